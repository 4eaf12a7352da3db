"""The rooms of the package as a picture, from the import contract: `python docs/rooms.py` writes `docs/rooms.svg`.

A package stands above those that it may import. Inside stand its rooms, left of those that may import them;
rooms in one column know nothing of each other.
"""

from __future__ import annotations

import ast
import tomllib
from pathlib import Path

from envgraph.draw import FILL_COLOURS, blend, escape_markup, format_colour, ink_on, parse_colour
from envgraph.files import replace_file

HERE = Path(__file__).parent
PACKAGE = HERE.parent / "envgraph"
WIDTH, HEIGHT, GAP, LABEL, LETTER, SMALL_LETTER = 1120, 34, 6, 118, 7.6, 6.4


def contracts() -> dict[str, list[list[str]]]:
    """For each container the layers, lowest first; a layer is what stands side by side."""
    with (HERE.parent / "pyproject.toml").open("rb") as file:
        settings = tomllib.load(file)["tool"]["importlinter"]["contracts"]
    return {
        contract["containers"][0]: [layer.split(" | ") for layer in reversed(contract["layers"])]
        for contract in settings
        if contract["type"] == "layers"
    }


def purpose(package: str) -> str:
    """The first sentence of a package's docstring, or of a module's."""
    path = PACKAGE / package / "__init__.py"
    tree = ast.parse((path if path.exists() else PACKAGE / f"{package}.py").read_text("utf-8"))
    return (ast.get_docstring(tree) or "").split("\n")[0].rstrip(".")


def columns_of(package: str, found: dict[str, list[list[str]]]) -> list[list[str]]:
    """The rooms of a package by layers; where no contract orders them, one layer."""
    rooms = sorted(path.parent.name for path in PACKAGE.glob(f"{package}/*/__init__.py"))
    return found.get(f"envgraph.{package}") or ([rooms] if rooms else [])


def picture() -> str:
    """The picture as SVG text."""
    found = contracts()
    packages = [package for layer in found.pop("envgraph") for package in layer]
    heights = [
        max((len(column) for column in columns_of(package, found)), default=1) * (HEIGHT - 8) + 8
        for package in packages
    ]
    total = sum(heights) + GAP * (len(heights) + 1)
    title = "The packages of envgraph: each imports only from those below it"
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {total}" width="{WIDTH}" height="{total}" '
        f'role="img" aria-label="{title}" font-family="system-ui, sans-serif" font-size="13">',
        f"<title>{title}</title>",
        f'<rect width="{WIDTH}" height="{total}" rx="8" fill="#ffffff"/>',
    ]
    bottom = total - GAP
    for number, (package, height) in enumerate(zip(packages, heights, strict=True)):
        fill = FILL_COLOURS[number % len(FILL_COLOURS)]
        top = bottom - height
        parts.append(box(GAP, top, WIDTH - 2 * GAP, height, fill))
        parts.append(text(GAP + 12, top + height / 2, package, fill, "bold"))
        drawn, left = rooms(columns_of(package, found), top, height, fill)
        words = purpose(package)
        assert left + len(words) * SMALL_LETTER < WIDTH - GAP, (
            f"the first sentence of {package} is too long for its row"
        )
        parts += [*drawn, text(left, top + height / 2, words, fill)]
        bottom = top - GAP
    return "\n".join([*parts, "</svg>"]) + "\n"


def rooms(columns: list[list[str]], top: float, height: float, fill: str) -> tuple[list[str], float]:
    """The rooms of one package, lowest layer first, and where there is room right of them."""
    inner = format_colour(blend(parse_colour(fill), (255.0, 255.0, 255.0), 0.6))
    parts: list[str] = []
    left = float(LABEL)
    for column in columns:
        width = max(map(len, column)) * LETTER + 20
        each = (height - 8) / len(column)
        for number, name in enumerate(column):
            y = top + 4 + number * each
            parts += [
                box(left, y + 1, width, each - 2, inner, "#5c636a"),
                text(left + 10, y + each / 2, name, inner),
            ]
        left += width + 10
    return parts, left


def box(x: float, y: float, width: float, height: float, fill: str, line: str = "none") -> str:
    return f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="5" fill="{fill}" stroke="{line}"/>'


def text(x: float, y: float, words: str, fill: str, weight: str = "normal") -> str:
    ink = format_colour(ink_on(parse_colour(fill)))
    return f'<text x="{x:g}" y="{y + 4.5:g}" fill="{ink}" font-weight="{weight}">{escape_markup(words)}</text>'


if __name__ == "__main__":
    replace_file(HERE / "rooms.svg", picture())
