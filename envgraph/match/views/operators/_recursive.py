"""Views of recursive patterns, updated by delete and rederive (DRed).

A. Gupta, I. S. Mumick, V. S. Subrahmanian, "Maintaining views incrementally", SIGMOD 1993. Support counts do not
suffice, since on a cycle rows can derive each other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from envgraph.errors import RAISE_LIMIT, EvaluationError, limit
from envgraph.graph import Store
from envgraph.match.views.operators._operators import Hook, Operator, Rows
from envgraph.match.views.operators._sets import Row


class Member(Rows):
    """An operator with the rows of one pattern of a recursive component.

    Attributes:
        component: names of the patterns of the component.
        queue: pending derivations, flat: a row, then True if it is inserted, False if deleted.
        spread: functions that queue the derivations of rows of the component from an inserted row of this pattern.
        retract: functions that queue the same derivations for removal, from a row that will be deleted.
        derivable: functions that return True if a row has a derivation from the present rows.
        list_base: functions that list the rows derived without rows of the component.
    """

    def __init__(self, name: str, store: Store, component: frozenset[str]) -> None:
        super().__init__(name, store)
        self.component = component
        self.queue: list[Any] = []
        self.spread: Sequence[Hook] = ()
        self.retract: Sequence[Hook] = ()
        self.derivable: Sequence[Callable[..., bool]] = ()
        self.list_base: Sequence[Callable[[], list[Row]]] = ()

    @property
    def pending(self) -> bool:
        return False  # the component processes all members together

    def process(self) -> None:
        raise AssertionError("members are processed together")

    def forget(self) -> None:
        self.queue.clear()

    def fill(self) -> None:
        """Remove all rows, because the component computes the rows of all its patterns together."""
        self.set_rows([])


class Component(Operator):
    """The operator that updates all patterns of a recursive component.

    Args:
        name: unique in the network.
        store: the store of the model.
        members: the views of the patterns, in the order in which the patterns were added to the library.
    """

    def __init__(self, name: str, store: Store, members: Sequence[Member]) -> None:
        super().__init__(name, store)
        self.members = tuple(members)
        self._most = limit("matches")

    @property
    def pending(self) -> bool:
        return any(member.queue for member in self.members)

    def forget(self) -> None:
        for member in self.members:
            member.queue.clear()

    def size(self) -> float:
        return sum(member.size() for member in self.members)

    def process(self) -> None:
        gained, lost = self._collect()
        self._spread([*gained, *self._take_out(lost)] if lost else gained, doubtful=bool(lost))

    def _collect(self) -> tuple[list[tuple[Member, Row]], list[tuple[Member, Row]]]:
        """Empty the queues of all views. Return the rows with a new derivation, and the rows with a lost derivation."""
        gained: list[tuple[Member, Row]] = []
        lost: list[tuple[Member, Row]] = []
        for member in self.members:
            entries = iter(member.queue[:])
            member.queue.clear()
            for row, coming in zip(entries, entries, strict=True):
                (gained if coming else lost).append((member, row))
        return gained, lost

    def _take_out(self, lost: list[tuple[Member, Row]]) -> list[tuple[Member, Row]]:
        """Delete and return the rows that lost a derivation, and all rows that may depend on them (overdeletion)."""
        marked: dict[tuple[str, Row], tuple[Member, Row]] = {}
        todo: list[tuple[Member, Row]] = []

        def mark(candidates: list[tuple[Member, Row]]) -> None:
            for member, row in candidates:
                if row in member.rows.position and (member.name, row) not in marked:
                    marked[member.name, row] = (member, row)
                    todo.append((member, row))

        mark(lost)
        for member, row in todo:
            for hook in member.retract:
                hook(*row)
            mark(self._collect()[1])
        for member, row in todo:
            member.vanish(row)
        return todo

    def _spread(
        self,
        found: list[tuple[Member, Row]],
        doubtful: bool,
        come: Callable[[Member, Row], None] = Rows.appear,
    ) -> None:
        """Insert the given rows that are missing, and all rows derived from them (semi-naive evaluation).

        Args:
            found: the rows to insert, each with its view; derived rows are appended to this list.
            doubtful: True if a given row is only inserted if it has a derivation, since it may have lost its last.
            come: inserts a row into its view.

        Raises:
            EvaluationError: a pattern would have more rows than the limit.
        """
        sure = len(found) if doubtful else 0
        coming: set[tuple[Member, Row]] = set()  # used only for membership tests
        for number, (member, row) in enumerate(found):
            if row in member.rows.position:
                continue
            if number < sure and not any(derivable(*row) for derivable in member.derivable):
                continue
            if len(member.rows) >= self._most:
                message = f"recursive pattern `{member.name}` has more than {self._most:,} matches"
                raise EvaluationError(message, hint=RAISE_LIMIT)
            come(member, row)
            for hook in member.spread:
                hook(*row)
            if member.spread:
                # A row may have very many derivations: it is added once.
                for other in self._collect()[0]:
                    if other not in coming and other[1] not in other[0].rows.position:
                        coming.add(other)
                        found.append(other)

    def fill(self) -> None:
        for member in self.members:
            member.fill()
            member.queue.clear()
        base = [(m, row) for m in self.members for each in m.list_base for row in each()]
        self._spread(base, doubtful=False, come=Member.hold)
