"""Who is played next: schedules of the members of a family, or of thousands of levels, behind one protocol.

A `Schedule` is asked for members and told what came of them. `InOrder` is a curriculum, `Shuffled` domain
randomisation, `Replay` prioritised level replay, `Sifter` sampling for learnability, and `Weighted` goes by what is
known of each member: learning progress, a band of success, learnability. The vector environments, `envgraph train` and
`envgraph audit` use the same ones.

>>> import numpy as np
>>> from envgraph.env.schedules import Outcomes, named_schedule
>>> schedule, rng = named_schedule("learnability", 3), np.random.default_rng(0)
>>> members = schedule.ask(3, rng).members
>>> schedule.tell(Outcomes(members, success=np.where(members == 1, 0.5, 1.0), returns=np.zeros(3), length=np.ones(3)))
>>> np.bincount(schedule.ask(1000, rng).members).argmax()
np.int64(1)
"""

from envgraph.env.schedules._named import SCHEDULES, named_schedule
from envgraph.env.schedules._order import InOrder, Shuffled
from envgraph.env.schedules._protocol import Batch, Outcomes, Schedule
from envgraph.env.schedules._replay import BestSeen, Buffer, Edit, Kept, Replay
from envgraph.env.schedules._seats import Seats
from envgraph.env.schedules._sifting import Sifter, Sifting
from envgraph.env.schedules._weighted import Band, Known, Weighted, learnability, learning_progress
from envgraph.errors import shorten

__all__ = [
    "SCHEDULES",
    "Band",
    "Batch",
    "BestSeen",
    "Buffer",
    "Edit",
    "InOrder",
    "Kept",
    "Known",
    "Outcomes",
    "Replay",
    "Schedule",
    "Seats",
    "Shuffled",
    "Sifter",
    "Sifting",
    "Weighted",
    "learnability",
    "learning_progress",
    "named_schedule",
]

shorten(globals(), __all__)
