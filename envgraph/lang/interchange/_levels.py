"""Levels of other tools as rows of named cells: texts of letters (XSB), MAP parts of des-files, Tiled's maps."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, LoadError, Source, Span
from envgraph.lang.interchange._level import BLANK, Level, LevelCell
from envgraph.lang.interchange._tiled import read_tiled
from envgraph.lang.syntax._formats import suffix_of

FLOORS = (BLANK, "_", "-")
"""Letters for an empty floor in files of Sokoban; where a legend has only some of them, they stand for each other."""
_XSB = ("xsb", "sok")

_BEFORE = re.compile(r"\s*;\s*(.*)")
_BEHIND = re.compile(r"\s*title\s*:\s*(.*)", re.IGNORECASE)
_DES = re.compile(r"(?:MAZE|LEVEL)\s*:\s*\"([^\"]*)\"")


def read_levels(source: Source, letters: Collection[str]) -> tuple[Level, ...]:
    """The levels of a file, in its order; its suffix says what it is.

    `.tmx` and `.tmj` (also `.json`) are maps of Tiled. In `.des` a level stands between `MAP` and `ENDMAP`. In any
    other file a level is a run of rows: lines of which more than half is `letters`. `; name` before it is its title,
    or `Title: name` behind it.

    Raises:
        LoadError: there is none, or the map is not one that can be read; all problems at once.
    """
    suffix = suffix_of(source.name)
    if suffix in ("tmx", "tmj", "json"):
        return (read_tiled(source),)
    found = tuple(_des_levels(source) if suffix == "des" else _text_levels(source, letters))
    if not found:
        hint = "a map stands between `MAP` and `ENDMAP`" if suffix == "des" else _known(letters)
        raise LoadError([Diagnostic("no-level", "the file has no level", source.span(0, 0), hint)])
    return found


def _known(letters: Collection[str]) -> str:
    return f"the letters are {', '.join(f'`{one}`' for one in letters)}"


@dataclass(frozen=True, slots=True)
class _Line:
    text: str
    where: Span


def _lines(source: Source) -> Iterator[_Line]:
    start = 0
    for line in source.text.split("\n"):
        text = line.rstrip()
        yield _Line(text, source.span(start, start + len(text)))
        start += len(line) + 1


def _text_levels(source: Source, letters: Collection[str]) -> list[Level]:
    known = {*letters, *(FLOORS if suffix_of(source.name) in _XSB else (BLANK,))}
    levels, rows, title = list[Level](), list[_Line](), ""
    for line in (*_lines(source), _Line("", source.span(0, 0))):
        if _is_row(line.text, known):
            rows.append(line)
            continue
        if rows:
            levels.append(_level(title, rows))
            rows, title = [], ""
        if before := _BEFORE.fullmatch(line.text):
            title = before.group(1)
        elif (behind := _BEHIND.fullmatch(line.text)) and levels:
            levels[-1] = replace(levels[-1], title=behind.group(1))
    return levels


def _is_row(line: str, known: Collection[str]) -> bool:
    text = line.strip()
    return text[:1] not in ("", ";") and 2 * sum(letter in known for letter in text) > len(text)


def _level(title: str, rows: Sequence[_Line]) -> Level:
    width = max(len(row.text) for row in rows)
    return Level(title, rows[0].where, tuple(tuple(_cells(row, width)) for row in rows))


def _cells(row: _Line, width: int) -> Iterator[LevelCell]:
    """The cells of a row; where it ends early they are blank."""
    source, start = row.where.source, row.where.start
    floors = FLOORS if suffix_of(source.name) in _XSB else ()
    for column, letter in enumerate(row.text.ljust(width)):
        place = min(start + column, row.where.end)
        names = _as_floor(letter) if letter in floors else (letter,)
        yield LevelCell(names, source.span(place, min(place + 1, row.where.end)))


def _as_floor(letter: str) -> tuple[str, ...]:
    """A blank is better written as another floor: nobody sees how many blanks there are."""
    first = () if letter == BLANK else (letter,)
    return (*first, *(one for one in FLOORS[1:] if one != letter), BLANK)


def _des_levels(source: Source) -> Iterator[Level]:
    title, rows, inside = "", list[_Line](), False
    for line in _lines(source):
        word = line.text.strip()
        if inside and word == "ENDMAP":
            if rows:
                yield _level(title, rows)
            inside = False
        elif inside:
            rows.append(line)
        elif word == "MAP":
            inside, rows = True, []
        elif found := _DES.match(word):
            title = found.group(1)
