"""Save the files that a tutorial shows, and write its pictures."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from envgraph.draw import Picture
from envgraph.files import replace_file

TUTORIALS = Path(__file__).parents[1] / "tutorials"
SHOWN = re.compile(r"^```\w+ (\S+) file\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def save_files(tutorial: str, folder: Path) -> None:
    """Write the files that `tutorials/NAME.md` shows into a folder, as a reader does."""
    for name, text in SHOWN.findall((TUTORIALS / f"{tutorial}.md").read_text(encoding="utf-8")):
        (folder / name).write_text(text, encoding="utf-8")


def svg_of(picture: Picture) -> str:
    """Return a picture as SVG. Graphviz is not used, so that the picture is the same on all machines."""
    return picture.to_svg(graphviz=False)


def write_pictures(pictures: Mapping[str, str]) -> None:
    """Write pictures, SVG by the names of their files, beside the tutorials."""
    for name, text in pictures.items():
        replace_file(TUTORIALS / name, text)
