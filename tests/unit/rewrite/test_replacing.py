"""Definitions that are removed and replaced."""

from __future__ import annotations

import pytest

from envgraph import Pattern, Rule, Unit
from envgraph.errors import InvalidArgument, ResolutionError
from envgraph.graph import Model
from envgraph.match import Matcher, ViewMatcher
from envgraph.pattern import Derivation
from envgraph.rewrite import Engine
from tests.oracle.naive._naive import NaiveMatcher
from tests.unit.rewrite.graphs import chain, definitions, patterns

SMALL = Pattern("small", "a : Item", "check a.n < 2; Item(a)")
SMALLER = Pattern("small", "a : Item", "check a.n < 1; Item(a)")
NEAR = Pattern("near", "a : Item, b : Item", "Item.next(a, b); find small(a)")
MARK = Rule("mark", "a : Item", lhs="find near(a, _)", modify="set a.label = 'x'".replace("'", '"'))
ALL = Unit("everywhere", body="if find small(_) { all mark; } else { mark; }")
TWICE = Unit("twice", body="everywhere; everywhere")


def made(matcher: type[Matcher] = ViewMatcher, model: Model | None = None) -> Engine:
    engine = Engine(chain(4) if model is None else model, matcher=matcher)
    engine.add(SMALL, NEAR, MARK, ALL, TWICE)
    return engine


def rows(engine: Engine, name: str) -> list[tuple[object, ...]]:
    return sorted(match.row for match in engine.matches(name))


# --- removing


def test_unused_definitions_are_removed() -> None:
    engine = made()
    engine.remove("twice")
    engine.remove("everywhere", "mark")
    assert (engine.rules, engine.units, engine.patterns) == ((), (), ("small", "near"))
    for ask in (engine.exists, engine.apply, engine.run, engine.definition):
        with pytest.raises(InvalidArgument, match="unknown"):
            ask("mark")
    engine.remove("small", "near")
    assert engine.definitions == () and engine.library.names() == ()
    engine.add(SMALLER, NEAR)
    assert rows(engine, "near") == [(0, 1)]


@pytest.mark.parametrize(
    ("names", "users"),
    [
        (["small"], "`small` is used by pattern `near`, unit `everywhere`"),
        (["small", "near"], "`small`, `near` are used by rule `mark`, unit `everywhere`"),
        (["near"], "`near` is used by rule `mark`"),
        (["mark"], "`mark` is used by unit `everywhere`"),
        (["everywhere"], "`everywhere` is used by unit `twice`"),
    ],
)
def test_removal_of_used_definitions_names_the_users(names: list[str], users: str) -> None:
    engine = made()
    with pytest.raises(InvalidArgument, match=f"^{users}: remove these first"):
        engine.remove(*names)
    assert engine.run("twice") and len(engine.definitions) == 5


def test_listeners_event_rules_and_python_rules_are_users() -> None:
    engine = made()
    listener = engine.listen("near", lambda appeared, disappeared: None)
    rule = engine.on("small", appear="twice", name="again", existing=False)

    @engine.rule("small")
    def grow(a):  # type: ignore[no-untyped-def]
        a.n += 1

    with pytest.raises(InvalidArgument, match="`twice` is used by event rule `again`"):
        engine.remove("twice")
    with pytest.raises(InvalidArgument, match="rule `grow`, unit `twice`, a listener of `near`, a listener of `small`"):
        engine.remove("small", "near", "mark", "everywhere")
    with pytest.raises(InvalidArgument, match="`small` is used by rule `grow`"):
        engine.replace(SMALLER)
    engine.remove("grow")
    with pytest.raises(InvalidArgument, match="event rule `again`"):
        engine.replace(SMALLER)
    rule.cancel()
    with pytest.raises(InvalidArgument, match="a listener of `near`"):
        engine.replace(SMALLER)
    engine.unlisten(listener)
    engine.replace(SMALLER)
    assert rows(engine, "near") == [(0, 1)]


def test_a_group_is_removed_as_a_whole() -> None:
    engine = Engine(chain(2))
    engine.add(Derivation("kinds", "retype", ("Item", "Special")), Unit("u", body="kinds.Item.Special"))
    with pytest.raises(InvalidArgument, match="belongs to the group `kinds`: name the whole group"):
        engine.remove("kinds.Item.Special")
    with pytest.raises(InvalidArgument, match="`kinds` is used by unit `u`"):
        engine.remove("kinds")
    engine.replace(Derivation("kinds", "retype", ("Item", "Box", "Special")))
    assert len(engine.rules) == 6 and engine.run("u")
    engine.remove("kinds", "u")
    assert engine.rules == engine.groups == engine.units == ()
    engine.add(Derivation("ops", "operators", ("Item",)))
    engine.remove("ops")
    assert engine.library.names() == ()


def test_python_definitions_are_removed() -> None:
    engine = made()

    @engine.rule("small")
    def grow(a):  # type: ignore[no-untyped-def]
        a.n += 1

    @engine.unit
    def both(engine):  # type: ignore[no-untyped-def]
        engine.apply("grow")

    assert engine.run("both")
    engine.remove("grow")
    with pytest.raises(InvalidArgument, match="unknown"):
        engine.run("both")
    engine.remove("both")
    assert engine.units == ("everywhere", "twice")


