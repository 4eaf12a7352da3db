"""Event rules: what fires when, in which order, and what becomes of it when something goes wrong."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from envgraph.errors import EvaluationError, InvalidArgument, RuleError, TransactionError
from envgraph.graph import Model, Node
from envgraph.rewrite import (
    Engine,
    Firing,
    Match,
)
from tests.oracle.naive._naive import NaiveMatcher
from tests.unit.rewrite.graphs import METAMODEL, chain, definitions, engine, snapshot

QUERIES = """
pattern done(x : Item) { Item.done(x, true); }
pattern number(x : Item, n : int) { Item.n(x, n); }
pattern following(left : Item, right : Item) { Item.next(left, right); }
pattern colour(x : Item, c : Colour, n : int) { Item.colour(x, c); Item.n(x, n); }
@FunctionalDependency(forEach = left, determines = right)
pattern head(left : Item, right : Item) { Item.next(left, right); }
pattern counted(x : Item, k : int) { Item(x); k == count find following(x, _); }
search pattern sought(x : Item) { Item(x); }
"""

RULES = """
rule finish(x : Item) { lhs { x; } modify { set x.done = true; } }
rule reset { lhs { x : Item; check x.done == true; } modify { set x.done = false; set x.n += 1; } }
rule grow { lhs { } rhs { b : Item { n = 7 }; } }
rule other(y : Item) { lhs { y; } modify { set y.n = 5; } }
rule add(x : Item, k : int) { lhs { x; } modify { set x.n += k; } }
unit both(x : Item) { finish(x); finish(x); }
unit twice { grow; grow; }
"""


def items(count: int = 2) -> Engine:
    """An engine over a chain of items, none of them done."""
    return engine(RULES, QUERIES, model=chain(count))


class Log(list[str]):
    """What has fired: `event node...`."""

    def job(self, word: str) -> Callable[..., None]:
        def note(match: Match) -> None:
            self.append(" ".join([word, *map(str, match.row)]))

        return note

    def take(self) -> list[str]:
        """What has fired since the last time."""
        found = list(self)
        self.clear()
        return found


# --- appear, disappear, update


def test_an_appearing_match_fires_at_the_end_of_the_outermost_transaction() -> None:
    made, log = items(), Log()
    made.on("done", appear=log.job("+"))
    with made.transaction():
        made.model.node(1).done = True
        with made.transaction():
            made.model.node(0).done = True
        assert log == []
    assert log.take() == ["+ 1", "+ 0"]


def test_rules_and_units_are_transactions_and_other_edits_wait_for_settle_or_commit() -> None:
    made, log = items(3), Log()
    made.on("done", appear=log.job("+"), disappear=log.job("-"))
    made.apply("finish", x=0)
    assert log.take() == ["+ 0"]
    made.run("both", x=1)
    assert log.take() == ["+ 1"]
    made.fire("reset", (1,))
    assert log.take() == ["- 1"]
    made.model.node(2).done = True
    assert log.take() == []
    made.settle()
    assert log.take() == ["+ 2"]
    made.model.node(2).done = False
    made.commit()
    assert log.take() == ["- 2"]
    with made.model.transaction():
        made.model.node(2).done = True
    assert log.take() == ["+ 2"]


def test_only_net_changes_fire_event_rules() -> None:
    made, log = items(), Log()
    made.on("done", appear=log.job("+"), disappear=log.job("-"))
    with made.transaction():
        made.model.node(0).done = True
        made.model.node(0).done = False
    with made.transaction():
        made.model.node(1).done = True
    with made.transaction():
        made.model.node(1).done = False
        made.model.node(1).done = True
    assert log.take() == ["+ 1"]


def test_rolled_back_changes_never_fire() -> None:
    made, log = items(), Log()
    made.on("done", appear=log.job("+"))
    with pytest.raises(ZeroDivisionError), made.transaction():
        made.model.node(0).done = True
        raise ZeroDivisionError
    with made.transaction():
        with pytest.raises(ZeroDivisionError), made.transaction():
            made.model.node(0).done = True
            raise ZeroDivisionError
        made.model.node(1).done = True
    assert log.take() == ["+ 1"]


def test_existing_matches_fire_at_the_first_settle() -> None:
    made, log = items(), Log()
    made.on("following", appear=log.job("+"))
    assert log == [] and len(made.agenda) == 1
    made.settle()
    assert log.take() == ["+ 0 1"] and len(made.agenda) == 0


def test_existing_matches_can_count_as_handled() -> None:
    made, log = items(), Log()
    made.on("following", appear=log.job("+"), disappear=log.job("-"), existing=False)
    made.settle()
    assert log.take() == []
    made.model.node(0).next = None
    made.settle()
    assert log.take() == ["- 0 1"]


def test_a_disappearance_fires_only_if_the_appearance_did() -> None:
    made, log = items(), Log()
    made.on("following", appear=log.job("+"), disappear=log.job("-"))
    made.on("following", disappear=log.job("bare -"))
    made.model.node(0).next = None
    assert len(made.agenda) == 1  # not told yet
    made.settle()
    assert log.take() == ["bare - 0 1"]


def test_an_update_replaces_a_match_by_one_with_the_same_objects() -> None:
    made, log = items(), Log()

    def updated(x: Node, n: int, old: Match) -> None:
        log.append(f"{x.id}: {old['n']} -> {n}")

    made.on("number", appear=log.job("+"), disappear=log.job("-"), update=updated, existing=False)
    with made.transaction():
        made.model.node(1).n = 7
        made.model.node(1).n = 8
        made.model.create("Item", n=9)
        made.model.graph.delete(0, "spo")
    assert log.take() == ["- 0 0", "1: 1 -> 8", "+ 2 9"]


def test_changed_matches_disappear_and_appear_without_an_update_job() -> None:
    made, log = items(), Log()
    made.on("number", appear=log.job("+"), disappear=log.job("-"), existing=False)
    made.model.node(1).n = 7
    made.settle()
    assert log.take() == ["- 1 1", "+ 1 7"]


def test_the_key_of_an_update_can_be_given() -> None:
    made, log = items(), Log()
    made.on("colour", update=log.job("by c"), key=("x", "c"))
    made.on("head", update=log.job("head"))
    made.on("following", update=log.job("by right"), key=["right"], name="f")
    with made.transaction():
        made.model.node(0).n = 7
        made.model.node(1).colour = "blue"
        made.model.node(0).next = made.model.create("Item")
    assert log.take() == ["by c 0 red 7", "head 0 2"]
    made.model.create("Item", next=made.model.node(2))
    assert log.take() == ["by right 3 2"]


def test_several_matches_with_one_key_are_paired_in_order() -> None:
    made, log = engine("", "pattern friend(x : Item, y : Item) { Item.links(x, y); }", model=chain(6)), Log()
    made.model.node(0).links = [made.model.node(1), made.model.node(2)]

    def updated(match: Match, old: Match) -> None:
        log.append(f"{old.row} -> {match.row}")

    made.on("friend", appear=log.job("+"), update=updated, key=("x",), existing=False)
    with made.transaction():
        made.model.node(0).links = [made.model.node(number) for number in (3, 4, 5)]
    assert log.take() == ["(0, 1) -> (0, 3)", "(0, 2) -> (0, 4)", "+ 0 5"]


def test_an_update_of_a_match_that_was_not_handled_is_an_appearance() -> None:
    made, log = items(1), Log()
    made.on("number", appear=log.job("+"), update=log.job("u"))
    made.model.node(0).n = 4
    made.settle()
    assert log.take() == ["+ 0 4"]


# --- what jobs are called with


def test_jobs_receive_the_arguments_that_they_name() -> None:
    made, found = items(), []

    def all_of_it(engine: Engine, right: Node, match: Match, extra: int = 3) -> None:
        found.append((engine is made, right.id, match.definition, match.row, extra))

    made.on("following", appear=all_of_it)
    made.on("following", appear=lambda **match: found.append(sorted(match)))
    made.settle()
    assert found == [(True, 1, "following", (0, 1), 3), ["left", "right"]]


def test_variable_names_take_precedence_over_engine_and_match() -> None:
    made, found = (
        engine("", "pattern p(engine : Item, old : int) { Item.n(engine, old); }", model=chain(1)),
        [],
    )
    made.on("p", update=lambda engine, old: found.append((engine.id, old)))
    made.model.node(0).n = 3
    made.settle()
    assert found == [(0, 3)]


def test_a_deleted_object_has_its_id() -> None:
    made, found = items(1), []
    made.on("number", disappear=lambda x, n: found.append((x.id, repr(x), n)))
    made.model.node(0).delete()
    assert found == []
    made.settle()
    assert found == [(0, "<no object 0>", 0)]


def test_rules_groups_and_units_can_be_jobs() -> None:
    made = items(3)
    made.add(*definitions("derive d = retype among { Item, Special };"))
    made.on("following", appear="finish", key=("left",), name="nothing bound", existing=False)
    made.on("number", update="both")
    made.on("done", appear="twice", priority=-1)
    made.on("done", disappear="d")
    made.model.node(1).n = 9
    made.settle()
    assert made.model.node(1).done and not made.model.node(0).done
    assert len(made.model) == 5
    made.model.node(1).done = False
    made.settle()
    assert made.model.graph.class_of(0) == "Special" or made.count("d.Item.Special") == 4


def test_variables_of_a_rule_are_bound_by_name() -> None:
    made = engine("rule copy { lhs { x : Item; y : Item; } modify { set y.n = x.n; } }", QUERIES, model=chain(2))
    made.on("done", appear="copy")
    made.model.node(1).done = True
    made.settle()
    assert made.model.node(0).n == 1


def test_a_rule_that_does_not_match_does_nothing() -> None:
    made = items(1)
    made.on("number", disappear="other", name="r", existing=False)
    assert made.agenda[:] == []
    rule = made.on("number", disappear="finish")
    made.model.node(0).delete()
    made.settle()
    assert rule.activations == () and len(made.model) == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "pass `appear`, `disappear` or `update`"),
        ({"pattern": "dne", "appear": print}, "did you mean `done`"),
        ({"appear": lambda y: None}, "parameter `y` is not a variable of `done`"),
        ({"appear": lambda old: None}, "parameter `old` is not a variable"),
        ({"appear": "finsh"}, "did you mean `finish`"),
        ({"appear": "add"}, "rule `add` needs `k`, which is no variable of `done`"),
        ({"pattern": "following", "appear": "both"}, "unit `both` needs `x`"),
        ({"appear": 3}, "must be a function or the name of a rule or unit, not 3"),
        ({"update": "reset"}, "the key of `done` contains all variables"),
        ({"pattern": "number", "update": "finish", "key": "x"}, "`key` takes several names"),
        ({"pattern": "number", "update": "finish", "key": ("y",)}, "no variable `y`"),
        ({"pattern": "number", "update": "finish", "key": ("n", "x")}, "contains all variables"),
        ({"pattern": "sought", "appear": "finish"}, "cannot be watched"),
    ],
)
def test_wrong_registrations_are_refused(options: dict[str, object], message: str) -> None:
    made = items()
    with pytest.raises(InvalidArgument, match=message):
        made.on(**{"pattern": "done", **options})  # type: ignore[arg-type]
    made.model.node(0).done = True
    made.settle()
    assert len(made.agenda) == 0


def test_the_naive_matcher_has_no_events() -> None:
    made = Engine(chain(1), matcher=NaiveMatcher)
    with pytest.raises(InvalidArgument, match="cannot watch"):
        made.on("done", appear="finish")
    made.settle()
    assert repr(made.agenda) == "<agenda: 0 to fire>"


def test_registering_event_rules_with_open_savepoints_or_versions_is_refused() -> None:
    made = items()
    version = made.commit()
    with pytest.raises(TransactionError, match="call `watch` before the transaction"):
        made.on("done", appear="finish")
    del version
    with made.transaction(), pytest.raises(TransactionError):
        made.on("done", appear="finish")
    made.on("done", appear="finish")
    assert made.watched == ("done",)


# --- the order


def test_agenda_order_is_priority_registration_arrival() -> None:
    made, log = items(3), Log()
    made.on("done", appear=log.job("low"), priority=-1)
    made.on("done", appear=log.job("first"))
    made.on("following", appear=log.job("second"))
    made.on("number", update=log.job("high"), priority=2)
    made.settle()
    log.clear()
    with made.transaction():
        made.model.node(2).next = made.model.node(0)
        made.model.node(2).done = True
        made.model.node(0).done = True
        made.model.node(1).n = 5
    assert log.take() == ["high 1 5", "first 2", "first 0", "second 2 0", "low 2", "low 0"]


def test_changes_of_a_job_update_the_agenda_before_the_next_job() -> None:
    made, log = items(3), Log()

    def more(x: Node) -> None:
        log.append(f"more {x.id}")
        if x.next is not None:
            x.next.done = True

    made.on("done", appear=more)
    made.on("done", appear=log.job("high"), priority=1)
    made.model.node(0).done = True
    made.settle()
    assert log.take() == ["high 0", "more 0", "high 1", "more 1", "high 2", "more 2"]


def test_event_rules_fire_again_after_a_rollback() -> None:
    made, log = items(6), Log()
    made.on("done", appear=lambda x, engine: (log.append(f"a {x.id}"), engine.apply("reset"))[0])
    made.on("number", update=log.job("u"), priority=1)
    runs = []
    for _ in range(2):
        made.rng = Engine(made.model, seed=3).rng
        with pytest.raises(ZeroDivisionError), made.transaction():
            for number in (3, 1, 5):
                made.model.node(number).done = True
            raise ZeroDivisionError
        start = made.commit()
        with made.transaction():
            for number in (3, 1, 5):
                made.model.node(number).done = True
        runs.append((log.take(), snapshot(made.model)))
        made.checkout(start, discard=True)
    assert runs[0] == runs[1] and len(runs[0][0]) >= 4


# --- withdrawal


def test_activations_of_deleted_matches_are_withdrawn() -> None:
    made, log = items(), Log()
    made.on("done", appear=log.job("late"), disappear=log.job("late -"))
    made.on("done", appear="reset", priority=1, name="undo")
    made.model.node(0).done = True
    made.settle()
    assert log.take() == [] and made.model.node(0).n == 1


def test_a_disappearance_is_withdrawn_if_the_match_is_back() -> None:
    made, log = items(), Log()
    made.on("following", appear=log.job("late +"), disappear=log.job("late -"), existing=False)

    def again(left: Node, right: Node) -> None:
        log.append("again")
        left.next = right

    made.on("following", disappear=again, priority=1, existing=False)
    made.model.node(0).next = None
    made.settle()
    assert log.take() == ["again"]


@pytest.mark.parametrize(
    ("values", "fired"),
    [((5, 6), ["u 0 6 from 0 0"]), ((5, 0), []), ((5, None), ["- 0 0"])],
    ids=["changes on", "is back", "goes"],
)
def test_pending_updates_follow_their_match(values: tuple[int, int | None], fired: list[str]) -> None:
    made, log = items(1), Log()

    def late(match: Match, old: Match) -> None:
        log.append(f"u {match.row[0]} {match.row[1]} from {old.row[0]} {old.row[1]}")

    made.on("number", appear=log.job("+"), disappear=log.job("-"), update=late, existing=False)

    def change(x: Node, n: int) -> None:
        if n == values[0]:
            x.n = values[1]

    made.on("number", update=change, priority=1, existing=False)
    made.model.node(0).n = 5
    made.settle()
    assert log.take() == fired


def test_returning_matches_replace_their_pending_update() -> None:
    made, log = engine("", "pattern friend(x : Item, y : Item) { Item.links(x, y); }", model=chain(3)), Log()
    one, two, three = made.model.nodes()
    one.links = [two]
    made.on("friend", appear=log.job("+"), disappear=log.job("-"), update=log.job("u"), key=("x",), existing=False)

    def both(x: Node) -> None:
        x.links = [two, three]

    made.on("friend", update=both, key=("x",), priority=1, existing=False)
    one.links = [three]
    made.settle()
    assert log.take() == ["+ 0 2"]


# --- errors


def test_a_raising_job_is_rolled_back_and_others_remain_pending() -> None:
    made, log = items(3), Log()

    def broken(x: Node) -> None:
        x.n = 99
        if x.id == 1:
            raise ZeroDivisionError("mine")
        log.append(f"+ {x.id}")

    rule = made.on("done", appear=broken, disappear=log.job("-"), name="fragile")
    with pytest.raises(ZeroDivisionError, match="mine") as caught, made.transaction():
        for number in (0, 1, 2):
            made.model.node(number).done = True
    assert caught.value.__notes__ == [
        "raised by event rule `fragile`, <appear fragile: done(x=<Item#1>)>",
    ]
    assert [node.n for node in made.model.nodes()] == [99, 1, 2]
    assert all(node.done for node in made.model.nodes())
    assert [activation.match.row for activation in rule.activations] == [(2,)]
    made.settle()
    assert log.take() == ["+ 0", "+ 2"]
    with made.transaction():
        for number in (0, 1, 2):
            made.model.node(number).done = False
    assert log.take() == ["- 0", "- 2"]


def test_refused_applications_of_event_rules_are_reported() -> None:
    made = engine("rule drop(x : Item) { lhs { x; } modify { delete x; } }", QUERIES, model=chain(2))
    made.on("done", appear="drop")
    with pytest.raises(RuleError), made.transaction():
        made.model.node(0).done = True
    assert made.model.node(0).done


def test_what_a_rule_has_done_is_recorded_even_if_an_event_rule_raises() -> None:
    made = items()
    made.on("done", appear=lambda x: 1 / 0)
    with made.recording() as trace, pytest.raises(ZeroDivisionError):
        made.apply("finish", x=0)
    assert trace == [Firing("finish", (0,))]
    with made.recording() as trace, pytest.raises(ZeroDivisionError), made.transaction():
        made.apply("finish", x=1)
    assert trace == [Firing("finish", (1,))] and made.model.node(1).done


def test_cycles_of_event_rules_are_detected_and_named() -> None:
    made = items(1)
    made.step_limit = 50

    def flip(x: Node) -> None:
        x.done = False

    def flop(x: Node) -> None:
        x.done = True

    made.on("number", appear="finish", name="once")
    made.on("done", appear=flip)
    made.on("done", disappear=flop)
    with pytest.raises(EvaluationError, match=r"do not terminate: 50 firings, the last ones of `(flip|flop)`, `fl"):
        made.settle()
    assert len(made.agenda) == 1


def test_firings_up_to_the_step_limit_are_allowed() -> None:
    made, log = items(1), Log()
    made.step_limit = 3
    made.on("number", update=lambda x, n: setattr(x, "n", min(n + 1, 12)))
    made.model.node(0).n = 10
    made.settle()
    assert made.model.node(0).n == 12 and log == []


# --- versions


def test_a_checkout_fires_no_event_rules() -> None:
    made, log = items(), Log()
    made.on("done", appear=log.job("+"), disappear=log.job("-"))
    start = made.commit()
    made.apply("finish", x=0)
    done = made.commit()
    assert log.take() == ["+ 0"]
    made.checkout(start)
    made.checkout(done)
    made.settle()
    assert log.take() == []
    made.apply("reset")
    assert log.take() == ["- 0"]
    made.model.node(1).done = True
    made.checkout(start, discard=True)
    made.settle()
    assert log.take() == []


def test_a_checkout_empties_the_conflict_set() -> None:
    made = items()
    made.on("done", appear=lambda x: 1 / 0)
    start = made.commit()
    with pytest.raises(ZeroDivisionError), made.transaction():
        for node in made.model.nodes():
            node.done = True
    assert len(made.agenda) == 1
    made.checkout(start, discard=True)
    assert len(made.agenda) == 0
    made.settle()
    made.check_integrity()


def test_versions_include_changes_of_event_rules() -> None:
    made = items()
    made.on("done", appear=lambda x: setattr(x, "n", 50))
    made.model.node(1).done = True
    version = made.commit()
    assert made.model.version == version and made.model.node(1).n == 50


# --- replay


def test_a_recording_has_the_rules_that_event_rules_apply_and_replays_without_them() -> None:
    made = items(3)
    made.on("done", appear="reset")
    start = made.commit()
    with made.recording() as trace:
        made.apply("finish", x=2)
        with made.transaction():
            made.apply("finish", x=0)
    assert trace == [("finish", (2,)), ("reset", (2,)), ("finish", (0,)), ("reset", (0,))]
    after = snapshot(made.model)
    made.checkout(start, discard=True)
    made.replay(trace)
    assert snapshot(made.model) == after and len(made.agenda) == 0


# --- the handle and the agenda


def test_cancelled_event_rules_do_not_fire() -> None:
    made, log = items(3), Log()
    rule = made.on("done", appear=log.job("+"))
    other = made.on("done", appear=log.job("other"))
    made.model.node(0).done = True
    made.settle()
    rule.cancel()
    rule.cancel()
    made.model.node(1).done = True
    made.settle()
    assert log.take() == ["+ 0", "other 0", "other 1"]
    assert (rule.active, other.active) == (False, True)
    assert repr(rule) == "<event rule note on done, cancelled>"
    other.cancel()
    made.model.node(2).done = True
    made.settle()
    assert log == [] and made.model.graph.store.followers[:] == [made.matcher.watched_views]


def test_event_rules_of_a_with_block_are_cancelled_at_its_end() -> None:
    made, log = items(), Log()
    with made.on("done", appear=log.job("+")) as rule:
        made.apply("finish", x=0)
        assert rule.active
    made.apply("finish", x=1)
    assert log.take() == ["+ 0"]
    with pytest.raises(ZeroDivisionError), made.on("done", appear=log.job("+")) as rule:
        raise ZeroDivisionError
    assert not rule.active and len(made.agenda) == 0


def test_a_job_may_cancel_rules_and_register_others() -> None:
    made, log = items(3), Log()
    made.watch("done", "number")

    def first(x: Node, engine: Engine) -> None:
        log.append(f"first {x.id}")
        rule.cancel()
        with pytest.raises(TransactionError):
            engine.on("following", appear=log.job("never"))
        engine.on("number", appear=log.job("new"))

    rule = made.on("done", appear=first)
    with made.transaction():
        made.model.node(0).done = made.model.node(1).done = True
    assert log.take() == ["first 0", "new 0 0", "new 1 1", "new 2 2"]


def test_the_agenda_lists_pending_activations() -> None:
    made = items(30)
    low = made.on("following", appear="finish", name="low", key=("left",))
    high = made.on("number", appear="reset", update=lambda x: None, priority=3, name="high", existing=False)
    assert len(made.agenda) == 29 and bool(made.agenda)
    first = made.agenda[0]
    assert (first.event, first.rule, first.old) == ("appear", low, None)
    assert repr(first) == "<appear low: following(left=<Item#0>, right=<Item#1>)>"
    assert made.agenda[-1].match.row == (28, 29) and first in made.agenda
    lines = str(made.agenda).splitlines()
    assert lines[0] == "<agenda: 29 to fire>" and lines[-1] == "  and 9 more" and len(lines) == 22
    seen = []
    made.on("done", appear=lambda engine: seen.append([repr(one) for one in engine.agenda]), existing=False)
    assert (high.activations, len(low.activations)) == ((), 29)
    low.cancel()
    with made.transaction():
        made.model.node(4).done = made.model.node(5).done = True
        made.model.node(3).n = 8
    assert seen == [["<appear <lambda>: done(x=<Item#5>)>"], []]


def test_pending_updates_show_the_old_match() -> None:
    made = items(1)
    rule = made.on("number", update=lambda x: None, name="u")
    made.on("number", update=lambda x: 1 / 0, priority=1)
    made.model.node(0).n = 4
    with pytest.raises(ZeroDivisionError):
        made.settle()
    assert [repr(one) for one in rule.activations] == [
        "<update u: number(x=<Item#0>, n=4) from number(x=<Item#0>, n=0)>"
    ]


def test_events_work_beside_listeners() -> None:
    made, log = items(2), Log()

    def told(appeared: list[Match], _: list[Match]) -> None:
        log.append(f"told {[match.row for match in appeared]}")
        for match in appeared:
            made.apply("other", y=match.row[0])

    made.listen("done", told)
    made.on("done", appear=log.job("+"))
    made.on("number", update=log.job("u"), priority=1)
    made.apply("finish", x=1)
    assert log.take() == ["told [(1,)]", "u 1 5", "+ 1"]


def test_loads_fire_event_rules_by_net_change() -> None:
    made, log = items(2), Log()
    made.on("number", appear=log.job("+"), disappear=log.job("-"), existing=False)
    with made.model.loading():
        made.model.create("Item", n=5)
        made.model.node(0).n = 3
    made.settle()
    assert log.take() == ["- 0 0", "+ 0 3", "+ 2 5"]


def test_engines_without_event_rules_are_unaffected() -> None:
    made = engine(RULES, QUERIES, model=Model(METAMODEL))
    assert len(made.agenda) == 0 and list(made.agenda) == []
    made.settle()
    assert made.run("twice") and made.commit() == made.model.version
