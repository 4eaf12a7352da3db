"""Draw the pictures of `docs/tutorials/modelling.md`: `python -m docs.pictures.modelling`."""

from __future__ import annotations

import tempfile
from pathlib import Path

import envgraph
from docs.pictures.tutorial_files import save_files, write_picture

SHOWN = ("Host", "Service")


def main() -> None:
    """Write four pictures: the classes, the model, the model after the unit, and a match."""
    with tempfile.TemporaryDirectory() as folder:
        save_files("modelling", Path(folder))
        engine = envgraph.open(f"{folder}/shop.xmi", f"{folder}/cloud.rules", seed=1)
    write_picture("modelling-classes", engine.model.metamodel.picture())
    write_picture("modelling-model", engine.model.picture(classes=SHOWN))
    overloaded = engine.first("overloaded")
    assert overloaded is not None
    write_picture("modelling-match", engine.model.picture(classes=SHOWN, highlight=overloaded))
    engine.run("evacuate", host=engine.model["h3"])
    write_picture("modelling-after", engine.model.picture(classes=SHOWN))


if __name__ == "__main__":
    main()
