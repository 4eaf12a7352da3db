"""The protocol of schedules: what `ask` returns, and what `tell` accepts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from envgraph.code import dataclass

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Members to play next.

    Attributes:
        members: int64, their numbers; may contain a number twice.
        learn: True to learn on them; False to play them only to score them.
        episodes: number of episodes that the schedule wants of each; None for any number.
    """

    members: Ints
    learn: bool = True
    episodes: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Outcomes:
    """The outcomes of playing members: arrays with an entry for each member that was played.

    Attributes:
        members: int64, their numbers, as in `Batch`.
        success: float64, share of its episodes that ended in success.
        returns: float64, mean return of its episodes.
        length: int64, steps that were played.
        score: float64, how useful learning on it is, computed by a caller that knows the student. If None, a schedule
            computes a score itself.
    """

    members: Ints
    success: Floats
    returns: Floats
    length: Ints
    score: Floats | None = None


Score = Callable[[Outcomes], Floats]
"""A function that computes a score for each member that was played; higher means more useful to learn on."""


@runtime_checkable
class Schedule(Protocol):
    """A strategy that chooses members, and may adapt to the outcomes of playing them.

    `ask` and `tell` may be called in any order, and `tell` may be called rarely or never: several members may be asked
    for before the first outcome is known. All randomness comes from the generator that `ask` is given.
    """

    def ask(self, count: int, rng: Generator) -> Batch:
        """Return `count` members to play next."""

    def tell(self, outcomes: Outcomes) -> None:
        """Update the schedule with the outcomes of members that it has chosen."""
