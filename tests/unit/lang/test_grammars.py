"""Grammars: what is common to all, with a small grammar of its own, and parsers that are kept in the cache."""

from __future__ import annotations

import shutil
from pathlib import Path
from time import process_time

import pytest
from lark import Lark, Token
from lark.exceptions import GrammarError

from envgraph.errors import Source
from envgraph.files import CACHE_VARIABLE
from envgraph.lang import bundled_domain, data_path
from envgraph.lang.syntax._grammar import RECOVERY_RULES, Grammar, build_grammar, load_grammar
from envgraph.lang.syntax._parser import (
    ParseResult,
    annotation_of,
    parse_tokens,
    select_tokens,
    select_trees,
    span_of,
)
from envgraph.metamodel import Annotation

GRAMMAR = """
%import .common (NAME, INT, FLOAT, LONG, STRING, TEXT, SIGN, WHITESPACE, LINE_COMMENT, BLOCK_COMMENT)
%import .common (annotation, annotation_argument, annotation_value)
%ignore WHITESPACE
%ignore LINE_COMMENT
%ignore BLOCK_COMMENT

start: statement*
statement: annotation* "let" NAME "=" value* ";"
         | "less" value "<" value ";"
         | "arrow" NAME "<-" NAME ";"
?value: NAME | INT | FLOAT | LONG | STRING | TEXT | "in" -> in | "-" value -> minus
"""


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Grammar:
    directory = tmp_path_factory.mktemp("grammars")
    (directory / "common.lark").write_text(data_path("grammars", "common.lark").read_text())
    (directory / "small.lark").write_text(GRAMMAR)
    return build_grammar("small", directory / "small.lark", ("statement",))


def parsed(small: Grammar, text: str) -> ParseResult:
    return parse_tokens(small, Source("t", text))[0]


def values(small: Grammar, text: str) -> list[str]:
    """The values of a statement without errors."""
    result = parsed(small, text)
    assert not result.diagnostics, result.diagnostics[0]
    assert result.tree is not None
    return [str(value) for value in select_trees(result.tree.children)[0].children[1:] if isinstance(value, Token)]


def messages(small: Grammar, text: str) -> list[str]:
    return [f"{one.span.line}:{one.span.column} {one.message}" for one in parsed(small, text).diagnostics if one.span]


@pytest.mark.parametrize("language", sorted(RECOVERY_RULES))
def test_grammars_have_no_conflicts_and_are_built_quickly(language: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, "off")  # what has been kept says nothing about building
    started = process_time()
    path = data_path("grammars", f"{language}.lark")
    built = build_grammar(language, path, RECOVERY_RULES[language])  # a conflict raises
    assert process_time() - started < 2.0  # processor time; a table that explodes takes far longer
    assert set(RECOVERY_RULES[language]) <= {*built.states._names.values()}  # parsing can resume after each of them


@pytest.mark.parametrize("language", sorted(RECOVERY_RULES))
def test_grammars_are_built_once(language: str) -> None:
    assert load_grammar(language) is load_grammar(language)


def test_conflicts_in_a_grammar_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "bad.lark"
    path.write_text('start: a b\na: "y"*\nb: "y"*\n')
    with pytest.raises(GrammarError, match="conflict"):
        build_grammar("bad", path)


def test_strings_are_unquoted_and_unescaped(small: Grammar) -> None:
    text = r"""let a = "x" 'y' "a\"b" 'it\'s' "\n\t\\" "\u00e9" "";"""
    assert values(small, text) == ["x", "y", 'a"b', "it's", "\n\t\\", "é", ""]


def test_multi_line_strings_are_not_unescaped(small: Grammar) -> None:
    assert values(small, 'let a = """one\n "two" \\n""";') == ['one\n "two" \\n']


def test_numbers_keep_their_kind(small: Grammar) -> None:
    result = parsed(small, "let a = 1 2.5 1e3 3l 0 007;")
    assert result.tree is not None
    kinds = [token.type for token in select_tokens(select_trees(result.tree.children)[0].children)[1:]]
    assert kinds == ["INT", "FLOAT", "FLOAT", "LONG", "INT", "INT"]


def test_a_keyword_is_a_name_where_no_keyword_is_expected(small: Grammar) -> None:
    assert values(small, "let let = less arrow;") == ["less", "arrow"]


