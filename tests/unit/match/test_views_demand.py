"""Closures in views are followed from what the rest of a body asks for, and from nothing else."""

from __future__ import annotations

import pytest

from envgraph.graph import Model
from envgraph.match import FREE, CompiledMatcher, ViewMatcher
from envgraph.metamodel import Class, Metamodel, Reference
from envgraph.pattern import Aggregate, Comparison, Library
from tests.unit.match.writing import find, path, pattern, v

SIDE = 12
METAMODEL = Metamodel(
    "grid",
    (Class("Cell", features=(Reference("next", "Cell", 0, None),)), Class("Start", supertypes=("Cell",))),
)


def grid() -> Model:
    """A square of cells, linked both ways, with one start in a corner."""
    model = Model(METAMODEL)
    following = METAMODEL.references[0]
    cells = [[model.graph.new("Cell" if row or column else "Start") for column in range(SIDE)] for row in range(SIDE)]
    for row in range(SIDE):
        for column in range(SIDE):
            for below, right in ((row + 1, column), (row, column + 1)):
                if below < SIDE and right < SIDE:
                    model.graph.link(cells[row][column], following, cells[below][right])
                    model.graph.link(cells[below][right], following, cells[row][column])
    return model


def library() -> Library:
    """Questions about what the start reaches."""
    found = Library(METAMODEL)
    found.add(
        pattern("link(a : Cell, b : Cell)", [path("Cell.next", "a", "b")]),
        pattern("reach(a : Cell, b : Cell)", [find("link+", "a", "b")]),
        pattern(
            "size(s : Start, n : int)",
            [Comparison("==", v("n"), Aggregate("count", find("reach", "s", "_")))],
        ),
        pattern(
            "back(s : Start, n : int)",
            [Comparison("==", v("n"), Aggregate("count", find("reach", "_", "s")))],
        ),
        pattern("loop(s : Start)", [find("link+", "s", "s")]),
    )
    return found


@pytest.mark.parametrize(
    ("query", "before", "after"), [("size", [(0, 144)], [(0, 0)]), ("back", [(0, 144)], [(0, 143)])]
)
def test_counts_of_reached_objects_follow_link_changes(query: str, before: object, after: object) -> None:
    model = grid()
    matcher = ViewMatcher(model, library())
    matcher.watch(query)
    assert matcher.rows(query, (FREE, FREE)) == before
    savepoint = model.graph.history.savepoint()
    for target in list(model.graph.targets(0, METAMODEL.references[0])):
        model.graph.unlink(0, METAMODEL.references[0], target)
    assert matcher.rows(query, (FREE, FREE)) == after
    assert CompiledMatcher(model, matcher.library).rows(query, (FREE, FREE)) == after
    matcher.check_integrity()
    model.graph.history.rollback(savepoint)
    assert matcher.rows(query, (FREE, FREE)) == before


@pytest.mark.parametrize("query", ["size", "back"])
def test_closure_queries_from_one_start_store_no_pairs(query: str) -> None:
    matcher = ViewMatcher(grid(), library())
    matcher.watch(query)
    closures = [
        each for each in matcher.watched_views.network.operators.values() if type(each).__name__ == "ClosureOperator"
    ]
    assert [each.size() for each in closures] == [SIDE * SIDE]


def test_cycle_views_store_only_nodes_on_cycles() -> None:
    matcher = ViewMatcher(grid(), library())
    matcher.watch("loop")
    circles = [
        each for each in matcher.watched_views.network.operators.values() if type(each).__name__ == "CycleOperator"
    ]
    assert [each.size() for each in circles] == [SIDE * SIDE]
    assert not any(
        type(each).__name__ == "ClosureOperator" for each in matcher.watched_views.network.operators.values()
    )
