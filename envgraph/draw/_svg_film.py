"""Join the pictures of an episode in one SVG file, as an animation.

The joined pictures mostly have the same elements, such as the walls of a maze. Each element is written once, so that an
animation of twenty frames is hardly larger than one frame.

A picture is a text that `envgraph.env.scene` or this package wrote: one line for the `<svg>` tag, one for the title,
one or more lines for each element, and `</svg>`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from difflib import SequenceMatcher
from itertools import groupby

from envgraph.code import dataclass
from envgraph.draw._diagram_data import escape_markup

BORDER = 12
"""The width of the border around pictures in CSS pixels."""

_LEAST_WIDTH = 250
"""The smallest width of an animation in CSS pixels, so that the texts below the picture have room."""

LEAST_LETTERS, _WIDE = 14, 28
"""The size of the letters of captions: at least 14 pixels, and larger in a picture wider than 28 letters, because a
narrow screen shrinks it."""

_LEFT_COLOUR, _RIGHT_COLOUR = "#1f2933", "#52606d"
"""The colours of captions; both are readable on white."""

STEP_SECONDS, LAST_STEPS, _ROUNDS = 0.6, 4, 3
"""The seconds for which a frame is shown, the length of the last frame in steps, and how often an animation runs."""


@dataclass(frozen=True, slots=True)
class SvgFrame:
    """A picture of an animation, with a text at the left and at the right of the line below."""

    svg: str
    left: str
    right: str = ""


@dataclass(frozen=True, slots=True)
class ElementGroup:
    """Elements that follow each other in every picture that has them. `pictures` has the numbers of these pictures."""

    pictures: frozenset[int]
    elements: tuple[str, ...]


def film(frames: Sequence[SvgFrame], title: str) -> str:
    """Return an animated SVG that shows the frames three times, and then the first frame.

    Without animation it shows the first frame: if the reader has asked for reduced motion, and in print.

    Args:
        frames: the frames. Pictures that are smaller than others are in the upper left corner.
        title: a sentence that describes the animation.
    """
    sizes = [svg_size(frame.svg) for frame in frames]
    width, height = (max(lengths) for lengths in zip(*sizes, strict=True))
    scale = width / sizes[0][0], height / sizes[0][1]
    inner = max(width, _LEAST_WIDTH)
    letters = letter_size(inner)
    line = BORDER + height + 1.5 * letters
    texts = [
        caption(BORDER, line, letters, frame.left) + caption(BORDER + inner, line, letters, frame.right, "end")
        for frame in frames
    ]
    tag = nested_tag(frames[0].svg, BORDER + (inner - width) / 2, BORDER, width, height, scale)
    films = {frozenset(range(len(frames))): ""}
    body = [tag, *_film_groups(merge_elements([svg_elements(frame.svg) for frame in frames]), films), "</svg>"]
    body += _film_groups(merge_elements([[text] for text in texts]), films)
    return joined_document(2 * BORDER + inner, line + BORDER, title, [_film_style(films, len(frames)), *body])


def _film_groups(groups: Iterable[ElementGroup], films: dict[frozenset[int], str]) -> list[str]:
    """Return the elements of groups, with a class for each set of frames, which is added to `films`."""
    lines: list[str] = []
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
                f"@keyframes {name}{{{keys}}}.{name}{{animation:{name} {steps * STEP_SECONDS:g}s step-end {_ROUNDS}}}"
            )
    return "<style>@media screen and (prefers-reduced-motion:no-preference){\n" + "\n".join(rules) + "\n}</style>"


def merge_elements(pictures: Sequence[Sequence[str]]) -> list[ElementGroup]:
    """Return the elements of all pictures in groups. The groups of a picture have its elements, in their order.

    >>> for group in merge_elements([["wall", "red", "hero"], ["wall", "blue", "hero"]]):
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
    return [ElementGroup(frozenset(shown), tuple(element for element, _ in run)) for shown, run in runs]


def svg_size(svg: str) -> tuple[float, float]:
    """Return the width and height of a picture in CSS pixels."""
    width, height = re.findall(r'\s(?:width|height)="([\d.]+)"', svg.split(">", 1)[0])
    return float(width), float(height)


def svg_elements(svg: str) -> list[str]:
    """Return the elements of a picture without its title: one or more lines, with as many tags opened as closed."""
    elements, depth = list[str](), 0
    for line in svg.removesuffix("\n").split("\n")[1:-1]:
        depth_before, depth = depth, depth + len(re.findall(r"<[a-z]", line)) - len(re.findall(r"</|/>", line))
        if depth_before:
            elements[-1] += "\n" + line
        else:
            elements.append(line)
    return elements[1:] if elements[0].startswith("<title>") else elements


def nested_tag(
    svg: str, x: float, y: float, width: float, height: float, scale: tuple[float, float] = (1.0, 1.0)
) -> str:
    """Return the tag of a picture at a position and with a size inside another one; `scale` enlarges what it shows."""
    head = re.sub(r'\s(width|height|xmlns|role|aria-label)="[^"]*"', "", svg.split(">", 1)[0])
    if scale != (1.0, 1.0):
        left, top, *sides = map(float, re.findall(r'viewBox="([^"]*)"', head)[0].split())
        shown = (left, top, *(side * factor for side, factor in zip(sides, scale, strict=True)))
        head = re.sub(r'viewBox="[^"]*"', f'viewBox="{" ".join(f"{one:g}" for one in shown)}"', head)
    return f'{head} x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}">'


def letter_size(width: float) -> int:
    """Return the size of the letters of captions in a picture of a width."""
    return max(LEAST_LETTERS, round(width / _WIDE))


def caption(x: float, y: float, size: float, text: str, anchor: str = "start") -> str:
    """Return a line of text that starts, ends or has its middle at `x`; "" for an empty text."""
    style = f'font-size="{size:g}" fill="{_RIGHT_COLOUR if anchor == "end" else _LEFT_COLOUR}" text-anchor="{anchor}"'
    return f'<text x="{x:g}" y="{y:g}" {style}>{escape_markup(text)}</text>' if text else ""


def joined_document(width: float, height: float, title: str, body: Sequence[str]) -> str:
    """Return an SVG document with a white background; `body` has its elements, and `title` describes it."""
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
