"""An interruption at any instruction leaves model and views as before what was interrupted, or as after it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import cache
from itertools import count

import pytest
from hypothesis import settings

from envgraph.graph import Model, Savepoint, UndoneChanges, Version, model_to_json
from envgraph.match import FREE
from envgraph.metamodel import Attribute, Metamodel, Scalar
from envgraph.pattern import Library
from tests.facts import Notified
from tests.oracle.naive._naive import NaiveMatcher
from tests.property.interrupting import Trip
from tests.property.snapshots import facts, spelt
from tests.thresholds import set_thresholds
from tests.unit.match.kinds import watched
from tests.unit.match.people import METAMODEL
from tests.unit.match.writing import equal, find, fold, is_a, neg, path, pattern

NIGHTLY = settings().max_examples > 100
ONCE, TWICE = (800, 200) if NIGHTLY else (2, 1)
"""Instructions at which a scenario is interrupted, and of these how many interruptions are followed by another."""

NAMES = Attribute("names", Scalar.STRING, lower=0, upper=None)
PEOPLE = Metamodel(
    METAMODEL.name,
    [replace(cls, features=(*cls.features, NAMES)) if cls.name == "Person" else cls for cls in METAMODEL.class_list],
    METAMODEL.enum_types,
)

PATTERNS = (
    pattern("knows(a : Person, b : Person)", [path("Person.knows", "a", "b")]),
    pattern("two(a : Person, c : Person)", [find("knows", "a", "b"), find("knows", "b", "c")]),
    pattern("reaches(a : Person, b : Person)", [find("knows+", "a", "b")]),
    pattern("lonely(a : Person)", [is_a("Person", "a"), neg(find("knows", "a", "_"))]),
    pattern("fans(a : Person, n : int)", [is_a("Person", "a"), equal("n", fold("count", find("two", "_", "a")))]),
    pattern(
        "aged(a : Person, b : Person, n : int)",
        [path("Person.knows", "a", "b"), path("Person.age", "b", "n")],
    ),
    pattern(
        "sum(a : Person, n : int)",
        [is_a("Person", "a"), equal("n", fold("sum", find("aged", "a", "_", "#")))],
    ),
    pattern(
        "most(a : Person, n : int)",
        [is_a("Person", "a"), equal("n", fold("max", find("aged", "a", "_", "#")))],
    ),
    pattern(
        "above(a : Person, b : Person)",
        [path("Person.boss", "b", "a")],
        [find("above", "a", "c"), path("Person.boss", "b", "c")],
    ),
    pattern("chiefs(a : Chief, t : Team)", [is_a("Chief", "a"), path("Team.members", "t", "a")]),
    pattern("paid(a : Person, m : int)", [path("Person.age", "a", "m")]),
    pattern("namesakes(a : Person, b : Person)", [path("Person.names", "a", "n"), path("Person.names", "b", "n")]),
    pattern(
        "named(a : Person, n : int)",
        [is_a("Person", "a"), equal("n", fold("count", path("Person.names", "a", "_")))],
    ),
    pattern("unnamed(a : Person)", [is_a("Person", "a"), neg(path("Person.names", "a", "_"))]),
)

LIBRARY = Library(PEOPLE)
LIBRARY.add(*PATTERNS)
EXPECTED: dict[tuple[tuple[str, ...], ...], dict[str, list[tuple[object, ...]]]] = {}
"""The matches in states that have been met."""


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few elements are many: so small models have everything."""
    small = {"crowd of targets": 2, "long change between versions": 8, "large group": 0}
    set_thresholds(monkeypatch, small)


