"""Significance tests for runs of several seeds."""

from __future__ import annotations

from collections.abc import Sequence
from math import atan, inf, pi, sqrt, tan

import numpy as np
from numpy.typing import ArrayLike, NDArray

from envgraph.errors import InvalidArgument

DRAWS = 10_000
"""The default number of draws of a test that is not exact."""

_MOST_EXACT_SUMS = 2**16
"""A test is exact if the sum has at most this many possible values."""

_GRID = 2.0**40

_ANGLES = 2**14
"""The number of parts of a right angle in the numerical integral of Student's t; see `mean_test`."""

FEWEST_UNITS = 10
"""Claims from fewer units, such as seeds, are undecided: if few units agree by chance, their variance is too small."""


def permutation_test(values: ArrayLike, others: ArrayLike, *, draws: int = DRAWS, seed: int = 0) -> float:
    """Return the two-sided p-value of a permutation test paired by seeds, the sign-flip test.

    If there is no difference, the two values of a seed can be exchanged. So p is the probability that the sum of the
    differences, each with a random sign, is at least as far from 0 as the observed sum (Good 2005). The test is exact
    if the sum takes few values, as with successes or few seeds. Otherwise p is (b + 1) / (draws + 1), where b draws are
    at least as far from 0 (Phipson and Smyth 2010).

    Args:
        values, others: the values of two methods, one for each seed, in the same order of seeds.
        draws: number of random sign vectors if the test is not exact.
        seed: the seed of the draws.

    Raises:
        InvalidArgument: there are no values, or not equally many.

    >>> permutation_test([1, 1, 1, 1, 1], [0, 0, 0, 0, 0])
    0.0625
    >>> permutation_test([1, 0, 1], [0, 0, 1])
    1.0
    """
    first = np.asarray(values, np.float64)
    second = np.asarray(others, np.float64)
    if first.ndim != 1 or not first.size or second.shape != first.shape:
        raise InvalidArgument(
            f"`values` and `others` must have one number for each seed, not {first.shape} and {second.shape}"
        )
    pairs = np.column_stack([first, second])[first != second]
    if not len(pairs):
        return 1.0
    # Values are whole multiples of a small unit: sums of the same numbers are equal in whatever order.
    whole = np.rint((pairs - pairs.min()) * (_GRID / np.ptp(pairs))).astype(np.int64)
    away = whole[:, 0] - whole[:, 1]
    least = abs(int(away.sum())) - 2 * away.size
    exact = _exact_p_value(away, least)
    if exact is not None:
        return exact
    rng = np.random.default_rng(seed)
    far = (abs(int((away * rng.choice((1, -1), away.size)).sum())) >= least for _ in range(draws))
    return (int(sum(far)) + 1) / (draws + 1)


def _exact_p_value(away: NDArray[np.int64], least: int) -> float | None:
    """Return the probability that `away`, summed with random signs, is at least `least` from 0; None if too costly."""
    sums: NDArray[np.int64] = np.zeros(1, np.int64)
    chances: NDArray[np.float64] = np.ones(1)
    for value in away:
        if sums.size * 2 > _MOST_EXACT_SUMS:
            return None
        sums, place = np.unique((sums[:, None] + [value, -value]).ravel(), return_inverse=True)
        chances = np.bincount(place, np.repeat(chances / 2, 2)).astype(np.float64)
    return min(1.0, float(chances[np.abs(sums) >= least].sum()))


def mean_test(value: float, *units: ArrayLike) -> tuple[float, float, float]:
    """Return low and high of the 95 % interval of a mean, and the two-sided p-value; p < .05 exactly if 0 is outside.

    The mean varies with each kind of unit that is sampled. Its variance v is the sum of v_k = variance / number over
    the kinds; value / sqrt(v) is compared with Student's t of v^2 / sum(v_k^2 / (number - 1)) degrees (Satterthwaite
    1946; Welch 1947). If each seed is run on each level, the variance of single pairs of seed and level is counted
    twice, so the test is a little too cautious (Cameron, Gelbach and Miller 2011; Owen 2007).

    Args:
        value: the mean, or a difference of means.
        units: for each kind, the means of its units; if a kind has fewer than two, the result is -inf, inf, 1.

    >>> low, high, p_value = mean_test(2.0, [1.0, 2.0, 3.0])
    >>> round(low, 3), round(high, 3), round(p_value, 4)
    (-0.484, 4.484, 0.0742)
    """
    means = [np.asarray(one, np.float64) for one in units]
    if min(map(len, means)) < 2:
        return -inf, inf, 1.0
    parts = [(float(one.var(ddof=1)) / len(one), len(one) - 1) for one in means]
    variance = sum(part for part, _ in parts)
    if not variance:
        return value, value, float(not value)
    degrees = variance**2 / sum(part**2 / free for part, free in parts)
    # With t = sqrt(degrees) tan(angle) the density of t is in proportion to cos(angle) ** (degrees - 1).
    angles = np.linspace(0.0, pi / 2, _ANGLES + 1)
    density = np.cos(angles) ** (degrees - 1.0)
    beyond = np.append(np.cumsum((density[1:] + density[:-1])[::-1])[::-1], 0.0)
    beyond /= beyond[0]
    width = sqrt(degrees * variance) * tan(float(np.interp(0.05, beyond[::-1], angles[::-1])))
    p_value = float(np.interp(atan(abs(value) / sqrt(degrees * variance)), angles, beyond))
    return value - width, value + width, p_value


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p-values corrected so that all significant claims hold together: Holm 1979.

    The smallest of m is multiplied by m, the next by m - 1 and so on. No result is below the one before, or above 1.

    >>> holm([0.01, 0.04, 0.03])
    [0.03, 0.06, 0.06]
    """
    adjusted, least = [0.0] * len(p_values), 0.0
    for place, number in enumerate(sorted(range(len(p_values)), key=lambda number: p_values[number])):
        least = min(1.0, max(least, (len(p_values) - place) * p_values[number]))
        adjusted[number] = least
    return adjusted
