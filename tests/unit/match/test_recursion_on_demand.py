"""Recursive patterns as a whole, on demand."""

from __future__ import annotations

from itertools import pairwise

import pytest

from envgraph.errors import EvaluationError
from envgraph.graph import Model
from envgraph.match import FREE, CompiledMatcher
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar
from envgraph.pattern import Binary, Comparison, Constant, Constraint, Evaluation, Library
from tests.oracle.naive._naive import NaiveMatcher
from tests.unit.match.writing import find, is_a, neg, path, pattern, v

METAMODEL = Metamodel(
    "hosts", (Class("Host", features=(Reference("next", "Host", 0, None), Attribute("load", Scalar.INT))),)
)


def library() -> Library:
    """Reachability by recursion on the left, and numbers without end."""
    found = Library(METAMODEL)
    more = Evaluation(Binary("+", v("m"), Constant(1)))
    found.add(
        pattern(
            "reach(a : Host, b : Host)",
            [path("Host.next", "a", "b")],
            [find("reach", "a", "c"), path("Host.next", "c", "b")],
        ),
        pattern(
            "endless(a : Host, n : int)",
            [path("Host.load", "a", "n")],
            [find("endless", "a", "m"), Comparison("==", v("n"), more)],
        ),
    )
    return found


def chain(length: int) -> Model:
    """Hosts in a row."""
    model = Model(METAMODEL)
    hosts = [model.graph.new("Host") for _ in range(length)]
    for one, other in pairwise(hosts):
        model.graph.link(one, METAMODEL.references[0], other)
    return model


def test_recursive_rows_of_a_long_chain_are_derived_semi_naively() -> None:
    length = 300
    assert CompiledMatcher(chain(length), library()).count("reach", (FREE, FREE)) == length * (length - 1) // 2


def test_recursive_rows_follow_model_changes() -> None:
    model = chain(6)
    compiled, naive = (kind(model, library()) for kind in (CompiledMatcher, NaiveMatcher))
    for change in (
        lambda: None,
        lambda: model.graph.unlink(2, METAMODEL.references[0], 3),
        lambda: model.graph.new("Host"),
    ):
        change()
        assert compiled.rows("reach", (FREE, FREE)) == naive.rows("reach", (FREE, FREE))


LINEAR = {
    "left": [find("asked", "a", "c"), path("Host.next", "c", "b")],
    "right": [path("Host.next", "a", "c"), find("asked", "c", "b")],
    "both": [find("asked", "a", "c"), find("asked", "c", "b")],
}


@pytest.mark.parametrize("body", LINEAR.values(), ids=LINEAR)
@pytest.mark.parametrize("bound", [(0,), (1,), (0, 1)])
def test_bound_recursive_queries_derive_only_relevant_rows(
    body: list[Constraint], bound: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    length = 400
    monkeypatch.setenv("ENVGRAPH_LIMITS", "0.0016")  # 1,600 rows
    patterns = Library(METAMODEL)
    patterns.add(pattern("asked(a : Host, b : Host)", [path("Host.next", "a", "b")], body))
    matcher = CompiledMatcher(chain(length), patterns)
    ends = (0, length - 1)
    arguments = tuple(ends[position] if position in bound else FREE for position in (0, 1))
    assert matcher.count("asked", arguments) == (1 if len(bound) == 2 else length - 1)


@pytest.mark.parametrize("body", LINEAR.values(), ids=LINEAR)
def test_frequently_queried_recursive_rows_are_derived_once(body: list[Constraint]) -> None:
    length = 500
    patterns = Library(METAMODEL)
    apart = [path("Host.load", "b", 1), is_a("Host", "a"), neg(find("asked", "a", "b"))]
    patterns.add(
        pattern("asked(a : Host, b : Host)", [path("Host.next", "a", "b")], body),
        pattern("apart(a : Host)", apart),
    )
    model = chain(length)
    model.graph.set_value(length - 1, METAMODEL.attributes[0], 1)
    matcher = CompiledMatcher(model, patterns)
    assert matcher.rows("apart", (FREE,)) == [(length - 1,)]
    assert matcher._program._recursion._kept < 12 * length


def test_tail_calls_read_only_their_own_rows() -> None:
    metamodel = Metamodel(
        "places",
        (
            Class(
                "Place",
                features=tuple(Reference(name, "Place", 0, None) for name in ("to", "near", "up")),
            ),
        ),
    )
    patterns = Library(metamodel)
    patterns.add(
        pattern(
            "p(a : Place, b : Place)",
            [path("Place.to", "a", "b")],
            [find("p", "a", "c"), path("Place.near", "c", "b")],
            [path("Place.up", "a", "c"), find("q", "c", "b")],
        ),
        pattern(
            "q(a : Place, b : Place)",
            [path("Place.up", "a", "b")],
            [path("Place.near", "a", "c"), find("p", "c", "b")],
        ),
    )
    model = Model(metamodel)
    first, second, third, last = (model.graph.new("Place") for _ in range(4))
    _, near, up = metamodel.references
    model.graph.link(first, near, second)
    model.graph.link(first, up, third)
    model.graph.link(third, near, last)
    compiled, naive = (kind(model, patterns) for kind in (CompiledMatcher, NaiveMatcher))
    assert compiled.rows("q", (first, FREE)) == naive.rows("q", (first, FREE)) == [(first, third)]


def test_recursion_that_computes_numbers_without_end_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ENVGRAPH_LIMITS", "0.001")
    model = chain(1)
    model.graph.set_value(0, METAMODEL.attributes[0], 1)
    with pytest.raises(EvaluationError, match="more than 1,000 matches"):
        CompiledMatcher(model, library()).rows("endless", (FREE, FREE))
