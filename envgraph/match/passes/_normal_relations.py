"""Passes that normalise relations for views: one reference of an opposite pair, negations of one relation."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator
from dataclasses import replace
from typing import cast

from envgraph.match.passes._rewritten_bodies import RewrittenBodies
from envgraph.metamodel import Metamodel, Reference
from envgraph.pattern import (
    AbsenceAtom,
    AggregateAtom,
    Conjunction,
    Goal,
    LinkAtom,
    RelationAtom,
    relation_variables,
)


def links_as_facts(body: Conjunction, bodies: RewrittenBodies) -> Conjunction:
    """Return the body with each link of two opposite references expressed by the one with the lower index.

    The store notifies changes of links by this reference.
    """
    metamodel = bodies.library.metamodel
    return replace(body, goals=tuple(_normalise_link(goal, metamodel) for goal in body.goals))


def _normalise_link(goal: Goal, metamodel: Metamodel) -> Goal:
    """Return the goal with each link, also inside it, expressed by the opposite reference if its index is lower."""
    match goal:
        case LinkAtom(Reference() as reference, source, target):
            opposite = metamodel.opposite(reference)
            flipped = opposite is not None and opposite.index < reference.index
            return LinkAtom(opposite, target, source) if flipped and opposite else goal
        case AbsenceAtom(alternatives):
            return replace(
                goal,
                alternatives=tuple(tuple(_normalise_link(g, metamodel) for g in each) for each in alternatives),
            )
        case AggregateAtom(_, relation):
            return replace(goal, relation=cast(RelationAtom, _normalise_link(relation, metamodel)))
        case _:
            return goal


def split_negations(body: Conjunction, bodies: RewrittenBodies) -> Conjunction:
    """Return the body with each negation of several relations split into negations of one relation.

    Variables with a fixed value count as outer variables of a negation, so the value also holds inside.
    """
    return replace(body, goals=tuple(_split(body.goals, {number for number, _ in body.constants})))


def _split(goals: Iterable[Goal], fixed: Container[int]) -> Iterator[Goal]:
    """Yield the goals, with each negation split into negations of one relation. `fixed` has the constants."""
    for goal in goals:
        if isinstance(goal, AbsenceAtom):
            for (relation,) in goal.alternatives:
                called = dict.fromkeys(relation_variables(cast(RelationAtom, relation)))
                yield AbsenceAtom(((relation,),), tuple(v for v in called if v in goal.outer or v in fixed))
        else:
            yield goal
