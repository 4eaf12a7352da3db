"""Keep six queries current while a railway is repaired (Train Benchmark), beside other tools.

    python -m benchmarks train

The protocol: build the model and the views of all six queries; then eight times choose matches by Java's random
numbers, and repair each. An operation is timed alone, from its first write until all six views are current, inside an
open transaction (so all of it can be rolled back); nothing is done twice before it is timed, so memory is cold. An
operation that finds its match repaired already, and changes nothing, is not counted; in brackets: how many were
timed. Every batch is then rolled back, timed, and done again. At the end the views are compared with what the queries
find. envgraph does all of that three times, each time with a model and views just built.

The peers get the same model, and the same elementary changes. CLIPS keeps the matches current too; the databases answer
all six queries anew; VF2 answers the one query that is nothing but a graph. Published figures are those of the tools'
authors on other machines. Each tool runs in a process of its own. Figures are medians; those in seconds or milliseconds
are of processor time, because other programs share the machine, those in microseconds of real time.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from statistics import median
from time import perf_counter_ns, process_time
from typing import NamedTuple, TypeVar

from benchmarks._railway import QUERIES, Railway, build, generate, workspace
from benchmarks._railway_edits import BATCHES, ORDER, QUOTAS, Operation, Protocol, Quota, rows_of, steps
from benchmarks._railway_peers import (
    Change,
    Clips,
    DuckDB,
    Recorder,
    SQLite,
    clips,
    duckdb,
    networkx_chain,
    records,
    rustworkx,
    rustworkx_chain,
)
from envgraph.graph import Model
from envgraph.match import CompiledMatcher, Row, ViewMatcher
from envgraph.rewrite import Engine

PEERS = ("clips", "duckdb", "rustworkx")


class Sizes(NamedTuple):
    """Sizes of railways, the largest last, those for VF2, and how often envgraph and the databases are measured."""

    railways: tuple[int, ...]
    vf2: tuple[int, ...]
    repeats: int


FULL = Sizes((64, 256), vf2=(1, 8), repeats=3)
QUICK = Sizes((1,), vf2=(1,), repeats=1)


@dataclass(frozen=True, slots=True)
class Targets:
    """What our figures must not exceed; None where nothing is asked."""

    built: float | None = None
    memory: float | None = None
    asked: float | None = None
    over_kinds: float | None = None
    kind: float | None = None
    rollback: float | None = None
    growth: float | None = None


TARGETS = Targets(built=1.0, memory=0.25, asked=0.1, over_kinds=10, kind=30, rollback=0.3, growth=1.3)
"""For size 64, and for the growth from there to 256."""

Others = dict[str, float | tuple[float, float] | None]
"""Figures of other tools, or ranges of them."""

VIATRA = "VIATRA, published"
VIATRA_BUILD = {64: 6.2, 256: 29.0}
"""Seconds to read a model and build the network."""

VIATRA_EDIT = {64: (44, 58), 256: (77, 107)}
"""Microseconds an edit."""

VIATRA_SEARCH = {64: 2.7, 256: 9.8}
"""Seconds of local search, without a network, for all six queries."""

VIATRA_MEMORY: Others = {VIATRA: 1.9}
"""Kilobytes a node or edge."""

VIATRA_GROWTH: Others = {VIATRA: (1.7, 2.0)}
"""Growth of an edit from size 64 to 256."""

Result = TypeVar("Result")


@dataclass(slots=True)
class Edits:
    """The batches of one protocol.

    Attributes:
        micros: by query, how long each of its operations took.
        rollbacks: for each batch, how long taking it back took, as a part of the time of the batch.
    """

    micros: dict[str, list[float]] = field(default_factory=dict)
    rollbacks: list[float] = field(default_factory=list)

    @property
    def over_kinds(self) -> float:
        """Median over the kinds of operations of the median of each."""
        return median(median(times) for times in self.micros.values())


@dataclass(slots=True)
class Figures:
    """What one tool took at one size, times in seconds, memory in kilobytes a node or edge; None if not measured."""

    load: float = 0.0
    views: float = 0.0
    memory: float | None = None
    asked_first: float = 0.0
    asked: float = 0.0
    edits: dict[str, Edits] = field(default_factory=dict)

    @property
    def built(self) -> float:
        """Model and views."""
        return self.load + self.views


def main(sizes: Sizes) -> None:
    """Print the figures."""
    figures: dict[tuple[str, int], Figures] = {}
    for size in sizes.railways:
        for tool, measure in TOOLS.items():
            if measure is not None:
                figures[tool, size] = in_fresh_process(measure, size, sizes.repeats)
        figures["envgraph", size].memory = in_fresh_process(measure_memory, size)
        report(size, figures)
    report_growth(sizes.railways, figures)
    report_vf2(sizes)


def in_fresh_process(measure: Callable[..., Result], *arguments: object) -> Result:
    """Call a function in a new process, whose memory nobody has used before."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(measure, *arguments).result()


