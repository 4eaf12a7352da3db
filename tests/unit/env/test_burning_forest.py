"""The tables of the Burning Forest against the published environment, written down here a second time."""

from __future__ import annotations

import json
from collections.abc import Iterator

import numpy as np
import pytest

from envgraph.env import Tabular, explore
from envgraph.rewrite import Engine
from tests.oracle.naive._naive import NaiveMatcher
from tests.unit.env import forest

MOVES = {"left": (-1, 0), "down": (0, 1), "right": (1, 0), "up": (0, -1)}
ENTERING = {"S": 0.0, "R": 0.0, "V": -0.1, "B": -1.0, "G": 10.0, "W": 0.0}


def published_step(rows: list[str], position: int, taken: bool, action: int) -> tuple[int, bool, float, int]:
    """One step of the published environment: position, water taken, reward, end (1 goal, 2 fire)."""
    width = len(rows[0])
    dx, dy = list(MOVES.values())[action]
    x, y = position % width + dx, position // width + dy
    if not (0 <= x < width and 0 <= y < len(rows)):
        x, y = position % width, position // width
    tile = rows[y][x]
    reward = 1.0 if tile == "W" and not taken else ENTERING[tile]
    return y * width + x, taken or tile == "W", reward, {"G": 1, "B": 2}.get(tile, 0)


def random_maps() -> Iterator[list[str]]:
    for number in (1, 17, 30):
        data = json.loads((forest.DATA / f"random-families/environments-8x8-random-{number:02}.json").read_text())
        yield data["environments"][0]["desc"]


MAPS = [
    *forest.published_maps(),
    *random_maps(),
    ["SVW", "BRG"],
    ["WVG"],
    ["SRV", "WBR", "VRV", "RRG"],
]


def assert_is_published(table: Tabular, rows: list[str]) -> None:
    """Follow both from the start, pair by pair; equal observations mean equal positions and water."""
    table.check()
    cells = len(rows) * len(rows[0])
    (start,) = table.start_states.tolist()
    assert table.observation[start] == 0
    seen = {start: (0, False, False)}
    queue = [start]
    for state in queue:
        position, taken, over = seen[state]
        assert table.observation[state] == position + cells * taken
        for action in range(4):
            if over:
                assert table.next_state[state, action, 0] == state
                assert table.reward[state, action, 0] == 0.0
                assert table.terminated[state, action, 0] == 0
                continue
            to, took, reward, end = published_step(rows, position, taken, action)
            assert table.reward[state, action, 0] == reward
            assert table.terminated[state, action, 0] == end
            found = int(table.next_state[state, action, 0])
            if found not in seen:
                seen[found] = (to, took, end > 0)
                queue.append(found)
            assert seen[found] == (to, took, end > 0)
    assert len(seen) == table.n_states


@pytest.mark.parametrize("rows", MAPS)
def test_every_transition_equals_that_of_the_published_environment(rows: list[str]) -> None:
    table = explore(forest.engine(rows), forest.behaviour()).tabular
    assert table.deterministic
    assert table.action_names == ("left", "down", "right", "up")
    assert table.observation_shape == (len(rows) * len(rows[0]), 2)
    assert_is_published(table, rows)


@pytest.mark.parametrize("seed", range(8))
def test_random_maps_of_any_shape_step_like_the_published_ones(seed: int) -> None:
    rng = np.random.default_rng(seed)
    height, width = rng.integers(1, 7, size=2)
    letters = rng.choice(list("RVBG"), size=(height, width), p=[0.4, 0.4, 0.15, 0.05])
    letters[rng.integers(height), rng.integers(width)] = "W"
    rows = ["".join(row) for row in letters]
    if letters[0, 0] == "W":
        rows[0] = "S" + rows[0][1:]
    assert_is_published(explore(forest.engine(rows), forest.behaviour()).tabular, rows)


def test_states_are_numbered_breadth_first() -> None:
    table = explore(forest.engine(forest.published_maps()[5]), forest.behaviour()).tabular
    first = [int(s) for state in range(table.n_states) for s in table.next_state[state, :, 0]]
    assert table.start_states.tolist() == [0]
    assert list(dict.fromkeys([0, *first])) == list(range(table.n_states))


def test_the_greedy_policy_on_the_target_has_the_published_return() -> None:
    table = explore(forest.engine(forest.published_maps()[5]), forest.behaviour()).tabular
    value = np.zeros(table.n_states)
    for _ in range(500):
        goes_on = (table.terminated == 0)[:, :, 0]
        q = table.reward[:, :, 0] + 0.99 * goes_on * value[table.next_state[:, :, 0]]
        value = q.max(axis=1)
    state, total, steps = int(table.start_states[0]), 0.0, 0
    while True:
        action = int(q[state].argmax())
        total += float(table.reward[state, action, 0])
        steps += 1
        if table.terminated[state, action, 0]:
            break
        state = int(table.next_state[state, action, 0])
    assert (round(total, 9), steps) == (10.2, 16)


def test_move_into_the_border_stays_and_repeats_the_reward_of_the_tile() -> None:
    table = explore(forest.engine(["VRG"]), forest.behaviour()).tabular
    start = int(table.start_states[0])
    for action in (0, 1, 3):
        assert table.next_state[start, action, 0] == start
        assert table.reward[start, action, 0] == -0.1


def test_clauses_are_not_evaluated_in_the_start_state() -> None:
    # The truck starts on the goal: a reset asks no clause, the first step does.
    table = explore(forest.engine(["RG"], start=(1, 0)), forest.behaviour()).tabular
    start = int(table.start_states[0])
    over = int(table.next_state[start, 2, 0])
    assert over != start
    assert table.observation[over] == table.observation[start]
    assert (table.reward[start, 2, 0], table.terminated[start, 2, 0]) == (10.0, 1)
    assert (table.reward[over] == 0.0).all()


def test_enumeration_leaves_the_model_unchanged() -> None:
    engine = forest.engine(forest.published_maps()[0])
    before = engine.model.state_hash()
    with engine.transaction():
        explore(engine, forest.behaviour())
        assert engine.model.state_hash() == before
    explore(engine, forest.behaviour())
    assert engine.model.state_hash() == before
    engine.model.check_integrity()


def test_both_matchers_give_the_same_table() -> None:
    rows = forest.published_maps()[3]
    naive = Engine(forest.model(rows), matcher=NaiveMatcher)
    naive.add(*forest.patterns(), *forest.rules())
    one = explore(naive, forest.behaviour()).tabular
    other = explore(forest.engine(rows), forest.behaviour()).tabular
    for name in ("next_state", "reward", "terminated", "probability", "observation", "start_states"):
        assert (getattr(one, name) == getattr(other, name)).all()
