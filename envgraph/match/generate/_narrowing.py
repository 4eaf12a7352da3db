"""Which of the tests that follow a loop over the ends of a link tell it to be over fewer objects."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile

from envgraph.match.generate._bindings import Bindings
from envgraph.match.plan._plan import Kind, Step
from envgraph.metamodel import Reference
from envgraph.pattern import LinkAtom


def link_tests(loop: Step, following: Sequence[Step], bindings: Bindings) -> list[Step]:
    """Return the tests of links between the end of a link, over which is looped, and objects that are known."""
    if not (isinstance(loop.goal, LinkAtom) and isinstance(loop.goal.reference, Reference)):
        return []
    (end,) = loop.binds
    found: list[Step] = []
    for each in takewhile(lambda step: step.kind is not Kind.LOOP, following):
        goal = each.goal
        if (
            each.kind is Kind.TEST
            and isinstance(goal, LinkAtom)
            and isinstance(goal.reference, Reference)
            and goal.source != goal.target
        ):
            other = goal.source if goal.target == end else goal.target
            if end in (goal.source, goal.target) and bindings.known(other):
                found.append(each)
    return found
