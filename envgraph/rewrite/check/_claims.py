"""Claims: what the operations of a rule require of the objects, links and values of a match, as data.

The matches of one application, and the variables of one match that are one object, have to agree on their claims.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Literal

from envgraph.code import dataclass
from envgraph.metamodel import Attribute, Feature, Metamodel, Reference, Scalar
from envgraph.rewrite._rule_plan import (
    AddLink,
    AdjustAttribute,
    BlockPlan,
    ChangeTargets,
    CreateObject,
    DeleteObject,
    MergeObjects,
    MoveToContainer,
    Operation,
    RetypeObject,
    RulePlan,
    SetAttribute,
    SetAttributeValues,
    SetTargets,
)

ClaimKind = Literal["gone", "touched", "class", "owner", "value", "element", "removed", "withdrawn", "added", "end"]


@dataclass(frozen=True, slots=True)
class Claim:
    """A requirement of one operation. Two claims about one object, link or value contradict each other as follows.

    - "gone" contradicts "touched", and "gone" with another object to merge into.
    - "class", the new class of an object, contradicts another class, and an "owner" that is no superclass of it.
    - "value", the new value or targets of a feature, contradicts another value, and a link "added" to another target.
    - "element", a value added to or removed from a list, contradicts the other operator.
    - "removed" (by `delete`) and "withdrawn" (by `-=`) contradict "added", unless one match removes and creates a link.
    - "end", the only target of an object or its container, contradicts another end if one of the two is `forced`.

    Attributes:
        node: slot of the object that the claim is about; of the source of a link in canonical direction.
        subject: the feature, or the class; None for the container.
        others: slots of the new values or targets, of the other end of a link, or of the object to merge into.
        present: slot of an object that may be missing, in which case the claim is void.
        forced: True if the operation replaces other links.
        via: the reference of a link to a container.
        operator: the operator of a change of a feature, empty if all its values are replaced. Without `others`,
            changes of several matches agree.
    """

    kind: ClaimKind
    operation: Operation
    node: int
    subject: Attribute | Reference | str | None = None
    others: tuple[int, ...] = ()
    present: int | None = None
    forced: bool = False
    via: Reference | None = None
    operator: str = ""


def claims_of(plan: BlockPlan, metamodel: Metamodel) -> Iterator[Claim]:
    """Yield all claims of a match of a rule or block, without nested blocks, in the order of execution."""
    for delete in plan.deletes:
        yield Claim("gone", delete, delete.node)
    for absorb in plan.absorbs:
        yield Claim("touched", absorb, absorb.kept)
        yield Claim("gone", absorb, absorb.absorbed, others=(absorb.kept,))
    for retype in plan.retypes:
        yield Claim("touched", retype, retype.node)
        yield Claim("class", retype, retype.node, retype.cls)
    for move in plan.moves:
        yield from _link_claims(metamodel, move, move.reference, move.container, move.node, forced=True)
    for link in plan.links:
        yield from _link_claims(metamodel, link, link.reference, link.source, link.target, forced=False)
    for change in plan.sets:
        node, feature = (
            change.object,
            change.reference if isinstance(change, SetTargets | ChangeTargets) else change.attribute,
        )
        yield Claim("touched", change, node)
        yield Claim("owner", change, node, feature.owner)
        match change:
            case SetAttribute(_, _, value):
                yield Claim("value", change, node, feature, () if value is None else (value,))
            case SetAttributeValues(_, _, values):
                yield Claim("value", change, node, feature, values)
            case AdjustAttribute(_, attribute, operator, value):
                # Additions to strings contradict each other, because their order changes the result.
                text = attribute.type is Scalar.STRING and not attribute.many
                yield Claim("value", change, node, feature, (value,) if text else (), operator=operator)
                if attribute.many:
                    yield Claim("element", change, node, feature, (value,), operator=operator)
            case SetTargets(_, reference, values):
                yield Claim("value", change, node, feature, values)
                for value in values:
                    yield from _link_claims(metamodel, change, reference, node, value, forced=True)
            case ChangeTargets(_, reference, operator, values):
                yield Claim("value", change, node, feature, operator=operator)
                for value in values:
                    if operator == "+=":
                        yield from _link_claims(metamodel, change, reference, node, value, forced=True)
                    else:
                        first, source, target = metamodel.canonical_link(reference, node, value)
                        yield Claim("withdrawn", change, source, first, (target,), value)
    for unlink in plan.unlinks:
        first, source, target = metamodel.canonical_link(unlink.reference, unlink.source, unlink.target)
        yield Claim("removed", unlink, source, first, (target,))


def _link_claims(
    metamodel: Metamodel, operation: Operation, reference: Reference, source: int, target: int, *, forced: bool
) -> Iterator[Claim]:
    """Yield the claims of an operation that adds a link."""
    opposite = metamodel.opposite(reference)
    yield Claim("touched", operation, source, present=target)
    yield Claim("touched", operation, target, present=target)
    yield Claim("owner", operation, source, reference.owner, present=target)
    yield Claim("owner", operation, target, reference.target, present=target)
    first, start, end = metamodel.canonical_link(reference, source, target)
    yield Claim("added", operation, start, first, (end,), target)
    if opposite == reference:
        yield Claim("added", operation, end, first, (start,), target)
    if reference.upper == 1:
        yield Claim("end", operation, source, reference, (target,), target, forced)
    if opposite is not None and opposite.upper == 1:
        yield Claim("end", operation, target, opposite, (source,), target, forced)
    if (held := metamodel.containment_link(reference, source, target)) is not None:
        contains, container, content = held
        yield Claim("end", operation, content, None, (container,), target, forced, contains)


def endangered_classes(blocks: Iterable[BlockPlan], metamodel: Metamodel) -> set[str]:
    """Return classes of variables whose objects may be deleted together with an object that a block deletes."""
    classes = dict.fromkeys(block.classes[delete.node] or "" for block in blocks for delete in block.deletes)
    deleted = (sub for cls in classes for sub in metamodel.concrete_classes(cls))
    return {above for cls in metamodel.all_content_classes(deleted) for above in metamodel.supertypes(cls)}


def kept_objects(plan: BlockPlan, metamodel: Metamodel) -> dict[int, str]:
    """Return the slots of objects that a block preserves or changes, each with a class of the object.

    Objects that enclosing blocks match are left out, since these preserve them too.
    """
    kept = {slot: plan.classes[slot] or "" for slot in plan.preserved_slots if slot >= plan.inherited_count}
    for claim in claims_of(plan, metamodel):
        if claim.kind == "owner" and plan.classes[claim.node] is None:
            kept.setdefault(claim.node, str(claim.subject))
    return kept


def may_be_refused(plan: RulePlan, metamodel: Metamodel) -> bool:
    """Return True if the model may refuse a rule at a match, so that a unit tries another match.

    Contradictions between matches do not count: they are errors.
    """
    endangered = endangered_classes(plan.blocks, metamodel)
    return any(
        block.identification_pairs
        or block.identification_link_pairs
        or any(unlink.is_required for unlink in block.unlinks)
        or not endangered.isdisjoint(kept_objects(block, metamodel).values())
        or any(may_refuse(operation, block, metamodel, lossy=plan.is_spo) for operation in block.operations)
        for block in plan.blocks
    )


def may_refuse(operation: Operation | CreateObject, plan: BlockPlan, metamodel: Metamodel, *, lossy: bool) -> bool:
    """Return True if the model may refuse an operation of a block; `lossy` under SPO semantics.

    Values that are missing or out of range are no refusals.
    """
    match operation:
        case DeleteObject(node):
            cls = metamodel.concrete_classes(plan.classes[node] or "")
            gone = {*cls, *metamodel.all_content_classes(cls)}
            return not lossy and any(
                metamodel.is_a(one, end)
                for reference in metamodel.references
                if metamodel.containment_link(reference, 0, 1) is None
                for end in (reference.owner, reference.target)
                for one in gone
            )
        case RetypeObject(node, new):
            return not lossy and any(
                metamodel.is_a(one, end) and not metamodel.is_a(new, end)
                for reference in metamodel.references
                for end in (reference.owner, reference.target)
                for one in metamodel.concrete_classes(plan.classes[node] or "")
            )
        case MoveToContainer(_, _, held) | SetTargets(_, held, (_, *_)) | ChangeTargets(_, held, "+="):
            return bool(bounded_features(operation, metamodel)) or _may_close_cycle(held, metamodel)
        case AddLink(_, reference) if reference.containment:
            return True
        case _:
            return isinstance(operation, MergeObjects) or bool(bounded_features(operation, metamodel))


def bounded_features(operation: Operation | CreateObject, metamodel: Metamodel) -> list[tuple[int, Feature]]:
    """Return the features that an operation may fill beyond their upper bounds, each after the slot of its object."""
    ends: list[tuple[int, Feature | None]] = []
    match operation:
        case AdjustAttribute(node, attribute, "+=") | SetAttributeValues(node, attribute):
            ends = [(node, attribute)] if attribute.many else []
        case MoveToContainer(_, container, reference):
            ends = [(container, reference)]
        case AddLink(source, reference, target):
            ends = [(source, reference), (target, metamodel.opposite(reference))]
        case SetTargets(node, reference, (_, *_) as targets) | ChangeTargets(node, reference, "+=", targets):
            both = [(node, reference), *((target, metamodel.opposite(reference)) for target in targets)]
            ends = [(slot, end) for slot, end in both if end is not None and end.many]  # others replace their link
    return [(slot, end) for slot, end in ends if end is not None and end.upper is not None]


def _may_close_cycle(reference: Reference, metamodel: Metamodel) -> bool:
    """Return True if a reference is a containment or its opposite, and its contents may contain its containers."""
    held = metamodel.containment_link(reference, reference.owner, reference.target)
    inside = metamodel.all_content_classes(metamodel.concrete_classes(held[2])) if held else ()
    return held is not None and any(metamodel.may_overlap(one, held[1]) for one in inside)
