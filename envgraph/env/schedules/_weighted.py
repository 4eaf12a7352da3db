"""Schedules that go by what is known of each member: how often the student succeeds there, and how that changes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.random import Generator

from envgraph.code import dataclass
from envgraph.env.schedules._protocol import Batch, Floats, Ints, Outcomes
from envgraph.errors import InvalidArgument

FAST: Final = 0.2
SLOW: Final = 0.05
"""Weights of the last outcome in the two averages of success."""


class Known:
    """What is known of members: two running averages of success, which begin with the first that is told.

    Attributes:
        fast, slow: float64 [members], the average that follows quickly, and the one that lags behind.
    """

    def __init__(self, count: int) -> None:
        self.fast, self.slow = np.zeros(count), np.zeros(count)
        self._told = np.zeros(count, np.bool_)

    def tell(self, outcomes: Outcomes) -> None:
        """Take in what came of members."""
        for member, success in zip(outcomes.member.tolist(), outcomes.success.tolist(), strict=True):
            for average, rate in ((self.fast, FAST), (self.slow, SLOW)):
                average[member] += (rate if self._told[member] else 1.0) * (success - average[member])
            self._told[member] = True


Weight = Callable[[Known], Floats]
"""What each member is drawn in proportion to."""


def learning_progress(known: Known) -> Floats:
    """How much success is changing, up or down (Oudeyer et al. 2007, Matiisen et al. 2017).

    Measured by a fast and a slow average (Kanitscheider et al. 2021).
    """
    return np.asarray(np.abs(known.fast - known.slow))


def learnability(known: Known) -> Floats:
    """p (1 - p), from the running average of success (Tzannetos et al. 2023, Rutherford et al. 2024)."""
    return known.fast * (1.0 - known.fast)


@dataclass(frozen=True, slots=True)
class Band:
    """Members whose success lies in a band, all alike; those nearest to it where there are none.

    The zone of proximal development, as Florensa et al. (2018) have goals of intermediate difficulty.

    Attributes:
        low, high: the band.
    """

    low: float = 0.1
    high: float = 0.9

    def __call__(self, known: Known) -> Floats:
        """1 for those members, 0 for others."""
        away = np.maximum(0.0, np.maximum(self.low - known.fast, known.fast - self.high))
        return np.asarray(away == away.min(), np.float64)


class Weighted:
    """Draws members in proportion to a weight, but for a share that is drawn uniformly; first each of them once.

    Args:
        count: how many members there are.
        weight: of what is known of them.
        uniform: the share.
    """

    def __init__(self, count: int, weight: Weight, uniform: float = 0.2) -> None:
        if count < 1 or not 0.0 <= uniform <= 1.0:
            raise InvalidArgument("a schedule needs a member, and a share from 0 to 1")
        self._count, self._weight, self._uniform = count, weight, uniform
        self._known = Known(count)
        self._first: Ints | None = None

    def ask(self, count: int, rng: Generator) -> Batch:
        """Members that nothing is known of, then others by their weights."""
        if self._first is None:
            self._first = rng.permutation(self._count)
        first, self._first = self._first[:count], self._first[count:]
        drawn = rng.choice(self._count, count - len(first), p=self.chances())
        return Batch(np.concatenate([first, drawn]))

    def tell(self, outcomes: Outcomes) -> None:
        """What came of members."""
        self._known.tell(outcomes)

    def chances(self) -> Floats:
        """The probability of each member."""
        weights = self._weight(self._known)
        total = weights.sum()
        share = weights / total if total > 0.0 else np.full(self._count, 1.0 / self._count)
        return np.asarray((1.0 - self._uniform) * share + self._uniform / self._count)
