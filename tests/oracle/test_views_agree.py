"""Watched patterns of random worlds against the naive matcher, after every step of random walks."""

from __future__ import annotations

import pytest
from hypothesis import settings, strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from tests.oracle.views_walk import Walk
from tests.oracle.worlds import Dice
from tests.profile import NIGHTLY
from tests.thresholds import EAGER, set_thresholds

pytestmark = pytest.mark.slow

EXAMPLES = settings().max_examples
"""Of the profile: 50 by day, 5,000 at night."""

SEEDS = st.integers(0, 2**32)
PATTERNS = st.integers(0, 20)


class Views(RuleBasedStateMachine):
    """A walk that hypothesis chooses. After every step `Walk.check` compares everything.

    Some edits are not looked at: what follows finds the views out of date.
    """

    walk: Walk
    looking = True

    @initialize(seed=SEEDS, watch=st.sampled_from([100, 100, 60]))
    def start(self, seed: int, watch: int) -> None:
        self.before()
        self.walk = Walk(seed, watch=watch)
        self.names = list(self.walk.sizes)

    def before(self) -> None:
        """What comes before the world."""

    def name(self, number: int) -> str:
        """Some pattern."""
        return self.names[number % len(self.names)]

    @rule(seed=SEEDS, count=st.integers(1, 6), look=st.booleans())
    def edit(self, seed: int, count: int, look: bool) -> None:
        self.walk.edit(Dice(seed), count)
        self.looking = look

    @rule(seed=SEEDS, count=st.integers(1, 6), look=st.booleans())
    def thin_out(self, seed: int, count: int, look: bool) -> None:
        self.walk.edit(Dice(seed), count, thin=True)
        self.looking = look

    @rule(seed=SEEDS)
    def ask(self, seed: int) -> None:
        self.walk.ask(Dice(seed))

    @rule()
    def open(self) -> None:
        self.walk.open()

    @rule(seed=SEEDS, count=st.integers(1, 6))
    def open_and_edit(self, seed: int, count: int) -> None:
        self.walk.open()
        self.walk.edit(Dice(seed), count)
        self.looking = seed % 2 == 0

    @precondition(lambda self: self.walk.savepoints)
    @rule()
    def roll_back(self) -> None:
        self.walk.roll_back()

    @precondition(lambda self: self.walk.savepoints)
    @rule()
    def release(self) -> None:
        self.walk.release()

    @precondition(lambda self: not self.walk.savepoints)
    @rule()
    def commit(self) -> None:
        self.walk.commit()

    @precondition(lambda self: self.walk.versions and not self.walk.savepoints)
    @rule(number=st.integers(0, 9))
    def check_out(self, number: int) -> None:
        self.walk.check_out(number)

    @precondition(lambda self: self.walk.versions)
    @rule(number=st.integers(0, 9))
    def drop(self, number: int) -> None:
        self.walk.drop(number)

    @precondition(lambda self: not self.walk.savepoints)
    @rule(seed=SEEDS, count=st.integers(1, 6))
    def load(self, seed: int, count: int) -> None:
        self.walk.drop_all()
        self.walk.load(Dice(seed), count)

    @rule(pattern=PATTERNS)
    def watch(self, pattern: int) -> None:
        self.walk.watch(self.name(pattern))

    @rule(pattern=PATTERNS)
    def unwatch(self, pattern: int) -> None:
        self.walk.unwatch(self.name(pattern))

    @rule(pattern=PATTERNS)
    def listen(self, pattern: int) -> None:
        self.walk.listen(self.name(pattern))

    @rule(pattern=PATTERNS)
    def unlisten(self, pattern: int) -> None:
        self.walk.unlisten(self.name(pattern))

    @rule()
    def deliver(self) -> None:
        self.walk.deliver()

    @invariant()
    def everything_agrees(self) -> None:
        if self.looking:
            self.walk.check()
        self.looking = True

    def teardown(self) -> None:
        if hasattr(self, "walk"):
            self.walk.close()


class EagerViews(Views):
    """The same where what else happens seldom, or in large models alone, happens at once."""

    def before(self) -> None:
        self.patch = pytest.MonkeyPatch()
        set_thresholds(self.patch, EAGER)

    def teardown(self) -> None:
        super().teardown()
        if hasattr(self, "patch"):
            self.patch.undo()


# Few steps, each with much to compare: an example takes a tenth of a second, most of it for planning and source.
TestViews = Views.TestCase
TestViews.settings = settings(max_examples=(4 if NIGHTLY else 1) * EXAMPLES, stateful_step_count=10)
TestEagerViews = EagerViews.TestCase
TestEagerViews.settings = settings(max_examples=EXAMPLES if NIGHTLY else EXAMPLES // 2, stateful_step_count=10)


@pytest.mark.parametrize("seed", [2, 3, 15, 16, 24])
def test_listeners_are_notified_in_row_order_after_replanning_a_grown_model(seed: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        set_thresholds(patch, EAGER)
        walk = Walk(seed, watch=100)
        for name in walk.sizes:
            walk.listen(name)
        walk.open()
        walk.edit(Dice(1), 5)
        walk.check()
        walk.release()  # each listener compares with what is listed then
        walk.check()
        assert sum(told.calls for each in walk.told.values() for told in each)
        walk.close()
