"""The generated source: what is in it, what is not, and that CPython takes it however long a pattern is."""

from __future__ import annotations

import ast
import re
from time import process_time
from typing import Any

import pytest

from envgraph.graph import Model
from envgraph.match import FREE, CompiledMatcher
from envgraph.match.generate._sources import view_source
from envgraph.match.generate._symbols import ResultMode
from envgraph.match.plan import CallGraph, PatternQuery, Planner
from envgraph.match.plan._step_candidates import StepCandidates
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar
from envgraph.pattern import Constant, Constraint, Library, Pattern
from tests.unit.match.forest import PATTERNS, forest, library
from tests.unit.match.writing import check, equal, find, fold, is_a, neg, op, path, pattern, unequal, value

RINGS = Metamodel(
    "rings",
    (
        Class(
            "Node",
            features=(
                Attribute("size", Scalar.INT),
                Attribute("label", Scalar.STRING),
                Reference("next", "Node", 0, 1),
                Reference("to", "Node", 0, None),
            ),
        ),
    ),
)


def ring(size: int) -> Model:
    """Nodes 0..size-1 in a ring by both references."""
    model = Model(RINGS)
    for number in range(size):
        model.create("Node", size=number)
    for number in range(size):
        model.node(number).next = model.node((number + 1) % size)
        model.node(number).to.append(model.node((number + 1) % size))
    return model


def matcher(model: Model, *patterns: Pattern) -> CompiledMatcher:
    found = Library(model.metamodel)
    found.add(*patterns)
    return CompiledMatcher(model, found)


def names(count: int) -> str:
    return ", ".join(f"x{number} : Node" for number in range(count))


def chain(reference: str, count: int) -> list[Constraint]:
    return [path(f"Node.{reference}", f"x{number}", f"x{number + 1}") for number in range(count - 1)]


def test_startTileFixedLocation_is_one_loop_with_all_checks_outside_the_second() -> None:
    found = CompiledMatcher(forest(), library()).source("startTileFixedLocation")
    assert found == (
        "def build(E5, A0, k0, A1, k1, B0, C):\n"
        "    def view():\n"
        "        out = []\n"
        "        add = out.append\n"
        "        for v1 in E5:\n"
        "            if A0[v1] == k0 and A1[v1] == k1 and (t0 := B0[v1]):\n"
        "                v0, = t0\n"
        "                if C[v0] == 3:\n"
        "                    add((v0, v1))\n"
        "        return out\n"
        "    return view\n"
    )


def test_existence_queries_stop_at_the_first_match() -> None:
    queries = library()
    planner = Planner(queries, CallGraph(queries))
    text = view_source(planner, PatternQuery("burningTile", (), ()), ResultMode.EXISTS).text
    assert "return True" in text
    assert "out" not in text


@pytest.mark.parametrize("mode", list(ResultMode))
def test_generated_source_contains_no_user_text(mode: ResultMode) -> None:
    evil = "evil'\"\\\n__import__('os')"
    nodes = matcher(
        ring(3),
        pattern(
            "class_(import_ : Node, None_ : string)",
            [
                path("Node.label", "import_", "None_"),
                unequal("None_", Constant(evil)),
                check(op("None_", "+", Constant(evil)), "!=", Constant("evil")),
                equal("lambda_", value(op("None_", "+", Constant(evil)))),
                neg(path("Node.label", "import_", Constant(evil))),
            ],
        ),
    )
    key = PatternQuery("class_", (), () if mode is ResultMode.EXISTS else (0, 1))
    text = view_source(nodes._program.planner, key, mode).text
    assert not re.search("evil|import|None_|lambda|class", text)
    assert not [
        node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]


def test_variable_names_cannot_clash_with_generated_names() -> None:
    reserved = ("out", "add", "seen", "todo", "node", "C", "E0", "F1", "v1", "t1", "k0", "view", "build")
    model = ring(3)
    for name in reserved:
        nodes = matcher(
            model,
            pattern(f"p({name} : Node, b : Node)", [path("Node.next+", name, "b"), path("Node.size", name, 0)]),
        )
        assert nodes.count("p", (FREE, FREE)) == 3


