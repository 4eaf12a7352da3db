"""Keep two queries of a social network current (TTC 2018), beside SQLite and networkx.

    python -m benchmarks ttc18

The protocol of the case: build the initial model and answer; then apply one change set after the other, each in a
transaction, and answer after each. An answer is the three best of a query. Every answer is compared with the published
one, those of the peers too. An update is timed from the first write to the answer; text is parsed before. Times are of
the processor, since other programs share the machine. The peers compute their answers anew from their own, indexed
data: sqlite3 by recursive queries, networkx by its graph algorithms.

Growth is told in two ways: the time for a line of the change sets at scales 1 and 4, and the change sets of scale 4 in
a network of 16 copies of its initial model, that is, the same changes in a model 16 times as large.
"""

from __future__ import annotations

import gc
import sqlite3
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median
from time import process_time
from typing import NamedTuple, Protocol

import networkx

from benchmarks._social_media import (
    QUERIES,
    SCALES,
    Line,
    Podium,
    best,
    change_sets,
    copies,
    expected_answers,
    initial_lines,
    open_network,
)
from tests.facts import Fact, Notified

TARGET = 0.5
"""Milliseconds an update with both queries may take at scale 4."""

PUBLISHED = {
    "Q1": "0.46 YAMTL, AOF; 0.84 differential dataflow",
    "Q2": "0.17 GraphBLAS; 0.42-0.5 ATL, YAMTL",
}
"""Median milliseconds of an update at scale 64, from the publications of the contest."""

EXPECTED = expected_answers()


class Sizes(NamedTuple):
    """Scales, the largest last, runs that a median is of, change sets, and copies of the model to measure growth."""

    scales: tuple[int, ...]
    runs: int
    change_sets: int
    copies: int

    def changes(self, scale: int) -> list[list[Line]]:
        """Return the first change sets of a scale."""
        return change_sets(scale)[: self.change_sets]


FULL = Sizes(SCALES, runs=5, change_sets=20, copies=16)
QUICK = Sizes((1,), runs=1, change_sets=2, copies=2)


class Tool(Protocol):
    """What is measured: something that takes lines in and gives answers."""

    def insert(self, lines: Iterable[Line]) -> None:
        """Make the insertions."""

    def answer(self, query: str) -> list[int]:
        """The three best, best first."""


class Views:
    """envgraph, with the patterns of the queries watched from the start."""

    def __init__(self, queries: Iterable[str], lines: Iterable[Line]) -> None:
        self.engine, self.network = open_network()
        self.started = process_time()
        with self.engine.model.loading():
            self.network.insert(lines)
        self.loaded = process_time()
        self.podiums: dict[str, Podium] = {}
        for query in queries:
            pattern = QUERIES[query]
            self.engine.watch(pattern)
            self.podiums[query] = podium = Podium(self.engine.matches(pattern))
            self.engine.listen(pattern, podium.update)

    def insert(self, lines: Iterable[Line]) -> None:
        with self.engine.transaction():
            self.network.insert(lines)

    def answer(self, query: str) -> list[int]:
        return self.podiums[query].best()


class OnDemand:
    """envgraph without views: all scores are computed when they are asked for."""

    def __init__(self, _queries: Iterable[str], lines: Iterable[Line]) -> None:
        self.engine, self.network = open_network()
        self.started = process_time()
        with self.engine.model.loading():
            self.network.insert(lines)

    def insert(self, lines: Iterable[Line]) -> None:
        with self.engine.transaction():
            self.network.insert(lines)

    def answer(self, query: str) -> list[int]:
        return best(self.engine.matches(QUERIES[query]))


SQL_SCHEMA = """
    create table Post (id integer primary key, timestamp text);
    create table Comment (id integer primary key, timestamp text, above integer);
    create table Likes (comment integer, user integer, primary key (comment, user)) without rowid;
    create table Friends (one integer, other integer, primary key (one, other)) without rowid;
    create index Above on Comment (above);
"""
SQL_ANSWERS = {
    "Q1": """
        with recursive Thread (post, comment) as (
            select Post.id, Comment.id from Post join Comment on above = Post.id
            union all
            select post, Comment.id from Thread join Comment on above = comment
        ),
        Score (post, score) as (
            select post, sum(10 + (select count(*) from Likes where Likes.comment = Thread.comment))
            from Thread group by post
        )
        select id from Post left join Score on post = id
        order by coalesce(score, 0) desc, timestamp desc limit 3
    """,
    "Q2": """
        with recursive Circle (comment, one, other) as (
            select comment, user, user from Likes
            union
            select Circle.comment, Circle.one, Friends.other
            from Circle join Friends on Friends.one = Circle.other
            join Likes on Likes.comment = Circle.comment and Likes.user = Friends.other
        ),
        Score (comment, score) as (select comment, count(*) from Circle group by comment)
        select id from Comment left join Score on comment = id
        order by coalesce(score, 0) desc, timestamp desc limit 3
    """,
}
SQL_INSERTS = {
    "Posts": ("insert into Post values (?, ?)", (0, 1)),
    "Comments": ("insert into Comment values (?, ?, ?)", (0, 1, 4)),
    "Likes": ("insert into Likes values (?, ?)", (1, 0)),
    "Friends": ("insert or ignore into Friends values (?, ?)", (0, 1)),
}


