"""A compiled environment does what the live one does, bit by bit."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.profile import NIGHTLY
from tests.unit.env.side_by_side import BUNDLED, EXTRA, mutants, opened, step_side_by_side

STEPS = 20_000 if NIGHTLY else 1_500

MODELS = {
    "keydoor": BUNDLED / "keydoor/two_rooms.model",
    "burning_forest": BUNDLED / "burning_forest/target_8x8.model",
    "network": BUNDLED / "network/backbone.model",
    "warehouse": BUNDLED / "warehouse/small_hall.model",
    "sokoban": EXTRA / "sokoban/small.model",
    "sokoban2": EXTRA / "sokoban2/small.model",
    "wildfire": EXTRA / "wildfire/wild.model",
}


def domain(model: Path) -> list[Path]:
    """A model with the behaviour beside it."""
    return [model, *model.parent.glob("*.environment")]


@pytest.mark.parametrize("name", MODELS)
def test_it_steps_as_the_live_engine_does(name: str) -> None:
    pytest.importorskip("numba")
    engine, behaviour = opened(*domain(MODELS[name]))
    step_side_by_side(mutants(engine, behaviour, 6), behaviour, STEPS, native=True)


@pytest.mark.parametrize("name", MODELS)
def test_without_numba_it_steps_the_same(name: str) -> None:
    engine, behaviour = opened(*domain(MODELS[name]))
    step_side_by_side(mutants(engine, behaviour, 3), behaviour, 60, native=False)
