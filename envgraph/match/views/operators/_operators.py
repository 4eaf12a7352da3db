"""Operators of a network of views: each holds one relation, and brings it up to date when it is its turn.

While the functions of its consumers run, a changed tuple is present: it comes, then they run; they run, then it goes.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from envgraph.graph import Store
from envgraph.match.views.operators._sets import Groups, Index, MatchSet, Row, become
from envgraph.match.views.operators._upkeep import changes

Hook = Callable[..., object]


class Operator(ABC):
    """One relation of a network.

    Attributes:
        name: unique in the network.
        added, removing: what the consumers do with a tuple; None without consumers.
    """

    def __init__(self, name: str, store: Store) -> None:
        self.name = name
        self.store = store
        self.added: Hook | None = None
        self.removing: Hook | None = None

    @property
    @abstractmethod
    def pending(self) -> bool:
        """Whether there is anything to process."""

    @abstractmethod
    def process(self) -> None:
        """Work off what is pending; all relations that this one is made of are up to date."""

    @abstractmethod
    def forget(self) -> None:
        """What is pending is void."""

    @abstractmethod
    def fill(self) -> None:
        """Compute the relation from those that it is made of, and tell nobody."""

    @abstractmethod
    def size(self) -> float:
        """Return how many tuples there are."""


class Rows(Operator):
    """A relation whose tuples are kept.

    Attributes:
        rows: the tuples.
        groups: the tuples under the values at some positions, for those who asked.
        listed: whether there are rows; else only groups, because nobody asks for more.
        asked: whether anybody but a closure reads the rows or groups.
    """

    def __init__(self, name: str, store: Store) -> None:
        super().__init__(name, store)
        self.rows = MatchSet(store)
        self.groups: dict[tuple[tuple[int, ...], int | None], Groups] = {}
        self.listed = True
        self.asked = False

    def size(self) -> float:
        if not self.listed:
            return float(sum(map(len, next(iter(self.groups.values())).table.values())))
        return float(len(self.rows))

    def group_table(self, positions: tuple[int, ...]) -> Mapping[Any, Collection[Any]]:
        """The tuples under the values at some positions, for an aggregate."""
        self.asked = True
        return self.group(positions).table

    def unlist(self) -> None:
        """Keep nothing but the groups."""
        self.listed = False
        self.rows.replace([])

    def group(self, positions: tuple[int, ...], item: int | None = None) -> Groups:
        """The tuples, or what they have at one position, under the values at some others; from now on kept."""
        key = (positions, item)
        if key not in self.groups:
            groups = self.groups[key] = Groups(self.store, positions, item)
            groups.fill(self.rows)
        return self.groups[key]

    def appear(self, row: Row) -> None:
        """A tuple comes."""
        self.rows.appear(row)
        for groups in self.groups.values():
            groups.add(row)
        if self.added is not None:
            self.added(*row)

    def vanish(self, row: Row) -> None:
        """A tuple goes."""
        if self.removing is not None:
            self.removing(*row)
        for groups in self.groups.values():
            groups.drop(row)
        self.rows.vanish(row)

    def hold(self, row: Row) -> None:
        """Insert a tuple, and notify nobody."""
        self.rows.appear(row)
        for groups in self.groups.values():
            groups.add(row)

    def set_rows(self, rows: Sequence[Row]) -> None:
        """Hold exactly these tuples, and tell nobody."""
        self.rows.replace(rows if self.listed else [])
        for groups in self.groups.values():
            groups.fill(rows)

    def check(self, rows: Iterable[Row]) -> None:
        """Assert that exactly these tuples are held, and in order everywhere."""
        if not self.listed:
            for groups in self.groups.values():
                groups.check(list(dict.fromkeys(rows)))
            return
        assert set(self.rows) == set(rows), self.name
        assert len(set(self.rows)) == len(self.rows)
        assert self.rows.position == {row: index for index, row in enumerate(self.rows)}
        for positions, index in self.rows.indexes.items():
            assert index.table == Index(positions, self.rows).table
        for groups in self.groups.values():
            groups.check(self.rows)


class View(Rows):
    """The tuples that have a derivation.

    Attributes:
        counts: number of derivations of each tuple; None if none has more than one.
        queue: derivations that have come (True) or gone (False) and wait for the view's turn, flat.
        list_derivations: all derivations, a tuple once for each.
        derive, underive: there is one more derivation of a tuple, or one less.
        work: `derive` and `underive` for the whole queue.
    """

    def __init__(self, name: str, store: Store, counted: bool) -> None:
        super().__init__(name, store)
        self.counts: dict[Row, int] | None = {} if counted else None
        self.queue: list[Any] = []
        self.list_derivations: Callable[[], list[Row]] = list
        self.derive: Callable[[Row], None] = _unmade
        self.underive: Callable[[Row], None] = _unmade
        self.work: Callable[[], None] = _unmade

    @property
    def pending(self) -> bool:
        return bool(self.queue)

    def forget(self) -> None:
        self.queue.clear()

    def make(self, arity: int) -> None:
        """Make the functions that change it, for the consumers and groups that it has now.

        Args:
            arity: values in a row.
        """
        self.derive, self.underive, self.work = changes(self, self.counts, arity)

    def process(self) -> None:
        self.work()

    def fill(self) -> None:
        found = self.list_derivations()
        if self.counts is None:
            self.set_rows(found)
            return
        counts: dict[Row, int] = {}
        for row in found:
            counts[row] = counts.get(row, 0) + 1
        become(self.store, self.counts, counts, 0)
        self.set_rows(list(counts))

    def check_derivations(self) -> None:
        """Assert that tuples and counts are those of a new computation."""
        assert not self.queue
        found = self.list_derivations()
        self.check(found)
        if self.counts is None:
            assert len(found) == len(set(found)), f"{self.name}: a tuple with two derivations"
            return
        counts: dict[Row, int] = {}
        for row in found:
            counts[row] = counts.get(row, 0) + 1
        assert {row: count for row, count in self.counts.items() if count} == counts, self.name


def fill_unrecorded(operator: Operator) -> None:
    """Compute a relation that nobody has asked before: nothing leads back to what it held."""
    with unrecorded(operator.store):
        operator.fill()


@contextmanager
def unrecorded(store: Store) -> Iterator[None]:
    """Nothing that is done in the block can be undone."""
    recording, store.recording = store.recording, False
    try:
        yield
    finally:
        store.recording = recording


def _unmade(*_: object) -> None:
    raise AssertionError("the view is not connected yet")


class Evaluated(Rows):
    """The rows of a pattern that is evaluated anew after every change, for what has no delta.

    Args:
        name: of the pattern.
        store: tells by its revision when there is something to do.
        evaluate: lists the rows.
    """

    def __init__(self, name: str, store: Store, evaluate: Callable[[], Sequence[Row]]) -> None:
        super().__init__(name, store)
        self._evaluate = evaluate
        self._revision = -1

    @property
    def pending(self) -> bool:
        return self._revision != self.store.revision

    def forget(self) -> None:
        self._revision = self.store.revision

    def process(self) -> None:
        self._revision = self.store.revision
        rows = self._evaluate()
        now = dict.fromkeys(rows)
        for row in [row for row in self.rows if row not in now]:
            self.vanish(row)
        known = self.rows.position
        for row in [row for row in rows if row not in known]:
            self.appear(row)

    def fill(self) -> None:
        self._revision = self.store.revision
        self.set_rows(self._evaluate())
