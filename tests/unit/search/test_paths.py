"""Counting directed paths, and the complexity made of them."""

from __future__ import annotations

from itertools import combinations

import networkx as nx
import pytest
from hypothesis import given, strategies as st

from envgraph.errors import EvaluationError
from envgraph.graph import Model
from envgraph.metamodel import Class, Metamodel, Reference
from envgraph.rewrite import Engine
from envgraph.search import (
    PathComplexity,
)
from envgraph.search.problem._paths import (
    count_paths,
)


@pytest.fixture
def places() -> Metamodel:
    """Ports have no way on: a goal without the reference that paths follow."""
    return Metamodel(
        "places",
        [
            Class("Spot", abstract=True),
            Class("Port", supertypes=("Spot",)),
            Class("Field", supertypes=("Spot",), features=(Reference("next", "Spot", upper=None),)),
            Class("Source", supertypes=("Field",)),
            Class("Swamp", supertypes=("Field",)),
        ],
    )


def built(metamodel: Metamodel) -> tuple[Engine, dict[str, int]]:
    """Two ways from source to port, one of them over a swamp."""
    model = Model(metamodel)
    nodes = {
        name: model.graph.new(cls)
        for name, cls in {"s": "Source", "a": "Field", "b": "Swamp", "p": "Port"}.items()
    }
    onward = metamodel.feature("Field", "next")
    for source, target in ("sa", "sb", "ap", "bp"):
        model.graph.link(nodes[source], onward, nodes[target])
    return Engine(model), nodes


@given(st.integers(2, 8), st.data())
def test_paths_are_counted_as_networkx_lists_them(size: int, data: st.DataObject) -> None:
    some_nodes = st.sets(st.integers(0, size - 1))
    links = data.draw(st.sets(st.sampled_from(list(combinations(range(size), 2)))))
    starts, goals, avoid = (data.draw(some_nodes) for _ in range(3))
    steps = tuple((node, tuple(v for u, v in sorted(links) if u == node)) for node in range(size))
    graph = nx.DiGraph(link for link in links if avoid.isdisjoint(link))
    graph.add_nodes_from(set(range(size)) - avoid)
    listed = sum(
        1 if start == goal else len(list(nx.all_simple_paths(graph, start, goal)))
        for start in starts - avoid
        for goal in goals - avoid
    )
    assert count_paths(size, steps, sorted(starts), sorted(goals), avoid) == listed


def test_a_goal_needs_no_way_on(places: Metamodel) -> None:
    engine, _ = built(places)
    assert PathComplexity(places, "Source", "Port", ("next",), "Swamp").evaluate(engine) == 0.5


def test_links_and_classes_that_change_are_seen(places: Metamodel) -> None:
    measure = PathComplexity(places, "Source", "Port", ("next",), "Swamp")
    engine, nodes = built(places)
    engine.model.graph.retype(nodes["a"], "Swamp")
    assert measure.evaluate(engine) == 1.0
    engine.model.graph.retype(nodes["b"], "Field")
    assert measure.evaluate(engine) == 0.5
    onward = places.feature("Field", "next")
    engine.model.graph.unlink(nodes["a"], onward, nodes["p"])
    assert measure.evaluate(engine) == 0.0
    engine.model.graph.unlink(nodes["b"], onward, nodes["p"])
    assert measure.evaluate(engine) == 1.0


def test_links_in_a_cycle_are_refused(places: Metamodel) -> None:
    engine, nodes = built(places)
    engine.model.graph.link(nodes["a"], places.feature("Field", "next"), nodes["s"])
    with pytest.raises(EvaluationError, match="along next form a cycle"):
        PathComplexity(places, "Source", "Port", ("next",), "Swamp").evaluate(engine)
