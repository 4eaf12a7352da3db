"""What an engine applies is noted in traces, and what changes its model otherwise is noticed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Literal

from envgraph.graph import Model, ensured
from envgraph.rewrite._match import Firing
from envgraph.rewrite.engine._replacing import Replacing
from envgraph.rewrite.engine._trace import Trace


class Recordings(Replacing):
    """A model, what is defined over it, and the traces under way; `Engine` adds what can be done."""

    def __init__(self, model: Model, matcher: Literal["compiled", "naive"]) -> None:
        super().__init__(model, matcher)
        self._recorders: list[Trace] = []

    @ensured
    def recording(self) -> Iterator[Trace]:
        """What is applied inside, in order, for `replay`; `trace_to_text` writes it.

        What a transaction inside takes back is left out. What a Python rule does is one application, and happens when
        its function is called again.

        Raises:
            TraceError: at the end of the block, if something that is no application of a rule has changed the model:
                an edit from Python, as that of a job of an event rule, or a checkout.
        """
        trace = Trace(start=self.model.state_hash())
        with self._listing(trace):
            yield trace
        trace.close(self.model.state_hash())

    @ensured
    def _listing(self, trace: Trace) -> Iterator[Trace]:
        """What is applied inside is added to a trace."""
        self._recorders = [*self._recorders, trace]
        try:
            yield trace
        finally:
            # By identity: traces are lists, and two of the same contents are equal.
            self._recorders = [other for other in self._recorders if other is not trace]

    @ensured
    def _unrecorded(self) -> Iterator[None]:
        """What is applied inside is part of what is being applied."""
        recorders = self._recorders
        self._recorders = []
        try:
            yield
        finally:
            self._recorders = recorders

    def _notice(self) -> None:
        """Something is about to be applied: what changed the model since the last time was no rule."""
        if self._recorders:
            state = self.model.state_hash()
            for recorder in self._recorders:
                recorder.notice(state)

    def _record(self, firings: Iterable[Firing], gaps: Sequence[int] = ()) -> None:
        if self._recorders:
            found, state = list(firings), self.model.state_hash()
            for recorder in self._recorders:
                recorder.put(found, state, gaps)
