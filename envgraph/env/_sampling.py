"""Drawing outcomes: one uniform number decides everything that is random in a step, or in a reset.

A behaviour makes its random choices one after the other (a branch, a match, another branch ...). One number u in
[0, 1) is enough for all of them: choice i takes the stretch of the unit interval that its probability gives it, and
u, measured within that stretch, decides the next choice. So a table whose outcomes are listed in the order of the
choices, and the live engine that makes the choices themselves, do the same for the same u.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

MOST_OUTCOMES = 10_000
"""Of one action in one state, equal ones included: some seconds. Units that make many choices have millions."""


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


class Recorded:
    """Choices made by a script: the first ones given, the others the first alternative.

    Attributes:
        places: number of the alternative taken at each choice, among those that are possible.
        counts: how many alternatives each choice had.
        probability: of all the choices together.
    """

    def __init__(self, script: Sequence[int]) -> None:
        self._script = script
        self.places: list[int] = []
        self.counts: list[int] = []
        self.probability = 1.0

    def choose(self, probabilities: Sequence[float]) -> int | None:
        """See `Choices`."""
        possible: list[tuple[int | None, float]] = [(i, p) for i, p in enumerate(probabilities) if p > 0.0]
        missing = lacking(probabilities)
        if missing > 1e-12:
            possible.append((None, missing))
        position, probability = possible[self._take(len(possible))]
        self.probability *= probability
        return position

    def pick(self, count: int) -> int:
        """See `Choices`."""
        self.probability /= count
        return self._take(count)

    def _take(self, count: int) -> int:
        number = len(self.places)
        self.places.append(self._script[number] if number < len(self._script) else 0)
        self.counts.append(count)
        return self.places[-1]


def all_choices() -> Iterator[Recorded]:
    """Every way to make the choices, in lexicographic order; each must be used before the next is asked for."""
    script: list[int] = []
    while True:
        choices = Recorded(script)
        yield choices
        script = choices.places
        while script and script[-1] + 1 == choices.counts[len(script) - 1]:
            script.pop()
        if not script:
            return
        script[-1] += 1


def cumulative(probability: NDArray[np.float64]) -> NDArray[np.float64]:
    """Running sums along the last axis, such that `searchsorted(.., u, "right")` never finds an impossible outcome.

    From the last possible outcome on the sum is exactly 1, whatever the rounding.
    """
    sums = np.cumsum(probability, axis=-1)
    possible = np.cumsum(probability[..., ::-1] > 0.0, axis=-1)[..., ::-1] > 0
    later = np.concatenate([possible[..., 1:], np.zeros_like(possible[..., :1])], axis=-1)
    sums[~later] = 1.0
    return sums
