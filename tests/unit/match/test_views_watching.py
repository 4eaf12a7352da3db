"""What it means to watch a pattern: when views are built, planned anew, and used."""

from __future__ import annotations

from itertools import pairwise
from weakref import ref

import pytest

from envgraph.errors import InvalidArgument, TransactionError, TypeMismatch
from envgraph.graph import Model
from envgraph.match import FREE, Row, ViewMatcher
from envgraph.pattern import Library
from tests.oracle.naive._naive import NaiveMatcher
from tests.thresholds import set_thresholds
from tests.unit.match.kinds import watched
from tests.unit.match.people import METAMODEL
from tests.unit.match.writing import check, find, is_a, path, pattern, unequal

KNOWS = pattern("knows(a : Person, b : Person)", [path("Person.knows", "a", "b")])
TWO = pattern("two(a : Person, c : Person)", [find("knows", "a", "b"), find("knows", "b", "c")])
OLDER = pattern("older(a : Person, in n : int)", [path("Person.age", "a", "m"), check("m", ">", "n")])
FREE2 = (FREE, FREE)


def library() -> Library:
    found = Library(METAMODEL)
    found.add(KNOWS, TWO, OLDER)
    return found


def chain(model: Model, length: int) -> list[int]:
    """People each of whom knows the next."""
    knows = model.metamodel.feature("Person", "knows")
    people = [model.graph.new("Person") for _ in range(length)]
    for one, other in pairwise(people):
        model.graph.link(one, knows, other)  # type: ignore[arg-type]
    return people


def test_views_are_replanned_for_grown_models_with_equal_results() -> None:
    model = Model(METAMODEL)
    views = watched(model, library())
    rows: set[Row] = set()

    def changed(appeared: list[Row], disappeared: list[Row]) -> None:
        rows.update(appeared)
        rows.difference_update(disappeared)

    views.listen("two", changed)
    small = views.watched_views.network
    chain(model, 900)
    assert views.count("two", FREE2) == 898
    assert views.watched_views.network is small
    chain(model, 200)
    assert views.count("two", FREE2) == 898 + 198
    assert views.watched_views.network is not small
    large = views.watched_views.network
    model.node(0).knows.append(model.node(5))
    views.listeners.deliver()
    assert rows == set(views.rows("two", FREE2))
    assert (0, 6) in rows
    chain(model, 900)
    assert views.exists("two", FREE2)
    assert views.watched_views.network is large  # not again and again
    views.check_integrity()


