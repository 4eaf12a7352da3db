"""Every construct of the query language as text, on a small harbour: the rows are known, and the matchers agree.

The queries are the golden files `constructs_*.query`; `query_language.txt` has their rows on `harbour.model`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from itertools import product
from pathlib import Path

import pytest

from envgraph.lang import open as open_files
from envgraph.match import FREE, CompiledMatcher, Matcher
from envgraph.pattern import Library, ObjectType
from envgraph.rewrite import Engine
from tests.oracle.naive._naive import NaiveMatcher
from tests.unit.match.kinds import Kind, assert_sound, watched

GOLDEN = Path(__file__).parent.parent / "golden"
FILES = sorted(path.stem for path in (GOLDEN / "query").glob("constructs_*.query"))
EXPECTED = {
    name.strip(): rows.strip()
    for name, _, rows in (
        line.partition("=") for line in (Path(__file__).parent / "query_language.txt").read_text("utf-8").splitlines()
    )
}
MATCHERS: list[Kind] = [CompiledMatcher, NaiveMatcher, watched]

Row = tuple[object, ...]


@cache
def names_in(file: str) -> list[str]:
    """The patterns of a file."""
    return [pattern.name for pattern in engine_of(file).library.patterns if pattern.package == "harbour"]


def engine_of(file: str) -> Engine:
    return open_files(GOLDEN / "query" / f"{file}.query", GOLDEN / "shared" / "harbour.model")


def rows_of(matcher: Matcher, library: Library, pattern: str, arguments: Row) -> str:
    """The rows as in the file of expected ones: objects by their names, other values as in Python."""
    types = library.parameter_types(pattern)
    rows = [
        " ".join(
            getattr(matcher.model.node(value), "name", "port") if isinstance(type_, ObjectType) else repr(value)
            for value, type_ in zip(row, types, strict=True)
        )
        for row in matcher.rows(pattern, arguments)
    ]
    assert len(set(rows)) == len(rows), "a row is reported twice"
    return " | ".join(sorted(rows))


@pytest.mark.parametrize("make", MATCHERS)
@pytest.mark.parametrize("file", FILES)
def test_each_query_construct_has_the_expected_rows(file: str, make: Kind) -> None:
    engine = engine_of(file)
    matcher = make(engine.model, engine.library)
    for name in names_in(file):
        if engine.library.inputs(f"harbour.{name}"):
            continue
        free = (FREE,) * len(engine.library.parameter_types(f"harbour.{name}"))
        found = rows_of(matcher, engine.library, f"harbour.{name}", free)
        assert (name, found) == (name, EXPECTED[f"{file}.{name}"])


def values_of(engine: Engine, pattern: str, rows: list[Row]) -> list[Row]:
    """Rows to take bound values from: the first and last match, and one of other objects."""
    types = engine.library.parameter_types(pattern)
    nodes = [node for cls in engine.model.metamodel.classes for node in engine.model.graph.exact_extent(cls)]
    others = tuple(nodes[-1] if isinstance(type_, ObjectType) else 60 for type_ in types)
    fits = all(isinstance(type_, ObjectType) or str(type_) == "int" for type_ in types)
    return [*rows[:1], *rows[-1:], *([others] if fits else [])]


def edits_of(engine: Engine) -> list[Callable[[], object]]:
    """Changes of the harbour, to be made one after the other; the first one is none."""
    ada, cyd, dan = (engine.model[name] for name in ("ada", "cyd", "dan"))
    return [
        lambda: None,
        lambda: setattr(dan, "at", ada.at),
        lambda: setattr(ada, "length", 60),
        lambda: engine.model.graph.delete(cyd.id, "spo"),
        lambda: ada.at.next.remove(ada.at),
    ]


@pytest.mark.parametrize("file", FILES)
def test_the_matchers_agree_on_every_binding_before_and_after_edits(file: str) -> None:
    engine = engine_of(file)
    compiled, naive, views = (make(engine.model, engine.library) for make in MATCHERS)
    for edit in edits_of(engine):
        edit()
        for name in names_in(file):
            assert_agree(engine, (compiled, views), naive, f"harbour.{name}")
        assert_sound(views)


def assert_agree(engine: Engine, matchers: Sequence[Matcher], naive: Matcher, pattern: str) -> None:
    size, needed = len(engine.library.parameter_types(pattern)), engine.library.inputs(pattern)
    everything = list(naive.rows(pattern, (FREE,) * size)) if not needed else []
    for values in values_of(engine, pattern, everything):
        for mask in product((False, True), repeat=size):
            arguments = tuple(value if given else FREE for value, given in zip(values, mask, strict=True))
            if all(mask[position] for position in needed):
                expected = list(naive.rows(pattern, arguments))
                for matcher in matchers:
                    assert sorted(matcher.rows(pattern, arguments)) == expected
                    assert matcher.exists(pattern, arguments) is bool(expected)


def test_every_expected_result_belongs_to_a_query_of_the_files() -> None:
    known = {f"{file}.{name}" for file in FILES for name in names_in(file)}
    assert set(EXPECTED) <= known


@pytest.mark.parametrize("file", FILES)
def test_views_of_every_construct_are_updated_by_edits_and_rollbacks(file: str) -> None:
    engine = engine_of(file)
    naive = NaiveMatcher(engine.model, engine.library)
    watchable = [
        f"harbour.{name}"
        for name in names_in(file)
        if not engine.library.inputs(f"harbour.{name}") and engine.library.get(f"harbour.{name}").strategy != "search"
    ]
    engine.watch(*watchable)
    before = snapshot(engine.matcher, engine.library, watchable)
    savepoint = engine.model.graph.history.savepoint()
    for edit in edits_of(engine):
        edit()
        found = snapshot(engine.matcher, engine.library, watchable)
        expected = snapshot(naive, engine.library, watchable)
        assert {name: sorted(rows) for name, rows in found.items()} == expected
    engine.model.graph.history.rollback(savepoint)
    assert snapshot(engine.matcher, engine.library, watchable) == before


def snapshot(matcher: Matcher, library: Library, patterns: list[str]) -> dict[str, list[Row]]:
    """The rows of patterns, in order."""
    return {name: list(matcher.rows(name, (FREE,) * len(library.parameter_types(name)))) for name in patterns}
