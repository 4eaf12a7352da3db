"""Event rules against match sets that the naive matcher finds anew before and after every transaction."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import pairwise
from typing import Any

from hypothesis import example, given, settings, strategies as st

from envgraph.graph import Model, Version
from envgraph.match import FREE
from envgraph.rewrite import Engine, EventRule, Match
from tests.oracle.naive._naive import NaiveMatcher
from tests.profile import examples
from tests.unit.rewrite.graphs import METAMODEL, engine

QUERIES = """
pattern done(x : Item) { Item.done(x, true); }
pattern number(x : Item, n : int) { Item.n(x, n); }
pattern linked(x : Item, y : Item) { Item.links(x, y); }
pattern way(x : Item, y : Item) { Item.next+(x, y); }
pattern counted(x : Item, k : int) { Item(x); k == count find linked(x, _); }
pattern loose(x : Item) { Item(x); neg find linked(_, x); }
"""
KEYS = {"number": ("x",), "linked": ("x",), "way": ("x",), "counted": ("x",)}
SIZE = 4

edits = st.one_of(
    st.tuples(st.just("done"), st.integers(0, SIZE - 1)),
    st.tuples(st.just("number"), st.integers(0, SIZE - 1), st.integers(0, 2)),
    st.tuples(st.just("link"), st.integers(0, SIZE - 1), st.integers(0, SIZE - 1)),
    st.tuples(st.just("next"), st.integers(0, SIZE - 1), st.integers(0, SIZE)),
    st.tuples(st.just("create")),
    st.tuples(st.just("delete"), st.integers(0, SIZE - 1)),
)
steps = st.one_of(
    st.tuples(st.sampled_from(["keep", "keep", "rollback", "nested", "loose"]), st.lists(edits, max_size=5)),
    st.tuples(st.just("commit"), st.just([])),
    st.tuples(st.just("checkout"), st.just([])),
)
scripts = st.lists(steps, max_size=8)


def start() -> Engine:
    model = Model(METAMODEL)
    nodes = [model.create("Item", n=number % 2) for number in range(SIZE)]
    for left, right in pairwise(nodes):
        left.links = [right]
    return engine("", QUERIES, model=model)


def edit(model: Model, what: tuple[Any, ...]) -> None:
    """One change; the numbers choose among the objects that are there."""
    nodes = model.nodes("Item")
    if what[0] == "create":
        model.create("Item", n=1)
    if not nodes or what[0] == "create":
        return
    node = nodes[what[1] % len(nodes)]
    match what[0]:
        case "done":
            node.done = not node.done
        case "number":
            node.n = what[2]
        case "link":
            other = nodes[what[2] % len(nodes)]
            node.links = [one for one in node.links if one != other] if other in node.links else [*node.links, other]
        case "next":
            node.next = None if what[2] == SIZE else nodes[what[2] % len(nodes)]
        case _:
            node.delete("spo")


class Runner:
    """Does the steps of a script on an engine."""

    def __init__(self, made: Engine) -> None:
        self.made = made
        self.versions: list[Version] = []

    def do(self, kind: str, edits: Sequence[tuple[Any, ...]]) -> None:
        made, model = self.made, self.made.model
        if kind == "commit":
            self.versions.append(made.commit())
        elif kind == "checkout" and self.versions:
            made.checkout(self.versions[len(self.versions) // 2], discard=True)
        elif kind == "loose":
            for what in edits:
                edit(model, what)
            made.settle()
        elif kind == "rollback":
            with suppress(ZeroDivisionError), made.transaction():
                self.all(edits)
                raise ZeroDivisionError
        elif kind == "nested":
            with made.transaction():
                self.all(edits[::2])
                with suppress(ZeroDivisionError), made.transaction():
                    self.all(edits)
                    raise ZeroDivisionError
        elif kind == "keep":
            with made.transaction():
                self.all(edits)

    def all(self, edits: Sequence[tuple[Any, ...]]) -> None:
        for what in edits:
            edit(self.made.model, what)


def found(made: Engine, name: str) -> set[tuple[Any, ...]]:
    """The matches now, by a matcher of its own."""
    size = len(made.library.get(name).parameters)
    return set(NaiveMatcher(made.model, made.library).rows(name, (FREE,) * size))


Fired = tuple[str, tuple[Any, ...], "tuple[Any, ...] | None"]


def note(log: list[Fired], event: str) -> Callable[..., None]:
    if event == "update":
        return lambda match, old: log.append((event, match.row, old.row))
    return lambda match: log.append((event, match.row, None))


@settings(max_examples=examples(25))
@given(scripts)
@example(
    [
        ("keep", [("number", 0, 2)]),
        ("checkout", []),
        ("commit", []),
        ("keep", [("done", 1)]),
        ("checkout", []),
    ]
)
def test_event_jobs_fire_for_the_difference_of_the_match_sets(script: list[Any]) -> None:
    made = start()
    logs: dict[str, list[Fired]] = {name: [] for name in made.patterns}
    plain: dict[str, list[Fired]] = {name: [] for name in made.patterns}
    for name, log in logs.items():
        jobs = {event: note(log, event) for event in ("appear", "disappear", *(["update"] if name in KEYS else []))}
        made.on(name, existing=False, key=KEYS.get(name), **jobs)
        made.on(name, appear=note(plain[name], "appear"), disappear=note(plain[name], "disappear"), priority=1)
    made.settle()
    for name, log in plain.items():
        assert {row for _, row, _ in log} == found(made, name)
        log.clear()
    runner = Runner(made)
    for kind, changes in script:
        before = {name: found(made, name) for name in logs}
        runner.do(kind, changes)
        for name, log in logs.items():
            after = found(made, name)
            appeared, disappeared = after - before[name], before[name] - after
            if kind == "checkout":
                appeared = disappeared = set()
            if kind == "loose":  # some edits are transactions of their own
                assert net_changes(plain[name]) == net_changes(log) == (appeared, disappeared)
            else:
                check_plain(plain[name], appeared, disappeared)
                check_updates(log, appeared, disappeared)
            log.clear()
            plain[name].clear()
        assert len(made.agenda) == 0


def net_changes(log: list[Fired]) -> tuple[set[Any], set[Any]]:
    """What has come, and what has gone, when all is told."""
    total: Counter[tuple[Any, ...]] = Counter()
    for event, row, before in log:
        total[row] += -1 if event == "disappear" else 1
        if before is not None:
            total[before] -= 1
    assert set(total.values()) <= {-1, 0, 1}
    return {row for row, count in total.items() if count == 1}, {row for row, count in total.items() if count == -1}


def check_plain(log: list[Fired], appeared: set[Any], disappeared: set[Any]) -> None:
    assert sorted(row for event, row, _ in log if event == "appear") == sorted(appeared)
    assert [row for event, row, _ in log if event == "disappear"] == sorted(disappeared)


def check_updates(log: list[Fired], appeared: set[Any], disappeared: set[Any]) -> None:
    """Every match that has come or gone is told once; none comes and another goes with one key."""
    new = [row for event, row, _ in log if event in ("appear", "update")]
    old = [row if before is None else before for event, row, before in log if event in ("disappear", "update")]
    assert sorted(new) == sorted(appeared) and sorted(old) == sorted(disappeared)
    assert all(row[0] == before[0] for _, row, before in log if before is not None)
    if any(event == "update" for event, _, _ in log):
        came = {row[0] for event, row, _ in log if event == "appear"}
        assert came.isdisjoint(row[0] for event, row, _ in log if event == "disappear")


class Mirror:
    """Keeps a copy of the matches of a pattern by its jobs, which also change the model, and fail, now and then."""

    def __init__(self, made: Engine, name: str, habits: Sequence[int], priority: int) -> None:
        self.made = made
        self.name = name
        self.rows: set[tuple[Any, ...]] = set()
        self.failed: set[tuple[Any, ...]] = set()
        self.log: list[str] = []
        self._habits = list(habits)
        update = {"update": self.update, "key": KEYS[name]} if name in KEYS else {}
        self.rule: EventRule = made.on(name, appear=self.appear, disappear=self.disappear, priority=priority, **update)

    def appear(self, match: Match) -> None:
        assert match.row not in self.rows and match.row in found(self.made, self.name)
        self.failed.add(match.row)
        self._act(f"+{match.row}")
        self.failed.remove(match.row)
        self.rows.add(match.row)

    def disappear(self, match: Match) -> None:
        assert match.row not in found(self.made, self.name)
        self.rows.remove(match.row)
        self._act(f"-{match.row}")

    def update(self, match: Match, old: Match) -> None:
        assert match.row in found(self.made, self.name) and old.row not in found(self.made, self.name)
        self.failed.discard(match.row)
        self.rows.remove(old.row)
        self.rows.add(match.row)
        self._act(f"{old.row}>{match.row}")

    def _act(self, what: str) -> None:
        """Note it; change something while there are habits left; perhaps raise."""
        self.log.append(what)
        if not self._habits:
            return
        habit = self._habits.pop()
        model = self.made.model
        edit(
            model,
            [("done", habit), ("number", habit, habit % 3), ("link", habit, habit // 2), ("create",)][habit % 4],
        )
        if habit % 5 == 0:
            raise ZeroDivisionError


def mirror(script: list[Any], habits: list[int]) -> tuple[list[list[str]], int]:
    """Mirrors of all patterns while a script runs, checked after each step."""
    made = start()
    mirrors = [Mirror(made, name, habits[number % 3 :: 3], number % 3 - 1) for number, name in enumerate(made.patterns)]
    runner = Runner(made)
    for kind, changes in [("keep", []), *script]:
        if kind in ("commit", "checkout"):
            continue
        with suppress(ZeroDivisionError):
            runner.do(kind, changes)
        for _ in range(200):
            with suppress(ZeroDivisionError):
                made.settle()
                break
        assert len(made.agenda) == 0
        for one in mirrors:
            rows = found(made, one.name)
            one.failed &= rows
            assert one.rows == rows - one.failed
    made.check_integrity()
    return [one.log for one in mirrors], made.model.state_hash()


@settings(max_examples=examples(25))
@given(scripts, st.lists(st.integers(0, 40), max_size=12))
@example([("keep", [("number", 1, 2), ("delete", 0)])], [1, 5, 2, 10, 3, 0])
@example([], [0, 6, 0, 0, 0, 0, 0, 31, 4, 6, 0, 0])
def test_event_jobs_can_maintain_a_copy_of_the_matches(script: list[Any], habits: list[int]) -> None:
    assert mirror(script, habits) == mirror(script, habits)