class InterruptedModel:
    """Some people, views of them, somebody who listens, and what a scenario keeps."""

    def __init__(self) -> None:
        self.model = model = Model(PEOPLE)
        self.library = LIBRARY
        self.names = [each.name for each in PATTERNS]
        people = [model.create("Person", object_name=f"p{n}", age=n) for n in range(7)]
        for one, other in ((0, 1), (1, 2), (2, 0), (0, 2), (0, 3), (5, 0), (0, 5), (5, 6)):
            people[one].knows.append(people[other])
        people[0].names, people[1].names = ["a", "b"], ["b"]
        people[1].boss = people[2].boss = people[3].boss = people[0]
        model.create("Team", object_name="t0", members=people[5:])
        model.create("Team", object_name="t1")
        self.matcher = watched(model, self.library)
        self.heard: set[tuple[object, ...]] = set(self.rows("two"))
        self.matcher.listen("two", self.on_change)
        self.versions: list[Version] = []
        self.savepoints: list[Savepoint] = []
        self.shelves: list[UndoneChanges] = []

    def on_change(self, appeared: list[tuple[object, ...]], disappeared: list[tuple[object, ...]]) -> None:
        """Be told of changes."""
        self.heard -= set(disappeared)
        self.heard |= set(appeared)

    def rows(self, name: str) -> list[tuple[object, ...]]:
        """The matches of a pattern."""
        return list(self.matcher.rows(name, (FREE,) * len(self.library.parameter_types(name))))

    def state(self) -> object:
        """The facts and the names."""
        model = self.model
        return spelt(facts(model)), [(n, model.graph.object_name(n)) for n in model.graph.store.nodes()]

    def expected(self) -> dict[str, list[tuple[object, ...]]]:
        """What the naive matcher finds, which takes long: in each state once."""
        state = tuple(spelt(facts(self.model)))
        if state not in EXPECTED:
            naive = NaiveMatcher(self.model, self.library)
            EXPECTED[state] = {
                name: naive.rows(name, (FREE,) * len(self.library.parameter_types(name))) for name in self.names
            }
        return EXPECTED[state]

    def check(self) -> None:
        """Assert that everything is right."""
        self.model.check_integrity()
        expected = self.expected()
        for name in self.names:
            assert sorted(self.rows(name)) == expected[name], name  # type: ignore[type-var]
        self.matcher.check_integrity()
        self.model.check_integrity()

    def assert_usable(self, states: dict[int, object]) -> None:
        """What is done after an interruption works, and leads to where it should."""
        model = self.model
        self.model.graph.history.unwind(0)
        self.check()
        here = self.state()
        model["p4"].knows.append(model["p0"])
        self.check()
        changed = self.state()
        version = model.commit()
        for other in [*self.versions, version, *self.versions]:
            model.checkout(other)
            self.check()
            known = changed if other is version else states.get(other.number, self.state())
            assert self.state() == known
        model.checkout(version)
        model["p4"].knows.remove(model["p0"])
        self.check()
        assert self.state() == here
        self.matcher.listeners.deliver()
        model.commit()
        assert self.heard == set(self.rows("two"))


Step = Callable[[InterruptedModel], object]


def _id(world: InterruptedModel, name: str) -> int:
    return world.model[name].id


def create(world: InterruptedModel) -> None:
    """An object with features, at once."""
    model = world.model
    model.create("Chief", object_name="new", age=3, knows=[model["p0"], model["p4"]], boss=model["p4"])


def new(world: InterruptedModel) -> None:
    """An object."""
    world.model.graph.new("Person", "n2")


def link(world: InterruptedModel) -> None:
    """A link."""
    world.model.graph.link(_id(world, "p0"), METAMODEL.feature("Person", "knows"), _id(world, "p0"))  # type: ignore[arg-type]


def unlink(world: InterruptedModel) -> None:
    """A link goes."""
    world.model.graph.unlink(_id(world, "p0"), METAMODEL.feature("Person", "knows"), _id(world, "p1"))  # type: ignore[arg-type]


def value(world: InterruptedModel) -> None:
    """A value."""
    world.model["p1"].age = 9


def values(world: InterruptedModel) -> None:
    """Other values of many."""
    world.model["p0"].names = ["c", "b", "d"] if world.model["p0"].names[0] == "a" else ["a"]


def insert(world: InterruptedModel) -> None:
    """A value before the others."""
    world.model["p0"].names.insert(0, f"n{len(world.model['p0'].names)}")


def append(world: InterruptedModel) -> None:
    """A value behind the others."""
    world.model["p0"].names.append(f"n{len(world.model['p0'].names)}")


def remove(world: InterruptedModel) -> None:
    """The second value goes."""
    del world.model["p0"].names[1]


def place(world: InterruptedModel) -> None:
    """A target at the front, which is new or was the last one."""
    people = world.model
    people["p0"].knows.insert(0, people["p6"])


def rotate(world: InterruptedModel) -> None:
    """The first target becomes the last."""
    people = world.model["p0"].knows
    people.insert(len(people), people[0])


def boss(world: InterruptedModel) -> None:
    """Another target, whose opposite is crowded."""
    world.model["p1"].boss = world.model["p4"]


def move(world: InterruptedModel) -> None:
    """Another container."""
    world.model["t1"].members.append(world.model["p5"])


def targets(world: InterruptedModel) -> None:
    """Other targets."""
    people = world.model
    people["p0"].knows = [people["p4"], people["p2"], people["p1"], people["p0"]]


def clear(world: InterruptedModel) -> None:
    """No targets."""
    world.model["p2"].knows = []


def retype(world: InterruptedModel) -> None:
    """Another class."""
    world.model["p1"].retype("Chief")


def lose(world: InterruptedModel) -> None:
    """Another class, which has none of the features."""
    world.model["p3"].retype("Ghost", lossy=True)


