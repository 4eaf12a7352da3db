"""Find the places of a plan where partial matches may repeat in all values that the rest of the plan uses.

In a chain of links the number of paths is the product of the fanouts, but the number of ends is at most the number of
objects. Where a variable is no longer needed, the values of the needed variables are let through only once. So the
work of each loop is bounded by the values before it. The first of equal partial matches is kept: results and their
order do not change.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Final

from envgraph.code import dataclass
from envgraph.match._match_costs import PLAN
from envgraph.match.plan._search_plan import PlanStep, StepKind
from envgraph.match.plan._shared_searches import variables_used_by
from envgraph.pattern import Goal

OUTER_LOOP: Final = -1
"""The step number that stands for a loop around the plan."""

DeterminedVariables = Callable[[Sequence[Goal], Iterable[int]], set[int]]
"""Returns the variables that have at most one value, by some goals, if the given variables have values."""


@dataclass(frozen=True, slots=True)
class DuplicateFilter:
    """A duplicate filter in a plan: a partial match passes only if the values of its key variables are new.

    Attributes:
        first: number of the step before which the set of seen keys is emptied, or `OUTER_LOOP`.
        key: the variables whose values are compared.
    """

    first: int
    key: tuple[int, ...]


def place_duplicate_filters(
    steps: Sequence[PlanStep],
    results: Iterable[int],
    known: Iterable[int],
    determined: DeterminedVariables,
    around: Iterable[int] = (),
) -> dict[int, DuplicateFilter]:
    """Return the duplicate filters of a plan.

    Args:
        steps: the plan. A result found several times must mean the same as a result found once.
        results: the variables that are used after the last step.
        known: the variables with values before the first step, constants included.
        determined: see `DeterminedVariables`.
        around: variables of a loop around the plan. A result that an earlier iteration found is a duplicate, too.

    Returns:
        the filters by the number of the step before which they are placed; the number of steps stands for the end.
    """
    known = frozenset(known).difference(around)
    needed = _variables_used_from(steps, results)
    place = dict.fromkeys(around, OUTER_LOOP)
    looped = dict.fromkeys(around)
    fresh = set(around)
    """The variables in which partial matches may differ since the last filter."""
    found: dict[int, DuplicateFilter] = {}
    for number in range(len(steps) + 1):
        # A filter is worthwhile before a loop, or before a step that costs as much as a function call.
        if fresh - needed[number] and (
            number == len(steps) or steps[number].kind is StepKind.LOOP or steps[number].cost >= PLAN.call
        ):
            goals = [step.goal for step in steps[:number] if step.kind is not StepKind.EXISTS]
            live = needed[number].intersection(place)
            fixed = determined(goals, known | live)
            if not fresh <= fixed:
                first = min(place[v] for v in looped if v not in fixed)
                outer = known.union(v for v in live if place[v] < first)
                key = _key(sorted(v for v in live if place[v] >= first), goals, outer, determined)
                before = steps[first - 1].rows if first > 0 else 1.0
                grows = first == OUTER_LOOP or steps[number - 1].rows >= PLAN.few_rows * before
                if key and (number == len(steps) or (len(key) <= PLAN.widest and grows)):
                    found[number] = DuplicateFilter(first, key)
                    fresh = set(key)
        if number < len(steps):
            place.update(dict.fromkeys(steps[number].binds, number))
            if steps[number].kind is StepKind.LOOP:
                looped.update(dict.fromkeys(steps[number].binds))
                fresh.update(steps[number].binds)
    return found


def _variables_used_from(steps: Sequence[PlanStep], results: Iterable[int]) -> list[set[int]]:
    """Return for each step the variables used by it or later, results included; as a last set, the results."""
    needed = [set(results)]
    for step in reversed(steps):
        needed.append(needed[-1].union(variables_used_by(step)))
    return needed[::-1]


def _key(
    variables: Sequence[int], goals: Sequence[Goal], outer: frozenset[int], determined: DeterminedVariables
) -> tuple[int, ...]:
    """Remove variables whose values the goals determine from the remaining and `outer` ones; return the rest."""
    key = list(variables)
    for variable in variables if len(variables) > 1 else ():
        others = [v for v in key if v != variable]
        if variable in determined(goals, outer.union(others)):
            key = others
    return tuple(key)
