"""Counting directed paths, and the complexity made of them."""

from __future__ import annotations

from itertools import combinations, product

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
        name: model.graph.new(cls) for name, cls in {"s": "Source", "a": "Field", "b": "Swamp", "p": "Port"}.items()
    }
    onward = metamodel.feature("Field", "next")
    for source, target in ("sa", "sb", "ap", "bp"):
        model.graph.link(nodes[source], onward, nodes[target])
    return Engine(model), nodes


def corner(*kinds: bool) -> str:
    """Return the class of the nodes that are starts, goals or closed."""
    return "Corner" + "".join(kind for kind, is_one in zip(KINDS, kinds, strict=True) if is_one)


KINDS = ("Start", "Goal", "Closed")
CORNERS = Metamodel(
    "corners",
    [
        Class("Spot", abstract=True, features=(Reference("next", "Spot", upper=None),)),
        *(Class(kind, abstract=True, supertypes=("Spot",)) for kind in KINDS),
        *(
            Class(
                corner(*kinds),
                supertypes=("Spot", *(kind for kind, one in zip(KINDS, kinds, strict=True) if one)),
            )
            for kinds in product((False, True), repeat=3)
        ),
    ],
)


def listed_paths(size: int, links: set[tuple[int, int]], starts: set[int], goals: set[int], closed: set[int]) -> int:
    """Return how many paths networkx lists from a start to a goal that visit no closed node."""
    graph = nx.DiGraph(link for link in links if closed.isdisjoint(link))
    graph.add_nodes_from(set(range(size)) - closed)
    return sum(
        1 if start == goal else len(list(nx.all_simple_paths(graph, start, goal)))
        for start in starts - closed
        for goal in goals - closed
    )


@given(st.integers(2, 8), st.data())
def test_path_complexity_equals_the_paths_listed_by_networkx(size: int, data: st.DataObject) -> None:
    some_nodes = st.sets(st.integers(0, size - 1))
    links = data.draw(st.sets(st.sampled_from(list(combinations(range(size), 2)))))
    starts, goals, avoid = (data.draw(some_nodes) for _ in range(3))
    model = Model(CORNERS)
    nodes = [model.create(corner(node in starts, node in goals, node in avoid)) for node in range(size)]
    for one, other in links:
        nodes[one].next.append(nodes[other])
    every, free = (listed_paths(size, links, starts, goals, closed) for closed in (set(), avoid))
    found = PathComplexity(CORNERS, "Start", "Goal", ("next",), "Closed").evaluate(Engine(model))
    assert found == (1.0 - free / every if every else 1.0)


def test_goal_without_outgoing_links_ends_a_path(places: Metamodel) -> None:
    engine, _ = built(places)
    assert PathComplexity(places, "Source", "Port", ("next",), "Swamp").evaluate(engine) == 0.5


def test_path_complexity_is_updated_after_changed_links_and_classes(places: Metamodel) -> None:
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
