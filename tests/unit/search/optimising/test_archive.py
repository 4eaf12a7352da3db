"""What dominates what, and in which order states are preferred."""

from __future__ import annotations

from math import inf
from random import Random

from envgraph.search.optimising._goals import (
    ConstrainedCosts,
)
from envgraph.search.optimising._pareto_archive import rank_states


def points(*costs: tuple[float, ...]) -> list[ConstrainedCosts]:
    return [ConstrainedCosts(0.0, cost) for cost in costs]


def test_domination_compares_violations_first_and_then_all_objectives() -> None:
    assert ConstrainedCosts(1.0, (9.0, 9.0)).dominates(ConstrainedCosts(2.0, (0.0, 0.0)))
    assert not ConstrainedCosts(2.0, (0.0, 0.0)).dominates(ConstrainedCosts(1.0, (9.0, 9.0)))
    assert ConstrainedCosts(0.0, (1.0, 2.0)).dominates(ConstrainedCosts(0.0, (1.0, 3.0)))
    assert not ConstrainedCosts(0.0, (1.0, 2.0)).dominates(ConstrainedCosts(0.0, (1.0, 2.0)))
    assert not ConstrainedCosts(0.0, (1.0, 3.0)).dominates(ConstrainedCosts(0.0, (2.0, 2.0)))
    assert ConstrainedCosts(0.0, (1.0, 2.0)).dominates(ConstrainedCosts(0.0, (1.0, inf)))


def test_states_with_one_objective_are_ranked_by_violation_and_cost() -> None:
    standings = [ConstrainedCosts(1.0, (0.0,)), *points((3.0,), (1.0,), (inf,), (1.0,))]
    assert rank_states(standings) == [2, 4, 1, 3, 0]


def test_states_are_ranked_front_by_front_with_extreme_states_first() -> None:
    standings = points((5, 5), (0, 4), (4, 0), (1, 2), (1.1, 1.9), (6, 6))
    assert rank_states(standings) == [1, 2, 4, 3, 0, 5]


def test_no_state_is_ranked_before_one_that_dominates_it() -> None:
    rng = Random(1)
    for _ in range(20):
        standings = [
            ConstrainedCosts(float(rng.randrange(2)), (float(rng.randrange(4)), float(rng.randrange(4))))
            for _ in range(15)
        ]
        order = rank_states(standings)
        assert sorted(order) == list(range(15))
        place = {one: number for number, one in enumerate(order)}
        assert not any(
            standings[one].dominates(standings[two]) and place[two] < place[one] for one in order for two in order
        )
