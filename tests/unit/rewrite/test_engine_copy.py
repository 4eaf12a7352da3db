"""Copies of an engine, and arguments that are none."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import pytest

from envgraph.errors import EvaluationError, InvalidArgument
from envgraph.graph import Model
from envgraph.match import ViewMatcher
from envgraph.metamodel import Attribute, Class, Metamodel, Scalar
from envgraph.pattern import (
    Body,
    Constant,
    LeftSide,
    Modification,
    Parameter,
    PathConstraint,
    Pattern,
    Rule,
    RuleNode,
    SetAction,
    Variable,
)
from envgraph.rewrite import Engine
from tests.oracle.naive._naive import NaiveMatcher

METAMODEL = Metamodel("lamps", [Class("Lamp", features=(Attribute("lit", Scalar.BOOL),))])


def engine() -> Engine:
    """Three dark lamps, and a rule that lights one."""
    model = Model(METAMODEL)
    for _ in range(3):
        model.create("Lamp")
    found = Engine(model)
    lit = PathConstraint("Lamp", ("lit",), Variable("lamp"), Constant(True))
    light = Modification((SetAction(Variable("lamp"), "lit", "=", Constant(True)),))
    found.add(
        Pattern("lit", (Parameter("lamp", "Lamp"),), (Body((lit,)),)),
        Rule("light", left=LeftSide((RuleNode("lamp", "Lamp"),)), right=light),
    )
    found.watch("lit")
    return found


def _pickled(one: Engine) -> Engine:
    found = pickle.loads(pickle.dumps(one))
    assert isinstance(found, Engine)
    return found


@pytest.mark.parametrize("make", [copy.copy, copy.deepcopy, Engine.copy, _pickled])
def test_a_copy_is_independent(make: Any) -> None:
    one = engine()
    other = make(one)
    assert other.watched == one.watched == ("lit",)
    assert other.model.state_hash() == one.model.state_hash()
    other.apply("light")
    assert (one.count("lit"), other.count("lit")) == (0, 1)
    one.check_integrity()
    other.check_integrity()


@pytest.mark.parametrize(
    "wrong",
    [
        lambda e: e.watch(["lit"]),
        lambda e: e.watch(3),
        lambda e: e.listen("lit", None),
        lambda e: e.listen("lit", print, 3),
        lambda e: e.unlisten(None),
        lambda e: e.count(None),
        lambda e: e.why_not(("lit",)),
    ],
)
def test_wrong_callables_and_names_are_refused_at_once(wrong: Any) -> None:
    with pytest.raises(InvalidArgument):
        wrong(engine())


@pytest.mark.parametrize("make", [copy.deepcopy, _pickled])
@pytest.mark.parametrize("matcher", [ViewMatcher, NaiveMatcher])
def test_copies_continue_with_the_same_random_choices(make: Any, matcher: Any) -> None:
    one = Engine(engine().model, seed=7, matcher=matcher)
    one.add(*engine().definitions)
    one.step_limit = 99
    first = one.rng.random()
    other = make(one)
    assert (other.seed, other.step_limit, other.rules) == (7, 99, one.rules)
    assert other.rng.random() == one.rng.random() != first == one.copy().rng.random()


def test_matches_are_copied_and_pickled_as_the_nodes_in_them() -> None:
    one = engine()
    one.model.nodes("Lamp")[1].lit = True
    match = one.first("lit")
    assert match is not None
    assert copy.copy(match) is copy.deepcopy(match) is match
    twin, model = pickle.loads(pickle.dumps((match, one.model)))
    assert twin == Engine.first(_with_definitions(one, model), "lit")
    assert twin.lamp in model


def _with_definitions(one: Engine, model: Model) -> Engine:
    twin = Engine(model)
    twin.add(one.definition("lit"))
    return twin


def test_a_version_cannot_be_pickled_and_a_copy_of_it_is_itself() -> None:
    one = engine()
    version = one.commit()
    with pytest.raises(TypeError, match="send its model"):
        pickle.dumps(version)
    assert copy.copy(version) is copy.deepcopy([version])[0] is version


def test_why_not_reports_deleted_objects() -> None:
    one = engine()
    lamp = one.model.nodes("Lamp")[0]
    lamp.delete()
    with pytest.raises(InvalidArgument, match="which does not exist"):
        one.why_not("lit", lamp=lamp.id)


def test_a_match_of_a_deleted_object_still_has_its_handle() -> None:
    one = engine()
    lamp = one.apply("light").match.lamp  # type: ignore[union-attr]
    told: list[int] = []
    one.listen("lit", lambda appeared, disappeared: told.extend(match.lamp.id for match in disappeared))
    with one.transaction():
        lamp.delete()
    assert told == [lamp.id]


def test_endless_changes_by_listeners_are_stopped() -> None:
    one = engine()

    def toggle(appeared: object, disappeared: object) -> None:
        lamp = one.model.nodes("Lamp")[1]
        lamp.lit = not lamp.lit

    one.listen("lit", toggle)
    with pytest.raises(EvaluationError, match="change the model at every notification"), one.transaction():
        one.model.nodes("Lamp")[0].lit = True
