"""Checking and lowering stay quick however long a pattern is."""

from time import process_time

import pytest

from envgraph.errors import has_errors
from envgraph.pattern import Library
from tests.unit.pattern.building import METAMODEL, agg, check, eq, ev, find, isa, ne, neg, op, path, pattern

SIZE = 200
CELLS = ", ".join(f"x{number} : Cell" for number in range(SIZE + 1))
START = path("Cell.x", "x0", "n0")

LONG = {
    "chain": ("x0 : Cell", [path("Cell.right", f"x{i}", f"x{i + 1}") for i in range(SIZE)]),
    "chain of parameters": (CELLS, [path("Cell.right", f"x{i}", f"x{i + 1}") for i in range(SIZE)]),
    "star of parameters": (CELLS, [path("Cell.right", "x0", f"x{i + 1}") for i in range(SIZE)]),
    "long paths": ("x0 : Cell", [path("Cell.right.left.right", f"x{i}", f"x{i + 1}") for i in range(SIZE)]),
    "equations": ("x0 : Cell", [isa("Cell", "x0"), *(eq(f"x{i}", f"x{i + 1}") for i in range(SIZE))]),
    "inequalities": ("x0 : Cell", [isa("Cell", f"x{i}") for i in range(20)]
        + [ne(f"x{i}", f"x{j}") for i in range(20) for j in range(i)]),
    "values": ("x0 : Cell", [START, *(eq(f"n{i + 1}", ev(op(f"n{i}", "+", 1))) for i in range(SIZE))]),
    "values, last one first": ("x0 : Cell",
        [*(eq(f"n{i + 1}", ev(op(f"n{i}", "+", 1))) for i in reversed(range(SIZE))), START]),
    "checks": ("x0 : Cell", [check(op("x0.x", ">", number)) for number in range(SIZE)]),
    "negations": ("x0 : Cell", [neg(path("Cell.x", "x0", number)) for number in range(SIZE)]),
    "counts": ("x0 : Cell", [eq(f"n{i}", agg("count", path("Cell.right", "x0", "_"))) for i in range(SIZE)]),
    "closures": (CELLS, [path("Cell.right", f"x{i}", f"x{i + 1}", closure="*") for i in range(SIZE)]),
    "calls": (CELLS, [find("step", f"x{i}", f"x{i + 1}") for i in range(SIZE)]),
}  # fmt: skip


@pytest.mark.parametrize("name", LONG)
def test_a_pattern_of_200_constraints_is_checked_and_lowered_quickly(name):
    parameters, constraints = LONG[name]
    patterns = [
        pattern("step", "a : Cell, b : Cell", [path("Cell.right", "a", "b")]),
        pattern("long", parameters, constraints),
    ]
    made = Library(METAMODEL)
    started = process_time()
    problems = made.check(*patterns)
    made.add(*patterns)
    lowered = made.lowered_pattern("long")
    assert process_time() - started < 2, "two checks and one lowering"
    assert not has_errors(problems)
    assert len(lowered.bodies) == 1
