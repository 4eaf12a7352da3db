"""What a score ranks."""

import numpy as np
import pytest

from envgraph.learn.audit import (
    ranking,
    two_way_test,
)
from envgraph.learn.audit._ranks import (
    level_parts,
    rank_correlation,
)


def test_rank_correlation_of_ties_is_that_of_midranks() -> None:
    values, others = np.array([1.0, 2.0, 2.0, 4.0]), np.array([3.0, 1.0, 2.0, 2.0])
    ranks, other_ranks = np.array([1, 2.5, 2.5, 4]), np.array([4, 1, 2.5, 2.5])
    assert rank_correlation(values, others) == pytest.approx(np.corrcoef(ranks, other_ranks)[0, 1])
    assert rank_correlation(values, np.ones(4)) == 0.0


def test_a_score_that_is_the_regret_ranks_perfectly() -> None:
    rng = np.random.default_rng(0)
    solvable = np.arange(100) % 4 > 0
    success = np.where(solvable, rng.random(100), 0.0)
    regret = np.where(solvable, 1.0 - success, 0.0)
    found = ranking(regret, regret, regret, success, solvable)
    assert (found.regret, found.regret_solvable, found.capture, found.repeat) == (1.0, 1.0, 1.0, 1.0)
    assert (found.unsolvable, found.mastered) == (0.0, 0.0)
    assert found.hopeless == np.mean(success[np.argsort(-regret, kind="stable")[:10]] < 0.05)


def test_unsolvable_levels_can_make_a_correlation_that_solvable_ones_do_not_have() -> None:
    rng = np.random.default_rng(0)
    solvable = np.arange(200) % 2 > 0
    regret = np.where(solvable, 0.1 + rng.random(200), 0.0)
    scores = np.where(solvable, 0.5 - 0.2 * regret, 0.0)
    found = ranking(scores, scores, regret, np.where(solvable, 0.5, 0.0), solvable)
    assert found.regret > 0.4
    assert found.regret_solvable == -1.0


def test_an_interval_over_seeds_and_levels_is_wider_than_over_either() -> None:
    rng = np.random.default_rng(1)
    seeds, levels = rng.standard_normal((20, 1)), rng.standard_normal((1, 30))
    low, high, _ = two_way_test(seeds + levels)
    for one in (seeds + np.zeros((1, 30)), levels + np.zeros((20, 1))):
        narrow = two_way_test(one)
        assert high - low > narrow[1] - narrow[0]
    assert two_way_test(np.full((3, 4), 0.25)) == (0.25, 0.25, 0.0)


@pytest.mark.parametrize("strength", [0.0, 1.0, 3.0])
def test_parts_of_levels_say_how_a_rank_correlation_varies_over_samples_of_levels(strength: float) -> None:
    rng, found, errors = np.random.default_rng(2), [], []
    for _ in range(200):
        values = rng.standard_normal(90)
        others = strength * values + rng.standard_normal(90)
        parts = level_parts(values, others)
        assert parts.shape == (20,)
        assert parts.mean() == pytest.approx(rank_correlation(values, others), abs=0.03)
        found.append(parts.mean())
        errors.append(parts.std(ddof=1) / np.sqrt(20))
    assert np.mean(errors) == pytest.approx(np.std(found), rel=0.15)
    assert level_parts(values[:3], others[:3]).shape == (3,)
