"""The history of an engine: transactions, versions, and recordings of applications."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager

from envgraph.graph import Model, Savepoint, Version, guarded_contextmanager
from envgraph.rewrite._matches import Firing
from envgraph.rewrite.engine._application_trace import Trace
from envgraph.rewrite.engine._notification import NO_CONTEXT, EngineEvents


class EngineHistory:
    """The transactions and versions of an engine, and the traces that are being recorded.

    Attributes:
        recorders: the traces to which applications are added.
    """

    def __init__(self, model: Model, events: EngineEvents) -> None:
        self._model = model
        self._events = events
        self.recorders: list[Trace] = []

    def transaction(self) -> AbstractContextManager[Savepoint]:
        """Open a transaction: if an exception leaves the block, all its changes are undone and left out of recordings.

        Transactions may nest. Event rules fire and listeners are notified at the end of the outermost one.
        """
        is_unrecorded = not self.recorders and self._events.delayed() is None
        return self._model.transaction() if is_unrecorded else self._transaction()

    @guarded_contextmanager
    def _transaction(self) -> Iterator[Savepoint]:
        lengths = [(recorder, len(recorder)) for recorder in self.recorders]
        with self._events.delayed() or NO_CONTEXT:
            try:
                with self._model.transaction() as savepoint:
                    yield savepoint
            except BaseException:
                for recorder, length in lengths:
                    recorder.truncate(length)
                raise

    def commit(self) -> Version:
        """Create a version of the current state, after event rules have fired.

        Raises:
            TransactionError: inside a transaction.
        """
        self._events.run_event_rules()
        return self._model.commit()

    def checkout(self, version: Version, *, discard: bool = False) -> None:
        """Restore the state of a version exactly.

        Raises:
            InvalidArgument: the argument is no version.
            TransactionError: inside a transaction, or for a version of another model, or if there are uncommitted
                changes and `discard` is False.
        """
        self._model.checkout(version, discard=discard)

    @guarded_contextmanager
    def recording(self) -> Iterator[Trace]:
        """Record the applications inside the block, in order, for `replay`; `trace_to_text` writes the trace.

        Applications that are rolled back are left out. A Python rule is recorded as one application; a replay calls its
        function again.

        Raises:
            TraceError: at the end of the block, if the model was changed by something other than a rule: an edit from
                Python (also in a job of an event rule) or a checkout.
        """
        trace = Trace(start=self._model.state_hash())
        with self.recording_to(trace):
            yield trace
        trace.end_recording(self._model.state_hash())

    @guarded_contextmanager
    def recording_to(self, trace: Trace) -> Iterator[Trace]:
        """Record the applications inside the block in one more trace."""
        self.recorders = [*self.recorders, trace]
        try:
            yield trace
        finally:
            # Compare by identity, because traces are lists, and lists with the same contents are equal.
            self.recorders = [other for other in self.recorders if other is not trace]

    @guarded_contextmanager
    def recording_paused(self) -> Iterator[None]:
        """Record no applications inside the block in any trace, because they are part of another application."""
        recorders = self.recorders
        self.recorders = []
        try:
            yield
        finally:
            self.recorders = recorders

    def check_state(self) -> None:
        """Pass the current state to the traces before an application, so that they detect changes without a rule."""
        if self.recorders:
            state = self._model.state_hash()
            for recorder in self.recorders:
                recorder.check_state(state)

    def record(self, firings: Iterable[Firing], gaps: Sequence[int] = ()) -> None:
        """Add applications to the recorded traces.

        `gaps` are indexes before which something other than a rule changed the model.
        """
        if self.recorders:
            found, state = list(firings), self._model.state_hash()
            for recorder in self.recorders:
                recorder.add_firings(found, state, gaps)
