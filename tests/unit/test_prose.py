"""Docstrings begin with a verb, names are used once, and coined words are absent."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections import defaultdict
from pathlib import Path

import pytest

from tests.sample_prose import ROOT, definitions, modules

OPENINGS = re.compile(r"(What|Whether|How|Those|One|That)\b")
"""First words of docstrings that name no verb and no thing."""

COINED = {
    "dear": "expensive",
    "hung": "subscribed",
    "joint": "joint action, or what is joined",
    "lent": "borrowed, shared",
    "plain": "pure Python, unordered, ..",
    "sieve": "distinct",
    "sight": "scope",
    "site": "occurrence, position",
    "told": "notified, reported",
    "torn": "interrupted",
    "twin": "counterpart, copy",
    "world": "model, state",
}
"""Words that this project used in a sense of its own, each with what to write."""

KNOWN_TERMS = re.compile(r"joint[ _]?(?:action|agent|reward|step)|call[ _]sites?|plain text", re.IGNORECASE)
"""Terms of the field that contain such a word."""


def coined_words(text: str) -> list[str]:
    """Return the coined words in a text or an identifier, singular and plural."""
    words = re.findall(r"[A-Z]?[a-z]+", KNOWN_TERMS.sub("", text))
    return [word for word in words if word.lower().removesuffix("s") in COINED]


def comments(path: Path) -> list[tuple[int, str]]:
    """Return the comments of a file with their lines."""
    with tokenize.open(path) as file:
        tokens = tokenize.generate_tokens(io.StringIO(file.read()).readline)
        return [(token.start[0], token.string) for token in tokens if token.type == tokenize.COMMENT]


def test_docstrings_do_not_begin_with_a_question_word_or_a_pronoun() -> None:
    found = [
        f"{path.relative_to(ROOT)}: {name}"
        for path, tree in modules()
        for name, node in [("module", tree), *definitions(tree)]
        if OPENINGS.match(ast.get_docstring(node) or "")
    ]
    assert found == []


def test_descriptions_of_constants_do_not_begin_so_either() -> None:
    """A description is a string on its own, below the constant."""
    found = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path, tree in modules()
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and OPENINGS.match(str(node.value.value))
    ]
    assert found == []


def test_docstrings_comments_and_names_have_no_coined_words() -> None:
    found = []
    for path, tree in modules():
        place = path.relative_to(ROOT)
        texts = [(line, text) for line, text in comments(path)]
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                texts.append((getattr(node, "lineno", 1), ast.get_docstring(node) or ""))
            if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                texts.append((node.lineno, node.name))
            elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                texts.append((node.lineno, node.id))
            elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
                texts.append((node.lineno, node.attr))
            elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
                texts.append((node.lineno, str(node.value.value)))
            elif isinstance(node, ast.arg):
                texts.append((node.lineno, node.arg))
        texts.append((1, path.stem))
        found += [f"{place}:{line}: {word}" for line, text in texts for word in coined_words(text)]
    assert found == []


def test_at_most_two_modules_define_a_class_of_one_name() -> None:
    homes: dict[str, list[str]] = defaultdict(list)
    for path, tree in modules():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                homes[node.name].append(str(path.relative_to(ROOT)))
    assert {name: places for name, places in homes.items() if len(places) > 2} == {}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("_twins_of", ["twins"]),
        ("WorldState", ["World"]),
        ("joint actions", []),
        ("the plain sets", ["plain"]),
    ],
)
def test_coined_words_are_found_in_names_and_sentences(text: str, words: list[str]) -> None:
    assert coined_words(text) == words
