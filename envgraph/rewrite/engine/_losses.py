"""Losses: where a rule may take an object away, by deleting it or its container, by a merge, by a change of class."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping

from envgraph.code import dataclass
from envgraph.errors import Span
from envgraph.metamodel import Attribute, Metamodel, Reference, reached
from envgraph.pattern import (
    Absence,
    AggregateAtom,
    Goal,
    Library,
    LinkAtom,
)
from envgraph.rewrite._plan import BlockPlan, RulePlan


@dataclass(frozen=True, slots=True)
class Loss:
    """An action of a rule that an object may fall victim to.

    Attributes:
        rule: qualified name.
        deed: what the action does, as a verb: "delete", "merge" or "retype".
        span: of the action; None where the rule was not read from a text.
    """

    rule: str
    deed: str
    span: Span | None


@dataclass(frozen=True, slots=True)
class UnnamedLinks:
    """An object that a rule deletes, with the references that it does not know of.

    Attributes:
        name: of the object in the rule.
        references: under DPO the rule is refused where the object has a link of one of them.
        span: of the action; None where the rule was not read from a text.
    """

    name: str
    references: tuple[Reference, ...]
    span: Span | None


def losses(
    plan: RulePlan, metamodel: Metamodel, cls: str | None, known: Mapping[str, bool]
) -> Iterator[Loss]:
    """The actions of a rule that may take an object of a class away.

    Args:
        plan: of the rule.
        metamodel: of the class.
        cls: of the object; None if it is not known. The object is lost, too, when it is no longer of the class.
        known: parameters of the rule that are the object (True), or surely another one (False).
    """
    given = any(known.values())
    for block in plan.blocks:

        def may_be(slot: int, block: BlockPlan = block) -> bool:
            """Return whether a slot may be the object: what one slot has is in no other, unless they may coincide."""
            told, kind = known.get(block.names[slot]), block.classes[slot]
            if told is not None:
                return told
            fits = cls is None or kind is None or metamodel.overlap(kind, cls)
            return fits and not (given and not block.coinciding)

        def may_contain(slot: int, block: BlockPlan = block) -> bool:
            kind = block.classes[slot]
            return cls is None or kind is None or _holds(metamodel, kind, cls)

        for delete in block.deletes:
            if may_be(delete.node) or may_contain(delete.node):
                yield Loss(plan.name, "delete", delete.span or block.span)
        for absorb in block.absorbs:
            if may_be(absorb.absorbed):
                yield Loss(plan.name, "merge", absorb.span or block.span)
        for retype in block.retypes:
            if cls is not None and not metamodel.is_a(retype.cls, cls) and may_be(retype.node):
                yield Loss(plan.name, "retype", retype.span or block.span)


def unnamed_links(plan: RulePlan, library: Library) -> Iterator[UnnamedLinks]:
    """The objects that a rule deletes under DPO, with references whose links it does not ask for in any way.

    Where there is such a link the rule is refused. A condition on one, even a negated one, or in a pattern that is
    called, is taken to say that the rule knows of it. Links to the container and from it go along.
    """
    patterns = reached((block.pattern for block in plan.blocks), library.called)
    bodies = (body for name in patterns for body in library.lowered(name).bodies)
    asked = {reference for body in bodies for reference in _asked(body.goals)}
    for block in plan.blocks:
        for delete in block.deletes if not plan.lossy else ():
            cls = block.classes[delete.node]
            found = cls and tuple(_touching(library.metamodel, cls, asked))
            if found:
                yield UnnamedLinks(block.names[delete.node], found, delete.span or block.span)


def _touching(
    metamodel: Metamodel, cls: str, asked: Collection[Reference | Attribute]
) -> Iterator[Reference]:
    """The references from and to a class that are no containment and not asked for; the first of two opposites."""
    for one in metamodel.references:
        pair = [one] if (other := metamodel.opposite(one)) is None else [one, other]
        if one.index > pair[-1].index or any(each.containment or each in asked for each in pair):
            continue
        if metamodel.overlap(cls, one.owner) or metamodel.overlap(cls, one.target):
            yield one


def _asked(goals: Iterable[Goal]) -> Iterator[Reference | Attribute]:
    """The references that goals ask for."""
    for goal in goals:
        if isinstance(goal, Absence):
            for alternative in goal.alternatives:
                yield from _asked(alternative)
        elif isinstance(goal, AggregateAtom):
            yield from _asked([goal.relation])
        elif isinstance(goal, LinkAtom):
            yield goal.reference


def _holds(metamodel: Metamodel, outer: str, inner: str) -> bool:
    """Return whether an object of one class may contain one of another, however deep."""
    return not {*metamodel.all_contents(metamodel.concrete(outer))}.isdisjoint(metamodel.concrete(inner))