def rename(world: InterruptedModel) -> None:
    """Another name."""
    world.model.graph.set_object_name(_id(world, "p2"), "other")


def delete(world: InterruptedModel) -> None:
    """A container with its contents."""
    world.model["t1" if world.model.graph.find_object("t0") is None else "t0"].delete("spo")


def ask(world: InterruptedModel) -> None:
    """All views."""
    for name in world.names:
        world.rows(name)


def deliver(world: InterruptedModel) -> None:
    """Tell who listens."""
    world.matcher.listeners.deliver()


def several(world: InterruptedModel) -> None:
    """A transaction."""
    with world.model.transaction():
        link(world)
        ask(world)
        insert(world)
        place(world)
        targets(world)
        with world.model.transaction():
            value(world)
            delete(world)


def fail(world: InterruptedModel) -> None:
    """A transaction that fails."""
    try:
        with world.model.transaction():
            targets(world)
            ask(world)
            delete(world)
            create(world)
            raise KeyError
    except KeyError:
        pass


def commit(world: InterruptedModel) -> None:
    """A version."""
    world.versions.append(world.model.commit())


def first(world: InterruptedModel) -> None:
    """To the first version."""
    world.model.checkout(world.versions[0], discard=True)


def last(world: InterruptedModel) -> None:
    """To the last version."""
    world.model.checkout(world.versions[-1], discard=True)


def forget(world: InterruptedModel) -> None:
    """Nobody holds the second version any more."""
    del world.versions[1]
    assert world.model.graph.history.is_idle is False


def forget_all(world: InterruptedModel) -> None:
    """Nobody holds any version."""
    world.versions.clear()
    assert world.model.graph.history.is_idle


def mark(world: InterruptedModel) -> None:
    """A savepoint."""
    world.savepoints.append(world.model.graph.history.savepoint())


def back(world: InterruptedModel) -> None:
    """To the last savepoint."""
    world.model.graph.history.rollback(world.savepoints.pop())


def keep(world: InterruptedModel) -> None:
    """Close the last savepoint."""
    world.model.graph.history.release(world.savepoints.pop())


def shelve(world: InterruptedModel) -> None:
    """To the last savepoint, for a time."""
    world.shelves.append(world.model.graph.history.undo_to(world.savepoints.pop()))


def resume(world: InterruptedModel) -> None:
    """What was shelved."""
    world.savepoints.append(world.model.graph.history.redo(world.shelves[-1]))


def load(world: InterruptedModel) -> None:
    """Without a journal."""
    with world.model.loading():
        link(world)


def watch_less(world: InterruptedModel) -> None:
    """A view goes."""
    world.matcher.unwatch("above")


def watch_more(world: InterruptedModel) -> None:
    """A view comes."""
    world.matcher.watch("above")


SCENARIOS: dict[str, tuple[Step, ...]] = {
    "objects": (create, new, ask, rename, retype, ask, lose, delete, ask),
    "links": (link, boss, ask, unlink, value, move, ask, targets, clear, ask, deliver),
    "values": (value, values, ask, mark, values, value, back, commit, values, commit, first, deliver),
    "places": (
        *(insert, append, place, ask, mark, remove, rotate, insert, ask, back, commit, rotate, insert),
        *(commit, remove, place, commit, forget, first, last, ask, deliver),
    ),
    "transactions": (several, ask, fail, deliver),
    "savepoints": (
        link,
        mark,
        targets,
        ask,
        mark,
        create,
        back,
        value,
        ask,
        keep,
        mark,
        delete,
        back,
        deliver,
    ),
    "shelves": (
        mark,
        targets,
        retype,
        mark,
        delete,
        shelve,
        value,
        back,
        mark,
        link,
        shelve,
        resume,
        ask,
        keep,
    ),
    "versions": (commit, several, commit, create, commit, first, value, last, first, link, commit, last, ask),
    "freed": (
        commit,
        link,
        commit,
        targets,
        retype,
        commit,
        forget,
        first,
        last,
        value,
        commit,
        forget_all,
        ask,
    ),
    "watching": (watch_less, load, watch_more, link, ask),
}


@cache
def play(steps: tuple[Step, ...]) -> tuple[list[object], list[dict[int, object]], int]:
    """States before the steps and after the last, those of the versions, and how many instructions there are."""
    world, trip = InterruptedModel(), Trip(0)
    states, numbered = [world.state()], [dict[int, object]()]
    for step in steps:
        trip.run(lambda step=step: step(world))  # type: ignore[misc]
        world.check()
        states.append(world.state())
        numbered.append({**numbered[-1], **{v.number: s for v, s in _here(world)}})
    world.matcher.listeners.deliver()
    assert world.heard == set(world.rows("two"))
    return states, numbered, trip.passed


