"""The queries of the bundled domains, each written once more in plain Python over the objects of a model.

A row has objects as ids, and values as they are. No query is asked here, and no rule.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from math import fsum

from envgraph.graph import Model, Node

Rows = set[tuple[object, ...]]

WAYS = ("west", "south", "east", "north")


def every(model: Model, cls: str) -> list[Node]:
    """The objects of a class and its subclasses."""
    return list(model.nodes(cls))


def ids(rows: Iterable[tuple[object, ...]]) -> Rows:
    return {tuple(value.id if isinstance(value, Node) else value for value in row) for row in rows}


def closure(steps: Rows) -> Rows:
    """Pairs with at least one step between them."""
    after: dict[object, set[object]] = {}
    for start, end in steps:
        after.setdefault(start, set()).add(end)
    found: Rows = set()
    for start, ends in after.items():
        reached, todo = set(ends), list(ends)
        while todo:
            for end in after.get(todo.pop(), ()):
                if end not in reached:
                    reached.add(end)
                    todo.append(end)
        found |= {(start, end) for end in reached}
    return found


# --- burning forest


def _placed(model: Model, cls: str, place: tuple[int, int]) -> Rows:
    return ids((f, t) for f in every(model, "Forest") for t in f.states if t.cls == cls and (t.x, t.y) == place)


def _neighbours(model: Model) -> Iterator[tuple[Node, Node]]:
    for tile in every(model, "Tile"):
        for way in ("right", "left", "down", "up"):
            if (other := getattr(tile, way)) is not None:
                yield tile, other


def _passages(model: Model) -> Rows:
    return ids((a, b) for a, b in _neighbours(model) if "BurningTile" not in (a.cls, b.cls))


def _solvable(model: Model) -> Rows:
    ends = {(a.id, b.id) for a in every(model, "StartTile") for b in every(model, "GoalTile")}
    return closure(_passages(model)) & ends


def _density(model: Model) -> Rows:
    return ids((f, sum(t.cls == "BurningTile" for t in f.states), len(f.states)) for f in every(model, "Forest"))


def _truck_on(model: Model, cls: str) -> Iterator[tuple[Node, Node]]:
    for truck in every(model, "FireTruck"):
        if truck.currentState.cls == cls:
            yield truck, truck.currentState


BURNING_FOREST: dict[str, Callable[[Model], Rows]] = {
    "burningTile": lambda m: ids((f, t) for f in every(m, "Forest") for t in f.states if t.cls == "BurningTile"),
    "startTileFixedLocation": lambda m: _placed(m, "StartTile", (0, 0)),
    "goalTileFixedLocation": lambda m: _placed(m, "GoalTile", (7, 7)),
    "waterTileFixedLocation": lambda m: _placed(m, "WaterTile", (3, 5)),
    "neighbour": lambda m: ids(_neighbours(m)),
    "passage": _passages,
    "solvable": _solvable,
    "fireDensity": _density,
    "onGoal": lambda m: ids((truck,) for truck, _ in _truck_on(m, "GoalTile")),
    "onFire": lambda m: ids((truck,) for truck, _ in _truck_on(m, "BurningTile")),
    "onVegetation": lambda m: ids((truck,) for truck, _ in _truck_on(m, "VegetationTile")),
    "onFreshWater": lambda m: ids((truck, at) for truck, at in _truck_on(m, "WaterTile") if not at.collected),
    "truckOnStart": lambda m: ids(_truck_on(m, "StartTile")),
    "collectedWater": lambda m: ids((w,) for w in every(m, "WaterTile") if w.collected),
}


# --- key and door, and the steps of the warehouse


def _steps(model: Model) -> Rows:
    found = ((cell, way, getattr(cell, way)) for cell in every(model, "Cell") for way in WAYS)
    return ids((cell, way, to) for cell, way, to in found if to is not None)


KEYDOOR: dict[str, Callable[[Model], Rows]] = {
    "step": _steps,
    "shut": lambda m: ids((d,) for d in every(m, "Door") if not d.open),
    "enterable": lambda m: ids((c,) for c in every(m, "Floor") if c.cls != "Door" or c.open),
    "atExit": lambda m: ids((h,) for h in every(m, "Hero") if h.at.cls == "Exit"),
    "holds": lambda m: ids((h, key.colour) for h in every(m, "Hero") for key in h.inventory),
    "keyless": lambda m: ids((d,) for d in every(m, "Door") if d.colour not in {key.colour for key in every(m, "Key")}),
    "buried": lambda m: ids((c,) for c in every(m, "Wall") if c.item or c in [h.at for h in every(m, "Hero")]),
    "keyOf": lambda m: ids((key, key.colour) for key in every(m, "Key")),
}


# --- network


def _connected(model: Model) -> Rows:
    return ids((getattr(link, "from"), link.to) for link in every(model, "Link") if link.up)


def _cut_off(model: Model) -> Rows:
    routers = [router.id for router in every(model, "Router")]
    return {(a, b) for a in routers for b in routers if a != b} - closure(_connected(model))


def _degrees(model: Model) -> dict[int, int]:
    sources = [getattr(link, "from").id for link in every(model, "Link")]
    return {router.id: sources.count(router.id) for router in every(model, "Router")}


NETWORK: dict[str, Callable[[Model], Rows]] = {
    "connected": _connected,
    "reaches": lambda m: closure(_connected(m)),
    "cutOff": _cut_off,
    "delivered": lambda m: ids((p,) for p in every(m, "Packet") if p.at == p.destination),
    "lost": lambda m: ids((p,) for p in every(m, "Packet") if p.hops > 16),
    "degree": lambda m: set(_degrees(m).items()),
    "crowded": lambda m: {(router,) for router, links in _degrees(m).items() if links > 4},
}


# --- warehouse


def _drivable(model: Model) -> Rows:
    shelves = {cell.id for cell in every(model, "Shelf")}
    return {(a, b) for a, _, b in _steps(model) if not {a, b} & shelves}


def _fetchable(model: Model) -> Rows:
    docks = {dock.id for dock in every(model, "Dock")}
    ways = closure(_drivable(model)) | {(dock, dock) for dock in docks}
    placed = [parcel for parcel in every(model, "Parcel") if parcel.at is not None]
    return {(parcel.id, dock) for parcel in placed for dock in docks if (parcel.at.id, dock) in ways}


WAREHOUSE: dict[str, Callable[[Model], Rows]] = {
    "step": _steps,
    "drivable": _drivable,
    "fetchable": _fetchable,
    "stranded": lambda m: {(p.id,) for p in every(m, "Parcel")} - {(p,) for p, _ in _fetchable(m)},
    "stuck": lambda m: ids((r,) for r in every(m, "Robot") if r.at.cls == "Shelf"),
    "pending": lambda m: ids((p,) for p in every(m, "Parcel") if not p.shipped),
    "empty": lambda m: ids((r,) for r in every(m, "Robot") if r.battery == 0),
    "parcels": lambda m: ids((hall, len(hall.parcels)) for hall in every(m, "Hall")),
}

# --- sokoban


def _boxes(model: Model) -> list[Node]:
    return [spot for spot in every(model, "Floor") if spot.box]


def _passable(model: Model) -> Rows:
    """Spots that a worker comes into by a step this way."""
    found: Rows = set()
    for spot in every(model, "Floor"):
        for way, back in zip(WAYS, ("east", "north", "west", "south"), strict=True):
            beyond = getattr(spot, way)
            inside = beyond is not None and beyond.cls != "Wall" and not beyond.box
            if inside if spot.box else getattr(spot, back) is not None:
                found.add((spot.id, way))
    return found


def _pushable(model: Model) -> Rows:
    found: Rows = set()
    for spot in every(model, "Floor"):
        for one, other in (("west", "east"), ("north", "south")):
            a, b = getattr(spot, one), getattr(spot, other)
            if a is not None and b is not None and "Wall" not in (a.cls, b.cls):
                found |= {(spot.id, a.id), (spot.id, b.id)}
    return {(a, b) for a, b in found}


def _alive(model: Model) -> Rows:
    goals = {goal.id for goal in every(model, "Goal")}
    return {(a,) for a, b in closure(_pushable(model)) if b in goals} | {(goal,) for goal in goals}


def _unbalanced(model: Model) -> Rows:
    boxes = len(_boxes(model))
    return {(boxes,)} if boxes != len(every(model, "Goal")) else set()


SOKOBAN: dict[str, Callable[[Model], Rows]] = {
    "step": _steps,
    "box": lambda m: ids((spot,) for spot in _boxes(m)),
    "empty": lambda m: ids((spot,) for spot in every(m, "Floor") if not spot.box),
    "passable": _passable,
    "misplaced": lambda m: ids((spot,) for spot in _boxes(m) if spot.cls != "Goal"),
    "pushable": _pushable,
    "alive": _alive,
    "stuck": lambda m: ids((spot,) for spot in _boxes(m)) - _alive(m),
    "inner": lambda m: ids((c,) for c in every(m, "Cell") if all(getattr(c, way) for way in WAYS)),
    "goal": lambda m: ids((goal,) for goal in every(m, "Goal")),
    "unbalanced": _unbalanced,
}

# --- lava

TURNS = ("east", "south", "west", "north")


def _ahead(model: Model) -> list[tuple[Node, Node]]:
    found = ((hero, getattr(hero.at, hero.facing)) for hero in every(model, "Hero"))
    return [(hero, cell) for hero, cell in found if cell is not None]


def _clear(cell: Node) -> bool:
    return cell.cls == "Floor" and cell.thing is None


def _enterable(model: Model) -> Rows:
    floors = [c for c in every(model, "Floor") if c.thing is None and (c.cls != "Door" or c.open)]
    return ids((cell,) for cell in (*floors, *every(model, "Lava")))


def _on(model: Model, cls: str) -> Rows:
    return ids((hero,) for hero in every(model, "Hero") if hero.at.cls == cls)


def _safe(model: Model) -> Rows:
    floors = {cell.id for cell in every(model, "Floor")}
    return {(a, b) for a, _, b in _steps(model) if {a, b} <= floors}


def _ways(model: Model) -> Rows:
    goals, ways = {goal.id for goal in every(model, "Goal")}, closure(_safe(model))
    return {(h.id, g) for h in every(model, "Hero") for g in goals if h.at.id == g or (h.at.id, g) in ways}


LAVA: dict[str, Callable[[Model], Rows]] = {
    "step": _steps,
    "turn": lambda m: {(left, TURNS[n - 3]) for n, left in enumerate(TURNS)},
    "ahead": lambda m: ids(_ahead(m)),
    "shut": lambda m: ids((d,) for d in every(m, "Door") if not d.open),
    "enterable": _enterable,
    "clear": lambda m: ids((c,) for c in every(m, "Floor") if _clear(c)),
    "arrived": lambda m: _on(m, "Goal"),
    "burnt": lambda m: _on(m, "Lava"),
    "carriesKey": lambda m: ids(
        (h, h.carries.colour) for h in every(m, "Hero") if h.carries is not None and h.carries.cls == "Key"
    ),
    "molten": lambda m: ids((c,) for c in every(m, "Lava")),
    "misplaced": lambda m: ids((h,) for h in every(m, "Hero") if not _clear(h.at)),
    "cutOff": lambda m: ids((h,) for h in every(m, "Hero")) - {(h,) for h, _ in _ways(m)},
    "way": _ways,
    "safeStep": _safe,
}


# --- taxi


def _drives(model: Model) -> set[tuple[Node, str, Node]]:
    found = set()
    for street in every(model, "Street"):
        for way in WAYS:
            to = getattr(street, way)
            walled = street.wall if way == "east" else to is not None and way == "west" and to.wall
            if to is not None and not walled:
                found.add((street, way, to))
    return found


def _reached(model: Model) -> Rows:
    ways = closure(ids((a, b) for a, _, b in _drives(model)))
    starts = {taxi.street.id for taxi in every(model, "Taxi")}
    return {(b,) for a, b in ways if a in starts} | {(start,) for start in starts}


TAXI: dict[str, Callable[[Model], Rows]] = {
    "step": lambda m: ids(_drives(m)),
    "arrived": lambda m: ids((p,) for p in every(m, "Passenger") if p.at == p.destination),
    "next": lambda m: ids((a, b) for a, _, b in _drives(m)),
    "reached": _reached,
    "cutOff": lambda m: ids((s,) for s in every(m, "Street")) - _reached(m),
    "occupied": lambda m: ids((stand.street,) for stand in every(m, "Stand")),
}


# --- job shop


def _work(model: Model) -> list[tuple[Node, Node, int]]:
    return [(one.machine, one, one.duration) for one in every(model, "Operation")]


def _load(model: Model) -> dict[Node, int]:
    work = _work(model)
    return {one: sum(time for machine, _, time in work if machine == one) for one in every(model, "Machine")}


def _length(model: Model) -> dict[Node, int]:
    return {job: sum(one.duration for one in job.operations) for job in every(model, "Job")}


JOBSHOP: dict[str, Callable[[Model], Rows]] = {
    "unfinished": lambda m: ids((job,) for job in every(m, "Job") if job.next is not None),
    "idle": lambda m: ids((one,) for one in every(m, "Machine") if one.serves is None),
    "working": lambda m: ids((one,) for one in every(m, "Machine") if one.serves is not None),
    "work": lambda m: ids(_work(m)),
    "load": lambda m: ids(_load(m).items()),
    "part": lambda m: ids((job, one, one.duration) for job in every(m, "Job") for one in job.operations),
    "length": lambda m: ids(_length(m).items()),
    "bound": lambda m: {(max(*_load(m).values(), *_length(m).values()),)},
}


# --- triage


def _in_ward(model: Model, *wards: str) -> list[Node]:
    return [patient for patient in every(model, "Patient") if patient.ward.cls in wards]


def _pressure(model: Model) -> Rows:
    risks = [patient.risk for patient in every(model, "Patient")]
    return {(fsum(risks) / ward.beds,) for ward in every(model, "Treatment")}


TRIAGE: dict[str, Callable[[Model], Rows]] = {
    "waiting": lambda m: ids((p,) for p in _in_ward(m, "Waiting")),
    "critical": lambda m: ids((p,) for p in _in_ward(m, "Waiting") if p.condition == "red"),
    "treated": lambda m: ids((p,) for p in _in_ward(m, "Treatment")),
    "inHouse": lambda m: ids((p,) for p in _in_ward(m, "Waiting", "Treatment")),
    "dead": lambda m: ids((p,) for p in _in_ward(m, "Morgue")),
    "risk": lambda m: ids((p, p.risk) for p in every(m, "Patient")),
    "pressure": _pressure,
    "patient": lambda m: ids((p,) for p in every(m, "Patient")),
}

BY_HAND = {
    "burning_forest": BURNING_FOREST,
    "jobshop": JOBSHOP,
    "keydoor": KEYDOOR,
    "lava": LAVA,
    "network": NETWORK,
    "sokoban": SOKOBAN,
    "taxi": TAXI,
    "triage": TRIAGE,
    "warehouse": WAREHOUSE,
}
