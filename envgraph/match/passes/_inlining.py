"""Passes that inline calls: the goals of small called patterns replace their calls."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from envgraph.code import dataclass
from envgraph.match._match_costs import INLINING
from envgraph.match.passes._implied_class_tests import drop_implied, drop_implied_inside
from envgraph.match.passes._repeated_relations import drop_repeated
from envgraph.match.passes._rewritten_bodies import RewrittenBodies
from envgraph.metamodel import Value
from envgraph.pattern import (
    AbsenceAtom,
    CallAtom,
    Conjunction,
    Goal,
    StaticType,
    is_relation,
    renumber_goal,
    visible_variables,
)

Test = Callable[[Conjunction], bool]


def inline_calls(body: Conjunction, bodies: RewrittenBodies) -> Conjunction:
    """Return the body with calls inlined if the called pattern has one small body; in negations, a few small bodies."""
    return _inline(body, bodies, is_small, is_small)


def inline_few_locals(body: Conjunction, bodies: RewrittenBodies) -> Conjunction:
    """Return the body with calls inlined if the called pattern has one small body with at most two local variables.

    In a negation, in addition, each body of the called pattern must be a single relation.
    """
    return _inline(body, bodies, has_few_locals, lambda called: has_few_locals(called) and is_single_relation(called))


def _inline(body: Conjunction, bodies: RewrittenBodies, fits: Test, fits_negated: Test) -> Conjunction:
    """Return the body with calls inlined if their bodies pass `fits`, negated calls if they pass `fits_negated`."""
    draft = _ConjunctionDraft(list(body.types), list(body.constants))
    goals: list[Goal] = []
    for goal in body.goals:
        match goal:
            case CallAtom(pattern, called):
                found = _inlinable(bodies, pattern, fits)
                if found is not None and len(found) == 1 and len(goals) < INLINING.calling:
                    goals.extend(draft.inline_body(found[0], called))
                    continue
            case AbsenceAtom(((relation,),)):
                goal = replace(goal, alternatives=_alternatives(relation, bodies, draft, fits_negated))
        goals.append(goal)
    return draft.conjunction(body, goals)


def _alternatives(
    goal: Goal, bodies: RewrittenBodies, draft: _ConjunctionDraft, fits: Test
) -> tuple[tuple[Goal, ...], ...]:
    """Return the alternatives of a negation of one goal: the called pattern's bodies if inlined, else the goal."""
    found = _inlinable(bodies, goal.pattern, fits) if isinstance(goal, CallAtom) else None
    if found is None or len(found) > INLINING.alternatives or not isinstance(goal, CallAtom):
        return ((goal,),)
    return tuple(tuple(draft.inline_body(body, goal.arguments)) for body in found)


def expanded_bodies(bodies: RewrittenBodies, pattern: str) -> tuple[Conjunction, ...]:
    """Return a pattern's bodies with calls inlined, in one copy for each combination of called bodies.

    If the copies are too many, return the original bodies. Copies pay off if duplicate results are removed anyway.
    """
    found: list[Conjunction] = []
    pending = list(bodies.bodies_of(pattern))
    while pending:
        body = pending.pop(0)
        alternatives = _expand_first_call(body, bodies)
        pending[:0] = alternatives
        if not alternatives:
            found.append(body)
        if len(found) + len(pending) > INLINING.expanded:
            return bodies.bodies_of(pattern)
    return tuple(found)


def _expand_first_call(body: Conjunction, bodies: RewrittenBodies) -> list[Conjunction]:
    """Return copies of a body, one for each body of the first inlinable call; [] if no call can be inlined."""
    for position, goal in enumerate(body.goals):
        found = _inlinable(bodies, goal.pattern, is_small) if isinstance(goal, CallAtom) else None
        if found is not None and isinstance(goal, CallAtom):
            others = [*body.goals[:position], *body.goals[position + 1 :]]
            return [_replace_call(body, others, each, goal.arguments, bodies) for each in found]
    return []


def _replace_call(
    body: Conjunction,
    others: Sequence[Goal],
    inner: Conjunction,
    called: tuple[int, ...],
    bodies: RewrittenBodies,
) -> Conjunction:
    """Return the body with the goals of one called body in place of the call, and without repeated and implied goals.

    Args:
        body: the calling body.
        others: its goals without the call.
        inner: the body of the called pattern.
        called: the arguments of the call.
        bodies: all bodies.
    """
    draft = _ConjunctionDraft(list(body.types), list(body.constants))
    whole = draft.conjunction(body, [*others, *draft.inline_body(inner, called)])
    for rewrite in (drop_repeated, drop_implied, drop_implied_inside):
        whole = rewrite(whole, bodies)
    return whole


def _inlinable(bodies: RewrittenBodies, pattern: str, fits: Test) -> tuple[Conjunction, ...] | None:
    """Return the bodies of a pattern if a call may be replaced by them and each passes `fits`; else None."""
    found = bodies.inlinable_bodies(pattern)
    return found if found is not None and all(map(fits, found)) else None


@dataclass(slots=True)
class _ConjunctionDraft:
    """The variables and constants of a conjunction under construction. Inlining adds local variables to it."""

    types: list[StaticType]
    constants: list[tuple[int, Value]]

    def inline_body(self, body: Conjunction, called: tuple[int, ...]) -> list[Goal]:
        """Return a called body's goals with the arguments for parameters; add its other variables to the draft."""
        numbers = dict(zip(body.parameters, called, strict=True))
        for number, type_ in enumerate(body.types):
            if number not in numbers:
                numbers[number] = len(self.types)
                self.types.append(type_)
        self.constants.extend((numbers[number], value) for number, value in body.constants)
        return [renumber_goal(goal, numbers) for goal in body.goals]

    def conjunction(self, body: Conjunction, goals: Sequence[Goal]) -> Conjunction:
        """Return a conjunction with this draft's variables, the parameters and names of `body`, and the given goals."""
        return Conjunction(tuple(self.types), tuple(self.constants), body.parameters, tuple(goals), body.names)


def is_small(body: Conjunction) -> bool:
    """Return True if a body has at most `INLINING.goals` goals, and its parameters are distinct and not constant."""
    return (
        sum(map(_size, body.goals)) <= INLINING.goals
        and len(set(body.parameters)) == len(body.parameters)
        and not any(number in body.parameters for number, _ in body.constants)
    )


def has_few_locals(body: Conjunction) -> bool:
    """Return True if a body is small and has at most two local variables."""
    fixed = {number for number, _ in body.constants}
    used = {number for goal in body.goals for number in visible_variables(goal)}
    return is_small(body) and len(used - fixed - set(body.parameters)) <= INLINING.local


def is_single_relation(body: Conjunction) -> bool:
    """Return True if a body has only one goal, and the goal is a relation."""
    return len(body.goals) == 1 and is_relation(body.goals[0])


def _size(goal: Goal) -> int:
    """Return the number of goals in a goal: 1, plus the number of goals inside a negation."""
    if isinstance(goal, AbsenceAtom):
        return 1 + sum(_size(each) for alternative in goal.alternatives for each in alternative)
    return 1
