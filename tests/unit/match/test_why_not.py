"""What explains a plan with actual rows, and why a pattern has no match."""

from __future__ import annotations

from itertools import pairwise

import pytest

from envgraph.errors import InvalidArgument
from envgraph.graph import Model
from envgraph.lang import TextFiles, load_workspace
from envgraph.match import FREE, CompiledMatcher, ViewMatcher
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar
from envgraph.pattern import Library, Pattern
from tests.oracle.naive._naive import NaiveMatcher
from tests.unit.match.forest import PATTERNS, forest, library
from tests.unit.match.writing import equal, find, is_a, path, pattern


def test_explain_counts_what_each_step_leaves() -> None:
    text = CompiledMatcher(forest(), library()).explain("startTileFixedLocation")
    steps = [line.strip() for line in text.splitlines() if line.startswith("  ")]
    assert [step.rpartition("actually ")[2] for step in steps[:3]] == ["1)", "1)", "1)"]


def test_explain_counts_for_given_values() -> None:
    model = forest()
    matcher = CompiledMatcher(model, library())
    burning = model.graph.extent("BurningTile")[0]
    neighbours = matcher.rows("neighbour", (burning, FREE))
    text = matcher.explain("neighbour", (0,), (burning,))
    counts = [int(line.rpartition("actually ")[2].rstrip(")")) for line in text.splitlines() if "actually" in line]
    assert sum(counts) == len(neighbours) > 0


def test_explain_of_bound_variables_without_values_has_estimates_only() -> None:
    text = CompiledMatcher(forest(), library()).explain("neighbour", (0,))
    assert "(rows " in text
    assert "actually" not in text


def test_the_deepest_partial_match_and_the_constraint_that_fails() -> None:
    model = forest()
    start = model.nodes("StartTile")[0]
    start.x = 3
    why = CompiledMatcher(model, library()).why_not("startTileFixedLocation", {})
    assert why.match is None
    (failure,) = why.failures
    assert failure.body == 1
    assert failure.found == {"tile": start.id}
    assert failure.objects == ("tile",)
    assert failure.constraint == "Tile.x(tile, 0)"
    assert str(why).splitlines()[1] == f"  body 1: finds tile = #{start.id}; then fails Tile.x(tile, 0)"


def test_class_constraints_fail_without_objects() -> None:
    metamodel = Metamodel("m", (Class("A", features=(Attribute("n", Scalar.INT),)),))
    named = Library(metamodel)
    named.add(pattern("p(a)", [path("A.n", "a", "n")]))
    (failure,) = CompiledMatcher(Model(metamodel), named).why_not("p", {}).failures
    assert failure.constraint == "A(a)"


def test_a_parameter_of_another_type_is_shown_with_its_type() -> None:
    files = {
        "m.metamodel": "metamodel m class Room {} class Ward extends Room { refers Room[0..1] next }",
        "m.query": 'import "m.metamodel"\npattern free(ward : Ward) { neg Ward.next(ward, _); }\n',
        "m.model": 'import "m.metamodel"\nmodel one : m { lobby : Room }\n',
    }
    engine = load_workspace(["m.model", "m.query"], files=TextFiles(files)).engine()
    (failure,) = engine.why_not("free", ward=engine.model["lobby"]).failures
    assert failure.constraint == "ward : Ward"


def test_why_not_lists_the_body_with_the_deepest_match_first() -> None:
    model = forest()
    matcher = CompiledMatcher(model, library())
    corner = next(tile for tile in model.nodes("Tile") if tile.right is None and tile.down is None)
    far = model.nodes("StartTile")[0]
    why = matcher.why_not("neighbour", {0: corner.id, 1: far.id})
    assert [failure.constraint for failure in why.failures].count("") == 0
    assert len(why.failures) == 4


def test_why_not_shows_an_existing_match() -> None:
    model = forest()
    start = model.graph.extent("StartTile")[0]
    why = CompiledMatcher(model, library()).why_not("startTileFixedLocation", {1: start})
    assert why.match is not None
    assert why.match["tile"] == start
    assert "has a match" in str(why)


