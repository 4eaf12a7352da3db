"""The six queries of the Train Benchmark as plain loops over a model: an oracle that owes the matchers nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from envgraph.graph import Model, Node

Tuple = tuple[int, ...]


def pos_length(model: Model) -> Iterator[Tuple]:
    return ((segment.id,) for segment in model.nodes("Segment") if segment.length <= 0)


def switch_monitored(model: Model) -> Iterator[Tuple]:
    return ((switch.id,) for switch in model.nodes("Switch") if not switch.monitoredBy)


def route_sensor(model: Model) -> Iterator[Tuple]:
    for route in model.nodes("Route"):
        required = {sensor.id for sensor in route.requires}
        for position in route.follows:
            for sensor in position.target.monitoredBy:
                if sensor.id not in required:
                    yield route.id, sensor.id, position.id, position.target.id


def switch_set(model: Model) -> Iterator[Tuple]:
    for route in model.nodes("Route"):
        if route.active and route.entry and route.entry.signal == "GO":
            for position in route.follows:
                if position.position != position.target.currentPosition:
                    yield route.entry.id, route.id, position.id, position.target.id


def connected_segments(model: Model) -> Iterator[Tuple]:
    for sensor in model.nodes("Sensor"):
        monitored = {element.id for element in sensor.monitors if element.cls == "Segment"}
        following = {id: [t.id for t in model.node(id).connectsTo if t.id in monitored] for id in monitored}
        rows: list[Tuple] = [(id,) for id in monitored]
        for _ in range(5):
            rows = [(*row, other) for row in rows for other in following[row[-1]]]
        yield from ((sensor.id, *row) for row in rows)


def semaphore_neighbor(model: Model) -> Iterator[Tuple]:
    requiring: dict[int, list[Node]] = {}
    for route in model.nodes("Route"):
        for sensor in route.requires:
            requiring.setdefault(sensor.id, []).append(route)
    for route1 in model.nodes("Route"):
        semaphore = route1.exit
        for sensor1 in route1.requires if semaphore else ():
            for te1 in sensor1.monitors:
                for te2 in te1.connectsTo:
                    for sensor2 in te2.monitoredBy:
                        for route2 in requiring.get(sensor2.id, ()):
                            if route1 != route2 and route2.entry != semaphore:
                                row = (semaphore, route1, route2, sensor1, sensor2, te1, te2)
                                yield tuple(node.id for node in row)


BY_HAND: dict[str, Callable[[Model], Iterator[Tuple]]] = {
    "posLength": pos_length,
    "switchMonitored": switch_monitored,
    "routeSensor": route_sensor,
    "switchSet": switch_set,
    "connectedSegments": connected_segments,
    "semaphoreNeighbor": semaphore_neighbor,
}
