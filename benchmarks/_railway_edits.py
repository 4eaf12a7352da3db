"""The protocol of the Train Benchmark: which matches are chosen, and what is done at each.

The operations write ids straight to the model. `rules/railway` says the same as rules, of which the tests know.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from inspect import signature
from itertools import repeat

from benchmarks._railway import POSITIONS, SEED, JavaRandom, attribute, reference
from envgraph.graph import Model
from envgraph.match import FREE, Row
from envgraph.rewrite import Engine

ORDER = (
    "connectedSegments",
    "posLength",
    "routeSensor",
    "semaphoreNeighbor",
    "switchSet",
    "switchMonitored",
)
"""The operations in the order in which a batch chooses for them and runs them."""

Edit = Callable[..., None]
"""Takes a match, objects as ids."""


@dataclass(frozen=True, slots=True)
class Operation:
    """What is done at the matches of a pattern.

    Attributes:
        query: one of the six.
        rule: the rule that says the same.
        pattern: its matches are what is chosen from: for a repair the query, for an injection the rule's left side.
        edit: does it at a match; its parameters are variables of the pattern.
        columns: where those stand in a match of the pattern.
    """

    query: str
    rule: str
    pattern: str
    edit: Edit
    columns: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Quota:
    """How many matches of each operation a batch takes: a fixed number, or a percentage, rounded down."""

    percent: int = 0
    fixed: int = 0

    def of(self, total: int) -> int:
        """The number for this many matches."""
        return min(self.fixed, total) if self.fixed else total * self.percent // 100

    def __str__(self) -> str:
        return f"{self.fixed} fixed" if self.fixed else f"{self.percent} %"


QUOTAS = (Quota(percent=5), Quota(fixed=10))
BATCHES = 8

Chosen = tuple[Operation, list[Row]]


class Protocol:
    """A run: batch after batch is chosen, with one stream of random numbers, and done.

    >>> from benchmarks._railway import build, generate, workspace
    >>> domain = workspace()
    >>> engine = Engine(build(generate("repair", 1), domain.metamodel))
    >>> engine.add(*domain.definitions)
    >>> protocol = Protocol(engine, "repair", Quota(fixed=10))
    >>> for operation, rows in protocol.choose():
    ...     for row in rows:
    ...         operation.edit(*row)
    >>> [engine.count(query) for query in ("posLength", "routeSensor", "switchSet", "semaphoreNeighbor")]
    [42, 2, 1, 1]

    Args:
        engine: with the patterns and rules of the railway.
        kind: "repair" or "inject".
        quota: how much a batch does.
        seed: of the random numbers.
    """

    def __init__(self, engine: Engine, kind: str, quota: Quota, seed: int = SEED) -> None:
        self.engine = engine
        self.operations = operations(engine, kind)
        self.quota = quota
        self.random = JavaRandom(seed)

    def choose(self) -> list[Chosen]:
        """The next batch: for each operation the matches of now, by id, shuffled, and the first of them taken."""
        return [(operation, self._choose(operation)) for operation in self.operations]

    def _choose(self, operation: Operation) -> list[Row]:
        found = rows_of(self.engine, operation.pattern)
        rows = sorted(tuple(row[column] for column in operation.columns) for row in found)
        self.random.shuffle(rows)
        return rows[: self.quota.of(len(rows))]


def rows_of(engine: Engine, pattern: str) -> Sequence[Row]:
    """All matches of a pattern as ids."""
    free = repeat(FREE, len(engine.library.parameter_types(pattern)))
    return engine.matcher.rows(pattern, tuple(free))


def steps(batch: Sequence[Chosen]) -> Iterator[tuple[Operation, Row]]:
    """The single operations of a batch, in order. One whose match is gone by then is done all the same."""
    for operation, rows in batch:
        for row in rows:
            yield operation, row


def operations(engine: Engine, kind: str) -> list[Operation]:
    """The six operations of a kind ("repair" or "inject") on the model of an engine, in the order of a batch."""
    edits = (repairs if kind == "repair" else injections)(engine.model)
    found = []
    for query in ORDER:
        rule = f"railway.{kind}.{kind}{query[0].upper()}{query[1:]}"
        pattern = f"railway.{query}" if kind == "repair" else engine.prepare(rule).pattern
        names = [parameter.name for parameter in engine.library.get(pattern).parameters]
        columns = tuple(names.index(name) for name in signature(edits[query]).parameters)
        found.append(Operation(query, rule, pattern, edits[query], columns))
    return found


def repairs(model: Model) -> dict[str, Edit]:
    """By query, what mends a match of it."""
    metamodel = model.metamodel
    length, position, current = (attribute(metamodel, n) for n in ("length", "position", "currentPosition"))
    id_ = attribute(metamodel, "id")
    connects, monitored = reference(metamodel, "connectsTo"), reference(metamodel, "monitoredBy")
    requires, entry = reference(metamodel, "requires"), reference(metamodel, "entry")
    value, put, link, unlink = model.graph.value, model.graph.set_value, model.graph.link, model.graph.unlink
    new, set_target, set_targets = model.graph.new, model.graph.set_target, model.graph.set_targets

    def pos_length(segment: int) -> None:
        old = value(segment, length)
        assert isinstance(old, int)
        put(segment, length, -old + 1)

    def switch_monitored(sw: int) -> None:
        sensor = new("Sensor")
        put(sensor, id_, sensor)
        link(sw, monitored, sensor)

    def route_sensor(route: int, sensor: int, swP: int, sw: int) -> None:
        link(route, requires, sensor)

    def switch_set(semaphore: int, route: int, swP: int, sw: int) -> None:
        put(sw, current, value(swP, position))

    def connected_segments(
        sensor: int,
        segment1: int,
        segment2: int,
        segment3: int,
        segment4: int,
        segment5: int,
        segment6: int,
    ) -> None:
        unlink(segment1, connects, segment2)
        link(segment1, connects, segment3)
        set_targets(segment2, connects, ())
        set_targets(segment2, monitored, ())

    def semaphore_neighbor(
        semaphore: int, route1: int, route2: int, sensor1: int, sensor2: int, te1: int, te2: int
    ) -> None:
        set_target(route2, entry, semaphore)

    return {
        "posLength": pos_length,
        "switchMonitored": switch_monitored,
        "routeSensor": route_sensor,
        "switchSet": switch_set,
        "connectedSegments": connected_segments,
        "semaphoreNeighbor": semaphore_neighbor,
    }


def injections(model: Model) -> dict[str, Edit]:
    """By query, what makes a match of it, or comes near."""
    metamodel = model.metamodel
    length, current, id_ = (attribute(metamodel, n) for n in ("length", "currentPosition", "id"))
    connects, monitored = reference(metamodel, "connectsTo"), reference(metamodel, "monitoredBy")
    requires, entry = reference(metamodel, "requires"), reference(metamodel, "entry")
    elements = reference(metamodel, "elements")
    value, put, link, unlink = model.graph.value, model.graph.set_value, model.graph.link, model.graph.unlink
    new, set_target, set_targets = model.graph.new, model.graph.set_target, model.graph.set_targets
    turned = dict(zip(POSITIONS, POSITIONS[1:] + POSITIONS[:1], strict=True))

    def pos_length(segment: int) -> None:
        put(segment, length, 0)

    def switch_monitored(sw: int) -> None:
        set_targets(sw, monitored, ())

    def route_sensor(route: int, sensor: int) -> None:
        unlink(route, requires, sensor)

    def switch_set(sw: int) -> None:
        put(sw, current, turned[str(value(sw, current))])

    def connected_segments(sensor: int, segment1: int, segment3: int, region: int) -> None:
        segment2 = new("Segment")
        put(segment2, id_, segment2)
        put(segment2, length, 500)
        link(region, elements, segment2)
        unlink(segment1, connects, segment3)
        link(segment1, connects, segment2)
        link(segment2, connects, segment3)
        link(segment2, monitored, sensor)

    def semaphore_neighbor(route: int, semaphore: int) -> None:
        set_target(route, entry, None)

    return {
        "posLength": pos_length,
        "switchMonitored": switch_monitored,
        "routeSensor": route_sensor,
        "switchSet": switch_set,
        "connectedSegments": connected_segments,
        "semaphoreNeighbor": semaphore_neighbor,
    }
