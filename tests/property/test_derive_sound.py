"""Derived operators keep every valid model valid, and are never refused where they match."""

from __future__ import annotations

from random import Random
from typing import Any

from hypothesis import HealthCheck, event, given, settings, strategies as st

from envgraph.errors import has_errors
from envgraph.graph import Model, check_conformance
from envgraph.metamodel import Attribute, Metamodel
from envgraph.pattern import Derivation, Rule
from envgraph.rewrite import (
    Engine,
    derived,
)
from tests.property.strategies import bounded_metamodels, valid_model

EXAMPLES = 3 * settings().max_examples


def operators(metamodel: Metamodel, random: Random) -> Any:
    """The operators of one of the classes, if it has any."""
    made = Derivation("ops", "operators", (random.choice(metamodel.class_list).name,))
    return None if has_errors(Engine(Model(metamodel)).check(made)) else derived(made, metamodel)


def frozen_part(model: Model) -> object:
    """What no operator may change: frozen objects with their features, and the links of frozen features."""
    metamodel = model.metamodel
    found: list[object] = []
    for node in model.graph.store.nodes():
        cls = model.graph.class_of(node)
        frozen = any(metamodel.classes[above].frozen for above in metamodel.supertypes(cls))
        if frozen:
            found.append((node, cls))
        for feature in metamodel.features(cls).values():
            marked = any(annotation.name == "frozen" for annotation in feature.annotations)
            owned = any(metamodel.classes[above].frozen for above in metamodel.supertypes(feature.owner))
            if isinstance(feature, Attribute):
                held: list[object] = [model.graph.value(node, feature)]
                marked = marked or frozen
            else:
                held = sorted(model.graph.targets(node, feature))
            if (marked or owned or frozen) and held:
                found.append((node, feature.name, held))
    return sorted(map(repr, found))


def contained(model: Model) -> set[int]:
    return {node for node in model.graph.store.nodes() if model.graph.container(node) is not None}


def apply_one(model: Model, rules: list[Rule], engine: Engine, random: Random) -> str | None:
    """The kind of an operator that has been applied at a random match."""
    for rule in random.sample(rules, min(3, len(rules))):
        engine.add(rule)
        runner = engine.prepare(rule.qualified_name)
        rows = runner.rows()
        if rows:
            runner.fire(random.choice(list(rows)))
            return rule.name.split(".")[1]
    return None


@settings(max_examples=EXAMPLES, suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much])
@given(bounded_metamodels(), st.integers(0, 2**32), st.integers(1, 6))
def test_a_derived_operator_keeps_a_valid_model_valid(metamodel: Metamodel, seed: int, size: int) -> None:
    random = Random(seed)
    model = valid_model(metamodel, random, size)
    assert check_conformance(model) == []
    made = operators(metamodel, random)
    if made is None:
        return
    engine = Engine(model)
    engine.add(*made.patterns)
    frozen, placed = frozen_part(model), contained(model)
    kind = apply_one(model, list(made.rules), engine, random)
    event(str(kind))
    assert check_conformance(model) == []
    assert frozen_part(model) == frozen
    assert all(node in contained(model) or not model.graph.alive(node) for node in placed)
    model.check_integrity()
