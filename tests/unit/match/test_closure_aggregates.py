"""Aggregates over sets of reached objects, against the aggregates of the tuples one by one."""

from __future__ import annotations

from random import Random

import pytest

from envgraph.match._aggregates import aggregate
from envgraph.match.demand import _closure_aggregates
from envgraph.match.demand._closure_aggregates import ClosureAggregate

Rows = list[tuple[int, ...] | tuple[int, int, float]]


OTHERS = [("by object", kind) for kind in ("several each", "shared", "floats")]
"""Where an object may have several values, or a tuple several objects, objects are not looked at one by one."""


def rows_of(kind: str, dice: Random) -> Rows:
    """Rows of an end, what else is in the tuple, and a value."""
    ends = range(0, 60, 2)
    rows: dict[tuple[int, int | float, int | float], None] = {}
    for _ in range(60):
        end, value = dice.choice(ends), dice.randint(-3, 3) if kind != "floats" else dice.random()
        other = {"one each": end, "several each": dice.randint(0, 9) + 100 * end}.get(
            kind, dice.randint(0, 9)
        )
        rows[end, other, 5 if kind == "one each" else value] = None
    return list(rows)  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", ["one each", "several each", "shared", "floats"])
@pytest.mark.parametrize("function", ["count", "sum", "avg", "min", "max"])
@pytest.mark.parametrize("way", ["by class", "by object", "whatever is less work"])
def test_a_closure_aggregate_agrees_with_the_aggregate_of_the_tuples(
    function: str, kind: str, way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    dice = Random(f"{function} {kind}")
    rows = rows_of(kind, dice)
    if way == "by class":
        monkeypatch.setattr(_closure_aggregates, "CLASS", 0)
    elif way == "by object":
        monkeypatch.setattr(_closure_aggregates, "MOST_CLASSES", 0)
        monkeypatch.setattr(_closure_aggregates, "DENSE", 1_000)
    column = 0 if function == "count" else 2
    closure = ClosureAggregate(function, column, rows)
    nodes: list[int] = []
    for node in dice.sample(range(60), 60):
        nodes.append(node)
        closure.catch_up(nodes)
        reached = [each for each in nodes if dice.random() < 0.5]
        found = closure.value(sum(1 << nodes.index(each) for each in reached))
        tuples = dict.fromkeys(row[1:] for row in rows if row[0] in reached)
        expected = aggregate(function, [row[-1] for row in tuples])
        if found is not None:
            assert found == (expected,)
        elif reached:
            assert way == "whatever is less work" or (way, kind) in OTHERS


def test_a_sum_beyond_64_bits_has_no_value() -> None:
    closure = ClosureAggregate("sum", 1, [(1, 2**62), (2, 2**62 + 1), (3, -2)])
    closure.catch_up([1, 2, 3])
    assert (closure.sum_up(0b011), closure.sum_up(0b111), closure.sum_up(0)) == (None, 2**63 - 1, 0)
