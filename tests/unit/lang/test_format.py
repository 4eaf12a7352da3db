"""The formatter: what it changes, what it keeps, what it refuses."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from random import Random

import pytest

from envgraph.errors import InvalidArgument, LoadError
from envgraph.lang import data_path, format_text, language_of
from tests.profile import NIGHTLY
from tests.reading import lexeme_places, read_definitions, read_metamodel_text, read_model_text, read_tree

TESTS = Path(__file__).parents[2]
LISTING = "burning_forest.query"
"""Begins with the paper's own listings, as they were printed."""


FILES = [
    path
    for root in (data_path("rules"), TESTS / "golden")
    for path in sorted(root.rglob("*"))
    if language_of(path.name) and path.is_file()
]
"""All texts of the languages in the repository."""
JUDGED = [path for path in FILES if NIGHTLY or path.name == LISTING or TESTS in path.parents]
"""By day without those that are in the style, as another test says."""


@cache
def readable(path: Path) -> bool:
    """Whether a text has no errors of syntax."""
    return read_tree(path.read_text(encoding="utf-8"), language_of(path.name) or "") is not None


def meaning(name: str, text: str) -> object:
    """The data of a text; places and what is wrong with it do not count."""
    language = language_of(name)
    assert language
    match language:
        case "query" | "rules":
            read = read_definitions(text, language)
            return read.header, read.definitions
        case "metamodel":
            metamodel = read_metamodel_text(text).metamodel
            return metamodel and (metamodel.name, metamodel.class_list, metamodel.enum_types)
        case "model":
            return [(one.name, one.metamodel) for one in read_model_text(text, None).models]
    tree = read_tree(text, language)
    assert tree is not None
    return re.sub(r"\s+", " ", str(tree))


@pytest.mark.parametrize("path", JUDGED, ids=lambda path: path.name)
def test_formatting_keeps_the_meaning_and_is_idempotent(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    if not readable(path):
        with pytest.raises(LoadError):
            format_text(language_of(path.name) or "", text)
        return
    formatted = format_text(language_of(path.name) or "", text)
    assert meaning(path.name, formatted) == meaning(path.name, text)
    assert format_text(language_of(path.name) or "", formatted) == formatted
    assert all(line == line.rstrip() for line in formatted.split("\n"))


@pytest.mark.parametrize(
    "path",
    [path for path in sorted(data_path("rules").rglob("*")) if language_of(path.name)],
    ids=lambda path: path.name,
)
def test_bundled_domains_are_in_the_style(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    formatted = format_text(language_of(path.name) or "", text)
    if path.name == LISTING:
        text, formatted = text.partition("pattern goalTile")[2], formatted.partition("pattern goalTile")[2]
    assert formatted == text


BLANKS = (" ", "  ", "\n", "\n\n", "\n   ", "\n\n\n  ", "\t")
COMMENTS = (
    "// one\n", "/* two */", "/* three\n   lines\n\n     of it */", "/** doc */", "\n// own\n", "\n /* own */\n",
    "\n\n  // apart\n\n", "/*\n * star\n * line\n */",
)  # fmt: skip


def with_random_blanks_and_comments(random: Random, language: str, text: str) -> str:
    """The text with other blanks, and with comments between any two tokens."""
    comments, blanks = random.choice((0, 0.02, 0.1)), random.choice((0, 0.05, 0.5))
    parts, end = [], 0
    for start, stop in lexeme_places(text, language):
        gap = text[end:start]
        if gap.isspace() and random.random() < blanks:
            gap = random.choice(BLANKS)
        if random.random() < comments:
            gap += random.choice(("", "", " ", "\n")) + random.choice(COMMENTS)
        parts += [gap, text[start:stop]]
        end = stop
    return "".join(parts)


@pytest.mark.parametrize("seed", range(150 if NIGHTLY else 50))
def test_files_with_any_blanks_and_comments_are_formatted(seed: int) -> None:
    random = Random(seed)
    path = next(filter(readable, iter(lambda: random.choice(FILES), None)))
    language = language_of(path.name) or ""
    text = with_random_blanks_and_comments(random, language, path.read_text(encoding="utf-8"))
    formatted = format_text(language, text)
    for comment in (
        "// one\n",
        "/* two */",
        "/* three\n",
        "of it */",
        "/** doc */",
        "// own\n",
        "/* own",
        "// apart",
        "* star\n",
    ):
        assert formatted.count(comment) == text.count(comment)
    assert meaning(path.name, formatted) == meaning(path.name, text)
    assert format_text(language, formatted) == formatted


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", ""),
        ("\n\n// only this \n\n\n", "// only this\n"),
        ("pattern p(){}", "pattern p() { }\n"),
        ("pattern p(){\nT(x);U(x);}", "pattern p() {\n    T(x);\n    U(x);\n}\n"),
        ("pattern p(){ T(x) // why\n ; U(x); }", "pattern p() {\n    T(x);  // why\n    U(x);\n}\n"),
        ("pattern p(){check(a<-1);}", "pattern p() { check(a < -1); }\n"),
        ("pattern p(){check(a- -1- -b);}", "pattern p() { check(a - -1 - -b); }\n"),
        ("pattern p(){check((a)&&(b));check (a);}", "pattern p() { check((a) && (b)); check(a); }\n"),
        ("pattern ^pattern(){T(^find);}", "pattern ^pattern() { T(^find); }\n"),
        ("pattern a(){}pattern b(){}", "pattern a() { }\npattern b() { }\n"),
        ("pattern a(){\nT(x);}pattern b(){}", "pattern a() {\n    T(x);\n}\n\npattern b() { }\n"),
        ("pattern a(){\n\n\n\nT(x);\n\n\n\nU(x);\n\n}", "pattern a() {\n    T(x);\n\n    U(x);\n}\n"),
        ("pattern a(){ T(x); }\r\n// b\r\n", "pattern a() { T(x); }\r\n// b\r\n"),
    ],
)
def test_queries_are_laid_out(text: str, expected: str) -> None:
    assert format_text("query", text) == expected


