"""Each corner of what behaviours may say, run in each way: the compiled environment does what the live one does."""

from __future__ import annotations

import builtins
import sys
from collections.abc import Callable, Collection
from copy import deepcopy
from dataclasses import replace
from dis import get_instructions
from functools import lru_cache, partial
from importlib import import_module
from inspect import isfunction, unwrap
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest

from envgraph.env import FloatRange, Tabular, explore
from envgraph.env.compiled import (
    CompiledProgram,
    CompiledVectorEnv,
    NotCompiled,
    enumerate_states,
    export_package,
    program_of,
)
from envgraph.env.compiled.layout._compiled_costs import CompiledCosts
from envgraph.env.compiled.layout._model_changes import calls_of
from envgraph.errors import LIMITS, EnvgraphError, EvaluationError, RuleError
from tests.profile import NIGHTLY
from tests.unit.env import test_sight, test_together, test_truncation
from tests.unit.env.corners import (
    blocks,
    classes,
    clauses,
    containers,
    creation,
    domains,
    links,
    meetings,
    observations,
    queries,
    refusals,
    units,
    values,
    windows,
)
from tests.unit.env.side_by_side import Family, assert_equal_tables, compare_random_steps, family_of
from tests.unit.rewrite.explorations import explore_twice

CORNERS = (
    domains.CORNERS
    | links.CORNERS
    | containers.CORNERS
    | classes.CORNERS
    | values.CORNERS
    | clauses.CORNERS
    | queries.CORNERS
    | blocks.CORNERS
    | creation.CORNERS
    | units.CORNERS
    | refusals.CORNERS
    | meetings.CORNERS
    | observations.CORNERS
    | windows.CORNERS
    | test_sight.CORNERS
    | test_together.CORNERS
    | test_truncation.CORNERS
)

STEPS = 6_000 if NIGHTLY else 50
"""Of all members together; by numba there are four times as many."""
LIMIT = 2_000 if NIGHTLY else 40
"""States of a table, and outcomes of an action; of more, all that is compared is that there are more."""


@lru_cache(maxsize=3)
def family(corner: str) -> Family:
    """Return the family of a corner, with which the ways to run it do not interfere: by day, of two mutants."""
    return family_of(CORNERS[corner], 3 if NIGHTLY else 2)


