"""Levels of the real MiniGrid become domains that step as they do: `make test-integrations` installs it, and runs this.

It is no `test_*.py`: `make test` does without.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import envgraph
from envgraph.env import MiniGridLevel
from tests.unit.cli.test_commands import Envgraph, envgraph as envgraph_command, ok

pytest.importorskip("minigrid")  # modules are imported in `make test`, too, for their doctests

__all__ = ["envgraph_command"]

pytestmark = pytest.mark.filterwarnings("default")  # theirs, not ours to fix

LEVELS = [
    ("Empty-5x5-v0", 0, 0.955),
    ("DoorKey-5x5-v0", 3, None),
    ("LavaGapS5-v0", 1, None),
    ("MultiRoom-N2-S4-v0", 1, None),
    ("Unlock-v0", 2, None),
    ("KeyCorridorS3R1-v0", 1, None),
]


@pytest.mark.parametrize(("level", "seed", "first"), LEVELS)
def test_a_level_steps_as_it_does_there(envgraph_command: Envgraph, level: str, seed: int, first: float | None) -> None:
    """Side by side under random actions and along the best policy, whose return is MiniGrid's."""
    said = ok(envgraph_command("adopt", f"MiniGrid-{level}", "-o", "mine", "--seed", seed, "--format", "json"))
    assert said.json["kind"] == "minigrid" and said.json["states"] > 20  # type: ignore[index, call-overload]
    assert "no problems" in ok(envgraph_command("check", "mine")).out
    texts = [str(path) for path in Path("mine").iterdir() if path.suffix != ".toml"]
    assert "would" not in envgraph_command("format", "--check", *texts).out
    ours = envgraph.make(domain="mine", observation="dict")
    theirs: Any = gymnasium.make(f"MiniGrid-{level}")
    table = ours.unwrapped.tabular
    rng = np.random.default_rng(0)
    values = _values(table)
    won = 0
    for episode in range(20):
        ours.reset(seed=0)
        theirs.reset(seed=seed)
        total, state = 0.0, int(table.start_states[0])
        for _ in range(ours.spec.max_episode_steps):
            best = (table.reward[state, :, 0] + values[table.next_state[state, :, 0]]).argmax()
            action = int(best) if episode == 0 else int(rng.integers(7))
            state = int(table.next_state[state, action, 0])
            seen, reward, over, cut, info = ours.step(action)
            _, paid, ended, stopped, _ = theirs.step(action)
            total += reward
            inner = theirs.unwrapped
            assert (over, cut and not over) == (ended, stopped and not ended)
            if not over:
                assert seen["hero at"] == inner.agent_pos[1] * inner.width + inner.agent_pos[0]
                assert seen["hero facing"] == inner.agent_dir
            if over or cut:
                break
        if info["success"]:
            assert total == pytest.approx(paid) and paid > 0
            won += 1
            assert episode or first is None or paid == pytest.approx(first)
        else:
            assert paid == 0
    assert won


def _values(table: Any) -> Any:
    values = np.zeros(table.n_states)
    for _ in range(200):
        values = (table.reward[:, :, 0] + values[table.next_state[:, :, 0]]).max(axis=1)
    return values


@pytest.mark.parametrize("level", ["Dynamic-Obstacles-5x5-v0", "GoToDoor-5x5-v0", "Fetch-5x5-N2-v0", "MemoryS7-v0"])
def test_levels_with_rules_of_their_own_are_refused(envgraph_command: Envgraph, level: str) -> None:
    done = envgraph_command("adopt", f"MiniGrid-{level}")
    assert done.code == 1 and "changes the steps or rewards of MiniGrid" in done.err and not list(Path().iterdir())


def test_boxes_give_what_is_inside_and_large_levels_are_tried_along_ways(envgraph_command: Envgraph) -> None:
    said = ok(envgraph_command("adopt", "MiniGrid-ObstructedMaze-1Dlhb-v0", "-o", "maze")).out
    assert "states, on paths to success in 21 steps and to objects that can be carried or opened" in said
    text = Path("maze/mini_grid_obstructed_maze_1_dlhb.model").read_text()
    assert " : Box {" in text and ", inside = thing" in text and "target : Ball" in text


@pytest.mark.parametrize("level", ["DoorKey-5x5-v0", "Unlock-v0", "KeyCorridorS3R1-v0"])
def test_a_family_goes_back_as_levels_that_step_as_its_members_do(
    envgraph_command: Envgraph, level: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    ok(envgraph_command("adopt", f"MiniGrid-{level}", "-o", "doors"))
    made = ok(envgraph_command("generate", "doors", "--generations", 1, "--name", "five", "--format", "json"))
    assert made.json["diversity"] > 0  # type: ignore[index, call-overload]
    name = ok(envgraph_command("export", "five", "--format", "minigrid", "-o", "out")).out.split('"')[1]
    monkeypatch.syspath_prepend(Path("out").resolve())
    sys.modules.pop("levels", None)
    for member in (f"E{place}" for place in range(1, 7)):
        env = gymnasium.make(name.replace("E6", member))
        check_env(env.unwrapped, skip_render_check=True)
        found = MiniGridLevel.from_reset(env.unwrapped, 0)
        assert [*found.differences(envgraph.make("five", member).unwrapped.tabular)] == []