# --- replacing


@pytest.mark.parametrize(("matcher", "watched"), [(ViewMatcher, True), (ViewMatcher, False), (NaiveMatcher, False)])
def test_patterns_use_a_replaced_definition(matcher: type[Matcher], watched: bool) -> None:
    engine = made(matcher)
    if watched:
        engine.watch("small", "near", "mark")
    assert engine.run("twice").applications == 4 and rows(engine, "mark") == [(0,), (1,)]
    for number, new in enumerate((SMALLER, SMALL, SMALLER)):
        engine.replace(new)
        count = 1 + number % 2
        assert rows(engine, "small") == rows(engine, "mark") == [(each,) for each in range(count)]
        assert engine.run("twice").applications == 2 * count
        assert engine.exists("near", a=1) is (count == 2)
        assert engine.watched == (("small", "near", "mark#lhs") if watched else ())
        engine.check_integrity()
    engine.model.node(0).n = 5
    assert not engine.exists("mark") and not engine.run("twice")


def test_a_replaced_definition_may_be_of_another_kind_and_have_other_parameters() -> None:
    engine = made()
    engine.add(Rule("relabel", "a : Item", lhs="check a.n > 0", modify="set a.n = 0"))
    engine.replace(Unit("mark", body="alap { relabel }"), Unit("everywhere", body="mark"))
    assert engine.run("twice").applications == 3
    engine.replace(Pattern("near", "a : Item, b : Item, n : int", "Item.next(a, b); Item.n(a, n)"))
    assert engine.first("near").n == 0  # type: ignore[union-attr]


def test_replacements_that_break_users_are_refused() -> None:
    engine = made()
    before = engine.definitions
    with pytest.raises(ResolutionError) as caught:
        engine.replace(Pattern("near", "a : Item", "Item(a)"))
    assert [one.code for one in caught.value.diagnostics] == ["wrong-arity"]
    with pytest.raises(ResolutionError, match="all"):
        engine.replace(Unit("mark", body="alap { twice }"))
    with pytest.raises(ResolutionError):
        engine.replace(SMALLER, SMALLER)
    with pytest.raises(InvalidArgument, match="expected a pattern, rule, unit or derivation, not 3"):
        engine.replace(3)  # type: ignore[arg-type]
    assert engine.definitions == before and engine.run("twice").applications == 4


def test_missing_definitions_are_not_replaced() -> None:
    engine = made()
    engine.add(Rule("treat", "a : Item", lhs="check a.n > 0", modify="set a.n -= 1", package="hospital"))
    before = engine.definitions
    treat = Rule("treat", "a : Item", modify="set a.n = 0")
    with pytest.raises(InvalidArgument) as caught:
        engine.replace(treat, Rule("smal", "a : Item"), SMALLER, Rule("treet", package="hospital"), ALL)
    assert str(caught.value) == (
        '`treat` (give it `package="hospital"`), `smal` (did you mean `small`?), '
        "`hospital.treet` (did you mean `hospital.treat`?) are not defined: use `add` for new definitions"
    )
    with pytest.raises(InvalidArgument, match=r"^`hospital.small` \(leave its package out\) is not defined"):
        engine.replace(Pattern("small", "a : Item", "Item(a)", package="hospital"))
    assert engine.definitions == before
    engine.replace(Rule("treat", "a : Item", modify="set a.n = 0", package="hospital"))
    assert len(engine.definitions) == len(before) and engine.count("treat") == 4


def test_definitions_are_replaced_while_versions_are_held() -> None:
    engine = made()
    engine.watch("near")
    start = engine.commit()
    engine.model.node(0).n = 7
    engine.replace(SMALLER)
    assert rows(engine, "near") == []
    later = engine.commit()
    engine.checkout(start)
    assert rows(engine, "near") == [(0, 1)]
    with engine.transaction():
        engine.replace(SMALL)
        engine.model.node(0).n = 1
        assert rows(engine, "near") == [(0, 1), (1, 2)]
    engine.checkout(later, discard=True)
    assert rows(engine, "near") == [(1, 2)]
    engine.check_integrity()


def test_a_file_is_loaded_again() -> None:
    engine = Engine(chain(3))
    engine.add(
        *patterns("pattern p(a : Item) { Item(a); }"),
        *definitions("rule r { lhs { find p(a); } modify { set a.n = 9; } }"),
    )
    engine.apply("r")
    engine.add(*patterns("pattern q(a : Item) { Item(a); check(a.n < 9); }"))
    engine.replace(*patterns("pattern p(a : Item) { find q(a); }"))
    assert engine.patterns == ("q", "p") and engine.count("r") == 2
    copy = engine.copy()
    assert copy.run("r") and copy.count("q") == 1


def test_unaffected_views_survive_a_replacement() -> None:
    engine = made()
    heard: list[int] = []
    engine.listen("near", lambda appeared, disappeared: heard.append(len(appeared) - len(disappeared)))
    engine.replace(Rule("mark", "a : Item", lhs="", modify="delete a"), Unit("everywhere", body="mark"))
    assert engine.watched == ("near",)
    engine.model.node(0).n = 9
    engine.settle()
    assert heard == [-1]
    engine.check_integrity()
