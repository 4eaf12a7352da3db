"""Join pictures in one SVG file: an episode as an animation, and pictures side by side.

The joined pictures mostly have the same elements, such as the walls of a maze. Each element is written once, so that an
animation of twenty frames is hardly larger than one frame.

A picture is a text that `envgraph.env.scene` or `envgraph.draw` wrote: one line for the `<svg>` tag, one for the title,
one or more lines for each element, and `</svg>`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from itertools import groupby

from envgraph.draw import escape_markup

BORDER = 12
"""The width of the border around pictures in CSS pixels."""

LEAST_LETTERS, WIDE = 14, 28
"""The size of the letters of captions: at least 14 pixels, and larger in a picture wider than 28 letters, because a
narrow screen shrinks it."""

INK, SOFT = "#1f2933", "#52606d"
"""The colours of captions; both are readable on white."""

STEP_SECONDS, LAST_STEPS, ROUNDS = 0.6, 4, 3
"""The seconds for which a frame is shown, the length of the last frame in steps, and how often an animation runs."""


@dataclass(frozen=True)
class Frame:
    """A picture of an animation, with a text at the left and at the right of the line below."""

    svg: str
    left: str
    right: str = ""


@dataclass(frozen=True)
class Group:
    """Elements that lie one above the other in all pictures that show them; `pictures` are the numbers of these."""

    pictures: frozenset[int]
    elements: tuple[str, ...]


def film(frames: Sequence[Frame], title: str, *, least_width: int = 250) -> str:
    """Return an animated SVG that shows the frames three times, and then the first frame.

    Without animation it shows the first frame: if the reader has asked for reduced motion, and in print.

    Args:
        frames: the frames; their pictures have the same size.
        title: a sentence that describes the animation.
        least_width: the smallest width in CSS pixels, so that the texts below the picture have room.
    """
    width, height = size_of(frames[0].svg)
    assert all(size_of(frame.svg) == (width, height) for frame in frames), "frames have the same size"
    inner = max(width, least_width)
    letters = _letters(inner)
    line = BORDER + height + 1.5 * letters
    texts = [
        _text(BORDER, line, letters, frame.left) + _text(BORDER + inner, line, letters, frame.right, "end")
        for frame in frames
    ]
    tag = _nested(frames[0].svg, BORDER + (inner - width) / 2, BORDER, width, height)
    films = {frozenset(range(len(frames))): ""}
    body = [tag, *_film_groups(merge([elements_of(frame.svg) for frame in frames]), films), "</svg>"]
    body += _film_groups(merge([[text] for text in texts]), films)
    return _document(2 * BORDER + inner, line + BORDER, title, [_film_style(films, len(frames)), *body])


def _film_groups(groups: Iterable[Group], films: dict[frozenset[int], str]) -> list[str]:
    """Return the elements of groups, with a class for each set of frames, which is added to `films`."""
    lines = []
    for group in groups:
        name = films.setdefault(group.pictures, f"f{len(films)}")
        hidden = "" if 0 in group.pictures else ' visibility="hidden"'
        lines += [f'<g class="{name}"{hidden}>', *group.elements, "</g>"] if name else group.elements
    return lines


def _film_style(films: dict[frozenset[int], str], count: int) -> str:
    """Return a style sheet that shows the groups of each class in their frames."""
    steps = count - 1 + LAST_STEPS
    rules = []
    for shown, name in films.items():
        turns = [number for number in range(1, count) if (number in shown) != (number - 1 in shown)]
        keys = "".join(
            f"{100 * turn / steps:.2f}%{{visibility:{'visible' if turn in shown else 'hidden'}}}" for turn in turns
        )
        if name:
            rules.append(
                f"@keyframes {name}{{{keys}}}.{name}{{animation:{name} {steps * STEP_SECONDS:g}s step-end {ROUNDS}}}"
            )
    return "<style>@media screen and (prefers-reduced-motion:no-preference){\n" + "\n".join(rules) + "\n}</style>"


def sheet(pictures: Sequence[tuple[str, str]], title: str, *, columns: int = 3, size: int = 150) -> str:
    """Return an SVG with pictures in rows, each with a text below.

    Args:
        pictures: pairs of a picture and its text.
        title: a sentence that describes all pictures.
        columns: the number of pictures in a row.
        size: the width of a picture in CSS pixels. The tallest picture determines the height of the rows.
    """
    sizes = [size_of(svg) for svg, _ in pictures]
    heights = [size * height / width for width, height in sizes]
    columns, high = min(columns, len(pictures)), max(heights)
    width = BORDER + columns * (size + BORDER)
    letters = _letters(width)
    row = high + 2 * letters + BORDER
    shared, shown = [], [list[str]() for _ in pictures]
    for number, group in enumerate(merge([elements_of(svg) for svg, _ in pictures])):
        once = len(group.pictures) > 1
        if once:
            shared += [f'<g id="g{number}">', *group.elements, "</g>"]
        for place in group.pictures:
            shown[place] += [f'<use href="#g{number}"/>'] if once else group.elements
    body = ["<defs>", *shared, "</defs>"] if shared else []
    for place, ((svg, text), elements) in enumerate(zip(pictures, shown, strict=True)):
        x, y = BORDER + place % columns * (size + BORDER), BORDER + place // columns * row
        body += [_nested(svg, x, y + high - heights[place], size, heights[place]), *elements, "</svg>"]
        body.append(_text(x + size / 2, y + high + 1.4 * letters, letters, text, "middle"))
    return _document(width, BORDER + -(-len(pictures) // columns) * row, title, body)


def tile(svg: str, title: str, words: str, *, size: int = 160) -> str:
    """Return a picture as a part of a gallery: all tiles have the same size. Two fit on the screen of a phone."""
    width, height = size_of(svg)
    room, high = size - 2 * BORDER, size - 2 * BORDER - 2.4 * LEAST_LETTERS
    scale = min(room / width, high / height)
    x, y = BORDER + (room - scale * width) / 2, BORDER + (high - scale * height) / 2
    body = [_nested(svg, x, y, scale * width, scale * height), *elements_of(svg), "</svg>"]
    body.append(f'<g font-weight="bold">{_text(size / 2, size - BORDER - 16, LEAST_LETTERS, title, "middle")}</g>')
    body.append(_text(size / 2, size - BORDER + 2, LEAST_LETTERS - 3, words, "middle"))
    return _document(size, size, f"{title}: {words}", body)


def merge(pictures: Sequence[Sequence[str]]) -> list[Group]:
    """Return groups of elements such that the groups of each picture are its elements, in their order.

    >>> for group in merge([["wall", "red", "hero"], ["wall", "blue", "hero"]]):
    ...     print(sorted(group.pictures), *group.elements)
    [0, 1] wall
    [0] red
    [1] blue
    [0, 1] hero
    """
    merged = [(element, {0}) for element in pictures[0]]
    for number, elements in enumerate(pictures[1:], 1):
        known, longer = [element for element, _ in merged], []
        for kind, first, last, begin, end in SequenceMatcher(None, known, elements, autojunk=False).get_opcodes():
            old = merged[first:last]
            longer += [(element, shown | {number}) for element, shown in old] if kind == "equal" else old
            longer += [] if kind == "equal" else [(element, {number}) for element in elements[begin:end]]
        merged = longer
    runs = groupby(merged, key=lambda pair: pair[1])
    return [Group(frozenset(shown), tuple(element for element, _ in run)) for shown, run in runs]


def size_of(svg: str) -> tuple[float, float]:
    """Return the width and height of a picture in CSS pixels."""
    width, height = re.findall(r'\s(?:width|height)="([\d.]+)"', svg.split(">", 1)[0])
    return float(width), float(height)


def elements_of(svg: str) -> list[str]:
    """Return the elements of a picture without its title: one or more lines, with as many tags opened as closed."""
    elements, depth = [], 0
    for line in svg.removesuffix("\n").split("\n")[1:-1]:
        depth_before, depth = depth, depth + len(re.findall(r"<[a-z]", line)) - len(re.findall(r"</|/>", line))
        if depth_before:
            elements[-1] += "\n" + line
        else:
            elements.append(line)
    return elements[1:] if elements[0].startswith("<title>") else elements


def _nested(svg: str, x: float, y: float, width: float, height: float) -> str:
    """Return the tag of a picture at a position and with a size inside another one."""
    head = re.sub(r'\s(width|height|xmlns|role|aria-label)="[^"]*"', "", svg.split(">", 1)[0])
    return f'{head} x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}">'


def _letters(width: float) -> int:
    """Return the size of the letters of captions in a picture of a width."""
    return max(LEAST_LETTERS, round(width / WIDE))


def _text(x: float, y: float, size: float, text: str, anchor: str = "start") -> str:
    style = f'font-size="{size:g}" fill="{SOFT if anchor == "end" else INK}" text-anchor="{anchor}"'
    return f'<text x="{x:g}" y="{y:g}" {style}>{escape_markup(text)}</text>' if text else ""


def _document(width: float, height: float, title: str, body: Sequence[str]) -> str:
    words = escape_markup(title)
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" width="{width:g}" '
            f'height="{height:g}" role="img" aria-label="{words}" font-family="system-ui, sans-serif">',
            f"<title>{words}</title>",
            f'<rect width="{width:g}" height="{height:g}" rx="8" fill="#ffffff"/>',
            *body,
            "</svg>\n",
        ]
    )
