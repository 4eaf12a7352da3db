"""Reverse curricula, whose members are states of an optimal episode: find the number of members and training steps."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Final

from envgraph.code import dataclass
from envgraph.search.curricula._family_moves import Family
from envgraph.search.curricula._first_families import FamilyOrigin, FirstFamilySampler
from envgraph.search.curricula._objectives import LearningObjective

GOOD_SUCCESS_RATE: Final = 0.98
"""A family is good if this share of learners succeeds. Then 95 of 100 others succeed with a probability of .99."""

FAMILY_SIZES: Final = (3, 4, 6, 9, 13, 19, 27, 38, 54)
"""Numbers of members to try if the family file has no `population`."""

TOTAL_STEPS: Final = tuple(round(300 * 1.25**step) for step in range(48))
"""Total numbers of training steps to try if the family file has no steps: from 300 to ten million."""

_SEED_COUNTS: Final = (8, 100, 500)
"""Numbers of seeds to judge a family: the next number is used only if the family is good with the previous one."""


@dataclass(frozen=True, slots=True)
class TrainedFamily:
    """A family, and the success rate of learners that were trained on it.

    Attributes:
        family: the members, the easiest first.
        objective: the learning objective with the number of steps per member.
        success: share of learners that solve the target.
        origin: the source of the members.
    """

    family: Family
    objective: LearningObjective
    success: float
    origin: FamilyOrigin


def reverse_curriculum(
    starts: FirstFamilySampler,
    objective: LearningObjective,
    sizes: Sequence[int],
    success_rate: Callable[[Family, LearningObjective, int], float],
    is_over: Callable[[], bool],
) -> TrainedFamily | None:
    """Return the reverse curriculum that is good with the fewest training steps in total; of equal ones the smallest.

    If none is good before the effort is spent, return the best one that was tried. Return None if no optimal episode
    has enough states.

    Args:
        starts: makes families of the optimal episodes of the target.
        objective: the learning objective; its steps are used unless they are free.
        sizes: numbers of members to try, ascending.
        success_rate: function that trains a number of new learners on a family and returns the share that solves
            the target.
        is_over: function that returns True if the effort is spent.
    """
    families = {size: list(starts.reverse_curricula(size)) for size in sizes}
    best: tuple[int, float, TrainedFamily] | None = None
    for size, steps in _sizes_and_steps(objective, [size for size in sizes if families[size]]):
        learning = objective if steps is None else objective.with_steps(steps)
        for origin, family in families[size]:
            for stage, seeds in enumerate(_SEED_COUNTS):
                found = TrainedFamily(family, learning, success_rate(family, learning, seeds), origin)
                if best is None or (stage, found.success) > best[:2]:
                    best = stage, found.success, found
                if found.success < GOOD_SUCCESS_RATE:
                    break
            else:
                return found
            if is_over():
                return best[2]
    return best[2] if best else None


def _sizes_and_steps(objective: LearningObjective, sizes: Sequence[int]) -> Iterator[tuple[int, int | None]]:
    """Yield pairs to try, fewest steps first: number of members, and steps per member (None: the objective's)."""
    if objective.is_steps_free:
        yield from ((size, max(1, total // size)) for total in TOTAL_STEPS for size in sizes)
    else:
        yield from ((size, None) for size in sizes)
