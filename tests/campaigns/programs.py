"""Random metamodels, models, patterns, rules and units: views, plans and rules against the naive oracles."""

from __future__ import annotations

from random import Random

from tests.oracle.rewriting_agreement import disagreement, given_values
from tests.oracle.rewriting_worlds import state_of
from tests.oracle.test_rewriting_agrees import world
from tests.oracle.views_walk import stroll


def prepare() -> None:
    """Nothing to do."""


def campaign(random: Random) -> str:
    """One program."""
    if random.random() < 0.5:
        stroll(random.randrange(2**32))
        return "views"
    found = world(random.randrange(2**48))
    for rule in found.rules:
        given = given_values(found.dice, rule, state_of(found.model))
        engine = found.engine(rule, watch=not given and random.random() < 0.5)
        wrong = disagreement(engine, found.patterns, rule, given)
        assert wrong is None, str(wrong)[:2000]
    return "rules"
