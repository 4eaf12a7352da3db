"""However many threads step compiled environments, they do the same."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envgraph.env.compiled import Batch, CompiledVectorEnv, program_of
from envgraph.env.compiled._layout import ERROR
from envgraph.errors import EnvgraphError, InvalidArgument
from tests.unit.env.side_by_side import BUNDLED, family_keys, mutants, opened
from tests.unit.env.test_compiled_corners import Corner, written

FOLDER = BUNDLED / "warehouse"


def stepped(env: CompiledVectorEnv, rounds: int) -> list[Any]:
    """All that comes of some rounds of random actions."""
    actions = np.random.default_rng(0)
    found = [env.reset(seed=4)]
    for _ in range(rounds):
        found.append(env.step(actions.integers(env.single_action_space.n, size=env.num_envs)))
    return found


def shown(results: list[Any]) -> str:
    """Everything, as text: equal texts, equal arrays."""
    with np.printoptions(threshold=10**6, floatmode="unique"):
        return repr(results)


@pytest.mark.parametrize("native", [False, True], ids=["python", "numba"])
@pytest.mark.parametrize("streams", ["shared", "each"])
def test_the_number_of_threads_changes_nothing(streams: Any, native: bool) -> None:
    if native:
        pytest.importorskip("numba")
    engine, behaviour = opened(FOLDER / "small_hall.model", *FOLDER.glob("*.environment"))
    engines = mutants(engine, behaviour, 3)
    program = program_of(engine, behaviour, engines, family_keys(engines, behaviour), native=native)
    many = [
        CompiledVectorEnv(program, 7, streams=streams, max_episode_steps=9, threads=threads)
        for threads in (1, 2, 3, 20)
    ]
    wanted, *others = [stepped(env, 40) for env in many]
    assert len({result[4]["agent"].tobytes() for result in wanted[1:]}) > 1
    assert all(shown(other) == shown(wanted) for other in others)
    copies = [deepcopy(env) for env in many]
    went_on, *rest = [stepped(env, 5) for env in (*many, *copies)]
    assert all(shown(each) == shown(went_on) for each in rest)
    for env in (*many, *copies):
        env.close()


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_of_several_that_fail_the_last_one_is_over(tmp_path: Path, threads: int) -> None:
    """The third step of those that do the first action leads to an int that has no space."""
    actions = "action burst = burst()\naction grow = grow()\nobserve adam.kind"
    burst = "rule burst { lhs { b : Box; } modify { set b.size = b.size * 1500 + 1500; } }\n"
    grow = "rule grow { lhs { b : Box; check b.size < 6; } modify { set b.size += 1; } }\n"
    engine, behaviour = written(tmp_path, Corner(burst + grow, actions))
    batch = Batch(program_of(engine, behaviour, native=False), [0] * 6, threads)
    batch.reset(np.ones(6, dtype=np.bool_))
    chosen = np.array([0, 0, 1, 0, 1, 1])
    for _ in range(2):
        batch.step(chosen, again=False)
    with pytest.raises(EnvgraphError, match="32 bits"):
        batch.step(chosen, again=False)
    assert np.flatnonzero(batch.states[:, ERROR]).tolist() == [0, 1, 3]
    assert np.flatnonzero(batch.over).tolist() == [3]
    batch.close()


def test_there_is_a_thread_at_least() -> None:
    engine, behaviour = opened(FOLDER / "small_hall.model", *FOLDER.glob("*.environment"))
    with pytest.raises(InvalidArgument, match="0 threads"):
        CompiledVectorEnv(program_of(engine, behaviour, native=False), 2, threads=0)
