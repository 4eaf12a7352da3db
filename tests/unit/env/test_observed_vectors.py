"""Each way to observe an environment: vectors of programs return what vectors of live environments do."""

from __future__ import annotations

from functools import lru_cache

import pytest
from gymnasium.vector import AutoresetMode

from envgraph.env import ObservationKind
from envgraph.env._observation_spaces import OBSERVATION_KINDS
from tests.profile import NIGHTLY
from tests.unit.env.corners import observations, windows
from tests.unit.env.side_by_side import Family, family_of
from tests.unit.env.vectors_side_by_side import compare_vectors

CORNERS = windows.CORNERS | observations.CORNERS
ALL = [(corner, kind) for kind in OBSERVATION_KINDS for corner in CORNERS]
BY_DAY = [
    ("a window around a man", "index"),
    ("cells of a window that move, come and go", "multi"),
    ("a window beside floats, patterns for each object, and refusals", "flat"),
    ("floats of agents that act together", "dict"),
    ("a window with cells out of sight", "image"),
    ("windows of agents that take turns", "graph"),
    ("windows of agents that act together", "padded_graph"),
    ("floats, and patterns for each object", "text"),
]


@lru_cache(maxsize=16)
def family(corner: str) -> Family:
    """Return the family of a corner, made once."""
    return family_of(CORNERS[corner], 3 if NIGHTLY else 1)


@pytest.mark.parametrize(("corner", "kind"), ALL if NIGHTLY else BY_DAY)
def test_vectors_observe_what_single_environments_do(corner: str, kind: ObservationKind) -> None:
    one, histories = family(corner), [None] if kind in ("graph", "text") else [None, 1, 3]
    for seed, mode in enumerate(AutoresetMode):
        compare_vectors(one, kind, histories[seed % len(histories)], mode, 100 if NIGHTLY else 8, seed)
    assert one.compared or (corner, kind) not in BY_DAY, "others have no such observations"
