"""Reverse curricula, whose members are states of an optimal episode: find how many states and steps suffice."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Final

from envgraph.code import dataclass
from envgraph.search.curricula._moves import Family
from envgraph.search.curricula._objectives import Learning
from envgraph.search.curricula._starts import Origin, Starts

GOOD: Final = 0.98
"""Share of learners that succeed on a good family. Then 95 of 100 others succeed with a probability of .99."""

SIZES: Final = (3, 4, 6, 9, 13, 19, 27, 38, 54)
"""Numbers of members that are tried if the family file has no `population`."""

TOTALS: Final = tuple(round(300 * 1.25**step) for step in range(48))
"""Steps in all that are tried if the family file has no steps: from 300 to ten million."""

_SEEDS: Final = (8, 100, 500)
"""Numbers of seeds for a family: the next number is used if the family is good with the one before."""


@dataclass(frozen=True, slots=True)
class TrainedFamily:
    """A family, and the success of learners that were trained on it.

    Attributes:
        family: the easiest member first.
        objective: says how many steps on each member.
        success: share of learners that solve the target.
        origin: what the members are made from.
    """

    family: Family
    objective: Learning
    success: float
    origin: Origin


def reverse_curriculum(
    starts: Starts,
    objective: Learning,
    sizes: Sequence[int],
    success: Callable[[Family, Learning, int], float],
    is_over: Callable[[], bool],
) -> TrainedFamily | None:
    """Return the reverse curriculum that is good with the fewest steps in all; of several, the one of fewest members.

    Args:
        starts: makes families of the optimal episodes of the target.
        objective: its steps are used, unless they are free.
        sizes: numbers of members that are tried, ascending.
        success: trains so many new learners on a family, and returns the share that solves the target.
        is_over: whether the effort is spent.

    Returns:
        If none is good, the best one that was tried; None if no optimal episode has enough states.
    """
    families = {size: list(starts.reversed_episodes(size)) for size in sizes}
    best: tuple[int, float, TrainedFamily] | None = None
    for size, steps in _tried(objective, [size for size in sizes if families[size]]):
        learning = objective if steps is None else objective.at(steps)
        for origin, family in families[size]:
            for stage, seeds in enumerate(_SEEDS):
                found = TrainedFamily(family, learning, success(family, learning, seeds), origin)
                if best is None or (stage, found.success) > best[:2]:
                    best = stage, found.success, found
                if found.success < GOOD:
                    break
            else:
                return found
            if is_over():
                return best[2]
    return best[2] if best else None


def _tried(objective: Learning, sizes: Sequence[int]) -> Iterator[tuple[int, int | None]]:
    """Yield numbers of members, and of steps on each member; None: the steps of the objective."""
    if objective.free:
        yield from ((size, max(1, total // size)) for total in TOTALS for size in sizes)
    else:
        yield from ((size, None) for size in sizes)
