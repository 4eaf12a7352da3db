"""Draw the pictures of `docs/tutorials/clinic.md`: `python -m docs.pictures.clinic`."""

from __future__ import annotations

import tempfile
from pathlib import Path

import envgraph
from docs.pictures.tutorial_files import save_files, write_picture
from envgraph.search import family_svg, generate


def main() -> None:
    """Write two pictures: the model and the family."""
    with tempfile.TemporaryDirectory() as folder:
        save_files("clinic", Path(folder))
        model = envgraph.open(f"{folder}/monday.model").model
        family = generate(f"{folder}/family.toml", Path(folder, "run.sqlite"))
        write_picture("clinic-model", model.picture())
        write_picture("clinic-family", family_svg(family))


if __name__ == "__main__":
    main()
