"""Write tables and texts as HTML for notebooks, without colours, so that they suit light and dark themes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields
from itertools import islice
from typing import Any

from envgraph.draw._diagram_data import escape_markup, shorten
from envgraph.errors import SHOWN, EnvgraphError


def html_table(
    rows: Iterable[Sequence[object]], head: Sequence[str] = (), caption: str = "", total: int | None = None
) -> str:
    """Return a table of escaped texts. Only the first 100 rows are shown, and a line below counts the others.

    Args:
        rows: the rows of values. Strings are shown as they are, floats with four digits, other values by their `repr`.
        head: the heads of the columns. Without heads, the first cell of each row is the head of the row.
        caption: a description above the table; "" for none.
        total: the number of rows; None to count `rows`, which must then be finite.

    >>> html_table([("states", 127), ("actions", "left, right")])
    '<table><tr><th>states</th><td>127</td></tr><tr><th>actions</th><td>left, right</td></tr></table>'
    """
    remaining = iter(rows)
    shown = list(islice(remaining, SHOWN.rows))
    hidden = total - len(shown) if total is not None else sum(1 for _ in remaining)
    lines = [f"<caption>{escape_markup(caption)}</caption>"] if caption else []
    if head:
        lines.append(f"<tr>{''.join(f'<th>{escape_markup(name)}</th>' for name in head)}</tr>")
    for row in shown:
        cells = [escape_markup(shorten(_cell_text(value), SHOWN.message)) for value in row]
        first = f"<td>{cells[0]}</td>" if head else f"<th>{cells[0]}</th>"
        lines.append(f"<tr>{first}{''.join(f'<td>{cell}</td>' for cell in cells[1:])}</tr>")
    more = f"<p>and {hidden:,} more</p>" if hidden else ""
    return f"<table>{''.join(lines)}</table>{more}"


def _cell_text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, int) and not isinstance(value, bool):
        return f"{value:,}"
    return value if isinstance(value, str) else repr(value)


def html_text(item: object) -> str:
    """Return the text of an object, `str(item)`, with its line breaks. Classes use it as their `_repr_html_`."""
    lines = str(item).splitlines()
    more = [f"and {len(lines) - SHOWN.lines:,} more lines"] if len(lines) > SHOWN.lines else []
    return f"<pre>{'<br>'.join(map(escape_markup, [*lines[: SHOWN.lines], *more]))}</pre>"


def html_picture(draw: Callable[[], str | None]) -> str:
    """Return the SVG that `draw` returns, or a sentence if `draw` raises an error or the SVG is too long."""
    try:
        svg = draw() or ""
    except EnvgraphError as error:
        return f"<p>no picture: {escape_markup(error.message)}</p>"
    return svg if len(svg) <= SHOWN.markup else "<p>the picture is too large for a notebook</p>"


def html_fields(item: Any) -> str:
    """Return a table of the fields of a data class. Classes use it as their `_repr_html_`."""
    return html_table((one.name.replace("_", " "), getattr(item, one.name)) for one in fields(item) if one.repr)
