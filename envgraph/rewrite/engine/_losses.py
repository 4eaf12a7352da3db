"""Losses: where a rule may take an object away, by deleting it or its container, by a merge, by a change of class."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from envgraph.code import dataclass
from envgraph.errors import Span
from envgraph.metamodel import Metamodel, reached
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
    waiting = [plan.body]
    for block in waiting:
        waiting += block.nested

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


def _holds(metamodel: Metamodel, outer: str, inner: str) -> bool:
    """Return whether an object of one class may contain one of another, however deep."""
    inside = (cls for name in metamodel.concrete(outer) for cls in metamodel.contents(name))
    found = set(reached(inside, metamodel.contents))
    return not found.isdisjoint(metamodel.concrete(inner))
