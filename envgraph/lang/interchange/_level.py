"""A level of another tool, as rows of named cells."""

from __future__ import annotations

from envgraph.code import dataclass
from envgraph.errors import Span

BLANK = " "


@dataclass(frozen=True, slots=True)
class LevelCell:
    """A cell: what it may be called, the first name first, and where it is written.

    A letter has one name, an empty floor of Sokoban three; a tile of Tiled has its class, if there is one, and number.
    """

    names: tuple[str, ...]
    where: Span


@dataclass(frozen=True, slots=True)
class Level:
    """A level: its rows from the top, equally long; `title` is "" if it has none, `where` is its first row."""

    title: str
    where: Span
    rows: tuple[tuple[LevelCell, ...], ...]
