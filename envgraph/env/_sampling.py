"""Drawing outcomes: one uniform number decides everything that is random in a step, or in a reset.

A behaviour makes its random choices one after the other (a branch, a match, another branch ...). One number u in
[0, 1) is enough for all of them: choice i takes the stretch of the unit interval that its probability gives it, and
u, measured within that stretch, decides the next choice. So a table whose outcomes are listed in the order of the
choices, and the live engine that makes the choices themselves, do the same for the same u.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


class Draw:
    """The rest of one uniform number, used up choice by choice.

    >>> draw = Draw(0.65)
    >>> draw.choose([0.5, 0.5]), round(draw.rest, 12)
    (1, 0.3)
    >>> draw.pick(5)
    1
    """

    __slots__ = ("rest",)

    def __init__(self, uniform: float) -> None:
        self.rest = uniform

    def choose(self, probabilities: Sequence[float]) -> int | None:
        """One of the alternatives; None with the probability that is missing to 1."""
        start = 0.0
        for position, probability in enumerate(probabilities):
            if self.rest < start + probability:
                self.rest = _within(self.rest - start, probability)
                return position
            start += probability
        missing = 1.0 - start
        if missing > 1e-12:
            self.rest = _within(self.rest - start, missing)
            return None
        self.rest = 0.0  # rounding: the probabilities sum to a little less than 1
        return len(probabilities) - 1

    def pick(self, count: int) -> int:
        """One of `count` >= 1 alternatives, equally likely."""
        scaled = self.rest * count
        position = min(int(scaled), count - 1)
        self.rest = min(scaled - position, _BELOW_ONE)
        return position


_BELOW_ONE = 1.0 - 2.0**-53


def _within(offset: float, width: float) -> float:
    return min(max(offset / width, 0.0), _BELOW_ONE)


def lacking(probabilities: Sequence[float]) -> float:
    """1 less the probabilities, added up in their order as `Draw` does; `sum` rounds differently in some Pythons."""
    total = 0.0
    for probability in probabilities:
        total += probability
    return 1.0 - total


def cumulative(probability: NDArray[np.float64]) -> NDArray[np.float64]:
    """Running sums along the last axis, such that `searchsorted(.., u, "right")` never finds an impossible outcome.

    From the last possible outcome on the sum is exactly 1, whatever the rounding.
    """
    sums = np.cumsum(probability, axis=-1)
    possible = np.cumsum(probability[..., ::-1] > 0.0, axis=-1)[..., ::-1] > 0
    later = np.concatenate([possible[..., 1:], np.zeros_like(possible[..., :1])], axis=-1)
    sums[~later] = 1.0
    return sums
