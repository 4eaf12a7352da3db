"""Explorations by the engine and by compiled programs, beside each other."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from envgraph.env.compiled.programs import _compiled_program
from envgraph.env.compiled.visiting import _exploration
from envgraph.errors import EvaluationError, RuleError
from envgraph.rewrite import Engine, Exploration
from envgraph.rewrite.explore import _exploration_search


@contextmanager
def compiling(after: float = 0, *, native: bool = False) -> Iterator[None]:
    """Compile explorations after a number of transitions, run by Python unless `native`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_exploration_search, "COMPILE_AFTER", after)
        patch.setattr(_exploration_search, "find_spec", lambda _: after < float("inf") or None)
        patch.setattr(_exploration, "has_numba", lambda: True)
        patch.setattr(_compiled_program, "has_numba", lambda: native)
        yield


def explore_twice(
    engine: Engine, names: str | Iterable[str], *, after: float = 0, native: bool = False, **options: Any
) -> Exploration | None:
    """Compare an exploration by the engine with one by a compiled program, and return it; None after an error."""
    found: list[Exploration | str] = []
    for start in (float("inf"), after):
        with compiling(start, native=native):
            try:
                found.append(engine.explore(names, **options))
            except (RuleError, EvaluationError) as error:
                found.append(f"{type(error).__name__}: {error}")
    live, compiled = found
    if isinstance(live, str) or isinstance(compiled, str):
        assert live == compiled
        return None
    assert live.not_compiled == "numba is not installed"
    assert_equal_explorations(live, compiled)
    return compiled


def assert_equal_explorations(one: Exploration, other: Exploration) -> None:
    """Compare states, transitions, and what is computed from them."""
    assert one.states == other.states
    assert one.transitions == other.transitions
    assert all(map(_same_types, one.transitions, other.transitions))
    assert (one.ending, one.goal, one.predicates, one.statistics) == (
        other.ending,
        other.goal,
        other.predicates,
        other.statistics,
    )
    assert one.deadlocks == other.deadlocks and repr(one) == repr(other) and len(one) == len(other)
    assert one.path(len(one) - 1) == other.path(len(other) - 1)


def _same_types(one: Any, other: Any) -> bool:
    """1, 1.0, True and the int64 1 are equal."""
    if type(one) is not type(other):
        return False
    return not isinstance(one, tuple) or all(map(_same_types, one, other))
