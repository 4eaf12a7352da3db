"""Settings of a curriculum search."""

from __future__ import annotations

from typing import Literal

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument

BeginKind = Literal["auto", "easing", "episode"]
"""Source of the members of the first families: the eased target, an optimal episode, or both ("auto")."""


@dataclass(frozen=True, slots=True)
class CurriculumSettings:
    """The settings of a curriculum search.

    Attributes:
        population: number of members with the target, at least 2. None: the number found for the reverse curriculum if
            one is tried, else 6.
        effort: budget of the search, in training steps. Each table that is made counts as 50,000 steps. Judging a
            family counts as at least 50,000 steps.
        lanes: number of families that are improved independently; after each round the better half continues.
        enough: value at which the search ends. None: the largest possible value of the objective.
        least_diversity: the least diversity of a family; infinity: the largest possible diversity; or None.
        begin: the source of the members of the first families, see `Starts`.
    """

    population: int | None
    effort: int
    lanes: int = 4
    enough: float | None = None
    least_diversity: float | None = None
    begin: BeginKind = "auto"

    def __post_init__(self) -> None:
        if (self.population or 2) < 2 or self.effort < 1 or self.lanes < 1:
            raise InvalidArgument(
                f"`population`, `effort` and `lanes` are {self.population}, {self.effort} and {self.lanes}, "
                "but must be at least 2, 1 and 1"
            )
