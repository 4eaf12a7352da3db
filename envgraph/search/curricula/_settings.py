"""Define the settings of the search for a whole family."""

from __future__ import annotations

from typing import Literal

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument

Begin = Literal["auto", "easing", "episode"]
"""Names what members of first families are made from: the eased target, an optimal episode, or both ("auto")."""


@dataclass(frozen=True, slots=True)
class CurriculumSettings:
    """Hold the settings of the search for a whole family.

    Attributes:
        population: members of a family, the target included; at least 2. None: the search chooses if it tries a reverse
            curriculum, else 6.
        effort: how long: steps that learners make, where a table that is made counts as 50,000, and so does what an
            objective that needs fewer makes of some seeds.
        lanes: families that are improved side by side, until the better half of them goes on.
        enough: the search ends at this value; None: at the most that the objective can be.
        demanded: the least diversity of a family; infinity: the largest there is; or None.
        begin: what the members of the first families are made from, see `Starts`.
    """

    population: int | None
    effort: int
    lanes: int = 4
    enough: float | None = None
    demanded: float | None = None
    begin: Begin = "auto"

    def __post_init__(self) -> None:
        if (self.population or 2) < 2 or self.effort < 1 or self.lanes < 1:
            raise InvalidArgument("a search needs two members, a lane, and some effort")