# --- envgraph


class Case:
    """A railway, and the files that say what is asked of it and done to it."""

    def __init__(self, railway: Railway) -> None:
        self.railway = railway
        self.domain = workspace()

    def open(self) -> Engine:
        """A new engine on a model of the railway, with all queries and rules."""
        assert self.domain.metamodel is not None
        engine = Engine(build(self.railway, self.domain.metamodel))
        engine.add(*self.domain.definitions)
        return engine

    def watched(self) -> Engine:
        """As `open`, with the six queries kept current."""
        engine = self.open()
        watch(engine)
        return engine


def watch(engine: Engine) -> None:
    """Keep the six queries current."""
    engine.watch(*(f"railway.{query}" for query in QUERIES))


def measure_envgraph(size: int, repeats: int) -> Figures:
    """Everything but memory."""
    case = Case(generate("repair", size))
    found = Figures()
    models, views = [], []
    for _ in range(repeats):
        started = process_time()
        engine = case.open()
        models.append(process_time() - started)
        started = process_time()
        watch(engine)
        views.append(process_time() - started)
    found.load, found.views = median(models), median(views)
    ask_on_demand(case.open(), found, repeats)
    for quota in QUOTAS:
        edits = found.edits[str(quota)] = Edits()
        for _ in range(repeats):  # a batch takes milliseconds; on a shared machine one run says little
            repair(case.watched(), quota, edits)
            gc.collect()
    return found


def ask_on_demand(engine: Engine, found: Figures, repeats: int) -> None:
    """All six queries without views: with planning, and then with the functions at hand."""
    matcher = CompiledMatcher(engine.model, engine.library)
    gc.collect()
    gc.freeze()
    times: list[float] = []
    for _ in range(1 + repeats):
        engine.model.graph.set_object_name(0, f"round {len(times)}")  # another state: nothing remembered is of use
        started = process_time()
        for query in QUERIES:
            matcher.prepare(f"railway.{query}", ())()
        times.append(process_time() - started)
    gc.unfreeze()
    found.asked_first, found.asked = times[0], median(times[1:])


def repair(engine: Engine, quota: Quota, edits: Edits) -> None:
    """The eight batches of a protocol; their times are added to `edits`."""
    protocol = Protocol(engine, "repair", quota)
    assert isinstance(engine.matcher, ViewMatcher)
    model, settle = engine.model, engine.matcher.watched_views.process_pending
    gc.collect()
    gc.freeze()
    for _ in range(BATCHES):
        batch = list(steps(protocol.choose()))
        savepoint = model.graph.history.savepoint()
        taken = timed(batch, model, settle, edits.micros)
        if taken:
            started = perf_counter_ns()
            model.graph.history.rollback(savepoint)
            settle()
            edits.rollbacks.append((perf_counter_ns() - started) / 1e3 / taken)
        else:
            model.graph.history.release(savepoint)
        for operation, row in batch:
            operation.edit(*row)
    gc.unfreeze()
    check(engine)


def timed(
    batch: list[tuple[Operation, Row]],
    model: Model,
    settle: Callable[[], object],
    micros: dict[str, list[float]],
) -> float:
    """Do a batch, add the time of each operation that changes something to `micros`, and return the sum."""
    total = 0.0
    for operation, row in batch:
        edit, revision = operation.edit, model.graph.store.revision
        started = perf_counter_ns()
        edit(*row)
        settle()
        taken = (perf_counter_ns() - started) / 1e3
        if model.graph.store.revision != revision:
            micros.setdefault(operation.query, []).append(taken)
            total += taken
    return total


def check(engine: Engine) -> None:
    """The views hold what the queries find anew.

    Raises:
        AssertionError: they do not; then the figures are worth nothing.
    """
    anew = CompiledMatcher(engine.model, engine.library)
    for query in QUERIES:
        pattern = f"railway.{query}"
        assert sorted(rows_of(engine, pattern)) == sorted(anew.prepare(pattern, ())()), query


def measure_memory(size: int) -> float | None:
    """Memory above that of an engine with the same views on an empty model; None where nobody knows."""
    case, empty = Case(generate("repair", size)), Case(Railway()).watched()
    gc.collect()
    before = resident()
    engine = case.watched()
    gc.collect()
    after = resident()
    assert engine.count("railway.posLength") > 0 == empty.count("railway.posLength")
    return kilobytes(case.railway, before, after)