class Sqlite:
    """sqlite3: four indexed tables and a recursive query for each question."""

    def __init__(self, _queries: Iterable[str], lines: Iterable[Line]) -> None:
        self.started = process_time()
        self.database = sqlite3.connect(":memory:")
        self.database.executescript(SQL_SCHEMA)
        self.insert(lines)
        self.database.execute("analyze")

    def insert(self, lines: Iterable[Line]) -> None:
        with self.database:
            for kind, *fields in lines:
                if kind == "Users":
                    continue
                statement, columns = SQL_INSERTS[kind]
                values = [fields[column] for column in columns]
                self.database.execute(statement, values)
                if kind == "Friends":
                    self.database.execute(statement, values[::-1])

    def answer(self, query: str) -> list[int]:
        return [id for (id,) in self.database.execute(SQL_ANSWERS[query])]


class Networkx:
    """networkx: descendants in the graph of comments, connected components among those who like one."""

    def __init__(self, _queries: Iterable[str], lines: Iterable[Line]) -> None:
        self.started = process_time()
        self.below, self.friends = networkx.DiGraph(), networkx.Graph()
        self.times: dict[str, dict[str, str]] = {"Posts": {}, "Comments": {}}
        self.likers: dict[str, list[str]] = {}
        self.insert(lines)

    def insert(self, lines: Iterable[Line]) -> None:
        for kind, *fields in lines:
            if kind == "Users":
                self.friends.add_node(fields[0])
            elif kind == "Friends":
                self.friends.add_edge(*fields)
            elif kind == "Likes":
                self.likers[fields[1]].append(fields[0])
            else:
                self.times[kind][fields[0]] = fields[1]
                self.below.add_node(fields[0])
                if kind == "Comments":
                    self.likers[fields[0]] = []
                    self.below.add_edge(fields[4], fields[0])

    def answer(self, query: str) -> list[int]:
        times, score = (
            (self.times["Posts"], self.post_score) if query == "Q1" else (self.times["Comments"], self.comment_score)
        )
        ranked = sorted(((score(id), time, id) for id, time in times.items()), reverse=True)
        return [int(id) for _, _, id in ranked[:3]]

    def post_score(self, post: str) -> int:
        return sum(10 + len(self.likers[comment]) for comment in networkx.descendants(self.below, post))

    def comment_score(self, comment: str) -> int:
        circles = networkx.connected_components(self.friends.subgraph(self.likers[comment]))
        return sum(len(circle) ** 2 for circle in circles)


@dataclass
class Times:
    """Seconds of several runs: until the first answers, and of each update."""

    initial: list[float] = field(default_factory=list)
    updates: list[float] = field(default_factory=list)

    @property
    def update(self) -> float:
        """Median of an update, in milliseconds."""
        return 1e3 * median(self.updates)


def main(sizes: Sizes) -> None:
    """Print the tables."""
    both = tuple(QUERIES)
    print(f"medians of {sizes.runs} runs of {sizes.change_sets} change sets each; all answers are the published ones\n")
    ours = print_updates([(), *((query,) for query in QUERIES), both], sizes)
    largest = sizes.scales[-1]
    print(f"\npublished at scale 64, ms: {'; '.join(f'{q}: {text}' for q, text in PUBLISHED.items())}")
    print(f"target: {TARGET} ms at scale 4 with both queries; at {largest}: {ours[largest].update:.3f} ms")
    print_sizes(ours, sizes)
    print_growth(ours[largest], sizes)
    print_peers(ours, sizes)


