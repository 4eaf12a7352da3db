"""Analysis of rules: actions that may lose an object, and changes that the model may refuse."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping

from envgraph.code import dataclass
from envgraph.errors import Span
from envgraph.metamodel import Attribute, Metamodel, Reference, reachable_nodes
from envgraph.pattern import (
    AbsenceAtom,
    AggregateAtom,
    Goal,
    Library,
    LinkAtom,
)
from envgraph.rewrite._rule_plan import BlockPlan, RulePlan
from envgraph.rewrite.check._claims import bounded_features


@dataclass(frozen=True, slots=True)
class Loss:
    """An action of a rule that may delete an object, merge it into another, or take away its class.

    Attributes:
        rule: qualified name of the rule.
        action: the kind of action: "delete", "merge" or "retype".
        span: span of the action; None if the rule was not parsed from text.
    """

    rule: str
    action: str
    span: Span | None


@dataclass(frozen=True, slots=True)
class PossibleRefusal:
    """A change for which the model may refuse a rule, since the rule's conditions do not mention some features.

    Attributes:
        features: for a deletion, references of which the object must not have a link; else the feature without room.
        deleted: the name of the deleted object in the rule; None if links or values are added.
        span: span of the change; None if the rule was not parsed from text.
    """

    features: tuple[Attribute | Reference, ...]
    deleted: str | None
    span: Span | None


def losses(plan: RulePlan, metamodel: Metamodel, cls: str | None, known: Mapping[str, bool]) -> Iterator[Loss]:
    """Yield the actions of a rule that may delete, merge or retype an object of a class, also with its container.

    Args:
        plan: plan of the rule.
        metamodel: the metamodel.
        cls: class of the object, or None if unknown. An object is also lost if it is no longer an instance of it.
        known: parameters of the rule that are the object (True) or certainly another one (False).
    """
    given = any(known.values())
    for block in plan.blocks:

        def may_be(slot: int, block: BlockPlan = block) -> bool:
            """Return True if a slot may be the object, by `known` or by its class.

            If `known` contains the object, other slots are the object only in a block whose variables may coincide.
            """
            reported, kind = known.get(block.names[slot]), block.classes[slot]
            if reported is not None:
                return reported
            fits = cls is None or kind is None or metamodel.may_overlap(kind, cls)
            return fits and not (given and not block.may_coincide)

        def may_contain(slot: int, block: BlockPlan = block) -> bool:
            """Return True if a slot may contain the object, at any depth."""
            kind = block.classes[slot]
            if cls is None or kind is None:
                return True
            inside = metamodel.all_content_classes(metamodel.concrete_classes(kind))
            return not set(inside).isdisjoint(metamodel.concrete_classes(cls))

        for delete in block.deletes:
            if may_be(delete.node) or may_contain(delete.node):
                yield Loss(plan.name, "delete", delete.span or block.span)
        for absorb in block.absorbs:
            if may_be(absorb.absorbed):
                yield Loss(plan.name, "merge", absorb.span or block.span)
        for retype in block.retypes:
            if cls is not None and not metamodel.is_a(retype.cls, cls) and may_be(retype.node):
                yield Loss(plan.name, "retype", retype.span or block.span)


def possible_refusals(plan: RulePlan, library: Library) -> Iterator[PossibleRefusal]:
    """Yield the deletions and additions of a rule that the model may refuse, unless conditions mention the feature.

    Every condition counts, even a negated one or one in a called pattern. Left out are containment links of a deleted
    object, which are deleted with it, features of created objects, and refusals of merges, retypes and cycles.
    """
    patterns = reachable_nodes((block.pattern for block in plan.blocks), library.callees)
    bodies = (body for name in patterns for body in library.lowered_pattern(name).bodies)
    asked = {reference for body in bodies for reference in _mentioned_references(body.goals)}
    for block in plan.blocks:
        for delete in block.deletes if not plan.is_spo else ():
            cls = block.classes[delete.node]
            found = cls and tuple(_unmentioned_references(library.metamodel, cls, asked))
            if found:
                yield PossibleRefusal(found, block.names[delete.node], delete.span or block.span)
        created = {create.node for each in plan.blocks for create in each.creates}
        for change in (*block.moves, *block.links, *block.sets):
            for node, feature in bounded_features(change, library.metamodel):
                opposite = library.metamodel.opposite(feature) if isinstance(feature, Reference) else None
                if node not in created and asked.isdisjoint((feature, opposite)):
                    yield PossibleRefusal((feature,), None, change.span or block.span)


def _unmentioned_references(
    metamodel: Metamodel, cls: str, asked: Collection[Reference | Attribute]
) -> Iterator[Reference]:
    """Yield one reference of each opposite pair at a class, if the pair is no containment and not in `asked`."""
    for one in metamodel.references:
        pair = [one] if (other := metamodel.opposite(one)) is None else [one, other]
        if one.index > pair[-1].index or any(each.containment or each in asked for each in pair):
            continue
        if metamodel.may_overlap(cls, one.owner) or metamodel.may_overlap(cls, one.target):
            yield one


def _mentioned_references(goals: Iterable[Goal]) -> Iterator[Reference | Attribute]:
    """Yield the references in goals, including those in negations and aggregates."""
    for goal in goals:
        if isinstance(goal, AbsenceAtom):
            for alternative in goal.alternatives:
                yield from _mentioned_references(alternative)
        elif isinstance(goal, AggregateAtom):
            yield from _mentioned_references([goal.relation])
        elif isinstance(goal, LinkAtom):
            yield goal.reference
