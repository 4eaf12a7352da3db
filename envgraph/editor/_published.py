"""Send the problems of files to the editor, as diagnostics of the protocol."""

from __future__ import annotations

from collections.abc import Container, Sequence
from typing import TYPE_CHECKING, Final

from envgraph.editor._documents import Document, JsonObject
from envgraph.errors import Diagnostic, Severity, Source

if TYPE_CHECKING:
    from envgraph.editor._checked_files import CheckResult
    from envgraph.editor._language_service import LanguageService

_SEVERITIES: Final = {Severity.ERROR: 1, Severity.WARNING: 2}
_UNNECESSARY: Final = 1


class Published:
    """The diagnostics that the editor shows; a file that several checks have read shows those of all of them."""

    def __init__(self, service: LanguageService) -> None:
        self._service = service
        self._of_checks: dict[tuple[str, ...], dict[str, list[JsonObject]]] = {}
        self._shown: dict[str, list[JsonObject]] = {}

    def publish(self, roots: tuple[str, ...], result: CheckResult) -> None:
        """Show the problems of a check in place of those of the last check of the same files."""
        found: dict[str, list[JsonObject]] = {}
        for problem in result.problems:
            place = problem.span.source.name if problem.span else next(iter(result.workspace.roots), roots[0])
            document = self._document_of(problem, place)
            found.setdefault(document.uri, []).append(self._to_protocol(problem, document))
        self._of_checks[roots] = found
        self._send_changes()

    def keep_only(self, wanted: Container[tuple[str, ...]]) -> None:
        """Remove the diagnostics of other checks."""
        self._of_checks = {roots: found for roots, found in self._of_checks.items() if roots in wanted}
        self._send_changes()

    def _send_changes(self) -> None:
        every: dict[str, list[JsonObject]] = {uri: [] for uri in self._shown}
        for found in self._of_checks.values():
            for uri, problems in found.items():
                shown = every.setdefault(uri, [])
                shown += [one for one in problems if one not in shown]
        for uri, problems in every.items():
            if problems != self._shown.get(uri):
                self._service.notify("textDocument/publishDiagnostics", {"uri": uri, "diagnostics": problems})
        self._shown = {uri: problems for uri, problems in every.items() if problems}

    def _document_of(self, problem: Diagnostic, name: str) -> Document:
        """Return the document with the text of a problem's span; for a problem without a span, the file `name`."""
        if problem.span is not None:
            return self._service.document_of(problem.span)
        return Document(self._service.document_named(name).uri, Source(name, ""))

    def _to_protocol(self, problem: Diagnostic, document: Document) -> JsonObject:
        start = {"line": 0, "character": 0}
        message = f"{problem.message}\nhint: {problem.hint}" if problem.hint else problem.message
        made: JsonObject = {
            "range": document.range(problem.span) if problem.span else {"start": start, "end": start},
            "severity": _SEVERITIES[problem.severity],
            "code": problem.code,
            "source": "envgraph",
            "message": message,
            "data": {"hint": problem.hint, "subject": list(problem.subject)},
        }
        if problem.code.startswith("unused-"):
            made["tags"] = [_UNNECESSARY]
        related = self._related_places(problem)
        if related:
            made["relatedInformation"] = related
        return made

    def _related_places(self, problem: Diagnostic) -> Sequence[JsonObject]:
        return [
            {"location": self._service.location(note.span), "message": note.message}
            for note in problem.notes
            if note.span is not None
        ]
