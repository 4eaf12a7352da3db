"""Views of closures against networkx: random graphs whose edges come and go, and large grids."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import pairwise
from random import Random

import networkx as nx
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from envgraph.graph import Model
from envgraph.match import FREE, ViewMatcher
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar
from envgraph.pattern import Constant, Library, Pattern
from tests.oracle.worlds import Dice
from tests.unit.match.kinds import watched
from tests.unit.match.writing import find, is_a, neg, path, pattern, unequal

EXAMPLES = settings().max_examples

PLACES = Metamodel(
    "places",
    (
        Class(
            "Place",
            features=(
                Attribute("shut", Scalar.BOOL),
                Reference("to", "Place", 0, None),
                Reference("beside", "Place", 0, None, opposite="beside"),
            ),
        ),
        Class("Start", supertypes=("Place",)),
        Class("Goal", supertypes=("Place",)),
    ),
)
TO, BESIDE = PLACES.references
SHUT = PLACES.attributes[0]

STEPS: dict[str, tuple[Pattern, ...]] = {
    "link": (pattern("step(a : Place, b : Place)", [path("Place.to", "a", "b")]),),
    "crossed link": (pattern("step(a : Place, b : Place)", [path("Place.to", "b", "a")]),),
    "undirected link": (pattern("step(a : Place, b : Place)", [path("Place.beside", "a", "b")]),),
    "bodies with negation": (
        pattern("shut(a : Place)", [path("Place.shut", "a", True)]),
        pattern(
            "step(a : Place, b : Place)",
            [path("Place.to", "a", "b"), neg(find("shut", "a")), neg(find("shut", "b"))],
            [path("Place.beside", "a", "b"), neg(find("shut", "a")), neg(find("shut", "b"))],
        ),
    ),
    "view": (
        pattern("edge(a : Place, b : Place)", [path("Place.to", "a", "c"), path("Place.beside", "c", "b")]),
        pattern("step(a : Place, b : Place)", [find("edge", "a", "b"), unequal("a", "b")]),
    ),
}

ASKED = (
    pattern("pairs(a : Place, b : Place)", [find("step+", "a", "b")]),
    pattern("pairs0(a : Place, b : Place)", [find("step*", "a", "b")]),
    pattern("starts(a : Start, b : Place)", [find("step+", "a", "b")]),
    pattern("starts0(a : Start, b : Place)", [find("step*", "a", "b")]),
    pattern("goals(a : Place, b : Goal)", [find("step+", "a", "b")]),
    pattern("solvable(a : Start, b : Goal)", [find("step*", "a", "b")]),
    pattern("lost(a : Start, b : Goal)", [is_a("Start", "a"), is_a("Goal", "b"), neg(find("solvable", "a", "b"))]),
    pattern("loops(a : Place)", [find("step+", "a", "a")]),
    pattern("straight(a : Place)", [is_a("Place", "a"), neg(find("loops", "a"))]),
    pattern("loops0(a : Place)", [find("step*", "a", "a")]),
    pattern("round(a : Place, b : Place)", [find("step+", "a", "b"), find("step+", "b", "a"), unequal("a", "b")]),
)  # fmt: skip


Edges = dict[tuple[int, int], None]
State = tuple[Edges, Edges, set[int], set[int], set[int]]


class Shadow:
    """A model of places, and the same as plain data.

    Attributes:
        to, beside: edges; both directions of `beside`.
        shut, starts, goals: some of the places.
    """

    def __init__(self, size: int) -> None:
        self.model = Model(PLACES)
        self.places = [self.model.graph.new("Place") for _ in range(size)]
        self.to: Edges = {}
        self.beside: Edges = {}
        self.shut: set[int] = set()
        self.starts: set[int] = set()
        self.goals: set[int] = set()

    def step(self, kind: str) -> nx.DiGraph:
        """The graph of a kind of steps."""
        graph = nx.DiGraph()
        graph.add_nodes_from(self.places)
        match kind:
            case "link":
                graph.add_edges_from(self.to)
            case "crossed link":
                graph.add_edges_from((b, a) for a, b in self.to)
            case "undirected link":
                graph.add_edges_from(self.beside)
            case "bodies with negation":
                graph.add_edges_from(self.to)
                graph.add_edges_from(self.beside)
                graph.remove_edges_from([e for e in graph.edges if not self.shut.isdisjoint(e)])
            case "view":
                across = ((a, b) for a, c in self.to for d, b in self.beside if c == d)
                graph.add_edges_from(edge for edge in across if edge[0] != edge[1])
        return graph

    def expected(self, kind: str) -> dict[str, set[tuple[int, ...]]]:
        """What every pattern of `ASKED` should find."""
        pairs = set(nx.transitive_closure(self.step(kind), reflexive=False).edges)
        pairs0 = pairs | {(place, place) for place in self.places}
        solvable = {(a, b) for a, b in pairs0 if a in self.starts and b in self.goals}
        return {
            "pairs": pairs,
            "pairs0": pairs0,
            "starts": {(a, b) for a, b in pairs if a in self.starts},
            "starts0": {(a, b) for a, b in pairs0 if a in self.starts},
            "goals": {(a, b) for a, b in pairs if b in self.goals},
            "solvable": solvable,
            "lost": {(a, b) for a in self.starts for b in self.goals} - solvable,
            "loops": {(a,) for a, b in pairs if a == b},
            "straight": {(a,) for a in self.places} - {(a,) for a, b in pairs if a == b},
            "loops0": {(a,) for a in self.places},
            "round": {(a, b) for a, b in pairs if a != b and (b, a) in pairs},
        }

    def change(self, dice: Dice, growing: int) -> None:
        """One place or edge changes; edges are added so often, in percent."""
        place, other = dice.one(self.places), dice.one(self.places)
        roll = dice.number(0, 9)
        if roll == 0:
            cls = dice.one(["Place", "Start", "Goal"])
            self.model.graph.retype(place, cls)
            self.starts.discard(place)
            self.goals.discard(place)
            if cls != "Place":
                (self.starts if cls == "Start" else self.goals).add(place)
        elif roll == 1:
            shut = dice.chance(30)
            self.model.graph.set_value(place, SHUT, shut)
            (self.shut.add if shut else self.shut.discard)(place)
        elif dice.chance(growing):
            self._link(place, other, roll < 6)
        else:
            self._unlink(dice, roll < 6)

    def _link(self, place: int, other: int, directed: bool) -> None:
        self.model.graph.link(place, TO if directed else BESIDE, other)
        if directed:
            self.to[place, other] = None
        else:
            self.beside[place, other] = self.beside[other, place] = None

    def _unlink(self, dice: Dice, directed: bool) -> None:
        edges = self.to if directed else self.beside
        if edges:
            place, other = dice.one(list(edges))
            self.model.graph.unlink(place, TO if directed else BESIDE, other)
            edges.pop((place, other))
            if not directed:
                edges.pop((other, place), None)

    def state(self) -> State:
        """A copy of the plain data."""
        return self.to.copy(), self.beside.copy(), self.shut.copy(), self.starts.copy(), self.goals.copy()

    def restore(self, state: State) -> None:
        """Be as in a copy."""
        to, beside, shut, starts, goals = state
        self.to, self.beside = to.copy(), beside.copy()
        self.shut, self.starts, self.goals = shut.copy(), starts.copy(), goals.copy()


def order(views: ViewMatcher) -> dict[str, list[tuple[object, ...]]]:
    """The rows of every asked pattern, as they are listed."""
    return {each.name: list(views.rows(each.name, (FREE,) * len(each.parameters))) for each in ASKED}


def assert_as_expected(views: ViewMatcher, shadow: Shadow, kind: str) -> None:
    expected = shadow.expected(kind)
    for name, rows in order(views).items():
        assert len(set(rows)) == len(rows)
        assert set(rows) == expected[name], name
    views.check_integrity()


def walk(seed: int, kind: str, *sizes: int, intricate: bool = True) -> None:
    """Edges come and go, one at a time and in batches; some are rolled back, or shelved and resumed.

    If it may be intricate, transactions nest, and versions are checked out.
    """
    dice = Dice(seed)
    shadow = Shadow(dice.one(sizes))
    library = Library(PLACES)
    library.add(*STEPS[kind], *ASKED)
    if dice.chance(60):  # else there is nothing yet when the views are built
        for _ in range(dice.number(0, 3 * len(shadow.places))):
            shadow.change(dice, growing=90)
    views = watched(shadow.model, library)
    assert_as_expected(views, shadow, kind)
    versions = []
    for _ in range(dice.number(2, 6)):
        episode(dice, views, shadow, kind, nested=2 if intricate else 0)
        if intricate and dice.chance(40):
            versions.append((shadow.model.commit(), order(views), shadow.state()))
        while versions and dice.chance(50):
            for _ in range(dice.number(1, 3)):  # outside any transaction
                shadow.change(dice, growing=50)
                assert_as_expected(views, shadow, kind)
            version, listed, state = dice.one(versions)
            shadow.model.checkout(version, discard=True)
            shadow.restore(state)
            assert order(views) == listed
            assert_as_expected(views, shadow, kind)


def episode(dice: Dice, views: ViewMatcher, shadow: Shadow, kind: str, nested: int) -> None:
    """A transaction with changes, perhaps others inside, and one of the ways in which it can end."""
    model = shadow.model
    batch, growing = dice.one([1, 1, 1, 5, len(shadow.places) // 2]), dice.one([10, 50, 90])
    before, state = order(views), shadow.state()
    savepoint = model.graph.history.savepoint()
    for _ in range(batch):
        shadow.change(dice, growing)
    assert_as_expected(views, shadow, kind)
    if nested and dice.chance(25):
        episode(dice, views, shadow, kind, nested - 1)
        shadow.change(dice, growing)
        assert_as_expected(views, shadow, kind)
    end = dice.one(["release", "release", "roll back", "shelve"])
    if end == "release":
        model.graph.history.release(savepoint)
        return
    after, changed = order(views), shadow.state()
    shelf = model.graph.history.undo_to(savepoint) if end == "shelve" else model.graph.history.rollback(savepoint)
    shadow.restore(state)
    assert order(views) == before
    assert_as_expected(views, shadow, kind)
    if shelf is not None:
        model.graph.history.release(model.graph.history.redo(shelf))
        shadow.restore(changed)
        assert order(views) == after
        assert_as_expected(views, shadow, kind)


@pytest.mark.parametrize("kind", STEPS)
@settings(max_examples=EXAMPLES // 5, suppress_health_check=list(HealthCheck))
@given(seed=st.integers(0, 2**32))
def test_closures_of_small_graphs_equal_networkx(kind: str, seed: int) -> None:
    walk(seed, kind, 3, 6, 12, 24)


@pytest.mark.parametrize("kind", STEPS)
@settings(max_examples=EXAMPLES // 12, suppress_health_check=list(HealthCheck))
@given(seed=st.integers(0, 2**32))
def test_closures_of_graphs_with_two_hundred_nodes_equal_networkx(kind: str, seed: int) -> None:
    walk(seed, kind, 200, intricate=False)


def test_journal_copies_a_large_tree_only_once_per_savepoint() -> None:
    model = Model(PLACES)
    start = model.graph.new("Start")
    ring = [model.graph.new("Place") for _ in range(500)]
    for near, far in zip([start, *ring], ring, strict=False):
        model.graph.link(near, TO, far)
    library = Library(PLACES)
    library.add(*STEPS["link"], *ASKED)
    views = ViewMatcher(model, library)
    views.watch("starts")
    savepoint = model.graph.history.savepoint()
    for _ in range(50):
        for inner in (False, True):
            within = model.graph.history.savepoint() if inner else None
            model.graph.unlink(ring[-2], TO, ring[-1])
            assert views.count("starts", (start, FREE)) == 499
            model.graph.link(ring[-2], TO, ring[-1])
            assert views.count("starts", (start, FREE)) == 500
            if within is not None:
                model.graph.history.rollback(within)
    journal = model.graph.store.journal
    trees = {id(old) for old in journal[2::4] if isinstance(old, dict)}
    assert len(journal) > 50 * 2 * 4
    # A copy for the outer savepoint, and one after each inner one: two changes each.
    assert 1 <= len(trees) <= 51
    model.graph.history.rollback(savepoint)
    assert views.count("starts", (start, FREE)) == 500
    views.check_integrity()


def test_journal_copies_the_tree_of_each_start_of_an_acyclic_graph_once() -> None:
    model = Model(PLACES)
    chain = [model.graph.new("Place") for _ in range(60)]
    for near, far in pairwise(chain):
        model.graph.link(near, TO, far)
    model.graph.link(chain[-2], TO, model.graph.new("Place"))  # so that it always has a link, and always is a start
    library = Library(PLACES)
    library.add(*STEPS["link"], *ASKED)
    views = ViewMatcher(model, library)
    views.watch("pairs", "pairs0", "loops")
    pairs = views.count("pairs", (FREE, FREE))
    assert pairs == 60 * 59 // 2 + 59
    savepoint = model.graph.history.savepoint()
    for _ in range(20):
        model.graph.unlink(chain[-2], TO, chain[-1])
        assert views.count("pairs", (FREE, FREE)) == pairs - 59
        model.graph.link(chain[-2], TO, chain[-1])
        assert views.count("pairs", (FREE, FREE)) == pairs
    trees = {id(old) for old in model.graph.store.journal[2::4] if isinstance(old, dict)}
    assert 59 <= len(trees) <= 3 * 60  # one for each start and closure
    model.graph.link(chain[-1], TO, chain[0])  # now they reach each other
    assert views.count("loops", (FREE,)) == 60
    views.check_integrity()
    model.graph.history.rollback(savepoint)
    assert views.count("loops", (FREE,)) == 0
    views.check_integrity()


def test_memory_of_cycle_views_is_linear_in_the_number_of_links() -> None:
    model = Model(PLACES)
    chain = [model.graph.new("Place") for _ in range(3000)]
    for near, far in pairwise(chain):
        model.graph.link(near, TO, far)
    library = Library(PLACES)
    library.add(*STEPS["link"], *ASKED)
    views = ViewMatcher(model, library)
    views.watch("loops", "straight")
    sizes = {each.name: each.size() for each in views.watched_views.network.operators.values()}
    assert sizes["step/circles"] == 0
    assert max(sizes.values()) <= 3000  # not a pair of a node and each that it reaches
    savepoint = model.graph.history.savepoint()
    model.graph.link(chain[2], TO, chain[2])
    model.graph.link(chain[-1], TO, chain[1000])
    assert views.count("loops", (FREE,)) == 2001
    model.graph.unlink(chain[1500], TO, chain[1501])
    assert views.rows("loops", (FREE,)) == [(chain[2],)]
    assert views.count("straight", (FREE,)) == 2999
    views.check_integrity()
    model.graph.history.rollback(savepoint)
    assert views.count("loops", (FREE,)) == 0
    views.check_integrity()


# --- grids: what hangs together costs its nodes, not their pairs

CELLS = Metamodel(
    "cells",
    (
        Class(
            "Cell",
            features=(
                Attribute("role", Scalar.STRING),
                Reference("east", "Cell", 0, 1, opposite="west"),
                Reference("west", "Cell", 0, 1, opposite="east"),
                Reference("south", "Cell", 0, 1, opposite="north"),
                Reference("north", "Cell", 0, 1, opposite="south"),
            ),
        ),
    ),
)
EAST, SOUTH = CELLS.references[0], CELLS.references[2]

CELL_STEP = pattern(
    "step(a : Cell, b : Cell)",
    *([path(f"Cell.{way}", "a", "b")] for way in ("east", "west", "south", "north")),
)
GRID_QUERIES = (
    CELL_STEP,
    pattern("loop(a : Cell)", [find("step+", "a", "a")]),
    pattern(
        "solvable(a : Cell, b : Cell)",
        [path("Cell.role", "a", Constant("start")), path("Cell.role", "b", Constant("goal")), find("step+", "a", "b")],
    ),
    pattern("fromStart(b : Cell)", [path("Cell.role", "a", Constant("start")), find("step*", "a", "b")]),
)  # fmt: skip


class Grid:
    """Cells in rows, each linked to its neighbours in both directions; the first is the start, the last the goal."""

    def __init__(self, width: int) -> None:
        self.model = Model(CELLS)
        self.width = width
        self.cells = []
        with self.model.loading():
            for number in range(width * width):
                self.cells.append(self.model.graph.new("Cell"))
                if number % width:
                    self.model.graph.link(self.cells[number - 1], EAST, self.cells[number])
                if number >= width:
                    self.model.graph.link(self.cells[number - width], SOUTH, self.cells[number])
            self.model.node(self.cells[0]).role = "start"
            self.model.node(self.cells[-1]).role = "goal"
        library = Library(CELLS)
        library.add(*GRID_QUERIES)
        self.views = watched(self.model, library)

    def cut(self, row: int, column: int) -> None:
        """Take all links of a cell away."""
        node = self.model.node(self.cells[row * self.width + column])
        node.east = node.west = node.south = node.north = None

    def join(self, row: int, column: int) -> None:
        """Link a cell with the one to its left."""
        right = row * self.width + column
        self.model.graph.link(self.cells[right - 1], EAST, self.cells[right])

    def stored(self) -> int:
        """Nodes in all reached sets that are held, each set once, and in the indexes of them."""
        found = 0
        for operator in self.views.watched_views.network.operators.values():
            if hasattr(operator, "reached"):
                found += sum(map(len, {id(each): each for each in operator.reached.values()}.values()))
        return found

    def count(self, pattern_: str, size: int) -> int:
        """Number of matches."""
        return self.views.count(pattern_, (FREE,) * size)


def test_closure_of_a_large_grid_does_not_store_all_pairs() -> None:
    grid = Grid(50)
    cells = 2_500
    assert grid.count("loop", 1) == grid.count("fromStart", 1) == cells
    assert grid.count("solvable", 2) == 1
    assert grid.stored() <= 4 * cells
    changes: Iterable[tuple[Callable[[int, int], None], int, int, int]] = (
        (grid.cut, 25, 25, cells - 1),  # from the middle
        (grid.join, 25, 25, cells),
        (grid.cut, 0, 49, cells - 1),  # a corner
        (grid.join, 0, 49, cells),
        (grid.cut, 49, 49, cells - 1),  # the goal
    )
    most = 4 * cells
    for change, row, column, loops in changes:
        change(row, column)
        assert grid.count("loop", 1) == grid.count("fromStart", 1) == loops
        most += 4 * cells  # a cell that is linked again is alone with its set
        assert grid.stored() <= most
    assert grid.count("solvable", 2) == 0
    grid.join(49, 49)
    assert grid.count("solvable", 2) == 1


def test_closure_of_a_grid_that_is_split_and_rejoined_does_not_store_all_pairs() -> None:
    grid = Grid(40)
    cells = 1_600
    savepoint = grid.model.graph.history.savepoint()
    for row in range(40):
        grid.cut(row, 20)
    assert grid.count("loop", 1) == cells - 40
    assert grid.count("fromStart", 1) == 20 * 40
    assert grid.stored() <= 6 * cells
    for row in range(40):
        grid.join(row, 20)
        assert grid.count("loop", 1) == cells - 39 + row
    assert grid.stored() <= 6 * cells + 40 * 20 * 40
    grid.views.check_integrity()
    grid.model.graph.history.rollback(savepoint)
    assert grid.count("loop", 1) == cells
    assert grid.stored() <= 4 * cells
    grid.views.check_integrity()


def test_changing_a_leaf_of_a_deep_tree_updates_its_ancestors(monkeypatch: pytest.MonkeyPatch) -> None:
    # All pairs are so many that no index of them would pay: what is above the leaf is searched for.
    places = Metamodel("places", (Class("Place", features=(Reference("to", "Place", 0, None),)),))
    random, model, (to,) = Random(1), Model(places), places.references
    with model.loading():
        nodes = [model.graph.new("Place") for _ in range(3_000)]
        for place in range(1, len(nodes)):
            model.graph.link(nodes[random.randrange(place // 2, place)], to, nodes[place])
    library = Library(places)
    library.add(pattern("below(a : Place, b : Place)", [path("Place.to+", "a", "b")]))
    views, looked = watched(model, library), []
    pairs = views.count("below", (FREE, FREE))
    assert pairs > 16 * len(nodes)
    (closure,) = (type(each) for each in views.watched_views.network.operators.values() if hasattr(each, "reached"))
    cut = closure._deletion_effect
    monkeypatch.setattr(closure, "_deletion_effect", lambda *given: looked.append(given) or cut(*given))
    (above,) = model.graph.sources(nodes[-1], to)
    model.graph.unlink(above, to, nodes[-1])
    lost = pairs - views.count("below", (FREE, FREE))
    assert len(looked) <= lost < 100
