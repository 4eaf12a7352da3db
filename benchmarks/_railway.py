"""The railway models of the Train Benchmark: its generator, draw for draw, and the model made from what it says.

The generator draws from `java.util.Random`, so that sizes and match counts are those that others publish. It gives
plain data, the same for every tool that is measured:

>>> railway = generate("repair", 1)
>>> railway.node_count, railway.edge_count
(741, 2100)

The format and the numbers are those of G. Szarnyas, B. Izso, I. Rath, D. Varro: "The Train Benchmark: cross-technology
performance evaluation of continuous model queries", Software & Systems Modeling 17 (2018).
"""

from __future__ import annotations

from collections.abc import Iterator, MutableSequence, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from envgraph.graph import Model
from envgraph.lang import Workspace, data_path, load_workspace
from envgraph.metamodel import Attribute, Metamodel, Reference

QUERIES = (
    "posLength",
    "switchMonitored",
    "routeSensor",
    "switchSet",
    "connectedSegments",
    "semaphoreNeighbor",
)
"""The six queries, in the order in which counts are listed."""

POSITIONS = ("FAILURE", "STRAIGHT", "DIVERGING")
OWNERS = {
    "routes": "RailwayContainer",
    "regions": "RailwayContainer",
    "id": "RailwayElement",
    "active": "Route",
    "length": "Segment",
    "currentPosition": "Switch",
    "position": "SwitchPosition",
    "signal": "Semaphore",
    "elements": "Region",
    "sensors": "Region",
    "entry": "Route",
    "exit": "Route",
    "follows": "Route",
    "requires": "Route",
    "monitoredBy": "TrackElement",
    "connectsTo": "TrackElement",
    "semaphores": "Segment",
    "target": "SwitchPosition",
}
"""The class that declares each feature."""

SEED = 19871053
ROUTES_PER_SIZE = 5
MAX_SWITCHES = 20
MAX_SENSORS = 10
SEGMENTS_PER_SENSOR = 5
MAX_LENGTH = 1000

_MULTIPLIER = 0x5DEECE66D
_MASK = (1 << 48) - 1


class JavaRandom:
    """`java.util.Random`: a linear congruential generator of 48 bits.

    The documentation of the class fixes it: x -> (x * 0x5DEECE66D + 0xB) mod 2^48 (D. H. Lehmer; Knuth, The Art of
    Computer Programming 2, 3.2.1), starting from seed xor 0x5DEECE66D.

    >>> random = JavaRandom(42)
    >>> [random.next_int(10) for _ in range(5)], random.next_int(8)
    ([0, 3, 8, 4, 0], 7)
    """

    def __init__(self, seed: int) -> None:
        self.state = (seed ^ _MULTIPLIER) & _MASK

    def _bits(self) -> int:
        """The upper 31 bits of the next state."""
        self.state = state = (self.state * _MULTIPLIER + 0xB) & _MASK
        return state >> 17

    def next_int(self, bound: int) -> int:
        """A number from 0 to `bound` - 1; `bound` is from 1 to 2^31 - 1."""
        bits = self._bits()
        if bound & (bound - 1) == 0:
            return (bound * bits) >> 31
        # The last stretch of numbers, if it is shorter than `bound`, would favour small remainders.
        while bits - bits % bound + bound - 1 >= 1 << 31:
            bits = self._bits()
        return bits % bound

    def shuffle(self, items: MutableSequence[Any]) -> None:
        """`java.util.Collections.shuffle`: in place, from the end.

        >>> items = [1, 2, 3, 4, 5]
        >>> JavaRandom(42).shuffle(items)
        >>> items
        [2, 3, 4, 5, 1]
        """
        for size in range(len(items), 1, -1):
            other = self.next_int(size)
            items[size - 1], items[other] = items[other], items[size - 1]


@dataclass(frozen=True, slots=True)
class Errors:
    """How often the generator makes a mistake of each kind: in percent, `reachability` per mille."""

    connected_segments: int
    pos_length: int
    route_sensor: int
    semaphore_neighbor: int
    switch_monitored: int
    switch_set: int
    reachability: int


SCENARIOS = {
    "batch": Errors(0, 0, 0, 0, 0, 0, 0),
    "inject": Errors(5, 2, 4, 7, 2, 8, 2),
    "repair": Errors(5, 10, 10, 25, 18, 15, 1),
}


@dataclass(slots=True)
class Railway:
    """A railway as plain data.

    Attributes:
        classes: the class of each element; that of element `i` is at `i - 1`.
        values: for each attribute but `id` the elements that have a value, and it; literals of enums as their names.
        edges: for each reference its links, each in the direction in which the benchmark counts it: of two opposite
            references only one is here. The container of all routes and regions is no element, and is left out.
    """

    classes: list[str] = field(default_factory=list)
    values: dict[str, list[tuple[int, int | bool | str]]] = field(default_factory=dict)
    edges: dict[str, list[tuple[int, int]]] = field(default_factory=dict)

    @property
    def node_count(self) -> int:
        """Number of elements."""
        return len(self.classes)

    @property
    def edge_count(self) -> int:
        """Number of links, an opposite pair counted once."""
        return sum(map(len, self.edges.values()))


def generate(scenario: str, size: int) -> Railway:
    """The railway of a scenario ("batch", "inject" or "repair") and size (1, 2, 4, ...)."""
    return _Generator(SCENARIOS[scenario]).run(ROUTES_PER_SIZE * size)