def print_updates(choices: Sequence[tuple[str, ...]], sizes: Sizes) -> dict[int, Times]:
    """Times with each choice of watched queries; gives those of the last choice by scale."""
    print(f"{'watched':10}" + "".join(f"{f'scale {scale}: first ms':>22}{'update ms':>12}" for scale in sizes.scales))
    found: dict[int, Times] = {}
    for queries in choices:
        found = {scale: measure(Views, queries, scale, sizes) for scale in sizes.scales}
        cells = "".join(f"{1e3 * median(t.initial):22.1f}{t.update:12.3f}" for t in found.values())
        print(f"{' and '.join(queries) or 'nothing':10}{cells}")
    return found


def print_sizes(ours: dict[int, Times], sizes: Sizes) -> None:
    """What an update costs by what it changes."""
    print(f"\n{'both':10}{'lines':>8}{'facts':>8}{'us a line':>12}{'us a fact':>12}   medians over the change sets")
    for scale, times in ours.items():
        lines, facts = [len(changes) for changes in sizes.changes(scale)], count_facts(scale, sizes)
        cells = f"{median(lines):8.1f}{median(facts):8.1f}"
        for counts, width in ((lines, 1), (facts, 2)):
            each = [1e6 * time / size for time, size in zip(times.updates, sizes.runs * counts, strict=True)]
            cells += f"{median(each):12.{width}f}"
        print(f"scale {scale:<4}{cells}")


def print_growth(small: Times, sizes: Sizes) -> None:
    """The same changes in a model many times as large."""
    large, scale = Times(), sizes.scales[-1]
    lines = copies(initial_lines(scale), sizes.copies)
    run(Views, tuple(QUERIES), lines, sizes.changes(scale), None, large)
    print(
        f"\n{sizes.copies} copies of scale {scale}, its change sets: first {1e3 * large.initial[0]:.0f} ms, "
        f"update {large.update:.3f} ms, {large.update / small.update:.2f} of that at scale {scale}"
    )


def print_peers(ours: dict[int, Times], sizes: Sizes) -> None:
    """Both queries by tools that compute them anew."""
    print(f"\n{'both':22}" + "".join(f"{f'scale {scale}: update ms':>22}{'ratio':>8}" for scale in sizes.scales))
    for name, tool in (
        ("envgraph on demand", OnDemand),
        (f"sqlite3 {sqlite3.sqlite_version}", Sqlite),
        (f"networkx {networkx.__version__}", Networkx),
    ):
        cells = ""
        for scale in sizes.scales:
            times = measure(tool, tuple(QUERIES), scale, sizes._replace(runs=1))
            cells += f"{times.update:22.2f}{times.update / ours[scale].update:8.0f}"
        print(f"{name:22}{cells}")


Maker = Callable[[Sequence[str], Iterable[Line]], Tool]


def measure(make: Maker, queries: Sequence[str], scale: int, sizes: Sizes) -> Times:
    """Times of the protocol of the case."""
    times = Times()
    lines, sets = initial_lines(scale), sizes.changes(scale)
    for _ in range(sizes.runs):
        run(make, queries, lines, sets, scale, times)
    return times


def run(
    make: Maker,
    queries: Sequence[str],
    lines: Sequence[Line],
    sets: Sequence[Sequence[Line]],
    scale: int | None,
    times: Times,
) -> None:
    """One run; answers are compared with those of the scale, if one is given."""
    gc.collect()
    tool = make(queries, lines)
    answers = [tool.answer(query) for query in queries]
    times.initial.append(process_time() - tool.started)
    compare(queries, answers, scale, 0)
    for number, changes in enumerate(sets, 1):
        started = process_time()
        tool.insert(changes)
        answers = [tool.answer(query) for query in queries]
        times.updates.append(process_time() - started)
        compare(queries, answers, scale, number)


def compare(queries: Sequence[str], answers: Sequence[list[int]], scale: int | None, number: int) -> None:
    """Refuse to print times of wrong answers."""
    for query, answer in zip(queries, answers, strict=True):
        if scale is not None and answer != EXPECTED[query, scale, number]:
            raise AssertionError(f"{query}, scale {scale}, after {number} change sets: {answer}")


class Counter:
    """Counts the elementary changes of a model."""

    def __init__(self) -> None:
        self.changes = 0

    def inserted(self, _fact: Fact) -> None:
        self.changes += 1

    def removing(self, _fact: Fact) -> None:
        self.changes += 1

    def restored(self) -> None:
        raise AssertionError("nothing is taken back here")


def count_facts(scale: int, sizes: Sizes) -> list[int]:
    """The number of elementary changes in each change set of a scale."""
    engine, network = open_network(initial_lines(scale))
    Notified(engine.model, counter := Counter())
    totals = [0]
    for changes in sizes.changes(scale):
        network.insert(changes)
        totals.append(counter.changes)
    return [after - before for before, after in pairwise(totals)]
