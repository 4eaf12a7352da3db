"""Burning Forest maps as tables, made directly from their letters: an oracle that shares no code with envgraph.

Published semantics: actions left, down, right, up are 0..3; a move into the border stays; the observation is
position + tiles x (water taken); a step is rewarded for the tile where the agent stands after it.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from envgraph.env import Tabular

DATA = Path(__file__).parents[3] / "envgraph" / "report" / "reproduction" / "data"
MOVES = ((-1, 0), (0, 1), (1, 0), (0, -1))


def published_family() -> list[Tabular]:
    """The tables of E1 to E6 of the paper."""
    return family("environment-config.json")


def family(name: str) -> list[Tabular]:
    """The tables of a file in `envgraph/report/reproduction/data`, in the order of their complexity."""
    environments = json.loads((DATA / name).read_text())["environments"]
    return [forest(one["desc"]) for one in sorted(environments, key=lambda one: one["complexity"])]


def forest(rows: list[str]) -> Tabular:
    """The table of a map; state 2 * tile + (water taken), which is not the order of the observations."""
    height, width = len(rows), len(rows[0])
    tiles = height * width
    states = 2 * tiles
    next_state = np.zeros((states, 4, 1), np.int32)
    reward = np.zeros((states, 4, 1))
    terminated = np.zeros((states, 4, 1), np.int8)
    for state in range(states):
        tile, taken = divmod(state, 2)
        for action, (right, down) in enumerate(MOVES):
            if rows[tile // width][tile % width] in "BG":
                next_state[state, action] = state
                continue
            x = min(max(tile % width + right, 0), width - 1)
            y = min(max(tile // width + down, 0), height - 1)
            letter = rows[y][x]
            fresh = letter == "W" and not taken
            next_state[state, action] = 2 * (y * width + x) + (taken or fresh)
            reward[state, action] = {"V": -0.1, "B": -1.0, "G": 10.0}.get(letter, 1.0 if fresh else 0.0)
            terminated[state, action] = {"G": 1, "B": 2}.get(letter, 0)
    start = "".join(rows).index("S")
    order = np.arange(states)
    return Tabular(
        next_state=next_state,
        probability=np.ones((states, 4, 1)),
        reward=reward,
        terminated=terminated,
        observation=(order // 2 + tiles * (order % 2)).astype(np.int32),
        start_states=np.array([2 * start], np.int32),
        start_probability=np.ones(1),
        n_observations=states,
        observation_shape=(tiles, 2),
        action_names=("left", "down", "right", "up"),
    )
