"""Change ordered features of an object that already has 8,000 targets or values."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from benchmarks._growth import Case, Prepare
from envgraph.graph import Model, Node
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar

TAGS = Attribute("tags", Scalar.STRING, lower=0, upper=None)
MARKS = Attribute("marks", Scalar.INT, lower=0, upper=None, unique=False)
WORLD = Metamodel(
    "world",
    [
        Class("World", features=(Reference("nodes", "Node", 0, None, containment=True), TAGS, MARKS)),
        Class("Node"),
    ],
)


def cases() -> Iterator[Case]:
    """Yield n insertions at a position, or removals from it."""

    def world(size: int) -> Node:
        model = Model(WORLD)
        found = model.create("World", tags=[f"t{n}" for n in range(size)], marks=[n % 7 for n in range(size)])
        with model.loading():
            found.nodes.extend(model.create("Node") for _ in range(size))
        return found

    def repeated(change: Callable[[Node, int], object]) -> Prepare:
        def setup(size: int) -> Callable[[], object]:
            found = world(8_000)
            return lambda: [change(found, number) for number in range(size)]

        return setup

    def rolled_back(change: Callable[[Node, int], object]) -> Prepare:
        def setup(size: int) -> Callable[[], object]:
            found = world(8_000)

            def work() -> None:
                savepoint = found.model.graph.history.savepoint()
                for number in range(size):
                    change(found, number)
                found.model.graph.history.rollback(savepoint)

            return work

        return setup

    def new(found: Node) -> Node:
        return found.model.create("Node")

    def every_other(size: int) -> Callable[[], object]:
        found = world(size)
        kept = list(found.nodes)[::2]
        return lambda: setattr(found, "nodes", kept)

    rows: dict[str, tuple[int, Prepare]] = {
        "nodes.insert(0, new)": (500, repeated(lambda w, _: w.nodes.insert(0, new(w)))),
        "nodes.insert(middle, new)": (500, repeated(lambda w, _: w.nodes.insert(4_000, new(w)))),
        "nodes.append(new)": (500, repeated(lambda w, _: w.nodes.append(new(w)))),
        "nodes.remove(first)": (500, repeated(lambda w, _: w.nodes.remove(w.nodes[0]))),
        "tags.append(value)": (500, repeated(lambda w, n: w.tags.append(f"u{n}"))),
        "tags.insert(0, value)": (500, repeated(lambda w, n: w.tags.insert(0, f"u{n}"))),
        "del tags[0]": (500, repeated(lambda w, _: w.tags.pop(0))),
        "tags.append, rolled back": (500, rolled_back(lambda w, n: w.tags.append(f"u{n}"))),
        "tags.insert(0), rolled back": (500, rolled_back(lambda w, n: w.tags.insert(0, f"u{n}"))),
        "marks.append, with repetitions": (500, repeated(lambda w, n: w.marks.append(n % 7))),
        "tags = n values": (2_000, lambda size: lambda: world(size)),
        "nodes = every other of n": (4_000, every_other),
    }
    yield from ((name, size, prepare) for name, (size, prepare) in rows.items())
