"""Watch cycles and recursive patterns."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

from benchmarks._growth import Case, Prepare
from envgraph import Engine, Model, Pattern
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar

STEPS = Metamodel(
    "steps",
    (Class("N", features=(Attribute("key", Scalar.INT), Reference("next", "N", 0, None))),),
)


def links(shape: str, size: int) -> Sequence[tuple[int, int]]:
    """Return the links of a chain, of a ring, or of a tree in which each node has two below it."""
    if shape == "tree":
        return [((number - 1) // 2, number) for number in range(1, size)]
    return [*pairwise(range(size)), *([(size - 1, 0)] if shape == "ring" else [])]


def watched(shape: str, edits: bool, *patterns: Pattern) -> Prepare:
    """Prepare to watch the last pattern or, with `edits`, to delete and insert a link while it is watched."""

    def case(size: int) -> Callable[[], object]:
        model = Model(STEPS)
        nodes = [model.create("N", key=number) for number in range(size)]
        edges = links(shape, size)
        for source, target in edges:
            nodes[source].next.append(nodes[target])
        engine = Engine(model)
        engine.add(*patterns)
        name = patterns[-1].name

        def watch() -> None:
            engine.watch(name)
            engine.count(name)

        def edit() -> None:
            source, target = edges[size // 2]
            for _ in range(5):
                nodes[source].next.remove(nodes[target])
                engine.count(name)
                nodes[source].next.append(nodes[target])
                engine.count(name)

        if edits:
            watch()
        return edit if edits else watch

    return case


CIRCLE = (Pattern("st", "a : N, b : N", "N.next(a, b)"), Pattern("q", "a : N", "find st+(a, a)"))

RECURSIVE = {
    "left": "find re(a, m); N.next(m, b)",
    "right": "N.next(a, m); find re(m, b)",
    "double": "find re(a, m); find re(m, b)",
}


def recursion(kind: str) -> tuple[Pattern, Pattern]:
    """Return a recursive pattern of some kind, and a pattern that calls it from one start."""
    bodies = ["N.next(a, b)", RECURSIVE[kind]]
    called = Pattern("re", "a : N, b : N", bodies, annotations="@SafeRecursion")
    return called, Pattern("q", "b : N", "N.key(a, 0); find re(a, b)")


VIEWS: dict[str, Prepare] = {
    f"st+(a, a), {shape}{', 5 edits' if edits else ''}": watched(shape, edits, *CIRCLE)
    for shape in ("chain", "ring", "tree")
    for edits in (False, True)
} | {
    f"{kind} recursion from one start, {shape}{', 5 edits' if edits else ''}": watched(shape, edits, *recursion(kind))
    for kind in RECURSIVE
    for shape in ("chain",)
    for edits in (False, True)
}


def cases() -> Iterator[Case]:
    """Yield patterns to watch, and edits of models in which they are watched."""
    yield from ((name, 1_000, prepare) for name, prepare in VIEWS.items())