@pytest.mark.parametrize("reference", ["next", "to"])
@pytest.mark.parametrize("length", [15, 25, 60])
def test_long_chains_are_split_into_functions(reference: str, length: int) -> None:
    model = ring(4)
    nodes = matcher(model, pattern(f"p({names(length)})", chain(reference, length)))
    rows = nodes.rows("p", (FREE,) * length)
    assert sorted(rows) == [tuple((start + i) % 4 for i in range(length)) for start in range(4)]
    assert nodes.count("p", (FREE,) * length) == 4
    assert nodes.first("p", (FREE,) * length) == rows[0]
    assert nodes.exists("p", (2, *(FREE,) * (length - 1)))
    assert nodes.rows("p", (*(FREE,) * (length - 1), 1)) == [row for row in rows if row[-1] == 1]


@pytest.mark.parametrize("reference", ["next", "to"])
def test_long_chains_with_only_the_start_projected_are_split(reference: str) -> None:
    long = pattern("p(x0 : Node)", chain(reference, 60))
    count = pattern("n(x : Node, n : int)", [is_a("Node", "x"), equal("n", fold("count", find("both", "x", "_")))])
    both = pattern("both(x0 : Node, x1 : Node)", chain(reference, 60))
    summed = pattern("s(n : int)", [equal("n", fold("sum", find("sizes", "_", "#")))])
    sizes = pattern("sizes(x0 : Node, n : int)", [*chain(reference, 40), path("Node.size", "x39", "n")])
    nodes = matcher(ring(4), long, count, both, summed, sizes)
    assert nodes.rows("p", (FREE,)) == [(0,), (1,), (2,), (3,)]
    assert nodes.rows("n", (FREE, FREE)) == [(n, 1) for n in range(4)]
    assert nodes.rows("s", (FREE,)) == [(6,)]


def test_closures_along_long_steps_are_split_too() -> None:
    step = pattern("step(x0 : Node, x40 : Node)", chain("to", 41))
    reach = pattern("reach(a : Node, b : Node)", [find("step+", "a", "b")])
    nodes = matcher(ring(6), step, reach)
    assert nodes.rows("reach", (0, FREE)) == [(0, 4), (0, 2), (0, 0)]
    assert nodes.exists("reach", (1, 5))
    assert not nodes.exists("reach", (1, 2))


def _checks(count: int) -> list[Constraint]:
    return [check(op("n", "+", number), ">=", number) for number in range(count)]


LONG = {
    "chain of links": chain("to", 200),
    "chain of single links": chain("next", 200),
    "star": [path("Node.to", "x0", f"x{number}") for number in range(1, 200)],
    "existential star": [path("Node.to", "x0", f"y{number}") for number in range(1, 200)],
    "checks": [path("Node.size", "x0", "n"), *_checks(199)],
    "negations": [neg(path("Node.size", "x0", number)) for number in range(10, 210)],
    "counts": [equal(f"n{number}", fold("count", path("Node.to", "x0", "_"))) for number in range(200)],
    "calls": [find("edge", f"x{number}", f"x{number + 1}") for number in range(199)],
    "closures": [path("Node.to*", f"x{number}", f"x{number + 1}") for number in range(199)],
    "calls of closures": [find("edge+", f"x{number}", f"x{number + 1}") for number in range(199)],
    "clique": [path("Node.to", f"x{i}", f"x{j}") for i in range(15) for j in range(15) if i != j],
    "tree": [path("Node.to", f"x{(number - 1) // 2}", f"x{number}") for number in range(1, 200)],
    "cycle": [path("Node.to", f"x{number}", f"x{(number + 1) % 198}") for number in range(198)],
    "grid": [path("Node.to", f"x{n}", f"x{n + step}") for n in range(90) for step in (1, 10)],
    "pieces": [path("Node.to", f"x{2 * number}", f"x{2 * number + 1}") for number in range(200)],
    "values": [path("Node.size", f"x{n // 2}", f"v{n // 3}") for n in range(200)],
}


@pytest.mark.parametrize("name", LONG)
def test_a_pattern_of_200_constraints_is_planned_in_under_a_second(name: str) -> None:
    nodes = matcher(
        ring(3),
        pattern("p(x0 : Node)", [is_a("Node", "x0"), *LONG[name]]),
        pattern("edge(a : Node, b : Node)", [path("Node.next", "a", "b")]),
    )
    started = process_time()
    rows = nodes.rows("p", (FREE,))
    assert process_time() - started < 1
    assert rows == ([] if name == "clique" else [(0,), (1,), (2,)])


