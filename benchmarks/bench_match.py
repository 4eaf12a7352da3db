"""Ask the queries of the Burning Forest, 8x8: compiled matcher, naive matcher and views.

    python -m benchmarks match

Times are medians, first of all rows by a prepared function, then of existence with arguments checked. The model
changes between two calls, so that nothing that is remembered of a state is of use.
"""

from __future__ import annotations

from collections.abc import Callable
from statistics import median
from time import perf_counter
from typing import NamedTuple

import networkx as nx

from envgraph.graph import Model
from envgraph.match import FREE, CompiledMatcher, Matcher, ViewMatcher
from envgraph.pattern import Library
from tests.oracle.naive._naive import NaiveMatcher
from tests.unit.match.forest import forest, library


class Sizes(NamedTuple):
    """How often times are taken, and on how many tiles."""

    rounds: int
    tiles: int | None


FULL = Sizes(rounds=15, tiles=None)
QUICK = Sizes(rounds=1, tiles=2)


def main(sizes: Sizes) -> None:
    """Print the tables."""
    model, queries = forest(), library()
    print_preparation(model, queries)
    print_queries(model, queries, sizes)
    print_search_loop(model, queries, sizes)
    print_views(model, queries, sizes)


def print_preparation(model: Model, queries: Library) -> None:
    """What making an engine costs: all functions for all queries, first and again."""
    times = []
    for _ in range(5):
        started = perf_counter()
        matcher = CompiledMatcher(model, queries)
        for name in queries.names():
            matcher.prepare(name, ())
            matcher.exists(name, free(queries, name))
        times.append(1e3 * (perf_counter() - started))
    count = 2 * len(queries.names())
    print(f"plan and generate {count} functions: first {times[0]:.1f} ms, again {median(times[1:]):.1f} ms\n")


def print_queries(model: Model, queries: Library, sizes: Sizes) -> None:
    """Every query with all parameters free."""
    compiled, naive = CompiledMatcher(model, queries), NaiveMatcher(model, queries)
    print(f"{'query':24}{'matches':>8}" + 2 * f"{'compiled us':>13}{'naive us':>11}{'ratio':>8}")
    for name in queries.names():
        arguments = free(queries, name)
        cells = ""
        for ask in ("rows", "exists"):
            fast, slow = (
                time_of(model, question(kind, ask, name, arguments), sizes.rounds) for kind in (compiled, naive)
            )
            cells += f"{fast:13.2f}{slow:11.0f}{slow / fast:8.0f}"
        print(f"{name:24}{compiled.count(name, arguments):8}{cells}")
    print()


def question(matcher: Matcher, ask: str, name: str, arguments: tuple[object, ...]) -> Callable[[], object]:
    """All matches by a prepared function, or existence by the checked interface."""
    return matcher.prepare(name, ()) if ask == "rows" else lambda: matcher.exists(name, arguments)


def print_search_loop(model: Model, queries: Library, sizes: Sizes) -> None:
    """The inner step of a search: retype a tile, ask whether the map is solvable, take it back."""
    start, goal = model.graph.extent("StartTile")[0], model.graph.extent("GoalTile")[0]
    roads = list(model.graph.extent("RoadTile"))[: sizes.tiles]
    print(f"retype, solvable, rollback, mean over {len(roads)} tiles")
    for kind in (CompiledMatcher, NaiveMatcher):
        matcher: Matcher = kind(model, queries)
        matcher.exists("solvable", (start, goal))
        started = perf_counter()
        for tile in roads:
            savepoint = model.graph.history.savepoint()
            model.graph.retype(tile, "BurningTile")
            matcher.exists("solvable", (start, goal))
            model.graph.history.rollback(savepoint)
        print(f"{kind.__name__:26}{1e6 * (perf_counter() - started) / len(roads):10.1f} us")


VIEWS = (
    "startTileFixedLocation",
    "goalTileFixedLocation",
    "waterTileFixedLocation",
    "burningTile",
    "fireDensity",
    "solvable",
)
TARGET_US = 25.0


def print_views(model: Model, queries: Library, sizes: Sizes) -> None:
    """The same step with six views kept current, the closure behind `solvable` among them."""
    matcher = ViewMatcher(model, queries)
    watching = perf_counter()
    matcher.watch(*VIEWS)
    watching = perf_counter() - watching
    demand = CompiledMatcher(model, queries)
    roads = list(model.graph.extent("RoadTile"))[: sizes.tiles]
    arguments = {name: free(queries, name) for name in VIEWS}

    def times(ask: Callable[[], object]) -> list[float]:
        found = []
        for tile in roads * sizes.rounds:
            started = perf_counter()
            savepoint = model.graph.history.savepoint()
            model.graph.retype(tile, "BurningTile")
            ask()
            model.graph.history.rollback(savepoint)
            found.append(1e6 * (perf_counter() - started))
        return found

    views = times(matcher.watched_views.process_pending)
    matcher.unwatch(*VIEWS)
    asked = times(lambda: [demand.count(name, arguments[name]) for name in VIEWS])
    library_ = path_times(model, matcher, roads * sizes.rounds)
    ours = median(views)
    mark = " " if ours <= TARGET_US else "!"
    print(f"\nretype, six views current, rollback (views made in {1e3 * watching:.1f} ms)")
    print(f"{'views, us':34}{ours:10.1f}   target {TARGET_US:.0f}{mark}  least {min(views):.1f}")
    for label, others in (("six queries on demand, us", asked), ("networkx, has_path alone, us", library_)):
        print(f"{label:34}{median(others):10.1f}   ratio {median(others) / ours:.2f}")


def path_times(model: Model, matcher: Matcher, tiles: list[int]) -> list[float]:
    """The tile is taken out of a graph of networkx, the search for a path repeated, the tile put back."""
    passages = matcher.rows("passage", (FREE, FREE))
    graph = nx.DiGraph(passages)
    (start,), (goal,) = model.graph.extent("StartTile"), model.graph.extent("GoalTile")
    found = []
    for tile in tiles:
        edges = [*graph.in_edges(tile), *graph.out_edges(tile)]
        started = perf_counter()
        graph.remove_node(tile)
        nx.has_path(graph, start, goal)
        graph.add_edges_from(edges)
        found.append(1e6 * (perf_counter() - started))
        graph.add_node(tile)
    return found


def free(queries: Library, name: str) -> tuple[object, ...]:
    """Arguments that leave every parameter open."""
    return (FREE,) * len(queries.parameter_types(name))


def time_of(model: Model, ask: Callable[[], object], rounds: int) -> float:
    """Median time of a call in microseconds, in a state that was never asked about."""
    truck = model.nodes("FireTruck")[0]
    times = []
    for _ in range(rounds):
        calls, elapsed = 0, 0.0
        while elapsed < 2e-4:
            model.graph.set_object_name(truck.id, None if truck.cls == model.graph.object_name(truck.id) else truck.cls)
            started = perf_counter()
            ask()
            elapsed += perf_counter() - started
            calls += 1
        times.append(1e6 * elapsed / calls)
    return median(times)
