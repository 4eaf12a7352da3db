"""A level of MiniGrid beside a table that claims to be it. `tests/integrations` has the real levels."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from envgraph.env import MiniGridLevel, Tabular

FORWARD = 2


class Street:
    """Two cells: a step forward leads from each to the other, and all other actions do nothing."""

    width, height, mission, max_steps = 2, 1, "walk", 10

    def __init__(self) -> None:
        self.grid = SimpleNamespace(grid=[None, None], get=lambda x, y: None)
        self.agent_pos, self.agent_dir, self.carrying, self.step_count = (0, 0), 0, None, 0

    def step(self, action: int) -> tuple[dict[str, object], float, bool, bool, dict[str, object]]:
        if action == FORWARD:
            self.agent_pos = 1 - self.agent_pos[0], 0
        return {}, 0.0, False, False, {}


def table(*forward: int) -> Tabular:
    """The table of a street, with the state that a step forward leads to from each state."""
    count = len(forward)
    following = np.repeat(np.arange(count, dtype=np.int32)[:, None, None], 7, axis=1)
    following[:, FORWARD, 0] = forward
    level = MiniGridLevel(Street(), "goal")
    reward, _ = level._step(level._start_state, FORWARD)
    return Tabular(
        following,
        np.ones((count, 7, 1)),
        np.full((count, 7, 1), reward),
        np.zeros((count, 7, 1), dtype=np.int8),
        np.arange(count),
        np.zeros(1, dtype=np.int32),
        np.ones(1),
        count,
        (count,),
        tuple("abcdefg"),
    )


@pytest.mark.parametrize(
    ("forward", "found"),
    [
        ((1, 0), None),
        ((0, 1), "action 2 leads to another state"),  # nobody leaves the first cell
        ((1, 2, 0), "action 2 leads to another state"),  # the first cell once more, as a third state
    ],
)
def test_table_that_differs_from_the_minigrid_level_is_reported(forward: tuple[int, ...], found: str | None) -> None:
    assert next(MiniGridLevel(Street(), "goal").differences(table(*forward)), None) == found
