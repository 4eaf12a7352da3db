"""Documents are opened, changed and closed, and their problems are sent."""

from __future__ import annotations

from pathlib import Path

import pytest

from envgraph.errors import InvalidArgument
from tests.editing import Editor, place

METAMODEL = "metamodel shop\nclass Box {\n    int size\n}\n"
QUERY = 'import "a.metamodel"\n\npattern big(b : Box) {\n    Box.size(b, n);\n    check n > 3;\n}\n'


def test_an_edited_text_counts_before_it_is_saved(tmp_path: Path) -> None:
    (tmp_path / "a.metamodel").write_text(METAMODEL, "utf-8")
    (tmp_path / "a.query").write_text(QUERY, "utf-8")
    editor, uri = Editor(folder=tmp_path), (tmp_path / "a.metamodel").as_uri()
    editor.open(uri, METAMODEL.replace("size", "weight"))
    assert editor.codes((tmp_path / "a.query").as_uri()) == ["unknown-feature"]
    editor.service.answer("textDocument/didClose", {"textDocument": {"uri": uri}})
    assert editor.shown == {(tmp_path / "a.query").as_uri(): []}


def test_changes_are_applied_one_after_the_other_in_utf_16() -> None:
    editor = Editor({"a.metamodel": METAMODEL})
    editor.open("memory:///a.query", "// \N{GRINNING FACE} x\r\n" + QUERY)
    assert editor.shown == {}
    word = {"start": place(0, 3), "end": place(0, 5)}
    line = {"start": place(4, 13), "end": place(4, 14)}
    editor.change("memory:///a.query", {"range": word, "text": ""}, {"range": line, "text": "\N{GRINNING FACE}c"})
    assert editor.service.documents["memory:///a.query"].source.text.startswith("//  x\r\nimport")
    (first, *_) = editor.shown["memory:///a.query"]
    assert first["range"] == {"start": place(4, 13), "end": place(4, 15)}
    editor.change("memory:///a.query", {"text": QUERY})
    assert editor.codes("memory:///a.query") == []


def test_notes_become_related_places_and_hints_are_shown() -> None:
    editor = Editor({})
    editor.open("memory:///a.metamodel", "metamodel shop\nclass Box\nclass Box\n")
    (problem,) = editor.shown["memory:///a.metamodel"]
    assert problem["relatedInformation"][0]["location"]["range"]["start"] == place(1, 6)
    assert problem["message"].endswith(f"\nhint: {problem['data']['hint']}")
    assert problem["severity"] == 1


def test_what_is_not_used_is_marked_as_unnecessary() -> None:
    editor = Editor({"a.metamodel": METAMODEL})
    editor.open("memory:///a.query", QUERY + "private pattern unused(b : Box) {\n    Box(b);\n}\n")
    assert [(one["code"], one["tags"]) for one in editor.shown["memory:///a.query"]] == [
        ("unused-private-pattern", [1])
    ]


def test_files_that_other_programs_change_are_read_again(tmp_path: Path) -> None:
    (tmp_path / "a.query").write_text(QUERY, "utf-8")
    editor, uri = Editor(folder=tmp_path), (tmp_path / "a.query").as_uri()
    editor.open(uri, QUERY)
    assert editor.codes(uri) == ["missing-file"]
    (tmp_path / "a.metamodel").write_text(METAMODEL, "utf-8")
    changes = [{"uri": (tmp_path / "a.metamodel").as_uri(), "type": 1}]
    editor.service.answer("workspace/didChangeWatchedFiles", {"changes": changes})
    editor.service.check()
    assert editor.codes(uri) == []


def test_a_text_that_was_never_saved_is_checked() -> None:
    editor = Editor({"a.metamodel": METAMODEL})
    editor.open("untitled:Untitled-1", QUERY.replace("Box.size", "Box.weight"), "query")
    assert editor.codes("untitled:Untitled-1") == ["unknown-feature"]


def test_a_file_outside_of_the_folders_is_checked_with_its_imports_alone(tmp_path: Path) -> None:
    (tmp_path / "a.metamodel").write_text(METAMODEL, "utf-8")
    (tmp_path / "b.metamodel").write_text(METAMODEL.replace("size", "weight"), "utf-8")
    editor, uri = Editor(folder=tmp_path / "folder"), (tmp_path / "a.query").as_uri()
    editor.open(uri, QUERY)
    assert editor.shown == {}
    event = {"added": [{"uri": tmp_path.as_uri(), "name": "all"}], "removed": []}
    (tmp_path / "a.query").write_text(QUERY, "utf-8")
    editor.service.answer("workspace/didChangeWorkspaceFolders", {"event": event})
    editor.service.check()
    assert editor.codes((tmp_path / "b.metamodel").as_uri()) == ["two-metamodels"]


def test_unknown_methods_and_documents_are_refused() -> None:
    editor = Editor({})
    with pytest.raises(InvalidArgument, match="there is no method `textDocument/hovr`; did you mean"):
        editor.service.answer("textDocument/hovr", {})
    with pytest.raises(InvalidArgument, match=r"`memory:///a.query` is not open"):
        editor.service.answer("textDocument/didClose", {"textDocument": {"uri": "memory:///a.query"}})
