"""Line charts as SVG text: no plotting library, nothing to load, crisp at any size."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from math import ceil, floor, isfinite, log10
from re import sub

from envgraph.code import dataclass
from envgraph.draw import markup
from envgraph.errors import InvalidArgument

# After Okabe and Ito 2008, distinguishable with every common colour vision; darker on white and lighter on black:
# each has a contrast of at least 4.5.
COLOURS = ("#0072b2", "#b34700", "#00785a", "#a8437b", "#8a6100", "#4b4fc4", "#6e4f1f", "#555555")
COLOURS_ON_DARK = ("#56b4e9", "#ff9d5c", "#2fc79a", "#e79fc4", "#e69f00", "#a9a4ff", "#c9a86a", "#aab2b9")
"""Variables `--line-0` ... of a dark page may stand in for those above."""

_WIDTH, _HEIGHT = 720, 300
_LEFT, _RIGHT, _TOP, _BOTTOM = 74, 26, 14, 44


@dataclass(frozen=True, slots=True)
class Series:
    """A line, and optionally a band around it.

    Attributes:
        label: for the legend.
        x, y: coordinates of the points, of one length.
        low, high: the band's edges at the points, or ().
        marked: draw its points, too.
        dashed: draw it broken, for a baseline. So are, with longer dashes, lines for which no colour is left.
        number: which colour it has, so that one line has one in several charts; None for that of its place.
    """

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    dashed: bool = False
    marked: bool = False
    number: int | None = None

    def __post_init__(self) -> None:
        lengths = {len(self.x), len(self.y), *(len(edge) for edge in (self.low, self.high) if edge)}
        if len(lengths) != 1 or not self.x or bool(self.low) != bool(self.high):
            raise InvalidArgument(f"series `{self.label}` needs points, and as many values on every line")
        if not all(isfinite(value) for value in (*self.x, *self.y, *self.low, *self.high)):
            raise InvalidArgument(f"series `{self.label}` has a value that is not finite")


def ticks(low: float, high: float, about: int = 6, *, least: float = 0.0) -> list[float]:
    """Round numbers from at most `low` to at least `high`, a 1, 2 or 5 times a power of ten apart, and `least`.

    >>> ticks(0, 2.585)
    [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0]
    >>> ticks(0, 2, least=1)
    [0.0, 1.0, 2.0]
    """
    if not high > low:
        apart = max(0.5, 1e-9 * abs(low))  # one more or less is lost in the rounding of large numbers
        low, high = low - apart, high + apart
    rough = (high - low) / about
    power = 10.0 ** floor(log10(rough))
    step = max(least, next(power * factor for factor in (1, 2, 5, 10) if power * factor >= rough * 0.999))
    first, last = floor(low / step + 1e-9), ceil(high / step - 1e-9)
    return [round(number * step, 12) + 0.0 for number in range(first, last + 1)]


def line_chart(series: Sequence[Series], *, x_label: str, y_label: str, title: str) -> str:
    """An SVG element with axes, grid, lines, bands and a legend below.

    Args:
        series: at least one; drawn in order, later ones on top.
        x_label, y_label: what the axes show, with the unit.
        title: for readers that see no picture.
    """
    if not series:
        raise InvalidArgument("a chart needs at least one series")
    xs = [value for one in series for value in one.x]
    ys = [value for one in series for value in (*one.y, *one.low, *one.high)]
    whole = all(float(value).is_integer() for value in xs)  # there is no half a generation
    x_ticks, y_ticks = ticks(min(xs), max(xs), 8, least=float(whole)), ticks(min(ys), max(ys))
    # The x axis ends at the data: a curve that stops before the frame looks unfinished.
    frame = _Frame(min(xs), max(*xs, min(xs) + 1e-9), y_ticks[0], y_ticks[-1])
    columns = _columns(series)
    height = _HEIGHT + 20 * ceil(len(series) / columns)
    parts = [
        f'<svg class="chart" viewBox="0 0 {_WIDTH} {height}" role="img" aria-label="{markup(title)}">',
        f"<title>{markup(title)}</title>",
        *frame.axes([tick for tick in x_ticks if min(xs) <= tick <= max(xs)], y_ticks, x_label, y_label),
    ]
    numbers = [place if one.number is None else one.number for place, one in enumerate(series)]
    places = (number % len(COLOURS) for number in numbers)
    colours = [f"var(--line-{place}, {COLOURS[place]})" for place in places]
    parts.extend(frame.band(one, colour) for one, colour in zip(series, colours, strict=True) if one.low)
    dashes = [_dash(number, one) for number, one in zip(numbers, series, strict=True)]
    parts.extend(frame.line(*one) for one in zip(series, colours, dashes, strict=True))
    parts.extend(_legend(series, colours, dashes, columns))
    return "\n".join([*parts, "</svg>"])


def standalone(chart: str) -> str:
    """A chart as a file of its own: a page has the name space, the styles and the colours that this adds.

    >>> chart = line_chart([Series("a", (0, 1), (2, 3))], x_label="x", y_label="y", title="t")
    >>> standalone(chart).startswith('<svg xmlns="http://www.w3.org/2000/svg"')
    True
    """
    head, rest = chart.split("\n", 1)
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


def png(picture: str) -> bytes | None:
    """A chart that stands alone as pixels, two for each unit of its size; None without the extra `png`."""
    if find_spec("resvg_py") is None:
        return None
    from resvg_py import svg_to_bytes

    return bytes(svg_to_bytes(svg_string=picture, zoom=2.0))


@dataclass(frozen=True, slots=True)
class _Frame:
    """Maps data to pixels."""

    x_low: float
    x_high: float
    y_low: float
    y_high: float

    def x(self, value: float) -> float:
        return _LEFT + (value - self.x_low) / (self.x_high - self.x_low) * (_WIDTH - _LEFT - _RIGHT)

    def y(self, value: float) -> float:
        share = (value - self.y_low) / (self.y_high - self.y_low)
        return _HEIGHT - _BOTTOM - share * (_HEIGHT - _TOP - _BOTTOM)

    def axes(
        self, x_ticks: Sequence[float], y_ticks: Sequence[float], x_label: str, y_label: str
    ) -> list[str]:
        bottom, right = _HEIGHT - _BOTTOM, _WIDTH - _RIGHT
        parts = []
        for tick in y_ticks:
            y = self.y(tick)
            parts.append(f'<line class="grid" x1="{_LEFT}" x2="{right}" y1="{y:.1f}" y2="{y:.1f}"/>')
            parts.append(f'<text x="{_LEFT - 8}" y="{y + 4:.1f}" text-anchor="end">{_number(tick)}</text>')
        for tick in x_ticks:
            x = self.x(tick)
            parts.append(f'<line class="tick" x1="{x:.1f}" x2="{x:.1f}" y1="{bottom}" y2="{bottom + 4}"/>')
            parts.append(f'<text x="{x:.1f}" y="{bottom + 17}" text-anchor="middle">{_number(tick)}</text>')
        parts.append(f'<line class="axis" x1="{_LEFT}" x2="{right}" y1="{bottom}" y2="{bottom}"/>')
        middle = (_LEFT + right) / 2
        parts.append(f'<text x="{middle}" y="{bottom + 35}" text-anchor="middle">{markup(x_label)}</text>')
        centre = (_TOP + bottom) / 2
        turned = f'transform="rotate(-90 14 {centre})"'
        parts.append(f'<text x="14" y="{centre}" text-anchor="middle" {turned}>{markup(y_label)}</text>')
        return parts

    def points(self, xs: Sequence[float], ys: Sequence[float]) -> str:
        return " ".join(f"{self.x(x):.1f},{self.y(y):.1f}" for x, y in zip(xs, ys, strict=True))

    def line(self, series: Series, colour: str, dash: str) -> str:
        if len(series.x) == 1:
            x, y = self.x(series.x[0]), self.y(series.y[0])
            return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" style="fill: {colour}"/>'
        points = self.points(series.x, series.y)
        line = f'<polyline class="line" points="{points}" style="stroke: {colour}"{dash}/>'
        places = [point.partition(",") for point in points.split()] if series.marked else []
        dots = [f'<circle cx="{x}" cy="{y}" r="3" style="fill: {colour}"/>' for x, _, y in places]
        return "\n".join([line, *dots])

    def band(self, series: Series, colour: str) -> str:
        edge = self.points(series.x + series.x[::-1], series.high + series.low[::-1])
        return f'<polygon class="band" points="{edge}" style="fill: {colour}"/>'


def _dash(place: int, series: Series) -> str:
    """The attribute by which lines of one colour are distinguished."""
    round_ = place // len(COLOURS)
    dash = [5 + 9 * round_, 4] if series.dashed or round_ else []
    return f' stroke-dasharray="{" ".join(map(str, dash))}"' if dash else ""


def _columns(series: Sequence[Series]) -> int:
    """How many labels stand beside each other in a legend: letters are 7.5 wide, or less."""
    widest = 28 + 7.5 * max(len(one.label) for one in series) + 8
    return max(1, min(4, int((_WIDTH - _LEFT - _RIGHT) / widest)))


def _legend(
    series: Sequence[Series], colours: Sequence[str], dashes: Sequence[str], columns: int
) -> list[str]:
    column = (_WIDTH - _LEFT - _RIGHT) / columns
    parts = []
    for place, (one, colour, dash) in enumerate(zip(series, colours, dashes, strict=True)):
        x, y = _LEFT + place % columns * column, _HEIGHT + 10 + place // columns * 20
        parts.append(
            f'<line class="line" x1="{x}" x2="{x + 22}" y1="{y}" y2="{y}" style="stroke: {colour}"{dash}/>'
        )
        parts.append(f'<text x="{x + 28}" y="{y + 4}">{markup(one.label)}</text>')
    return parts


def _number(value: float) -> str:
    """A tick's label: thousands separated by a thin space, no trailing zeros."""
    return f"{value:,.0f}".replace(",", "\u2009") if abs(value) >= 1000 else f"{value:g}"
