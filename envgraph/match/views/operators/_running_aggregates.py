"""Sums and extremes of values that come and go, each change at the cost of itself; they follow rollbacks exactly."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from heapq import heapify, heappop, heappush
from math import isfinite
from typing import Any, Final

from envgraph.graph import EXCHANGE, SET, Store
from envgraph.match._aggregates import EXACT_INTS, fits, scaled, unscaled

Number = int | float
Change = tuple[Number, int]
"""A value, and how many more of it there are."""

Sums = tuple[int, int, int, int, int]
"""Number of values, of floats, of those that no float adds exactly; the sum of the ints, and that of the floats."""

NOTHING: Final[Sums] = (0, 0, 0, 0, 0)


class Totals:
    """Sum or mean of values, exact however often they change.

    Ints and floats are added apart, floats as whole multiples of the smallest one.

    Args:
        store: whose journal records changes.
        function: sum or avg.
        values: those that are there now.
    """

    __slots__ = ("_function", "_state", "_store")

    def __init__(self, store: Store, function: str, values: Sequence[Number]) -> None:
        self._store = store
        self._function = function
        self._state = {None: _added(NOTHING, [(value, 1) for value in values])}  # a dict for the journal

    def follow(self, changes: Sequence[Change]) -> None:
        """Take some changes in."""
        old = self._state[None]
        if self._store.recording:
            self._store.journal.extend((self._state, None, old, SET))
        self._state[None] = _added(old, changes)

    @property
    def knows(self) -> bool:
        """Whether the value follows from the sums: not of ints beside floats, which are rounded one by one."""
        number, floats, odd, _, _ = self._state[None]
        if not floats:
            return not odd or self._function == "sum"
        return floats == number and not odd

    def value(self) -> Number | None:
        """The sum, or the mean; None when the sum is no finite number, or an int beyond 64 bits."""
        number, floats, _, whole, parts = self._state[None]
        if self._function == "sum" and not floats:
            return whole if fits(whole) else None
        total = unscaled(parts) if floats else float(whole)
        return total if self._function == "sum" or total is None else total / number

    def check(self, values: Sequence[Number]) -> None:
        """Assert that the sums are those of these values."""
        assert self._state[None] == _added(NOTHING, [(value, 1) for value in values])


def _added(sums: Sums, changes: Sequence[Change]) -> Sums:
    number, floats, odd, whole, parts = sums
    for value, times in changes:
        number += times
        if isinstance(value, int):
            whole += times * value
            odd += times * (abs(value) > EXACT_INTS)
        else:
            floats += times
            if isfinite(value):
                parts += times * scaled(value)
            else:
                odd += times
    return number, floats, odd, whole, parts


class Counts(dict[Number, int]):
    """How often each value is there; one that is missing, not at all."""

    __slots__ = ()

    def __missing__(self, value: Number) -> int:
        return 0


class Extremes:
    """Minimum or maximum of values.

    Every value that is there is in a heap, with others that were: those that come to its top are taken out. What is
    taken out and could come back by a rollback is recorded, so that it is put in again.

    Args:
        store: whose journal records changes.
        function: min or max.
        values: those that are there now, at least one.
    """

    __slots__ = ("_counts", "_heap", "_held", "_most", "_sign", "_store")

    def __init__(self, store: Store, function: str, values: Sequence[Number]) -> None:
        self._store = store
        self._sign = 1 if function == "min" else -1
        self._counts = Counts(Counter(values))
        self._heap = [self._sign * value for value in self._counts]
        heapify(self._heap)
        self._held = set(self._heap)
        self._most = 2 * len(self._heap) + 64  # entries before those that are not there are taken out

    knows = True

    def follow(self, changes: Sequence[Change]) -> None:
        """Take some changes in."""
        counts, store = self._counts, self._store
        for value, times in changes:
            old = counts[value]
            if store.recording:
                store.journal.extend((counts, value, old, SET))
            counts[value] = old + times
            if times > 0:
                self.exchange(self._sign * value, None)
        if len(self._heap) > self._most:
            self._shrink()

    def value(self) -> Number:
        """The least or the greatest."""
        heap, counts, sign = self._heap, self._counts, self._sign
        while not counts[sign * heap[0]]:
            self._let_go(heap[0])
            heappop(heap)
        return sign * heap[0]

    def exchange(self, entry: Number, _: None) -> None:
        """Put an entry into the heap, unless it is there; also for the journal, which undoes a removal by it."""
        if entry not in self._held:
            heappush(self._heap, entry)
            self._held.add(entry)  # after an interruption it may be in the heap twice, which does no harm

    def _let_go(self, entry: Number) -> None:
        """An entry is about to leave the heap."""
        if self._store.recording:
            self._store.journal.extend((self, entry, None, EXCHANGE))
        self._held.discard(entry)
        self._counts.pop(self._sign * entry, None)

    def _shrink(self) -> None:
        for value in [value for value, number in self._counts.items() if not number]:
            if self._sign * value in self._held:
                self._let_go(self._sign * value)
            else:
                del self._counts[value]
        self._heap = list(dict.fromkeys(entry for entry in self._heap if entry in self._held))
        heapify(self._heap)
        self._most = 2 * len(self._heap) + 64

    def check(self, values: Sequence[Number]) -> None:
        """Assert that these values are counted, and that each is in the heap."""
        counted: dict[Any, int] = {value: number for value, number in self._counts.items() if number}
        assert counted == Counter(values)
        assert {self._sign * value for value in counted} <= self._held
        assert self._held <= set(self._heap)
