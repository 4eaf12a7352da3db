"""Sample outcomes so that one uniform random number determines all random choices of a step or reset.

A behaviour makes its random choices one after the other (a branch, a match, another branch ...). One number u in
[0, 1) is enough: each choice divides the unit interval by the probabilities, takes the part that contains u, and
rescales u within this part for the next choice. Therefore a table, whose outcomes are listed in the order of the
choices, and the live engine, which makes the choices, reach the same state for the same u.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray


class Draw:
    """A uniform random number in [0, 1) that decides several choices one after the other; `rest` decides the next ones.

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
        """Return the position of a sampled alternative; with the probability that is missing to 1, return None."""
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
        """Return the position of one of `count` >= 1 alternatives, sampled uniformly."""
        scaled = self.rest * count
        position = min(int(scaled), count - 1)
        self.rest = min(scaled - position, _BELOW_ONE)
        return position


_BELOW_ONE = 1.0 - 2.0**-53
"""Largest float below 1, as in compiled programs: with another, both draw different outcomes."""


def _within(offset: float, width: float) -> float:
    return min(max(offset / width, 0.0), _BELOW_ONE)


def lacking(probabilities: Sequence[float]) -> float:
    """Return 1 minus the probabilities, added in order as `Draw` does; `sum` rounds differently in some Pythons."""
    total = 0.0
    for probability in probabilities:
        total += probability
    return 1.0 - total


class Recorded:
    """Choices that follow a script, and take the first alternative after its end.

    Attributes:
        places: for each choice, the number of the alternative taken, among those with positive probability.
        counts: the number of alternatives of each choice.
        probability: the probability of all choices together.
    """

    def __init__(self, script: Sequence[int]) -> None:
        self._script = script
        self.places: list[int] = []
        self.counts: list[int] = []
        self.probability = 1.0

    def choose(self, probabilities: Sequence[float]) -> int | None:
        """Take the scripted alternative among those of positive probability, and return its position.

        If the probabilities sum to less than 1, None is the last alternative.
        """
        possible: list[tuple[int | None, float]] = [(i, p) for i, p in enumerate(probabilities) if p > 0.0]
        missing = lacking(probabilities)
        if missing > 1e-12:
            possible.append((None, missing))
        position, probability = possible[self._take(len(possible))]
        self.probability *= probability
        return position

    def pick(self, count: int) -> int:
        """Take the scripted one of `count` equally likely alternatives, and return its position."""
        self.probability /= count
        return self._take(count)

    def _take(self, count: int) -> int:
        number = len(self.places)
        self.places.append(self._script[number] if number < len(self._script) else 0)
        self.counts.append(count)
        return self.places[-1]


def all_choices() -> Iterator[Recorded]:
    """Yield every possible sequence of choices, in lexicographic order.

    Use each for a step before requesting the next, because the step determines which choices exist.
    """
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
    """Return cumulative sums along the last axis, for `searchsorted(.., u, "right")`.

    From the last possible outcome on, the sum is exactly 1, so that rounding never selects an impossible outcome.
    """
    sums = np.cumsum(probability, axis=-1)
    possible = np.cumsum(probability[..., ::-1] > 0.0, axis=-1)[..., ::-1] > 0
    later = np.concatenate([possible[..., 1:], np.zeros_like(possible[..., :1])], axis=-1)
    sums[~later] = 1.0
    return sums
