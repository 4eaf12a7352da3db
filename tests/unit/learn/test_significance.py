"""Tests of significance against all permutations."""

from itertools import product
from math import comb

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numpy.typing import ArrayLike

from envgraph.errors import InvalidArgument
from envgraph.learn import Curve, Experiment, RunResult, compare, holm, mean_test

CURVE = Curve((1,), (0.0,), (1,), (0,))


def p_value(values: ArrayLike, others: ArrayLike) -> float:
    """Return the p-value of the comparison of a curriculum with a control that have these returns, by seeds."""
    runs = [
        RunResult(kind, kind, seed, 1, 1, 0.0, one, 1.0, 0, 0.0, CURVE)  # type: ignore[arg-type]
        for kind, returns in (("curriculum", values), ("control", others))
        for seed, one in enumerate(np.asarray(returns, np.float64).tolist())
    ]
    (comparison,) = compare(Experiment(tuple(runs)), can_succeed=False)
    return comparison.p_value


ROW = st.tuples(*[st.sampled_from([0.0, 0.25, 1.0, 1 / 3, 10.2])] * 2)


def share_of_permutations(blocks: list[tuple[float, ...]]) -> float:
    """The share of all choices of one value a seed whose sum is as far from the mean as that of the first ones."""
    middle = sum(sum(block) / len(block) for block in blocks)
    found = abs(sum(block[0] for block in blocks) - middle)
    sums = [abs(sum(choice) - middle) for choice in product(*blocks)]
    return sum(one >= found - 1e-9 for one in sums) / len(sums)


@given(st.lists(ROW, min_size=1, max_size=6))
def test_p_is_the_share_of_all_permutations(blocks: list[tuple[float, ...]]) -> None:
    values, others = zip(*blocks, strict=True)
    assert p_value(values, others) == pytest.approx(share_of_permutations(blocks))


@pytest.mark.parametrize(("better", "worse"), [(7, 24 - 7), (12, 3), (1, 0), (40, 60)])
def test_the_p_value_of_successes_is_that_of_the_exact_sign_test(better: int, worse: int) -> None:
    """And McNemar's: seeds in which both do the same say nothing."""
    values = [1] * better + [0] * worse + [1, 0, 1]
    others = [0] * better + [1] * worse + [1, 0, 1]
    number, least = better + worse, max(better, worse)
    tail = sum(comb(number, count) for count in range(least, number + 1)) / 2**number
    assert p_value(values, others) == pytest.approx(min(1.0, 2 * tail))


def test_the_p_value_of_17_of_24_agrees_with_the_binomial_table() -> None:
    assert p_value([1] * 17 + [0] * 7, [0] * 17 + [1] * 7) == pytest.approx(0.0639, abs=5e-5)


def test_the_p_value_of_darwins_data_agrees_with_fisher() -> None:
    """Maize, The Design of Experiments, section 21: of 32,768 arrangements 1,726 are as far on either side."""
    differences = [49, -67, 8, 16, 6, 23, 28, 41, 14, 29, 56, 24, 75, 60, -48]
    assert p_value(differences, [0] * 15) == pytest.approx(1726 / 32768)


def test_the_p_value_of_random_signs_is_close_to_that_of_all_signs() -> None:
    """With 18 seeds whose differences have 262,144 sums, signs are drawn at random."""
    differences = np.random.default_rng(5).normal(0.8, 1.0, 18)
    sums = np.zeros(1)
    for one in differences:
        sums = np.concatenate([sums + one, sums - one])
    exact = float(np.mean(np.abs(sums) >= abs(differences.sum()) - 1e-9))
    assert 0.01 < exact < 0.2
    drawn = p_value(differences, np.zeros(18))
    assert drawn == p_value(differences, np.zeros(18)) != exact
    assert drawn == pytest.approx(exact, abs=4 * (exact * (1 - exact) / 10_000) ** 0.5)
    assert p_value(np.random.default_rng(0).random(40) + 1, np.zeros(40)) == 1 / 10_001  # never 0


def test_equal_values_have_the_p_value_1() -> None:
    assert p_value([1, 0, 0.5], [1, 0, 0.5]) == 1.0


@given(st.lists(st.floats(0, 1), min_size=1, max_size=6))
def test_holm_steps_down(p_values: list[float]) -> None:
    adjusted, number = holm(p_values), len(p_values)
    for own, found in zip(p_values, adjusted, strict=True):
        smaller = [other for other in p_values if other <= own]
        ranks = [sum(other < one for other in p_values) for one in smaller]
        assert found == pytest.approx(
            min(1.0, max((number - rank) * one for rank, one in zip(ranks, smaller, strict=True)))
        )


def test_comparisons_of_different_seeds_are_refused() -> None:
    with pytest.raises(InvalidArgument, match="different seeds"):
        p_value([1], [1, 2])


@pytest.mark.parametrize(("degrees", "factor"), [(1, 12.7062), (2, 4.3027), (9, 2.2622), (30, 2.0423), (1000, 1.9623)])
def test_the_interval_of_a_mean_is_that_of_students_t(degrees: int, factor: float) -> None:
    values = np.random.default_rng(0).standard_normal(degrees + 1)
    low, high, p_value = mean_test(float(values.mean()), values)
    error = values.std(ddof=1) / np.sqrt(degrees + 1)
    assert [low, high] == pytest.approx(values.mean() + np.array([-1, 1]) * factor * error, rel=1e-4)
    assert mean_test(factor * error, values)[2] == pytest.approx(0.05, rel=1e-4)
    assert mean_test(-factor * error, values)[2] == pytest.approx(0.05, rel=1e-4)
    assert (p_value < 0.05) == (low > 0 or high < 0)


def test_small_p_values_are_those_of_the_table() -> None:
    values = np.random.default_rng(0).standard_normal(10)
    error = values.std(ddof=1) / np.sqrt(10)
    assert mean_test(4.7809 * error, values)[2] == pytest.approx(0.001, rel=1e-3)
    assert mean_test(0.0, values)[2] == 1.0


@given(
    st.floats(-3, 3),
    st.lists(st.floats(-1, 1), min_size=2, max_size=9),
    st.lists(st.floats(-9, 9), min_size=2),
)
def test_p_is_below_5_percent_exactly_if_the_interval_excludes_0(
    value: float, units: list[float], others: list[float]
) -> None:
    low, high, p_value = mean_test(value, units, others)
    assert low <= value <= high
    if abs(p_value - 0.05) > 1e-9:
        assert (p_value < 0.05) == (low > 0 or high < 0)


def test_two_samples_are_compared_by_welchs_test() -> None:
    """Welch 1947 by hand: variances 2.5 / 5 and 10 / 5 over 4 degrees each, t = 3 / sqrt(2.5), 5.88 degrees."""
    low, high, p_value = mean_test(3.0, [1, 2, 3, 4, 5], [2, 4, 6, 8, 10])
    assert p_value == pytest.approx(0.1075, abs=5e-4)
    assert (high - low) / 2 == pytest.approx(2.4593 * np.sqrt(2.5), rel=1e-3)


def test_the_interval_is_infinite_for_one_unit_and_a_point_without_variance() -> None:
    assert mean_test(0.5, [0.5], [1.0, 2.0]) == (-np.inf, np.inf, 1.0)
    assert mean_test(0.5, [0.5, 0.5]) == (0.5, 0.5, 0.0)
    assert mean_test(0.0, [0.0, 0.0]) == (0.0, 0.0, 1.0)
