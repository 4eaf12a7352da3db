"""Keep transitive closures current while a link is deleted and inserted, beside networkx and rustworkx.

    python -m benchmarks closure

Graphs of several shapes, with numbers that are always the same. Either all pairs are asked for, or what one start
reaches. The views are current after each of the two changes, inside an open transaction. Beside them, the same question
asked anew of networkx and rustworkx after each change. Medians in microseconds of real time, for both changes together.
At the end the pairs are compared with those of networkx.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from itertools import product
from random import Random
from statistics import median
from time import perf_counter_ns
from typing import NamedTuple

import networkx as nx

from benchmarks._peers import peer
from envgraph import Engine, Pattern
from envgraph.graph import Model
from envgraph.match import FREE, ViewMatcher
from envgraph.metamodel import Class, Metamodel, Reference

Edges = list[tuple[int, int]]

PEERS = ("rustworkx",)
rustworkx = peer("rustworkx")

PLACES = Metamodel(
    "places",
    (Class("Place", features=(Reference("to", "Place", 0, None),)), Class("Start", supertypes=("Place",))),
)
(TO,) = PLACES.references

QUESTIONS = {
    "all pairs": Pattern("reached", "a : Place, b : Place", "Place.to+(a, b)"),
    "one start": Pattern("reached", "a : Start, b : Place", "Place.to+(a, b)"),
}
SEED = 1
LONGEST = 2_000_000
"""Work, as edges times starts, above which a peer is left out: a change would take seconds."""


def tree(size: int) -> Edges:
    """Each place hangs from one before it."""
    random = Random(SEED)
    return [(random.randrange(place), place) for place in range(1, size)]


def crossing(size: int) -> Edges:
    """No circles: two links to each place from some before it."""
    random = Random(SEED)
    drawn = ((random.randrange(place), place) for place in range(1, size) for _ in range(2))
    return list(dict.fromkeys(drawn))


def grid(size: int) -> Edges:
    """A square whose places lead east and south."""
    side = int(size**0.5)
    places = product(range(side), repeat=2)
    steps = [((r, c), (r + dr, c + dc)) for r, c in places for dr, dc in ((0, 1), (1, 0))]
    return [(r * side + c, s * side + d) for (r, c), (s, d) in steps if s < side and d < side]


def circles(size: int) -> Edges:
    """A square whose places lead in all four directions: all reach each other."""
    return [edge for a, b in grid(size) for edge in ((a, b), (b, a))]


class Sizes(NamedTuple):
    """Graphs, each with its number of places and its question, and how many links are changed."""

    cases: tuple[tuple[Callable[[int], Edges], int, str], ...]
    changes: int


FULL = Sizes(
    (
        (tree, 1_000, "all pairs"),
        (tree, 10_000, "all pairs"),
        (crossing, 1_000, "all pairs"),
        (grid, 900, "all pairs"),
        (circles, 400, "all pairs"),
        (tree, 100_000, "one start"),
        (circles, 10_000, "one start"),
    ),
    changes=30,
)
QUICK = Sizes(
    (*((shape, 25, "all pairs") for shape in (tree, crossing, grid, circles)), (tree, 25, "one start")),
    changes=5,
)


def main(sizes: Sizes) -> None:
    """Print the figures."""
    print(f"{'graph':12}{'places':>8}  {'asked':12}{'pairs':>9}{'envgraph':>10}{'networkx':>20}{'rustworkx':>20}")
    for shape, size, question in sizes.cases:
        edges = shape(size)
        size = 1 + max(max(edge) for edge in edges)
        starts = list(range(size)) if question == "all pairs" else [0]
        changed = Random(SEED).sample(edges, sizes.changes)
        pairs, ours = in_views(edges, size, question, changed)
        cells = ""
        for measure in (in_networkx, in_rustworkx):
            theirs = measure(edges, size, starts, changed) if len(edges) * len(starts) <= LONGEST else None
            cells += f"{'-' if theirs is None else f'{theirs:,.0f} ({theirs / ours:,.0f}x)':>20}"
        print(f"{shape.__name__:12}{size:8}  {question:12}{pairs:9}{ours:10.1f}{cells}", flush=True)


def in_views(edges: Edges, size: int, question: str, changed: Edges) -> tuple[int, float]:
    """Number of pairs, and microseconds."""
    model = Model(PLACES)
    with model.loading():
        places = [model.graph.new("Place" if number else "Start") for number in range(size)]
        for source, target in edges:
            model.graph.link(places[source], TO, places[target])
    engine = Engine(model)
    engine.add(QUESTIONS[question])
    engine.watch("reached")
    matcher = engine.matcher
    assert isinstance(matcher, ViewMatcher)

    def cut(source: int, target: int) -> None:
        model.graph.unlink(places[source], TO, places[target])
        matcher.watched_views.process_pending()

    def join(source: int, target: int) -> None:
        model.graph.link(places[source], TO, places[target])
        matcher.watched_views.process_pending()

    savepoint = model.graph.history.savepoint()
    found = times(cut, join, changed)
    model.graph.history.rollback(savepoint)
    pairs = set(matcher.rows("reached", (FREE, FREE)))
    graph = nx.DiGraph(edges)
    starts = graph if question == "all pairs" else [0]
    assert pairs == {(start, end) for start in starts for _, end in nx.edge_bfs(graph, start)}
    return len(pairs), found


def in_networkx(edges: Edges, size: int, starts: list[int], changed: Edges) -> float:
    """All descendants of the starts, after each change."""
    graph = nx.DiGraph(edges)

    def ask() -> int:
        return sum(len(nx.descendants(graph, start)) for start in starts)

    def cut(source: int, target: int) -> None:
        graph.remove_edge(source, target)
        ask()

    def join(source: int, target: int) -> None:
        graph.add_edge(source, target)
        ask()

    return times(cut, join, changed[:3])


def in_rustworkx(edges: Edges, size: int, starts: list[int], changed: Edges) -> float | None:
    """As `in_networkx`; None if it is not installed."""
    if rustworkx is None:
        return None
    graph = rustworkx.PyDiGraph()
    graph.add_nodes_from(range(size))
    graph.add_edges_from_no_data(edges)

    def ask() -> int:
        return sum(len(rustworkx.descendants(graph, start)) for start in starts)

    def cut(source: int, target: int) -> None:
        graph.remove_edge(source, target)
        ask()

    def join(source: int, target: int) -> None:
        graph.add_edge(source, target, None)
        ask()

    return times(cut, join, changed[:5])


def times(cut: Callable[[int, int], None], join: Callable[[int, int], None], changed: Edges) -> float:
    """Median of both changes together, in microseconds."""
    gc.collect()
    gc.freeze()
    found = []
    for edge in changed:
        started = perf_counter_ns()
        cut(*edge)
        join(*edge)
        found.append((perf_counter_ns() - started) / 1e3)
    gc.unfreeze()
    return median(found)
