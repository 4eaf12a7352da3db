"""Large patterns as views."""

from __future__ import annotations

from itertools import pairwise

import pytest

from envgraph.graph import Model
from envgraph.match import FREE, CompiledMatcher, ViewMatcher
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar
from envgraph.pattern import Library
from tests.unit.match.writing import path, pattern

METAMODEL = Metamodel("chain", (Class("Cell", features=(Reference("next", "Cell", 0, None),)),))


@pytest.mark.parametrize(("length", "kind"), [(30, "MaterializedView"), (200, "RecomputedRows")])
def test_a_chain_of_constraints_is_kept_current(length: int, kind: str) -> None:
    library = Library(METAMODEL)
    chain = [path("Cell.next", f"x{number}", f"x{number + 1}") for number in range(length)]
    library.add(pattern(f"far(x0 : Cell, x{length} : Cell)", chain))
    model = Model(METAMODEL)
    cells = [model.graph.new("Cell") for _ in range(length + 2)]
    following = METAMODEL.references[0]
    for one, other in pairwise(cells):
        model.graph.link(one, following, other)
    matcher = ViewMatcher(model, library)
    matcher.watch("far")
    assert type(matcher.watched_views.network.operators["far"]).__name__ == kind
    assert set(matcher.rows("far", (FREE, FREE))) == {
        (cells[0], cells[length]),
        (cells[1], cells[length + 1]),
    }
    model.graph.unlink(cells[length], following, cells[length + 1])
    assert matcher.rows("far", (FREE, FREE)) == [(cells[0], cells[length])]
    model.graph.unlink(cells[3], following, cells[4])
    assert matcher.count("far", (FREE, FREE)) == 0
    model.graph.link(cells[3], following, cells[4])
    assert matcher.rows("far", (FREE, FREE)) == CompiledMatcher(model, library).rows("far", (FREE, FREE))
    matcher.check_integrity()


@pytest.mark.parametrize("shape", ["chain", "star"])
def test_large_patterns_are_explained_with_actual_rows(shape: str) -> None:
    library = Library(METAMODEL)
    ends = [(f"x{n}" if shape == "chain" else "x0", f"x{n + 1}") for n in range(200)]
    library.add(pattern("large(x0 : Cell, x1 : Cell)", [path("Cell.next", one, other) for one, other in ends]))
    model = Model(METAMODEL)
    cells = [model.graph.new("Cell") for _ in range(3)]
    model.graph.link(cells[0], METAMODEL.references[0], cells[1])
    matcher = CompiledMatcher(model, library)
    assert "actually" in matcher.explain("large")
    why = matcher.why_not("large", {})
    assert (why.match is None) == (shape == "chain")


def test_rows_are_deleted_with_their_last_derivation() -> None:
    metamodel = Metamodel(
        "net",
        (
            Class(
                "Cell",
                features=(Attribute("marked", Scalar.BOOL), Reference("next", "Cell", 0, None)),
            ),
        ),
    )
    (marked,), (following,) = metamodel.attributes, metamodel.references
    library = Library(metamodel)
    library.add(
        pattern(
            "two(a : Cell, m : bool, c : Cell)",
            [path("Cell.marked", "a", "m"), path("Cell.next", "a", "b"), path("Cell.next", "b", "c")],
        )
    )
    model = Model(metamodel)
    cells = [model.graph.new("Cell") for _ in range(16)]
    for one in cells:
        model.graph.set_value(one, marked, True)
        for other in cells:
            model.graph.link(one, following, other)
    views, searched = ViewMatcher(model, library), CompiledMatcher(model, library)
    views.watch("two")
    for value in (None, False, True):
        model.graph.set_value(cells[0], marked, value)
        found = views.rows("two", (FREE, FREE, FREE))
        assert len(found) == 16 * (15 + (value is not None))
        assert sorted(found) == sorted(searched.rows("two", (FREE, FREE, FREE)))  # type: ignore[type-var]
    views.check_integrity()
