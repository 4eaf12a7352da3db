"""What follows from other errors, and is not reported."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from envgraph.errors import Diagnostic, Severity
from envgraph.lang._parsing import Parsed
from envgraph.pattern import Pattern

_UNREAD = frozenset({"empty-body", "unreferenced-parameter", "used-once"})
"""What may follow from a constraint that could not be read."""


def unread_names(parsed: Parsed) -> frozenset[str]:
    """The names in a text of which nothing could be saved, or in a comment that runs to the end of the file."""
    opened = [one.span.start for one in parsed.diagnostics if one.code == "unterminated-comment" and one.span]
    text = parsed.source.text
    start = 0 if parsed.tree is None else min(opened, default=len(text))
    return frozenset(re.findall(r"[^\W\d]\w*", text[start:]))


def without_echoes(
    found: Sequence[Diagnostic], unread: Iterable[Diagnostic], patterns: Iterable[Pattern]
) -> list[Diagnostic]:
    """Leaves out what follows from other errors in the same pattern.

    Args:
        found: what a check says.
        unread: what was wrong with the texts before.
        patterns: of all the files.
    """
    before = [one for one in unread if one.severity is Severity.ERROR]
    echoes: set[Diagnostic] = set()
    for pattern in patterns:
        inside = [one for one in found if _within(one, pattern)]
        if not any(one.code in _UNREAD for one in inside):
            continue
        if any(_within(one, pattern) for one in before):
            echoes.update(one for one in inside if one.code in _UNREAD)
        errors = [one for one in inside if one.severity is Severity.ERROR and one.code not in _UNREAD]
        if errors:  # the variable that it is about may be the one that is missing elsewhere
            echoes.update(one for one in inside if one.code == "used-once")
        if any(one.code == "wrong-arity" for one in errors):
            echoes.update(one for one in inside if one.code == "unreferenced-parameter")
    return [one for one in found if one not in echoes]


def _within(problem: Diagnostic, pattern: Pattern) -> bool:
    """Whether a diagnostic is about something from the name of a pattern to the end of its last body."""
    span, start = problem.span, pattern.span
    if span is None or start is None or span.source.name != start.source.name:
        return False
    end = max((body.span.end for body in pattern.bodies if body.span), default=start.end)
    return start.start <= span.start <= end
