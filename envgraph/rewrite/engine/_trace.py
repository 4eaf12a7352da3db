"""Recorded runs: what was applied where, and in which state that ended; and as text, one JSON object a line.

    {"format": "envgraph-trace-1", "model": "target", "metamodel": "burning_forest", "state": "5b0e..."}
    {"rule": "burning_forest.moveLeft", "match": {"truck": 0, "from": 7, "to": 6}, "state": "91aa..."}
    {"end": 1, "state": "91aa..."}

The first line says in which state the run began, the last one how many applications there were. Objects are ids. A
state is the identity hash of the model (`Model.state_hash`) as 16 hexadecimal digits; after an application inside a
unit it is left out. Replaying applies the rules at these matches, and compares the states.

`trace.schema.json` in this package is the JSON Schema of a line.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Final

from envgraph.errors import Diagnostic, EvaluationError, Note, RuleError, Span, TraceError
from envgraph.rewrite._match import Firing

if TYPE_CHECKING:
    from envgraph.rewrite.engine._engine import Engine

TRACE_FORMAT: Final = "envgraph-trace-1"

_CHANGED: Final = "the trace was changed, or the rule is not what it was"
_HINT: Final = (
    "a trace holds applications of rules: put the edit into a rule (`@engine.rule` makes one of a function), or leave "
    "it out"
)


class Trace(list[Firing]):
    """What was applied, in order: a list of `Firing`s that knows states.

    Attributes:
        states: hash of the state after so many applications, where it is known; at 0, before the first.
        gaps: after so many applications something else changed the model: a trace with gaps is of no use.
        spans: where the states stand, the first one included, if the trace was read from a text; else empty.
        matches: where the matches stand then.
    """

    def __init__(self, firings: Iterable[Firing] = (), *, start: int | None = None) -> None:
        super().__init__(firings)
        self.states: dict[int, int] = {} if start is None else {0: start}
        self.gaps: list[int] = []
        self.spans: tuple[Span, ...] = ()
        self.matches: tuple[Span, ...] = ()

    def notice(self, state: int) -> None:
        """The next application follows on this state."""
        known = self.states.setdefault(len(self), state)
        if known != state:
            if len(self) not in self.gaps:
                self.gaps.append(len(self))
            self.states[len(self)] = state

    def put(self, firings: Iterable[Firing], state: int, gaps: Sequence[int] = ()) -> None:
        """Rules have been applied, something else after so many of them, and this is the state after all."""
        self.gaps.extend(len(self) + gap for gap in gaps)
        self.extend(firings)
        self.states[len(self)] = state

    def cut(self, length: int) -> None:
        """Everything from an application on was undone."""
        del self[length:]
        self.states = {count: state for count, state in self.states.items() if count <= length}
        self.gaps = [gap for gap in self.gaps if gap < length]

    def close(self, state: int) -> None:
        """The recording ends in this state.

        Raises:
            TraceError: something that is no application of a rule has changed the model.
        """
        self.notice(state)
        if self.gaps:
            raise TraceError([self._gap(gap) for gap in self.gaps])

    def _gap(self, gap: int) -> Diagnostic:
        where = f"after application {gap}, `{self[gap - 1].rule}`," if gap else "before the first application"
        return Diagnostic(
            "unrecorded-change", f"{where} something changed the model that no rule did", None, _HINT
        )

    def check(self, count: int, state: int) -> None:
        """After so many applications of a replay the model is in this state.

        Raises:
            TraceError: it was another one when this was recorded.
        """
        known = self.states.get(count)
        if known is None or known == state:
            return
        if count:
            rule = self[count - 1].rule
            message = (
                f"application {count}, `{rule}`, leads to state {state_text(state)}, not {state_text(known)}"
            )
            hint = _CHANGED
        else:
            message = f"the run began in state {state_text(known)}, and this is {state_text(state)}"
            hint = "replay it on the model that it was recorded on"
        raise TraceError([Diagnostic("other-state", message, self.span(count), hint)])

    def refused(self, count: int, error: RuleError | EvaluationError) -> TraceError:
        """An application of a trace that was read cannot be made."""
        message = f"application {count}: {error.message}"
        notes: tuple[Note, ...] = (Note("this cannot be done", error.span),) if error.span else ()
        notes += tuple(map(Note, error.details if isinstance(error, RuleError) else ()))
        hint = error.hint or _CHANGED
        found = Diagnostic("not-applicable", message, self.matches[count - 1], hint, notes=notes)
        return TraceError([found])

    def span(self, count: int) -> Span | None:
        """Return where the state after so many applications stands."""
        return self.spans[count] if self.spans else None


def trace_to_text(engine: Engine, trace: Trace) -> str:
    """A trace as JSON lines; the engine is the one that recorded it, or has the same rules."""
    head: dict[str, Any] = {
        "format": TRACE_FORMAT,
        "model": engine.model.name,
        "metamodel": engine.model.metamodel.name,
    }
    lines = [_line(trace, 0, head)]
    for count, (rule, row) in enumerate(trace, start=1):
        names = engine.prepare(rule).shape.names
        lines.append(_line(trace, count, {"rule": rule, "match": dict(zip(names, row, strict=True))}))
    lines.append(_line(trace, len(trace), {"end": len(trace)}))
    return "".join(f"{line}\n" for line in lines)


def _line(trace: Trace, count: int, values: dict[str, Any]) -> str:
    state = trace.states.get(count)
    found = values if state is None else {**values, "state": state_text(state)}
    return json.dumps(found, ensure_ascii=False)


def state_text(state: int) -> str:
    """A state hash as it is written."""
    return f"{state:016x}"


def trace_schema() -> dict[str, Any]:
    """The JSON Schema (2020-12) of one line of a trace; it is the file `trace.schema.json` in this package.

    >>> trace_schema()["$defs"]["application"]["required"]
    ['rule', 'match']
    """
    from importlib.resources import files  # takes as long to import as a small model to read

    schema: dict[str, Any] = json.loads(
        files("envgraph.rewrite.engine").joinpath("trace.schema.json").read_text("utf-8")
    )
    return schema
