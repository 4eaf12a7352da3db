"""Ask for a first match, with bound variables, and run loops of units, in large models.

    python -m benchmarks questions

No figure should grow with the model. `alap` applies a rule until nothing is left, on demand and watched; `first` and
its like are asked with one variable bound, of a pattern over a link and of one over equal values, on demand and
watched, in a model that stands still and in one that changes between two questions. Processor time; medians where there
are several rounds.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from itertools import product
from statistics import median
from time import process_time
from typing import NamedTuple

import envgraph
from envgraph.errors import EvaluationError
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar

METAMODEL = Metamodel(
    "questions",
    [
        Class("Left", features=(Attribute("key", Scalar.INT), Attribute("done", Scalar.BOOL))),
        Class(
            "Right",
            features=(
                Attribute("key", Scalar.INT),
                Attribute("seen", Scalar.INT),
                Reference("left", "Left", upper=1),
            ),
        ),
    ],
)

LINKED = envgraph.Pattern("linked", "a : Left, b : Right", "Right.left(b, a);")
EQUAL = envgraph.Pattern("equal", "a : Left, b : Right", "Left.key(a, k); Right.key(b, k);")
NEG = envgraph.Rule("neg", lhs="a : Left; check a.done == false;", modify="set a.done = true;")
JOIN = envgraph.Rule("join", lhs="a : Left; b : Right; check a.key == b.key;", modify="set b.seen += 1;")
GROW = envgraph.Rule("grow", lhs="a : Left;", modify="create b : Left;")
UNITS = (
    envgraph.Unit("drain", body="alap { neg; }"),
    envgraph.Unit("drain_first", body="alap { first neg; }"),
    envgraph.Unit("forever", body="alap { grow; }"),
)


class Sizes(NamedTuple):
    """Objects of the loops, limits of steps, pairs of objects in the large model, and how often it is asked."""

    loops: tuple[int, ...]
    limits: tuple[int, ...]
    objects: int
    rounds: int


FULL = Sizes((1_000, 2_000, 4_000, 8_000), (1_000, 4_000, 16_000, 64_000), objects=100_000, rounds=41)
QUICK = Sizes((10, 20), (10, 20), objects=100, rounds=2)

QUESTIONS: dict[str, Callable[[envgraph.Engine, str, envgraph.Node], object]] = {
    "matches": lambda engine, pattern, left: engine.matches(pattern, a=left),
    "first": lambda engine, pattern, left: engine.first(pattern, a=left),
    "exists": lambda engine, pattern, left: engine.exists(pattern, a=left),
    "count": lambda engine, pattern, left: engine.count(pattern, a=left),
    "apply": lambda engine, pattern, left: engine.apply(pattern, a=left),
    "apply first": lambda engine, pattern, left: engine.apply(pattern, choose="first", a=left),
}


def main(sizes: Sizes) -> None:
    """Print the tables."""
    print_loops(sizes)
    print_growth(sizes)
    print_questions(sizes)


def engine_of(pairs: int, objects: int | None = None) -> envgraph.Engine:
    """So many pairs of a `Left` and a `Right`, linked and with the same key."""
    model = envgraph.Model(METAMODEL)
    with model.loading():
        for key in range(pairs):
            left = model.create("Left", key=key)
            model.create("Right", key=key, left=left)
    engine = envgraph.Engine(model)
    engine.add(LINKED, EQUAL, NEG, JOIN, GROW, *UNITS)
    return engine


def print_loops(sizes: Sizes) -> None:
    """`alap` over a rule that uses its matches up."""
    print(f"{'alap, ms':28}" + "".join(f"{objects:>10,}" for objects in sizes.loops))
    for unit in ("drain", "drain_first"):
        for watched in (False, True):
            cells = []
            for objects in sizes.loops:
                engine = engine_of(objects)
                if watched:
                    engine.watch("neg")
                started = process_time()
                result = engine.run(unit)
                cells.append(1e3 * (process_time() - started))
                assert result.applications == objects
            print(f"{unit + (', watched' if watched else ', on demand'):28}" + "".join(f"{c:10.0f}" for c in cells))


def print_growth(sizes: Sizes) -> None:
    """A loop that never ends: what a step costs, up to the limit of steps."""
    cells = []
    for limit in sizes.limits:
        engine = engine_of(1)
        engine.step_limit = limit
        started = process_time()
        with suppress(EvaluationError):
            engine.run("forever")
        cells.append(1e6 * (process_time() - started) / limit)
    print(f"\n{'steps of a loop without end':28}" + "".join(f"{limit:10,}" for limit in sizes.limits))
    print(f"{'us a step':28}" + "".join(f"{cell:10.1f}" for cell in cells))


def print_questions(sizes: Sizes) -> None:
    """One variable bound, in a large model."""
    print(f"\none variable bound, {2 * sizes.objects:,} objects, us a question")
    print(f"{'':28}" + "".join(f"{name:>13}" for name in QUESTIONS))
    for pattern, watched, changing in product(("linked", "equal", "join"), (False, True), (False, True)):
        engine = engine_of(sizes.objects)
        if watched:
            engine.watch(pattern)
        lefts = engine.model.nodes("Left")
        cells = []
        for name, ask in QUESTIONS.items():
            if pattern != "join" and name.startswith("apply"):
                continue
            times = []
            for number in range(sizes.rounds):
                if changing:
                    lefts[-number - 1].done = not lefts[-number - 1].done
                started = process_time()
                ask(engine, pattern, lefts[37 * number])
                times.append(1e6 * (process_time() - started))
            cells.append(median(times))
        how = f"{pattern}, {'watched' if watched else 'on demand'}{', changing' if changing else ''}"
        print(f"{how:28}" + "".join(f"{cell:13.0f}" for cell in cells), flush=True)