def kilobytes(railway: Railway, before: int | None, after: int | None) -> float | None:
    """What was needed between two times, for each node and edge."""
    if before is None or after is None or after <= before:  # a small model may fit into memory that was freed
        return None
    return (after - before) / 1024 / (railway.node_count + railway.edge_count)


def resident() -> int | None:
    """Bytes of memory that this process has in use, where the system tells (Linux)."""
    file = Path("/proc/self/statm")
    return int(file.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") if file.is_file() else None


# --- peers


def measure_clips(size: int, _repeats: int) -> Figures:
    """Building the network, and the changes of every operation; its rollback is the changes in reverse."""
    railway = generate("repair", size)
    everything = list(records(railway))
    found = Figures()
    environment = Clips()
    before = resident()
    started = process_time()
    environment.load(everything)
    found.load = process_time() - started
    found.memory = kilobytes(railway, before, resident())
    for quota in QUOTAS:
        batches = recorded(railway, quota)
        gc.collect()
        gc.freeze()
        found.edits[str(quota)] = replay(environment, batches)
        gc.unfreeze()
    return found


Recorded = list[tuple[str, list[Change]]]
"""A batch: for each operation its query and its elementary changes."""


def recorded(railway: Railway, quota: Quota) -> list[Recorded]:
    """The elementary changes of all operations of a protocol."""
    engine = Case(railway).open()
    protocol = Protocol(engine, "repair", quota)
    recorder = Recorder(engine.model)
    batches = []
    for _ in range(BATCHES):
        batch: Recorded = []
        for operation, row in steps(protocol.choose()):
            operation.edit(*row)
            changes = recorder.take()
            if changes:
                batch.append((operation.query, changes))
        batches.append(batch)
    return batches


def replay(environment: Clips, batches: list[Recorded]) -> Edits:
    """Do the batches, each with its way back in between; at the end the facts are as they were."""
    edits = Edits()
    for batch in batches:
        total = 0.0
        for query, changes in batch:
            taken = clocked(environment, changes)
            edits.micros.setdefault(query, []).append(taken)
            total += taken
        back = undoing([change for _, changes in batch for change in changes])
        if back:
            edits.rollbacks.append(clocked(environment, back) / total)
        clocked(environment, [change for _, changes in batch for change in changes])
    clocked(environment, undoing([change for batch in batches for _, changes in batch for change in changes]))
    return edits


def undoing(changes: list[Change]) -> list[Change]:
    return [(not added, record) for added, record in reversed(changes)]


def clocked(environment: Clips, changes: Iterable[Change]) -> float:
    """Microseconds of some changes."""
    apply = environment.apply
    started = perf_counter_ns()
    for change in changes:
        apply(change)
    return (perf_counter_ns() - started) / 1e3


def measure_sqlite(size: int, repeats: int) -> Figures:
    return measure_database(SQLite(), size, repeats)


def measure_duckdb(size: int, repeats: int) -> Figures:
    return measure_database(DuckDB(), size, repeats)


def measure_database(database: SQLite | DuckDB, size: int, repeats: int) -> Figures:
    """Loading, and the six queries."""
    railway = generate("repair", size)
    found = Figures()
    started = process_time()
    database.load(railway)
    found.load = process_time() - started
    times = []
    for _ in range(1 + repeats):
        started = process_time()
        for query in QUERIES:
            database.rows(query)
        times.append(process_time() - started)
    found.asked_first, found.asked = times[0], median(times[1:])
    return found


TOOLS: dict[str, Callable[[int, int], Figures] | None] = {
    "envgraph": measure_envgraph,
    "CLIPS": measure_clips if clips else None,
    "SQLite": measure_sqlite,
    "DuckDB": measure_duckdb if duckdb else None,
}


# --- tables


def report(size: int, figures: Mapping[tuple[str, int], Figures]) -> None:
    """All figures of a size."""
    tools = {tool: figures[tool, size] for tool in TOOLS if (tool, size) in figures}
    ours, railway = tools.pop("envgraph"), generate("repair", size)
    print(f"\nrepair-{size}: {railway.node_count:,} nodes, {railway.edge_count:,} edges")
    print(f"{'':46}{'envgraph':>10}{'target':>8}   others (and how many times ours)")
    goal = TARGETS if size == 64 else Targets()
    built: Others = {tool: found.load for tool, found in tools.items() if found.edits}
    line("build the model and six views, s", ours.built, goal.built, built | published(VIATRA_BUILD, size))
    line("  of which the model, s", ours.load, None, {t: f.load for t, f in tools.items() if not f.edits})
    memory: Others = {tool: found.memory for tool, found in tools.items()}
    line("memory of a node or edge, with all views, kB", ours.memory, goal.memory, memory | VIATRA_MEMORY)
    asked: Others = {tool: found.asked for tool, found in tools.items() if found.asked}
    asked |= published(VIATRA_SEARCH, size)
    line("all six queries once, without views, s", ours.asked, goal.asked, asked)
    line("  the first time, with planning, s", ours.asked_first)
    for quota in map(str, QUOTAS):
        others = {tool: found.edits[quota] for tool, found in tools.items() if found.edits}
        report_edits(f"{quota} x {BATCHES}", ours.edits[quota], others, size)


def report_edits(protocol: str, ours: Edits, tools: Mapping[str, Edits], size: int) -> None:
    """The operations of a protocol, and rolling its batches back."""
    goal = TARGETS if size == 64 else Targets()
    others: Others = {tool: found.over_kinds for tool, found in tools.items()}
    others |= published(VIATRA_EDIT, size)
    line(f"{protocol}: one repair, median over kinds, us", ours.over_kinds, goal.over_kinds, others)
    for query in ORDER:
        if query in ours.micros:
            name = f"  {query} ({len(ours.micros[query])})"
            others = {tool: median(found.micros[query]) for tool, found in tools.items()}
            line(name, median(ours.micros[query]), goal.kind, others)
    others = {f"{tool}, changes in reverse": median(found.rollbacks) for tool, found in tools.items()}
    line("  rollback of a batch, as part of the batch", median(ours.rollbacks), goal.rollback, others)


def report_growth(sizes: tuple[int, ...], figures: Mapping[tuple[str, int], Figures]) -> None:
    """How much slower an operation is in the larger model."""
    small, large = sizes[0], sizes[-1]
    print(f"\ngrowth from size {small} to {large}")
    goal = TARGETS if sizes == FULL.railways else Targets()
    for quota in map(str, QUOTAS):
        growth: dict[str, float] = {}
        for tool in TOOLS:
            if (tool, small) in figures and figures[tool, small].edits:
                before, after = (figures[tool, size].edits[quota].over_kinds for size in (small, large))
                growth[tool] = after / before
        ours = growth.pop("envgraph")
        others: Others = {**growth, **(VIATRA_GROWTH if sizes == FULL.railways else {})}
        line(f"{quota} x {BATCHES}: one repair, median over kinds", ours, goal.growth, others)


def report_vf2(sizes: Sizes) -> None:
    """ConnectedSegments as a graph, in small models."""
    print("\nconnectedSegments alone, once, without views, ms")
    for size in sizes.vf2:
        railway = generate("repair", size)
        engine = Case(railway).open()
        ask = CompiledMatcher(engine.model, engine.library).prepare("railway.connectedSegments", ())
        others: Others = {
            name: milliseconds(make(railway), sizes.repeats)
            for name, make in (("networkx VF2", networkx_chain), ("rustworkx VF2", rustworkx_chain))
            if make is networkx_chain or rustworkx is not None
        }
        line(f"repair-{size}", milliseconds(lambda: len(ask()), sizes.repeats), None, others)  # noqa: B023


def milliseconds(ask: Callable[[], int], repeats: int) -> float:
    """Median time of a question."""
    times = []
    for _ in range(repeats):
        started = process_time()
        ask()
        times.append(1e3 * (process_time() - started))
    return median(times)


def published(by_size: Mapping[int, float | tuple[float, float]], size: int) -> Others:
    """What VIATRA's authors published for a size."""
    return {VIATRA: by_size[size]} if size in by_size else {}


def line(name: str, ours: float | None, target: float | None = None, others: Others | None = None) -> None:
    """One figure: ours, what it must not exceed ("!" where it does), the others and how many times ours they are."""
    if ours is None:
        print(f"{name:46}{'unknown':>10}")
        return
    mark = "" if target is None else f"{target:g}" + (" " if ours <= target else "!")
    beside = ", ".join(f"{tool} {beside_ours(value, ours)}" for tool, value in (others or {}).items() if value)
    print(f"{name:46}{digits(ours):>10}{mark:>9}  {beside}".rstrip())


def beside_ours(value: float | tuple[float, float], ours: float) -> str:
    """A figure of another tool, or a range of them, and how many times ours it is."""
    values = value if isinstance(value, tuple) else (value,)
    return f"{'-'.join(map(digits, values))} ({'-'.join(digits(each / ours) for each in values)}x)"


def digits(value: float) -> str:
    """A number with three significant digits at least."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"
