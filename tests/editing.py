"""An editor for the tests of the language server, without a connection."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from envgraph.editor import Document, LanguageService
from envgraph.errors import Source
from envgraph.lang import TextFiles, data_path

MEMORY = "memory:///"


class Editor:
    """An editor with a language service; it keeps the diagnostics that it was sent, by URI."""

    def __init__(self, texts: dict[str, str] | None = None, folder: Path | None = None) -> None:
        self.shown: dict[str, list[Any]] = {}
        self.texts = texts or {}
        self.service = LanguageService(self._receive, TextFiles(texts) if texts is not None else None)
        uri = folder.as_uri() if folder else f"{MEMORY}."
        self.service.answer("initialize", {"workspaceFolders": [{"uri": uri, "name": "folder"}]})

    def _receive(self, method: str, params: dict[str, Any]) -> None:
        if method == "textDocument/publishDiagnostics":
            self.shown[params["uri"]] = params["diagnostics"]

    def open(self, uri: str, text: str, language: str = "") -> None:
        document = {"uri": uri, "text": text, "version": 1, "languageId": language}
        self.service.answer("textDocument/didOpen", {"textDocument": document})
        self.service.check()

    def open_all(self) -> None:
        """Open the files in memory."""
        for name, text in self.texts.items():
            document = {"uri": MEMORY + name, "text": text, "version": 1, "languageId": ""}
            self.service.answer("textDocument/didOpen", {"textDocument": document})
        self.service.check()

    def change(self, uri: str, *changes: dict[str, Any]) -> None:
        document = {"uri": uri, "version": 2}
        self.service.answer("textDocument/didChange", {"textDocument": document, "contentChanges": changes})
        self.service.check()

    def codes(self, uri: str) -> list[str]:
        return [one["code"] for one in self.shown.get(uri, [])]

    def ask(self, method: str, uri: str, at: str | int = 0, **more: Any) -> Any:
        """Ask about a position: an offset, or a text that contains `|` before the character that is meant."""
        document = self.service.documents[uri]
        offset = at if isinstance(at, int) else document.source.text.index(at.replace("|", "")) + at.index("|")
        params = {"textDocument": {"uri": uri}, "position": document.position(offset), **more}
        return self.service.answer(f"textDocument/{method}", params)

    def text_at(self, location: dict[str, Any]) -> str:
        """Return file name, line and text of a location."""
        name = self.service.name_of(location["uri"])
        source = self.service.document_named(name, self.service.edited_files().read(name).decode()).source
        document = Document(location["uri"], source)
        start, end = document.offset(location["range"]["start"]), document.offset(location["range"]["end"])
        return f"{name}:{location['range']['start']['line'] + 1}: {source.text[start:end]}"


def domain_texts(domain: str) -> dict[str, str]:
    """Return the files of a bundled domain, by their paths below the directory of all domains."""
    folder = data_path("rules")
    files = sorted(one for one in (folder / domain).rglob("*") if one.is_file())
    return {one.relative_to(folder).as_posix(): one.read_text("utf-8") for one in files}


def place(line: int, character: int) -> dict[str, int]:
    return {"line": line, "character": character}


def apply_edits(text: str, edits: list[dict[str, Any]]) -> str:
    """Return a text with the edits of the protocol, whose ranges do not overlap."""
    document = Document("", Source("", text))
    for edit in sorted(edits, key=lambda one: -document.offset(one["range"]["start"])):
        start, end = document.offset(edit["range"]["start"]), document.offset(edit["range"]["end"])
        text = text[:start] + edit["newText"] + text[end:]
    return text
