"""Learners side by side are learners of the trainer."""

from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

from envgraph.env.compiled import streams
from envgraph.solve import evaluate, steps_to_success
from envgraph.solve.learning import Epsilon, Learners, TrainingSettings, flatten, train_curriculum
from tests.unit.learn.forest_tables import published_family
from tests.unit.learn.small_tables import random_table

needs_numba = pytest.mark.skipif(
    find_spec("numba") is None, reason="numba, the extra `fast`, is not installed"
)


def generators(count: int) -> list[np.random.Generator]:
    return [np.random.default_rng(seed) for seed in range(count)]


@needs_numba
@pytest.mark.parametrize("steps", [2_000, 20_000])
def test_each_succeeds_exactly_where_the_trainer_does(steps: int) -> None:
    family = published_family()
    settings = TrainingSettings(steps_per_environment=steps)
    found = Learners(settings, family[-1]).judge(
        [flatten(one) for one in family], streams(generators(12)), steps
    )
    expected = []
    for rng in generators(12):
        q = train_curriculum(family, settings, rng, backend="python").q
        expected.append(evaluate(q, family[-1], 1, settings.limit, rng).success_rate)
    assert found.successes.tolist() == expected
    assert steps == 2_000 or 1.0 in expected


@needs_numba
@pytest.mark.parametrize(("outcomes", "starts"), [(1, 4), (3, 1), (4, 3)])
def test_a_played_episode_is_one_of_the_greedy_policy(outcomes: int, starts: int) -> None:
    """The share of successes of many learners is that of the trainer's Q-values, up to chance."""
    tables = [random_table(seed, outcomes, starts) for seed in (3, 4)]
    settings = TrainingSettings(steps_per_environment=800, limit=30, epsilon=Epsilon(reset="never"))
    found = Learners(settings, tables[-1]).judge(
        [flatten(one) for one in tables], streams(generators(60)), 800
    )
    expected = []
    for rng in generators(60):
        q = train_curriculum(tables, settings, rng, backend="numba").q
        expected.append(evaluate(q, tables[-1], 200, settings.limit, rng).success_rate)
    deviation = np.sqrt(0.25 / (60 * 16))
    assert abs(found.successes.mean() - np.mean(expected)) < 4 * deviation
    assert np.all((found.scores >= found.successes) & (found.scores <= 1.0))


@needs_numba
def test_streams_are_left_as_they_are_and_decide_alone() -> None:
    family = published_family()
    learners, tables = Learners(TrainingSettings(), family[-1]), [flatten(one) for one in family]
    rows = streams(generators(4))
    before = rows.copy()
    together = learners.judge(tables, rows, 500).scores
    assert np.array_equal(rows, before)
    apart = [learners.judge(tables, rows[place : place + 1], 500).scores[0] for place in range(4)]
    assert together.tolist() == apart


@needs_numba
def test_observations_that_nobody_meets_take_no_space() -> None:
    """Ten billion rows of values would not fit; what is learned is what is learned without them."""
    tables = [random_table(seed, 3, 2) for seed in (3, 4)]
    wide = [
        replace(one, observation=one.observation.astype(np.int64) * 10**9, n_observations=10**10)
        for one in tables
    ]
    settings = TrainingSettings(steps_per_environment=300, limit=30)
    found = [
        Learners(settings, some[-1])
        .judge([flatten(one) for one in some], streams(generators(20)), 300)
        .scores
        for some in (tables, wide)
    ]
    assert np.array_equal(*found) and found[0].std() > 0.0


def test_distances_are_those_of_a_search_from_each_state() -> None:
    for seed in range(8):
        table = random_table(seed, 2, 1)
        found = steps_to_success(table)
        for start in range(table.n_states):
            seen, frontier, steps, ended = {start}, [start], 0, False
            while frontier and not ended:
                steps += 1
                onward = []
                for state in frontier:
                    for action, outcome in np.argwhere(table.probability[state] > 0.0):
                        ended = ended or table.terminated[state, action, outcome] == 1
                        if table.terminated[state, action, outcome] == 0:
                            onward.append(int(table.next_state[state, action, outcome]))
                frontier = [one for one in dict.fromkeys(onward) if one not in seen]
                seen.update(frontier)
            assert found[start] == (steps if ended else table.n_states + 1)
