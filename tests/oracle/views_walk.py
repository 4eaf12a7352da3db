"""Random walks of a model whose patterns are watched, with everything compared after each step.

    python -m tests.oracle.views_walk 0 1000            # 1,000 walks against the naive matcher
    python -m tests.oracle.views_walk 0 1000 --size 6   # larger worlds, against the compiled matcher
    python -m tests.oracle.views_walk 0 1000 --eager    # what else happens seldom, or in large models, happens at once

A walk and its number belong together: the same number gives the same walk. Failures are printed with their number.
"""

from __future__ import annotations

import argparse
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice

import pytest

from envgraph.errors import TransactionError
from envgraph.graph import Savepoint, Version
from envgraph.match import FREE, CompiledMatcher, Matcher, ViewMatcher
from envgraph.match.views import Subscription
from tests.oracle.naive._naive import NaiveMatcher
from tests.oracle.worlds import Dice, RandomCase, edit, random_case
from tests.thresholds import EAGER, set_thresholds

Row = tuple[object, ...]
Order = dict[str, list[Row]]


@dataclass
class ListenerState:
    """What a listener believes a pattern's matches to be.

    Attributes:
        rows: those that have appeared and not disappeared.
        calls: how often it was told anything.
    """

    subscription: Subscription
    rows: set[Row]
    calls: int = 0


