"""Watch rules with blocks whose objects must differ from the objects outside."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from random import Random

import envgraph
from benchmarks._growth import Case
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar

_NODES = Metamodel(
    "nodes",
    (
        Class(
            "N",
            features=(
                Attribute("mark", Scalar.BOOL, default=False),
                Attribute("v", Scalar.INT, default=0),
                Reference("next", "N", 0, None),
            ),
        ),
    ),
)
_LEFT = "x : N -next-> y : N; check !y.mark;"
_BLOCKS = {
    "not": "not { y -next-> z : N; check !z.mark; }",
    "not, two nodes": "not { y -next-> z : N -next-> u : N; check !u.mark; }",
    "not, nested": "not { y -next-> z : N; not { z -next-> u : N; check !u.mark; } }",
    "not, a value": "not { y -next-> z : N; check z.v > x.v; }",
    "require, three nodes": "require { y -next-> z : N -next-> u : N -next-> w : N; check !w.mark; }",
}


def cases() -> Iterator[Case]:
    """Yield rules to watch in chains, random graphs and stars, and changes of these."""
    for name in _BLOCKS:
        for shape in (_chain, _random):
            yield f"watch {name}, {shape.__name__[1:]}", 5_000, partial(_watch, name, shape)
    yield "watch not, star", 5_000, partial(_watch, "not", _star)
    yield "watch count, random", 5_000, partial(_watch, "count", _random)
    yield "all marks, chain", 2_500, partial(_change, _chain)
    yield "all marks, star", 2_500, partial(_change, _star)


def _watch(name: str, shape: Callable[[int], list[tuple[int, int]]], size: int) -> Callable[[], object]:
    engine = _engine(shape, size)
    if name == "count":
        engine.add(
            envgraph.Pattern("other", "x : N, y : N, z : N", "N.next(y, z); x != z;"),
            envgraph.Pattern("r", "x : N, y : N", "N.next(x, y); 0 == count find other(x, y, _);"),
        )
    else:
        engine.add(envgraph.Rule("r", lhs=_LEFT, blocks=_BLOCKS[name], modify="set y.mark = true;"))

    def work() -> None:
        engine.watch("r")
        engine.unwatch("r")

    return work


def _change(shape: Callable[[int], list[tuple[int, int]]], size: int) -> Callable[[], object]:
    """Set and clear the mark of each object while the rule is watched."""
    engine = _engine(shape, size)
    engine.add(envgraph.Rule("r", lhs=_LEFT, blocks=_BLOCKS["not"], modify="set y.mark = true;"))
    engine.watch("r")
    nodes = engine.model.nodes("N")

    def work() -> None:
        for mark in (True, False):
            for node in nodes:
                node.mark = mark
            engine.count("r")

    return work


def _engine(shape: Callable[[int], list[tuple[int, int]]], size: int) -> envgraph.Engine:
    model = envgraph.Model(_NODES)
    with model.loading():
        nodes = [model.create("N") for _ in range(size)]
        for source, target in shape(size):
            nodes[source].next.append(nodes[target])
    return envgraph.Engine(model)


def _chain(size: int) -> list[tuple[int, int]]:
    return [(number, number + 1) for number in range(size - 1)]


def _random(size: int) -> list[tuple[int, int]]:
    """Return two links for each object, the same ones in every run."""
    dice = Random(size)
    return sorted({(dice.randrange(size), dice.randrange(size)) for _ in range(2 * size)})


def _star(size: int) -> list[tuple[int, int]]:
    """Return links from half of the objects to the first, and from there to the other half."""
    return [(number, 0) if number < size // 2 else (0, number) for number in range(1, size)]
