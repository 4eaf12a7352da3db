"""Schedules that nothing is told: one member after the other, and all of them at random."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.random import Generator

from envgraph.env.schedules._protocol import Batch, Ints, Outcomes
from envgraph.errors import InvalidArgument


class InOrder:
    """A curriculum: member 0 for a number of steps, then member 1 and so on; the last one from then on.

    Args:
        steps: of each member; counted are those of the episodes that it is told of.
    """

    def __init__(self, steps: Sequence[int]) -> None:
        if not steps or min(steps) < 1:
            raise InvalidArgument("an order needs a positive number of steps for each member")
        self._ends = np.cumsum(steps)
        self._done = 0

    def ask(self, count: int, rng: Generator) -> Batch:
        """The member whose turn it is."""
        place = min(int(np.searchsorted(self._ends, self._done, "right")), len(self._ends) - 1)
        return Batch(np.full(count, place, np.int64))

    def tell(self, outcomes: Outcomes) -> None:
        """Steps go by."""
        self._done += int(outcomes.length.sum())


class Shuffled:
    """Domain randomisation (Tobin et al. 2017): members in random order, each once before one comes again.

    Args:
        members: their numbers.
    """

    def __init__(self, members: Ints) -> None:
        if not len(members):
            raise InvalidArgument("a schedule needs a member")
        self.members = members
        self._order: Ints = np.zeros(0, np.int64)

    def ask(self, count: int, rng: Generator) -> Batch:
        """The next ones of the order."""
        return Batch(self.draw(count, rng))

    def tell(self, outcomes: Outcomes) -> None:
        """Nothing depends on it."""

    def draw(self, count: int, rng: Generator) -> Ints:
        """The numbers of the next members."""
        while len(self._order) < count:
            self._order = np.concatenate([self._order, rng.permutation(self.members)])
        found, self._order = self._order[:count], self._order[count:]
        return found
