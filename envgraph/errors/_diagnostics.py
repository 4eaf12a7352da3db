"""Define diagnostics as data, and format them as text."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import field
from enum import StrEnum
from typing import Final

from envgraph.code import dataclass, escape_unprintable
from envgraph.errors._shown import SHOWN
from envgraph.errors._source_text import Span
from envgraph.errors._suggestions import ReplacementHint

WARNING_CODES: Final = frozenset({
    "always-different", "annotation-argument", "cartesian-product", "chain-aggregate", "conformance",
    "constant-comparison", "deletion-by-omission", "derived-feature", "duplicate-action", "empty-block", "endless-unit",
    "existing-link", "file-too-large", "frozen-class", "generic-type", "global-negation", "homeless", "left-out",
    "less-specific-type", "loose-connection", "lost-object", "may-be-refused", "maybe-none", "missing-file",
    "missing-required", "missing-uri", "never-applicable", "never-matches", "never-paid", "new-object", "no-base-case",
    "no-creation", "no-observation", "no-parameters", "no-right-side", "no-success", "no-values", "not-a-file",
    "nothing-derived", "opposites-differ", "orphan", "other-class", "other-file", "other-names", "outside-range",
    "quantified-variable", "query-feature", "recursive-pattern", "self-comparison", "similar-names",
    "too-many-warnings", "unbound-agent", "undeclared-type", "unique", "unknown-annotation", "unknown-object",
    "unknown-uri", "unlikely-probability", "unmatched-link", "unreadable-file", "unused-import", "unused-parameter",
    "unused-private-pattern", "unused-suppress", "used-once", "useless-annotation", "values-left-out", "values-rounded",
})  # fmt: skip
"""The codes of the warnings that `envgraph check` may give."""


class Severity(StrEnum):
    """The severity of a diagnostic: an error prevents the file from being loaded, a warning does not."""

    ERROR = "error"
    WARNING = "warning"


@dataclass(frozen=True, slots=True)
class Note:
    """A remark on a diagnostic that points to another place in the text, such as the first of two definitions."""

    message: str
    span: Span | None = None


@dataclass(frozen=True, slots=True)
class Edit:
    """A change of a text: the text that replaces a span, or is inserted at an empty one."""

    span: Span
    text: str


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """A problem found in an input file or in a definition made in Python.

    Attributes:
        code: stable kebab-case code for programs ("unknown-class").
        message: one line in lower case, with names in backquotes.
        span: the place of the problem; None if the input has no text, like a pattern built in Python.
        hint: how to correct the problem, without the word "hint".
        subject: the subject of the problem, for programs: the name quoted in the message, or the keys that lead to a
            value.
        edits: the changes that correct the problem, if the hint does not have them as a `ReplacementHint`.
    """

    code: str
    message: str
    span: Span | None = None
    hint: str | None = None
    severity: Severity = Severity.ERROR
    notes: tuple[Note, ...] = ()
    subject: tuple[str | int, ...] = field(default=(), compare=False, repr=False)
    edits: tuple[Edit, ...] = field(default=(), compare=False, repr=False)

    @property
    def fixes(self) -> tuple[Edit, ...]:
        r"""Return the changes that together correct the problem as its hint says; () if no text is known to be right.

        >>> from envgraph.errors import Source, did_you_mean
        >>> span = Source("a", "find stpe(x, y)").span_between(5, 9)
        >>> Diagnostic("unknown-pattern", "unknown pattern `stpe`", span, did_you_mean("stpe", ["step"])).fixes[0].text
        'step'
        """
        if self.edits or self.span is None or not isinstance(self.hint, ReplacementHint):
            return self.edits
        source, wrong = self.span.source, self.hint.wrong
        places = [0] if self.span.text == wrong else _word_places(self.span.text, wrong)
        starts = [self.span.start + place for place in places]
        found = [Edit(source.span_between(start, start + len(wrong)), self.hint.right) for start in starts]
        return tuple(found) if len(found) == 1 else ()

    def __str__(self) -> str:
        """Return the lines that a person sees: position and message, excerpt with carets, notes, hint."""
        mark = "" if self.severity is Severity.ERROR else "warning: "
        # Show the code of a warning, because `@suppress` and `--ignore` take it.
        message = f"{_displayed_text(self.message)} [{self.code}]" if mark else _displayed_text(self.message)
        lines = [f"{self.span}: {mark}{message}" if self.span else f"{mark}{message}"]
        if self.span and self.span.source.text:  # the text is empty if the file cannot be read
            lines.append(self.span.excerpt())
        for note in self.notes:
            message = _displayed_text(note.message)
            lines.append(f"note: {note.span}: {message}" if note.span else f"note: {message}")
            if note.span:
                lines.append(note.span.excerpt())
        if self.hint:
            lines.append(f"hint: {_displayed_text(self.hint)}")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, object]:
        """Return the diagnostic as JSON-ready data. Lines and columns count from 1, and the end is excluded."""
        data: dict[str, object] = {
            "severity": str(self.severity),
            "code": self.code,
            "message": self.message,
            "hint": self.hint,
        }
        data.update(_position_dict(self.span))
        if self.notes:
            data["notes"] = [{"message": note.message, **_position_dict(note.span)} for note in self.notes]
        return data


def _word_places(text: str, word: str) -> list[int]:
    """Return the offsets at which a word occurs in a text, but not inside of a longer word."""
    return [found.start() for found in re.finditer(rf"(?<!\w){re.escape(word)}(?!\w)", text)]


def _displayed_text(text: str) -> str:
    if len(text) > SHOWN.message:
        text = f"{text[: SHOWN.message // 2]}...{text[-SHOWN.message // 2 :]}"
    return escape_unprintable(text)


def _position_dict(span: Span | None) -> dict[str, object]:
    if span is None:
        return {}
    end_line, end_column = span.source.line_and_column(span.end)
    return {
        "file": span.source.name,
        "start": {"line": span.line, "column": span.column},
        "end": {"line": end_line, "column": end_column},
    }


def has_errors(diagnostics: Iterable[Diagnostic]) -> bool:
    """Return True if at least one diagnostic is an error rather than a warning."""
    return any(diagnostic.severity is Severity.ERROR for diagnostic in diagnostics)


def sort_diagnostics(diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
    """Return diagnostics in order of their positions, grouped by file; diagnostics without a span come first.

    Files keep the order in which the diagnostics mention them.
    """
    ordered = list(diagnostics)
    files: dict[str, int] = {}
    for diagnostic in ordered:
        if diagnostic.span:
            files.setdefault(diagnostic.span.source.name, len(files))

    def key(diagnostic: Diagnostic) -> tuple[int, int, int]:
        if diagnostic.span is None:
            return (-1, 0, 0)
        return (files[diagnostic.span.source.name], diagnostic.span.start, diagnostic.span.end)

    return sorted(ordered, key=key)


def too_many_errors_diagnostic(span: Span | None, rest: str = "the rest of the file is not read") -> Diagnostic:
    """Return the final diagnostic when the limit of errors is reached; `rest` states what is skipped."""
    return Diagnostic("too-many-errors", f"too many mistakes: {rest}", span, "correct these mistakes first")


def duplicate_diagnostics(
    named: Iterable[tuple[str, Span | None]],
    message: str,
    hint: str = "rename or delete one of the two definitions",
    first: Mapping[str, Span | None] | None = None,
) -> Iterator[Diagnostic]:
    """Yield an error for each repeated definition of a name, with a note at its first definition.

    Args:
        named: the defined names with their spans, in the order of the file.
        message, hint: templates of the texts; `{}` is replaced by the name.
        first: spans of names that other files define.
    """
    known = dict(first or {})
    for name, span in named:
        if name in known:
            text, advice = (one.replace("{}", name) for one in (message, hint))
            notes = (Note("the first definition is here", known[name]),)
            yield Diagnostic("duplicate-definition", text, span, advice, notes=notes)
        known.setdefault(name, span)