def _here(world: InterruptedModel) -> Iterator[tuple[Version, object]]:
    version = world.model.version
    if version is not None:
        yield version, world.state()


def interrupt(steps: tuple[Step, ...], trip: Trip, states: list[object], numbered: list[dict[int, object]]) -> None:
    """Play until the interruption, and look at everything."""
    world = InterruptedModel()
    for number, step in enumerate(steps):
        if trip.run(lambda step=step: step(world)):  # type: ignore[misc]
            world.check()
            assert world.state() in (states[number], states[number + 1])
            world.assert_usable(numbered[number + 1])
            return


def spread(name: str, most: int, instructions: int) -> Iterator[int]:
    """Some instructions, at other places in each scenario."""
    stride = instructions / most
    first = stride * (list(SCENARIOS).index(name) + 1) / (len(SCENARIOS) + 1)
    return (int(first + stride * number) for number in range(most))


@pytest.mark.parametrize("name", SCENARIOS)
def test_interruption_at_any_instruction_leaves_the_state_before_or_after(name: str) -> None:
    steps = SCENARIOS[name]
    states, numbered, instructions = play(steps)
    for instruction in spread(name, ONCE, instructions):
        interrupt(steps, Trip(instruction), states, numbered)


@pytest.mark.parametrize("name", SCENARIOS)
def test_second_interruption_during_recovery_leaves_a_consistent_state(name: str) -> None:
    steps = SCENARIOS[name]
    states, numbered, instructions = play(steps)
    for number, instruction in enumerate(spread(name, TWICE, instructions)):
        calls = 1 + number % 3, 7 + number % 11, 20 + number % 31
        for call in calls if NIGHTLY else calls[list(SCENARIOS).index(name) % 3 :][:1]:
            interrupt(steps, Trip(instruction, call), states, numbered)


def test_interrupted_commit_leaves_a_usable_model() -> None:
    model, trip = Model(PEOPLE), Trip(0)
    trip.run(model.commit)
    for instruction in range(trip.passed):
        model = Model(PEOPLE)
        Trip(instruction).run(model.commit)
        model.create("Person")
        version = model.commit()
        model.create("Person")
        model.checkout(version, discard=True)
        model.check_integrity()


def test_interrupted_checkout_of_a_visited_version_leaves_a_consistent_state() -> None:
    model = Model(PEOPLE)
    people = [model.create("Person", age=number) for number in range(4)]
    first = model.commit()
    people[0].knows.extend(people[1:3])
    people[2].age = 7
    people[1].retype("Chief")
    people[3].delete()
    second = model.commit()
    states = []
    for version in (first, second, first, second):
        model.checkout(version)
        states.append((model.state_hash(), model_to_json(model)))
    assert states[:2] == states[2:]
    for instruction in count(1):
        trip = Trip(instruction)
        trip.run(lambda: model.checkout(first))
        model.check_integrity()
        for version, state in ((second, states[1]), (first, states[0]), (second, states[1])):
            model.checkout(version)
            assert (model.state_hash(), model_to_json(model)) == state
        if not trip.tripped:
            break
    assert instruction > 100


@pytest.mark.parametrize("fails", [False, True])
def test_no_interruption_leaves_a_transaction_open(fails: bool) -> None:
    model = Model(PEOPLE)
    person = model.create("Person", age=0)

    def change() -> None:
        with model.transaction():
            person.age = 1
            if fails:
                raise KeyError

    for instruction in count(1):
        trip = Trip(instruction)
        with suppress(KeyError):
            trip.run(change)
        assert model.graph.history.savepoint_depth == 0
        assert person.age in ((0,) if fails else (0, 1))
        model.check_integrity()
        person.age = 0
        if not trip.tripped:
            break
    assert instruction > 100


class RaisingListener:
    """A listener that raises when it is notified of a change for the n-th time."""

    def __init__(self, number: int) -> None:
        self.left = number

    def inserted(self, _: object) -> None:
        """See `Hearer`."""
        self.left -= 1
        if self.left == 0:
            raise Refused

    removing = inserted

    def restored(self) -> None:
        """See `Hearer`."""


class Refused(Exception):
    """What a listener raises."""


@pytest.mark.parametrize("name", SCENARIOS)
def test_exception_of_a_listener_leaves_the_state_before_or_after(name: str) -> None:
    steps = SCENARIOS[name]
    states, numbered, _ = play(steps)
    for change in (*range(1, 9), 12, 17, 25, 40) if NIGHTLY else (1, 4, 17):
        world = InterruptedModel()
        Notified(world.model, RaisingListener(change))
        for number, step in enumerate(steps):
            try:
                step(world)
            except Refused:
                world.check()
                assert world.state() in (states[number], states[number + 1])
                world.assert_usable(numbered[number + 1])
                break
