"""What nothing connects is combined with everything: that ends at a limit, not in memory."""

from __future__ import annotations

from itertools import combinations

import pytest

from envgraph.errors import EvaluationError
from envgraph.graph import Model
from envgraph.match import FREE, CompiledMatcher, Matcher, ViewMatcher
from envgraph.pattern import Library
from tests.unit.match.people import METAMODEL
from tests.unit.match.writing import is_a, path, pattern, unequal

NAMES = [f"v{number}" for number in range(14)]
PATTERNS = (
    pattern(f"all({', '.join(f'{name} : Person' for name in NAMES)})", [is_a("Person", name) for name in NAMES]),
    pattern("pairs(a : Person, b : Person)", [is_a("Person", "a"), is_a("Person", "b")]),
    pattern("knows(a : Person, b : Person)", [path("Person.knows", "a", "b")]),
    pattern("same(a : Person, b : Person)", [path("Person.age", "a", "n"), path("Person.age", "b", "n")]),
)


def matcher(kind: type[CompiledMatcher] | type[ViewMatcher], people: int) -> Matcher:
    model, library = Model(METAMODEL), Library(METAMODEL)
    library.add(*PATTERNS)
    for _ in range(people):
        model.graph.new("Person")
    return kind(model, library)


def free(size: int) -> tuple[object, ...]:
    return (FREE,) * size


@pytest.mark.parametrize("question", ["rows", "count"])
def test_unconnected_objects_exceed_the_match_limit(question: str) -> None:
    asked = matcher(CompiledMatcher, 10)
    with pytest.raises(
        EvaluationError, match="`all` has more than 1,000,000 combinations of objects: nothing connects `v"
    ) as caught:
        getattr(asked, question)("all", free(14))
    assert caught.value.hint is not None and "ENVGRAPH_LIMITS=10" in caught.value.hint
    assert asked.exists("all", free(14)) and asked.first("all", free(14)) == (0,) * 14


def test_the_environment_variable_raises_the_match_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ENVGRAPH_LIMITS", "0.0001")
    with pytest.raises(EvaluationError, match="more than 100 combinations"):
        matcher(CompiledMatcher, 15).rows("pairs", free(2))
    monkeypatch.setenv("ENVGRAPH_LIMITS", "0.001")
    assert len(matcher(CompiledMatcher, 15).rows("pairs", free(2))) == 225


def test_objects_connected_by_a_link_or_a_value_have_no_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ENVGRAPH_LIMITS", "0.00001")
    asked = matcher(CompiledMatcher, 15)
    assert len(asked.rows("same", free(2))) == 225
    assert "m0" not in asked.source("knows")  # type: ignore[attr-defined]


def test_views_raise_at_the_match_limit_when_built_and_when_updated(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("ENVGRAPH_LIMITS", "0.02")
    with pytest.raises(EvaluationError, match="`all` has more than 20,000 combinations"):
        matcher(ViewMatcher, 3).watch("all")  # type: ignore[attr-defined]
    views = matcher(ViewMatcher, 2)
    assert isinstance(views, ViewMatcher)
    views.watch("all", "pairs")
    assert views.count("all", free(14)) == 2**14
    with pytest.raises(EvaluationError, match="`all` has more than 20,000 combinations"):
        views.model.graph.new("Person")
        views.count("all", free(14))
    number = len(views.model.graph.extent("Person"))
    assert views.count("pairs", free(2)) == number**2
    if number == 3:
        views.model.graph.delete(views.model.graph.extent("Person")[-1])
    assert views.count("all", free(14)) == 2**14
    views.check_integrity()


def test_searches_without_matches_stop_at_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ENVGRAPH_LIMITS", "0.002")
    different = [unequal(one, other) for one, other in combinations(NAMES[:8], 2)]
    library = Library(METAMODEL)
    heads = ", ".join(f"{name} : Person" for name in NAMES[:8])
    library.add(pattern(f"eight({heads})", [*(is_a("Person", name) for name in NAMES[:8]), *different]))
    model = Model(METAMODEL)
    for _ in range(7):
        model.graph.new("Person")
    asked = CompiledMatcher(model, library)
    for question in (asked.rows, asked.count, asked.exists, asked.first):
        with pytest.raises(EvaluationError, match="`eight` has more than 2,000 combinations"):
            question("eight", free(8))
    monkeypatch.setenv("ENVGRAPH_LIMITS", "0.02")
    small = CompiledMatcher(model, library)
    for _ in range(10):  # each search begins anew
        assert not small.exists("eight", free(8))


def test_a_plan_is_explained_without_running_it_to_the_end() -> None:
    asked = matcher(CompiledMatcher, 10)
    assert isinstance(asked, CompiledMatcher)
    text = asked.explain("all")
    assert "for     Person(v3)  (rows 6250000)" in text and "actually" not in text
    assert "actually 100)" in asked.explain("pairs")