class Walk:
    """A model, its watched patterns, and what they should hold: now, and in every state to go back to.

    Invariants: `check` passes after every other method. While a savepoint is open nobody is told anything, unless
    `deliver` is called.

    Args:
        seed: of the world.
        size: of the model.
        naive: whether the naive matcher says what is right; else the compiled one.
        watch: how many patterns are watched, in percent.
        world: makes the world.
    """

    def __init__(
        self,
        seed: int,
        size: int = 1,
        naive: bool = True,
        watch: int = 100,
        world: Callable[[int, int], RandomCase] = random_case,
    ) -> None:
        made = world(seed, size)
        dice = Dice(seed)
        self.model, self.library = made.model, made.library
        self.oracle: Matcher = (NaiveMatcher if naive else CompiledMatcher)(self.model, self.library)
        self.views = ViewMatcher(self.model, self.library)
        self.sizes = {
            pattern.qualified_name: len(pattern.parameters)
            for pattern in self.library.patterns
            if not self.library.inputs(pattern.qualified_name)
        }
        self.views.watch(*(name for name in self.sizes if dice.chance(watch)))
        self.savepoints: list[tuple[Savepoint, Order]] = []
        self.versions: list[tuple[Version, Order]] = []
        self.told: dict[str, list[ListenerState]] = {name: [] for name in self.sizes}

    # --- what must hold

    def order(self) -> Order:
        """The rows of every watched pattern, as they are listed."""
        return {name: list(self.views.rows(name, self.free(name))) for name in self.views.watched}

    def free(self, pattern: str) -> Row:
        """Arguments that give no values."""
        return (FREE,) * self.sizes[pattern]

    def check(self) -> None:
        """Every pattern has the rows that it should have, and everything recounted is what is held."""
        for name in self.sizes:
            rows = self.views.rows(name, self.free(name))
            assert len(set(rows)) == len(rows), f"{name}: a row is listed twice"
            expected = self.oracle.rows(name, self.free(name))
            assert sorted(rows) == sorted(expected), name
            assert self.views.count(name, self.free(name)) == len(rows)
            assert self.views.first(name, self.free(name)) == (rows[0] if rows else None)
            for row in islice(rows, 2):
                assert self.views.exists(name, row)
        self.views.check_integrity()

    def ask(self, dice: Dice) -> None:
        """A question with some values given."""
        name = dice.one(list(self.sizes))
        rows = self.oracle.rows(name, self.free(name))
        if rows:
            chosen = dice.one(rows)
            arguments = tuple(value if dice.chance(50) else FREE for value in chosen)
            agreeing = [r for r in rows if all(a is FREE or a == v for a, v in zip(arguments, r, strict=True))]
            assert sorted(self.views.rows(name, arguments)) == sorted(agreeing)
            assert self.views.exists(name, arguments)
            assert self.views.count(name, arguments) == len(agreeing)

    def _assert_order_restored(self, before: Order) -> None:
        """The watched patterns list their rows in the order that they had then."""
        now = self.order()
        for name in now:
            assert now[name] == before[name], f"{name}: another order"

    def _calls(self) -> int:
        return sum(each.calls for listeners in self.told.values() for each in listeners)

    @contextmanager
    def _assert_not_notified(self) -> Iterator[None]:
        """Nobody may be told anything inside."""
        before = self._calls()
        yield
        assert self._calls() == before, "told of what may still be rolled back"

    # --- changes

    def edit(self, dice: Dice, count: int, thin: bool = False) -> None:
        """Random changes."""
        if self.model.graph.history.savepoint_depth:
            with self._assert_not_notified():
                self._edit(dice, count, thin)
        else:
            self._edit(dice, count, thin)

    def _edit(self, dice: Dice, count: int, thin: bool = False) -> None:
        for _ in range(count):
            edit(dice, self.model, thin)

    def load(self, dice: Dice, count: int) -> None:
        """Random changes that are not recorded, if there is nothing to go back to."""
        if not self.model.graph.history.is_idle:
            return
        with self._assert_not_notified(), self.model.loading():
            self._edit(dice, count)
            name = dice.one(list(self.sizes))
            rows = self.views.rows(name, self.free(name))
            assert sorted(rows) == sorted(self.oracle.rows(name, self.free(name)))
        self.deliver()

    # --- savepoints

    def open(self) -> None:
        """Open a savepoint, perhaps inside others."""
        self.savepoints.append((self.model.graph.history.savepoint(), self.order()))

    def roll_back(self) -> None:
        """Roll back to the innermost savepoint."""
        if self.savepoints:
            savepoint, before = self.savepoints.pop()
            with self._assert_not_notified():
                self.model.graph.history.rollback(savepoint)
                self._assert_order_restored(before)

    def release(self) -> None:
        """Keep the changes since the innermost savepoint."""
        if not self.savepoints:
            return
        savepoint, _ = self.savepoints.pop()
        if self.savepoints:
            with self._assert_not_notified():
                self.model.graph.history.release(savepoint)
        else:
            self.model.graph.history.release(savepoint)
            self._assert_all_notified()

    # --- versions

    def commit(self) -> None:
        """Name the present state."""
        if not self.savepoints:
            version = self.model.commit()
            self._assert_all_notified()
            self.versions.append((version, self.order()))

    def check_out(self, number: int) -> None:
        """Go to a version, whatever becomes of changes that were not committed."""
        if not self.versions or self.savepoints:
            return
        version, before = self.versions[number % len(self.versions)]
        if self.model.version is version:
            self.views.listeners.deliver()  # what was told and then rolled back; going nowhere tells nothing
        try:
            self.model.checkout(version)
        except TransactionError:
            self.model.checkout(version, discard=True)
        self._assert_order_restored(before)
        self._assert_all_notified()

    def drop(self, number: int) -> None:
        """Hold a version no longer."""
        if self.versions:
            self.versions.pop(number % len(self.versions))

    def drop_all(self) -> None:
        """Hold no version any more."""
        self.versions.clear()

    # --- who watches and listens

    def watch(self, pattern: str) -> None:
        """Watch a pattern, if there is no state to go back to; else that is refused, or asked for later."""
        if self.model.graph.history.is_idle:
            self.views.watch(pattern)
            assert pattern in self.views.watched
        elif pattern not in self.views.watched:
            try:
                self.views.watch(pattern)
            except TransactionError:
                return
            raise AssertionError("watched, and there is a state in which it was not")

    def unwatch(self, pattern: str) -> None:
        """Watch a pattern no longer, unless somebody listens."""
        if not self.told[pattern]:
            self.views.unwatch(pattern)
            assert pattern not in self.views.watched

    def listen(self, pattern: str) -> None:
        """Listen to a pattern that is watched."""
        if pattern not in self.views.watched:
            return
        rows: set[Row] = set()

        def changed(appeared: list[Row], disappeared: list[Row]) -> None:
            listener.calls += 1
            assert appeared or disappeared, "told of nothing"
            assert len(set(appeared)) == len(appeared)
            assert len(set(disappeared)) == len(disappeared)
            assert rows.isdisjoint(appeared), "it was there already"
            assert rows.issuperset(disappeared), "it was not there"
            rows.difference_update(disappeared)
            rows.update(appeared)
            now = list(self.views.rows(pattern, self.free(pattern)))
            assert rows == set(now), "what was told does not make up the view"
            assert appeared == [row for row in now if row in set(appeared)]
            assert disappeared == sorted(disappeared)

        listener = ListenerState(self.views.listen(pattern, changed), rows)
        rows.update(self.views.rows(pattern, self.free(pattern)))
        self.told[pattern].append(listener)

    def unlisten(self, pattern: str) -> None:
        """The listener that came last goes."""
        if self.told[pattern]:
            self.views.listeners.remove(self.told[pattern].pop().subscription)

    def deliver(self) -> None:
        """Tell now, also what may be rolled back."""
        self.views.listeners.deliver()
        self._assert_all_notified()

    def _assert_all_notified(self) -> None:
        with self._assert_not_notified():
            for name, listeners in self.told.items():
                for listener in listeners:
                    assert listener.rows == set(self.views.rows(name, self.free(name))), f"{name}: not told"

    def close(self) -> None:
        """Go back everywhere, once."""
        while self.savepoints:
            self.roll_back()
            self.check()
        for number in range(len(self.versions)):
            self.check_out(number)
            self.check()