def test_views_are_not_replanned_with_open_savepoints_or_versions(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    set_thresholds(monkeypatch, {"least growth of the model": 3})
    model = Model(METAMODEL)
    views = watched(model, library())
    chain(model, 3)
    savepoint = model.graph.history.savepoint()
    before, network = list(views.rows("two", FREE2)), views.watched_views.network
    chain(model, 30)
    assert views.count("two", FREE2) == 29
    assert views.watched_views.network is network
    model.graph.history.rollback(savepoint)
    assert views.rows("two", FREE2) == before
    version = model.commit()
    chain(model, 30)
    assert views.count("two", FREE2) == 29
    assert views.watched_views.network is network
    model.checkout(version, discard=True)
    assert views.rows("two", FREE2) == before
    views.check_integrity()


def test_views_are_replanned_before_a_savepoint_not_after_its_rollback(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    set_thresholds(monkeypatch, {"least growth of the model": 3})
    model = Model(METAMODEL)
    views = watched(model, library())
    chain(model, 30)
    model.node(0).knows.clear()
    model.node(0).knows.append(model.node(1))  # last in the order of the links, first in that of the objects
    savepoint, network = model.graph.history.savepoint(), views.watched_views.network
    before = list(views.rows("two", FREE2))
    model.graph.history.rollback(savepoint)
    assert views.rows("two", FREE2) == before
    assert views.watched_views.network is network
    views.check_integrity()


def test_watching_is_refused_with_open_savepoints_or_versions() -> None:
    model = Model(METAMODEL)
    views = ViewMatcher(model, library())
    with model.transaction(), pytest.raises(TransactionError, match="inside a transaction"):
        views.watch("two")
    version = model.commit()
    with pytest.raises(TransactionError, match="while a version exists"):
        views.watch("two")
    views.watch_later("two", "older")
    assert views.watched == ()
    del version
    assert views.watched == ("two",)
    with pytest.raises(InvalidArgument, match="its parameter `n` always needs a value"):
        views.watch("older")
    with pytest.raises(InvalidArgument, match="unknown pattern"):
        views.watch("twice")


def test_an_unwatched_pattern_is_searched_for_even_after_a_rollback() -> None:
    model = Model(METAMODEL)
    views = watched(model, library())
    chain(model, 4)
    savepoint = model.graph.history.savepoint()
    chain(model, 4)
    views.unwatch("two")
    chain(model, 4)
    assert views.count("two", FREE2) == 6
    model.graph.history.rollback(savepoint)
    assert views.count("two", FREE2) == 2
    views.unwatch("knows")
    assert views.watched == ()
    chain(model, 4)
    assert views.count("two", FREE2) == 4
    views.watch("two")
    chain(model, 4)
    assert sorted(views.rows("two", FREE2)) == NaiveMatcher(model, views.library).rows("two", FREE2)
    views.check_integrity()


def test_a_pattern_with_a_listener_stays_watched() -> None:
    model = Model(METAMODEL)
    views = ViewMatcher(model, library())
    subscription = views.listen("two", lambda appeared, disappeared: None)
    with pytest.raises(InvalidArgument, match="`two` has listeners"):
        views.unwatch("two")
    views.listeners.remove(subscription)
    views.listeners.remove(subscription)
    views.unwatch("two")
    assert views.watched == ()


def test_loads_and_checkouts_are_notified_to_listeners() -> None:
    model = Model(METAMODEL)
    views = ViewMatcher(model, library())
    told: list[tuple[str, int, int]] = []
    views.listen(
        "knows",
        lambda appeared, disappeared: told.append(("changed", len(appeared), len(disappeared))),
        lambda appeared, disappeared: told.append(("restored", len(appeared), len(disappeared))),
    )
    with model.loading():
        chain(model, 4)
    assert told == []
    views.listeners.deliver()
    first = model.commit()
    with model.transaction():
        chain(model, 3)
    second = model.commit()
    model.checkout(first)
    model.checkout(second)
    assert told == [("changed", 3, 0), ("changed", 2, 0), ("restored", 0, 2), ("restored", 2, 0)]


def test_only_one_matcher_of_a_model_watches() -> None:
    model = Model(METAMODEL)
    first, second = watched(model, library()), ViewMatcher(model, library())
    chain(model, 3)
    second.unwatch("two")
    chain(model, 3)
    assert first.count("two", FREE2) == 2
    first.check_integrity()
    message = r"another engine of model 'model' watches patterns, .*: `unwatch` `knows`, `two` there"
    with pytest.raises(InvalidArgument, match=message):
        second.watch("two")
    assert (first.watched, second.watched) == (("knows", "two"), ())
    chain(model, 3)
    assert first.count("two", FREE2) == second.count("two", FREE2) == 3
    first.unwatch(*first.watched)
    second.listen("two", lambda appeared, disappeared: None)
    with pytest.raises(InvalidArgument, match="another engine of model 'model' has listeners"):
        first.watch("two")
    chain(model, 3)
    second.check_integrity()
    first.watch_later("two")
    assert first.count("two", FREE2) == second.count("two", FREE2) == 4
    assert first.watched == ()


def test_views_of_unused_matchers_are_released() -> None:
    class User:
        pass

    model, user = Model(METAMODEL), User()
    first, second = watched(model, library()), ViewMatcher(model, library())
    first.watched_views.user = ref(user)
    with pytest.raises(InvalidArgument, match="another engine"):
        second.watch("two")
    del user
    second.watch("two")
    chain(model, 3)
    assert (first.watched, second.watched) == ((), ("two",))
    assert first.count("two", FREE2) == second.count("two", FREE2) == 1
    second.check_integrity()


def test_a_log_of_changes_outside_of_transactions_is_bounded() -> None:
    model = Model(METAMODEL)
    views, told = ViewMatcher(model, library()), list[tuple[object, object]]()
    views.listen("knows", lambda *changes: told.append(changes))
    one, two, three = map(model.node, chain(model, 3))
    log = views.watched_views.views["knows"].rows.log
    for _ in range(5_000):
        one.knows.remove(two)
        one.knows.append(two)
    one.knows.remove(two)
    assert log is not None and len(log) < 2_000
    views.listeners.deliver()
    assert told == [([(two.id, three.id)], [])]


def test_partly_bound_counts_of_a_watched_pattern_are_those_of_a_search() -> None:
    model = Model(METAMODEL)
    views = watched(model, library())
    for size in (3, 40):
        nodes = list(map(model.node, chain(model, size)))
        for turn in range(2):
            for node in nodes:
                for arguments in ((node.id, FREE), (FREE, node.id)):
                    expected = views.demand.count("two", arguments)
                    assert views.count("two", arguments) == expected
                    assert views.exists("two", arguments) is (expected > 0)
            nodes[turn].knows.remove(nodes[turn + 1])
    gone = nodes[5].id
    model.graph.delete(gone, semantics="spo")
    for _ in range(2):
        assert views.count("two", (gone, FREE)) == 0 and not views.exists("two", (FREE, gone))
    with pytest.raises(TypeMismatch):
        views.count("two", ("a", FREE))
    with pytest.raises(InvalidArgument, match="takes 2 arguments"):
        views.count("two", (FREE, FREE, 1))


def test_a_load_that_fails_or_ends_without_views_leaves_none_suspended() -> None:
    model = Model(METAMODEL)
    views = watched(model, library())
    with pytest.raises(RuntimeError, match="no more"), model.loading():
        chain(model, 3)
        raise RuntimeError("no more")
    assert views.count("two", FREE2) == 1
    views.check_integrity()
    with model.loading():
        views.unwatch("knows", "two")
        chain(model, 3)
    views.watch("two")
    chain(model, 3)
    assert views.count("two", FREE2) == 3
    assert len(views.watched_views.views["two"].rows) == 3


def test_rows_inserted_and_deleted_in_one_transaction_are_not_notified() -> None:
    model = Model(METAMODEL)
    views = ViewMatcher(model, library())
    told: list[tuple[list[Row], list[Row]]] = []
    a, b, c = chain(model, 3)
    views.listen("knows", lambda *change: told.append(change))
    with model.transaction():
        model.node(a).knows.remove(model.node(b))
        model.node(a).knows.append(model.node(c))
        model.node(a).knows.append(model.node(b))
    assert told == [([(a, c)], [])]
    with model.transaction():
        model.node(a).knows.remove(model.node(c))
        model.node(a).knows.append(model.node(c))
    assert len(told) == 1


def test_parts_without_parameters_may_have_unconnected_loops() -> None:
    model, patterns = Model(METAMODEL), Library(METAMODEL)
    apart = [is_a("Person", "a"), is_a("Person", "b"), is_a("Person", "c"), unequal("b", "c")]
    patterns.add(pattern("apart(a : Person)", apart))
    views = watched(model, patterns)
    model.create("Person")
    assert views.count("apart", (FREE,)) == 0
    model.create("Person")
    assert views.count("apart", (FREE,)) == 2
