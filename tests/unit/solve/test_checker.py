"""Certificates by other means agree with the first ones, and notice where those are wrong."""

from dataclasses import fields, replace
from math import inf

import numpy as np
import pytest

from envgraph.solve import Certificates, certify, recomputed
from tests.unit.learn.forest_tables import published_family
from tests.unit.learn.small_tables import random_table


@pytest.mark.parametrize("discount", [1.0, 0.9])
@pytest.mark.parametrize(("outcomes", "starts"), [(1, 1), (3, 1), (2, 4)])
def test_both_computations_agree_on_random_tables(outcomes: int, starts: int, discount: float) -> None:
    for seed in range(10):
        table = random_table(seed, outcomes, starts)
        one, other = (how(table, limit=17, discount=discount) for how in (certify, recomputed))
        for name in (field.name for field in fields(Certificates)):
            assert getattr(one, name) == pytest.approx(getattr(other, name), rel=1e-12, abs=1e-12), name


def test_both_computations_agree_on_the_published_family() -> None:
    for table in published_family():
        one, other = certify(table), recomputed(table)
        assert one.shortest_plan == other.shortest_plan < inf
        assert one.random_success == pytest.approx(other.random_success, rel=1e-9)
        assert one.optimal_return == pytest.approx(other.optimal_return, rel=1e-12)


def test_an_unsolvable_table_has_an_infinite_shortest_plan() -> None:
    table = random_table(1)
    closed = replace(table, terminated=np.zeros_like(table.terminated))
    assert recomputed(closed).shortest_plan == certify(closed).shortest_plan == inf