@pytest.mark.parametrize("name", [each.name for each in PATTERNS])
def test_why_not_says_there_is_no_match_exactly_if_there_is_none(name: str) -> None:
    model, queries = forest(), library()
    matcher, naive = CompiledMatcher(model, queries), NaiveMatcher(model, queries)
    size = len(queries.parameter_types(name))
    found = naive.first(name, (FREE,) * size)
    assert (matcher.why_not(name, {}).match is None) == (found is None)
    # Objects that are of the wrong kinds for almost every place.
    for node in list(model.graph.extent("Agent"))[:1] + list(model.graph.extent("BurningTile"))[:1]:
        why = matcher.why_not(name, {0: node})
        assert (why.match is None) == (not naive.exists(name, (node, *(FREE,) * (size - 1))))
        if why.match is None:
            assert why.failures


def test_why_not_explains_called_patterns() -> None:
    model = forest()
    for cls in ("RoadTile", "VegetationTile"):
        for tile in model.nodes(cls):
            tile.retype("BurningTile")
    matcher = CompiledMatcher(model, library())
    why = matcher.why_not("solvable", {})
    assert why.match is None
    assert "passage+" in why.failures[0].constraint


def test_unknown_positions_are_refused() -> None:
    with pytest.raises(InvalidArgument, match="`bound` contains position 7"):
        CompiledMatcher(forest(), library()).why_not("neighbour", {7: 0})


def test_a_watched_pattern_is_explained_by_what_keeps_it_current() -> None:
    matcher = ViewMatcher(forest(), library())
    matcher.watch("solvable")
    text = matcher.explain("solvable")
    assert text.startswith("solvable is watched")
    assert "closure from 1 source" in text
    assert "def delta(" in text


def test_measured_sizes_change_the_plan_but_not_the_rows() -> None:
    model, queries = forest(), library()
    matcher = CompiledMatcher(model, queries)

    def rows() -> dict[str, list[tuple[object, ...]]]:
        sizes = {name: len(queries.parameter_types(name)) for name in queries.names()}
        return {name: sorted(matcher.rows(name, (FREE,) * size)) for name, size in sizes.items()}

    before, plan = rows(), matcher.explain("fireDensity")
    matcher.analyze()
    assert rows() == before
    assert matcher.explain("fireDensity") != plan


CHAIN = Metamodel("chain", (Class("Link", features=(Reference("next", "Link"),)),))


def chain(*patterns: Pattern) -> tuple[CompiledMatcher, list[int]]:
    """Three objects, each with a link to the next one."""
    model, queries = Model(CHAIN), Library(CHAIN)
    queries.add(*patterns)
    links = [model.create("Link") for _ in range(3)]
    for here, there in pairwise(links):
        here.next = there
    return CompiledMatcher(model, queries), [link.id for link in links]


def test_why_not_explains_recursive_patterns_body_by_body() -> None:
    after = pattern(
        "after(a : Link, b : Link)",
        [path("Link.next", "a", "b")],
        [path("Link.next", "a", "c"), find("after", "c", "b")],
    )
    matcher, (first, second, last) = chain(after)
    why = matcher.why_not("after", {0: second, 1: first})
    assert [(failure.body, failure.constraint) for failure in why.failures] == [
        (2, "find after(c, b)"),
        (1, "Link.next(a, b)"),
    ]
    inner = why.failures[0].inner
    assert inner is not None and inner.given == {"a": last, "b": first}
    loop = pattern("loop(a : Link)", [path("Link.next", "a", "a")], [find("loop", "a")])
    matcher, _ = chain(loop)
    asked = matcher.why_not("loop", {0: 0}).failures
    assert {failure.constraint for failure in asked} == {"Link.next(a, a)", "find loop(a)"}
    assert all(failure.inner is None for failure in asked)


def test_given_values_may_contradict_equalities_of_a_body() -> None:
    same = pattern("same(a : Link, b : Link)", [is_a("Link", "a"), equal("a", "b")])
    matcher, (first, second, _) = chain(same)
    why = matcher.why_not("same", {0: first, 1: second})
    assert [(failure.constraint, failure.found) for failure in why.failures] == [("", {})]
    assert str(why).splitlines()[1] == "  body 1: the given values contradict this body"
