"""Confidence intervals against printed tables and brute force."""

from collections.abc import Callable
from itertools import product
from statistics import fmean

import numpy as np
import pytest
from hypothesis import given, strategies as st

from envgraph.errors import InvalidArgument
from envgraph.solve import (
    _intervals,
    bootstrap_interval,
    interquartile_mean,
    newcombe_interval,
    performance_profile,
    probability_of_improvement,
    wilson_interval,
)


@pytest.mark.parametrize(
    ("proportion", "runs", "interval"),
    [
        (1.0, 20, (0.8389, 1.0)),
        (0.0, 10, (0.0, 0.2775)),
        (0.5, 10, (0.2366, 0.7634)),
        (0.263, 380, (0.2212, 0.3094)),
    ],
)
def test_wilson_intervals_agree_with_printed_tables(
    proportion: float, runs: int, interval: tuple[float, float]
) -> None:
    assert wilson_interval(proportion, runs) == pytest.approx(interval, abs=2e-4)


@pytest.mark.parametrize(
    ("first", "second", "interval"),
    [
        ((56, 70), (48, 80), (0.0524, 0.3339)),
        ((9, 10), (3, 10), (0.1705, 0.8090)),
        ((6, 7), (2, 7), (0.0582, 0.8062)),
        ((5, 56), (0, 29), (-0.0381, 0.1926)),
        ((0, 10), (0, 20), (-0.1611, 0.2775)),
        ((10, 10), (0, 20), (0.6791, 1.0)),
        ((10, 10), (0, 10), (0.6075, 1.0)),
    ],
)
def test_newcombe_intervals_agree_with_the_printed_tables(
    first: tuple[int, int], second: tuple[int, int], interval: tuple[float, float]
) -> None:
    (reached, runs), (other, others) = first, second
    found = newcombe_interval(reached / runs, runs, other / others, others)
    assert found == pytest.approx(interval, abs=6e-5)


def test_a_bootstrap_of_two_values_has_the_means_of_all_resamples() -> None:
    assert bootstrap_interval([0.0, 1.0], confidence=0.6) == (0.0, 1.0)  # a quarter each
    assert bootstrap_interval([0.0, 1.0], confidence=0.4) == (0.5, 0.5)


def test_a_bootstrap_interval_agrees_with_the_quantiles_of_all_resamples() -> None:
    values = [0.3, 1.0, 2.5, 2.6]
    every = [fmean(one) for one in product(values, repeat=4)]
    found = bootstrap_interval(values, confidence=0.8, resamples=50_000)
    assert found == pytest.approx(np.quantile(every, [0.1, 0.9]), abs=0.02)


def test_a_bootstrap_interval_depends_only_on_its_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    values, others = [1.0, 2.0, 4.0, 8.0], [3.0, 3.5, 5.0]
    first = bootstrap_interval(values, statistic=interquartile_mean)
    assert first == bootstrap_interval(values, statistic=interquartile_mean)
    assert first != bootstrap_interval(values, statistic=interquartile_mean, seed=1, resamples=20)
    low, high = bootstrap_interval(values, others, statistic=probability_of_improvement) or (1.0, 0.0)
    assert 0.0 <= low < float(probability_of_improvement(values, others)) < high <= 1.0
    monkeypatch.setattr(_intervals, "_MOST_DRAWN", 40)
    assert bootstrap_interval(values, resamples=25) is not None


@given(st.lists(st.integers(-5, 5), min_size=1, max_size=12))
def test_an_interquartile_mean_leaves_out_the_outer_quarters(values: list[int]) -> None:
    cut = len(values) // 4
    middle = sorted(values)[cut : len(values) - cut]
    assert float(interquartile_mean(values)) == pytest.approx(fmean(middle))
    assert interquartile_mean([values, values]).tolist() == pytest.approx([fmean(middle)] * 2)


@given(st.lists(st.integers(0, 4), min_size=1, max_size=8), st.lists(st.integers(0, 4), min_size=1, max_size=8))
def test_probability_of_improvement_is_the_share_of_better_pairs(values: list[int], others: list[int]) -> None:
    pairs = [(x > y) + (x == y) / 2 for x in values for y in others]
    assert float(probability_of_improvement(values, others)) == pytest.approx(fmean(pairs))
    shares = performance_profile(values, others)
    assert shares.tolist() == pytest.approx([fmean(x > y for x in values) for y in others])


@pytest.mark.parametrize("confidence", [0.0, 1.0, float("nan")])
def test_a_confidence_outside_0_to_1_is_refused(confidence: float) -> None:
    with pytest.raises(InvalidArgument, match="`confidence`"):
        wilson_interval(0.5, 10, confidence)
    with pytest.raises(InvalidArgument, match="`confidence`"):
        bootstrap_interval([1.0, 2.0], confidence=confidence)


@pytest.mark.parametrize(
    "act",
    [
        lambda: wilson_interval(1.1, 10),
        lambda: wilson_interval(0.5, 0),
        bootstrap_interval,
        lambda: bootstrap_interval([1.0, 2.0], resamples=0),
        lambda: interquartile_mean([]),
        lambda: probability_of_improvement([], [1.0]),
        lambda: performance_profile([], [1.0]),
    ],
)
def test_invalid_arguments_are_refused(act: Callable[[], object]) -> None:
    with pytest.raises(InvalidArgument):
        act()
