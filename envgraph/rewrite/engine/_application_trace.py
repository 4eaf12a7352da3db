"""Traces: recorded applications with hashes of states, and their text form with one JSON object per line.

    {"format": "envgraph-trace-1", "model": "target", "metamodel": "burning_forest", "state": "5b0e..."}
    {"rule": "burning_forest.moveLeft", "match": {"truck": 0, "from": 7, "to": 6}, "state": "91aa..."}
    {"end": 1, "state": "91aa..."}

The first line contains the state before the first application, the last line the number of applications. Objects are
ids. A state is the identity hash of the model (`Model.state_hash`) as 16 hexadecimal digits; it is left out after an
application inside a unit. A replay applies the rules at these matches and compares the states.

`trace.schema.json` in this package is the JSON Schema of a line.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Final

from envgraph.code import shorten_repr
from envgraph.draw import html_table
from envgraph.errors import Diagnostic, EvaluationError, Note, RuleError, Span, TraceError
from envgraph.rewrite._matches import Firing

if TYPE_CHECKING:
    from envgraph.rewrite.engine._engine import Engine

TRACE_FORMAT: Final = "envgraph-trace-1"

_CHANGED_HINT: Final = "check if the trace or the rule was changed after the recording"
_UNRECORDED_HINT: Final = (
    "make the change in a rule (`@engine.rule` turns a function into a rule) or remove it: a trace contains only "
    "applications of rules"
)


@shorten_repr
class Trace(list[Firing]):
    """A list of applications (`Firing`s), in order, with the hashes of the states between them.

    Attributes:
        states: hash of the state after n applications, by n, if it is known; at 0, the state before the first.
        gaps: numbers n such that the model was changed, after n applications, by something other than a rule. A trace
            with gaps cannot be replayed.
        spans: spans of the states, including the first one, if the trace was parsed from text; else empty.
        matches: spans of the matches, if the trace was parsed from text; else empty.
    """

    def __init__(self, firings: Iterable[Firing] = (), *, start: int | None = None) -> None:
        super().__init__(firings)
        self.states: dict[int, int] = {} if start is None else {0: start}
        self.gaps: list[int] = []
        self.spans: tuple[Span, ...] = ()
        self.matches: tuple[Span, ...] = ()

    def _repr_html_(self) -> str:
        rows = ((number, one.rule, ", ".join(map(str, one.values))) for number, one in enumerate(self, start=1))
        return html_table(rows, ("step", "rule", "match"), total=len(self)) if self else "no applications"

    def check_state(self, state: int) -> None:
        """Record the state before the next application. If it differs from the state after the last one, add a gap."""
        known = self.states.setdefault(len(self), state)
        if known != state:
            if len(self) not in self.gaps:
                self.gaps.append(len(self))
            self.states[len(self)] = state

    def add_firings(self, firings: Iterable[Firing], state: int, gaps: Sequence[int] = ()) -> None:
        """Add applications and the state after them.

        `gaps` are numbers of these applications after which something other than a rule changed the model.
        """
        self.gaps.extend(len(self) + gap for gap in gaps)
        self.extend(firings)
        self.states[len(self)] = state

    def truncate(self, length: int) -> None:
        """Remove the applications from the index `length` on, their states and gaps, because they were undone."""
        del self[length:]
        self.states = {count: state for count, state in self.states.items() if count <= length}
        self.gaps = [gap for gap in self.gaps if gap < length]

    def end_recording(self, state: int) -> None:
        """Record the state at the end, and check that the trace has no gaps.

        Raises:
            TraceError: something other than a rule changed the model.
        """
        self.check_state(state)
        if self.gaps:
            raise TraceError([self._gap_diagnostic(gap) for gap in self.gaps])

    def _gap_diagnostic(self, gap: int) -> Diagnostic:
        where = f"after application {gap}, `{self[gap - 1].rule}`," if gap else "before the first application"
        return Diagnostic(
            "unrecorded-change",
            f"{where} the model was changed by something other than a rule",
            None,
            _UNRECORDED_HINT,
        )

    def check_replayed_state(self, count: int, state: int) -> None:
        """Check that the state after `count` applications of a replay equals the recorded state.

        Raises:
            TraceError: the states differ.
        """
        known = self.states.get(count)
        if known is None or known == state:
            return
        if count:
            rule = self[count - 1].rule
            message = f"application {count}, `{rule}`, leads to state {format_state(state)}, not {format_state(known)}"
            hint = _CHANGED_HINT
        else:
            message = (
                f"the recorded run began in state {format_state(known)}, but the model is in {format_state(state)}"
            )
            hint = "replay it on the model that it was recorded on"
        raise TraceError([Diagnostic("other-state", message, self.spans[count] if self.spans else None, hint)])

    def refused_error(self, count: int, error: RuleError | EvaluationError) -> TraceError:
        """Return the error for an application, numbered from 1, that cannot be made. The trace must have spans."""
        message = f"application {count}: {error.message}"
        notes: tuple[Note, ...] = (Note("this operation failed", error.span),) if error.span else ()
        notes += tuple(map(Note, error.details if isinstance(error, RuleError) else ()))
        hint = error.hint or _CHANGED_HINT
        found = Diagnostic("not-applicable", message, self.matches[count - 1], hint, notes=notes)
        return TraceError([found])


def trace_to_text(engine: Engine, trace: Trace) -> str:
    """Format a trace as JSON lines. The engine must be the one that recorded it, or have the same rules."""
    head: dict[str, Any] = {
        "format": TRACE_FORMAT,
        "model": engine.model.name,
        "metamodel": engine.model.metamodel.name,
    }
    lines = [_format_line(trace, 0, head)]
    for count, (rule, row) in enumerate(trace, start=1):
        names = engine.prepare(rule).shape.names
        lines.append(_format_line(trace, count, {"rule": rule, "match": dict(zip(names, row, strict=True))}))
    lines.append(_format_line(trace, len(trace), {"end": len(trace)}))
    return "".join(f"{line}\n" for line in lines)


def _format_line(trace: Trace, count: int, values: dict[str, Any]) -> str:
    state = trace.states.get(count)
    found = values if state is None else {**values, "state": format_state(state)}
    return json.dumps(found, ensure_ascii=False)


def format_state(state: int) -> str:
    """Format a state hash as 16 hexadecimal digits."""
    return f"{state:016x}"


def trace_schema() -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of one line of a trace, from the file `trace.schema.json` in this package.

    >>> trace_schema()["$defs"]["application"]["required"]
    ['rule', 'match']
    """
    from importlib.resources import (
        files,
    )  # as slow to import as a small model is to parse

    schema: dict[str, Any] = json.loads(
        files("envgraph.rewrite.engine").joinpath("trace.schema.json").read_text("utf-8")
    )
    return schema