def test_a_keyword_is_preferred_to_a_name_where_both_are_expected(small: Grammar) -> None:
    result = parsed(small, "let a = in;")
    assert result.tree is not None
    assert [tree.data for tree in select_trees(select_trees(result.tree.children)[0].children)] == ["in"]


def test_an_escaped_keyword_is_a_name(small: Grammar) -> None:
    assert values(small, "let a = ^in ^other;") == ["in", "other"]
    result = parsed(small, "let a = ^in;")
    assert result.tree is not None
    token = select_tokens(select_trees(result.tree.children)[0].children)[1]
    assert span_of(result.source, token).text == "^in"


def test_adjacent_words_and_numbers_need_a_blank(small: Grammar) -> None:
    assert messages(small, "leta = 1;")[0] == "1:1 unexpected `leta`"
    assert messages(small, "let a = 3steps;") == ["1:9 `3steps` is neither a number nor a name"]
    assert messages(small, "let a = 1.5x 2;") == ["1:9 `1.5x` is neither a number nor a name"]


def test_a_long_operator_is_split_only_where_only_its_parts_fit(small: Grammar) -> None:
    assert not messages(small, "less a <-b; arrow a <- b;")


def test_comments_are_skipped(small: Grammar) -> None:
    assert values(small, "// x\nlet /* y\n * z */ a = 1 // 2\n;") == ["1"]
    assert values(small, "let a = 1; /**/ // /* \n") == ["1"]


def test_doc_comments_belong_to_the_definition_that_follows(small: Grammar) -> None:
    text = "/** First.\n *\n * More. */\nlet a = 1;\nlet b = 2;\n"
    text += "/** Third. */ @x let c = 3;\n@y /** Fourth. */ let d = 4;"
    result = parsed(small, text)
    assert result.tree is not None
    docs = [result.doc_comment(tree) for tree in select_trees(result.tree.children)]
    assert docs == ["First.\n\nMore.", None, "Third.", "Fourth."]


def test_annotations_become_data(small: Grammar) -> None:
    text = '@a @b() @c(1, -2.5, "s", true, name) @d(k = 1, l = {x, y}) let a = 1;'
    result = parsed(small, text)
    assert not result.diagnostics and result.tree is not None
    found = select_trees(select_trees(result.tree.children)[0].children, "annotation")
    assert [annotation_of(result.source, tree) for tree in found] == [
        Annotation("a"),
        Annotation("b"),
        Annotation("c", (1, -2.5, "s", True, "name")),
        Annotation("d", (), (("k", 1), ("l", "x"), ("l", "y"))),
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('let a = "x;\nlet b = 1;', "1:9 the string is not closed on its line"),
        ("let a = 'x;\nlet b = 1;", "1:9 the string is not closed on its line"),
        ('let a = """x;\nlet b = 1;', "1:9 the text is not closed"),
        ("let a = 1; /* x\nlet b = 1;", "1:12 the comment is not closed"),
        ("let a = 1 § 2; let b = 1;", "1:11 `§` is not allowed here"),
        ("let a = \x00;", "1:9 `\\x00` is not allowed here"),
        (r'let a = "\q";', r"1:10 `\q` is not an escape sequence"),
        (r'let a = "\ud800";', r"1:10 `\ud800` is not an escape sequence"),
        ("let a = 1e999;", "1:9 the number is too large"),
        ("let a = " + "9" * 5000 + ";", "1:9 the number is too large"),
    ],
)
def test_each_spelling_mistake_is_one_diagnostic(small: Grammar, text: str, message: str) -> None:
    assert messages(small, text) == [message]


def test_parsing_resumes_after_the_semicolon(small: Grammar) -> None:
    result = parsed(small, "let a = = 1; let b = 2; less less; let c = 3;")
    assert [one.message for one in result.diagnostics] == ["unexpected `=`", "unexpected `;`"]
    assert result.tree is not None
    assert [str(tree.children[0]) for tree in select_trees(result.tree.children)] == ["b", "c"]


def test_a_misspelled_keyword_is_parsed_as_the_keyword_meant(small: Grammar) -> None:
    result = parsed(small, "lett a = 1;\narow b <- c;")
    assert [one.hint for one in result.diagnostics] == ["did you mean `let`?", "did you mean `arrow`?"]
    assert result.tree is not None
    assert len(select_trees(result.tree.children)) == 2