def step(walk: Walk, dice: Dice, size: int = 1) -> None:
    """One random step of a walk; edits are the most frequent."""
    pattern = dice.one(list(walk.sizes))
    match dice.number(0, 25):
        case 0 | 1 | 2 | 3 | 4 | 5:
            walk.edit(dice, dice.number(1, 4 * size))
        case 6 | 7:
            walk.edit(dice, dice.number(1, 4 * size), thin=True)
        case 8 | 9 | 10:
            walk.open()
        case 11 | 12:
            walk.roll_back()
        case 13:
            walk.release()
        case 14 | 15:
            walk.commit()
        case 16 | 17:
            walk.check_out(dice.number(0, 9))
        case 18:
            walk.drop(dice.number(0, 9))
        case 19:
            if dice.chance(50):
                walk.drop_all()
            walk.load(dice, dice.number(0, 5 * size))
        case 20:
            walk.drop_all()
            walk.watch(pattern)
        case 21:
            if dice.chance(30):
                walk.unwatch(pattern)
        case 22:
            walk.listen(pattern)
        case 23:
            walk.unlisten(pattern)
        case 24:
            walk.deliver()
        case 25:
            walk.ask(dice)


def run_random_walk(seed: int, size: int = 1, naive: bool = True) -> None:
    """A walk of random steps."""
    dice = Dice(seed)
    walk = Walk(seed, size, naive, watch=85)
    walk.check()
    for _ in range(dice.number(3, 15)):
        step(walk, dice, size)
        if dice.chance(30):  # an index that a question makes has to follow the next steps
            walk.ask(dice)
        if dice.chance(80):  # else several steps come between two looks
            walk.check()
    walk.close()


def main(arguments: Sequence[str]) -> int:
    """Walk, and say what failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int)
    parser.add_argument("--size", type=int, default=1, help="times as many objects, links and edits")
    parser.add_argument("--compiled", action="store_true", help="compare with the compiled matcher only")
    parser.add_argument("--eager", action="store_true", help="what happens seldom happens at once")
    options = parser.parse_args(arguments)
    if options.eager:
        set_thresholds(pytest.MonkeyPatch(), EAGER)
    failed: Counter[tuple[str, str, int]] = Counter()
    for seed in range(options.first, options.last):
        try:
            run_random_walk(seed, options.size, naive=options.size == 1 and not options.compiled)
        except Exception as problem:
            frame = traceback.extract_tb(problem.__traceback__)[-1]
            kind = (type(problem).__name__, frame.filename, frame.lineno or 0)
            failed[kind] += 1
            if failed[kind] <= 3:
                print(seed, *kind, str(problem)[:200], flush=True)
    print(f"{sum(failed.values())} of {options.last - options.first} failed", dict(failed))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
