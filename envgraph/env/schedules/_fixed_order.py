"""Schedules that ignore outcomes: one member after the other, and all members in random order."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.random import Generator

from envgraph.env.schedules._protocol import Batch, Ints, Outcomes
from envgraph.errors import InvalidArgument


class InOrder:
    """A curriculum: member 0 for a number of steps, then member 1 and so on; then the last member for ever.

    Args:
        steps: the number of steps for each member, counted from the outcomes passed to `tell`.
    """

    def __init__(self, steps: Sequence[int]) -> None:
        if not steps or min(steps) < 1:
            raise InvalidArgument("`steps` must have a positive number of steps for each member")
        self._ends = np.cumsum(steps)
        self._done = 0

    def ask(self, count: int, rng: Generator) -> Batch:
        """Return the current member, `count` times."""
        place = min(int(np.searchsorted(self._ends, self._done, "right")), len(self._ends) - 1)
        return Batch(np.full(count, place, np.int64))

    def tell(self, outcomes: Outcomes) -> None:
        """Count the steps of the outcomes."""
        self._done += int(outcomes.length.sum())


class Shuffled:
    """Domain randomisation (Tobin et al. 2017): members in random order, all of them before any is repeated.

    Args:
        members: the numbers of the members.
    """

    def __init__(self, members: Ints) -> None:
        if not len(members):
            raise InvalidArgument("`members` is empty, but a schedule needs at least one member")
        self.members = members
        self._order: Ints = np.zeros(0, np.int64)

    def ask(self, count: int, rng: Generator) -> Batch:
        """Return the next members of the random order."""
        return Batch(self.next_members(count, rng))

    def tell(self, outcomes: Outcomes) -> None:
        """Do nothing: the order does not depend on outcomes."""

    def next_members(self, count: int, rng: Generator) -> Ints:
        """Remove the next `count` members from the random order, and return their numbers."""
        while len(self._order) < count:
            self._order = np.concatenate([self._order, rng.permutation(self.members)])
        found, self._order = self._order[:count], self._order[count:]
        return found
