"""`engine.listen`: what appears, disappears and is updated, as matches."""

from __future__ import annotations

from typing import Any

import pytest

from envgraph.errors import InvalidArgument
from envgraph.rewrite import Engine, Match
from tests.unit.rewrite.graphs import chain, engine

QUERIES = """
pattern number(x : Item, n : int) { Item.n(x, n); }
pattern follows(x : Item, y : Item) { Item.next(x, y); }
"""
RULES = "rule add(x : Item, k : int) { lhs { x; } modify { set x.n += k; } }"


class Told(list[Any]):
    """What listeners were told, objects as ids."""

    def changed(self, appeared: list[Match], disappeared: list[Match]) -> None:
        self.append(([one.row for one in appeared], [one.row for one in disappeared]))

    def updated(self, pairs: list[tuple[Match, Match]]) -> None:
        self.append([(before.row, after.row) for before, after in pairs])

    def restored(self, appeared: list[Match], disappeared: list[Match]) -> None:
        self.append("restored")

    def take(self) -> list[Any]:
        found = list(self)
        self.clear()
        return found


def items() -> Engine:
    return engine(RULES, QUERIES, model=chain(3))


def test_updates_are_distinguished_from_appearances_and_disappearances() -> None:
    made, told = items(), Told()
    made.listen("number", told.changed, updated=told.updated)
    with made.transaction():
        made.apply("add", x=0, k=5)
        made.model.graph.delete(made.model.node(2).id, semantics="spo")
        made.model.create("Item", n=7)
    assert told.take() == [[((0, 0), (0, 5))], ([(3, 7)], [(2, 2)])]
    made.apply("add", x=1, k=1)
    assert told.take() == [[((1, 1), (1, 2))]]
    made.model.create("Item")
    made.settle()
    assert told.take() == [([(4, 0)], [])]


def test_reverted_changes_are_not_updates() -> None:
    made, told = items(), Told()
    made.listen("number", told.changed, updated=told.updated)
    with made.transaction():
        made.apply("add", x=0, k=5)
        made.apply("add", x=0, k=-5)
    assert told == []


def test_updates_are_disappearance_and_appearance_without_a_function() -> None:
    made, told = items(), Told()
    made.listen("number", told.changed)
    made.apply("add", x=0, k=5)
    assert told == [([(0, 5)], [(0, 0)])]


def test_keys_pair_the_matches_of_an_update() -> None:
    made, told = items(), Told()
    made.listen("follows", told.changed, updated=told.updated, key=("x",))
    with made.transaction():
        made.model.node(0).next = made.model.node(2)
    assert told == [[((0, 1), (0, 2))], ([], [(1, 2)])]


def test_checkouts_are_notified_as_updates_without_a_checkout_function() -> None:
    made, told = items(), Told()
    made.listen("number", told.changed, updated=told.updated)
    made.listen("number", told.changed, told.restored, updated=told.updated)
    start = made.commit()
    made.apply("add", x=0, k=5)
    later = made.commit()
    assert told.take() == [[((0, 0), (0, 5))]] * 2
    made.checkout(start)
    assert told.take() == [[((0, 5), (0, 0))], "restored"]
    made.checkout(later)


def test_appearances_are_notified_even_if_the_update_function_raises() -> None:
    made, told = items(), Told()

    def broken(pairs: list[tuple[Match, Match]]) -> None:
        raise ZeroDivisionError("mine")

    made.listen("number", told.changed, updated=broken)
    with pytest.raises(ZeroDivisionError, match="mine"), made.transaction():
        made.apply("add", x=0, k=5)
        made.model.create("Item", n=9)
    assert told == [([(3, 9)], [])]


def test_arguments_that_are_none_are_refused() -> None:
    made = items()
    with pytest.raises(InvalidArgument, match="a listener must be a function, not 3"):
        made.listen("number", print, updated=3)  # type: ignore[arg-type]
    with pytest.raises(InvalidArgument, match="`key` has no effect without `updated`"):
        made.listen("number", print, key=("x",))
    with pytest.raises(InvalidArgument, match="the key of `follows` contains all variables"):
        made.listen("follows", print, updated=print)
    with pytest.raises(InvalidArgument, match="`number` has no variable `y`"):
        made.listen("number", print, updated=print, key=("y",))
    assert made.watched == ()
    with pytest.raises(InvalidArgument, match="`version` is None, but must be a version"):
        made.checkout(None)  # type: ignore[arg-type]


def test_a_second_engine_of_a_model_does_not_watch_while_the_first_does() -> None:
    made = items()
    made.watch("number")
    other = Engine(made.model)
    other.add(*made.definitions)
    with pytest.raises(InvalidArgument, match=r"another engine of model .* watches patterns, .* `unwatch` `number`"):
        other.watch("follows")
    assert other.count("number") == made.count("number") == 3
    del made
    other.watch("follows")
    assert other.watched == ("follows",)
