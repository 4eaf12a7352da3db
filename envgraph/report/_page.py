"""The report: one HTML page that needs nothing but itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

from jinja2 import PackageLoader
from markupsafe import Markup

from envgraph.code import dataclass
from envgraph.draw import colour_text, ink_on, parse_colour
from envgraph.env import Key
from envgraph.files import jinja_environment
from envgraph.report._charts import COLOURS_ON_DARK


@dataclass(frozen=True, slots=True)
class Card:
    """One environment of the family.

    Attributes:
        name: such as "E6".
        picture: SVG text.
        facts: label and value, shown below the picture.
        fixed: whether it is the initial environment.
    """

    name: str
    picture: str
    facts: tuple[tuple[str, str], ...]
    fixed: bool = False


@dataclass(frozen=True, slots=True)
class Table:
    """A table of text.

    Attributes:
        caption: what it shows.
        columns: heads.
        rows: as many cells each as there are heads.
        numeric: places of the columns that are set flush right.
    """

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numeric: frozenset[int] = frozenset()


@dataclass(frozen=True, slots=True)
class Section:
    """A headed part of the page: paragraphs, then charts (SVG text), then tables."""

    title: str
    text: tuple[str, ...] = ()
    charts: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()


@dataclass(frozen=True, slots=True)
class Report:
    """Everything that a report shows; the page is a function of it alone.

    Attributes:
        title, summary: head of the page.
        cards: the family, from the easiest environment to the target.
        legend: what is drawn on the cards.
        sections: in order.
        facts: how to make the same again (seed, versions, settings), shown at the end.
    """

    title: str
    summary: str
    cards: tuple[Card, ...] = ()
    legend: tuple[Key, ...] = ()
    sections: tuple[Section, ...] = ()
    facts: Mapping[str, str] = field(default_factory=dict)


def render_html(report: Report) -> str:
    """The page, as text. Everything but the pictures and charts is escaped.

    >>> "<h1>A &lt; B</h1>" in render_html(Report("A < B", ""))
    True
    """
    environment = jinja_environment(PackageLoader("envgraph.report"), ".html")
    return environment.get_template("report.html.j2").render(
        report=report,
        svg=Markup,
        ink=lambda colour: colour_text(ink_on(parse_colour(colour))),
        lines=COLOURS_ON_DARK,
    )
