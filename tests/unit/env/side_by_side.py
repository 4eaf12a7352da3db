"""Compiled environments beside live ones: the same numbers are drawn, and everything has to be equal."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import blake2b
from math import prod
from operator import mul
from pathlib import Path
from re import sub
from typing import Any

import numpy as np

from envgraph.env import Behaviour, GraphView, KeyIndex, Simulator, Tabular, TextView, indexed_classes
from envgraph.env.compiled import CompiledBatch, CompiledProgram, program_of
from envgraph.env.compiled.batches._batch import INT_ERROR
from envgraph.env.compiled.kernels.step_kernels import FULL, OVERFLOW
from envgraph.errors import LARGEST_INT, EvaluationError, RuleError
from envgraph.graph import Model
from envgraph.lang import load_workspace
from envgraph.metamodel import Reference
from envgraph.rewrite import Engine
from tests.profile import NIGHTLY
from tests.unit.env.remembered import CachedSimulator, State, Transition

REPOSITORY = Path(__file__).parents[3]
BUNDLED = REPOSITORY / "rules"
CLOSELY = 40 if NIGHTLY else 20
"""States of which all are compared cell by cell."""
MASKED = 500
"""Actions of which all masks are compared: of many agents that act together there may be some ten thousand."""
TOO_LARGE = " entries is too large"
"""The end of the error of a table of a pattern, with space for objects that rules create."""
MOST_SPACE = 50
"""For new objects in a state: those that are created without end take more and more time and space."""
ERROR = 0
"""The column of `Batch.states` that says what went wrong in an environment; 0 for nothing."""
EXTRA = REPOSITORY / "tests" / "data" / "compiled"


def opened(*paths: Path) -> tuple[Engine, Behaviour]:
    """An engine of the model among some files, and the behaviour."""
    workspace = load_workspace([str(path) for path in paths])
    engine = Engine(workspace.models[0].model)
    engine.add(*workspace.definitions)
    return engine, workspace.behaviour()


def called_rules(behaviour: Behaviour) -> set[str | None]:
    """Return the names of the rules that resets, actions and effects of a behaviour call."""
    owners = (behaviour, *behaviour.agents)
    branches = [
        *(branch for reset in behaviour.resets for branch in reset.apply),
        *(branch for owner in owners for action in owner.actions for branch in action.branches),
        *(branch for owner in owners for effect in owner.effects for branch in effect.apply),
    ]
    return {branch.call.rule for branch in branches}


def mutants(engine: Engine, behaviour: Behaviour, count: int, seed: int = 0, first: int = 0) -> list[Engine]:
    """Members of a family: random applications of rules that the behaviour does not call, and that need no value."""
    called = called_rules(behaviour)
    rules = [name for name in engine.rules if name not in called and name.rpartition(".")[2] not in called]
    rules = [name for name in rules if not any(one.is_required for one in engine.signature(name).parameters)]
    found = []
    for number in range(first, count):
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
    keys = KeyIndex.of_model(engines[0].model, classes)
    for engine in engines[1:]:
        keys = keys.merge(KeyIndex.of_model(engine.model, classes), metamodel)
    return keys


@dataclass(frozen=True)
class Corner:
    """An environment that is run in several ways.

    Attributes:
        opened: returns a new engine of its model, and its behaviour.
        members: how many models its family has: this one, and mutants of it.
        spare: how many new objects a state of its program has space for.
    """

    opened: Callable[[], tuple[Engine, Behaviour]]
    members: int = 3
    spare: int = 12


class Family:
    """Engines of a behaviour, and the programs that are made of them, each when it is first asked for.

    Args:
        engines: of the members. A program keeps them: nothing else may change their models.
        spare: how many new objects a state has space for.

    Attributes:
        compared: how many steps have been compared.
    """

    compared = 0

    def __init__(self, engines: Sequence[Engine], behaviour: Behaviour, spare: int = 12) -> None:
        self.engines = engines
        self.behaviour = behaviour
        self.keys = family_keys(engines, behaviour)
        self._spare = spare

    @cached_property
    def program(self) -> CompiledProgram:
        """The program, run by Python."""
        return program_of(self.engines[0], self.behaviour, self.engines, self.keys, native=False, spare=self._spare)

    @cached_property
    def native(self) -> CompiledProgram:
        """The same program, compiled by numba."""
        return replace(self.program, native=True)

    def copies(self) -> list[Engine]:
        """Return copies of the engines, whose models may change."""
        return [engine.copy() for engine in self.engines]


def family_of(corner: Corner, most: int = 3) -> Family:
    """Return the family of a corner, of its last members if it has more than `most`."""
    engine, behaviour = corner.opened()
    first = max(0, corner.members - most)
    return Family(mutants(engine, behaviour, corner.members, first=first), behaviour, corner.spare)


def step_side_by_side(
    engines: Sequence[Engine],
    behaviour: Behaviour,
    steps: int,
    *,
    native: bool,
    seed: int = 0,
    spare: int = 12,
) -> CompiledProgram:
    """Do `compare_random_steps` for engines that have no family yet; return the program."""
    family = Family([engine.copy() for engine in engines], behaviour, spare)
    return compare_random_steps(family, steps, native=native, seed=seed)


def compare_random_steps(family: Family, steps: int, *, native: bool, seed: int = 0) -> CompiledProgram:
    """Step all members on both, with random actions; anything that differs is an error of the test.

    What each step gives is compared, and whether states that are one are one on both sides; of the states those that
    are new at first, and each 128th of the others, cell by cell. The live engine makes each transition once.

    Where an episode cannot begin, something has no space in a state, or many objects have been created, that is all.
    """
    engines, behaviour, keys = family.copies(), family.behaviour, family.keys
    program = family.native if native else family.program
    batch = CompiledBatch(program, range(len(engines)))
    live = [CachedSimulator(Simulator(engine, behaviour, keys)) for engine in engines]
    same = [SameStates(batch, number, one) for number, one in enumerate(live)]
    streams = [np.random.Generator(np.random.PCG64([seed, number])) for number in range(len(engines))]
    batch.seed(streams)
    assert all(one.simulator.action_names == program.action_names for one in live)
    assert all(one.simulator.observation_shape == program.observation_shape for one in live)
    chosen = np.random.default_rng(seed)
    over = np.ones(len(engines), dtype=np.bool_)
    for step in range(steps):
        if over.any():
            begun = {n: live[n].reset(streams[n].random()) for n in map(int, np.flatnonzero(over))}
            enough = _agree(batch, _raised_error(batch.reset, over), begun.values(), f"before step {step}")
            if not enough or any(one.error for one in begun.values()):
                break
            for number, wanted in begun.items():
                assert observation_numbers(batch)[number] == wanted.observation, f"before step {step}, member {number}"
                same[number].see(f"before step {step}, member {number}")
        actions = chosen.integers(len(program.action_names), size=len(engines))
        allowed = [one.present.allowed for one in live]
        expected = [
            one.step(action, stream.random())
            for one, action, stream in zip(live, actions.tolist(), streams, strict=True)
        ]
        said = f"step {step}, {[program.action_names[action] for action in actions]}"
        if not _agree(batch, _raised_error(batch.step, actions, resets_ended=False), expected, said):
            break
        if batch.program.members.spare > max(MOST_SPACE, 2 * program.members.spare):
            break
        over = (batch.ended != 0) | (batch.steps >= (behaviour.limit or 200))
        found = zip(batch.reward.tolist(), batch.ended.tolist(), observation_numbers(batch), strict=True)
        for number, (outcome, results) in enumerate(zip(expected, found, strict=True)):
            if outcome.error is not None:
                over[number] = True
                continue
            at = f"{said}, member {number}"
            can = behaviour.together or allowed[number] is None or allowed[number][actions[number]]
            assert can or not outcome.did, at  # of those that act together, one may let another one act
            assert results == (outcome.reward, outcome.terminated, outcome.observation), at
            same[number].see(at)
            family.compared += 1
    return program


def observation_numbers(batch: CompiledBatch) -> list[int]:
    """Return the number of each environment's observation, also if it has more than 64 bits."""
    shape = batch.program.observation_shape
    if prod(shape) <= LARGEST_INT:
        return batch.observation.tolist()
    weights = [prod(shape[:place]) for place in range(len(shape))]
    return [sum(map(mul, row, weights)) for row in batch.components.tolist()]


