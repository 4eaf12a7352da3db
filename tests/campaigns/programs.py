"""Random metamodels, models, patterns, rules and units: views, plans and rules against the naive oracles."""

from __future__ import annotations

import tempfile
from pathlib import Path
from random import Random

from envgraph.graph import check_conformance
from envgraph.rewrite import Engine
from envgraph.search import generate
from tests.oracle.naive._naive import NaiveMatcher
from tests.oracle.rewriting_agreement import disagreement, given_values
from tests.oracle.rewriting_worlds import state_of
from tests.oracle.test_rewriting_agrees import random_rewriting_case
from tests.oracle.views_walk import run_random_walk

SEARCHED = ["burning_forest/paper.toml", "keydoor/diverse.toml", "network/diverse.toml"]


def prepare() -> None:
    """Nothing to do."""


def campaign(random: Random) -> str:
    """One program."""
    if random.random() < 0.1:
        _generate(random.randrange(10**6), random.choice(SEARCHED))
        return "families"
    if random.random() < 0.5:
        run_random_walk(random.randrange(2**32))
        return "views"
    found = random_rewriting_case(random.randrange(2**48))
    for rule in found.rules:
        given = given_values(found.dice, rule, state_of(found.model))
        engine = found.engine(rule, watch=not given and random.random() < 0.5)
        wrong = disagreement(engine, found.patterns, rule, given)
        assert wrong is None, str(wrong)[:2000]
    return "rules"


def _generate(seed: int, domain: str) -> None:
    """A short search, which keeps views: what it says of its members holds, and the naive matcher agrees on them."""
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory, "run.sqlite")
        family = generate(domain, path, seed=seed, generations=3, population=3)
    for member in family.members:
        model = family.model(member)
        engine = family.domain.engine(family.model(member))
        naive = Engine(model, matcher=NaiveMatcher)
        naive.add(*engine.definitions)
        for name in (*engine.patterns, *engine.rules):
            if any(one.is_required for one in engine.signature(name).parameters) if name in engine.rules else False:
                continue
            rows = [sorted(match.row for match in one.matches(name)) for one in (engine, naive)]
            assert rows[0] == rows[1], name
        assert not check_conformance(model)
