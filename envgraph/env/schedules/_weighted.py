"""Schedules that sample members by weights, computed from the student's success rate on each member and its change."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.random import Generator

from envgraph.code import dataclass
from envgraph.env.schedules._protocol import Batch, Floats, Ints, Outcomes
from envgraph.errors import InvalidArgument

FAST_RATE: Final = 0.2
SLOW_RATE: Final = 0.05
"""FAST and SLOW are the weights of the last outcome in the two averages of success."""


class SuccessRates:
    """The success rates of members as two running averages, which begin with the first outcome.

    Attributes:
        fast, slow: float64 [members], averages with a high and with a low weight of the last outcome.
    """

    def __init__(self, count: int) -> None:
        self.fast, self.slow = np.zeros(count), np.zeros(count)
        self._has_outcome = np.zeros(count, np.bool_)

    def tell(self, outcomes: Outcomes) -> None:
        """Update both averages of each member that was played with its share of successes."""
        for member, success in zip(outcomes.members.tolist(), outcomes.success.tolist(), strict=True):
            for average, rate in ((self.fast, FAST_RATE), (self.slow, SLOW_RATE)):
                average[member] += (rate if self._has_outcome[member] else 1.0) * (success - average[member])
            self._has_outcome[member] = True


Weight = Callable[[SuccessRates], Floats]
"""A function that computes for each member a weight, to which its probability is proportional."""


def learning_progress(known: SuccessRates) -> Floats:
    """Return how much the success rate of each member changes, up or down (Oudeyer et al. 2007, Matiisen et al. 2017).

    It is the distance of a fast and a slow average (Kanitscheider et al. 2021).
    """
    return np.asarray(np.abs(known.fast - known.slow))


def learnability(known: SuccessRates) -> Floats:
    """Return p (1 - p) of the running success rate p (Tzannetos et al. 2023, Rutherford et al. 2024)."""
    return known.fast * (1.0 - known.fast)


@dataclass(frozen=True, slots=True)
class Band:
    """A weight that is equal for members with a success rate in a band, and 0 for others.

    If no success rate is in the band, only the members nearest to it have a weight. This is the zone of proximal
    development; compare the goals of intermediate difficulty of Florensa et al. (2018).

    Attributes:
        low, high: the limits of the band.
    """

    low: float = 0.1
    high: float = 0.9

    def __call__(self, known: SuccessRates) -> Floats:
        """Return 1 for members in or nearest to the band, 0 for others."""
        away = np.maximum(0.0, np.maximum(self.low - known.fast, known.fast - self.high))
        return np.asarray(away == away.min(), np.float64)


class Weighted:
    """A schedule that samples members in proportion to a weight, after playing each member once.

    Args:
        count: number of members.
        weight: computes the weights from the success rates.
        uniform: share of the probability that is the same for all members.
    """

    def __init__(self, count: int, weight: Weight, uniform: float = 0.2) -> None:
        if count < 1 or not 0.0 <= uniform <= 1.0:
            raise InvalidArgument("`count` must be at least 1, and `uniform` from 0 to 1")
        self._count, self._weight, self._uniform = count, weight, uniform
        self._known = SuccessRates(count)
        self._first: Ints | None = None

    def ask(self, count: int, rng: Generator) -> Batch:
        """Return members that were never returned before, then members sampled by weight."""
        if self._first is None:
            self._first = rng.permutation(self._count)
        first, self._first = self._first[:count], self._first[count:]
        drawn = rng.choice(self._count, count - len(first), p=self.probabilities())
        return Batch(np.concatenate([first, drawn]))

    def tell(self, outcomes: Outcomes) -> None:
        """Update the running success rates of the members."""
        self._known.tell(outcomes)

    def probabilities(self) -> Floats:
        """Return the sampling probability of each member: its share of the weights, mixed with a uniform part."""
        weights = self._weight(self._known)
        total = weights.sum()
        share = weights / total if total > 0.0 else np.full(self._count, 1.0 / self._count)
        return np.asarray((1.0 - self._uniform) * share + self._uniform / self._count)