class SameStates:
    """Sees that the states of an environment are those of the live one.

    Args:
        batch: has the environment.
        number: of it.
        live: steps beside it.
    """

    def __init__(self, batch: CompiledBatch, number: int, live: CachedSimulator) -> None:
        self._batch = batch
        self._number = number
        self._live = live
        self._known: dict[tuple[int, bytes], State] = {}
        self._mask = not batch.program.native and len(batch.program.action_names) <= MASKED
        """Whether masks are compared: numba has to compile what asks."""

    def see(self, said: str) -> None:
        """Compare the present states."""
        batch, state = self._batch, self._live.present
        bits = batch.states[self._number].tobytes() + batch.float_states[self._number].tobytes()
        row = len(bits), blake2b(bits, digest_size=16).digest()  # the bits of all states may be too much
        known = self._known.setdefault(row, state)
        assert known is state, f"{said}: two states of the live engine are one"
        if state.row == row:
            return
        grown = state.row is None or state.row[0] != row[0]
        assert grown, f"{said}: a state of the live engine is two"
        state.row = row
        if state.number > CLOSELY and state.number % 128:
            return
        live = self._live.checkout_present_state()
        state.allowed = live.action_mask()
        if self._mask:
            assert batch.action_masks()[self._number].tolist() == state.allowed.tolist(), said
        assert_same_state(batch, self._number, live)


