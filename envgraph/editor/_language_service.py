"""The language server without its connection: it takes requests and notifications as JSON objects."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from importlib import import_module
from typing import Any, Final

from envgraph.editor._checked_files import CheckJob, CheckResult, all_roots, mentions_word
from envgraph.editor._documents import Document, JsonObject
from envgraph.editor._match_counts import CountJob, MatchCounts
from envgraph.editor._name_index import NameIndex
from envgraph.editor._open_files import name_of_uri, uri_of_name, with_texts
from envgraph.editor._published import Published
from envgraph.errors import InvalidArgument, Source, Span, name_hint
from envgraph.lang import DiskFiles, Files

Notify = Callable[[str, JsonObject], None]
"""A function that sends a notification, by its method and parameters, to the editor. If the editor supports them, it
also sends the requests "workspace/codeLens/refresh", "workspace/semanticTokens/refresh" and
"client/registerCapability", whose answers do not matter."""

METHODS: Final[Mapping[str, str]] = {
    "initialize": "_synchronisation:initialize",
    "initialized": "_synchronisation:watch_files",
    "shutdown": "_synchronisation:do_nothing",
    "exit": "_synchronisation:do_nothing",
    "$/cancelRequest": "_synchronisation:do_nothing",
    "$/setTrace": "_synchronisation:do_nothing",
    "textDocument/didOpen": "_synchronisation:open_document",
    "textDocument/didChange": "_synchronisation:change_document",
    "textDocument/didSave": "_synchronisation:do_nothing",
    "textDocument/didClose": "_synchronisation:close_document",
    "workspace/didChangeConfiguration": "_synchronisation:do_nothing",
    "workspace/didChangeWatchedFiles": "_synchronisation:change_files",
    "workspace/didChangeWorkspaceFolders": "_synchronisation:change_folders",
    "textDocument/definition": "_navigation:find_definition",
    "textDocument/references": "_navigation:find_references",
    "textDocument/documentHighlight": "_navigation:highlight",
    "textDocument/hover": "_hover:hover",
    "textDocument/documentSymbol": "_symbols:document_symbols",
    "workspace/symbol": "_symbols:workspace_symbols",
    "textDocument/prepareRename": "_rename:prepare_rename",
    "textDocument/rename": "_rename:rename",
    "textDocument/codeLens": "_lenses:code_lenses",
    "textDocument/completion": "_completion:complete",
    "textDocument/signatureHelp": "_signatures:signature_help",
    "textDocument/semanticTokens/full": "_semantic_tokens:semantic_tokens",
    "textDocument/semanticTokens/range": "_semantic_tokens:semantic_tokens_in_range",
    "textDocument/foldingRange": "_folding:folding_ranges",
    "textDocument/selectionRange": "_folding:selection_ranges",
    "textDocument/documentLink": "_folding:document_links",
    "textDocument/formatting": "_formatting:format_document",
    "textDocument/rangeFormatting": "_formatting:format_range",
    "textDocument/codeAction": "_quick_fixes:code_actions",
    "envgraph/preview": "_preview:preview",
    "envgraph/whyNot": "_preview:why_not",
}
"""The function that answers each method: its module in this package, and its name. It takes the service and the
parameters, and is imported with the first request."""


class LanguageService:
    """The state of a language server: the open documents and what is known of their files.

    `answer` never waits for the check of an edited file. The owner of the connection calls `check` in pauses, or takes
    the `next_job`, runs it elsewhere, and gives its result to `record`. Then the diagnostics are sent.

    Attributes:
        files: where files that are not open are read from.
        folders: the names of the open folders; their files are checked together.
        documents: the open documents, by URI.
        refreshes_lenses, refreshes_tokens: True if the editor can be asked to request lenses or semantic tokens again.
        watches_files: True if the editor can report changed files.
        partial_tokens: the names of documents of which not all semantic tokens were sent.
    """

    def __init__(self, notify: Notify, files: Files | None = None) -> None:
        """Create a service without documents.

        Args:
            notify: sends the notifications of the service.
            files: where files that are not open are read from; None for the disk.
        """
        self.notify = notify
        self.files: Files = files or DiskFiles()
        self.folders: tuple[str, ...] = ()
        self.documents: dict[str, Document] = {}
        self.refreshes_lenses = self.refreshes_tokens = self.watches_files = False
        self.partial_tokens: set[str] = set()
        self._parsed: frozenset[str] = frozenset()
        self._results: dict[tuple[str, ...], CheckResult] = {}
        self._stale: dict[tuple[str, ...], None] = {}
        self._uncounted: dict[tuple[str, ...], None] = {}
        self._published = Published(self)

    def answer(self, method: str, params: JsonObject) -> Any:
        """Return the result of a request or, for a notification of the editor, None.

        Raises:
            InvalidArgument: there is no such method, or the request is refused, such as a rename to a keyword.
        """
        if method not in METHODS:
            raise InvalidArgument(f"there is no method `{method}`", name_hint(method, METHODS))
        module, _, name = METHODS[method].partition(":")
        return getattr(import_module(f"envgraph.editor.{module}"), name)(self, params)

    # --- documents ---

    def document(self, params: JsonObject) -> Document:
        """Return the open document that the parameters of a request name.

        Raises:
            InvalidArgument: it is not open.
        """
        uri = params["textDocument"]["uri"]
        if uri not in self.documents:
            raise InvalidArgument(f"the document `{uri}` is not open", "open it first, with `textDocument/didOpen`")
        return self.documents[uri]

    def document_named(self, name: str, text: str = "") -> Document:
        """Return the open document of a file, or else a document with the given text."""
        for one in self.documents.values():
            if one.source.name == name:
                return one
        return Document(uri_of_name(self.files, name), Source(name, text))

    def document_of(self, span: Span) -> Document:
        """Return the document of the file of a span, with the text that the span belongs to."""
        return Document(self.document_named(span.source.name).uri, span.source)

    def location(self, span: Span) -> JsonObject:
        """Return a span as a location of the protocol: the URI of its file, and its range."""
        document = self.document_of(span)
        return {"uri": document.uri, "range": document.range(span)}

    def name_of(self, uri: str, language: str = "") -> str:
        """Return the file name of a URI; `language` is the suffix of a text that was never saved."""
        if uri in self.documents:
            return self.documents[uri].source.name
        return name_of_uri(self.files, uri, f".{language}" if language else "")

    def edited_files(self) -> Files:
        """Return all files, with the texts of the open documents in place of those that were saved."""
        return with_texts(self.files, {one.source.name: one.source.text for one in self.documents.values()})

    def is_parsed(self, name: str) -> bool:
        """Return True if a check has parsed all of an open document, so that an edit costs the parse of one part."""
        return name in self._parsed

    # --- checks ---

    def roots_of(self, name: str) -> tuple[str, ...]:
        """Return the paths to read for a file: its directory if this is in an open folder, else the file alone."""
        return CheckJob.roots_of(self.edited_files(), name, self.folders)

    def mark_stale(self, name: str) -> None:
        """Note that a file has changed: the open documents that depend on it are checked again."""
        wanted = self._open_roots()
        for roots in wanted:
            result = self._results.get(roots)
            if result is None or name in roots or result.depends_on(name, roots):
                self._stale[roots] = None
        # Results of files that are not open are not checked again until a request needs them.
        self._results = {
            roots: result
            for roots, result in self._results.items()
            if roots in wanted or not result.depends_on(name, roots)
        }

    def mark_all_stale(self) -> None:
        """Note that folders were opened or closed: all open documents are checked again."""
        self._stale = self._open_roots()
        self._published.keep_only(self._stale)

    def _open_roots(self) -> dict[tuple[str, ...], None]:
        return {self.roots_of(one.source.name): None for one in self.documents.values()}

    def next_job(self) -> CheckJob | CountJob | None:
        """Remove and return the next job: a check, or else a count of matches; None if there is no job."""
        wanted = self._open_roots()
        self._stale = {roots: None for roots in self._stale if roots in wanted}
        if self._stale:
            roots = next(iter(self._stale))
            del self._stale[roots]
            open_texts = tuple(one.source for one in self.documents.values())
            return CheckJob(roots, self.edited_files(), open_texts, self._results.get(roots))
        uncounted = [roots for roots in self._uncounted if roots in self._results]
        self._uncounted = dict.fromkeys(uncounted[1:])
        return CountJob(uncounted[0], self._results[uncounted[0]]) if uncounted else None

    def record(self, job: CheckJob | CountJob, result: CheckResult | MatchCounts | None) -> None:
        """Keep the result of a job. Send the diagnostics of a check unless a newer check of these files waits."""
        if isinstance(result, CheckResult):
            assert isinstance(job, CheckJob)
            self._parsed |= {one.name for one in job.open_texts}
            if self.partial_tokens & self._parsed:
                self.partial_tokens -= self._parsed
                self.notify("workspace/semanticTokens/refresh", {})
            self._keep(job.roots, result)
            self._uncounted[job.roots] = None
            if job.roots not in self._stale and job.roots in self._open_roots():
                self._published.publish(job.roots, result)
        elif job.roots in self._results:
            last = self._results[job.roots]
            self._results[job.roots] = replace(last, counts=result)
            if result != last.counts and self.refreshes_lenses:
                self.notify("workspace/codeLens/refresh", {})

    def check(self) -> None:
        """Check all files that have changed, send their diagnostics, and count matches."""
        while (job := self.next_job()) is not None:
            self.record(job, job.run())

    def checked(self, name: str) -> CheckResult:
        """Return the last result of checking a file with those that belong to it; check it now if there is none."""
        return self._result_of(self.roots_of(name))

    def _result_of(self, roots: tuple[str, ...]) -> CheckResult:
        if roots not in self._results:
            self._keep(roots, CheckJob(roots, self.edited_files()).run())
        return self._results[roots]

    def _keep(self, roots: tuple[str, ...], result: CheckResult) -> None:
        last = self._results.get(roots)
        if result.metamodel is None and last is not None:
            result = replace(result, metamodel=last.metamodel)
        if last is not None and not result.workspace.errors:
            result = replace(result, counts=last.counts)  # until they are counted again
        self._results[roots] = result

    def index(self, name: str, word: str | None = None) -> NameIndex:
        """Return the names in a file and in the files that belong to it.

        Args:
            name: the file.
            word: a name; files of other directories in the open folders that contain it are indexed, too.
        """
        results = [self.checked(name)]
        if word is not None:
            files = self.edited_files()
            results += [
                self._result_of(roots)
                for roots in all_roots(files, self.folders)
                if roots != self.roots_of(name) and mentions_word(files, roots, word)
            ]
        return NameIndex.of(self, results)

    def all_indexes(self) -> Iterator[NameIndex]:
        """Yield the names of the files of each open document, then of each directory in the open folders."""
        for roots in dict.fromkeys([*self._open_roots(), *all_roots(self.edited_files(), self.folders)]):
            yield NameIndex.of(self, [self._result_of(roots)])

    def close(self, name: str) -> None:
        """Forget a document that was closed, and remove the diagnostics of files that no open document needs."""
        self._parsed -= {name}
        self._published.keep_only(self._open_roots())
        self.mark_stale(name)
