"""What a score ranks."""

import numpy as np
import pytest

from envgraph.learn.audit import (
    rank_levels,
    seed_and_level_test,
)
from envgraph.learn.audit._ranks import (
    jackknife_values,
    rank_correlation,
)


def test_rank_correlation_uses_midranks_for_ties() -> None:
    values, others = np.array([1.0, 2.0, 2.0, 4.0]), np.array([3.0, 1.0, 2.0, 2.0])
    ranks, other_ranks = np.array([1, 2.5, 2.5, 4]), np.array([4, 1, 2.5, 2.5])
    assert rank_correlation(values, others) == pytest.approx(np.corrcoef(ranks, other_ranks)[0, 1])
    assert rank_correlation(values, np.ones(4)) == 0.0


def test_a_score_equal_to_the_regret_has_rank_correlation_1() -> None:
    rng = np.random.default_rng(0)
    solvable = np.arange(100) % 4 > 0
    success = np.where(solvable, rng.random(100), 0.0)
    regret = np.where(solvable, 1.0 - success, 0.0)
    found = rank_levels(regret, regret, regret, success, solvable)
    assert (found.regret, found.regret_solvable, found.capture, found.repeat) == (1.0, 1.0, 1.0, 1.0)
    assert (found.unsolvable, found.mastered) == (0.0, 0.0)
    assert found.hopeless == np.mean(success[np.argsort(-regret, kind="stable")[:10]] < 0.05)


def test_unsolvable_levels_can_hide_the_correlation_of_solvable_levels() -> None:
    rng = np.random.default_rng(0)
    solvable = np.arange(200) % 2 > 0
    regret = np.where(solvable, 0.1 + rng.random(200), 0.0)
    scores = np.where(solvable, 0.5 - 0.2 * regret, 0.0)
    found = rank_levels(scores, scores, regret, np.where(solvable, 0.5, 0.0), solvable)
    assert found.regret > 0.4
    assert found.regret_solvable == -1.0


def test_an_interval_over_seeds_and_levels_is_wider_than_over_either() -> None:
    rng = np.random.default_rng(1)
    seeds, levels = rng.standard_normal((20, 1)), rng.standard_normal((1, 30))
    low, high, _ = seed_and_level_test(seeds + levels)
    for one in (seeds + np.zeros((1, 30)), levels + np.zeros((20, 1))):
        narrow = seed_and_level_test(one)
        assert high - low > narrow[1] - narrow[0]
    assert seed_and_level_test(np.full((3, 4), 0.25)) == (0.25, 0.25, 0.0)


@pytest.mark.parametrize("strength", [0.0, 1.0, 3.0])
def test_level_parts_estimate_the_variance_of_the_rank_correlation(strength: float) -> None:
    rng, found, errors = np.random.default_rng(2), [], []
    for _ in range(200):
        values = rng.standard_normal(90)
        others = strength * values + rng.standard_normal(90)
        parts = jackknife_values(values, others)
        assert parts.shape == (20,)
        assert parts.mean() == pytest.approx(rank_correlation(values, others), abs=0.03)
        found.append(parts.mean())
        errors.append(parts.std(ddof=1) / np.sqrt(20))
    assert np.mean(errors) == pytest.approx(np.std(found), rel=0.15)
    assert jackknife_values(values[:3], others[:3]).shape == (3,)
