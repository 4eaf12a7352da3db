"""Charts of an audit: scatter plots of several kinds of points, and intervals beside a zero line."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument
from envgraph.report._charts import (
    WIDTH,
    PlotArea,
    line_colour,
    svg_chart,
    svg_dot,
    svg_line,
    svg_text,
    tick_values,
)

_PANEL, _LEFT = 200, 40


@dataclass(frozen=True, slots=True)
class ScatterPanel:
    """A scatter plot, drawn beside others.

    Attributes:
        title: the text above the plot.
        points: for each kind, its points (x, y).
    """

    title: str
    points: tuple[tuple[tuple[float, float], ...], ...]


@dataclass(frozen=True, slots=True)
class IntervalRow:
    """A value with its interval, in one row of a chart.

    Attributes:
        label: the text on the left.
        value, low, high: the value of the dot, and the ends of the bar.
        text: the text on the right.
        is_highlighted: True to draw the row in colour, False in grey.
    """

    label: str
    value: float
    low: float
    high: float
    text: str
    is_highlighted: bool = True


def scatter_chart(
    panels: Sequence[ScatterPanel], kinds: Sequence[str], *, x_label: str, y_label: str, title: str
) -> str:
    """Return an SVG element with rows of three scatter plots, each with its own scale, and a legend of the kinds.

    Args:
        panels: at least one scatter plot.
        kinds: the names of the kinds of points, each of which has a colour.
        x_label, y_label: the labels of the axes of all panels.
        title: the description for screen readers.
    """
    if not panels:
        raise InvalidArgument("a chart needs at least one panel")
    height = -(-len(panels) // 3) * (_PANEL + 64) + 26
    parts: list[str] = []
    for place, panel in enumerate(panels):
        row, column = divmod(place, 3)
        left, top = _LEFT + column * (_PANEL + 36), 24 + row * (_PANEL + 64)
        parts += _draw_panel(panel, left, top, x_label, "" if column else y_label)
    for number, kind in enumerate(kinds):
        x, y = _LEFT + number * 165, height - 10
        parts += [svg_dot(x, y, line_colour(number), 4), svg_text(x + 10, y + 4, kind)]
    return svg_chart(height, title, parts)


def _draw_panel(panel: ScatterPanel, left: float, top: float, x_label: str, y_label: str) -> Iterator[str]:
    every = [point for kind in panel.points for point in kind] or [(0.0, 0.0)]
    x_ticks, y_ticks = (tick_values(min(one), max(one), 4) for one in zip(*every, strict=True))
    frame = PlotArea(left, top, _PANEL, _PANEL, x_ticks, y_ticks)
    yield svg_text(left + _PANEL / 2, top - 8, panel.title, "middle")
    yield from frame.axes(x_ticks, y_ticks, x_label, y_label)
    for number, points in enumerate(panel.points):
        for x, y in points:
            yield svg_dot(frame.x(x), frame.y(y), f"{line_colour(number)}; opacity: 0.65", 2.2)


def interval_chart(rows: Sequence[IntervalRow], *, x_label: str, title: str) -> str:
    """Return an SVG element with one row for each value, its interval as a bar, and a line at 0.

    Args:
        rows: at least one row, from the top.
        x_label: the label of the axis, with the unit.
        title: the description for screen readers.
    """
    if not rows:
        raise InvalidArgument("a chart needs at least one row")
    x_ticks = tick_values(min(0.0, *(one.low for one in rows)), max(0.0, *(one.high for one in rows)))
    frame = PlotArea(250, 10, WIDTH - 400, 22 * len(rows), x_ticks, (len(rows), 0))
    parts = [*frame.axes(x_ticks, (), x_label, "")]
    parts += [
        svg_line("grid" if tick else "axis", (frame.x(tick), frame.x(tick)), (4, frame.bottom)) for tick in x_ticks
    ]
    for place, one in enumerate(rows):
        y, shade = frame.y(place + 0.5), line_colour(0) if one.is_highlighted else "var(--soft, #5b6773)"
        parts += [
            svg_text(frame.left - 10, y + 4, one.label, "end"),
            svg_line("line", (frame.x(one.low), frame.x(one.high)), (y, y), f"stroke: {shade}"),
            svg_dot(frame.x(one.value), y, shade, 3.5),
            svg_text(frame.right + 10, y + 4, one.text),
        ]
    return svg_chart(frame.bottom + 44, title, parts)
