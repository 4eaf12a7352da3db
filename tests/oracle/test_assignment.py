"""The CRA index of `rules/assignment` against a computation from the definition, over the objects of a model."""

from __future__ import annotations

from random import Random

import numpy as np
import pytest

import envgraph
from envgraph.graph import Model, Node
from envgraph.rewrite import Engine
from tests.oracle.domains_by_hand import every

MOVES = ("introduce", "assign", "move", "extract", "join")


def ratio(number: int, of: int) -> float:
    return number / of if of else 0.0


def cra(model: Model) -> tuple[float, float]:
    """Cohesion and coupling, class by class and pair by pair (Fleck, Troya and Wimmer 2016)."""
    classes = every(model, "Class")
    methods = {cls: [one for one in cls.encapsulates if one.cls == "Method"] for cls in classes}
    attributes = {cls: [one for one in cls.encapsulates if one.cls == "Attribute"] for cls in classes}

    def mai(source: Node, target: Node) -> int:
        return sum(a in list(m.dataDependency) for m in methods[source] for a in attributes[target])

    def mmi(source: Node, target: Node) -> int:
        return sum(n in list(m.functionalDependency) for m in methods[source] for n in methods[target])

    cohesion = coupling = 0.0
    for source in classes:
        for target in classes:
            callers, called, read = len(methods[source]), len(methods[target]), len(attributes[target])
            share = ratio(mai(source, target), callers * read)
            share += ratio(mmi(source, target), callers * (called - 1))
            if source is target or source == target:
                cohesion += share
            else:
                coupling += share
    return cohesion, coupling


def random_model(seed: int, features: int) -> Engine:
    """An engine with the domain on random features, some of them assigned."""
    engine, rng = envgraph.open("assignment"), Random(seed)
    model = engine.model
    root = every(model, "ClassModel")[0]
    for number in range(features):
        root.features.append(model.create(rng.choice(("Method", "Attribute")), name=f"f{number}"))
    methods, attributes = every(model, "Method"), every(model, "Attribute")
    for method in methods:
        for feature in rng.sample(attributes, 2):
            method.dataDependency.append(feature)
        for other in rng.sample(methods, 2):  # itself, now and then
            method.functionalDependency.append(other)
    return engine


def value(engine: Engine, pattern: str) -> float:
    (match,) = engine.matches(pattern)
    (name,) = match.names
    return float(match[name])  # type: ignore[arg-type]


@pytest.mark.parametrize("watched", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_cra_index_equals_its_definition_after_random_moves(seed: int, watched: bool) -> None:
    engine = random_model(seed, 8)
    if watched:
        engine.watch("craIndex", "cohesion", "coupling", "unassigned")
    engine.rng = rng = np.random.default_rng(seed)
    applied = set[str]()
    for _ in range(60):
        chosen = engine.choose(MOVES, rng)
        assert chosen is not None
        engine.fire(*chosen)
        applied.add(chosen[0])
        cohesion, coupling = cra(engine.model)
        assert value(engine, "cohesion") == pytest.approx(cohesion, abs=1e-12)
        assert value(engine, "coupling") == pytest.approx(coupling, abs=1e-12)
        assert value(engine, "craIndex") == pytest.approx(cohesion - coupling, abs=1e-12)
        free = [one.id for one in every(engine.model, "Feature") if one.isEncapsulatedBy is None]
        assert sorted(match["feature"].id for match in engine.matches("unassigned")) == sorted(free)
        names = [cls.name for cls in every(engine.model, "Class")]
        assert len(set(names)) == len(names), "classes have names of their own"
        assert all(len(cls.encapsulates) for cls in every(engine.model, "Class"))
    assert applied == {f"assignment.{move}" for move in MOVES}
