"""Objects that are found by values which are computed of them, or by bounds of such values."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import pytest

import envgraph
from envgraph.graph import Model
from envgraph.match.demand._value_index import ValueIndex
from envgraph.metamodel import Attribute, Class, Metamodel, Scalar

KEYS = Metamodel("keys", (Class("N", features=(Attribute("key", Scalar.INT), Attribute("part", Scalar.FLOAT))),))
PAIR = "N.key(a, x); N.key(b, y); "
COMPARED = {
    "sum and product": (PAIR + "check(x + 1 == y * 2)", 1_500),
    "two evaluations": (PAIR + "v == eval(x + 1); v == eval(y * 2)", 1_500),
    "successor": (PAIR + "check(y == x + 1)", 2_999),
    "between": (PAIR + "check(x < y && y < x + 3)", 5_997),
    "int and float": ("N.key(a, x); N.part(b, y); check(x * 2 == y * 4)", 3_000),
    "a divisor of zero has no value": (PAIR + "check(x == 2999 / y)", None),
    "beyond 64 bits": (PAIR + "check(x * 9223372036854775807 == y * 9223372036854775807)", 3_000),
}


def engine_of(size: int) -> envgraph.Engine:
    """So many objects with keys from 0 on."""
    model = Model(KEYS)
    with model.loading():
        for number in range(size):
            model.create("N", key=number, part=number / 2)
    engine = envgraph.Engine(model)
    engine.add(
        envgraph.Pattern("greater", "a : N, b : N", PAIR + "check(y > x)"),
        envgraph.Pattern("greatest", "a : N", "neg find greater(a, _)"),
        envgraph.Pattern("third", "a : N", "2 == count find greater(a, _)"),
    )
    return engine


@pytest.mark.parametrize("name", COMPARED)
def test_thousands_of_objects_are_joined_on_demand_and_watched(name: str) -> None:
    text, expected = COMPARED[name]
    engine = engine_of(3_000)
    engine.add(envgraph.Pattern("q", "a : N, b : N", text))
    if expected is None:
        expected = sum(2_999 // y < 3_000 for y in range(1, 3_000))
    assert engine.count("q") == expected
    engine.watch("q")
    assert engine.count("q") == expected
    assert "looked up by value" in engine.explain("q")


def test_a_maximum_is_watched_without_storing_all_pairs() -> None:
    engine = engine_of(3_000)
    engine.watch("greatest", "third")
    nodes = engine.model.nodes("N")
    assert [match.a for match in engine.matches("greatest")] == [nodes[-1]]
    assert [match.a for match in engine.matches("third")] == [nodes[-3]]
    with engine.transaction():
        nodes[5].key = 5_000
    assert [match.a for match in engine.matches("greatest")] == [nodes[5]]
    assert [match.a for match in engine.matches("third")] == [nodes[-2]]


def test_explain_shows_index_lookups_in_loops() -> None:
    engine = engine_of(3)
    engine.add(envgraph.Pattern("q", "a : N, b : N", PAIR + "check(y == x + 1)"))
    lines = engine.explain("q").splitlines()
    assert lines[2:7] == [
        "  for     N(a)  (rows 100, actually 3)",
        "  bind    N.key(a, x)  (rows 99, actually 3)",
        "  for     N(b), looked up by value  (rows 9900, actually 9)",
        "  bind    N.key(b, y)  (rows 9801, actually 9)",
        "  test    check(y == x + 1)  (rows 4900, actually 2)",
    ]


def test_user_functions_are_not_indexed() -> None:
    engine = engine_of(4)
    called: list[int] = []

    @engine.function
    def noted(x: int) -> int:
        called.append(x)
        return x

    engine.add(envgraph.Pattern("q", "a : N, b : N", PAIR + "check(x == noted(y))"))
    assert engine.count("q") == 4
    assert called == [0, 1, 2, 3] * 4
    assert "looked up" not in engine.explain("q")


@pytest.mark.parametrize("operators", [(), (">=", "<")])
def test_a_value_index_is_updated_and_rebuilt_only_after_a_rollback(
    operators: tuple[str, ...],
) -> None:
    model = Model(KEYS)
    nodes = [model.create("N", key=number) for number in range(100)]
    index = ValueIndex(model.graph.store, (0,), operators)
    column = model.graph.store.values[0]
    looked: list[int] = []

    def entries(ids: Iterable[int]) -> Iterator[tuple[object, object, int]]:
        for node in ids:
            looked.append(node)
            yield (() if operators else column[node]), column[node], node

    def find(key: int) -> list[int]:
        looked.clear()
        asked = ((), key, key + 1) if operators else (key,)
        found = list(index.rows(entries, *asked))
        assert found == list(index.some(entries, *asked))
        assert index.count(entries, *asked) == len(found)
        return found

    assert find(7) == [nodes[7].id]
    nodes[3].key = 7
    nodes[50].delete()
    assert find(7) == [nodes[3].id, nodes[7].id]
    assert len(looked) <= 3
    savepoint = model.graph.history.savepoint()
    nodes[3].key = None
    assert find(7) == [nodes[7].id]
    assert len(looked) == 1
    model.graph.history.rollback(savepoint)
    assert find(7) == [nodes[3].id, nodes[7].id]
    assert len(looked) >= 99
