"""Distinct partial matches: where the loops of a plan come to the same values again, although only different ones
matter for what follows.

A chain of links has as many paths as its fanouts multiply to, but only as many ends as there are objects. Wherever
a variable is not needed further on, the values of those that are needed pass once: so the work of each loop is bounded
by the values that it starts from. The first of equals passes: results and their order are the same as without.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Final

from envgraph.code import dataclass
from envgraph.match.plan._options import CALL
from envgraph.match.plan._order import WIDEST
from envgraph.match.plan._plan import Kind, Step
from envgraph.match.plan._sharing import mentioned
from envgraph.pattern import Goal

FEW: Final = 50.0
"""Partial matches, as estimated, of which it is not worth while to find those that are alike before a loop."""
OUTSIDE: Final = -1
"""Stands for a loop around the plan."""

Determined = Callable[[Sequence[Goal], Iterable[int]], set[int]]
"""The variables that have one value at most, by some goals, once those given have theirs."""


@dataclass(frozen=True, slots=True)
class Distinct:
    """Lets partial matches pass only if they differ in what is needed further on.

    Attributes:
        first: number of the step before which it is empty again, or `OUTSIDE`.
        key: the variables in which they have to differ.
    """

    first: int
    key: tuple[int, ...]


def distinct_places(
    steps: Sequence[Step],
    results: Iterable[int],
    known: Iterable[int],
    determined: Determined,
    around: Iterable[int] = (),
) -> dict[int, Distinct]:
    """The places of a plan where partial matches may be alike.

    Args:
        steps: the plan. Coming to the same results again must change nothing.
        results: the variables that are used at its end.
        known: those that have a value before, constants included.
        determined: see `Determined`.
        around: those that have a value from a loop around the plan, with the same use of results in each round.

    Returns:
        `Distinct`s by the number of the step that they stand before; by the number of steps, at the end.
    """
    known = frozenset(known).difference(around)
    needed = _needed(steps, results)
    place = dict.fromkeys(around, OUTSIDE)
    looped = dict.fromkeys(around)
    fresh = set(around)
    """Variables by which partial matches may differ since the last set."""
    found: dict[int, Distinct] = {}
    for number in range(len(steps) + 1):
        if fresh - needed[number] and (number == len(steps) or _heavy(steps[number])):
            goals = [step.goal for step in steps[:number] if step.kind is not Kind.EXISTS]
            live = needed[number].intersection(place)
            fixed = determined(goals, known | live)
            if not fresh <= fixed:
                first = min(place[v] for v in looped if v not in fixed)
                outer = known.union(v for v in live if place[v] < first)
                key = _key(sorted(v for v in live if place[v] >= first), goals, outer, determined)
                if key and (number == len(steps) or (len(key) <= WIDEST and _many(steps, first, number))):
                    found[number] = Distinct(first, key)
                    fresh = set(key)
        if number < len(steps):
            place.update(dict.fromkeys(steps[number].binds, number))
            if steps[number].kind is Kind.LOOP:
                looped.update(dict.fromkeys(steps[number].binds))
                fresh.update(steps[number].binds)
    return found


def _needed(steps: Sequence[Step], results: Iterable[int]) -> list[set[int]]:
    """The variables that are used from each step on, and after the last one."""
    needed = [set(results)]
    for step in reversed(steps):
        needed.append(needed[-1].union(mentioned(step)))
    return needed[::-1]


def _heavy(step: Step) -> bool:
    return step.kind is Kind.LOOP or step.cost >= CALL


def _many(steps: Sequence[Step], first: int, number: int) -> bool:
    """Return whether there may be many partial matches to tell apart."""
    before = steps[first - 1].rows if first > 0 else 1.0
    return first == OUTSIDE or steps[number - 1].rows >= FEW * before


def _key(
    variables: Sequence[int], goals: Sequence[Goal], outer: frozenset[int], determined: Determined
) -> tuple[int, ...]:
    """Those of the variables that the others do not determine."""
    key = list(variables)
    for variable in variables if len(variables) > 1 else ():
        others = [v for v in key if v != variable]
        if variable in determined(goals, outer.union(others)):
            key = others
    return tuple(key)
