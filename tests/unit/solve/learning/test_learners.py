"""Learners side by side are learners of the trainer."""

from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

from envgraph.env.compiled import generator_states
from envgraph.solve import evaluate, steps_to_success
from envgraph.solve.learning import Epsilon, LearnerGroup, TrainingSettings, flatten_tabular, train_curriculum
from tests.unit.learn.forest_tables import published_family
from tests.unit.learn.small_tables import random_table

needs_numba = pytest.mark.skipif(find_spec("numba") is None, reason="numba, the extra `fast`, is not installed")


def generators(count: int) -> list[np.random.Generator]:
    return [np.random.default_rng(seed) for seed in range(count)]


@needs_numba
@pytest.mark.parametrize("steps", [2_000, 20_000])
def test_learners_succeed_exactly_where_the_trainer_succeeds(steps: int) -> None:
    family = published_family()
    settings = TrainingSettings(steps_per_environment=steps)
    found = LearnerGroup(settings, family[-1]).train_and_play(
        [flatten_tabular(one) for one in family], generator_states(generators(12)), steps
    )
    expected = []
    for rng in generators(12):
        q = train_curriculum(family, settings, rng, backend="python").q
        expected.append(evaluate(q, family[-1], 1, settings.limit, rng).success_rate)
    assert found.successes.tolist() == expected
    assert steps == 2_000 or 1.0 in expected


@needs_numba
@pytest.mark.parametrize(("outcomes", "starts"), [(1, 4), (3, 1), (4, 3)])
def test_episodes_of_learners_follow_the_greedy_policy(outcomes: int, starts: int) -> None:
    """The share of successes of many learners is that of the trainer's Q-values, up to chance."""
    tables = [random_table(seed, outcomes, starts) for seed in (3, 4)]
    settings = TrainingSettings(steps_per_environment=800, limit=30, epsilon=Epsilon(reset="never"))
    found = LearnerGroup(settings, tables[-1]).train_and_play(
        [flatten_tabular(one) for one in tables], generator_states(generators(60)), 800
    )
    expected = []
    for rng in generators(60):
        q = train_curriculum(tables, settings, rng, backend="numba").q
        expected.append(evaluate(q, tables[-1], 200, settings.limit, rng).success_rate)
    deviation = np.sqrt(0.25 / (60 * 16))
    assert abs(found.successes.mean() - np.mean(expected)) < 4 * deviation
    assert np.all((found.scores >= found.successes) & (found.scores <= 1.0))


@needs_numba
def test_scores_depend_only_on_their_random_streams() -> None:
    family = published_family()
    learners, tables = LearnerGroup(TrainingSettings(), family[-1]), [flatten_tabular(one) for one in family]
    rows = generator_states(generators(4))
    before = rows.copy()
    together = learners.train_and_play(tables, rows, 500).scores
    assert np.array_equal(rows, before)
    apart = [learners.train_and_play(tables, rows[place : place + 1], 500).scores[0] for place in range(4)]
    assert together.tolist() == apart


@needs_numba
def test_unvisited_observations_take_no_memory() -> None:
    """Ten billion rows of values would not fit; what is learned is what is learned without them."""
    tables = [random_table(seed, 3, 2) for seed in (3, 4)]
    wide = [replace(one, observation=one.observation.astype(np.int64) * 10**9, n_observations=10**10) for one in tables]
    settings = TrainingSettings(steps_per_environment=300, limit=30)
    found = [
        LearnerGroup(settings, some[-1])
        .train_and_play([flatten_tabular(one) for one in some], generator_states(generators(20)), 300)
        .scores
        for some in (tables, wide)
    ]
    assert np.array_equal(*found) and found[0].std() > 0.0


def test_steps_to_success_agree_with_a_breadth_first_search() -> None:
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
