"""Render a report as one HTML page without external files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

from jinja2 import PackageLoader
from markupsafe import Markup

from envgraph.code import dataclass
from envgraph.draw import format_colour, ink_on, parse_colour
from envgraph.env import LegendEntry
from envgraph.files import jinja_environment
from envgraph.report._charts import COLOURS_ON_DARK
from envgraph.search import LineageBranch


@dataclass(frozen=True, slots=True)
class Card:
    """The picture and facts of one environment of the family on the page.

    Attributes:
        name: the name, such as "E6".
        picture: SVG text.
        facts: labels and values, shown below the picture.
        fixed: True for the initial environment.
    """

    name: str
    picture: str
    facts: tuple[tuple[str, str], ...]
    fixed: bool = False


@dataclass(frozen=True, slots=True)
class ReportTable:
    """A table of text.

    Attributes:
        caption: a description of the table.
        columns: the column heads.
        rows: rows with one cell for each column.
        numeric: the positions of right-aligned columns.
    """

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numeric: frozenset[int] = frozenset()


@dataclass(frozen=True, slots=True)
class ReportSection:
    """A part of the page with a heading: paragraphs, then charts (SVG text), then tables, then a tree of changes."""

    title: str
    text: tuple[str, ...] = ()
    charts: tuple[str, ...] = ()
    tables: tuple[ReportTable, ...] = ()
    lineage: LineageBranch | None = None


@dataclass(frozen=True, slots=True)
class Report:
    """The content of a report page.

    Attributes:
        title, summary: the head of the page.
        verdict: a sentence that says what the family is worth; "" for a page without one.
        chart: SVG text of the chart below the verdict; "" for none.
        cards: the family, from the easiest environment to the target.
        legend: the symbols that occur on the cards.
        sections: the sections in their order on the page.
        facts: what is needed to repeat the run (seed, versions, settings), shown at the end.
    """

    title: str
    summary: str
    verdict: str = ""
    chart: str = ""
    cards: tuple[Card, ...] = ()
    legend: tuple[LegendEntry, ...] = ()
    sections: tuple[ReportSection, ...] = ()
    facts: Mapping[str, str] = field(default_factory=dict)


def render_html(report: Report) -> str:
    """Return the HTML text of a report. Everything except pictures and charts is escaped.

    >>> "<h1>A &lt; B</h1>" in render_html(Report("A < B", ""))
    True
    """
    environment = jinja_environment(PackageLoader("envgraph.report"), ".html")
    return environment.get_template("report.html.j2").render(
        report=report,
        svg=Markup,
        ink=lambda colour: format_colour(ink_on(parse_colour(colour))),
        lines=COLOURS_ON_DARK,
    )
