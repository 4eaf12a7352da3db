"""Texts that are half-written, cut or damaged are answered without an exception other than a refusal."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from random import Random

import pytest

from envgraph.editor._language_service import METHODS
from envgraph.editor._mentions import mentions_of
from envgraph.errors import EnvgraphError, Source
from envgraph.lang import bundled_domains, language_of, text_parts
from tests.editing import MEMORY, Editor, domain_texts
from tests.profile import NIGHTLY

SIGNS = [
    "{",
    "}",
    "(",
    ")",
    ";",
    "\N{GRINNING FACE}",
    '"',
    "/*",
    "^",
    "::",
    "find ",
    "\r\n",
    "\ud800",
    "@",
    "\0",
    '"""',
]
QUESTIONS = [
    one
    for one in METHODS
    if one.startswith("textDocument/") and "did" not in one and "Formatting" not in one and "range" not in one
]


def damaged(text: str, random: Random) -> str:
    """Return a prefix of a text, or the text without or with some characters, or with other line ends."""
    start = random.randrange(len(text) + 1)
    match random.randrange(4):
        case 0:
            return text[:start]
        case 1:
            return text[:start] + text[start + random.randrange(1, 30) :]
        case 2:
            return text[:start] + random.choice(SIGNS) + text[start:]
    return text.replace("\n", "\r\n")


@pytest.mark.parametrize("domain", bundled_domains() if NIGHTLY else ["railway", "triage"])
def test_damaged_texts_are_answered(domain: str) -> None:
    texts, random = domain_texts(domain), Random(domain)
    editor = Editor(texts)
    for name in texts:
        for _ in range(30 if NIGHTLY else 1):
            uri, text = MEMORY + name, damaged(texts[name], random)
            editor.open(uri, text)
            text = editor.service.documents[uri].source.text
            offset = random.randrange(len(text) + 1)
            for method in QUESTIONS:
                more = {"newName": "zz", "context": {"diagnostics": []}, "positions": [], "range": {}}
                whole = {"start": {"line": 0, "character": 0}, "end": {"line": 9, "character": 0}}
                with suppress(EnvgraphError):
                    editor.ask(method.removeprefix("textDocument/"), uri, offset, **(more | {"range": whole}))
            with suppress(EnvgraphError):
                editor.service.answer("envgraph/preview", {"uri": uri})
            editor.service.answer("textDocument/didClose", {"textDocument": {"uri": uri}})


def test_positions_after_the_end_are_moved_to_the_end() -> None:
    editor = Editor({"a.metamodel": "metamodel a\nclass B"})
    editor.open(MEMORY + "a.metamodel", "metamodel a\r\nclass B")
    wide = {"start": {"line": 7, "character": 3}, "end": {"line": 90, "character": 0}}
    editor.change(MEMORY + "a.metamodel", {"range": wide, "text": " { int size }"})
    wide = {"start": {"line": 0, "character": 99}, "end": {"line": 0, "character": 99}}
    editor.change(MEMORY + "a.metamodel", {"range": wide, "text": ";"})
    assert editor.service.documents[MEMORY + "a.metamodel"].source.text == "metamodel a;\r\nclass B { int size }"
    assert editor.codes(MEMORY + "a.metamodel") == []


def test_names_are_found_in_all_texts_with_mistakes() -> None:
    """The golden tests have a text for each mistake that people make."""
    golden = Path(__file__).parents[2] / "golden"
    names = [one for one in sorted(golden.rglob("*")) if one.is_file() and language_of(one.name)]
    for one in names:
        for part in text_parts(Source(one.name, one.read_text(encoding="utf-8"))):
            mentions_of(part)
    assert len(names) > 100