def test_aligned_columns_are_kept_and_not_introduced() -> None:
    loose = "environment E(t : T) {\n    action a = a(t)\n    action bcd = b(t)\n}\n"
    assert format_text("environment", loose) == loose
    columns = loose.replace("action a =", "action a     =")
    assert "    action a   = a(t)\n    action bcd = b(t)\n" in format_text("environment", columns)


def test_columns_are_not_aligned_if_a_line_would_get_too_long() -> None:
    call = f"find {'p' * 60}(t)"
    text = f"environment E(t : T) {{\n    on find a(t)   reward 1\n    on {call} reward {'1' * 18}.{'0' * 20}\n}}\n"
    formatted = format_text("environment", text)
    assert "    on find a(t) reward 1\n" in formatted


def test_rows_of_a_grid_keep_their_columns() -> None:
    text = 'model m : n {\n a : A { b = grid c { rows """\n      # #\n    ###\n\n    """ } }\n}\n'
    assert '            rows """\n                  # #\n                ###\n\n                """\n' in (
        format_text("model", text.replace("{ b", "{\n b").replace("{ rows", "{\nrows"))
    )


def test_a_text_with_errors_is_refused_with_all_of_them() -> None:
    with pytest.raises(LoadError) as caught:
        format_text("query", "pattern a( { T(x); }\npattern b() { find ; }", "a.query")
    assert [one.span.line for one in caught.value.diagnostics if one.span] == [1, 2]


def test_an_unknown_language_is_refused() -> None:
    with pytest.raises(InvalidArgument, match="unknown language `python`; the languages are"):
        format_text("python", "pass")


def test_unknown_names_are_formatted() -> None:
    assert format_text("rules", "rule r{lhs{x:Nothing;}}") == "rule r { lhs { x : Nothing; } }\n"


@pytest.mark.parametrize("depth", [10, 60, 97])
def test_deeply_nested_brackets_are_formatted(depth: int) -> None:
    text = f"pattern p(x : T) {{ check({'(' * depth}x{')' * depth}); }}"
    assert re.sub(r"\s", "", format_text("query", text)) == text.replace(" ", "")
