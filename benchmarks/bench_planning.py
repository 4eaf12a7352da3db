"""Plan the first search over metamodels of many classes.

    python -m benchmarks planning

There are two kinds of metamodel. In `flat` all classes extend one that contains itself. In `woven` each class extends
one or two earlier classes and has five references, one of them a containment. Timed is the first query of a new engine
on an empty model: two links between classes in the middle, and no third link. The table shows medians in milliseconds
of processor time, and the exponent with which they grow with the number of classes.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from math import log
from random import Random
from statistics import median
from time import process_time

from envgraph import Engine, Pattern
from envgraph.graph import Model
from envgraph.metamodel import Class, Metamodel, Reference

FULL = (125, 250, 500, 1_000)
QUICK = (10, 20)
REPEATS = 5


def flat(number: int) -> Metamodel:
    """Return a metamodel of a class that contains itself, and of subclasses without features."""
    features = (Reference("parts", "C0", 0, None, containment=True), Reference("uses", "C0", 0, None))
    root = Class("C0", abstract=True, features=features)
    return Metamodel("flat", [root, *(Class(f"C{i}", supertypes=("C0",)) for i in range(1, number))])


def woven(number: int) -> Metamodel:
    """Return a metamodel whose classes have one or two supertypes, mostly recent classes, and five references."""
    draw = Random(7)
    classes = [*flat(1).class_list]
    for i in range(1, number):
        supers = sorted({draw.randrange(i), draw.randrange(max(0, i - 5), i)})
        targets = [f"C{draw.randrange(number)}" for _ in range(5)]
        features = [Reference(f"f{i}_{k}", t, 0, None, containment=not k) for k, t in enumerate(targets)]
        classes.append(Class(f"C{i}", supertypes=tuple(f"C{s}" for s in supers), features=tuple(features)))
    return Metamodel("woven", classes)


def first_question(metamodel: Metamodel) -> float:
    """Return the seconds that the first question takes."""
    number = len(metamodel.class_list)
    one, other = f"C{number // 2}", f"C{number * 7 // 10}"
    engine = Engine(Model(metamodel))
    engine.add(
        Pattern("far", f"x : {one}, y : C0", "C0.parts.uses(x, y)"),
        Pattern("both", f"x : {one}, y : {other}", "C0.uses(x, z); C0.uses(z, y); neg find far(x, y)"),
    )
    gc.collect()
    began = process_time()
    engine.count("both")
    return process_time() - began


def main(sizes: tuple[int, ...]) -> None:
    """Print a line for each kind of metamodel."""
    kinds: tuple[Callable[[int], Metamodel], ...] = (flat, woven)
    print(f"{'first question, ms':20}" + "".join(f"{n:>9,}" for n in sizes) + "  classes, exponent")
    for kind in kinds:
        times = [median(first_question(kind(n)) for _ in range(REPEATS)) for n in sizes]
        grows = log(times[-1] / times[0]) / log(sizes[-1] / sizes[0])
        print(f"{kind.__name__:20}" + "".join(f"{t * 1e3:>9.1f}" for t in times) + f"  {grows:.2f}")
    print("Every repetition makes a new metamodel, model and engine.")
    print("Compiling the functions of a query is part of every time.")
