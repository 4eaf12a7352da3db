"""Recursive patterns, kept current by deltas: what is new spreads, what may be lost is taken out and derived again.

Delete and rederive: A. Gupta, I. S. Mumick, V. S. Subrahmanian, "Maintaining views incrementally", SIGMOD 1993. Counts
would not do, since on a cycle rows can derive each other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

from envgraph.errors import RAISE_LIMIT, EvaluationError, limit
from envgraph.graph import Store
from envgraph.match.views.operators._operators import Hook, Operator, Rows
from envgraph.match.views.operators._sets import Row

MOST_ROWS: Final = 1_000_000
"""Rows of one pattern; only an `eval` that makes new values without end needs more."""


class Member(Rows):
    """The rows of one of the patterns that call each other.

    Attributes:
        component: names of those patterns.
        queue: derivations that have come (True) or gone (False), flat.
        spread, retract: find what a row that has come, or one that is about to go, derives inside the component.
        derivable: whether a row follows from what there is.
        list_base: the rows that need no other row of the component.
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
        return False  # it is the turn of all members at once

    def process(self) -> None:
        raise AssertionError("members are processed together")

    def forget(self) -> None:
        self.queue.clear()

    def fill(self) -> None:
        """Empty: the component fills all."""
        self.set_rows([])


class Component(Operator):
    """The patterns that call each other.

    Args:
        name: unique.
        store: of the model.
        members: in the order in which they were added to the library.
    """

    def __init__(self, name: str, store: Store, members: Sequence[Member]) -> None:
        super().__init__(name, store)
        self.members = tuple(members)
        self._most = limit(MOST_ROWS)

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
        """Return what the queues hold: rows with a derivation more, and rows with one less."""
        gained: list[tuple[Member, Row]] = []
        lost: list[tuple[Member, Row]] = []
        for member in self.members:
            entries = iter(member.queue[:])
            member.queue.clear()
            for row, coming in zip(entries, entries, strict=True):
                (gained if coming else lost).append((member, row))
        return gained, lost

    def _take_out(self, lost: list[tuple[Member, Row]]) -> list[tuple[Member, Row]]:
        """Remove the rows that have lost a derivation, and all that may follow from them; returns them."""
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
        """Add rows and what follows from them; of the doubtful ones those that do follow from something."""
        sure = len(found) if doubtful else 0
        coming: set[tuple[Member, Row]] = set()  # for membership alone
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
                # A row may have very many derivations: it is noted once.
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
