"""The bundled domains, and some larger ones."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from tests.unit.env.side_by_side import BUNDLED, EXTRA, Corner, opened

MODELS = {
    "keydoor": BUNDLED / "keydoor/two_rooms.model",
    "burning_forest": BUNDLED / "burning_forest/target_8x8.model",
    "network": BUNDLED / "network/backbone.model",
    "warehouse": BUNDLED / "warehouse/small_hall.model",
    "sokoban": EXTRA / "sokoban/small.model",
    "sokoban2": EXTRA / "sokoban2/small.model",
    "wildfire": EXTRA / "wildfire/wild.model",
    "jobshop": BUNDLED / "jobshop/three_jobs.model",
    "lava": BUNDLED / "lava/vault.model",
    "pushing": BUNDLED / "sokoban/small.model",
    "taxi": BUNDLED / "taxi/town.model",
    "triage": BUNDLED / "triage/friday.model",
}


def files(model: Path) -> list[Path]:
    """Return a model and the behaviour beside it."""
    return [model, *model.parent.glob("*.environment")]


CORNERS = {name: Corner(partial(opened, *files(model))) for name, model in MODELS.items()}
