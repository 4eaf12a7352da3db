"""Compare values of objects that nothing else connects."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import envgraph
from benchmarks._growth import Case
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar

_KEYS = Metamodel(
    "keys",
    (
        Class("G"),
        Class(
            "N",
            features=(
                Attribute("key", Scalar.INT),
                Attribute("name", Scalar.STRING),
                Reference("g", "G", 0, 1),
            ),
        ),
    ),
)
_BOTH = "N.key(a, x); N.key(b, y); "
_CALLED = (
    envgraph.Pattern("greater", "a : N, b : N", _BOTH + "check(y > x)"),
    envgraph.Pattern("above", "a : N, b : N", "N.g(a, g); N.g(b, g); " + _BOTH + "check(y > x)"),
    envgraph.Pattern("inBucket", "k : int, a : N", "N.key(a, x); k == eval(x / 10)"),
    envgraph.Pattern("inTens", "k : int, a : N", "N.key(a, x); k == eval(x % 10)"),
)
_COMPARED = {
    "computed values": _BOTH + "check(x + 1 == y * 2)",
    "eval on both sides": _BOTH + "v == eval(x + 1); v == eval(y * 2)",
    "y == x + 1": _BOTH + "check(y == x + 1)",
    "text of a number": 'N.name(a, x); N.key(b, y); check(x == "n" + y)',
    "between": _BOTH + "check(x < y && y < x + 3)",
    "none is greater": "neg find greater(a, _)",
    "none of the group is greater": "N.g(a, _); neg find above(a, _)",
    "how many are greater": "n == count find greater(a, _); check(n < 3)",
    "buckets": "N.key(a, x); k == eval(x / 10); n == count find inBucket(k, _)",
    "ten buckets": "N.key(a, x); k == eval(x % 10); n == count find inTens(k, _)",
}


def cases() -> Iterator[Case]:
    """Yield queries on demand and watched, and changes between queries or while watched."""
    for name in _COMPARED:
        yield f"{name}, on demand", 1_500, partial(_compare, name, False)
        yield f"{name}, watched", 1_500, partial(_compare, name, True)
    for name in ("computed values", "y == x + 1", "between"):
        yield f"{name}, n watched changes", 700, partial(_change_keys, name, True)
        yield f"{name}, n questions, changes", 700, partial(_change_keys, name, False)


def _engine_of(name: str, size: int) -> envgraph.Engine:
    model = envgraph.Model(_KEYS)
    with model.loading():
        groups = [model.create("G") for _ in range(size // 10 + 1)]
        for number in range(size):
            model.create("N", key=number, name=f"n{number}", g=groups[number % len(groups)])
    engine = envgraph.Engine(model)
    engine.add(
        *_CALLED,
        envgraph.Pattern("q", "a : N, b : N" if "b, y" in _COMPARED[name] else "a : N", _COMPARED[name]),
    )
    return engine


def _compare(name: str, watched: bool, size: int) -> Callable[[], object]:
    engine = _engine_of(name, size)

    def ask() -> int:
        if watched:
            engine.watch("q")
        return engine.count("q")

    return ask


def _change_keys(name: str, watched: bool, size: int) -> Callable[[], object]:
    engine = _engine_of(name, size)
    nodes = engine.model.nodes("N")
    if watched:
        engine.watch("q")

    def change() -> None:
        for number, node in enumerate(nodes):
            node.key = (7 * number) % size
            engine.count("q", a=node)

    return change
