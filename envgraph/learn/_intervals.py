"""Confidence intervals for what several training runs give."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, isfinite, pi, sin, sqrt, tan
from statistics import NormalDist, fmean, stdev

from envgraph.errors import InvalidArgument


def wilson_interval(proportion: float, runs: int, confidence: float = 0.95) -> tuple[float, float]:
    """Score interval for a proportion among so many runs. Wilson 1927, p. 209.

    >>> low, high = wilson_interval(1.0, 20)
    >>> round(low, 3), high
    (0.839, 1.0)
    """
    if not 0.0 <= proportion <= 1.0 or runs < 1:
        raise InvalidArgument("`proportion` must be from 0 to 1, and `runs` positive")
    z = NormalDist().inv_cdf(0.5 + _checked(confidence) / 2)
    weight = 1.0 + z * z / runs
    centre = (proportion + z * z / (2 * runs)) / weight
    spread = z * sqrt(proportion * (1.0 - proportion) / runs + z * z / (4.0 * runs * runs)) / weight
    return max(0.0, min(proportion, centre - spread)), min(1.0, max(proportion, centre + spread))


def mean_interval(values: Sequence[float], confidence: float = 0.95) -> tuple[float, float] | None:
    """Student's interval for the mean; None for fewer than two values, of which nothing can be said.

    >>> low, high = mean_interval([1.0, 2.0, 3.0])
    >>> round(low, 3), round(high, 3)
    (-0.484, 4.484)
    """
    if len(values) < 2:
        return None
    mean = fmean(values)
    spread = student_quantile(len(values) - 1, confidence) * stdev(values) / sqrt(len(values))
    return mean - spread, mean + spread


def student_quantile(freedom: int, confidence: float = 0.95) -> float:
    """The t that Student's distribution keeps within plus and minus t with this probability.

    Args:
        freedom: degrees of freedom, at least 1.
        confidence: the probability, in (0, 1).

    >>> round(student_quantile(19), 3)
    2.093
    """
    if freedom < 1:
        raise InvalidArgument("`freedom` must be at least 1")
    _checked(confidence)
    low, high = 0.0, pi / 2
    for _ in range(100):
        middle = (low + high) / 2
        if _student_probability(middle, freedom) < confidence:
            low = middle
        else:
            high = middle
    return tan(low) * sqrt(freedom)


def _student_probability(angle: float, freedom: int) -> float:
    """Probability within plus and minus tan(angle) x sqrt(freedom). Abramowitz and Stegun 1964, 26.7.3 and 26.7.4."""
    odd = freedom % 2
    term = cos(angle) if odd else 1.0
    total = 0.0
    for power in range(2 + odd, freedom + 1, 2):
        total += term
        term *= cos(angle) ** 2 * (power - 1) / power
    return 2 / pi * (angle + sin(angle) * total) if odd else sin(angle) * total


def _checked(confidence: float) -> float:
    if not isfinite(confidence) or not 0.0 < confidence < 1.0:
        raise InvalidArgument(f"`confidence` is {confidence!r}, it must be between 0 and 1")
    return confidence
