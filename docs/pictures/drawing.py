"""Join pictures in one SVG file, side by side and as tiles of a gallery. `envgraph.draw.film` makes animations."""

from __future__ import annotations

from collections.abc import Sequence

from envgraph.draw._svg_film import (
    BORDER,
    LEAST_LETTERS,
    caption,
    joined_document,
    letter_size,
    merge_elements,
    nested_tag,
    svg_elements,
    svg_size,
)


def sheet(pictures: Sequence[tuple[str, str]], title: str, *, columns: int = 3, size: int = 150) -> str:
    """Return an SVG with pictures in rows, each with a text below.

    Args:
        pictures: pairs of a picture and its text.
        title: a sentence that describes all pictures.
        columns: the number of pictures in a row.
        size: the width of a picture in CSS pixels. The tallest picture determines the height of the rows.
    """
    sizes = [svg_size(svg) for svg, _ in pictures]
    heights = [size * height / width for width, height in sizes]
    columns, high = min(columns, len(pictures)), max(heights)
    width = BORDER + columns * (size + BORDER)
    letters = letter_size(width)
    row = high + 2 * letters + BORDER
    shared, shown = [], [list[str]() for _ in pictures]
    for number, group in enumerate(merge_elements([svg_elements(svg) for svg, _ in pictures])):
        once = len(group.pictures) > 1
        if once:
            shared += [f'<g id="g{number}">', *group.elements, "</g>"]
        for place in group.pictures:
            shown[place] += [f'<use href="#g{number}"/>'] if once else group.elements
    body = ["<defs>", *shared, "</defs>"] if shared else []
    for place, ((svg, text), elements) in enumerate(zip(pictures, shown, strict=True)):
        x, y = BORDER + place % columns * (size + BORDER), BORDER + place // columns * row
        body += [nested_tag(svg, x, y + high - heights[place], size, heights[place]), *elements, "</svg>"]
        body.append(caption(x + size / 2, y + high + 1.4 * letters, letters, text, "middle"))
    return joined_document(width, BORDER + -(-len(pictures) // columns) * row, title, body)


def tile(svg: str, title: str, words: str, *, size: int = 160) -> str:
    """Return a picture as a part of a gallery: all tiles have the same size. Two fit on the screen of a phone."""
    width, height = svg_size(svg)
    room, high = size - 2 * BORDER, size - 2 * BORDER - 2.4 * LEAST_LETTERS
    scale = min(room / width, high / height)
    x, y = BORDER + (room - scale * width) / 2, BORDER + (high - scale * height) / 2
    body = [nested_tag(svg, x, y, scale * width, scale * height), *svg_elements(svg), "</svg>"]
    body.append(f'<g font-weight="bold">{caption(size / 2, size - BORDER - 16, LEAST_LETTERS, title, "middle")}</g>')
    body.append(caption(size / 2, size - BORDER + 2, LEAST_LETTERS - 3, words, "middle"))
    return joined_document(size, size, f"{title}: {words}", body)
