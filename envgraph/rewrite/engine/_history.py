"""The history of an engine: transactions, versions, and recordings of what was applied."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager

from envgraph.graph import Model, Savepoint, Version, guarded
from envgraph.rewrite._match import Firing
from envgraph.rewrite.engine._notification import NOTHING, Events
from envgraph.rewrite.engine._trace import Trace


class EngineHistory:
    """Transactions and versions of a model on which event rules fire, and the traces under way.

    Attributes:
        recorders: the traces that what is applied is added to.
    """

    def __init__(self, model: Model, events: Events) -> None:
        self._model = model
        self._events = events
        self.recorders: list[Trace] = []

    def transaction(self) -> AbstractContextManager[Savepoint]:
        """Everything inside happens, or, if an exception leaves the block, nothing of it. Transactions nest."""
        plain = not self.recorders and self._events.holding() is None
        return self._model.transaction() if plain else self._transaction()

    @guarded
    def _transaction(self) -> Iterator[Savepoint]:
        lengths = [(recorder, len(recorder)) for recorder in self.recorders]
        with self._events.holding() or NOTHING:
            try:
                with self._model.transaction() as savepoint:
                    yield savepoint
            except BaseException:
                for recorder, length in lengths:
                    recorder.cut(length)
                raise

    def commit(self) -> Version:
        """Name the present state of the model, after event rules have done what is pending.

        Raises:
            TransactionError: inside a transaction.
        """
        self._events.run()
        return self._model.commit()

    def checkout(self, version: Version, *, discard: bool = False) -> None:
        """Put the model into a committed state, exactly as it was then.

        Raises:
            InvalidArgument: that is no version.
            TransactionError: inside a transaction, a version of another model, or uncommitted changes that are not
                to be discarded.
        """
        self._model.checkout(version, discard=discard)

    @guarded
    def recording(self) -> Iterator[Trace]:
        """Record what is applied inside, in order, for `replay`; `trace_to_text` writes it.

        What a transaction inside undoes is left out. What a Python rule does is one application, and happens when
        its function is called again.

        Raises:
            TraceError: at the end of the block, if something that is no application of a rule has changed the model:
                an edit from Python, as that of a job of an event rule, or a checkout.
        """
        trace = Trace(start=self._model.state_hash())
        with self.listing(trace):
            yield trace
        trace.close(self._model.state_hash())

    @guarded
    def listing(self, trace: Trace) -> Iterator[Trace]:
        """Add what is applied inside to a trace."""
        self.recorders = [*self.recorders, trace]
        try:
            yield trace
        finally:
            # By identity: traces are lists, and two of the same contents are equal.
            self.recorders = [other for other in self.recorders if other is not trace]

    @guarded
    def unrecorded(self) -> Iterator[None]:
        """Make what is applied inside a part of what is being applied."""
        recorders = self.recorders
        self.recorders = []
        try:
            yield
        finally:
            self.recorders = recorders

    def notice(self) -> None:
        """Something is about to be applied: what changed the model since the last time was no rule."""
        if self.recorders:
            state = self._model.state_hash()
            for recorder in self.recorders:
                recorder.notice(state)

    def record(self, firings: Iterable[Firing], gaps: Sequence[int] = ()) -> None:
        """Note what has been applied; `gaps` are places among it at which something else changed the model."""
        if self.recorders:
            found, state = list(firings), self._model.state_hash()
            for recorder in self.recorders:
                recorder.put(found, state, gaps)
