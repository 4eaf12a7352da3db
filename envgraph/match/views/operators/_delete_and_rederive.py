"""Views of recursive patterns, updated by delete and rederive (DRed).

A. Gupta, I. S. Mumick, V. S. Subrahmanian, "Maintaining views incrementally", SIGMOD 1993. Support counts do not
suffice, since on a cycle rows can derive each other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from envgraph.errors import RAISE_LIMIT_HINT, EvaluationError, scaled_limit
from envgraph.graph import Store
from envgraph.match.views.operators._materialized_view import Hook, Operator, RowOperator
from envgraph.match.views.operators._row_set import Row


class RecursiveView(RowOperator):
    """An operator with the rows of one pattern of a recursive component.

    Attributes:
        component: names of the patterns of the component.
        queue: pending derivations, flat: a row, then True if it is inserted, False if deleted.
        spread_functions: functions that queue the derivations of rows of the component from an inserted row of this
            pattern.
        retract_functions: functions that queue the same derivations for removal, from a row that will be deleted.
        derivability_tests: functions that return True if a row has a derivation from the present rows.
        base_functions: functions that list the rows derived without rows of the component.
    """

    def __init__(self, name: str, store: Store, component: frozenset[str]) -> None:
        super().__init__(name, store)
        self.component = component
        self.queue: list[Any] = []
        self.spread_functions: Sequence[Hook] = ()
        self.retract_functions: Sequence[Hook] = ()
        self.derivability_tests: Sequence[Callable[..., bool]] = ()
        self.base_functions: Sequence[Callable[[], list[Row]]] = ()

    @property
    def is_pending(self) -> bool:
        return False  # the component processes all members together

    def process(self) -> None:
        raise AssertionError("members are processed together")

    def discard_pending(self) -> None:
        self.queue.clear()

    def recompute(self) -> None:
        """Remove all rows, because the component computes the rows of all its patterns together."""
        self.set_rows([])


class RecursiveComponent(Operator):
    """The operator that updates all patterns of a recursive component.

    Args:
        name: unique in the network.
        store: the store of the model.
        members: the views of the patterns, in the order in which the patterns were added to the library.
    """

    def __init__(self, name: str, store: Store, members: Sequence[RecursiveView]) -> None:
        super().__init__(name, store)
        self.members = tuple(members)
        self._most = scaled_limit("matches")

    @property
    def is_pending(self) -> bool:
        return any(member.queue for member in self.members)

    def discard_pending(self) -> None:
        for member in self.members:
            member.queue.clear()

    def size(self) -> float:
        return sum(member.size() for member in self.members)

    def process(self) -> None:
        gained, lost = self._take_queues()
        self._insert_and_spread([*gained, *self._overdelete(lost)] if lost else gained, needs_rederivation=bool(lost))

    def _take_queues(self) -> tuple[list[tuple[RecursiveView, Row]], list[tuple[RecursiveView, Row]]]:
        """Empty the queues of all views. Return the rows with a new derivation, and the rows with a lost derivation."""
        gained: list[tuple[RecursiveView, Row]] = []
        lost: list[tuple[RecursiveView, Row]] = []
        for member in self.members:
            entries = iter(member.queue[:])
            member.queue.clear()
            for row, coming in zip(entries, entries, strict=True):
                (gained if coming else lost).append((member, row))
        return gained, lost

    def _overdelete(self, lost: list[tuple[RecursiveView, Row]]) -> list[tuple[RecursiveView, Row]]:
        """Delete and return the rows that lost a derivation, and all rows that may depend on them (overdeletion)."""
        marked: dict[tuple[str, Row], tuple[RecursiveView, Row]] = {}
        todo: list[tuple[RecursiveView, Row]] = []

        def mark(candidates: list[tuple[RecursiveView, Row]]) -> None:
            for member, row in candidates:
                if row in member.rows.position and (member.name, row) not in marked:
                    marked[member.name, row] = (member, row)
                    todo.append((member, row))

        mark(lost)
        for member, row in todo:
            for hook in member.retract_functions:
                hook(*row)
            mark(self._take_queues()[1])
        for member, row in todo:
            member.delete(row)
        return todo

    def _insert_and_spread(
        self,
        found: list[tuple[RecursiveView, Row]],
        needs_rederivation: bool,
        insert: Callable[[RecursiveView, Row], None] = RowOperator.insert,
    ) -> None:
        """Insert the given rows that are missing, and all rows derived from them (semi-naive evaluation).

        Args:
            found: the rows to insert, each with its view; derived rows are appended to this list.
            needs_rederivation: True if a given row is only inserted if it has a derivation, since it may have lost
                its last.
            insert: inserts a row into its view.

        Raises:
            EvaluationError: a pattern would have more rows than the limit.
        """
        sure = len(found) if needs_rederivation else 0
        coming: set[tuple[RecursiveView, Row]] = set()  # used only for membership tests
        for number, (member, row) in enumerate(found):
            if row in member.rows.position:
                continue
            if number < sure and not any(derivable(*row) for derivable in member.derivability_tests):
                continue
            if len(member.rows) >= self._most:
                message = f"recursive pattern `{member.name}` has more than {self._most:,} matches"
                raise EvaluationError(message, hint=RAISE_LIMIT_HINT)
            insert(member, row)
            for hook in member.spread_functions:
                hook(*row)
            if member.spread_functions:
                # A row may have very many derivations: it is added once.
                for other in self._take_queues()[0]:
                    if other not in coming and other[1] not in other[0].rows.position:
                        coming.add(other)
                        found.append(other)

    def recompute(self) -> None:
        for member in self.members:
            member.recompute()
            member.queue.clear()
        base = [(m, row) for m in self.members for each in m.base_functions for row in each()]
        self._insert_and_spread(base, needs_rederivation=False, insert=RecursiveView.insert_silently)
