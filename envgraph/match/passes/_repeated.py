"""Relations that stand twice in a conjunction, as inlining leaves them."""

from __future__ import annotations

from dataclasses import replace

from envgraph.match.passes._bodies import Bodies
from envgraph.pattern import Conjunction, Goal, is_relation


def drop_repeated(body: Conjunction, bodies: Bodies) -> Conjunction:
    """Each relation once; expressions stay, for `1 / 2` and `1.0 / 2` compare equal."""
    kept: list[Goal] = []
    seen: set[Goal] = set()
    for goal in body.goals:
        if is_relation(goal):
            if goal in seen:
                continue
            seen.add(goal)
        kept.append(goal)
    return replace(body, goals=tuple(kept))
