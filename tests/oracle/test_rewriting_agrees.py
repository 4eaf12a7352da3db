"""Rules of every kind on random graphs, against an independent implementation of what the language says.

The oracle (`rewriting.py`) finds matches by trying and rewrites sets; the worlds are in `rewriting_worlds.py`.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import pytest
from hypothesis import example, given, settings, strategies as st

from envgraph.errors import EvaluationError, InvalidArgument, RuleError
from envgraph.graph import Model
from envgraph.lang import format_text, to_text
from envgraph.pattern import (
    Alap,
    AtomicStep,
    Pattern,
    Repeat,
    Rule,
    Step,
    StepSequence,
    TryStep,
    Unit,
    UnitCall,
    UnitChoice,
)
from envgraph.rewrite import Engine
from tests.oracle.rewriting_agreement import disagreement, given_values
from tests.oracle.rewriting_search import Env, Matching, Search, Thing
from tests.oracle.rewriting_smaller import without_refused_parts
from tests.oracle.rewriting_worlds import MOST, concrete, random_model, random_patterns, random_rule, state_of
from tests.oracle.worlds import Dice, random_metamodel
from tests.profile import examples
from tests.reading import read_definitions
from tests.unit.rewrite.graphs import snapshot

SEEDS = st.integers(0, 2**48)


@dataclass
class RewritingCase:
    """A graph with patterns and rules."""

    dice: Dice
    model: Model
    patterns: list[Pattern]
    rules: list[Rule]

    def engine(self, *rules: Rule, watch: bool = False) -> Engine:
        """One that knows these rules, on a model of its own."""
        engine = Engine(self.model.copy(), seed=1)
        engine.add(*self.patterns, *rules)
        if watch:
            for rule in rules:
                engine.watch(rule.name)
        return engine


def random_rewriting_case(seed: int, size: int = 1) -> RewritingCase:
    """What follows from a number."""
    dice = Dice(seed)
    metamodel = random_metamodel(dice)
    while not metamodel.references or not concrete(metamodel):
        metamodel = random_metamodel(dice)
    model = random_model(dice, metamodel)
    patterns = random_patterns(dice, metamodel)
    engine = Engine(model)
    engine.add(*patterns)
    state = state_of(model)
    made = [without_refused_parts(engine, random_rule(dice, state, patterns, f"r{number}")) for number in range(size)]
    return RewritingCase(dice, model, patterns, [rule for rule in made if rule is not None])


@settings(max_examples=examples(70))
@given(SEEDS)
def test_rule_applications_equal_the_oracle(seed: int) -> None:
    found = random_rewriting_case(seed)
    for rule in found.rules:
        given = given_values(found.dice, rule, state_of(found.model))
        engine = found.engine(rule, watch=not given and seed % 3 == 0)
        assert disagreement(engine, found.patterns, rule, given) is None


@settings(max_examples=examples(10))
@given(SEEDS)
def test_consecutive_rule_applications_equal_the_oracle(seed: int) -> None:
    """Where one rule leads, the next ones have their matches, watched or not."""
    found = random_rewriting_case(seed, size=3)
    given = {rule.name: given_values(found.dice, rule, state_of(found.model)) for rule in found.rules}
    free = [rule for rule in found.rules if not given[rule.name]]
    engine = found.engine(*found.rules)
    engine.watch(*(rule.name for rule in free))
    for _ in range(5):
        if len(engine.model) > MOST + 2:
            return
        for rule in found.rules:
            wrong = disagreement(engine, found.patterns, rule, given[rule.name], most=2)
            assert wrong is None, rule.name
        if not free:
            return
        apply_quietly(engine, found.dice.one(free).name)
        engine.check_integrity()


def apply_quietly(engine: Engine, name: str, **arguments: object) -> str:
    """Apply a rule, or not if it is refused; what came of it."""
    try:
        done = engine.apply(name, **arguments)
    except RuleError as error:
        return error.reason
    except EvaluationError:
        return "error"
    return str(done and done.match.row)


@settings(max_examples=examples(25))
@given(SEEDS)
def test_bound_parameters_filter_the_matches(seed: int) -> None:
    found = random_rewriting_case(seed)
    for rule in found.rules:
        state = state_of(found.model)
        values = given_values(found.dice, rule, state)
        search = Search(state, {pattern.name: pattern for pattern in found.patterns})
        expected = Matching(state, rule, search).matches(values)
        if not expected:
            continue
        chosen = found.dice.one(expected)
        names = [name for name in chosen if found.dice.chance(40)]
        bound = object_ids_for_things(values | {name: chosen[name] for name in names})
        engine = found.engine(rule)
        rows = {tuple(match.row) for match in engine.matches(rule.name, **bound)}
        order = engine.prepare(rule.name).shape.names
        wanted = [env for env in expected if all(env[name] == chosen[name] for name in names)]
        assert rows == {tuple(env[name] for name in order) for env in wanted}
        assert engine.count(rule.name, **bound) == len(wanted)
        said = apply_quietly(engine, rule.name, **bound)
        assert not said.startswith("(") or said in map(str, rows)
        things = [name for name in order if isinstance(chosen[name], Thing)]
        if things:
            other = max(state.classes) + 1000
            with pytest.raises(InvalidArgument, match="which does not exist"):
                engine.matches(rule.name, **object_ids_for_things(values | {things[0]: Thing(other)}))


def object_ids_for_things(env: Env) -> dict[str, object]:
    """With ids for objects."""
    return {name: int(value) if isinstance(value, Thing) else value for name, value in env.items()}


@settings(max_examples=examples(25))
@given(SEEDS)
def test_rule_read_from_its_text_is_applied_alike(seed: int) -> None:
    found = random_rewriting_case(seed)
    for rule in found.rules:
        text = to_text(rule)
        assert format_text("rules", text) == text
        (read,) = read_definitions(text, "rules", "r").definitions
        assert isinstance(read, Rule)
        given = given_values(found.dice, rule, state_of(found.model))
        states = []
        for one in (rule, read):
            engine = found.engine(one)
            said: list[object] = [match.row for match in engine.matches(one.name, **given)]
            said += [apply_quietly(engine, one.name, **given) for _ in range(3)]
            states.append((said, snapshot_of(engine)))
        assert states[0] == states[1]


@settings(max_examples=examples(15))
@given(SEEDS)
@example(1297)  # a variable of two classes that nothing can be of
def test_rollback_restores_the_state_and_the_order_of_rows(seed: int) -> None:
    found = random_rewriting_case(seed, size=4)
    free = [rule for rule in found.rules if not given_values(found.dice, rule, state_of(found.model))]
    if not free:
        return
    engine = found.engine(*free)
    engine.watch(*(rule.name for rule in free[:2]))
    engine.add(Unit("unit", (), random_step(found.dice, [rule.name for rule in free])))
    engine.step_limit = 100
    before = snapshot_of(engine)
    rows = {rule.name: [match.row for match in engine.matches(rule.name)] for rule in free}
    savepoint = engine.model.graph.history.savepoint()
    with suppress(RuleError, EvaluationError):
        engine.run("unit")
    engine.check_integrity()
    engine.model.graph.history.rollback(savepoint)
    assert snapshot_of(engine) == before
    assert {rule.name: [match.row for match in engine.matches(rule.name)] for rule in free} == rows
    engine.check_integrity()


def random_step(dice: Dice, names: list[str], depth: int = 0) -> Step:
    """A unit of any kind of steps."""
    roll = dice.number(0, 9) if depth < 3 else 0
    if roll < 2:
        return UnitCall(dice.one(names), every=dice.chance(25))
    inner = random_step(dice, names, depth + 1)
    match roll:
        case 2 | 3 | 4:
            return StepSequence((inner, *(random_step(dice, names, depth + 1) for _ in range(dice.number(1, 2)))))
        case 5:
            return UnitChoice((inner, *(UnitCall(dice.one(names)) for _ in range(dice.number(1, 2)))))
        case 6:
            return Alap(inner)
        case 7:
            return Repeat(dice.number(0, 1), dice.number(1, 3), inner)
        case 8:
            return TryStep(inner, random_step(dice, names, depth + 1) if dice.chance(60) else None)
        case _:
            return AtomicStep(inner)


def snapshot_of(engine: Engine) -> tuple[object, ...]:
    """The state with every order."""
    return snapshot(engine.model)