class _Generator:
    """One run: a stream of random numbers for each kind of mistake, and one for each kind of number."""

    def __init__(self, errors: Errors) -> None:
        self.railway = Railway()
        self.errors = errors
        self.connected_segments, self.pos_length, self.route_sensor = (JavaRandom(SEED + k) for k in (0, 1, 2))
        self.semaphore_neighbor, self.switch_monitored = JavaRandom(SEED + 3), JavaRandom(SEED + 4)
        self.switch_set, self.reachability = JavaRandom(SEED + 5), JavaRandom(SEED + 8)
        self.lengths, self.positions, self.sensors, self.switches = (JavaRandom(SEED) for _ in range(4))

    def run(self, routes: int) -> Railway:
        first_exit = entry = self.semaphore()
        first = before = 0
        for number in range(routes):
            leave = first_exit if number == routes - 1 else self.semaphore()
            tracks = self.route(entry, leave)
            if before:
                self.edge("connectsTo", before, tracks[0])
            first, before, entry = first or tracks[0], tracks[-1], leave
        self.edge("connectsTo", before, first)
        return self.railway

    def route(self, entry: int, leave: int) -> list[int]:
        """A route with its region; returns its track elements in a row."""
        route = self.node("Route", active=True)
        if self.semaphore_neighbor.next_int(100) >= self.errors.semaphore_neighbor:
            self.edge("entry", route, entry)
        self.edge("exit", route, leave)
        region = self.node("Region")
        tracks: list[int] = []
        for _ in range(self.switches.next_int(MAX_SWITCHES - 1) + 1):
            tracks += self.switch(route, region)
        self.edge("semaphores", next(t for t in tracks if self.railway.classes[t - 1] == "Segment"), leave)
        for one, other in pairwise(tracks):
            if self.reachability.next_int(1000) >= self.errors.reachability:
                self.edge("connectsTo", one, other)
        return tracks

    def switch(self, route: int, region: int) -> list[int]:
        """A switch of a route, its sensors and their segments; returns it and the segments."""
        current = self.positions.next_int(3)
        switch = self.node("Switch", currentPosition=POSITIONS[current])
        self.edge("elements", region, switch)
        tracks = [switch]
        for _ in range(self.sensors.next_int(MAX_SENSORS - 1) + 1):
            sensor = self.node("Sensor")
            self.edge("sensors", region, sensor)
            if self.switch_monitored.next_int(100) >= self.errors.switch_monitored:
                self.edge("monitoredBy", switch, sensor)
                # Only here is there a draw, and a requirement, so a sensor without its switch is not required either.
                if self.route_sensor.next_int(100) >= self.errors.route_sensor:
                    self.edge("requires", route, sensor)
            tracks += [self.segment(region, sensor) for _ in range(SEGMENTS_PER_SENSOR)]
            if self.connected_segments.next_int(100) < self.errors.connected_segments:
                tracks.append(self.segment(region, sensor))
        wrong = self.switch_set.next_int(100) < self.errors.switch_set
        position = self.node("SwitchPosition", position=POSITIONS[2 - current if wrong else current])
        self.edge("target", position, switch)
        self.edge("follows", route, position)
        return tracks

    def segment(self, region: int, sensor: int) -> int:
        wrong = self.pos_length.next_int(100) < self.errors.pos_length
        length = (-1 if wrong else 1) * self.lengths.next_int(MAX_LENGTH) + 1
        segment = self.node("Segment", length=length)
        self.edge("elements", region, segment)
        self.edge("monitoredBy", segment, sensor)
        return segment

    def semaphore(self) -> int:
        return self.node("Semaphore", signal="GO")

    def node(self, cls: str, **values: int | bool | str) -> int:
        self.railway.classes.append(cls)
        number = len(self.railway.classes)
        for name, value in values.items():
            self.railway.values.setdefault(name, []).append((number, value))
        return number

    def edge(self, name: str, source: int, target: int) -> None:
        self.railway.edges.setdefault(name, []).append((source, target))


def workspace() -> Workspace:
    """The bundled domain: metamodel, queries, and the rules of both kinds."""
    return load_workspace([data_path("rules", "railway")])


def build(railway: Railway, metamodel: Metamodel) -> Model:
    """The railway as a model, built as fast as the public interface allows, and without a history.

    The container is object 0, so that the id of every element is also its `id`.
    """
    model = Model(metamodel, "railway")
    with model.loading():
        # The model's own ints go into the links: comparing one with itself is faster than with an equal one.
        ids = [model.graph.new("RailwayContainer"), *_elements(model, railway)]
        _add_values(model, railway, ids)
        _add_links(model, railway, ids)
    return model


def attribute(metamodel: Metamodel, name: str) -> Attribute:
    """An attribute of the railway by its name."""
    found = metamodel.feature(OWNERS[name], name)
    assert isinstance(found, Attribute)
    return found


def reference(metamodel: Metamodel, name: str) -> Reference:
    """A reference of the railway by its name."""
    found = metamodel.feature(OWNERS[name], name)
    assert isinstance(found, Reference)
    return found


def _elements(model: Model, railway: Railway) -> Iterator[int]:
    new, put = model.graph.new, model.graph.set_value
    number = attribute(model.metamodel, "id")
    for cls in railway.classes:
        node = new(cls)
        put(node, number, node)
        yield node


def _add_values(model: Model, railway: Railway, ids: Sequence[int]) -> None:
    put = model.graph.set_value
    for name, values in railway.values.items():
        feature = attribute(model.metamodel, name)
        for node, value in values:
            put(ids[node], feature, value)


def _add_links(model: Model, railway: Railway, ids: Sequence[int]) -> None:
    link = model.graph.link
    for name, edges in railway.edges.items():
        feature = reference(model.metamodel, name)
        for source, target in edges:
            link(ids[source], feature, ids[target])
    for name, cls in (("routes", "Route"), ("regions", "Region")):
        feature = reference(model.metamodel, name)
        for part in model.graph.extent(cls):
            link(ids[0], feature, part)
