"""Find the tests after a loop over the ends of a link that restrict the objects of the loop."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile

from envgraph.match.generate._bindings import Bindings
from envgraph.match.plan._plan import Kind, Step
from envgraph.metamodel import Reference
from envgraph.pattern import LinkAtom


def link_tests(loop: Step, following: Sequence[Step], bindings: Bindings) -> list[Step]:
    """Return the link tests, before the next loop, between the end that a loop over links binds and a known object."""
    if not (isinstance(loop.goal, LinkAtom) and isinstance(loop.goal.reference, Reference)):
        return []
    (end,) = loop.binds
    found: list[Step] = []
    for each in takewhile(lambda step: step.kind is not Kind.LOOP, following):
        match each:
            case Step(kind=Kind.TEST, goal=LinkAtom(Reference(), one, other)) if end in (one, other):
                if one != other and bindings.known(other if one == end else one):
                    found.append(each)
    return found
