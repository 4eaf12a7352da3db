"""Random choices made in every way, one run after the other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar


class Branches:
    """Stands in for a random generator; a run that is repeated while `advance` is true meets every choice.

    The choices of a run depend on those before them, and on nothing else that changes between runs.

    >>> branches, found = Branches(), []
    >>> while branches.advance():
    ...     first = branches.choose(2)
    ...     found.append((first, branches.choose(3) if first else None))
    >>> found
    [(0, None), (1, 0), (1, 1), (1, 2)]

    Attributes:
        ordered: whether units take matches in the order of what these stand for; else in that of the matcher, which may
            depend on how a state was reached.
    """

    ordered: ClassVar[bool] = False

    def __init__(self) -> None:
        self._chosen: list[int] = []
        self._counts: list[int] = []
        self._place = -1

    def advance(self) -> bool:
        """Begin the next run; False if there is none: the last choice that can be made otherwise is."""
        if self._place >= 0:
            while self._chosen and self._chosen[-1] + 1 == self._counts[-1]:
                self._chosen.pop()
                self._counts.pop()
            if not self._chosen:
                return False
            self._chosen[-1] += 1
        self._place = 0
        return True

    def choose(self, count: int) -> int:
        """One of `count` numbers from 0."""
        if self._place == len(self._chosen):
            self._chosen.append(0)
            self._counts.append(count)
        self._place += 1
        return self._chosen[self._place - 1]

    def weigh(self, weights: Sequence[float]) -> int:
        """One of several numbers from 0, by weight; here whatever the weights, as everything that can happen does."""
        return self.choose(len(weights))

    def random(self) -> float:
        """Where only chance decides, as in functions of the user: always the same.

        Rules and units choose among a number of things, and ask `choose`.
        """
        return 0.0
