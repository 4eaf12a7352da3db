"""Draw the charts of a family: bars of what agents reach, and a strip of the members' values with its bins."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from envgraph.code import dataclass
from envgraph.report._charts import WIDTH, PlotArea, line_colour, svg_chart, svg_dot, svg_line, svg_text, tick_values

_ROW, _TOP = 26, 12
_GREY = 7
"""The number of the grey among the colours of lines."""

_LETTER = 7.2
"""The width of most letters of a label, in pixels."""

_DOT, _MOST_DOTS, _MOST_NAMES = 11, 12, 24
"""The distance of dots in pixels, the most dots above each other, and the most members whose names are written."""


@dataclass(frozen=True, slots=True)
class Bar:
    """A bar of a bar chart.

    Attributes:
        label: the label at its left.
        value: the value where it ends.
        text: the value as text.
        interval: the ends of the interval of the value, drawn as a line; None if there is none.
        emphasised: True to draw the bar in the first colour; other bars are grey.
    """

    label: str
    value: float
    text: str
    interval: tuple[float, float] | None = None
    emphasised: bool = False


def bar_chart(bars: Sequence[Bar], *, x_label: str, title: str, whole: float | None = None) -> str:
    """Return an SVG element with horizontal bars, the first at the top.

    Args:
        bars: at least one bar.
        x_label: the label of the axis, with the unit.
        title: the description for screen readers; the texts of all bars are added.
        whole: the largest possible value; None to end the axis at the largest value.
    """
    ends = [end for bar in bars for end in (bar.value, *(bar.interval or ()))]
    ticks = tick_values(min(0.0, *ends), max(0.0, *ends) if whole is None else whole)
    left = min(260.0, 12 + _LETTER * max(len(bar.label) for bar in bars))
    right = 12 + _LETTER * max(len(bar.text) for bar in bars)
    frame = PlotArea(left, _TOP, WIDTH - left - right - 6, _ROW * len(bars), (ticks[0], ticks[-1]), (0.0, 1.0))
    parts = [svg_line("grid", (frame.x(tick), frame.x(tick)), (frame.top, frame.bottom)) for tick in ticks]
    parts += frame.axes(ticks, (), x_label, "")
    for place, bar in enumerate(bars):
        middle, start = frame.top + _ROW * (place + 0.5), frame.x(0.0)
        width, shade = frame.x(bar.value) - start, line_colour(0 if bar.emphasised else _GREY)
        parts.append(
            f'<rect class="{"bar" if bar.emphasised else "bar plain"}" x="{min(start, start + width):.1f}" '
            f'y="{middle - 8:.1f}" width="{max(1.5, abs(width)):.1f}" height="16" rx="2" style="fill: {shade}"/>'
        )
        if bar.interval is not None:
            parts.append(svg_line("whisker", (frame.x(bar.interval[0]), frame.x(bar.interval[1])), (middle, middle)))
        parts.append(svg_text(left - 8, middle + 4, _shorten(bar.label, left), "end"))
        parts.append(svg_text(frame.right + 8, middle + 4, bar.text))
    said = "; ".join(f"{bar.label} {bar.text}" for bar in bars)
    return svg_chart(frame.bottom + 44, f"{title}: {said}", parts)


def value_strip(
    values: Sequence[tuple[str, float]],
    *,
    x_label: str,
    bounds: Sequence[float] = (),
    others: Sequence[float] = (),
) -> str:
    """Return an SVG element with a dot for each member at its value, above an axis that is divided into bins.

    Args:
        values: name and value of each member, at least one.
        x_label: the label of the axis.
        bounds: the bounds of the bins, in increasing order; () if there are no bins.
        others: the values of all models that the search accepted, counted for each bin below the axis; () to leave
            the counts out. Values outside of the bounds count in the first or last bin.
    """
    found = [value for _, value in values]
    ticks = tick_values(min(*found, *bounds, found[0]), max(*found, *bounds, found[0]), 8)
    edges = bounds or (ticks[0], ticks[-1])
    ends = min(ticks[0], edges[0]), max(ticks[-1], edges[-1])
    frame = PlotArea(16, _TOP, WIDTH - 32, 0, ends, (0.0, 1.0))
    columns: dict[int, list[str]] = {}
    for name, value in values:
        columns.setdefault(round(frame.x(value) / _DOT), []).append(name)
    dots = max(len(names) for names in columns.values())
    frame = PlotArea(16, _TOP, WIDTH - 32, 20 + min(_MOST_DOTS, dots) * _DOT, ends, (0.0, 1.0))
    parts = [_draw_bin(frame, *pair, place % 2) for place, pair in enumerate(pairwise(bounds))]
    for column, names in columns.items():
        parts += _draw_column(frame, column * _DOT, names, named=len(values) <= _MOST_NAMES)
    parts += frame.axes(ticks, (), x_label, "")
    height = frame.bottom + 44
    said = ", ".join(f"{name} {value:g}" for name, value in values[:_MOST_NAMES])
    if bounds and others:
        height += 18
        counts = _bin_counts(bounds, others)
        for (low, high), count in zip(pairwise(bounds), counts, strict=True):
            parts.append(svg_text((frame.x(low) + frame.x(high)) / 2, height - 8, f"{count:,}", "middle"))
        said += f"; accepted models in each bin: {', '.join(map(str, counts))}"
    return svg_chart(height, f"{x_label} of the members: {said}", parts)


def _bin_counts(bounds: Sequence[float], values: Sequence[float]) -> list[int]:
    counts = [0] * (len(bounds) - 1)
    for value in values:
        counts[min(max(0, sum(value >= bound for bound in bounds) - 1), len(counts) - 1)] += 1
    return counts


def _draw_bin(frame: PlotArea, low: float, high: float, shade: int) -> str:
    """Return the background of a bin; neighbours differ by `shade`, 0 or 1."""
    x, width = frame.x(low), frame.x(high) - frame.x(low)
    return (
        f'<rect class="bin shade-{shade}" x="{x:.1f}" y="{frame.top}" width="{width:.1f}" height="{frame.height:.1f}"/>'
    )


def _draw_column(frame: PlotArea, x: float, names: Sequence[str], *, named: bool) -> list[str]:
    """Return the dots of members with about equal values, upwards from the axis, with names if there is space."""
    if len(names) > _MOST_DOTS:
        parts = [svg_dot(x, frame.bottom - (row + 0.5) * _DOT, line_colour(0), 4) for row in range(_MOST_DOTS - 1)]
        return [*parts, svg_text(x, frame.bottom - (_MOST_DOTS - 0.8) * _DOT, f"{len(names)}", "middle")]
    parts = [svg_dot(x, frame.bottom - (row + 0.5) * _DOT, line_colour(0), 4) for row in range(len(names))]
    if named:
        text = ", ".join(names[:2]) + (f" and {len(names) - 2}" if len(names) > 2 else "")
        parts.append(svg_text(x, frame.bottom - len(names) * _DOT - 5, text, "middle"))
    return parts


def _shorten(label: str, width: float) -> str:
    """Return a label, cut to the letters that fit into a width in pixels."""
    letters = int((width - 12) / _LETTER + 0.5)
    return label if len(label) <= letters else label[: letters - 1].rstrip() + "\N{HORIZONTAL ELLIPSIS}"
