"""Save the files that a tutorial shows, and write its pictures."""

from __future__ import annotations

import re
from pathlib import Path

from envgraph.draw import Picture
from envgraph.files import replace_file

TUTORIALS = Path(__file__).parents[1] / "tutorials"
SHOWN = re.compile(r"^```\w+ (\S+) file\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def save_files(tutorial: str, folder: Path) -> None:
    """Write the files that `tutorials/NAME.md` shows into a folder, as a reader does."""
    for name, text in SHOWN.findall((TUTORIALS / f"{tutorial}.md").read_text(encoding="utf-8")):
        (folder / name).write_text(text, encoding="utf-8")


def write_picture(name: str, picture: Picture | str) -> None:
    """Write a picture beside the tutorials. Graphviz is not used, so that the picture is the same on all machines."""
    text = picture if isinstance(picture, str) else picture.to_svg(graphviz=False)
    replace_file(TUTORIALS / f"{name}.svg", text.rstrip("\n") + "\n")