def steps(family: Family) -> None:
    """Compare rewards, ends, observations, states, masks and errors of random steps.

    Numba compiles all of a program, and so needs each name in it, while Python looks up only what it runs.
    """
    known = unwrap(family.program.functions_for("mask")["masks"]).__globals__
    functions = [one for one in known.values() if isfunction(one) and one.__globals__ is known]
    used = {each.argval for one in functions for each in get_instructions(one) if each.opname == "LOAD_GLOBAL"}
    assert used <= known.keys() | vars(builtins).keys()
    with pytest.MonkeyPatch.context() as few:
        few.setitem(LIMITS, "outcomes", LIMIT)  # that masks try
        compare_random_steps(family, STEPS // len(family.engines), native=False)


def steps_by_numba(family: Family) -> None:
    """Compare the same of a program that numba has compiled, but for masks, which it would have to compile."""
    compare_random_steps(family, 4 * STEPS // len(family.engines), native=True)


def table(family: Family, *, native: bool = False) -> None:
    """Compare the tables of all states. Where there is none, that of the other side is none either.

    The errors may differ: of several states with an error, the live engine may come to another one first.
    """
    program = family.native if native else family.program
    with pytest.MonkeyPatch.context() as few:
        few.setitem(LIMITS, "outcomes", LIMIT)
        few.setitem(LIMITS, "all outcomes", 20 * LIMIT)
        few.setattr(CompiledCosts, "progress_interval", 20 * LIMIT)
        for number, engine in enumerate(family.engines):
            found = table_or_error(partial(enumerate_states, program, number, limit=LIMIT))
            known = partial(explore, engine, family.behaviour, family.keys, limit=LIMIT, outcomes=20 * LIMIT)
            wanted = table_or_error(lambda: known().tabular)  # noqa: B023
            if isinstance(wanted, Exception) or isinstance(found, Exception):
                assert isinstance(wanted, Exception) or isinstance(found, NotCompiled), "there is space for less"
                assert isinstance(found, Exception)
            else:
                assert_equal_tables(found, wanted)


def table_by_numba(family: Family) -> None:
    """Compare the same of a program that numba has compiled."""
    table(family, native=True)


def threads(family: Family, *, native: bool = False) -> None:
    """Compare what many environments do on one thread and on more, and what copies of them do from there on."""
    program = family.native if native else family.program
    for streams in ("shared", "each"):
        many = [vector(program, streams=streams, threads=number) for number in (1, 3, 20)]
        wanted, *others = [shown(stepped(env, program, 20)) for env in many]
        assert others == [wanted] * 2
        copies = [deepcopy(env) for env in many]
        went_on, *others = [shown(stepped(env, program, 5)) for env in (*many, *copies)]
        assert others == [went_on] * 5
        for env in (*many, *copies):
            env.close()


def exploration(family: Family) -> None:
    """Compare what the engine explores, with a program and without it: with the rules that the behaviour calls."""
    for engine in family.copies() if NIGHTLY else [family.engines[0].copy()]:
        called = dict.fromkeys(call.rule for call in calls_of(family.behaviour) if call.rule is not None)
        runners = [engine.prepare(name) for name in called if engine.signature(name).kind == "rule"]
        names = [runner.name for runner in runners if not runner.inputs]
        known = [pattern for pattern in engine.patterns if not engine.library.inputs(pattern)]
        if names:
            explore_twice(engine, names, limit=LIMIT, predicates=known)


def threads_by_numba(family: Family) -> None:
    """Compare the same where threads run at the same time."""
    threads(family, native=True)


def package(family: Family) -> None:
    """Compare what an exported package does where there is no envgraph, and no numba."""
    program, members = family.program, range(len(family.engines))
    kinds = ("flat",) if any(isinstance(size, FloatRange) for size in program.observation_shape) else ("index", "multi")
    options = [{"streams": one, "observation": other} for one in ("shared", "each") for other in kinds]
    with TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as elsewhere:
        name = f"corner_{len(sys.modules)}"
        export_package(program, Path(folder) / name, name="Corner", members=[f"E{n}" for n in members], limit=9)
        elsewhere.syspath_prepend(folder)
        for missing in ("envgraph", "numba"):
            elsewhere.setitem(sys.modules, missing, None)
        module = import_module(name)
        found = [stepped(module.Environments(7, members, **each), program, 20) for each in options]
        assert not module._load_program().NATIVE
    for (results, error), each in zip(found, options, strict=True):
        wanted, live_error = stepped(vector(program, **each), program, 20)
        if error and program.layout.reuses_numbers:  # the space for new objects does not grow in a package
            wanted, live_error = wanted[: len(results)], live_error or error
        assert shown(results) == shown(wanted)
        assert (error is None) == (live_error is None)


def table_or_error(function: Callable[[], Tabular]) -> Tabular | Exception:
    """Return a table, or the error in its place."""
    try:
        return function()
    except (EvaluationError, RuleError, NotCompiled) as error:
        return error


def vector(program: CompiledProgram, **options: Any) -> CompiledVectorEnv:
    """Return seven environments of the members in turn."""
    return CompiledVectorEnv(program, 7, max_episode_steps=9, **options)


def stepped(many: Any, program: CompiledProgram, rounds: int) -> tuple[list[Any], Exception | None]:
    """Return all results of a reset and some rounds of random actions, and the error that ended them."""
    actions, found = np.random.default_rng(0), list[Any]()
    try:
        seen, infos = many.reset(seed=4)
        found.append(seen)
        for _ in range(rounds):
            found += [
                infos["step"],
                infos["success"],
                *([infos["agent"].astype("U9")] if "agent" in infos else []),
            ]
            *results, infos = many.step(actions.integers(len(program.action_names), size=7))
            found += results
    except (EnvgraphError, RuntimeError) as error:
        return found, error
    return found, None


def shown(results: object) -> str:
    """Return everything as text: equal texts, equal arrays."""
    with np.printoptions(threshold=10**6, floatmode="unique"):
        return repr(results)


WAYS: dict[str, Callable[..., None]] = {
    "steps": steps,
    "table": table,
    "threads": threads,
    "exploration": exploration,
    "package": package,
    "steps by numba": steps_by_numba,
    "table by numba": table_by_numba,
    "threads by numba": threads_by_numba,
}

SMALL = (
    "moves between containers", "deletion under spo", "observed among a class that objects are not of",
    "bool parameters", "a clause without names holds once", "success and failure at once",
    "what a block asks for cannot be", "robots together in ..d", "episodes that a behaviour truncates",
    "division by zero in rewards", "what is deleted, and changed", "alternatives by weight and by priority",
    "agents together, some of which go", "few states with refusals",
)  # fmt: skip
"""Corners with fewer states than `LIMIT` by day, and four whose table is an error; most others have too many states."""

LONG = (
    "keydoor", "burning_forest",
    "objects that are merged", "objects that are merged, among other changes", "units that merge objects",
    "strings of objects that are merged", "classes that change, and with them what objects have",
    "units that ask for rules", "units that change attributes with many values",
    "units that undo the growth of a state", "rules with blocks in units", "matches that a unit chooses",
    "values that a unit passes on", "attempts and conditions", "loops, and steps that fail after others",
    "loops nested too deep for one function", "containers that are set, among other changes",
    "all targets are replaced", "references that are their own opposites", "blocks that change the same",
    "blocks that change attributes with many values", "blocks that delete containers and contents",
    "attributes with many values, of objects that come and go", "windows around a cell and around a pit",
)  # fmt: skip
"""Corners whose steps take most of a second or more, like those of others that meet the same constructs.

Of the two domains, `test_compiled_tables.py` compares all states.
"""

BY_DAY: dict[str, Collection[str]] = {
    "steps": [name for name in CORNERS if name not in LONG],
    "table": SMALL,
    "threads": ("warehouse", "arrivals by chance, and each that waits may leave"),
    "exploration": tuple(CORNERS)[::3],
    "package": (
        "warehouse",
        "floats",
        "blocks in blocks",
        "probabilities that the state has",
        "few states with refusals",
    ),
    "steps by numba": ("floats",),
    "table by numba": ("division by zero in rewards",),
    "threads by numba": ("floats",),
}
"""What is run by day; at night everything is. Numba takes seconds for each program and each way to use it."""

MATRIX = [(corner, way) for corner in CORNERS for way in WAYS if NIGHTLY or corner in BY_DAY[way]]


@pytest.mark.parametrize(("corner", "way"), MATRIX)
def test_compiled_construct_behaves_like_the_live_engine(corner: str, way: str) -> None:
    if "numba" in way:
        pytest.importorskip("numba")
    WAYS[way](family(corner))


REFUSED = (
    links.REFUSED
    | containers.REFUSED
    | classes.REFUSED
    | values.REFUSED
    | queries.REFUSED
    | blocks.REFUSED
    | units.REFUSED
)


@pytest.mark.parametrize("construct", REFUSED)
def test_constructs_that_are_not_compiled_are_reported_with_their_span(construct: str) -> None:
    """The place is what stands between [[ and ]]."""
    corner = REFUSED[construct]
    texts = {name: getattr(corner, name) for name in ("rules", "behaviour", "query")}
    (marked,) = [text.partition("[[")[2].partition("]]")[0] for text in texts.values() if "[[" in text]
    plain = {name: text.replace("[[", "", 1).replace("]]", "", 1) for name, text in texts.items()}
    with pytest.raises(NotCompiled) as caught:
        program_of(*replace(corner, **plain).opened(), native=False)
    assert caught.value.construct == construct.partition(" | ")[0]
    assert caught.value.span is not None
    assert caught.value.span.text.rstrip(";").strip() == marked.rstrip(";")
