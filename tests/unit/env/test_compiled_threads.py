"""Threads that step compiled environments; that they change nothing is one of the ways to run corners."""

from __future__ import annotations

import numpy as np
import pytest

from envgraph.env.compiled import CompiledBatch, CompiledVectorEnv, program_of
from envgraph.errors import EnvgraphError, InvalidArgument
from tests.unit.env.corners.yard import Yard
from tests.unit.env.side_by_side import ERROR


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_only_the_last_of_several_failing_environments_is_marked_as_over(threads: int) -> None:
    """The third step of those that do the first action leads to an int that has no space."""
    actions = "action burst = burst()\naction grow = grow()\nobserve adam.kind"
    burst = "rule burst { lhs { b : Box; } modify { set b.size = b.size * 1000000000 + 1000000000; } }\n"
    grow = "rule grow { lhs { b : Box; check b.size < 6; } modify { set b.size += 1; } }\n"
    engine, behaviour = Yard(burst + grow, actions).opened()
    batch = CompiledBatch(program_of(engine, behaviour, native=False), [0] * 6, threads)
    batch.reset(np.ones(6, dtype=np.bool_))
    chosen = np.array([0, 0, 1, 0, 1, 1])
    for _ in range(2):
        batch.step(chosen, resets_ended=False)
    with pytest.raises(EnvgraphError, match="64 bits"):
        batch.step(chosen, resets_ended=False)
    assert np.flatnonzero(batch.states[:, ERROR]).tolist() == [0, 1, 3]
    assert np.flatnonzero(batch.over).tolist() == [3]
    batch.close()


def test_zero_threads_are_refused() -> None:
    engine, behaviour = Yard("", "action wait = nothing()\nobserve adam.kind").opened()
    with pytest.raises(InvalidArgument, match="`threads` is 0"):
        CompiledVectorEnv(program_of(engine, behaviour, native=False), 2, threads=0)
