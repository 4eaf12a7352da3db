"""Compiled environments beside live ones: the same numbers are drawn, and everything has to be equal."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from re import sub
from typing import Any

import numpy as np

from envgraph.env import Behaviour, KeyIndex, Simulator, indexed_classes
from envgraph.env.compiled import Batch, Program, program_of
from envgraph.env.compiled._changes import calls_of
from envgraph.env.compiled._kernels import BEYOND, FULL, OVERFLOW
from envgraph.env.compiled._layout import ERROR
from envgraph.errors import EvaluationError, RuleError
from envgraph.graph import Model
from envgraph.lang import load_workspace
from envgraph.metamodel import Reference
from envgraph.rewrite import Engine

REPOSITORY = Path(__file__).parents[3]
BUNDLED = REPOSITORY / "rules"
MASKED = 500
"""Actions of which all masks are compared: of many agents that act together there may be some ten thousand."""
EXTRA = REPOSITORY / "tests" / "data" / "compiled"


def opened(*paths: Path) -> tuple[Engine, Behaviour]:
    """An engine of the model among some files, and the behaviour."""
    workspace = load_workspace([str(path) for path in paths])
    engine = Engine(workspace.models[0].model)
    engine.add(*workspace.definitions)
    return engine, workspace.behaviour()


def mutants(engine: Engine, behaviour: Behaviour, count: int, seed: int = 0) -> list[Engine]:
    """Members of a family: random applications of rules that the behaviour does not call, and that need no value."""
    called = {call.rule for call in calls_of(behaviour)}
    rules = [name for name in engine.rules if name not in called and name.rpartition(".")[2] not in called]
    rules = [name for name in rules if not any(one.required for one in engine.signature(name).parameters)]
    found = []
    for number in range(count):
        other = engine.copy()
        rng = np.random.default_rng([seed, number])
        for _ in range(int(rng.integers(1, 9)) if number and rules else 0):
            name = rules[int(rng.integers(len(rules)))]
            rows = other.matches(name)
            if rows:
                with suppress(RuleError):
                    other.apply(name, rows[int(rng.integers(len(rows)))])
        found.append(other)
    return found


def family_keys(engines: Sequence[Engine], behaviour: Behaviour) -> KeyIndex:
    """The indices of objects over all members."""
    metamodel = engines[0].model.metamodel
    classes = indexed_classes(behaviour, metamodel)
    keys = KeyIndex.of(engines[0].model, classes)
    for engine in engines[1:]:
        keys = keys.merge(KeyIndex.of(engine.model, classes), metamodel)
    return keys


def step_side_by_side(
    engines: Sequence[Engine],
    behaviour: Behaviour,
    steps: int,
    *,
    native: bool,
    seed: int = 0,
    spare: int = 12,
) -> Program:
    """Step all members on both, with random actions; anything that differs is an error of the test.

    Where an episode cannot begin, or something has no space in a state, that is all.
    """
    keys = family_keys(engines, behaviour)
    members = [engine.copy() for engine in engines]
    program = program_of(engines[0], behaviour, members, keys, native=native, spare=spare)
    batch = Batch(program, range(len(engines)))
    live = [Simulator(engine, behaviour, keys) for engine in engines]
    streams = [np.random.Generator(np.random.PCG64([seed, number])) for number in range(len(engines))]
    batch.seed(streams)
    assert all(simulator.action_names == program.action_names for simulator in live)
    assert all(simulator.observation_shape == program.observation_shape for simulator in live)
    chosen = np.random.default_rng(seed)
    again = np.ones(len(engines), dtype=np.bool_)
    for step in range(steps):
        if again.any():
            begun = {n: _tried(live[n].reset, streams[n]) for n in map(int, np.flatnonzero(again))}
            enough = _agree(batch, _tried(batch.reset, again), begun.values(), f"before step {step}")
            if not enough or any(isinstance(one, Exception) for one in begun.values()):
                break
            for number, wanted in begun.items():
                assert batch.observation[number] == wanted, f"before step {step}, member {number}"
        actions = chosen.integers(len(program.action_names), size=len(engines))
        allowed = np.array([simulator.allowed() for simulator in live])
        if not native and len(program.action_names) <= MASKED:  # numba has to compile what asks
            assert batch.allowed().tolist() == allowed.tolist(), f"before step {step}"
        expected = [
            _tried(simulator.step, int(action), stream)
            for simulator, action, stream in zip(live, actions, streams, strict=True)
        ]
        said = f"step {step}, {[program.action_names[action] for action in actions]}"
        if not _agree(batch, _tried(batch.step, actions, again=False), expected, said):
            break
        again = np.zeros(len(engines), dtype=np.bool_)
        for number, outcome in enumerate(expected):
            if isinstance(outcome, Exception):
                again[number] = True
                continue
            did = live[number].did and not behaviour.together  # what one does may let another one act
            assert allowed[number, actions[number]] or not did, f"{said}, member {number}"
            found = (batch.reward[number], batch.ended[number], batch.observation[number])
            wanted = (outcome.reward, outcome.terminated, outcome.observation)
            assert found == wanted, f"{said}, member {number}"
            again[number] = outcome.terminated != 0 or batch.steps[number] >= (behaviour.limit or 200)
            if step % 32 == number:
                assert_same_state(batch, number, live[number])
    return program


def _tried(function: Callable[..., Any], *arguments: object, **options: object) -> Any:
    """What a function returns, or the error that it raises."""
    try:
        return function(*arguments, **options)
    except (RuleError, EvaluationError) as error:
        return error


def _agree(batch: Batch, error: Exception | None, expected: Iterable[object], said: str) -> bool:
    """See that all environments together raise the last of the errors that each alone does, if there is one.

    Returns:
        Whether there was space for everything.
    """
    if np.isin(batch.states[:, ERROR], (OVERFLOW, BEYOND, FULL)).any():
        return False
    errors = [one for one in expected if isinstance(one, Exception)]
    assert (error is not None) == bool(errors), f"{said}: {error}, but live {errors}"
    if errors:  # links have no order, but are listed in the one in which they came
        found, wanted = (sorted(str(one).splitlines()) for one in (error, errors[-1]))
        if batch.program.layout.renumbered:  # ids are what the message has of them
            found, wanted = (sorted(sub("#[0-9]+", "#", line) for line in lines) for lines in (found, wanted))
        assert found == wanted, said
    return True


def assert_same_state(batch: Batch, number: int, simulator: Simulator) -> None:
    """The state of an environment, cell by cell, is that of the live one."""
    hashed, facts = simulator.state_key(), None
    if batch.program.layout.renumbered:
        facts = facts_of(simulator.engine.model)
    with batch.model_of(number) as twin:
        if facts is None:
            assert twin.state_key() == hashed
        else:
            assert facts_of(twin.engine.model) ^ facts == set()
            assert twin.turn == simulator.turn


def facts_of(model: Model) -> set[tuple[object, ...]]:
    """All that a model says, with the ranks of objects in place of their ids."""
    rank = {node.id: number for number, node in enumerate(sorted(model.nodes(), key=lambda node: node.id))}
    found: set[tuple[object, ...]] = set()
    for node, number in rank.items():
        found.add((number, model.class_of(node)))
        for feature in model.metamodel.features(model.class_of(node)).values():
            if isinstance(feature, Reference):
                found.update((number, feature.name, rank[target]) for target in model.targets(node, feature))
            else:
                values = model.values(node, feature) if feature.many else model.value(node, feature)
                found.add((number, feature.name, str(values)))
    return found
