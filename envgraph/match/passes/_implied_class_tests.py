"""Passes that remove class tests implied by other goals."""

from __future__ import annotations

from dataclasses import replace

from envgraph.match.passes._rewritten_bodies import RewrittenBodies
from envgraph.pattern import AbsenceAtom, Conjunction, Goal, implied_classes, is_implied


def drop_implied(body: Conjunction, bodies: RewrittenBodies) -> Conjunction:
    """Return the body without class tests that another goal of the body implies."""
    library = bodies.library
    known = implied_classes(body.goals, library.metamodel, library.parameter_types)
    kept = (goal for goal in body.goals if not is_implied(goal, body.goals, known, library.metamodel))
    return replace(body, goals=tuple(kept))


def drop_implied_inside(body: Conjunction, bodies: RewrittenBodies) -> Conjunction:
    """Return the body without class tests in negations that goals of the same alternative or outside imply."""
    library = bodies.library
    outside = implied_classes(body.goals, library.metamodel, library.parameter_types)

    def without_implied_tests(alternative: tuple[Goal, ...]) -> tuple[Goal, ...]:
        """Return an alternative of a negation without class tests that goals inside or outside it imply."""
        inside = implied_classes(alternative, library.metamodel, library.parameter_types)
        known = {v: inside.get(v, frozenset()) | outside.get(v, frozenset()) for v in (*inside, *outside)}
        kept = (goal for goal in alternative if not is_implied(goal, alternative, known, library.metamodel))
        return tuple(kept)

    def simplify_negation(goal: Goal) -> Goal:
        """Return a negation without implied class tests; return any other goal unchanged."""
        if isinstance(goal, AbsenceAtom):
            return replace(goal, alternatives=tuple(map(without_implied_tests, goal.alternatives)))
        return goal

    return replace(body, goals=tuple(map(simplify_negation, body.goals)))
