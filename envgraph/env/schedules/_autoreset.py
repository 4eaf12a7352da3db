"""Assign members, chosen by a schedule, to the environments of a vector environment."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator, default_rng
from numpy.typing import NDArray

from envgraph.env.schedules._protocol import Floats, Ints, Outcomes, Schedule
from envgraph.errors import InvalidArgument

Bools = NDArray[np.bool_]


class MemberAssignment:
    """The member of each environment of a vector environment, chosen by a schedule whenever an episode begins.

    Args:
        schedule: returns members, and gets the outcomes of episodes.
        count: number of environments.
        members: number of members.

    Attributes:
        member: int64 [count], the member of each environment.
        learn: bool [count], True if the schedule wants the student to learn on it.
    """

    def __init__(self, schedule: object, count: int, members: int) -> None:
        if not isinstance(schedule, Schedule):
            hint = "use an object with `ask` and `tell`, such as `envgraph.env.schedules.named_schedule` returns"
            raise InvalidArgument(f"`schedule` is {schedule!r}, which is not a schedule", hint)
        self.schedule, self._members = schedule, members
        self.member = np.zeros(count, np.int64)
        self.learn = np.ones(count, np.bool_)
        self._returns = np.zeros(count)
        self._rng = default_rng()

    def seed(self, rng: Generator) -> None:
        """Set the random generator from which the schedule samples from now on."""
        self._rng = rng

    def begin_episodes(self, mask: Bools) -> None:
        """Assign members that the schedule chooses to the environments in the mask, and set their returns to 0.

        Raise InvalidArgument if the schedule returns a wrong number of members or unknown ones.
        """
        places = np.flatnonzero(mask)
        if not len(places):
            return
        batch = self.schedule.ask(len(places), self._rng)
        members: Ints = np.asarray(batch.members)
        if members.shape != places.shape or not ((members >= 0) & (members < self._members)).all():
            raise InvalidArgument(
                f"the schedule returned {members.tolist()}, but must return {len(places)} numbers below {self._members}"
            )
        self.member[places], self.learn[places], self._returns[places] = members, batch.learn, 0.0

    def record_step(self, reward: Floats, is_over: Bools, success: Bools, steps: Ints) -> None:
        """Add up the rewards of a step, and pass the outcomes of episodes that are over to the schedule.

        `steps` has the number of steps of each episode.
        """
        self._returns += reward
        ended = np.flatnonzero(is_over)
        if len(ended):
            self.schedule.tell(
                Outcomes(self.member[ended], success[ended].astype(np.float64), self._returns[ended], steps[ended])
            )
