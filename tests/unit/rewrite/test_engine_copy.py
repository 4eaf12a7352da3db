"""Copies of an engine, and arguments that are none."""

from __future__ import annotations

import copy
from typing import Any

import pytest

from envgraph.errors import InvalidArgument
from envgraph.graph import Model
from envgraph.metamodel import Attribute, Class, Metamodel, Scalar
from envgraph.pattern import (
    Body,
    Constant,
    LeftSide,
    Modification,
    Node,
    Parameter,
    PathConstraint,
    Pattern,
    Rule,
    Set,
    Variable,
)
from envgraph.rewrite import Engine

METAMODEL = Metamodel("lamps", [Class("Lamp", features=(Attribute("lit", Scalar.BOOL),))])


def engine() -> Engine:
    """Three dark lamps, and a rule that lights one."""
    model = Model(METAMODEL)
    for _ in range(3):
        model.create("Lamp")
    found = Engine(model)
    lit = PathConstraint("Lamp", ("lit",), Variable("lamp"), Constant(True))
    light = Modification((Set(Variable("lamp"), "lit", "=", Constant(True)),))
    found.add(
        Pattern("lit", (Parameter("lamp", "Lamp"),), (Body((lit,)),)),
        Rule("light", left=LeftSide((Node("lamp", "Lamp"),)), right=light),
    )
    found.watch("lit")
    return found


@pytest.mark.parametrize("make", [copy.copy, copy.deepcopy, Engine.copy])
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
def test_what_is_no_name_or_function_is_refused_at_once(wrong: Any) -> None:
    with pytest.raises(InvalidArgument):
        wrong(engine())
