"""Enumeration of all random choices of a program by running it again and again."""

from __future__ import annotations

from collections.abc import Sequence


class Branches:
    """A replacement for a random generator that enumerates all choices: make a run each time `advance` returns True.

    The choices of a run may depend only on the earlier choices of that run, not on anything that changes between runs.

    >>> branches, found = Branches(), []
    >>> while branches.advance():
    ...     first = branches.choose(2)
    ...     found.append((first, branches.choose(3) if first else None))
    >>> found
    [(0, None), (1, 0), (1, 1), (1, 2)]

    Units take matches in the order of their objects and values, because the order of a matcher may depend on how a
    state was reached.
    """

    def __init__(self) -> None:
        self._chosen: list[int] = []
        self._counts: list[int] = []
        self._position = -1

    def advance(self) -> bool:
        """Start the next run and return True. Return False if every combination of choices has been run."""
        if self._position >= 0:
            while self._chosen and self._chosen[-1] + 1 == self._counts[-1]:
                self._chosen.pop()
                self._counts.pop()
            if not self._chosen:
                return False
            self._chosen[-1] += 1
        self._position = 0
        return True

    def choose(self, count: int) -> int:
        """Return the choice of this run, a number from 0 to `count` - 1. Later runs return the other numbers."""
        if self._position == len(self._chosen):
            self._chosen.append(0)
            self._counts.append(count)
        self._position += 1
        return self._chosen[self._position - 1]

    def weigh(self, weights: Sequence[float]) -> int:
        """Return the choice of this run, an index into `weights`. The runs try every index, whatever its weight."""
        return self.choose(len(weights))

    def random(self) -> float:
        """Return 0.0 always, because functions of the user that ask for a random float are not enumerated.

        Rules and units choose one of a finite number of options and therefore call `choose`.
        """
        return 0.0