def test_a_missing_separator_is_reported_where_it_belongs(small: Grammar) -> None:
    assert messages(small, "arrow a <- b\narrow c <- d;") == ["1:13 missing `;`"]


def test_names_in_skipped_text_are_recorded(small: Grammar) -> None:
    assert {"a", "b"} <= parsed(small, "let a = = b;").lost_names


def test_deep_nesting_is_an_error(small: Grammar) -> None:
    assert [one.split(" ", 1)[1] for one in messages(small, "let a = " + "- " * 500 + "1;")] == [
        "this is nested too deeply to be read"
    ]


def test_errors_at_the_end_of_the_text_have_a_position(small: Grammar) -> None:
    assert messages(small, "let a = 1") == ["1:10 unexpected end of the file"]
    assert messages(small, "let a = 1\n") == ["2:1 unexpected end of the file"]


def test_spans_count_characters_of_the_text(small: Grammar) -> None:
    result = parsed(small, 'let é = "🔥" = ;')
    assert [one.span.column for one in result.diagnostics if one.span] == [13]


# --- parsers in the cache: those that Lark builds, built anew whenever the file is not what it should be

GRAMMARS = data_path("grammars")
TEXTS = {path.suffix[1:]: path.read_text(encoding="utf-8") for path in bundled_domain("keydoor").glob("*.*")}


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ENVGRAPH_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def lark_calls(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Notes what Lark builds."""
    names: list[str] = []
    make = Lark.__init__

    def noted(self: Lark, grammar: object, **options: object) -> None:
        names.append(Path(str(getattr(grammar, "name", ""))).stem)
        make(self, grammar, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(Lark, "__init__", noted)
    return names


def read_grammar(language: str, directory: Path = GRAMMARS) -> Grammar:
    """Return the grammar of a language, with the parser of the cache if there is one."""
    return build_grammar(language, directory / f"{language}.lark", RECOVERY_RULES[language])


@pytest.mark.parametrize("language", sorted(RECOVERY_RULES))
def test_a_cached_parser_gives_the_same_tree_and_diagnostics(language: str, cache: Path, lark_calls: list[str]) -> None:
    source = Source(f"a.{language}", TEXTS[language])
    damaged = Source(f"a.{language}", TEXTS[language].replace("}", "", 3).replace(";", "", 1))
    first, second = read_grammar(language), read_grammar(language)
    assert lark_calls == [language]
    for text in (source, damaged):
        (one, _), (other, _) = parse_tokens(first, text), parse_tokens(second, text)
        assert one.tree == other.tree
        assert list(map(str, one.diagnostics)) == list(map(str, other.diagnostics))


@pytest.mark.parametrize("content", [b"", b"{", b"[1]", b'{"key": 1}', b"\xff", b"null"])
def test_a_damaged_cache_file_is_replaced(content: bytes, cache: Path, lark_calls: list[str]) -> None:
    read_grammar("model")
    (cache / "grammar-model").write_bytes(content)
    read_grammar("model")
    read_grammar("model")
    assert lark_calls == ["model", "model"]


def test_cache_files_that_are_outdated_or_incomplete_are_not_used(
    cache: Path, lark_calls: list[str], tmp_path: Path
) -> None:
    shutil.copytree(data_path("grammars"), tmp_path / "grammars")
    read_grammar("model", tmp_path / "grammars")
    common = tmp_path / "grammars" / "common.lark"
    common.write_text(common.read_text() + "\n// another one\n")
    read_grammar("model", tmp_path / "grammars")
    assert lark_calls == ["model", "model"]
    kept = cache / "grammar-model"
    kept.write_bytes(kept.read_bytes()[:-1])
    read_grammar("model", tmp_path / "grammars")
    assert lark_calls == ["model", "model", "model"]


def test_a_cache_file_of_another_language_is_not_used(cache: Path, lark_calls: list[str]) -> None:
    read_grammar("model")
    read_grammar("query")
    shutil.copy(cache / "grammar-query", cache / "grammar-model")
    read_grammar("model")
    assert lark_calls == ["model", "query", "model"]


def test_nothing_is_cached_if_caching_is_off(
    cache: Path, monkeypatch: pytest.MonkeyPatch, lark_calls: list[str]
) -> None:
    monkeypatch.setenv("ENVGRAPH_CACHE", "off")
    read_grammar("model")
    read_grammar("model")
    assert lark_calls == ["model", "model"] and not cache.exists()
