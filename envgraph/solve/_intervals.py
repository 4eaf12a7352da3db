"""Confidence intervals and robust statistics for the results of several training runs or episodes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite, sqrt
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from envgraph.errors import InvalidArgument

RESAMPLES = 2_000
"""The default number of resamples of a bootstrap."""

_MOST_DRAWN = 2**22
"""Maximum number of values that are resampled at a time."""

Statistic = Callable[..., NDArray[Any]]
"""A statistic of values along their last axis."""


def wilson_interval(proportion: float, runs: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return the score interval of a proportion among `runs` runs. Wilson 1927, p. 209.

    >>> low, high = wilson_interval(1.0, 20)
    >>> round(low, 3), high
    (0.839, 1.0)
    """
    if not 0.0 <= proportion <= 1.0 or runs < 1:
        raise InvalidArgument("`proportion` must be from 0 to 1, and `runs` must be at least 1")
    z = NormalDist().inv_cdf(0.5 + _checked_confidence(confidence) / 2)
    weight = 1.0 + z * z / runs
    centre = (proportion + z * z / (2 * runs)) / weight
    spread = z * sqrt(proportion * (1.0 - proportion) / runs + z * z / (4.0 * runs * runs)) / weight
    return max(0.0, min(proportion, centre - spread)), min(1.0, max(proportion, centre + spread))


def newcombe_interval(proportion: float, runs: int, other: float, others: int) -> tuple[float, float]:
    """Return the 95 % score interval of `proportion` minus `other`, for independent runs (Newcombe 1998, method 10).

    With the Wilson limits l and u of both, the difference d has the limits d - sqrt((p - l)^2 + (u' - p')^2) and
    d + sqrt((u - p)^2 + (p' - l')^2).

    >>> low, high = newcombe_interval(56 / 70, 70, 48 / 80, 80)
    >>> round(low, 4), round(high, 4)
    (0.0524, 0.3339)
    """
    low, high = wilson_interval(proportion, runs)
    other_low, other_high = wilson_interval(other, others)
    difference = proportion - other
    return (
        difference - sqrt((proportion - low) ** 2 + (other_high - other) ** 2),
        difference + sqrt((high - proportion) ** 2 + (other - other_low) ** 2),
    )


def bootstrap_interval(
    *samples: Sequence[float],
    statistic: Statistic = np.mean,
    confidence: float = 0.95,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> tuple[float, float] | None:
    """Return the percentile interval of the bootstrap (Efron and Tibshirani 1993, section 13.3; Agarwal et al. 2021).

    Each sample is resampled `resamples` times from its own values, with replacement. The interval is too narrow for
    fewer than about ten values, which show too little of their spread.

    Args:
        samples: one or more, each with at least two values.
        statistic: takes an array [.., values] of each sample and `axis=-1`; by default the mean of the only one.
        confidence: share of the resamples between the ends, in (0, 1).
        resamples: number of resamples.
        seed: the seed of the resampling.

    Returns:
        The ends of the interval; None if a sample has fewer than two values.

    >>> bootstrap_interval([1.0, 1.0, 1.0]), bootstrap_interval([1.0])
    ((1.0, 1.0), None)
    """
    tail = (1.0 - _checked_confidence(confidence)) / 2
    if resamples < 1 or not samples:
        raise InvalidArgument("give at least one sample, and `resamples` of at least 1")
    arrays = [np.asarray(sample, np.float64) for sample in samples]
    if min(map(len, arrays)) < 2:
        return None
    rng, found, rows = np.random.default_rng(seed), [], max(1, _MOST_DRAWN // sum(map(len, arrays)))
    for first in range(0, resamples, rows):
        count = min(rows, resamples - first)
        drawn = (array[rng.integers(len(array), size=(count, len(array)))] for array in arrays)
        found.append(statistic(*drawn, axis=-1))
    low, high = np.quantile(np.concatenate(found), [tail, 1.0 - tail])
    return float(low), float(high)


def interquartile_mean(values: Sequence[float] | NDArray[Any], axis: int = -1) -> NDArray[Any]:
    """Return the mean without the lowest and the highest quarter of the values; the quarters are rounded down.

    Agarwal et al. 2021, section 4.3. It is nearly as robust as the median, with less variance.

    >>> float(interquartile_mean([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 100.0]))
    3.5
    """
    ordered = np.sort(np.asarray(values, np.float64), axis=axis)
    size = ordered.shape[axis]
    if not size:
        raise InvalidArgument("`values` must contain at least one number")
    middle = np.take(ordered, range(size // 4, size - size // 4), axis=axis)
    return np.asarray(middle.mean(axis=axis))


def probability_of_improvement(
    values: Sequence[float] | NDArray[Any], others: Sequence[float] | NDArray[Any], axis: int = -1
) -> NDArray[Any]:
    """Return the probability that a run of `values` is better than a run of `others`; equal runs count half.

    The mean over all pairs of [x > y] + [x = y] / 2: Mann and Whitney's U divided by the number of pairs (Agarwal et
    al. 2021, section 4.3).

    >>> float(probability_of_improvement([1.0, 3.0], [2.0, 3.0]))
    0.375
    """
    first, second = (np.moveaxis(np.asarray(one, np.float64), axis, -1) for one in (values, others))
    if not first.size or not second.size:
        raise InvalidArgument("`values` and `others` must each contain at least one number")
    found = np.empty(first.shape[:-1])
    for place in np.ndindex(found.shape):
        ordered = np.sort(second[place])
        below = (np.searchsorted(ordered, first[place], side).mean() for side in ("left", "right"))
        found[place] = sum(below) / (2 * len(ordered))
    return found


def performance_profile(values: Sequence[float], thresholds: Sequence[float]) -> NDArray[np.float64]:
    """Return the share of the runs above each threshold: float64 [thresholds]. Agarwal et al. 2021, section 4.2.

    >>> performance_profile([0.0, 0.5, 1.0, 1.0], [-1.0, 0.0, 0.7, 1.0]).tolist()
    [1.0, 0.75, 0.5, 0.0]
    """
    if not len(values):
        raise InvalidArgument("`values` must contain at least one number")
    return np.asarray(np.greater.outer(np.asarray(values), np.asarray(thresholds)).mean(axis=0))


def _checked_confidence(confidence: float) -> float:
    if not isfinite(confidence) or not 0.0 < confidence < 1.0:
        raise InvalidArgument(f"`confidence` is {confidence!r}, it must be between 0 and 1")
    return confidence
