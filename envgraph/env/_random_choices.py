"""Sample outcomes so that one uniform random number determines all random choices of a step or reset.

A behaviour makes its random choices one after the other (a branch, a match, another branch ...). One number u in
[0, 1) is enough: each choice divides the unit interval by the probabilities, takes the part that contains u, and
rescales u within this part for the next choice. Therefore a table, whose outcomes are listed in the order of the
choices, and the live engine, which makes the choices, reach the same state for the same u.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence


class UniformDraw:
    """A uniform random number in [0, 1) that decides several choices one after the other; `remainder` decides the next
    ones.

    >>> draw = UniformDraw(0.65)
    >>> draw.choose([0.5, 0.5]), round(draw.remainder, 12)
    (1, 0.3)
    >>> draw.pick(5)
    1
    """

    __slots__ = ("remainder",)

    def __init__(self, uniform: float) -> None:
        self.remainder = uniform

    def choose(self, probabilities: Sequence[float]) -> int | None:
        """Return the position of a sampled alternative; with the probability that is missing to 1, return None."""
        start = 0.0
        for position, probability in enumerate(probabilities):
            if self.remainder < start + probability:
                self.remainder = _rescale(self.remainder - start, probability)
                return position
            start += probability
        missing = 1.0 - start
        if missing > 1e-12:
            self.remainder = _rescale(self.remainder - start, missing)
            return None
        self.remainder = 0.0  # rounding: the probabilities sum to a little less than 1
        return len(probabilities) - 1

    def pick(self, count: int) -> int:
        """Return the position of one of `count` >= 1 alternatives, sampled uniformly."""
        scaled = self.remainder * count
        position = min(int(scaled), count - 1)
        self.remainder = min(scaled - position, _MAX_UNIFORM)
        return position


_MAX_UNIFORM = 1.0 - 2.0**-53
"""Largest float below 1, as in compiled programs: with another, both draw different outcomes."""


def _rescale(offset: float, width: float) -> float:
    return min(max(offset / width, 0.0), _MAX_UNIFORM)


def missing_probability(probabilities: Sequence[float]) -> float:
    """Return 1 minus the probabilities, added in order as `UniformDraw` does; `sum` rounds differently in some
    Pythons.
    """
    total = 0.0
    for probability in probabilities:
        total += probability
    return 1.0 - total


class ScriptedChoices:
    """Choices that follow a script, and take the first alternative after its end.

    Attributes:
        taken: for each choice, the number of the alternative taken, among those with positive probability.
        alternative_counts: the number of alternatives of each choice.
        probability: the probability of all choices together.
    """

    def __init__(self, script: Sequence[int]) -> None:
        self._script = script
        self.taken: list[int] = []
        self.alternative_counts: list[int] = []
        self.probability = 1.0

    def choose(self, probabilities: Sequence[float]) -> int | None:
        """Take the scripted alternative among those of positive probability, and return its position.

        If the probabilities sum to less than 1, None is the last alternative.
        """
        possible: list[tuple[int | None, float]] = [(i, p) for i, p in enumerate(probabilities) if p > 0.0]
        missing = missing_probability(probabilities)
        if missing > 1e-12:
            possible.append((None, missing))
        position, probability = possible[self._take_scripted(len(possible))]
        self.probability *= probability
        return position

    def pick(self, count: int) -> int:
        """Take the scripted one of `count` equally likely alternatives, and return its position."""
        self.probability /= count
        return self._take_scripted(count)

    def _take_scripted(self, count: int) -> int:
        number = len(self.taken)
        self.taken.append(self._script[number] if number < len(self._script) else 0)
        self.alternative_counts.append(count)
        return self.taken[-1]


def all_choice_sequences() -> Iterator[ScriptedChoices]:
    """Yield every possible sequence of choices, in lexicographic order.

    Use each for a step before requesting the next, because the step determines which choices exist.
    """
    script: list[int] = []
    while True:
        choices = ScriptedChoices(script)
        yield choices
        script = choices.taken
        while script and script[-1] + 1 == choices.alternative_counts[len(script) - 1]:
            script.pop()
        if not script:
            return
        script[-1] += 1
