"""Parse traces written by `envgraph.rewrite.trace_to_text`, with the position of every mistake."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any, Final

from envgraph.errors import (
    MAX_ERRORS,
    Diagnostic,
    InvalidArgument,
    Source,
    Span,
    TraceError,
    TypeMismatch,
    name_hint,
    quote_names,
)
from envgraph.graph import JsonPath
from envgraph.lang.interchange._json_reader import value_spans
from envgraph.metamodel import Value
from envgraph.rewrite import TRACE_FORMAT, Engine, Firing, Trace

_STATE: Final = re.compile("[0-9a-f]{16}")
_KEYS: Final = {
    "format": ("format", "model", "metamodel", "state"),
    "rule": ("rule", "match", "state"),
    "end": ("end", "state"),
}
_WRITE_HINT: Final = "write traces with `envgraph apply --trace` or `trace_to_text`"
_CHANGED_HINT: Final = "record the trace again: the trace or the rule was changed since"


def parse_trace(source: Source, engine: Engine) -> Trace:
    """Return the trace in a text, for `Engine.replay` of an engine with the same rules.

    Raises:
        TraceError: the text is not a trace, or names rules or objects that the engine lacks; contains all mistakes.
    """
    reader = _TraceReader(source, engine)
    reader.read()
    if reader.problems:
        raise TraceError(reader.problems[:MAX_ERRORS])
    return reader.trace


class _TraceReader:
    def __init__(self, source: Source, engine: Engine) -> None:
        self.source = source
        self.engine = engine
        self.trace = Trace()
        self.problems: list[Diagnostic] = []
        self._states: list[Span] = []
        self._matches: list[Span] = []
        self._ended = False

    def read(self) -> None:
        start = 0
        for line in self.source.text.split("\n"):
            if line.strip():
                self._read_line(Source(self.source.name, line), start)
            start += len(line) + 1
            if len(self.problems) >= MAX_ERRORS:
                return
        end = len(self.source.text)
        if not self._states and not self.problems:
            span = self.source.span_between(0, min(1, end))
            self._report("empty-file", "the file contains no trace", span, _WRITE_HINT)
        elif not self._ended and not self.problems:
            message = f"the trace ends after {len(self.trace)} applications, without its last line"
            hint = f'add the missing rest of the file; its last line is `{{"end": {len(self.trace)}, "state": ..}}`'
            self._report("unfinished-trace", message, self.source.span_between(max(0, end - 1), end), hint)
        self.trace.spans, self.trace.matches = tuple(self._states), tuple(self._matches)

    def _read_line(self, line: Source, start: int) -> None:
        whole = self.source.span_between(start, start + len(line.text))
        try:
            value = json.loads(line.text)
        except json.JSONDecodeError as error:
            place = start + error.pos
            span = self.source.span_between(place, place + 1)
            self._report("syntax", f"not JSON: {error.msg.lower()}", span, "write one JSON object on each line")
            return
        except (ValueError, RecursionError) as error:  # a number of thousands of digits, or thousands of brackets
            what = "a number is too large" if isinstance(error, ValueError) else "a value is nested too deeply"
            self._report("syntax", f"not JSON: {what}", whole, _WRITE_HINT)
            return
        spans = {
            path: self.source.span_between(start + span.start, start + span.end) for path, span in value_spans(line)
        }
        first = next(iter(value), None) if isinstance(value, dict) else None
        if first not in _KEYS:
            hint = 'begin the line with the key "format", "rule" or "end"'
            self._report("bad-format", "this is not a line of a trace", whole, hint)
        elif self._check_keys(value, _KEYS[first], spans):
            read = {"format": self._read_header, "rule": self._read_application, "end": self._read_end}[first]
            if self._check_order(first, whole):
                read(value, spans)

    def _check_order(self, first: str, whole: Span) -> bool:
        if (first == "format") is bool(self._states):
            if self.problems and not self._states:
                self._states = [whole]  # the mistake is in the first line
                return False
            message = "the trace has begun already" if self._states else "the first line is missing"
            hint = f'write `{{"format": "{TRACE_FORMAT}", ..}}` as the first line and nowhere else'
            self._report("bad-format", message, whole, hint)
            self._states = self._states or [whole]  # report it once
            return False
        if self._ended:
            hint = "remove all lines after the line with `end`"
            self._report("bad-format", "the trace has ended already", whole, hint)
            return False
        return True

    def _check_keys(self, value: Mapping[str, Any], known: tuple[str, ...], spans: Mapping[JsonPath, Span]) -> bool:
        strange = [key for key in value if key not in known]
        for key in strange:
            self._report("bad-format", f"unknown entry `{key}`", spans[key,], name_hint(key, known))
        if known[1] == "match" and "match" not in value:
            hint = 'write `"match": {"variable": value, ..}`'
            self._report("bad-format", "this application has no `match`", spans[()], hint)
            return False
        return not strange

    def _read_header(self, value: Mapping[str, Any], spans: Mapping[JsonPath, Span]) -> None:
        if value["format"] != TRACE_FORMAT:
            hint = (
                "update envgraph: a newer version may have written the trace"
                if str(value["format"]).startswith("envgraph")
                else _WRITE_HINT
            )
            message = f"the format must be `{TRACE_FORMAT}`, not {json.dumps(value['format'])}"
            self._report("bad-format", message, spans["format",], hint)
        metamodel = self.engine.model.metamodel.name
        if value.get("metamodel", metamodel) != metamodel:
            message = f"the trace is of a model of {json.dumps(value['metamodel'])}, but this model is of `{metamodel}`"
            hint = "replay it on the model on which it was recorded"
            self._report("other-metamodel", message, spans["metamodel",], hint)
        self._read_state(value, spans)

    def _read_application(self, value: Mapping[str, Any], spans: Mapping[JsonPath, Span]) -> None:
        firing = self._parse_firing(value, spans)
        if firing is not None:
            self.trace.append(firing)
            self._matches.append(spans["match",])
            self._read_state(value, spans)

    def _parse_firing(self, value: Mapping[str, Any], spans: Mapping[JsonPath, Span]) -> Firing | None:
        try:
            if not isinstance(value["rule"], str):
                raise InvalidArgument("the name of a rule must be a string")
            rule = self.engine.prepare(value["rule"])
        except InvalidArgument as error:
            self._report("unknown-rule", error.message, spans["rule",], error.hint)
            return None
        match, names = value["match"], rule.shape.names
        if not isinstance(match, dict):
            hint = 'write `{"variable": value, ..}`'
            self._report("bad-format", "a match must map each variable to its value", spans["match",], hint)
            return None
        missing = [name for name in names if name not in match]
        if missing:
            message = f"the match of `{rule.name}` lacks {quote_names(missing)}"
            self._report("wrong-match", message, spans["match",], _CHANGED_HINT)
        values: dict[str, Value] = {}
        for name, given in match.items():
            try:
                if type(given) is int and rule.shape.is_object(rule.shape.position(name)):
                    values[name] = given  # an earlier application may create this object
                else:
                    values.update(self.engine.catalog.check_bindings(rule.shape, {name: given}))
            except (InvalidArgument, TypeMismatch) as error:
                self._report("wrong-match", error.message, spans["match", name], error.hint or _CHANGED_HINT)
        if missing or len(values) != len(names):
            return None
        return Firing(rule.name, tuple(values[name] for name in names))

    def _read_end(self, value: Mapping[str, Any], spans: Mapping[JsonPath, Span]) -> None:
        self._ended = True
        count = value["end"]
        if (type(count) is not int or count != len(self.trace)) and not self.problems:
            message = f"`end` is {json.dumps(count)}, but the trace has {len(self.trace)} applications"
            self._report("wrong-count", message, spans["end",], "look for missing or additional lines")
        before = self.trace.states.get(len(self.trace))
        # After a mistake, applications may be missing, so the last recorded state is not compared.
        whole = not self.problems
        span = self._read_state(value, spans, is_last_line=True, was_recorded=before is not None)
        if whole and before is not None and self.trace.states[len(self.trace)] != before and span is not None:
            self._report("other-state", "this is not the state after the last application", span, _CHANGED_HINT)

    def _read_state(
        self,
        value: Mapping[str, Any],
        spans: Mapping[JsonPath, Span],
        *,
        is_last_line: bool = False,
        was_recorded: bool = False,
    ) -> Span | None:
        """Record the state hash on a line, if it has one, and return its span; None if it is missing or malformed.

        `is_last_line` is True for the last line, and `was_recorded` if the line before it had this state.
        """
        span = spans.get(("state",))
        if not is_last_line:
            self._states.append(span or spans[()])
        if span is None:
            return None
        state = value["state"]
        if not isinstance(state, str) or not _STATE.fullmatch(state):
            hint = "remove it to skip the comparison of states here"
            self._report("bad-format", "a state must have 16 hexadecimal digits", span, hint)
            return None
        self.trace.states[len(self.trace)] = int(state, 16)
        if is_last_line and not was_recorded:
            self._states[-1] = span
        return span

    def _report(self, code: str, message: str, span: Span, hint: str | None = None) -> None:
        self.problems.append(Diagnostic(code, message, span, hint))
