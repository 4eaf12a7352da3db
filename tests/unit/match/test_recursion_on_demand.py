"""Recursive patterns as a whole, on demand."""

from __future__ import annotations

from itertools import pairwise

import pytest

from envgraph.errors import EvaluationError
from envgraph.graph import Model
from envgraph.match import FREE, CompiledMatcher, NaiveMatcher
from envgraph.match.views import _recursive
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar
from envgraph.pattern import Binary, Comparison, Constant, Evaluation, Library
from tests.unit.match.writing import find, path, pattern, v

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
    hosts = [model.new("Host") for _ in range(length)]
    for one, other in pairwise(hosts):
        model.link(one, METAMODEL.references[0], other)
    return model


def test_all_rows_of_a_long_chain_are_derived_from_what_is_new() -> None:
    length = 300
    assert (
        CompiledMatcher(chain(length), library()).count("reach", (FREE, FREE)) == length * (length - 1) // 2
    )


def test_the_rows_follow_the_model() -> None:
    model = chain(6)
    compiled, naive = (kind(model, library()) for kind in (CompiledMatcher, NaiveMatcher))
    for change in (
        lambda: None,
        lambda: model.unlink(2, METAMODEL.references[0], 3),
        lambda: model.new("Host"),
    ):
        change()
        assert compiled.rows("reach", (FREE, FREE)) == naive.rows("reach", (FREE, FREE))


def test_numbers_without_end_are_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_recursive, "MOST_ROWS", 1_000)
    model = chain(1)
    model.set_value(0, METAMODEL.attributes[0], 1)
    with pytest.raises(EvaluationError, match="more than 1,000 matches"):
        CompiledMatcher(model, library()).rows("endless", (FREE, FREE))
