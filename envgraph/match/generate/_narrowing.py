"""Which of the tests that follow a loop tell it to be over fewer objects."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import takewhile

from envgraph.match.generate._bindings import Bindings
from envgraph.match.plan._plan import Kind, Step
from envgraph.metamodel import Reference
from envgraph.pattern import AttributeAtom, InstanceAtom, LinkAtom


def value_tests(loop: Step, following: Sequence[Step], bindings: Bindings) -> list[Step]:
    """The tests of attributes of an object that is looped over, for values that are known and change."""
    if not isinstance(loop.goal, InstanceAtom):
        return []
    tests: dict[int, tuple[int, Step]] = {}
    for each in _tests(following):
        goal = each.goal
        if (
            isinstance(goal, AttributeAtom)
            and goal.object == loop.goal.variable
            and bindings.known(goal.value)
        ):
            tests.setdefault(goal.attribute.index, (goal.value, each))
    if bindings.constants.keys() >= {value for value, _ in tests.values()}:
        return []
    return [test for _, test in tests.values()]


def link_tests(loop: Step, following: Sequence[Step], bindings: Bindings) -> list[Step]:
    """The tests of links between the end of a link, over which is looped, and objects that are known."""
    if not (isinstance(loop.goal, LinkAtom) and isinstance(loop.goal.reference, Reference)):
        return []
    (end,) = loop.binds
    found: list[Step] = []
    for each in _tests(following):
        goal = each.goal
        if (
            isinstance(goal, LinkAtom)
            and isinstance(goal.reference, Reference)
            and goal.source != goal.target
        ):
            other = goal.source if goal.target == end else goal.target
            if end in (goal.source, goal.target) and bindings.known(other):
                found.append(each)
    return found


def _tests(following: Sequence[Step]) -> Iterator[Step]:
    """Yield the tests before the next loop."""
    before = takewhile(lambda step: step.kind is not Kind.LOOP, following)
    return (step for step in before if step.kind is Kind.TEST)
