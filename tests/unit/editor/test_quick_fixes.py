"""Problems are corrected by the changes that the editor offers for them."""

from __future__ import annotations

import pickle
from functools import cache
from typing import Any

import pytest

from envgraph.cli._help_command import CodeExplanation, example_texts, load_explanations
from envgraph.editor import LanguageService
from envgraph.errors import Diagnostic, Severity
from envgraph.lang import TextFiles, load_workspace

FIXED = {
    "missing-file": "Write `maze.metamodel` in place of `maze.metamodell`",
    "missing-token": "Write `;` here",
    "no-metamodel": 'Import "maze.metamodel"',
    "stray-character": "Write `&&` in place of `&`",
    "unescaped-keyword": "Write `^in` in place of `in`",
    "unknown-annotation": "Write `weight` in place of `wait`",
    "unknown-attribute": "Write `number` in place of `numbr`",
    "unknown-choice": "Write `heavy_tailed` in place of `heavy`",
    "unknown-class": "Write `Floor` in place of `Flor`",
    "unknown-component": "Write `random` in place of `randm`",
    "unknown-key": "Write `population` in place of `populaton`",
    "unknown-measure": "Write `plan` in place of `plann`",
    "unknown-metamodel": "Write `maze` in place of `maz`",
    "unknown-object": "Write `cell` in place of `cel`",
    "unknown-rule": "Write `moveUp` in place of `moveUpp`",
    "unused-import": "Remove this import",
}
"""The codes whose examples have a correction, with its title."""
SUPPRESSED = ("used-once", "unused-parameter", "never-applicable", "homeless", "duplicate-action", "no-success")
"""Some codes of warnings whose examples are suppressed."""


@cache
def explanations() -> dict[str, CodeExplanation]:
    return load_explanations()


class FixedFile:
    """A file that is open in an editor, with the other files of its domain."""

    def __init__(self, name: str, texts: dict[str, str]) -> None:
        self.uri, self.name, self.texts = f"memory:///{name}", name, texts
        self.service = LanguageService(lambda method, params: None, TextFiles(texts))
        self.open(texts[name])

    def open(self, text: str) -> None:
        document = {"uri": self.uri, "text": text, "version": 1, "languageId": ""}
        self.service.answer("textDocument/didOpen", {"textDocument": document})

    def problems(self) -> list[Diagnostic]:
        self.service.check()
        return list(self.service.checked(self.name).problems)

    def codes(self) -> list[str]:
        return [one.code for one in self.problems()]

    def actions(self) -> dict[str, Any]:
        """Return the offered changes of the whole file by their titles."""
        self.service.check()
        everywhere = {"start": {"line": 0, "character": 0}, "end": {"line": 9999, "character": 0}}
        params = {"textDocument": {"uri": self.uri}, "range": everywhere, "context": {"diagnostics": []}}
        return {one["title"]: one for one in self.service.answer("textDocument/codeAction", params)}

    def apply(self, action: Any) -> str:
        """Open the text that a change makes, and return it."""
        document = self.service.documents[self.uri]
        text = document.source.text
        edits = action["edit"]["changes"][self.uri]
        for edit in sorted(edits, key=lambda one: document.offset(one["range"]["start"]), reverse=True):
            start, end = document.offset(edit["range"]["start"]), document.offset(edit["range"]["end"])
            text = text[:start] + edit["newText"] + text[end:]
        self.open(text)
        return text


def example_of(code: str) -> FixedFile:
    one = explanations()[code]
    return FixedFile(one.file, example_texts({**one.also, one.file: one.wrong}))


@pytest.mark.parametrize("code", FIXED)
def test_a_correction_removes_the_problem_of_its_example(code: str) -> None:
    file = example_of(code)
    assert code in file.codes()
    file.apply(file.actions()[FIXED[code]])
    assert file.codes() == []


@pytest.mark.parametrize("code", SUPPRESSED)
def test_a_warning_can_be_suppressed_where_it_is_found(code: str) -> None:
    file = example_of(code)
    before = file.codes()
    file.apply(file.actions()[f"Suppress `{code}` in this definition"])
    assert len(file.codes()) < len(before)
    assert "unused-suppress" not in file.codes()


def test_a_name_is_corrected_wherever_it_is_misspelt() -> None:
    texts = {"a.metamodel": "metamodel m\nclass Box\n", "a.query": (
        'import "a.metamodel"\n\npattern p(b : Boxx) {\n    Boxx(b);\n}\n'
    )}  # fmt: skip
    file = FixedFile("a.query", texts)
    corrected = file.apply(file.actions()["Write `Box` in place of `Boxx` in 2 places"])
    assert corrected == texts["a.query"].replace("Boxx", "Box")


def test_a_string_is_closed_before_the_signs_behind_it() -> None:
    file = FixedFile("a.metamodel", {"a.metamodel": 'metamodel m\n@glyph("L)\nclass Lamp\n'})
    assert file.codes() == ["unterminated-string"]
    assert '@glyph("L")' in file.apply(file.actions()['Write `"` here'])
    assert file.codes() == []


def test_an_import_is_added_below_the_others() -> None:
    texts = {
        "a.metamodel": "metamodel m\nclass Box\n",
        "b.query": 'import "a.metamodel"\npattern any(b : Box) {\n    Box(b);\n}\n',
        "a.query": '// A query.\npackage a\nimport "a.metamodel"\n\npattern p(b : Box) {\n    find any(b);\n}\n',
    }
    file = FixedFile("a.query", texts)
    corrected = file.apply(file.actions()['Import "b.query"'])
    assert corrected == texts["a.query"].replace('l"\n\n', 'l"\nimport "b.query"\n\n')
    assert file.codes() == []


def test_no_change_is_offered_for_a_text_that_was_edited_after_its_check() -> None:
    file = example_of("unknown-class")
    assert file.actions()
    document = file.service.documents[file.uri]
    file.open("\n" + document.source.text)
    everywhere = {"start": {"line": 0, "character": 0}, "end": {"line": 9999, "character": 0}}
    params = {"textDocument": {"uri": file.uri}, "range": everywhere, "context": {"diagnostics": []}}
    assert file.service.answer("textDocument/codeAction", params) == []


def test_fixes_survive_pickling_and_name_the_place() -> None:
    texts = {"a.metamodel": "metamodel m\nclass Box { contains Boxx[*] inner }\n"}
    problems = load_workspace(["a.metamodel"], files=TextFiles(texts)).diagnostics
    (problem,) = [one for one in problems if one.severity is Severity.ERROR]
    (edit,) = pickle.loads(pickle.dumps(problem)).fixes
    assert (edit.span.text, edit.text) == ("Boxx", "Box")
