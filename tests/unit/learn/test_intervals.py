"""Confidence intervals against printed tables."""

import pytest

from envgraph.errors import InvalidArgument
from envgraph.learn import mean_interval, wilson_interval
from envgraph.learn._intervals import student_quantile


@pytest.mark.parametrize(
    ("freedom", "confidence", "quantile"),
    [
        (1, 0.95, 12.706),
        (2, 0.95, 4.303),
        (3, 0.95, 3.182),
        (4, 0.95, 2.776),
        (9, 0.95, 2.262),
        (10, 0.99, 3.169),
        (29, 0.95, 2.045),
        (30, 0.90, 1.697),
        (120, 0.95, 1.980),
        (999, 0.95, 1.962),
    ],
)
def test_student_quantiles_are_those_of_the_tables(freedom: int, confidence: float, quantile: float) -> None:
    assert student_quantile(freedom, confidence) == pytest.approx(quantile, abs=5e-4)


@pytest.mark.parametrize(
    ("proportion", "runs", "interval"),
    [
        (1.0, 20, (0.8389, 1.0)),
        (0.0, 10, (0.0, 0.2775)),
        (0.5, 10, (0.2366, 0.7634)),
        (0.263, 380, (0.2212, 0.3094)),
    ],
)
def test_wilson_intervals(proportion: float, runs: int, interval: tuple[float, float]) -> None:
    assert wilson_interval(proportion, runs) == pytest.approx(interval, abs=2e-4)


def test_equal_values_have_an_interval_without_width() -> None:
    assert mean_interval([2.0, 2.0, 2.0]) == (2.0, 2.0)


def test_one_value_has_no_interval() -> None:
    assert mean_interval([2.0]) is None


@pytest.mark.parametrize("confidence", [0.0, 1.0, float("nan")])
def test_a_confidence_is_between_0_and_1(confidence: float) -> None:
    with pytest.raises(InvalidArgument, match="`confidence`"):
        wilson_interval(0.5, 10, confidence)
    with pytest.raises(InvalidArgument, match="`confidence`"):
        mean_interval([1.0, 2.0], confidence)


def test_impossible_counts_are_refused() -> None:
    with pytest.raises(InvalidArgument):
        wilson_interval(1.1, 10)
    with pytest.raises(InvalidArgument):
        wilson_interval(0.5, 0)
    with pytest.raises(InvalidArgument):
        student_quantile(0)
