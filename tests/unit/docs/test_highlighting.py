"""The lexers of the documentation colour the languages as the parser reads them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from highlighting import LEXERS
from language_tokens import tokens_of
from pygments.token import Comment, Error, Keyword, Name, Number, String

from envgraph.errors import Source
from envgraph.lang import LANGUAGES
from envgraph.lang.syntax._parser import parse

ROOT = Path(__file__).parents[3]
FENCE = re.compile(r"^( *)```(\w+)[^\n`]*\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)


def coloured(language: str, text: str) -> list[tuple[str, object]]:
    """Return the tokens of a text without white space, each with its kind."""
    return [(piece, kind) for _, kind, piece in LEXERS[language]().get_tokens_unprocessed(text) if piece.strip()]


def names_at(language: str, text: str) -> set[int]:
    """Return the positions of the words that are coloured as names."""
    tokens = LEXERS[language]().get_tokens_unprocessed(text)
    return {at for at, kind, piece in tokens if kind in Name and piece != "@"}


def test_every_language_has_a_lexer() -> None:
    assert set(LEXERS) == set(LANGUAGES)


@pytest.mark.parametrize("language", LEXERS)
def test_every_keyword_is_coloured_as_a_keyword(language: str) -> None:
    keywords = re.findall(r'"([A-Za-z]\w*)"', (ROOT / "grammars" / f"{language}.lark").read_text("utf-8"))
    assert len(keywords) > 10
    for word in keywords:
        ((piece, kind),) = coloured(language, word)
        assert piece == word
        assert kind in Keyword


@pytest.mark.parametrize("language", LEXERS)
def test_words_of_bundled_files_are_names_where_the_parser_reads_names(language: str) -> None:
    paths = sorted((ROOT / "rules").rglob(f"*.{language}"))
    assert len(paths) > 10
    for path in paths:
        text = path.read_text("utf-8")
        tree = parse(language, Source(str(path), text)).tree
        assert tree is not None
        tokens = tree.scan_values(lambda token: token is not None and token.type == "NAME")
        variables = [child.children[0] for child in tree.find_data("variable")]
        expected = {token.start_pos for token in (*tokens, *variables)}
        assert names_at(language, text) == expected, path


@pytest.mark.parametrize("language", LEXERS)
def test_bundled_files_and_examples_of_the_documentation_have_no_unknown_characters(language: str) -> None:
    texts = [path.read_text("utf-8") for path in (ROOT / "rules").rglob(f"*.{language}")]
    for page in (ROOT / "docs").rglob("*.md"):
        texts += [found[3] for found in FENCE.finditer(page.read_text("utf-8")) if found[2] == language]
    for text in texts:
        tokens = list(LEXERS[language]().get_tokens_unprocessed(text))
        assert [piece for _, kind, piece in tokens if kind is Error] == []
        assert "".join(piece for _, _, piece in tokens) == text


def test_numbers_strings_comments_and_annotations_have_kinds_of_their_own() -> None:
    text = '@Use(unit = "m") pattern far(c : Cell) { // long\n Cell.size(c, 2.5); /* x */ }'
    kinds = dict(coloured("query", text))
    assert kinds["Use"] is Name.Decorator
    assert kinds['"m"'] is String
    assert kinds["far"] is Name.Function
    assert kinds["Cell"] is Name.Class
    assert kinds["2.5"] is Number.Float
    assert kinds["// long"] is Comment.Single
    assert kinds["/* x */"] is Comment.Multiline


def test_unknown_characters_are_errors() -> None:
    assert dict(coloured("query", "pattern ~"))["~"] is Error


@pytest.mark.parametrize(
    ("language", "text", "name"),
    [
        ("environment", "action go(x : Cell) = move(x)", "x"),
        ("model", "Sea { row = 3 }", "row"),
        ("query", "pattern p(c : A, n) { A.size(c, count); }", "count"),
        ("metamodel", "class Enum { String class }", "class"),
        ("query", "find out.size(^check)", "^check"),
    ],
)
def test_words_where_no_keyword_can_occur_are_names(language: str, text: str, name: str) -> None:
    assert text.rindex(name) in names_at(language, text)


def test_aggregates_are_keywords_before_a_relation() -> None:
    text = "n == count find p(x); m == max A.size(x, #);"
    assert names_at("query", text).isdisjoint({text.index("count"), text.index("max")})


def test_tokens_of_the_expressions_belong_to_the_languages_that_import_them() -> None:
    assert "instanceof" in tokens_of("rules").keywords
    assert "instanceof" not in tokens_of("model").keywords
    assert "search" not in tokens_of("environment").keywords
