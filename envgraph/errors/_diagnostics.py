"""Diagnostics as data, and how they read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import field
from enum import StrEnum

from envgraph.code import dataclass, visible
from envgraph.errors._source import Span

_LONGEST = 2000
"""A message that is longer is not shown in full: names may have any length."""


class Severity(StrEnum):
    """How bad a diagnostic is: an error stops the load, a warning does not."""

    ERROR = "error"
    WARNING = "warning"


@dataclass(frozen=True, slots=True)
class Note:
    """A second place that explains a diagnostic, such as the first of two definitions."""

    message: str
    span: Span | None = None


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """One problem.

    Attributes:
        code: stable, kebab-case, for programs ("unknown-class").
        message: one line, lower case, names in backquotes.
        span: what it is about; None where the input has no text (patterns built in Python).
        hint: how to mend it, without the word "hint".
        subject: what it is about, for programs: the name that stands in the message, or the keys that lead to a value.
    """

    code: str
    message: str
    span: Span | None = None
    hint: str | None = None
    severity: Severity = Severity.ERROR
    notes: tuple[Note, ...] = ()
    subject: tuple[str | int, ...] = field(default=(), compare=False, repr=False)

    def __str__(self) -> str:
        """Position, message, the code of a warning, excerpt with caret, notes and hint, on several lines."""
        mark = "" if self.severity is Severity.ERROR else "warning: "
        # The code of a warning is shown because `@suppress` and `--ignore` take it.
        message = f"{_shown(self.message)} [{self.code}]" if mark else _shown(self.message)
        lines = [f"{self.span}: {mark}{message}" if self.span else f"{mark}{message}"]
        if self.span and self.span.source.text:  # the text of a file that cannot be read is empty
            lines.append(self.span.excerpt())
        for note in self.notes:
            message = _shown(note.message)
            lines.append(f"note: {note.span}: {message}" if note.span else f"note: {message}")
            if note.span:
                lines.append(note.span.excerpt())
        if self.hint:
            lines.append(f"hint: {_shown(self.hint)}")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, object]:
        """The diagnostic as JSON-ready data; lines and columns from 1, the end excluded."""
        data: dict[str, object] = {
            "severity": str(self.severity),
            "code": self.code,
            "message": self.message,
            "hint": self.hint,
        }
        data.update(_place(self.span))
        if self.notes:
            data["notes"] = [{"message": note.message, **_place(note.span)} for note in self.notes]
        return data


def _shown(text: str) -> str:
    if len(text) > _LONGEST:
        text = f"{text[: _LONGEST // 2]}...{text[-_LONGEST // 2 :]}"
    return visible(text)


def _place(span: Span | None) -> dict[str, object]:
    if span is None:
        return {}
    end_line, end_column = span.source.position(span.end)
    return {
        "file": span.source.name,
        "start": {"line": span.line, "column": span.column},
        "end": {"line": end_line, "column": end_column},
    }


def has_errors(diagnostics: Iterable[Diagnostic]) -> bool:
    """Return whether any of them is an error rather than a warning."""
    return any(diagnostic.severity is Severity.ERROR for diagnostic in diagnostics)


def sort_diagnostics(diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
    """In the order of the text: by file as first met, then by position; those without a span first."""
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


def too_many_errors(span: Span | None, rest: str = "the rest of the file is not read") -> Diagnostic:
    """The last error where there are too many: what comes of it."""
    return Diagnostic("too-many-errors", f"too many mistakes: {rest}", span, "mend these first")


def defined_twice(
    named: Iterable[tuple[str, Span | None]],
    message: str,
    hint: str = "choose another name, or leave one out",
    first: Mapping[str, Span | None] | None = None,
) -> Iterator[Diagnostic]:
    """Yield an error for each name that is defined again, with a note where it is defined first.

    Args:
        named: the names, each with its place, in the order of the file.
        message, hint: the texts; `{}` in them becomes the name.
        first: the places of names that other files define.
    """
    known = dict(first or {})
    for name, span in named:
        if name in known:
            text, advice = (one.replace("{}", name) for one in (message, hint))
            notes = (Note("the first definition is here", known[name]),)
            yield Diagnostic("duplicate-definition", text, span, advice, notes=notes)
        known.setdefault(name, span)
