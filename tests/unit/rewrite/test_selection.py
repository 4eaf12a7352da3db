"""Which of its matches a rule is applied at, as it is said from Python."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator

import pytest

from envgraph.errors import InvalidArgument, RuleError
from envgraph.graph import Model
from envgraph.lang import from_text, to_text
from envgraph.pattern import Binary, Constant, Navigation, Unary, Unit, UnitCall, UnitChoice, Variable
from envgraph.rewrite import Engine, Match, Row
from tests.unit.rewrite.graphs import METAMODEL, chain, engine, snapshot

RULES = """
rule mark(a : Item) { lhs { } modify { set a.label = "marked"; } }
rule cut(a : Item) { lhs { } modify { delete a; } }
rule pair(a : Item, b : Item) { lhs { check a.n < b.n; } modify { set a.n = 9; } }
rule contra { lhs { } forall { lhs { a : Item; b : Item; } modify { set a.label = b.label + b.n; } } }
derive kinds = retype among { Item, Special };
"""
QUERIES = """
pattern small(a : Item) { Item.n(a, n); check(n < 2); }
pattern follows(b : Item, a : Item) { Item.next(a, b); }
pattern above(a : Item, in least : int) { Item.n(a, n); check(n > least); }
pattern other(x : Item) { Item(x); }
"""
N = Navigation(Variable("a"), "n")


def made(length: int = 4) -> Engine:
    return engine(RULES, QUERIES, model=chain(length))


def ids(*applications: object) -> list[object]:
    return [one.match.row[0] for one in applications]  # type: ignore[attr-defined]


def test_the_first_match_is_the_first_of_matches() -> None:
    one = made()
    before = one.matches("mark")[0]
    done = one.apply("mark", choose="first")
    assert done is not None and done.match == before


def test_the_first_match_is_looked_for_and_no_other() -> None:
    one = engine(
        RULES + "unit early { first mark where find above(a, 0); } unit plain { first mark; }",
        QUERIES,
        model=chain(6),
    )
    looked: list[object] = []
    read = one.matcher.prepare_iterator

    def seeker(pattern: str, bound: tuple[int, ...]) -> Callable[..., Iterator[Row]]:
        return lambda *values: (looked.append(row) or row for row in read(pattern, bound)(*values))

    one.matcher.prepare_iterator = seeker  # type: ignore[method-assign]
    first = one.matches("mark")[0].row
    asked: list[object] = []
    one.apply("mark", choose="first")
    one.apply("mark", choose="first", where=lambda match: asked.append(match) or True)
    one.apply("mark", choose="first", a=one.model.node(3))
    assert looked == [first, first, (3,)] and len(asked) == 1
    looked.clear()
    assert one.run("plain") and looked == [first]
    assert one.run("early") and looked == [first, first, (1,)]


def test_where_the_first_match_is_refused_the_next_one_is_taken() -> None:
    rules = "rule drop(a : Item) { lhs { } modify { delete a; } } unit once { first drop; }"
    for run in (lambda one: one.apply("drop", choose="first"), lambda one: one.run("once")):
        one = engine(rules, "", model=chain(4))
        one.model.nodes("Item")[-1].next = None
        one.model.nodes("Item")[-1].prev = None
        left = one.matches("drop")[-1]
        assert run(one)
        assert left not in one.matches("drop") and one.count("drop") == 3


def test_a_random_match_is_drawn_uniformly_by_the_generator_of_the_engine() -> None:
    one = made()
    seen = Counter(ids(one.apply("mark", where="small"))[0] for _ in range(400))
    assert set(seen) == {0, 1} and 150 < seen[0] < 250


def test_a_function_chooses_among_the_matches_or_none() -> None:
    one = made()
    seen: list[list[Match]] = []

    def last(matches: list[Match]) -> Match:
        seen.append(matches)
        return matches[-1]

    assert ids(one.apply("mark", choose=last)) == [3]
    assert seen == [one.matches("mark")]
    assert one.apply("mark", choose=lambda matches: None) is None
    with pytest.raises(InvalidArgument, match="one of the matches passed to it"):
        one.apply("mark", choose=lambda matches: one.matches("cut")[0])


def test_a_query_filters_by_the_variables_that_it_shares_with_the_rule() -> None:
    one = made()
    assert ids(*one.apply_all("mark", where="small")) == [0, 1]
    assert ids(*one.apply_all("mark", where="follows")) == [0, 1, 2]  # `a` of some pair
    assert [done.match.row for done in one.apply_all("pair", where="follows", by=N)] == [
        (2, 3),
        (1, 2),
        (0, 1),
    ]
    with pytest.raises(
        InvalidArgument,
        match="`other` has no parameter that is a variable of `mark`, whose variables are `a`",
    ):
        one.apply("mark", where="other")
    with pytest.raises(InvalidArgument, match="did you mean `small`"):
        one.apply("mark", where="smal")
    with pytest.raises(InvalidArgument, match="`least`"):
        one.apply("mark", where="above")


def test_an_expression_or_a_function_filters() -> None:
    one = made()
    assert ids(*one.apply_all("mark", where=Binary(">", N, Constant(1)))) == [2, 3]
    assert ids(*one.apply_all("mark", where=lambda match: match.a.n == 2)) == [2]
    assert one.apply("mark", where=lambda match: False) is None


def test_the_best_matches_come_first_and_ties_as_they_are() -> None:
    one = made()
    assert ids(one.apply("mark", by=N)) == [3]
    assert ids(one.apply("mark", by=lambda match: -match.a.n)) == [0]
    assert ids(*one.apply_all("mark", by=Unary("-", N))) == [0, 1, 2, 3]
    assert ids(*one.apply_all("mark", by=N, top=2)) == [3, 2]
    assert ids(*one.apply_all("mark", by=lambda match: 0, top=3)) == [0, 1, 2]
    nowhere = Navigation(Navigation(Variable("a"), "next"), "n")
    assert ids(*one.apply_all("mark", by=nowhere)) == [2, 1, 0]


def test_apply_all_checks_each_match_again_and_leaves_out_what_is_refused() -> None:
    one = made(3)
    assert [done.match.row for done in one.apply_all("pair", by=N)] == [(1, 2), (0, 1)]
    two = made(3)
    two.model.create("Item", n=7)
    assert ids(*two.apply_all("cut")) == [3]  # the others are linked
    with two.recording() as trace:
        two.apply_all("mark", a=1)
        two.apply_all("mark", where="small", by=N, top=1)
    assert trace == [("mark", (1,)), ("mark", (1,))]


def test_conflicts_roll_back_the_whole_application() -> None:
    one = made(3)
    before = snapshot(one.model)
    with pytest.raises(RuleError, match="two values"):
        one.apply_all("contra")
    assert snapshot(one.model) == before


def test_arguments_and_selection_go_together() -> None:
    one = made()
    assert one.apply("pair", a=0, by=Navigation(Variable("b"), "n")).match.row == (0, 3)  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"choose": "best"}, '`choose` must be "random", "first" or a function'),
        ({"choose": "first", "by": N}, "one of `match`, `choose` and `by`"),
        ({"by": 3}, "expected a function of the match, or an expression of .*, not 3"),
        ({"by": "a.n"}, "not 'a.n': write `lambda match"),
        ({"where": 3}, "expected a function of the match, or an expression of .*, not 3"),
    ],
)
def test_wrong_selections_are_refused(options: dict[str, object], message: str) -> None:
    one = made()
    with pytest.raises(InvalidArgument, match=message):
        one.apply("mark", **options)  # type: ignore[arg-type]
    with pytest.raises(InvalidArgument, match="a group, not a rule"):
        one.apply("kinds", choose="first")
    with pytest.raises(InvalidArgument, match="one of `match`"):
        one.apply("mark", one.matches("mark")[0], choose="first")
    with pytest.raises(InvalidArgument, match="`top` is 0, but must be a whole number from 1"):
        one.apply_all("mark", by=N, top=0)
    with pytest.raises(InvalidArgument, match="`top` needs `by`"):
        one.apply_all("mark", top=2)


def test_units_made_in_python_choose_like_those_of_a_file() -> None:
    one = engine(RULES, QUERIES, model=chain(4))
    best = UnitCall("mark", every=True, limit=2, by=N)
    one.add(Unit("best", (), UnitChoice((best,))))
    assert one.run("best").firings == (("mark", (3,)), ("mark", (2,)))
    wrong = {
        "missing-by": UnitCall("mark", every=True, limit=2),
        "missing-top": UnitCall("mark", by=N),
        "wrong-selection": UnitCall("mark", every=True, first=True),
        "bad-bounds": UnitCall("mark", every=True, limit=0, by=N),
    }
    for code, call in wrong.items():
        assert [problem.code for problem in one.check(Unit("u", (), call))] == [code]
    assert Model(METAMODEL).metamodel is one.model.metamodel


def test_choices_among_matches_are_printed_as_they_are_read() -> None:
    text = """\
unit u(a : Item) {
    first up;
    all up where find big(a), neg find linked(a, _) by -a.n * 2;
    top 2 up(a) where check(a.n > 1) by a.n + 1 | ^first | ^top;
    first first;
}
"""
    assert to_text(*from_text(text)) == text
