"""Calls of small patterns are replaced by what these ask for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

from envgraph.code import dataclass
from envgraph.match.passes._bodies import Bodies
from envgraph.match.passes._implied import drop_implied, drop_implied_inside
from envgraph.match.passes._repeated import drop_repeated
from envgraph.metamodel import Value
from envgraph.pattern import (
    Absence,
    CallAtom,
    Conjunction,
    Goal,
    StaticType,
    is_relation,
    renumbered,
    variables,
)

MOST_INLINED: Final = 8
"""Goals of a called body that may be inlined, those inside negations included."""
MOST_GOALS: Final = 64
"""Goals of a body beyond which nothing is inlined into it."""
MOST_ALTERNATIVES: Final = 4
"""Bodies of a negated pattern that may be inlined."""
MOST_EXPANDED: Final = 8
"""Bodies that a pattern may have after the bodies of those it calls have been multiplied out."""
MOST_LOCAL: Final = 2
"""Local variables of a called body in a view: each can multiply the derivations of a match."""

Test = Callable[[Conjunction], bool]


def inline_calls(body: Conjunction, bodies: Bodies) -> Conjunction:
    """Patterns with one small body stand in place of their calls, and those with few also inside negations."""
    return _inlined(body, bodies, small, small)


def inline_few_locals(body: Conjunction, bodies: Bodies) -> Conjunction:
    """The same where that keeps derivations few, and into a negation only what is a single relation."""
    return _inlined(body, bodies, few_locals, lambda called: few_locals(called) and single(called))


def _inlined(body: Conjunction, bodies: Bodies, fits: Test, fits_negated: Test) -> Conjunction:
    draft = _Draft(list(body.types), list(body.constants))
    goals: list[Goal] = []
    for goal in body.goals:
        match goal:
            case CallAtom(pattern, called):
                found = _inlinable(bodies, pattern, fits)
                if found is not None and len(found) == 1 and len(goals) < MOST_GOALS:
                    goals.extend(draft.inlined(found[0], called))
                    continue
            case Absence(((relation,),)):
                goal = replace(goal, alternatives=_alternatives(relation, bodies, draft, fits_negated))
        goals.append(goal)
    return draft.conjunction(body, goals)


def _alternatives(goal: Goal, bodies: Bodies, draft: _Draft, fits: Test) -> tuple[tuple[Goal, ...], ...]:
    found = _inlinable(bodies, goal.pattern, fits) if isinstance(goal, CallAtom) else None
    if found is None or len(found) > MOST_ALTERNATIVES or not isinstance(goal, CallAtom):
        return ((goal,),)
    return tuple(tuple(draft.inlined(body, goal.arguments)) for body in found)


def expanded(bodies: Bodies, pattern: str) -> tuple[Conjunction, ...]:
    """The bodies of a pattern with those of called patterns multiplied out, if that gives only a few.

    It pays where duplicates are sorted out anyway, as in a closure.
    """
    found: list[Conjunction] = []
    pending = list(bodies.of(pattern))
    while pending:
        body = pending.pop(0)
        alternatives = _multiplied(body, bodies)
        pending[:0] = alternatives
        if not alternatives:
            found.append(body)
        if len(found) + len(pending) > MOST_EXPANDED:
            return bodies.of(pattern)
    return tuple(found)


def _multiplied(body: Conjunction, bodies: Bodies) -> list[Conjunction]:
    """The conjunction with each body of the first pattern that it calls; none if no call can be replaced."""
    for position, goal in enumerate(body.goals):
        found = _inlinable(bodies, goal.pattern, small) if isinstance(goal, CallAtom) else None
        if found is not None and isinstance(goal, CallAtom):
            others = [*body.goals[:position], *body.goals[position + 1 :]]
            return [_with_body(body, others, each, goal.arguments, bodies) for each in found]
    return []


def _with_body(
    body: Conjunction, others: Sequence[Goal], inner: Conjunction, called: tuple[int, ...], bodies: Bodies
) -> Conjunction:
    draft = _Draft(list(body.types), list(body.constants))
    whole = draft.conjunction(body, [*others, *draft.inlined(inner, called)])
    for rewrite in (drop_repeated, drop_implied, drop_implied_inside):
        whole = rewrite(whole, bodies)
    return whole


def _inlinable(bodies: Bodies, pattern: str, fits: Test) -> tuple[Conjunction, ...] | None:
    """The bodies of a pattern if each of them may stand in place of its call."""
    found = bodies.called(pattern)
    return found if found is not None and all(map(fits, found)) else None


@dataclass(slots=True)
class _Draft:
    """The variables of a conjunction to which inlining adds others."""

    types: list[StaticType]
    constants: list[tuple[int, Value]]

    def inlined(self, body: Conjunction, called: tuple[int, ...]) -> list[Goal]:
        """The goals of a called body with this body's variables for its parameters and new ones for the rest."""
        numbers = dict(zip(body.parameters, called, strict=True))
        for number, type_ in enumerate(body.types):
            if number not in numbers:
                numbers[number] = len(self.types)
                self.types.append(type_)
        self.constants.extend((numbers[number], value) for number, value in body.constants)
        return [renumbered(goal, numbers) for goal in body.goals]

    def conjunction(self, body: Conjunction, goals: Sequence[Goal]) -> Conjunction:
        return Conjunction(
            tuple(self.types), tuple(self.constants), body.parameters, tuple(goals), body.names
        )


def small(body: Conjunction) -> bool:
    """Return whether a body has few goals, and its parameters are variables of their own."""
    return (
        sum(map(_size, body.goals)) <= MOST_INLINED
        and len(set(body.parameters)) == len(body.parameters)
        and not any(number in body.parameters for number, _ in body.constants)
    )


def few_locals(body: Conjunction) -> bool:
    """Return whether a small body has hardly any variables beside its parameters."""
    fixed = {number for number, _ in body.constants}
    used = {number for goal in body.goals for number in variables(goal)}
    return small(body) and len(used - fixed - set(body.parameters)) <= MOST_LOCAL


def single(body: Conjunction) -> bool:
    """Return whether a body is one relation."""
    return len(body.goals) == 1 and is_relation(body.goals[0])


def _size(goal: Goal) -> int:
    """Goals in a goal, itself included: what negations have inlined would double with each level."""
    if isinstance(goal, Absence):
        return 1 + sum(_size(each) for alternative in goal.alternatives for each in alternative)
    return 1