def _raised_error(function: Callable[..., Any], *arguments: object, **options: object) -> Exception | None:
    """The error that a function raises, if it does."""
    try:
        function(*arguments, **options)
    except (RuleError, EvaluationError) as error:
        return error
    return None


def _agree(batch: CompiledBatch, error: Exception | None, expected: Iterable[Transition], said: str) -> bool:
    """See that all environments together raise the last of the errors that each alone does, if there is one.

    Returns:
        Whether there was space for everything.
    """
    message = getattr(error, "message", "")
    if np.isin(batch.states[:, ERROR], (OVERFLOW, FULL)).any() or message == INT_ERROR or message.endswith(TOO_LARGE):
        return False
    errors = [one.error for one in expected if one.error]
    assert (error is not None) == bool(errors), f"{said}: {error}, but live {errors}"
    if errors:
        assert lines_of(error, batch.program) == lines_of(errors[-1], batch.program), said
    return True


def lines_of(error: object, program: CompiledProgram) -> list[str]:
    """Return the lines of an error."""
    text = str(error)
    if program.layout.reuses_numbers:  # ids are what the message has of them
        text = sub("#[0-9]+", "#", text)
    return text.splitlines()


def assert_same_state(batch: CompiledBatch, number: int, simulator: Simulator) -> None:
    """The state of an environment, cell by cell, is that of the live one, and is seen as a graph in the same order.

    In words it is the same, too.
    """
    hashed, facts = simulator.state_key(), None
    if batch.program.layout.reuses_numbers:
        facts = facts_of(simulator.engine.model)
    view = GraphView(simulator.behaviour, simulator.engine.model.metamodel)
    text = TextView(simulator.behaviour)
    wanted, words = view.observe(simulator), text.observe(simulator)
    assert words in text.space
    with batch.live_simulator(number) as twin:
        assert all(map(np.array_equal, view.observe(twin), wanted))
        assert text.observe(twin) == words
        if facts is None:
            assert twin.state_key() == hashed
        else:
            assert facts_of(twin.engine.model) ^ facts == set()
            assert twin.turn == simulator.turn


def assert_equal_tables(found: Tabular, wanted: Tabular) -> None:
    """Check a table, and that it is the other one, number by number."""
    found.check()
    for name in Tabular.__slots__:
        one, other = getattr(found, name), getattr(wanted, name)
        if isinstance(other, np.ndarray):
            assert one.dtype == other.dtype, name
            assert np.array_equal(one, other), name
        else:
            assert one == other, name


def facts_of(model: Model) -> set[tuple[object, ...]]:
    """All that a model says, with the ranks of objects in place of their ids."""
    rank = {node.id: number for number, node in enumerate(sorted(model.nodes(), key=lambda node: node.id))}
    found: set[tuple[object, ...]] = set()
    for node, number in rank.items():
        found.add((number, model.graph.class_of(node)))
        for feature in model.metamodel.features(model.graph.class_of(node)).values():
            if isinstance(feature, Reference):
                found.update((number, feature.name, rank[target]) for target in model.graph.targets(node, feature))
            else:
                graph = model.graph  # the order of many values is no part of a state
                values = sorted(graph.values(node, feature)) if feature.many else graph.value(node, feature)
                found.add((number, feature.name, str(values)))
    return found
