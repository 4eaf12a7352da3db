"""A pass that removes repeated relations, which inlining may leave in a conjunction."""

from __future__ import annotations

from dataclasses import replace

from envgraph.match.passes._rewritten_bodies import RewrittenBodies
from envgraph.pattern import Conjunction, Goal, is_relation


def drop_repeated(body: Conjunction, bodies: RewrittenBodies) -> Conjunction:
    """Return the body with each relation once. Repeated expressions stay: `1` equals `1.0`, but differs in type."""
    kept: list[Goal] = []
    seen: set[Goal] = set()
    for goal in body.goals:
        if is_relation(goal):
            if goal in seen:
                continue
            seen.add(goal)
        kept.append(goal)
    return replace(body, goals=tuple(kept))
