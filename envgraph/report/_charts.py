"""Draw line charts as SVG text, without a plotting library."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from importlib.util import find_spec
from math import ceil, floor, isfinite, log10
from re import sub
from typing import Final

from envgraph.code import dataclass
from envgraph.draw import escape_markup
from envgraph.errors import InvalidArgument

# After Okabe and Ito 2008, distinguishable with every common colour vision; darker on white and lighter on black:
# each has a contrast of at least 4.5.
COLOURS = ("#0072b2", "#b34700", "#00785a", "#a8437b", "#8a6100", "#4b4fc4", "#6e4f1f", "#555555")
COLOURS_ON_DARK = ("#56b4e9", "#ff9d5c", "#2fc79a", "#e79fc4", "#e69f00", "#a9a4ff", "#c9a86a", "#aab2b9")
"""Colours for dark pages, which the page sets as the CSS variables `--line-0` and so on."""

WIDTH: Final = 720
"""Width of every chart, in pixels."""


@dataclass(frozen=True, slots=True)
class Series:
    """A line of a chart, with an optional band around it.

    Attributes:
        label: the label in the legend.
        x, y: the coordinates of the points, of equal length.
        low, high: the band's edges at the points, or ().
        has_points: True to draw the points, too.
        is_dashed: True to dash the line, for a baseline. Lines without a colour of their own get longer dashes.
        number: the number of the line's colour, so that a line has the same colour in several charts; None for the
            position of the line.
    """

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    is_dashed: bool = False
    has_points: bool = False
    number: int | None = None

    def __post_init__(self) -> None:
        lengths = {len(self.x), len(self.y), *(len(edge) for edge in (self.low, self.high) if edge)}
        if len(lengths) != 1 or not self.x or bool(self.low) != bool(self.high):
            raise InvalidArgument(f"series `{self.label}` needs points, and `x`, `y`, `low` and `high` of equal length")
        if not all(isfinite(value) for value in (*self.x, *self.y, *self.low, *self.high)):
            raise InvalidArgument(f"series `{self.label}` has a value that is not finite")


def tick_values(low: float, high: float, about: int = 6, *, least: float = 0.0) -> list[float]:
    """Return evenly spaced round numbers that cover `low` to `high`, about `about` of them.

    The step is 1, 2 or 5 times a power of ten, and at least `least`.

    >>> tick_values(0, 2.585)
    [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0]
    >>> tick_values(0, 2, least=1)
    [0.0, 1.0, 2.0]
    """
    if not high > low:
        apart = max(0.5, 1e-9 * abs(low))  # for large numbers a difference of 1 is lost by rounding
        low, high = low - apart, high + apart
    rough = (high - low) / about
    power = 10.0 ** floor(log10(rough))
    step = max(least, next(power * factor for factor in (1, 2, 5, 10) if power * factor >= rough * 0.999))
    first, last = floor(low / step + 1e-9), ceil(high / step - 1e-9)
    return [round(number * step, 12) + 0.0 for number in range(first, last + 1)]


def line_chart(series: Sequence[Series], *, x_label: str, y_label: str, title: str) -> str:
    """Return an SVG element with axes, grid, lines, bands and a legend below.

    Args:
        series: at least one line; later lines are drawn on top of earlier ones.
        x_label, y_label: the labels of the axes, with the unit.
        title: the description for screen readers.
    """
    if not series:
        raise InvalidArgument("a chart needs at least one series")
    xs = [value for one in series for value in one.x]
    ys = [value for one in series for value in (*one.y, *one.low, *one.high)]
    whole = all(float(value).is_integer() for value in xs)  # no tick at half a generation
    x_ticks, y_ticks = tick_values(min(xs), max(xs), 8, least=float(whole)), tick_values(min(ys), max(ys))
    # The x axis ends at the data, because a curve that stops before the frame looks unfinished.
    x_range = min(xs), max(*xs, min(xs) + 1e-9)
    frame = PlotArea(74, 14, WIDTH - 100, 242, x_range, y_ticks)
    x_ticks = [tick for tick in x_ticks if min(xs) <= tick <= max(xs)]
    numbers = [place if one.number is None else one.number for place, one in enumerate(series)]
    drawn = [
        (one, line_colour(number), _dash_attribute(number, one)) for number, one in zip(numbers, series, strict=True)
    ]
    # Letters of the legend are at most 7.5 pixels wide.
    columns = max(1, min(4, int(frame.width / (36 + 7.5 * max(len(one.label) for one in series)))))
    parts = [
        *frame.axes(x_ticks, y_ticks, x_label, y_label),
        *(_draw_band(frame, one, shade) for one, shade, _ in drawn if one.low),
        *(_draw_curve(frame, *one) for one in drawn),
    ]
    for place, (one, shade, dash) in enumerate(drawn):
        x, y = frame.left + place % columns * frame.width / columns, 310 + place // columns * 20
        parts += [
            svg_line("line", (x, x + 22), (y, y), f"stroke: {shade}", dash),
            svg_text(x + 28, y + 4, one.label),
        ]
    return svg_chart(300 + 20 * ceil(len(series) / columns), title, parts)


def standalone_chart(drawn: str) -> str:
    """Return a chart as the text of an SVG file, with the namespace, styles and colours that a page would provide.

    >>> drawn = line_chart([Series("a", (0, 1), (2, 3))], x_label="x", y_label="y", title="t")
    >>> standalone_chart(drawn).startswith('<svg xmlns="http://www.w3.org/2000/svg"')
    True
    """
    head, rest = drawn.split("\n", 1)
    style = (
        "text { font: 12px sans-serif; fill: #444 } .grid { stroke: #ddd } .axis, .tick { stroke: #888 } "
        ".line { fill: none; stroke-width: 2 } .band { opacity: .16 }"
    )
    return (
        head.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1)
        + f'\n<style>{style}</style>\n<rect width="100%" height="100%" fill="white"/>\n'
        + sub(r"var\(--line-\d+, (#\w+)\)", r"\1", rest)
        + "\n"
    )


def chart_png(picture: str) -> bytes | None:
    """Return a standalone chart as PNG, two pixels for each unit of its size; None without the extra `chart_png`."""
    if find_spec("resvg_py") is None:
        return None
    from resvg_py import svg_to_bytes

    return bytes(svg_to_bytes(svg_string=picture, zoom=2.0))


def svg_chart(height: float, title: str, parts: Iterable[str]) -> str:
    """Return an SVG element that is `WIDTH` wide; the title is its description for screen readers."""
    head = f'<svg class="chart" viewBox="0 0 {WIDTH} {height}" role="img" aria-label="{escape_markup(title)}">'
    return "\n".join([head, f"<title>{escape_markup(title)}</title>", *parts, "</svg>"])


def svg_text(x: float, y: float, words: str, anchor: str = "", *, is_vertical: bool = False) -> str:
    """Return an SVG text element at a position; `anchor` is its `text-anchor`, and `is_vertical` makes it read
    upwards.
    """
    style = f' text-anchor="{anchor}"' if anchor else ""
    style += f' transform="rotate(-90 {x:.1f} {y:.1f})"' if is_vertical else ""
    return f'<text x="{x:.1f}" y="{y:.1f}"{style}>{escape_markup(words)}</text>'


def svg_line(css_class: str, xs: tuple[float, float], ys: tuple[float, float], style: str = "", dash: str = "") -> str:
    """Return an SVG line from (xs[0], ys[0]) to (xs[1], ys[1]); `css_class` is its class in the style sheet."""
    ends = f'x1="{xs[0]:.1f}" x2="{xs[1]:.1f}" y1="{ys[0]:.1f}" y2="{ys[1]:.1f}"'
    return f'<line class="{css_class}" {ends}' + (f' style="{style}"' if style else "") + f"{dash}/>"


def svg_dot(x: float, y: float, style: str, radius: float = 3) -> str:
    """Return a filled SVG circle; `style` is its CSS colour."""
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius}" style="fill: {style}"/>'


def line_colour(number: int) -> str:
    """Return the CSS colour of a line or kind of points; pages in dark mode override it."""
    place = number % len(COLOURS)
    return f"var(--line-{place}, {COLOURS[place]})"


@dataclass(frozen=True, slots=True)
class PlotArea:
    """The plot area of a chart, in pixels, and the ranges of its data.

    Attributes:
        x_range, y_range: the first value is at the left or bottom edge, the last value at the right or top edge.
    """

    left: float
    top: float
    width: float
    height: float
    x_range: Sequence[float]
    y_range: Sequence[float]

    @property
    def right(self) -> float:
        """Return the right edge, in pixels."""
        return self.left + self.width

    @property
    def bottom(self) -> float:
        """Return the lower edge, in pixels from the top of the chart."""
        return self.top + self.height

    def x(self, value: float) -> float:
        """Return the position of a data value, in pixels from the left."""
        return self.left + (value - self.x_range[0]) / (self.x_range[-1] - self.x_range[0]) * self.width

    def y(self, value: float) -> float:
        """Return the position of a data value, in pixels from the top."""
        return self.bottom - (value - self.y_range[0]) / (self.y_range[-1] - self.y_range[0]) * self.height

    def axes(self, x_ticks: Sequence[float], y_ticks: Sequence[float], x_label: str, y_label: str) -> Iterator[str]:
        """Yield SVG elements of the axes with their labels, and a horizontal grid line for each y tick."""
        across, bottom = (self.left, self.right), self.bottom
        for tick in y_ticks:
            y = self.y(tick)
            yield svg_line("grid", across, (y, y))
            yield svg_text(self.left - 5, y + 4, _format_tick(tick), "end")
        for tick in x_ticks:
            x = self.x(tick)
            yield svg_line("tick", (x, x), (bottom, bottom + 4))
            yield svg_text(x, bottom + 17, _format_tick(tick), "middle")
        yield svg_line("axis", across, (bottom, bottom))
        yield svg_text(self.left + self.width / 2, bottom + 35, x_label, "middle")
        if y_label:
            yield svg_text(10, self.top + self.height / 2, y_label, "middle", is_vertical=True)

    def points(self, xs: Sequence[float], ys: Sequence[float]) -> str:
        """Return data points in the format of SVG's `points` attribute."""
        return " ".join(f"{self.x(x):.1f},{self.y(y):.1f}" for x, y in zip(xs, ys, strict=True))


def _draw_curve(frame: PlotArea, series: Series, shade: str, dash: str) -> str:
    points = f'points="{frame.points(series.x, series.y)}" style="stroke: {shade}"{dash}'
    alone = len(series.x) == 1
    places = zip(series.x, series.y, strict=True) if series.has_points or alone else ()
    dots = [svg_dot(frame.x(x), frame.y(y), shade) for x, y in places]
    return "\n".join([*([] if alone else [f'<polyline class="line" {points}/>']), *dots])


def _draw_band(frame: PlotArea, series: Series, shade: str) -> str:
    edge = frame.points(series.x + series.x[::-1], series.high + series.low[::-1])
    return f'<polygon class="band" points="{edge}" style="fill: {shade}"/>'


def _dash_attribute(colour_number: int, series: Series) -> str:
    """Return the dash attribute of a dashed line, or of a line whose colour occurs before; "" for a solid line."""
    round_ = colour_number // len(COLOURS)
    dash = [5 + 9 * round_, 4] if series.is_dashed or round_ else []
    return f' stroke-dasharray="{" ".join(map(str, dash))}"' if dash else ""


def _format_tick(value: float) -> str:
    """Format a tick's label: thousands separated by commas, no trailing zeros."""
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:g}"
