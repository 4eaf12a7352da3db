"""Random mistakes in real files: nothing but diagnostics comes of them, all with a position, soon."""

from pathlib import PurePosixPath
from time import process_time

import pytest
from hypothesis import given, strategies as st

from envgraph.errors import LoadError
from envgraph.lang import TextFiles, data_path, load_workspace
from tests.reading import load_family

DOMAIN = data_path("rules", "burning_forest")
TEXTS = {path.name: path.read_text(encoding="utf-8") for path in sorted(DOMAIN.glob("*.*"))}
LANGUAGE_FILES = [name for name in TEXTS if PurePosixPath(name).suffix != ".toml"]
BRACKETS = ["{", "}", "(", ")", "[", "]", '"', '"""', "'", "/*", "*/", "//", "#"]
SIGNS = [";", ",", "=", ":", "::", "..", "->", "-", "@", "\\", "\x00", "é", "🔥", "9" * 30, "", "\n", " "]
WORDS = [
    "none",
    "class",
    "pattern",
    "rule",
    "lhs",
    "modify",
    "action",
    "find",
    "neg",
    "Tile",
    "truck",
    "nope",
]
PIECES = [*BRACKETS, *SIGNS, *WORDS, "^class", "0", "7x", "1e999"]

Edit = tuple[float, float, str]


def edited(text: str, edits: list[Edit]) -> str:
    """Each edit replaces a stretch (both ends as shares of the text) by a piece."""
    for start, length, piece in edits:
        first = int(start * len(text))
        last = first + int(length * length * length * (len(text) - first))
        text = text[:first] + piece + text[last:]
    return text


EDITS = st.lists(
    st.tuples(st.floats(0, 1), st.one_of(st.just(0.0), st.floats(0, 1)), st.sampled_from(PIECES)),
    min_size=1,
    max_size=6,
)


@given(st.sampled_from(LANGUAGE_FILES), EDITS)
def test_mistakes_in_a_file_are_diagnosed_with_positions(name: str, edits: list[Edit]) -> None:
    texts = TEXTS | {name: edited(TEXTS[name], edits)}
    started = process_time()
    workspace = load_workspace([name], files=TextFiles(texts))
    for diagnostic in workspace.diagnostics:
        assert diagnostic.span is not None
        assert 0 <= diagnostic.span.start <= diagnostic.span.end <= len(diagnostic.span.source.text)
        assert str(diagnostic).startswith(f"{diagnostic.span.source.name}:")
    assert sum(1 for one in workspace.diagnostics) <= 2000
    assert process_time() - started < 5


@given(EDITS)
def test_mistakes_in_a_family_file_are_diagnosed_with_positions(edits: list[Edit]) -> None:
    texts = TEXTS | {"paper.toml": edited(TEXTS["paper.toml"], edits)}
    try:
        load_family("paper.toml", TextFiles(texts))
    except LoadError as error:
        assert error.diagnostics
        assert all(one.span is not None and one.span.source.name == "paper.toml" for one in error.diagnostics)


@given(st.sampled_from(["metamodel", "model", "query", "rules", "environment"]), st.text(max_size=80))
def test_diagnostics_of_random_texts_have_spans(language: str, text: str) -> None:
    workspace = load_workspace([f"a.{language}"], files=TextFiles({f"a.{language}": text}))
    assert all(one.span is not None for one in workspace.diagnostics)


@pytest.mark.parametrize(
    "text",
    [
        "model m : m { a : A { x = " + "[" * 5000,
        "model m : m { a : A " + "{ x = B " * 3000,
        "model m : m { " + "a : A { } " * 3000,
        "model m : m { " + "a A { } " * 2000,
        "model m : m { a : A { x = " + "-" * 3000,
        "/*" * 5000,
        '"' * 5001,
        "}" * 5000,
        "import " * 3000,
    ],
    ids=["brackets", "nesting", "objects", "mistakes", "signs", "comments", "quotes", "closing", "imports"],
)
def test_hostile_texts_are_read_within_the_time_limit(text: str) -> None:
    started = process_time()
    workspace = load_workspace(["a.model"], files=TextFiles({"a.model": text}))
    assert workspace.errors
    assert len(workspace.errors) <= 3100
    assert process_time() - started < 5


@pytest.mark.parametrize("operator", ["? 1 :", "==", "<", "+ -(1"])
def test_nested_expressions_are_refused_rather_than_overflowing_the_stack(operator: str) -> None:
    text = "package a\npattern p(x : X) { check(" + f"1 {operator} " * 3000 + "1 > 0); X(x); }"
    workspace = load_workspace(["a.query"], files=TextFiles({"a.query": text}))
    assert any(one.code == "nested-too-deeply" for one in workspace.errors)


def test_a_model_of_thousands_of_objects_is_read_within_the_time_limit() -> None:
    # 4,000 objects took a minute when every statement was compared with all before it; now it is a second.
    objects = "\n".join(f"b{i} : Box {{ size = {i} links = [b{i // 2}, b{(i + 1) % 4000}] }}" for i in range(4000))
    texts = {
        "m.metamodel": "metamodel m class Box { int size refers Box[0..*] links }",
        "a.model": f'import "m.metamodel" model a : m {{ {objects} }}',
    }
    started = process_time()
    workspace = load_workspace(["a.model"], files=TextFiles(texts))
    assert process_time() - started < 15
    assert not workspace.errors
