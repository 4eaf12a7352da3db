"""Tests of significance for runs that are paired by their seeds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from envgraph.errors import InvalidArgument

DRAWS = 10_000
"""Of a test that is not exact."""

_EXACT = 2**16
"""A test is exact as long as the sum of the values has no more values than this."""

_GRID = 2.0**40


def permutation_test(values: ArrayLike, others: ArrayLike, *, draws: int = DRAWS, seed: int = 0) -> float:
    """Two-sided p-value of a permutation test paired by seeds; for one other value a seed, the sign-flip test.

    Were there no difference, of the values of one seed any might have been the first. So p is the probability that
    their sum over the seeds, each drawn among those of its seed, is as far from its mean as the one that was found
    (Good 2005). It is exact where the sum takes few values, as with successes or few seeds; else
    (b + 1) / (draws + 1), where b draws are as far (Phipson and Smyth 2010).

    Args:
        values: [seeds].
        others: [seeds] or [seeds, several], of the same seeds.
        draws: how many, where it is not exact.
        seed: of the draws.

    Raises:
        InvalidArgument: there are no values, or not as many on both sides.

    >>> permutation_test([1, 1, 1, 1, 1], [0, 0, 0, 0, 0])
    0.0625
    >>> permutation_test([1, 0, 1], [0, 0, 1])
    1.0
    """
    first = np.asarray(values, np.float64)
    second = np.asarray(others, np.float64)
    if first.ndim != 1 or not first.size or second.shape[:1] != first.shape or second.ndim > 2:
        raise InvalidArgument(
            f"values of as many seeds are needed on both sides, not {first.shape} and {second.shape}"
        )
    blocks = np.column_stack([first, second])
    blocks = blocks[(blocks != blocks[:, :1]).any(axis=1)]  # where all are equal nothing can be exchanged
    if not len(blocks):
        return 1.0
    # Values are whole multiples of a small unit: sums of the same numbers are equal in whatever order.
    whole = np.rint((blocks - blocks.min()) * (_GRID / np.ptp(blocks))).astype(np.int64)
    away = whole * whole.shape[1] - whole.sum(axis=1, keepdims=True)  # from the mean of the seed
    least = abs(int(away[:, 0].sum())) - away.size
    exact = _exact(away, least)
    return exact if exact is not None else _drawn(away, least, draws, seed)


def _exact(away: NDArray[np.int64], least: int) -> float | None:
    """The probability that the sum is at least so far from 0; None where it takes too many values."""
    sums: NDArray[np.int64] = np.zeros(1, np.int64)
    chances: NDArray[np.float64] = np.ones(1)
    for options in away:
        if sums.size * options.size > _EXACT:
            return None
        sums, place = np.unique((sums[:, None] + options).ravel(), return_inverse=True)
        chances = np.bincount(place, np.repeat(chances / options.size, options.size)).astype(np.float64)
    return min(1.0, float(chances[np.abs(sums) >= least].sum()))


def _drawn(away: NDArray[np.int64], least: int, draws: int, seed: int) -> float:
    rng, far = np.random.default_rng(seed), 0
    rows = np.arange(len(away))
    for _ in range(draws):
        far += abs(int(away[rows, rng.integers(away.shape[1], size=len(away))].sum())) >= least
    return (far + 1) / (draws + 1)


def holm(p_values: Sequence[float]) -> list[float]:
    """p-values of several claims, such that all hold at once: Holm 1979.

    The smallest of m is multiplied by m, the next by m - 1 and so on; none is less than one before it, nor more than 1.

    >>> holm([0.01, 0.04, 0.03])
    [0.03, 0.06, 0.06]
    """
    adjusted, least = [0.0] * len(p_values), 0.0
    for place, number in enumerate(sorted(range(len(p_values)), key=lambda number: p_values[number])):
        least = min(1.0, max(least, (len(p_values) - place) * p_values[number]))
        adjusted[number] = least
    return adjusted
