"""Open, change and close documents and folders, as notifications of the editor say."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from envgraph import __version__
from envgraph.editor._documents import Document, JsonObject
from envgraph.editor._semantic_tokens import TOKEN_TYPES
from envgraph.errors import Source
from envgraph.lang import LANGUAGES

if TYPE_CHECKING:
    from envgraph.editor._language_service import LanguageService

_INCREMENTAL = 2
_WATCHED_SUFFIXES = (*LANGUAGES, "vql", "ecore", "xmi", "json", "toml")


def initialize(service: LanguageService, params: JsonObject) -> JsonObject:
    """Open the folders of the editor, and return what the server can do."""
    folders = params.get("workspaceFolders") or []
    uris = [one["uri"] for one in folders] or ([params["rootUri"]] if params.get("rootUri") else [])
    service.folders = tuple(service.name_of(uri) for uri in uris)
    workspace = params.get("capabilities", {}).get("workspace") or {}
    service.refreshes_lenses = bool((workspace.get("codeLens") or {}).get("refreshSupport"))
    service.refreshes_tokens = bool((workspace.get("semanticTokens") or {}).get("refreshSupport"))
    service.watches_files = bool((workspace.get("didChangeWatchedFiles") or {}).get("dynamicRegistration"))
    return {"capabilities": CAPABILITIES, "serverInfo": {"name": "envgraph", "version": __version__}}


def watch_files(service: LanguageService, params: JsonObject) -> None:
    """Ask the editor to report files in our languages that other programs change, if it can."""
    if service.watches_files:
        watchers = [{"globPattern": f"**/*.{{{','.join(_WATCHED_SUFFIXES)}}}"}]
        method = "workspace/didChangeWatchedFiles"
        registration = {"id": "files", "method": method, "registerOptions": {"watchers": watchers}}
        service.notify("client/registerCapability", {"registrations": [registration]})


def do_nothing(service: LanguageService, params: JsonObject) -> None:
    """Do nothing: the connection answers this message itself, or it has no effect here."""


def open_document(service: LanguageService, params: JsonObject) -> None:
    """Add a document with the text that the editor shows."""
    given = params["textDocument"]
    language = str(given.get("languageId", "")).removeprefix("envgraph-")
    name = service.name_of(given["uri"], language if language in LANGUAGES else "")
    _set_text(service, given["uri"], name, given["text"], given.get("version", 0))


def change_document(service: LanguageService, params: JsonObject) -> None:
    """Apply the changes of a document, each a range with its new text, or the whole text, in their order."""
    document = service.document(params)
    for change in params["contentChanges"]:
        text = change["text"]
        if "range" in change:
            start, end = document.offset(change["range"]["start"]), document.offset(change["range"]["end"])
            old = document.source.text
            text = old[: min(start, end)] + text + old[max(start, end) :]
        document = Document(document.uri, Source(document.source.name, text), document.version)
    version = params["textDocument"].get("version") or 0
    _set_text(service, document.uri, document.source.name, document.source.text, version)


def close_document(service: LanguageService, params: JsonObject) -> None:
    """Remove a document: from now on, the saved file counts."""
    document = service.document(params)
    del service.documents[document.uri]
    service.close(document.source.name)


def change_files(service: LanguageService, params: JsonObject) -> None:
    """Check again what depends on files that other programs have changed, created or deleted."""
    for change in params["changes"]:
        service.mark_stale(service.name_of(change["uri"]))


def change_folders(service: LanguageService, params: JsonObject) -> None:
    """Add and remove open folders."""
    event: Any = params["event"]
    removed = {service.name_of(one["uri"]) for one in event["removed"]}
    added = [service.name_of(one["uri"]) for one in event["added"]]
    service.folders = tuple(dict.fromkeys([*(one for one in service.folders if one not in removed), *added]))
    service.mark_all_stale()


def _set_text(service: LanguageService, uri: str, name: str, text: str, version: int) -> None:
    # Half of a surrogate pair is not a character, and cannot be written to a file.
    text = text.encode("utf-16-le", "surrogatepass").decode("utf-16-le", "replace")
    service.documents[uri] = Document(uri, Source(name, text), version)
    service.mark_stale(name)


CAPABILITIES: JsonObject = {
    "positionEncoding": "utf-16",
    "textDocumentSync": {"openClose": True, "change": _INCREMENTAL, "save": False},
    "workspace": {"workspaceFolders": {"supported": True, "changeNotifications": True}},
    "definitionProvider": True,
    "referencesProvider": True,
    "documentHighlightProvider": True,
    "hoverProvider": True,
    "documentSymbolProvider": True,
    "workspaceSymbolProvider": True,
    "renameProvider": {"prepareProvider": True},
    "codeLensProvider": {"resolveProvider": False},
    "completionProvider": {"triggerCharacters": [".", ":", "@", '"']},
    "signatureHelpProvider": {"triggerCharacters": ["(", ","]},
    "semanticTokensProvider": {
        "legend": {"tokenTypes": list(TOKEN_TYPES), "tokenModifiers": ["declaration"]},
        "full": True,
        "range": True,
    },
    "foldingRangeProvider": True,
    "selectionRangeProvider": True,
    "documentLinkProvider": {"resolveProvider": False},
    "documentFormattingProvider": True,
    "documentRangeFormattingProvider": True,
    "codeActionProvider": {"codeActionKinds": ["quickfix"]},
}
"""The capabilities of the server, in the words of the protocol."""
