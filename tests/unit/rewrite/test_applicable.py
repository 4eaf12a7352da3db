"""Where a rule is applicable: at the matches at which the model does not refuse it."""

from __future__ import annotations

from collections import Counter

import pytest

from envgraph.errors import InvalidArgument, RuleError
from envgraph.graph import Model
from envgraph.pattern import Constant, Navigation, Unary, Variable
from envgraph.rewrite import Engine
from tests.unit.rewrite.graphs import METAMODEL, chain, engine, snapshot

RULES = """
rule cut(a : Item) { lhs { } modify { delete a; } }
rule mark(a : Item) { lhs { } modify { set a.label = "marked"; } }
rule contra { lhs { } forall { lhs { a : Item; b : Item; } modify { set a.label = b.label + b.n; } } }
rule broken(a : Item) { lhs { } modify { set a.n = 1 / a.n; } }
derive kinds = retype among { Item, Special };
unit cuts { cut; }
"""
QUERIES = """
pattern small(a : Item) { Item.n(a, n); check(n < 3); }
pattern any(a : Item) { Item(a); }
"""
N = Navigation(Variable("a"), "n")


def half(seed: int = 0) -> Engine:
    """Items 0 and 1 are linked to each other, so `cut` applies at 2 and 3 alone."""
    model = chain(2)
    model.create("Item", n=2)
    model.create("Item", n=3)
    return engine(RULES, QUERIES, model=model, seed=seed)


def test_refused_matches_are_skipped_and_others_sampled_uniformly() -> None:
    made = half()
    seen: Counter[object] = Counter()
    for _ in range(400):
        savepoint = made.model.graph.history.savepoint()
        done = made.apply("cut")
        assert done is not None
        seen[done.match.row] += 1
        made.model.graph.history.rollback(savepoint)
    assert set(seen) == {(2,), (3,)} and 150 < seen[2,] < 250


def test_apply_samples_matches_like_a_unit() -> None:
    for seed in range(10):
        done, run = half(seed).apply("cut"), half(seed).run("cuts")
        assert done is not None and done.match.row == run.matches[0].row


def test_without_refusals_only_one_match_is_sampled() -> None:
    made = half(7)
    draws = [made.apply("mark").match.row for _ in range(10)]  # type: ignore[union-attr]
    other = half(7)
    assert draws == [(int(other.rng.random() * 4),) for _ in range(10)]


def test_if_all_matches_are_refused_the_error_says_so() -> None:
    made = engine(RULES, QUERIES, model=chain(3))
    before = snapshot(made.model)
    with pytest.raises(RuleError, match="it is refused at each of the 3 matches") as caught:
        made.apply("cut")
    assert caught.value.reason == "dangling" and caught.value.rule == "cut" and caught.value.span is not None
    assert snapshot(made.model) == before
    with pytest.raises(RuleError) as caught:
        made.apply("cut", a=0)
    assert "matches" not in caught.value.message
    with pytest.raises(RuleError):
        made.apply("cut", made.matches("cut")[0])


def test_choices_continue_after_refused_alternatives() -> None:
    assert half().apply("cut", choose="first").match.row == (2,)  # type: ignore[union-attr]
    assert half().apply("cut", where="small").match.row == (2,)  # type: ignore[union-attr]
    assert half().apply("cut", by=Unary("-", N)).match.row == (2,)  # type: ignore[union-attr]
    with pytest.raises(RuleError, match="each of the 2 matches"):
        half().apply("cut", where=lambda match: match.a.n < 2, by=N)
    with pytest.raises(RuleError):  # the one that a function chose is meant
        half().apply("cut", choose=lambda matches: matches[0])


def test_apply_all_skips_only_refused_matches() -> None:
    assert [done.match.row for done in half().apply_all("cut")] == [(2,), (3,)]
    with pytest.raises(RuleError, match="two values"):
        half().apply("contra")
    with pytest.raises(RuleError, match="two values"):
        half().apply_all("contra")


def test_groups_try_other_matches_and_rules_after_refusals() -> None:
    for seed in range(8):
        model = Model(METAMODEL)
        model.create("Item")
        for favourite in (model.create("Item"), None):  # the first cannot become an `Item`
            model.create("Special", favourite=favourite)
        made = engine(RULES, model=model, seed=seed)
        assert made.apply("kinds") is not None
    model = Model(METAMODEL)
    for _ in range(2):
        one = model.create("Special")
        one.favourite = one
    made = engine(RULES, model=model)
    with pytest.raises(RuleError, match="refused at each match of a rule of `kinds`"):
        made.apply("kinds")


def test_the_prepared_rule_skips_refused_matches_too() -> None:
    for seed in range(8):
        made = half(seed)
        assert made.prepare("cut").once(made.rng) in [(2,), (3,)]
    made = engine(RULES, QUERIES, model=chain(3))
    with pytest.raises(RuleError):
        made.prepare("cut").once(made.rng)


# --- questions


def test_queries_include_refused_matches_by_default() -> None:
    made = half()
    assert made.count("cut") == 4 and made.count("cut", applicable=True) == 2
    assert [match.row for match in made.matches("cut", applicable=True)] == [(2,), (3,)]
    assert made.first("cut").row == (0,) and made.first("cut", applicable=True).row == (2,)  # type: ignore[union-attr]
    assert made.exists("cut", a=0) and not made.exists("cut", applicable=True, a=0)
    assert made.exists("cut", applicable=True) and made.first("cut", applicable=True, a=1) is None


def test_applicability_queries_change_nothing() -> None:
    made = half(3)
    made.watch("any")
    heard: list[object] = []
    made.listen("any", lambda appeared, disappeared: heard.append((appeared, disappeared)))
    before, version = snapshot(made.model), made.commit()
    with made.recording() as trace:
        assert made.count("cut", applicable=True) == 2
    made.settle()
    assert (trace, heard, snapshot(made.model)) == ([], [], before)
    assert made.model.version is version
    assert made.rng.random() == half(3).rng.random()


def test_errors_other_than_refusals_are_raised() -> None:
    made = half()
    with pytest.raises(RuleError, match="two values"):
        made.exists("contra", applicable=True)
    with pytest.raises(Exception, match="division by zero"):
        made.exists("broken", applicable=True)
    with pytest.raises(InvalidArgument, match="`any` is a pattern, but `applicable` needs a rule"):
        made.exists("any", applicable=True)
    for ask in (made.matches, made.first, made.exists, made.count):
        for value in (made.model.node(0), 0, None):
            with pytest.raises(InvalidArgument, match=r"not .*; to bind a variable of that name, write `bound="):
                ask("cut", applicable=value)  # type: ignore[arg-type]


def test_a_python_rule_is_applicable_where_its_function_is_not_refused() -> None:
    made = half()

    @made.rule("any")
    def drop(a):  # type: ignore[no-untyped-def]
        a.delete()

    assert made.count("drop", applicable=True) == 2 and len(made.model) == 4
    assert made.apply("drop", by=Constant(1)).match.row == (2,)  # type: ignore[union-attr]
