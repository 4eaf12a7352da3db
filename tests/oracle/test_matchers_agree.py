"""The compiled matcher against the naive one, on random worlds."""

from __future__ import annotations

from itertools import product

from hypothesis import HealthCheck, given, settings

from envgraph.graph import Model
from envgraph.match import FREE, CompiledMatcher, Matcher
from envgraph.pattern import Library, ObjectType
from tests.oracle.naive._naive import NaiveMatcher
from tests.oracle.worlds import RandomCase, domain, random_cases

EXAMPLES = settings().max_examples
"""Of the profile: 50 by day, 5,000 at night."""


def many(factor: float) -> settings:
    """Settings for so many times the examples of the profile."""
    return settings(max_examples=int(factor * EXAMPLES), suppress_health_check=list(HealthCheck))


def sizes(library: Library) -> dict[str, int]:
    """Number of parameters of every pattern."""
    return {pattern.qualified_name: len(pattern.parameters) for pattern in library.patterns}


def free(size: int) -> tuple[object, ...]:
    """Arguments of a call that gives no values."""
    return (FREE,) * size


def snapshot(matcher: Matcher, library: Library) -> dict[str, list[tuple[object, ...]]]:
    """All rows of all patterns, in order."""
    return {name: list(matcher.rows(name, free(size))) for name, size in sizes(library).items()}


def candidates(world: RandomCase, pattern: str, naive: list[tuple[object, ...]]) -> list[tuple[object, ...]]:
    """Tuples to take bound values from: matches, and others of the right types."""
    columns: list[list[object]] = []
    for type_ in world.library.parameter_types(pattern):
        if isinstance(type_, ObjectType):
            columns.append([n for c in world.model.metamodel.classes for n in world.model.graph.exact_extent(c)])
        else:
            columns.append(list(domain(type_)))
    found = [world.dice.one(naive)] if naive else []
    if all(columns):
        found.append(tuple(world.dice.one(column) for column in columns))
    return found


def assert_agree(world: RandomCase, compiled: Matcher, naive: Matcher) -> None:
    """Every question about every pattern has the same answer."""
    for pattern, size in sizes(world.library).items():
        expected = list(naive.rows(pattern, free(size)))
        for question in QUESTIONS:
            question(compiled, pattern, free(size), expected)
        for values in candidates(world, pattern, expected):
            for mask in product((False, True), repeat=size):
                if not any(mask):
                    continue  # asked already
                arguments = tuple(v if bound else FREE for v, bound in zip(values, mask, strict=True))
                agreeing = [row for row in expected if agrees(row, arguments)]
                assert list(naive.rows(pattern, arguments)) == agreeing
                # Each question needs a function of its own, which takes longest: ask two of them.
                assert_rows(compiled, pattern, arguments, agreeing)
                world.dice.one(QUESTIONS)(compiled, pattern, arguments, agreeing)


Row = tuple[object, ...]


def agrees(row: Row, arguments: Row) -> bool:
    """Whether a row has the given values."""
    return all(argument is FREE or argument == value for argument, value in zip(arguments, row, strict=True))


def assert_rows(matcher: Matcher, pattern: str, arguments: Row, expected: list[Row]) -> None:
    """The rows are the expected ones, each once."""
    rows = list(matcher.rows(pattern, arguments))
    assert len(set(rows)) == len(rows), "a row is reported twice"
    assert sorted(rows) == expected


def assert_exists(matcher: Matcher, pattern: str, arguments: Row, expected: list[Row]) -> None:
    """There is a match if there should be one."""
    assert matcher.exists(pattern, arguments) is bool(expected)


def assert_count(matcher: Matcher, pattern: str, arguments: Row, expected: list[Row]) -> None:
    """There are as many matches as there should be."""
    assert matcher.count(pattern, arguments) == len(expected)


def assert_first(matcher: Matcher, pattern: str, arguments: Row, expected: list[Row]) -> None:
    """The first match is the first row."""
    rows = list(matcher.rows(pattern, arguments))
    assert matcher.first(pattern, arguments) == (rows[0] if rows else None)


def assert_prepared(matcher: Matcher, pattern: str, arguments: Row, expected: list[Row]) -> None:
    """Prepared functions give the rows in the same order."""
    bound = tuple(position for position, value in enumerate(arguments) if value is not FREE)
    values = [arguments[position] for position in bound]
    expected = list(matcher.rows(pattern, arguments))
    assert matcher.prepare(pattern, bound)(*values) == expected
    assert list(matcher.prepare_iterator(pattern, bound)(*values)) == expected


QUESTIONS = (assert_rows, assert_exists, assert_count, assert_first, assert_prepared)


@many(2)
@given(random_cases())
def test_compiled_and_naive_matcher_agree_after_every_edit(world: RandomCase) -> None:
    compiled, naive = (kind(world.model, world.library) for kind in (CompiledMatcher, NaiveMatcher))
    assert_agree(world, compiled, naive)
    for _ in range(world.dice.number(0, 2)):
        world.edit(world.dice.number(1, 5))
        assert_agree(world, compiled, naive)


@many(1)
@given(random_cases())
def test_rollback_restores_rows_and_their_order(world: RandomCase) -> None:
    compiled = CompiledMatcher(world.model, world.library)
    before = snapshot(compiled, world.library)
    savepoint = world.model.graph.history.savepoint()
    for _ in range(world.dice.number(1, 3)):
        world.edit(world.dice.number(1, 5))
        snapshot(compiled, world.library)
    world.model.graph.history.rollback(savepoint)
    assert snapshot(compiled, world.library) == before
    assert snapshot(CompiledMatcher(world.model, world.library), world.library) == before


@many(0.7)
@given(random_cases())
def test_order_of_rows_depends_only_on_the_version(world: RandomCase) -> None:
    model = world.model
    matchers = [CompiledMatcher(model, world.library)]
    versions = []
    for _ in range(3):
        world.edit(world.dice.number(1, 6))
        versions.append((model.commit(), snapshot(matchers[0], world.library)))
    for _ in range(4):
        version, expected = world.dice.one(versions)
        model.checkout(version)
        matchers.append(CompiledMatcher(model, world.library))
        for matcher in matchers:
            assert snapshot(matcher, world.library) == expected


@many(0.3)
@given(random_cases())
def test_two_matchers_generate_the_same_source(world: RandomCase) -> None:
    other = Model(world.model.metamodel)
    for pattern, size in reversed(sizes(world.library).items()):
        for bound in (tuple(range(size)), ()):
            one = CompiledMatcher(world.model, world.library)
            snapshot(one, world.library)
            assert one.source(pattern, bound) == CompiledMatcher(other, world.library).source(pattern, bound)
