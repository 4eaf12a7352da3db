"""Exceptions in the middle: in a listener, and while views are brought up to date."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import product
from typing import Any

import pytest

from envgraph.graph import Model
from envgraph.match import FREE, Row, ViewMatcher
from envgraph.match.views.operators._row_set import RowLog
from envgraph.pattern import Library
from tests.oracle.naive._naive import NaiveMatcher
from tests.profile import NIGHTLY
from tests.unit.match.kinds import watched
from tests.unit.match.people import METAMODEL
from tests.unit.match.writing import equal, find, fold, is_a, neg, path, pattern

PATTERNS = (
    pattern("knows(a : Person, b : Person)", [path("Person.knows", "a", "b")]),
    pattern("two(a : Person, c : Person)", [find("knows", "a", "b"), find("knows", "b", "c")]),
    pattern("reaches(a : Person, b : Person)", [find("two+", "a", "b")]),
    pattern("lonely(a : Person)", [is_a("Person", "a"), neg(find("reaches", "a", "_"))]),
    pattern("fans(a : Person, n : int)", [is_a("Person", "a"), equal("n", fold("count", find("two", "_", "a")))]),
)


class Interrupted(BaseException):
    """Like KeyboardInterrupt: nobody catches it."""


class Fuse(RowLog):
    """A log that raises when it is written for a certain time."""

    def __init__(self, length: int) -> None:
        super().__init__()
        self.length = length

    def extend(self, items: Iterable[Any]) -> None:
        """As for a list."""
        self.length -= 1
        if self.length < 0:
            raise Interrupted
        super().extend(items)


class Crowd:
    """Four people, and views of who knows whom; four fan out from one who knows all."""

    def __init__(self) -> None:
        self.model = Model(METAMODEL)
        self.library = Library(METAMODEL)
        self.library.add(*PATTERNS)
        self.people = [self.model.graph.new("Person") for _ in range(4)]
        self.knows = self.model.metamodel.feature("Person", "knows")
        self.views = watched(self.model, self.library)
        self.link(0, 1)
        self.link(1, 2)

    def link(self, source: int, target: int) -> None:
        """Two people meet."""
        self.model.graph.link(self.people[source], self.knows, self.people[target])  # type: ignore[arg-type]

    def unlink(self, source: int, target: int) -> None:
        """Two people part."""
        self.model.graph.unlink(self.people[source], self.knows, self.people[target])  # type: ignore[arg-type]

    def meet(self) -> None:
        """Several meet and part at once."""
        for source, target in ((2, 0), (3, 3), (2, 3), (0, 2)):
            self.link(source, target)
        self.unlink(0, 1)

    def order(self) -> dict[str, list[Row]]:
        """All rows as they are listed."""
        return {name: list(self.views.rows(name, free(self, name))) for name in self.library_names}

    @property
    def library_names(self) -> list[str]:
        """Names of the patterns."""
        return [each.name for each in PATTERNS]

    def light(self, pattern: str, length: int) -> None:
        """From now on the view raises when so many rows have come or gone."""
        rows_of(self.views, pattern).log = Fuse(length)

    def quench(self) -> None:
        """No view raises any more."""
        for name in self.library_names:
            rows_of(self.views, name).log = None

    def assert_right(self) -> None:
        """Answers are what the naive matcher says, whether views are up to date or not."""
        naive = NaiveMatcher(self.model, self.library)
        for name in self.library_names:
            given = free(self, name)
            assert sorted(self.views.rows(name, given)) == naive.rows(name, given), name
            assert self.views.count(name, given) == naive.count(name, given)
            assert all(self.views.exists(name, row) for row in naive.rows(name, given))


def free(crowd: Crowd, name: str) -> Row:
    return (FREE,) * len(crowd.library.parameter_types(name))


def rows_of(views: ViewMatcher, pattern: str) -> Any:
    return views.watched_views.views[pattern].rows


FUSES = list(product(["two", "reaches", "lonely", "fans"], [0, 1, 3] if NIGHTLY else [1]))


def explode(crowd: Crowd, fuse: tuple[str, int], *changes: Callable[[], object]) -> bool:
    """Make changes that may be interrupted; whether they were."""
    crowd.light(*fuse)
    try:
        for change in changes:
            change()
    except Interrupted:
        return True
    finally:
        crowd.quench()
    return False


@pytest.mark.parametrize("fuse", FUSES, ids=str)
def test_a_rollback_repairs_views_that_were_interrupted(fuse: tuple[str, int]) -> None:
    crowd = Crowd()
    before = crowd.order()
    savepoint = crowd.model.graph.history.savepoint()
    explode(crowd, fuse, crowd.meet, crowd.order)
    crowd.assert_right()
    crowd.model.graph.history.rollback(savepoint)
    assert crowd.order() == before
    crowd.views.check_integrity()
    crowd.meet()
    crowd.assert_right()
    crowd.views.check_integrity()


def test_injected_exceptions_are_raised() -> None:
    """Else the tests here would test nothing."""
    burnt = 0
    for fuse in FUSES:
        crowd = Crowd()
        with crowd.model.transaction():
            burnt += explode(crowd, fuse, crowd.meet, crowd.order)
    assert burnt >= 3 * len(FUSES) // 4


@pytest.mark.parametrize("fuse", FUSES, ids=str)
def test_interrupted_savepoints_are_not_open(fuse: tuple[str, int]) -> None:
    crowd = Crowd()
    before = crowd.order()
    outer = crowd.model.graph.history.savepoint()
    exploded = explode(crowd, fuse, crowd.meet, crowd.model.graph.history.savepoint)
    if not exploded:
        return
    crowd.assert_right()
    crowd.model.graph.history.rollback(outer)
    assert crowd.order() == before
    crowd.views.check_integrity()


@pytest.mark.parametrize("fuse", FUSES, ids=str)
def test_a_rollback_of_later_changes_alone_repairs_nothing(fuse: tuple[str, int]) -> None:
    crowd = Crowd()
    before = crowd.order()
    outer = crowd.model.graph.history.savepoint()
    inner = crowd.model.graph.history.savepoint()
    explode(crowd, fuse, crowd.meet, crowd.order)
    crowd.model.graph.history.release(inner)
    later = crowd.model.graph.history.savepoint()
    crowd.link(3, 1)
    crowd.assert_right()
    crowd.model.graph.history.rollback(later)
    crowd.assert_right()
    crowd.model.graph.history.rollback(outer)
    assert crowd.order() == before
    crowd.views.check_integrity()


@pytest.mark.parametrize("fuse", FUSES, ids=str)
def test_versions_with_interrupted_views_are_never_silently_wrong(fuse: tuple[str, int]) -> None:
    crowd = Crowd()
    first = crowd.model.commit()
    before = crowd.order()
    with crowd.model.transaction():
        explode(crowd, fuse, crowd.meet, crowd.order)
    second = crowd.model.commit()
    crowd.assert_right()
    crowd.link(1, 3)
    crowd.assert_right()
    third = crowd.model.commit()
    for version in (first, second, first, third, second, third):
        crowd.model.checkout(version)
        crowd.assert_right()
    crowd.model.checkout(first)
    assert {name: sorted(rows) for name, rows in crowd.order().items()} == {
        name: sorted(rows) for name, rows in before.items()
    }


@pytest.mark.parametrize("fuse", FUSES, ids=str)
def test_an_interrupted_commit_may_be_made_again(fuse: tuple[str, int]) -> None:
    crowd = Crowd()
    first = crowd.model.commit()

    def change() -> None:
        with crowd.model.transaction():
            crowd.meet()

    explode(crowd, fuse, change, crowd.model.commit)
    second = crowd.model.commit()
    for version in (first, second, first, second):
        crowd.model.checkout(version)
        crowd.assert_right()


@pytest.mark.parametrize("fuse", FUSES, ids=str)
def test_interrupted_views_are_rebuilt_without_open_savepoints(
    fuse: tuple[str, int],
) -> None:
    crowd = Crowd()
    with crowd.model.transaction():
        explode(crowd, fuse, crowd.meet, crowd.order)
    crowd.assert_right()
    with crowd.model.loading():
        crowd.link(1, 3)
    crowd.assert_right()
    crowd.views.check_integrity()
    crowd.link(3, 0)
    crowd.assert_right()


# --- listeners


class Refused(Exception):
    """What a listener raises."""


def test_listener_exceptions_leave_views_correct() -> None:
    crowd = Crowd()

    def refuse(appeared: list[Row], disappeared: list[Row]) -> None:
        raise Refused

    crowd.views.listen("two", refuse)
    with pytest.raises(Refused), crowd.model.transaction():
        crowd.meet()
    assert crowd.model.graph.history.savepoint_depth == 0
    crowd.assert_right()
    crowd.views.check_integrity()
    crowd.unlink(3, 3)
    with pytest.raises(Refused):
        crowd.model.commit()
    crowd.assert_right()
    crowd.views.check_integrity()


@pytest.mark.parametrize("raised", [Refused, Interrupted])
def test_listener_exceptions_do_not_stop_other_notifications(raised: type[BaseException]) -> None:
    crowd = Crowd()
    heard: dict[str, list[Row]] = {"two": [], "reaches": []}

    def refuse(appeared: list[Row], disappeared: list[Row]) -> None:
        raise Refused

    def interrupt(appeared: list[Row], disappeared: list[Row]) -> None:
        raise raised

    def hear(name: str) -> Callable[[list[Row], list[Row]], None]:
        return lambda appeared, disappeared: heard[name].extend(appeared)

    crowd.views.listen("two", refuse)
    crowd.views.listen("two", interrupt)
    crowd.views.listen("two", hear("two"))
    crowd.views.listen("reaches", hear("reaches"))
    with pytest.raises(raised), crowd.model.transaction():
        crowd.link(2, 3)
    one, two, three = crowd.people[1:]
    assert heard == {"two": [(one, three)], "reaches": [(one, three)]}, two


def test_changes_by_listeners_are_notified_too() -> None:
    crowd = Crowd()
    heard: list[Row] = []

    def answer(appeared: list[Row], disappeared: list[Row]) -> None:
        heard.extend(appeared)
        for first, second in appeared:
            crowd.model.graph.link(second, crowd.knows, first)  # type: ignore[arg-type]

    crowd.views.listen("knows", answer)
    crowd.link(2, 3)
    crowd.views.listeners.deliver()
    two, three = crowd.people[2:]
    assert heard == [(two, three), (three, two)]
    crowd.assert_right()
    crowd.views.check_integrity()


def test_listeners_are_never_notified_of_partial_changes() -> None:
    crowd = Crowd()
    rows = set(crowd.order()["reaches"])

    def changed(appeared: list[Row], disappeared: list[Row]) -> None:
        rows.update(appeared)
        rows.difference_update(disappeared)

    crowd.views.listen("reaches", changed)
    log = rows_of(crowd.views, "reaches").log
    crowd.light("two", 1)
    with pytest.raises(Interrupted), crowd.model.transaction():
        crowd.meet()
        crowd.order()
    for name in crowd.library_names:
        rows_of(crowd.views, name).log = log if name == "reaches" else None
    with crowd.model.transaction():
        crowd.link(3, 1)
    crowd.views.listeners.deliver()
    assert rows == set(NaiveMatcher(crowd.model, crowd.library).rows("reaches", (FREE, FREE)))


def test_rollbacks_discard_pending_notifications() -> None:
    crowd = Crowd()
    told: list[object] = []
    crowd.views.listen("knows", lambda *change: told.append(change))
    crowd.views.listeners.deliver()
    for _ in range(1_000):
        savepoint = crowd.model.graph.history.savepoint()
        crowd.meet()
        crowd.model.graph.history.rollback(savepoint)
    assert len(rows_of(crowd.views, "knows").log) < 1_000
    crowd.views.listeners.deliver()
    assert told == []
