"""Reverse curricula without any search: how many states of an optimal episode, and how many steps, it takes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Final

from envgraph.code import dataclass
from envgraph.search.curricula._moves import Family
from envgraph.search.curricula._objectives import Learning
from envgraph.search.curricula._starts import Origin, Starts

GOOD: Final = 0.98
"""Share of learners that have to succeed. Of 100 others 95 do then with a probability of .99."""

SIZES: Final = (3, 4, 6, 9, 13, 19, 27, 38, 54)
"""Members of families that are tried where the family file names no number."""

TOTALS: Final = tuple(round(300 * 1.25**step) for step in range(48))
"""Steps in all that are tried where the family file names no number: from 300 to ten million."""

_SEEDS: Final = (8, 100, 500)
"""Seeds on which families are tried, one after the other as long as they are good enough."""


@dataclass(frozen=True, slots=True)
class Taught:
    """A family and what came of learners that were trained on it.

    Attributes:
        family: the easiest member first.
        objective: with the steps on each member.
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
) -> Taught | None:
    """Return the reverse curriculum that is good with the fewest steps in all, and then with the fewest members.

    Args:
        starts: knows optimal episodes of the target.
        objective: its steps are those on each member, or free.
        sizes: numbers of members that are tried, ascending.
        success: share of so many new learners of a family that solve the target.
        is_over: whether the effort is spent.

    Returns:
        Without one that is good, the best that was met; None if no optimal episode has as many states.
    """
    families = {size: list(starts.reversed_episodes(size)) for size in sizes}
    best: tuple[int, float, Taught] | None = None
    for size, steps in _tried(objective, [size for size in sizes if families[size]]):
        learning = objective if steps is None else objective.at(steps)
        for origin, family in families[size]:
            for stage, seeds in enumerate(_SEEDS):
                found = Taught(family, learning, success(family, learning, seeds), origin)
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
    """Yield numbers of members and of steps on each of them; None: those of the objective."""
    if objective.free:
        yield from ((size, max(1, total // size)) for total in TOTALS for size in sizes)
    else:
        yield from ((size, None) for size in sizes)
