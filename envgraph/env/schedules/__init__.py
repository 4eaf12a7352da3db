"""Schedules: they choose the members of a family, or of thousands of levels, that a student plays next.

A `Schedule` returns members by `ask` and gets outcomes by `tell`. `InOrder` is a curriculum, `Shuffled` domain
randomisation, `Replay` prioritised level replay, `Sifter` sampling for learnability. `Weighted` samples by statistics
of each member: learning progress, a band of success rates, learnability. The vector environments, `envgraph train` and
`envgraph audit` use the same schedules.

>>> import numpy as np
>>> from envgraph.env.schedules import Outcomes, named_schedule
>>> schedule, rng = named_schedule("learnability", 3), np.random.default_rng(0)
>>> members = schedule.ask(3, rng).members
>>> schedule.tell(Outcomes(members, success=np.where(members == 1, 0.5, 1.0), returns=np.zeros(3), length=np.ones(3)))
>>> np.bincount(schedule.ask(1000, rng).members).argmax()
np.int64(1)
"""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.env.schedules._autoreset import MemberAssignment as MemberAssignment
    from envgraph.env.schedules._fixed_order import InOrder as InOrder, Shuffled as Shuffled
    from envgraph.env.schedules._learnability import Sifter as Sifter, Sifting as Sifting
    from envgraph.env.schedules._level_replay import (
        Buffer as Buffer,
        Edit as Edit,
        Replay as Replay,
        ReplayBuffer as ReplayBuffer,
    )
    from envgraph.env.schedules._named import SCHEDULES as SCHEDULES, named_schedule as named_schedule
    from envgraph.env.schedules._protocol import Batch as Batch, Outcomes as Outcomes, Schedule as Schedule
    from envgraph.env.schedules._weighted import (
        Band as Band,
        Weighted as Weighted,
        learnability as learnability,
        learning_progress as learning_progress,
    )

export_lazily(globals())
