"""What schedules are asked, and what they are told."""

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
        members: int64, their numbers; one may stand twice.
        learn: whether to learn on them; else they are played to be scored alone.
        episodes: how many episodes of each the schedule wants; None: as many as whoever plays them likes.
    """

    members: Ints
    learn: bool = True
    episodes: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Outcomes:
    """What came of playing members; arrays with an entry for each that was played.

    Attributes:
        member: int64, which one.
        success: float64, share of its episodes that ended in success.
        returns: float64, mean sum of rewards of its episodes.
        length: int64, steps that were played.
        score: float64, how much worth learning on each is, of somebody who knows the student; None: then a schedule
            goes by a score of its own.
    """

    member: Ints
    success: Floats
    returns: Floats
    length: Ints
    score: Floats | None = None


Score = Callable[[Outcomes], Floats]
"""What members that were played are worth; the higher, the more there is to be learned on them."""


@runtime_checkable
class Schedule(Protocol):
    """Chooses members, and learns from what comes of them.

    It is asked and told in any order, and told as often as it likes to be or not at all: several members may be asked
    for before anything is known of the first. All that it draws comes from the generator that it is given.
    """

    def ask(self, count: int, rng: Generator) -> Batch:
        """So many members to play next."""

    def tell(self, outcomes: Outcomes) -> None:
        """What came of members that were asked for."""
