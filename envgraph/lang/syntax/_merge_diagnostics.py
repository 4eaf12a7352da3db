"""Merge diagnostics of one mistake that shows in several places."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from envgraph.errors import SHOWN, Diagnostic, Note, Span, count_with_noun

_ROW_CODES = frozenset({"stray-character", "unterminated-text"})
_MOST_LINES = 3
"""If more adjacent lines than this contain invalid characters, these lines are the rows of one unquoted text."""
FILE_WIDE_NAME_CODES = frozenset(
    f"unknown-{kind}"
    for kind in (
        *("attribute", "class", "enum", "feature", "function", "literal"),
        *("object", "pattern", "prefix", "reference", "rule", "type", "uri"),
    )
)
"""Codes about names with the scope of a file: if a name's definition is misspelt, all its uses are unknown."""
_PARAMETERS = ("unknown-variable", ".environment")
"""The code and suffix for parameters of environments, whose scope is a file too, unlike that of other variables."""


def merge_unknown_names(diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
    """Return the diagnostics, but only one for each unknown name in a file, with a note that lists its other places.

    Args:
        diagnostics: the diagnostics, file by file, in the order of the text.
    """
    places: dict[tuple[str, str, str, str], list[Diagnostic]] = {}
    kept: list[Diagnostic] = []
    for one in diagnostics:
        if one.span is None or not (one.code in FILE_WIDE_NAME_CODES or _is_parameter(one.code, one.span)):
            kept.append(one)
            continue
        group = places.setdefault((one.span.source.name, one.code, one.message, one.span.text), [])
        group.append(one)
        if len(group) == 1:
            kept.append(one)
    groups = {id(group[0]): group for group in places.values() if len(group) > 1}
    return [_merge_group(groups[id(one)]) if id(one) in groups else one for one in kept]


def _merge_group(group: Sequence[Diagnostic]) -> Diagnostic:
    """Return the first diagnostic of a group, with a note about the others; its fixes correct all of them."""
    first, *others = group
    edits = tuple(edit for one in group for edit in one.fixes)
    return replace(first, notes=(*first.notes, _other_places_note(others)), edits=edits)


def _is_parameter(code: str, span: Span) -> bool:
    return code == _PARAMETERS[0] and span.source.name.endswith(_PARAMETERS[1])


def _other_places_note(problems: Sequence[Diagnostic]) -> Note:
    spans = [one.span for one in problems[: SHOWN.places] if one.span is not None]
    shown = ", ".join(f"{span.line}:{span.column}" for span in spans)
    more = len(problems) - SHOWN.places
    return Note(f"also at {shown}" + (f" and at {count_with_noun(more, 'more place')}" if more > 0 else ""))


def merge_unquoted_text(diagnostics: Sequence[Diagnostic]) -> Iterator[Diagnostic]:
    """Yield the diagnostics, but only the first one, with a new hint, for the rows of a text without opening quotes."""
    rows = sorted(
        (one for one in diagnostics if one.span and one.code in _ROW_CODES),
        key=lambda one: (one.span.source.name, one.span.start) if one.span else ("", 0),
    )
    first: dict[Diagnostic, Diagnostic] = {}
    lines: dict[Diagnostic, set[int]] = {}
    previous: Diagnostic | None = None
    for one in rows:
        begin = first[previous] if previous is not None and _is_adjacent_line(previous, one) else one
        first[one] = begin
        lines.setdefault(begin, set()).add(one.span.line if one.span else 0)
        previous = one
    for one in diagnostics:
        head = first.get(one)
        if head is None or len(lines[head]) <= _MOST_LINES:
            yield one
        elif one is head:
            yield replace(one, hint='write a text of several lines between `"""` and `"""`')


def _is_adjacent_line(one: Diagnostic, other: Diagnostic) -> bool:
    """Return True if the second diagnostic is on the same line as the first or on the next line."""
    if one.span is None or other.span is None or one.span.source is not other.span.source:
        return False
    return other.span.line - one.span.line <= 1
