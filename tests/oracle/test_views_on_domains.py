"""Everything that the queries and rules of four domains look for, watched while random rules are applied."""

from __future__ import annotations

from contextlib import suppress

import pytest

from envgraph.errors import RuleError
from envgraph.graph import Version
from envgraph.match import FREE, ViewMatcher
from envgraph.pattern import conformance_patterns
from envgraph.rewrite import Engine
from tests.oracle.naive._naive import NaiveMatcher
from tests.oracle.worlds import Dice
from tests.profile import NIGHTLY
from tests.unit.match.kinds import watchable
from tests.unit.rewrite.domains import domain

Order = dict[str, list[tuple[object, ...]]]

MODELS = {
    "burning_forest": "running_4x4",
    "keydoor": "two_rooms",
    "network": "backbone",
    "warehouse": "small_hall",
}


class WatchedDomain:
    """An engine whose patterns are all watched, those of the metamodel's constraints included."""

    def __init__(self, name: str) -> None:
        self.engine: Engine = domain(name, MODELS[name])
        self.library = self.engine.library
        known = {pattern.qualified_name for pattern in self.library.patterns}
        demands = conformance_patterns(self.engine.model.metamodel)
        self.library.add(*(each for each in demands if each.qualified_name not in known))
        self.views = self.engine.matcher
        self.names = watchable(self.library)
        assert isinstance(self.views, ViewMatcher)
        self.views.watch(*self.names)
        self.rules = [
            *(name for name in self.engine.rules if not self.engine.signature(name).parameters),
            *self.engine.groups,
        ]
        self.fired = 0

    def order(self) -> Order:
        """The rows of all patterns, as they are listed."""
        return {name: list(self.views.rows(name, self.free(name))) for name in self.names}

    def free(self, name: str) -> tuple[object, ...]:
        """Arguments that give no values."""
        return (FREE,) * len(self.library.parameter_types(name))

    def check(self) -> None:
        """Every view holds what the naive matcher finds."""
        naive = NaiveMatcher(self.engine.model, self.library)
        for name, rows in self.order().items():
            assert sorted(rows) == naive.rows(name, self.free(name)), name
        self.engine.check_integrity()

    def fire(self, dice: Dice, count: int) -> None:
        """Apply some rules at random; what they refuse is not done."""
        for _ in range(count):
            with suppress(RuleError):
                self.fired += self.engine.apply(dice.one(self.rules)) is not None


@pytest.mark.parametrize("seed", range(2 if NIGHTLY else 1))
@pytest.mark.parametrize("name", MODELS)
def test_watched_queries_of_domains_agree_with_the_naive_matcher(name: str, seed: int) -> None:
    dice, play = Dice(seed), WatchedDomain(name)
    play.check()
    versions: list[tuple[Version, Order]] = []
    for _ in range(10):
        match dice.number(0, 3):
            case 0 | 1:
                play.fire(dice, dice.number(1, 4))
            case 2:
                before, savepoint = play.order(), play.engine.model.graph.history.savepoint()
                play.fire(dice, dice.number(1, 6))
                play.check()
                play.engine.model.graph.history.rollback(savepoint)
                assert play.order() == before
            case 3:
                versions.append((play.engine.commit(), play.order()))
                play.fire(dice, 2)
                version, before = dice.one(versions)
                play.engine.checkout(version, discard=True)
                assert play.order() == before
        play.check()
    assert play.fired > 5
