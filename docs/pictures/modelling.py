"""Draw the pictures of `docs/tutorials/modelling.md`: `python -m docs.pictures.modelling`."""

from __future__ import annotations

import tempfile
from pathlib import Path

import envgraph
from docs.pictures.tutorial_files import save_files, svg_of, write_pictures

DRAWN = ("Host", "Service")


def pictures() -> dict[str, str]:
    """Return the classes, the model, a match in it, and the model after the unit: SVG by the name of the file."""
    with tempfile.TemporaryDirectory() as folder:
        save_files("modelling", Path(folder))
        engine = envgraph.open(f"{folder}/shop.xmi", f"{folder}/cloud.rules", seed=1)
    overloaded = engine.first("overloaded")
    assert overloaded is not None
    before = {
        "modelling-classes.svg": svg_of(engine.model.metamodel.picture()),
        "modelling-model.svg": svg_of(engine.model.picture(classes=DRAWN)),
        "modelling-match.svg": svg_of(overloaded.picture(distance=2, classes=DRAWN)),
    }
    engine.run("evacuate", host=engine.model["h3"])
    return {**before, "modelling-after.svg": svg_of(engine.model.picture(classes=DRAWN))}


if __name__ == "__main__":
    write_pictures(pictures())
