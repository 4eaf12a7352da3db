"""The members that the environments of a vector are over, one after the other, as a schedule says."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator, default_rng
from numpy.typing import NDArray

from envgraph.env.schedules._protocol import Floats, Ints, Outcomes, Schedule
from envgraph.errors import InvalidArgument

Bools = NDArray[np.bool_]


class Seats:
    """Asks a schedule for a member whenever an episode begins, and tells it of each that ends.

    Args:
        schedule: is asked and told.
        count: how many environments there are.
        members: how many members there are.

    Attributes:
        member: int64 [count], the member of each environment.
        learn: bool [count], whether the schedule gives it to be learned on.
    """

    def __init__(self, schedule: object, count: int, members: int) -> None:
        if not isinstance(schedule, Schedule):
            hint = "a schedule has `ask` and `tell`; `envgraph.env.schedules.named_schedule` makes those with names"
            raise InvalidArgument(f"{schedule!r} is no schedule", hint)
        self.schedule, self._members = schedule, members
        self.member = np.zeros(count, np.int64)
        self.learn = np.ones(count, np.bool_)
        self._returns = np.zeros(count)
        self._rng = default_rng()

    def seed(self, rng: Generator) -> None:
        """Draw from now on from this generator."""
        self._rng = rng

    def begin(self, mask: Bools) -> None:
        """Episodes begin in the environments of a mask."""
        places = np.flatnonzero(mask)
        if not len(places):
            return
        batch = self.schedule.ask(len(places), self._rng)
        members: Ints = np.asarray(batch.members)
        if members.shape != places.shape or not ((members >= 0) & (members < self._members)).all():
            raise InvalidArgument(
                f"the schedule gave {members.tolist()} when asked for {len(places)} of {self._members} members"
            )
        self.member[places], self.learn[places], self._returns[places] = members, batch.learn, 0.0

    def step(self, reward: Floats, over: Bools, success: Bools, steps: Ints) -> None:
        """What a step of all environments brought; those that are over are told of."""
        self._returns += reward
        ended = np.flatnonzero(over)
        if len(ended):
            self.schedule.tell(
                Outcomes(
                    self.member[ended], success[ended].astype(np.float64), self._returns[ended], steps[ended]
                )
            )
