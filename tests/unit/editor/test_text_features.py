"""Texts are coloured, folded, selected, linked and formatted."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from envgraph.editor import LanguageService
from envgraph.lang import TextFiles, data_path, format_text, language_of

METAMODEL = """metamodel shop

/* boxes
   of all sizes */
enum Size { small, large }

class Box {
    Size size = small
}
"""
QUERY = """package shop
import "a.metamodel"

pattern big(b : Box) {
    Box.size(b, ::large);
}
"""
BUNDLED = sorted(
    path
    for domain in ("sokoban", "railway", "triage", "jobshop")
    for path in data_path("rules", domain).iterdir()
    if language_of(path.name) is not None
)


def opened(text: str, name: str = "a.query", **others: str) -> LanguageService:
    """Return a service in which a text is open; `others` are files that are not open, such as `a_query`."""
    files = TextFiles({one.replace("_", "."): content for one, content in others.items()})
    service = LanguageService(lambda method, params: None, files)
    document = {"uri": f"memory:///{name}", "text": text, "version": 1, "languageId": ""}
    service.answer("textDocument/didOpen", {"textDocument": document})
    return service


def ask(service: LanguageService, method: str, **params: Any) -> Any:
    (uri,) = service.documents
    return service.answer(f"textDocument/{method}", {"textDocument": {"uri": uri}, **params})


def text_of(service: LanguageService) -> str:
    (document,) = service.documents.values()
    return document.source.text


def edited(service: LanguageService, edits: list[Any]) -> str:
    """Return the text of the open document with edits, given from the last to the first or in order, applied."""
    (document,) = service.documents.values()
    text = document.source.text
    for edit in sorted(edits, key=lambda one: document.offset(one["range"]["start"]), reverse=True):
        start, end = document.offset(edit["range"]["start"]), document.offset(edit["range"]["end"])
        text = text[:start] + edit["newText"] + text[end:]
    return text


def coloured(service: LanguageService, data: list[int]) -> list[tuple[str, str, bool]]:
    """Return text, kind and mark of a definition of each token, decoded as an editor decodes them."""
    legend = service.answer("initialize", {})["capabilities"]["semanticTokensProvider"]["legend"]["tokenTypes"]
    lines = [one.encode("utf-16-le") for one in text_of(service).split("\n")]
    found, line, start = [], 0, 0
    for place in range(0, len(data), 5):
        below, after, length, kind, modifiers = data[place : place + 5]
        line, start = line + below, after if below else start + after
        token = lines[line][2 * start : 2 * (start + length)].decode("utf-16-le")
        found.append((token, legend[kind], bool(modifiers)))
    return found


def test_names_are_coloured_by_what_they_stand_for() -> None:
    service = opened(QUERY, a_metamodel=METAMODEL)
    assert coloured(service, ask(service, "semanticTokens/full")["data"]) == [
        ("package", "keyword", False), ("shop", "namespace", True),
        ("import", "keyword", False), ('"a.metamodel"', "string", False),
        ("pattern", "keyword", False), ("big", "function", True), ("b", "parameter", True), ("Box", "type", False),
        ("Box", "type", False), ("size", "property", False), ("b", "parameter", False), ("large", "enumMember", False),
    ]  # fmt: skip


def test_comments_of_several_lines_and_wide_characters_are_coloured() -> None:
    service = opened("/* \N{GRINNING FACE}\r\n x */ enum A { b } // \N{GRINNING FACE}\r\n", "a.metamodel")
    assert coloured(service, ask(service, "semanticTokens/full")["data"]) == [
        ("/* \N{GRINNING FACE}", "comment", False), (" x */", "comment", False), ("enum", "keyword", False),
        ("A", "type", True), ("b", "enumMember", True), ("// \N{GRINNING FACE}", "comment", False),
    ]  # fmt: skip


def test_text_with_mistakes_is_coloured_as_far_as_it_is_understood() -> None:
    service = opened("pattern a(b : Box) {\n  find (\n\npattern c(d : Box) { Box(d); }\n")
    names = coloured(service, ask(service, "semanticTokens/full")["data"])
    assert ("find", "keyword", False) in names
    assert names[-5:] == [
        ("c", "function", True), ("d", "parameter", True), ("Box", "type", False), ("Box", "type", False),
        ("d", "parameter", False),
    ]  # fmt: skip


def test_the_rest_of_a_large_text_is_coloured_after_its_first_check() -> None:
    sent: list[str] = []
    service = LanguageService(lambda method, params: sent.append(method), TextFiles({}))
    service.answer("initialize", {"capabilities": {"workspace": {"semanticTokens": {"refreshSupport": True}}}})
    text = "".join(f"pattern p{one}(x : A, y : A) {{ A(x); A(y); }}\n" for one in range(1_000))
    document = {"uri": "memory:///a.query", "text": text, "version": 1, "languageId": ""}
    service.answer("textDocument/didOpen", {"textDocument": document})
    first = ask(service, "semanticTokens/full")["data"]
    assert "workspace/semanticTokens/refresh" not in sent
    service.check()
    assert sent.count("workspace/semanticTokens/refresh") == 1
    whole = ask(service, "semanticTokens/full")["data"]
    assert 0 < len(first) < len(whole) / 2
    assert whole[: len(first)] == first
    assert len(coloured(service, whole)) == 1_000 * len(
        coloured(opened(text[:40]), ask(opened(text[:40]), "semanticTokens/full")["data"])
    )


def test_the_tokens_of_a_range_are_those_of_its_definitions() -> None:
    service = opened("pattern a(x : A) { A(x); }\n\npattern b(x : B) { B(x); }\n")
    all_tokens = coloured(service, ask(service, "semanticTokens/full")["data"])
    there = {"start": {"line": 2, "character": 0}, "end": {"line": 2, "character": 5}}
    part = coloured(service, ask(service, "semanticTokens/range", range=there)["data"])
    assert part == all_tokens[len(all_tokens) // 2 :]


def test_blocks_comments_and_imports_are_folded() -> None:
    service = opened(METAMODEL, "a.metamodel")
    assert ask(service, "foldingRange") == [
        {"startLine": 2, "endLine": 3, "kind": "comment"},
        {"startLine": 6, "endLine": 7},
    ]
    assert ask(opened(QUERY), "foldingRange") == [
        {"startLine": 3, "endLine": 4},
        {"startLine": 0, "endLine": 1, "kind": "imports"},
    ]
    assert ask(opened("a = 1\n\n[b]\nc = 1\n\n[d]\n", "family.toml"), "foldingRange") == [
        {"startLine": 2, "endLine": 3}
    ]


def test_a_selection_grows_from_the_word_to_the_document() -> None:
    service = opened(QUERY)
    (found,) = ask(service, "selectionRange", positions=[{"line": 4, "character": 9}])
    (document,) = service.documents.values()
    texts = []
    while found:
        start, end = document.offset(found["range"]["start"]), document.offset(found["range"]["end"])
        texts.append(document.source.text[start:end])
        found = found.get("parent")
    assert texts[0] == "size"
    assert texts[-1] == QUERY
    assert all(inner in outer and inner != outer for inner, outer in pairwise(texts))


def test_imports_of_files_are_links() -> None:
    (link,) = ask(opened(QUERY, a_metamodel=METAMODEL), "documentLink")
    assert link["target"] == "memory:///a.metamodel"
    assert ask(opened(QUERY), "documentLink") == []


def test_only_lines_that_change_are_edited() -> None:
    service = opened(QUERY.replace("    Box", "  Box"))
    edits = ask(service, "formatting")
    assert [one["range"]["start"]["line"] for one in edits] == [4]
    assert edited(service, edits) == QUERY


def test_a_file_with_mistakes_is_not_formatted() -> None:
    assert ask(opened(QUERY.replace("    Box", "  Box") + "\npattern {\n"), "formatting") == []


def test_a_range_is_formatted_alone() -> None:
    one = "pattern a(x:A){A(x);}\n"
    service = opened(one + "\n" + one)
    there = {"start": {"line": 2, "character": 0}, "end": {"line": 2, "character": 1}}
    assert edited(service, ask(service, "rangeFormatting", range=there)) == one + "\npattern a(x : A) { A(x); }\n"


@pytest.mark.parametrize("path", BUNDLED, ids=lambda path: path.name)
def test_bundled_files_are_read_in_parts_as_a_whole(path: Path) -> None:
    text = path.read_text("utf-8")
    squeezed = text.replace("    ", "  ")
    service = opened(squeezed, path.name)
    language = language_of(path.name)
    assert language is not None
    assert edited(service, ask(service, "formatting")) == format_text(language, squeezed)
    names = coloured(service, ask(service, "semanticTokens/full")["data"])
    assert len(names) > 20
