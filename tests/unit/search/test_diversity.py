"""Measures of a family."""

from __future__ import annotations

from itertools import combinations_with_replacement
from math import log2

import pytest
from hypothesis import given, strategies as st

from envgraph.errors import InvalidArgument
from envgraph.search import BinnedEntropy, Gini

values = st.lists(st.floats(0, 1, allow_nan=False), min_size=2, max_size=12)


def test_entropy_of_six_values_in_six_bins_is_log2_6() -> None:
    assert BinnedEntropy(6).score([0.0, 0.2, 0.4, 0.55, 0.7, 0.93]) == pytest.approx(log2(6), abs=1e-12)


def test_the_published_family_has_the_maximal_entropy() -> None:
    published = [0.0, 0.198, 0.479, 0.585, 0.673, 0.932]
    assert BinnedEntropy(6).score(published) == pytest.approx(log2(6), abs=1e-12)


def test_entropy_puts_the_upper_end_and_outliers_into_the_border_bins() -> None:
    measure = BinnedEntropy(4, 0.0, 8.0)
    assert [measure.bin_of(value) for value in (-3.0, 0.0, 2.0, 7.999, 8.0, 99.0)] == [0, 0, 1, 3, 3, 3]


def test_entropy_of_one_bin_is_positive_zero() -> None:
    assert str(BinnedEntropy(3).score([0.5, 0.5])) == "0.0"


@pytest.mark.parametrize("size", range(1, 8))
@pytest.mark.parametrize(
    "measure",
    [
        BinnedEntropy(3),
        BinnedEntropy(5),
        BinnedEntropy(6, 1, 5, whole=True),
        BinnedEntropy(4, 0.5, 1.5, whole=True),
    ],
    ids=str,
)
def test_maximum_diversity_equals_the_best_score_of_all_families(measure: BinnedEntropy, size: int) -> None:
    values = range(-1, 8) if measure.whole else [place / 10 for place in range(11)]
    found = max(measure.score(family) for family in combinations_with_replacement(values, size))
    assert measure.maximum(size) == pytest.approx(found, abs=1e-12)


def test_values_far_outside_of_the_range_fall_into_the_border_bins() -> None:
    measure = BinnedEntropy(4, 0.0, 1e-300)
    assert [measure.bin_of(value) for value in (-1e308, 1e308)] == [0, 3]


@pytest.mark.parametrize(("bins", "low", "high"), [(0, 0.0, 1.0), (3, 1.0, 1.0), (3, 2.0, 1.0)])
def test_impossible_bins_are_refused(bins: int, low: float, high: float) -> None:
    with pytest.raises(InvalidArgument):
        BinnedEntropy(bins, low, high)


def test_gini_of_equal_values_is_zero_and_of_a_single_nonzero_value_nearly_one() -> None:
    assert Gini().score([2.0, 2.0, 2.0]) == 0.0
    assert Gini().score([0.0] * 9 + [1.0]) == pytest.approx(0.9)


@given(values)
def test_gini_is_half_the_relative_mean_absolute_difference(sample: list[float]) -> None:
    mean = sum(sample) / len(sample)
    if mean > 1e-9:
        differences = sum(abs(a - b) for a in sample for b in sample) / len(sample) ** 2
        assert Gini().score(sample) == pytest.approx(differences / (2 * mean), abs=1e-9)


def test_gini_refuses_negative_values() -> None:
    with pytest.raises(InvalidArgument):
        Gini().score([-1.0, 3.0])
