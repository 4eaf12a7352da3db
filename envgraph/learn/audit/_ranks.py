"""Evaluate how scores rank levels: rank correlations with exact values, and properties of the highest-ranked levels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from envgraph.code import dataclass
from envgraph.learn.audit._audit_settings import PROTOCOL

Floats = NDArray[np.float64]

MASTERED, HOPELESS = 0.95, 0.05
"""A level is mastered if the policy's success rate is above the first, and hopeless if it is below the second."""


def midranks(values: Floats) -> Floats:
    """Return the rank of each value from 1; equal values share the mean of their ranks.

    >>> midranks(np.array([3.0, 1.0, 3.0])).tolist()
    [2.5, 1.0, 2.5]
    """
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(count)
    return np.asarray((last - (count - 1) / 2.0)[place])


def rank_correlation(values: Floats, others: Floats) -> float:
    """Return Spearman's correlation of midranks (Spearman 1904); 0 if all values of one side are equal.

    >>> rank_correlation(np.array([1.0, 2.0, 3.0]), np.array([1.0, 4.0, 9.0]))
    1.0
    """
    first, second = midranks(values), midranks(others)
    first, second = first - first.mean(), second - second.mean()
    norm = float(np.sqrt((first @ first) * (second @ second)))
    return round(float(first @ second) / norm, 12) if norm > 0 else 0.0


def jackknife_values(values: Floats, exact_values: Floats) -> Floats:
    """Return jackknife pseudo-values of a rank correlation over at most 20 groups of levels [groups].

    With g groups, the value of a group is g times the correlation minus g - 1 times the correlation without the group
    (Tukey 1958). The variance of their mean estimates that of the correlation over samples of levels.
    """
    groups = np.arange(len(values)) % min(20, len(values))
    whole, number = rank_correlation(values, exact_values), groups.max() + 1
    kept = (groups != group for group in range(number))
    return np.array([number * whole - (number - 1) * rank_correlation(values[one], exact_values[one]) for one in kept])


@dataclass(frozen=True, slots=True)
class Ranking:
    """A comparison of how a score ranks levels with exact values.

    Attributes:
        regret: rank correlation with exact regret over all levels; influenced by unsolvable levels, whose regret is 0.
        regret_solvable: rank correlation with exact regret over solvable levels.
        learnability, success: rank correlation with the exact values, over all levels.
        unsolvable, mastered, hopeless: shares of the highest-ranked tenth of levels; hopeless levels are solvable.
        capture: mean exact regret of the tenth with the highest score, divided by that with the highest regret.
        repeat: rank correlation with a second estimate from other episodes, over all levels; its square root is the
            greatest correlation with anything that noise allows (Spearman 1904).
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


def rank_levels(
    scores: Floats, second_scores: Floats, regret: Floats, success: Floats, solvable: NDArray[np.bool_]
) -> Ranking:
    """Compare how a score, estimated twice, and exact values rank levels.

    Args:
        scores, second_scores: the two estimates of the score of each level.
        regret, success: the exact regret and success of each level.
        solvable: True for solvable levels.
    """
    count = max(1, round(PROTOCOL.top * len(scores)))
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
        repeat=rank_correlation(scores, second_scores),
    )