def test_planning_reestimates_calls_only_after_relevant_changes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    estimated = 0

    def estimate(*arguments: Any) -> tuple[float, float]:
        nonlocal estimated
        estimated += 1
        return original(*arguments)

    original = StepCandidates._estimate
    monkeypatch.setattr(StepCandidates, "_estimate", estimate)
    edge = pattern("edge(a : Node, b : Node)", [path("Node.next", "a", "b")], [path("Node.to", "a", "b")])
    nodes = matcher(ring(3), edge, pattern("p(x0 : Node)", [is_a("Node", "x0"), *LONG["calls"]]))
    assert nodes.exists("p", (0,))
    assert estimated <= 4 * len(LONG["calls"])


def test_explain_shows_the_order_with_estimates_and_the_source() -> None:
    text = CompiledMatcher(forest(), library()).explain("spread", (1,))
    head, _, source = text.partition("\n\n")
    assert head.splitlines()[0] == "pattern spread(fire, tile), given tile"
    assert re.search(r"test +VegetationTile\(tile\) +\(rows [\d.]+\)", head)
    assert re.search(r"test +neg any of 1 for tile", head)
    assert re.search(r"for +find neighbour\(fire, tile\)", head)
    assert source == CompiledMatcher(forest(), library()).source("spread", (1,))


@pytest.mark.parametrize("name", [p.name for p in PATTERNS])
def test_every_plan_can_be_explained(name: str) -> None:
    found = CompiledMatcher(forest(), library())
    size = len(found.library.parameter_types(name))
    for bound in ((), tuple(range(size))):
        assert found.explain(name, bound).startswith(f"pattern {name}(")


@pytest.mark.parametrize("bodies", [1, 2])
def test_long_chains_of_calls_need_no_deep_stack(bodies: int) -> None:
    patterns = [pattern("p0(a : Node, b : Node)", [path("Node.to", "a", "b")])]
    for number in range(1, 250):
        below = f"p{number - 1}"
        one = [find(below, "a", "c"), path("Node.next", "c", "b")]
        other = [path("Node.next", "a", "b"), path("Node.next", "b", "b")]
        patterns.append(pattern(f"p{number}(a : Node, b : Node)", *[one, other][:bodies]))
    nodes = matcher(ring(5), *patterns)
    assert nodes.rows("p249", (0, FREE)) == [(0, 0)]
    assert nodes.exists("p248", (FREE, 1))
    assert nodes.count("p247", (FREE, FREE)) == 5


def test_an_input_is_bound_before_the_call_of_a_recursive_pattern() -> None:
    down = pattern(
        "down(a : Node, in n : int)",
        [is_a("Node", "a"), equal("n", 0)],
        [
            path("Node.size", "a", "s"),
            check("n", ">", 0),
            equal("m", value(op("n", "-", 1))),
            find("down", "a", "m"),
        ],
    )
    user = pattern("user(a : Node)", [find("down", "a", "n"), path("Node.size", "a", "n")])
    nodes = matcher(ring(4), down, user)
    assert nodes.rows("user", (FREE,)) == [(0,), (1,), (2,), (3,)]


def test_independent_parts_are_tested_for_existence_once() -> None:
    tail = [path("Node.to", "b", "c"), path("Node.to", "c", "d"), path("Node.to", "d", "e")]
    nodes = matcher(ring(3), pattern("p(a : Node, b : Node)", [path("Node.to", "a", "b"), *tail]))
    text = nodes.explain("p", (0,))
    assert re.search(r"\n  for +Node\.to\(a, b\).*\n  if any", text)
    assert "return True" in text
    assert "reported once" not in text


def test_independent_goals_are_tested_before_any_loop() -> None:
    other = [path("Node.to", "x", "y"), path("Node.to", "y", "z")]
    nodes = matcher(ring(3), pattern("p(a : Node, b : Node)", [path("Node.to", "a", "b"), *other]))
    steps = nodes.explain("p").partition("\n\n")[0].splitlines()[2:]
    assert steps[0].split()[:2] == ["if", "any"]


def test_plans_with_unique_rows_need_no_distinct_check() -> None:
    nodes = matcher(
        ring(3),
        pattern("single(a : Node)", [path("Node.next", "a", "b")]),
        pattern("apart(a : Node, n : int)", [is_a("Node", "a"), equal("n", 1)], [is_a("Node", "a"), equal("n", 2)]),
        pattern("many(b : Node)", [path("Node.to", "a", "b"), path("Node.next", "a", "b")]),
    )
    assert "out = []" in nodes.source("single")
    assert "out = []" in nodes.source("apart")
    assert nodes.rows("many", (FREE,)) == [(1,), (2,), (0,)]
