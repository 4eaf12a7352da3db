"""What a score ranks: rank correlations with what is exact, and what its highest values are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from envgraph.code import dataclass

Floats = NDArray[np.float64]

MASTERED, HOPELESS = 0.95, 0.05
"""A level on which the policy succeeds more often is mastered, one on which it does less often hopeless."""

TOP = 0.1
"""The share of the levels that a score puts highest."""


def midranks(values: Floats) -> Floats:
    """The rank of each value from 1; equal ones share the mean of theirs.

    >>> midranks(np.array([3.0, 1.0, 3.0])).tolist()
    [2.5, 1.0, 2.5]
    """
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(count)
    return np.asarray((last - (count - 1) / 2.0)[place])


def rank_correlation(values: Floats, others: Floats) -> float:
    """Spearman's correlation, of midranks (Spearman 1904); 0 where all values of one side are equal.

    >>> rank_correlation(np.array([1.0, 2.0, 3.0]), np.array([1.0, 4.0, 9.0]))
    1.0
    """
    first, second = midranks(values), midranks(others)
    first, second = first - first.mean(), second - second.mean()
    norm = float(np.sqrt((first @ first) * (second @ second)))
    return round(float(first @ second) / norm, 12) if norm > 0 else 0.0


def level_parts(values: Floats, others: Floats) -> Floats:
    """Return the jackknife pseudo-values of a rank correlation over groups of levels, 20 or as many as levels [groups].

    With g groups, the value of a group is g times the correlation minus g - 1 times the correlation without the group
    (Tukey 1958). The variance of their mean estimates that of the correlation over samples of levels.
    """
    groups = np.arange(len(values)) % min(20, len(values))
    whole, number = rank_correlation(values, others), groups.max() + 1
    kept = (groups != group for group in range(number))
    return np.array(
        [number * whole - (number - 1) * rank_correlation(values[one], others[one]) for one in kept]
    )


@dataclass(frozen=True, slots=True)
class Ranking:
    """What a score makes of levels beside what is exact.

    Attributes:
        regret: rank correlation with exact regret over all levels; unsolvable ones have none, and make much of it.
        regret_solvable: over solvable levels alone.
        learnability, success: rank correlation with these, over all levels.
        unsolvable, mastered, hopeless: shares of the highest tenth; hopeless are solvable ones.
        capture: mean exact regret of the highest tenth, divided by that of the tenth with the highest regret.
        repeat: rank correlation with a second estimate by other episodes, over all levels; its root is the greatest
            correlation with anything that noise allows (Spearman 1904).
    """

    regret: float
    regret_solvable: float
    learnability: float
    success: float
    unsolvable: float
    mastered: float
    hopeless: float
    capture: float
    repeat: float


def ranking(
    scores: Floats, again: Floats, regret: Floats, success: Floats, solvable: NDArray[np.bool_]
) -> Ranking:
    """Compare a score, estimated twice, with what is exact.

    Args:
        scores, again: of each level.
        regret, success: exact, of each level.
        solvable: whether a level is.
    """
    count = max(1, round(TOP * len(scores)))
    top = np.argsort(-scores, kind="stable")[:count]
    most = np.sort(regret)[-count:].mean()
    here = solvable[top]
    return Ranking(
        regret=rank_correlation(scores, regret),
        regret_solvable=rank_correlation(scores[solvable], regret[solvable]),
        learnability=rank_correlation(scores, success * (1.0 - success)),
        success=rank_correlation(scores, success),
        unsolvable=float(1.0 - here.mean()),
        mastered=float((success[top] > MASTERED).mean()),
        hopeless=float((here & (success[top] < HOPELESS)).mean()),
        capture=float(regret[top].mean() / most) if most > 0 else 0.0,
        repeat=rank_correlation(scores, again),
    )
