"""Charts of an audit: points of several kinds, and intervals beside a line."""

from __future__ import annotations

from collections.abc import Sequence

from envgraph.code import dataclass
from envgraph.draw import markup
from envgraph.errors import InvalidArgument
from envgraph.report._charts import COLOURS, ticks

_WIDTH = 720
_PANEL, _GAP, _TOP, _BOTTOM, _LEFT = 200, 36, 24, 40, 40
_ROW, _LABELS, _VALUES = 22, 250, 150


@dataclass(frozen=True, slots=True)
class Panel:
    """One of several plots of points beside each other.

    Attributes:
        title: above it.
        points: of each kind x and y, in the order of the kinds.
    """

    title: str
    points: tuple[tuple[tuple[float, float], ...], ...]


@dataclass(frozen=True, slots=True)
class Interval:
    """A value with an interval, in a row of its own.

    Attributes:
        label: on the left.
        value, low, high: of the dot and of the bar.
        text: on the right.
        strong: whether it is drawn in colour.
    """

    label: str
    value: float
    low: float
    high: float
    text: str
    strong: bool = True


def scatter_chart(
    panels: Sequence[Panel], kinds: Sequence[str], *, x_label: str, y_label: str, title: str
) -> str:
    """An SVG element with three panels in a row, each with its own scale, and a legend of the kinds of points.

    Args:
        panels: at least one.
        kinds: what the points are, each with a colour.
        x_label, y_label: what the axes of all panels show.
        title: for readers that see no picture.
    """
    if not panels:
        raise InvalidArgument("a chart needs at least one panel")
    rows = -(-len(panels) // 3)
    height = rows * (_PANEL + _TOP + _BOTTOM) + 26
    parts = [
        f'<svg class="chart" viewBox="0 0 {_WIDTH} {height}" role="img" aria-label="{markup(title)}">',
        f"<title>{markup(title)}</title>",
    ]
    for place, panel in enumerate(panels):
        left = _LEFT + place % 3 * (_PANEL + _GAP)
        top = _TOP + place // 3 * (_PANEL + _TOP + _BOTTOM)
        parts += _panel(panel, left, top, x_label, y_label if place % 3 == 0 else "")
    for number, kind in enumerate(kinds):
        x, y = _LEFT + number * 165, height - 10
        parts.append(f'<circle cx="{x}" cy="{y}" r="4" style="fill: {_colour(number)}"/>')
        parts.append(f'<text x="{x + 10}" y="{y + 4}">{markup(kind)}</text>')
    return "\n".join([*parts, "</svg>"])


def _panel(panel: Panel, left: float, top: float, x_label: str, y_label: str) -> list[str]:
    every = [point for kind in panel.points for point in kind] or [(0.0, 0.0)]
    x_ticks, y_ticks = (ticks(min(one), max(one), 4) for one in zip(*every, strict=True))
    bottom = top + _PANEL

    def x_at(value: float) -> float:
        return left + (value - x_ticks[0]) / (x_ticks[-1] - x_ticks[0]) * _PANEL

    def y_at(value: float) -> float:
        return bottom - (value - y_ticks[0]) / (y_ticks[-1] - y_ticks[0]) * _PANEL

    parts = [f'<text x="{left + _PANEL / 2}" y="{top - 8}" text-anchor="middle">{markup(panel.title)}</text>']
    for tick in y_ticks:
        y = y_at(tick)
        parts.append(f'<line class="grid" x1="{left}" x2="{left + _PANEL}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(f'<text x="{left - 5}" y="{y + 4:.1f}" text-anchor="end">{tick:g}</text>')
    for tick in x_ticks:
        parts.append(f'<text x="{x_at(tick):.1f}" y="{bottom + 15}" text-anchor="middle">{tick:g}</text>')
    parts.append(f'<line class="axis" x1="{left}" x2="{left + _PANEL}" y1="{bottom}" y2="{bottom}"/>')
    middle = left + _PANEL / 2
    parts.append(f'<text x="{middle}" y="{bottom + 31}" text-anchor="middle">{markup(x_label)}</text>')
    if y_label:
        centre = top + _PANEL / 2
        turned = f'transform="rotate(-90 10 {centre})"'
        parts.append(f'<text x="10" y="{centre}" text-anchor="middle" {turned}>{markup(y_label)}</text>')
    for number, points in enumerate(panel.points):
        colour = _colour(number)
        for x, y in points:
            parts.append(
                f'<circle cx="{x_at(x):.1f}" cy="{y_at(y):.1f}" r="2.2" style="fill: {colour}; opacity: 0.65"/>'
            )
    return parts


def interval_chart(rows: Sequence[Interval], *, x_label: str, title: str) -> str:
    """An SVG element with a row for each value, its interval as a bar, and a line at 0.

    Args:
        rows: at least one, from the top.
        x_label: what the axis shows, with the unit.
        title: for readers that see no picture.
    """
    if not rows:
        raise InvalidArgument("a chart needs at least one row")
    x_ticks = ticks(min(0.0, *(one.low for one in rows)), max(0.0, *(one.high for one in rows)))
    right, bottom = _WIDTH - _VALUES, 10 + _ROW * len(rows)
    parts = [
        f'<svg class="chart" viewBox="0 0 {_WIDTH} {bottom + 44}" role="img" aria-label="{markup(title)}">',
        f"<title>{markup(title)}</title>",
    ]

    def x_at(value: float) -> float:
        return _LABELS + (value - x_ticks[0]) / (x_ticks[-1] - x_ticks[0]) * (right - _LABELS)

    for tick in x_ticks:
        x = x_at(tick)
        kind = "axis" if tick == 0.0 else "grid"
        parts.append(f'<line class="{kind}" x1="{x:.1f}" x2="{x:.1f}" y1="4" y2="{bottom}"/>')
        parts.append(f'<text x="{x:.1f}" y="{bottom + 16}" text-anchor="middle">{tick:g}</text>')
    for place, one in enumerate(rows):
        y = 10 + _ROW * (place + 0.5)
        colour = _colour(0) if one.strong else "var(--soft, #5b6773)"
        parts.append(f'<text x="{_LABELS - 10}" y="{y + 4}" text-anchor="end">{markup(one.label)}</text>')
        parts.append(
            f'<line class="line" x1="{x_at(one.low):.1f}" x2="{x_at(one.high):.1f}" y1="{y}" y2="{y}" '
            f'style="stroke: {colour}"/>'
        )
        parts.append(f'<circle cx="{x_at(one.value):.1f}" cy="{y}" r="3.5" style="fill: {colour}"/>')
        parts.append(f'<text x="{right + 10}" y="{y + 4}">{markup(one.text)}</text>')
    centre = (_LABELS + right) / 2
    parts.append(f'<text x="{centre}" y="{bottom + 34}" text-anchor="middle">{markup(x_label)}</text>')
    return "\n".join([*parts, "</svg>"])


def _colour(number: int) -> str:
    return f"var(--line-{number % len(COLOURS)}, {COLOURS[number % len(COLOURS)]})"
