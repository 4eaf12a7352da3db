"""Sums and extremes that each change of a value updates, without a new computation over all. Rollbacks are exact."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from heapq import heapify, heappop, heappush
from math import isfinite
from typing import Any, Final

from envgraph.graph import ASSIGNED, OVERWRITTEN, Store
from envgraph.match._aggregate_values import EXACT_INTS, fits_int64, float_to_multiple, multiple_to_float

Number = int | float
Change = tuple[Number, int]
"""A value, and the change of its number of occurrences."""

Sums = tuple[int, int, int, int, int]
"""The numbers of values, of floats, and of values without exact float sum; the sums of the ints and of the floats."""

NOTHING: Final[Sums] = (0, 0, 0, 0, 0)


class RunningTotal:
    """A running sum or mean of values, exact after any number of changes.

    Ints and floats are added separately, floats as integer multiples of the smallest float.

    Args:
        store: the store whose journal records changes.
        function: sum or avg.
        values: the initial values.
    """

    __slots__ = ("_function", "_state", "_store")

    def __init__(self, store: Store, function: str, values: Sequence[Number]) -> None:
        self._store = store
        self._function = function
        self._state = {None: _add_changes(NOTHING, [(value, 1) for value in values])}  # a dict for the undo log

    def apply_changes(self, changes: Sequence[Change]) -> None:
        """Update the sums by changes of the numbers of occurrences of values, and journal the old sums."""
        old = self._state[None]
        if self._store.recording:
            self._store.journal.extend((self._state, None, old, ASSIGNED))
        self._state[None] = _add_changes(old, changes)

    @property
    def is_exact(self) -> bool:
        """Return True if `value` is exact. Otherwise the caller must compute the aggregate from all values.

        It is not exact for ints mixed with floats, for infinite or NaN floats, and for the mean of very large ints.
        """
        number, floats, odd, _, _ = self._state[None]
        if not floats:
            return not odd or self._function == "sum"
        return floats == number and not odd

    def value(self) -> Number | None:
        """Return the sum or the mean; None if the sum is not a finite float, or is an int beyond 64 bits."""
        number, floats, _, whole, parts = self._state[None]
        if self._function == "sum" and not floats:
            return whole if fits_int64(whole) else None
        total = multiple_to_float(parts) if floats else float(whole)
        return total if self._function == "sum" or total is None else total / number

    def check(self, values: Sequence[Number]) -> None:
        """Assert that the running sums are the sums of these values."""
        assert self._state[None] == _add_changes(NOTHING, [(value, 1) for value in values])


def _add_changes(sums: Sums, changes: Sequence[Change]) -> Sums:
    """Return the sums after changes of the numbers of occurrences of some values."""
    number, floats, odd, whole, parts = sums
    for value, times in changes:
        number += times
        if isinstance(value, int):
            whole += times * value
            odd += times * (abs(value) > EXACT_INTS)
        else:
            floats += times
            if isfinite(value):
                parts += times * float_to_multiple(value)
            else:
                odd += times
    return number, floats, odd, whole, parts


class RunningExtreme:
    """A running minimum or maximum of values.

    The heap contains every present value, and values that are no longer present; the latter are removed when they reach
    the top. A removal is journalled, because a rollback may restore the value, which must then be inserted again.

    Args:
        store: the store whose journal records changes.
        function: min or max.
        values: the initial values, at least one.
    """

    __slots__ = ("_counts", "_heap", "_held", "_most", "_sign", "_store")

    def __init__(self, store: Store, function: str, values: Sequence[Number]) -> None:
        self._store = store
        self._sign = 1 if function == "min" else -1
        self._counts = Counter(values)
        self._heap = [self._sign * value for value in self._counts]
        heapify(self._heap)
        self._held = set(self._heap)
        self._most = 2 * len(self._heap) + 64  # the heap size at which absent values are removed

    is_exact = True

    def apply_changes(self, changes: Sequence[Change]) -> None:
        """Update the numbers of occurrences of some values, journal this, and insert new values into the heap."""
        counts, store = self._counts, self._store
        for value, times in changes:
            old = counts[value]
            if store.recording:
                store.journal.extend((counts, value, old, ASSIGNED))
            counts[value] = old + times
            if times > 0:
                self.exchange(self._sign * value, None)
        if len(self._heap) > self._most:
            self._remove_absent()

    def value(self) -> Number:
        """Return the minimum or maximum of the present values, and remove absent values from the top of the heap."""
        heap, counts, sign = self._heap, self._counts, self._sign
        while not counts[sign * heap[0]]:
            self._record_removal(heap[0])
            heappop(heap)
        return sign * heap[0]

    def exchange(self, entry: Number, _: None) -> None:
        """Push an entry onto the heap unless it is present. The journal calls this to undo a removal."""
        if entry not in self._held:
            heappush(self._heap, entry)
            self._held.add(entry)  # last: after an interruption a repeated entry does no harm

    def _record_removal(self, entry: Number) -> None:
        """Journal that the caller removes an entry from the heap, and delete the count of its value."""
        if self._store.recording:
            self._store.journal.extend((self, entry, None, OVERWRITTEN))
        self._held.discard(entry)
        self._counts.pop(self._sign * entry, None)

    def _remove_absent(self) -> None:
        """Remove all values without occurrences from the heap and the counts."""
        for value in [value for value, number in self._counts.items() if not number]:
            if self._sign * value in self._held:
                self._record_removal(self._sign * value)
            else:
                del self._counts[value]
        self._heap = list(dict.fromkeys(entry for entry in self._heap if entry in self._held))
        heapify(self._heap)
        self._most = 2 * len(self._heap) + 64

    def check(self, values: Sequence[Number]) -> None:
        """Assert that the counts are those of these values, and that the heap contains each value."""
        counted: dict[Any, int] = {value: number for value, number in self._counts.items() if number}
        assert counted == Counter(values)
        assert {self._sign * value for value in counted} <= self._held
        assert self._held <= set(self._heap)
