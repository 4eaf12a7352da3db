"""Create schedules by the names that `make_vec` and `envgraph train` accept."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from envgraph.env.schedules._fixed_order import Shuffled
from envgraph.env.schedules._learnability import Sifter
from envgraph.env.schedules._level_replay import Buffer, Replay
from envgraph.env.schedules._protocol import Schedule
from envgraph.env.schedules._weighted import Band, Weighted, learnability, learning_progress
from envgraph.errors import check_known

SCHEDULES: Final[dict[str, Callable[[int], Schedule]]] = {
    "uniform": lambda count: Shuffled(np.arange(count)),
    "learning_progress": lambda count: Weighted(count, learning_progress),
    "band": lambda count: Weighted(count, Band()),
    "learnability": lambda count: Weighted(count, learnability),
    "plr": lambda count: Replay(np.arange(count)),
    "robust_plr": lambda count: Replay(np.arange(count), Buffer(fresh_learned=False)),
    "sfl": lambda count: Sifter(np.arange(count)),
}
"""For each name, a function that creates the schedule for a number of members."""


def named_schedule(name: str, count: int) -> Schedule:
    """Return a new schedule of `count` members, with its default settings.

    Raises:
        InvalidArgument: no schedule has this name.
    """
    check_known(name, SCHEDULES, f"unknown schedule `{name}`")
    return SCHEDULES[name](count)
