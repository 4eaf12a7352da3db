"""What dominates what, and in which order states are preferred."""

from __future__ import annotations

from math import inf
from random import Random

from envgraph.search.optimising._archive import ranked
from envgraph.search.optimising._goals import (
    Standing,
)


def points(*costs: tuple[float, ...]) -> list[Standing]:
    return [Standing(0.0, cost) for cost in costs]


def test_violations_come_first_then_what_is_better_in_something_and_worse_in_nothing() -> None:
    assert Standing(1.0, (9.0, 9.0)).dominates(Standing(2.0, (0.0, 0.0)))
    assert not Standing(2.0, (0.0, 0.0)).dominates(Standing(1.0, (9.0, 9.0)))
    assert Standing(0.0, (1.0, 2.0)).dominates(Standing(0.0, (1.0, 3.0)))
    assert not Standing(0.0, (1.0, 2.0)).dominates(Standing(0.0, (1.0, 2.0)))
    assert not Standing(0.0, (1.0, 3.0)).dominates(Standing(0.0, (2.0, 2.0)))
    assert Standing(0.0, (1.0, 2.0)).dominates(Standing(0.0, (1.0, inf)))


def test_with_one_goal_states_are_ranked_by_cost() -> None:
    standings = [Standing(1.0, (0.0,)), *points((3.0,), (1.0,), (inf,), (1.0,))]
    assert ranked(standings) == [2, 4, 1, 3, 0]


def test_fronts_come_one_after_the_other_and_in_each_the_ends_first() -> None:
    standings = points((5, 5), (0, 4), (4, 0), (1, 2), (1.1, 1.9), (6, 6))
    assert ranked(standings) == [1, 2, 4, 3, 0, 5]


def test_no_state_is_ranked_before_one_that_dominates_it() -> None:
    rng = Random(1)
    for _ in range(20):
        standings = [
            Standing(float(rng.randrange(2)), (float(rng.randrange(4)), float(rng.randrange(4))))
            for _ in range(15)
        ]
        order = ranked(standings)
        assert sorted(order) == list(range(15))
        place = {one: number for number, one in enumerate(order)}
        assert not any(
            standings[one].dominates(standings[two]) and place[two] < place[one]
            for one in order
            for two in order
        )
