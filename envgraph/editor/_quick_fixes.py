"""Offer changes that correct the problems of a text."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Final

from envgraph.editor._documents import Document, JsonObject
from envgraph.errors import Diagnostic, Edit, Severity, Source
from envgraph.lang import Files, language_of, part_at
from envgraph.metamodel import SUPPRESS

if TYPE_CHECKING:
    from envgraph.editor._language_service import LanguageService

_DEFINED_BY: Final = {
    "unknown-class": ("class", ("metamodel",)),
    "unknown-type": ("class|enum", ("metamodel",)),
    "unknown-enum": ("enum", ("metamodel",)),
    "unknown-pattern": ("pattern", ("query", "vql")),
    "unknown-rule": ("rule|unit|derive", ("rules",)),
    "no-metamodel": ("metamodel", ("metamodel",)),
}
"""By code: the keywords before a definition of the missing name, and the suffixes of files that may have it."""
_IMPORT_LINE = re.compile(r"^[ \t]*import\b[^\n]*(?:\n|\Z)")
_HEADER_LINES = re.compile(r"(?:[ \t]*(?:import|package)\b[^\n]*\n|[ \t]*\n)*", re.MULTILINE)
_LEADING_COMMENTS = re.compile(r"(?:[ \t]*\r?\n|[ \t]*//[^\n]*\n)*")
_MOST_SHOWN: Final = 30


def code_actions(service: LanguageService, params: JsonObject) -> list[JsonObject]:
    """Return the corrections of the problems in a range of a document, as they were found in its last check."""
    document = service.document(params)
    first, last = (document.offset(params["range"][one]) for one in ("start", "end"))
    shown: list[JsonObject] = params.get("context", {}).get("diagnostics", [])
    found: list[JsonObject] = []
    for problem in service.checked(document.source.name).problems:
        span = problem.span
        if span is None or span.source.name != document.source.name or span.source.text != document.source.text:
            continue  # The text has changed since the check, so the places are unknown.
        if span.start <= last and first <= span.end:
            position = document.range(span)
            same = [one for one in shown if one.get("code") == problem.code and one.get("range") == position]
            found += _actions(service, document, problem, same)
    return found


def _actions(
    service: LanguageService, document: Document, problem: Diagnostic, shown: Sequence[JsonObject]
) -> Iterator[JsonObject]:
    if problem.fixes:
        yield _action(service, _title(problem.fixes), problem.fixes, shown) | {"isPreferred": True}
    for title, edit in (
        *_import_fixes(document, problem, service.edited_files()),
        *_removal_fixes(document, problem),
        *_suppression_fixes(document, problem),
    ):
        yield _action(service, title, [edit], shown)


def _action(service: LanguageService, title: str, edits: Iterable[Edit], shown: Sequence[JsonObject]) -> JsonObject:
    changes: dict[str, list[JsonObject]] = {}
    for edit in edits:
        document = service.document_of(edit.span)
        changes.setdefault(document.uri, []).append({"range": document.range(edit.span), "newText": edit.text})
    return {"title": title, "kind": "quickfix", "diagnostics": list(shown), "edit": {"changes": changes}}


def _title(edits: Sequence[Edit]) -> str:
    old, new = (_shortened(one) for one in (edits[0].span.text, edits[0].text))
    if not edits[0].text:
        return f"Remove `{old}`"
    others = f" in {len(edits)} places" if len(edits) > 1 else ""
    return (f"Write `{new}` in place of `{old}`" if old else f"Write `{new}` here") + others


def _shortened(text: str) -> str:
    return text if len(text) <= _MOST_SHOWN else f"{text[:_MOST_SHOWN]}..."


def _import_fixes(document: Document, problem: Diagnostic, files: Files) -> Iterator[tuple[str, Edit]]:
    """Yield imports of the files in the same directory that define the name that a problem misses."""
    if problem.code not in _DEFINED_BY or problem.span is None:
        return
    words, suffixes = _DEFINED_BY[problem.code]
    name = r"\w+" if problem.code == "no-metamodel" else re.escape(problem.span.text.rpartition("::")[2])
    definition = re.compile(rf"^[ \t]*(?:\w+[ \t]+)*(?:{words})[ \t]+{name}\b", re.MULTILINE)
    own = document.source.name
    for entry in files.entries(own.rpartition("/")[0] or "."):
        last = entry.rpartition("/")[2]
        if entry == own or last.rpartition(".")[2] not in suffixes or f'"{last}"' in document.source.text:
            continue
        if definition.search(_text_of(files, entry)):
            place = _import_place(document.source)
            edit = Edit(document.source.span_between(place, place), f'import "{last}"\n')
            yield f'Import "{last}"', edit


def _text_of(files: Files, name: str) -> str:
    try:
        return files.read(name).decode("utf-8", "replace")
    except (OSError, ValueError):
        return ""


def _import_place(source: Source) -> int:
    """Return the offset of the line after the last import or, without one, after the package and first comments."""
    begin = _LEADING_COMMENTS.match(source.text)
    start = begin.end() if begin else 0
    header = _HEADER_LINES.match(source.text, start)
    lines = header.group().rstrip() if header else ""
    return start if not lines else min(start + len(lines) + 1, len(source.text))


def _removal_fixes(document: Document, problem: Diagnostic) -> Iterator[tuple[str, Edit]]:
    """Yield the removal of the line of an import that is not used."""
    if problem.code != "unused-import" or problem.span is None:
        return
    source = document.source
    start = source.line_start(problem.span.line)
    line = _IMPORT_LINE.match(source.text[start:])
    if line is not None and "as" not in source.text[start : problem.span.start].split():
        yield "Remove this import", Edit(source.span_between(start, start + line.end()), "")


def _suppression_fixes(document: Document, problem: Diagnostic) -> Iterator[tuple[str, Edit]]:
    """Yield the insertion of `@suppress`, which hides a warning, before the definition with the warning."""
    source, span = document.source, problem.span
    if problem.severity is not Severity.WARNING or span is None or problem.code in ("unused-suppress", "unused-import"):
        return
    part = part_at(source, span.start)
    if part is None or language_of(source.name) == "model":
        return
    _, *around = part.reading.spans_around(span.start - part.start)
    if not around:
        return
    start = part.start + around[0][0]
    if re.match(r"import\b|package\b", source.text[start:]):
        return
    line = source.line_start(source.line_and_column(start)[0])
    indent = source.text[line:start]
    behind = "\n" + indent if not indent.strip() else " "
    edit = Edit(source.span_between(start, start), f'@{SUPPRESS}("{problem.code}"){behind}')
    yield f"Suppress `{problem.code}` in this definition", edit
