"""Draw the pictures of `docs/tutorials/clinic.md`: `python -m docs.pictures.clinic`."""

from __future__ import annotations

import tempfile
from pathlib import Path

import envgraph
from docs.pictures.tutorial_files import save_files, svg_of, write_pictures
from envgraph.search import family_svg, generate


def pictures() -> dict[str, str]:
    """Return the model and the family: SVG by the name of the file."""
    with tempfile.TemporaryDirectory() as folder:
        save_files("clinic", Path(folder))
        model = envgraph.open(f"{folder}/monday.model").model
        family = generate(f"{folder}/family.toml", Path(folder, "run.sqlite"))
        return {"clinic-model.svg": svg_of(model.picture()), "clinic-family.svg": family_svg(family)}


if __name__ == "__main__":
    write_pictures(pictures())
