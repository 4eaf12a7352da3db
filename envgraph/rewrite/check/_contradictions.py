"""Detection of contradictory changes among the matches that one application of a rule executes together."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Any, Final, NamedTuple, cast

from envgraph.errors import EnvgraphError, RuleError
from envgraph.metamodel import Attribute, Metamodel, Reference
from envgraph.rewrite._rule_plan import (
    AddLink,
    AdjustAttribute,
    BlockPlan,
    ChangeTargets,
    DeleteObject,
    MergeObjects,
    MoveToContainer,
    Operation,
    RemoveLink,
    RetypeObject,
    SetAttribute,
    SetAttributeValues,
    SetTargets,
)
from envgraph.rewrite.check._claims import Claim

CanonicalLink = tuple[Reference, int, int]
"""A link in canonical direction, so that a link and its opposite are equal: see `Metamodel.canonical`."""

PARTIAL_CHANGE: Final = object()
"""Recorded in place of values or targets that are added or removed: such changes of several matches agree."""


class FreshObject(int):
    """A placeholder for the id of an object that is not created yet: a negative number, different for each object."""

    __slots__ = ()


class RequestedChange(NamedTuple):
    """A change that one match requests: an operation of a block plan, with the slot values of the match."""

    plan: BlockPlan
    slots: Sequence[Any]
    operation: Operation


class Contradiction(EnvgraphError):
    """An error about two requested changes that cannot both be made.

    Attributes:
        is_refused: True if the model refuses the two changes in any order.
        is_certain: False if the changes agree in a match in which their two values or containers are the same
            object. True if they contradict each other in every match.
    """

    def __init__(
        self,
        message: str,
        one: RequestedChange,
        other: RequestedChange,
        *,
        refused: bool = False,
        always: bool = True,
    ) -> None:
        super().__init__(message)
        self.changes = (one, other)
        self.is_refused = refused
        self.is_certain = always


class ConflictCheck:
    """A collection of the changes that all matches of an application request; it finds contradictory changes.

    Deleting an object twice, creating a link twice and setting a feature twice to one value are no contradictions. Two
    changes contradict each other if their order would decide the result: two objects that both become the only target
    of a third one, or a new link that a `set` of the same reference would remove.

    Args:
        metamodel: the metamodel of the model.
        describe: returns the text of an object, which may be `FreshObject`, for messages.
        strict: if True, two links that do not both fit into a single-valued reference are also a contradiction. If
            False, the model refuses them later.
    """

    def __init__(self, metamodel: Metamodel, describe: Callable[[int], str], *, strict: bool = False) -> None:
        self.metamodel = metamodel
        self._canonical = metamodel.canonical_link
        self.describe = describe
        self.strict = strict
        self._deleted: dict[int, tuple[int | None, RequestedChange]] = {}
        self._changed: dict[int, RequestedChange] = {}
        self._classes: dict[int, tuple[str, RequestedChange]] = {}
        self._values: dict[tuple[int, Attribute | Reference], tuple[Any, RequestedChange]] = {}
        self._elements: dict[tuple[int, Attribute, object], tuple[str, RequestedChange]] = {}
        self._removed: dict[CanonicalLink, RequestedChange] = {}
        self._added: dict[CanonicalLink, RequestedChange] = {}
        self._removed_targets: dict[CanonicalLink, RequestedChange] = {}
        self._ends: dict[tuple[int, Reference | None], tuple[object, RequestedChange, bool]] = {}
        self._features: list[tuple[int, str, RequestedChange]] = []

    def add_match(self, plan: BlockPlan, claims: Sequence[Claim], slots: Sequence[Any]) -> None:
        """Add the changes that one match of a block requests; `claims` has the claims of the block.

        Raises:
            RuleError: the match deletes an object or link that its own LHS also preserves ("identification").
            Contradiction: two of the changes added so far contradict each other.
        """
        self._check_identification(plan, slots)
        want: RequestedChange | None = None
        created = set[CanonicalLink]()
        for claim in claims:
            if claim.present is not None and slots[claim.present] is None:
                continue
            if want is None or want.operation is not claim.operation:
                want = RequestedChange(plan, slots, claim.operation)
            node, subject = slots[claim.node], cast(Any, claim.subject)
            match claim.kind:
                case "gone":
                    self._add_deletion(node, slots[claim.others[0]] if claim.others else None, want)
                case "touched":
                    self._changed.setdefault(node, want)
                case "class":
                    self._add_retyping(node, subject, want)
                case "owner":
                    self._features.append((node, subject, want))
                case "value":
                    self._add_value(node, subject, _new_value(claim, slots), want)
                case "element":
                    self._add_element(node, subject, slots[claim.others[0]], claim.operator, want)
                case "end":
                    end = slots[claim.others[0]]
                    self._add_single_end(
                        node, subject, end if claim.via is None else (end, claim.via), want, claim.forced
                    )
                case _:
                    arrow = self._canonical(subject, node, slots[claim.others[0]])
                    if claim.kind == "added":
                        self._added.setdefault(arrow, want)
                        if isinstance(claim.operation, AddLink):
                            created.add(arrow)
                    elif claim.kind == "withdrawn":
                        self._removed_targets.setdefault(arrow, want)
                    elif arrow not in created:  # a link that the same match removes and adds remains
                        self._removed.setdefault(arrow, want)

    def check_all(self) -> None:
        """Check for contradictions that only all changes together show, such as an object both deleted and changed.

        Raises:
            Contradiction: two changes contradict each other.
        """
        for node, (_, want) in self._deleted.items():
            if node in self._changed:
                raise Contradiction(f"{self.describe(node)} is both deleted and changed", want, self._changed[node])
        for arrow, want in self._added.items():
            self._check_added(arrow, want)
        for node, owner, want in self._features:
            if node in self._classes and not self.metamodel.is_a(self._classes[node][0], owner):
                cls, retyped = self._classes[node]
                raise Contradiction(
                    f"{self.describe(node)} is retyped to `{cls}`, but another change needs class `{owner}`",
                    retyped,
                    want,
                )

    @property
    def deleted(self) -> Collection[int]:
        """Return the ids of the objects that the added changes delete or merge into other objects."""
        return self._deleted.keys()

    @property
    def changed(self) -> Collection[int]:
        """Return the ids, also `FreshObject` ones, of objects that the added changes modify, retype, link or merge
        into.
        """
        return self._changed.keys()

    def _check_added(self, arrow: CanonicalLink, want: RequestedChange) -> None:
        removed = self._removed.get(arrow) or self._removed_targets.get(arrow)
        if removed is not None:
            raise Contradiction(f"{self._format_link(arrow)} is both removed and added", removed, want)
        reference, source, target = arrow
        for node, feature, other in (
            (source, reference, target),
            (target, self.metamodel.opposite(reference), source),
        ):
            if feature is None or (node, feature) not in self._values:
                continue
            targets, exact = self._values[node, feature]
            if targets is not PARTIAL_CHANGE and other not in targets:
                raise self._two_values_error(node, feature, (targets, exact), ((other,), want))

    def _check_identification(self, plan: BlockPlan, slots: Sequence[Any]) -> None:
        for gone, other in plan.identification_pairs:
            if slots[gone] == slots[other]:
                names = f"`{plan.names[gone]}` and `{plan.names[other]}`"
                message = f"{names} are one object, but only `{plan.names[gone]}` is deleted"
                span = next((delete.span for delete in plan.deletes if delete.node == gone), None)
                details = [self.describe(slots[gone])]
                raise RuleError(message, reason="identification", details=details, span=span)
        for gone_link, other_link in plan.identification_link_pairs:
            ends = slots[gone_link.source], slots[gone_link.target]
            same = slots[other_link.source], slots[other_link.target]
            if self._canonical(gone_link.reference, *ends) == self.metamodel.canonical_link(
                other_link.reference, *same
            ):
                message = f"two edges `{gone_link.reference.name}` are one link, but only one of them is deleted"
                details = [self.describe(end) for end in ends]
                raise RuleError(message, reason="identification", details=details, span=gone_link.span)

    # --- objects

    def _add_deletion(self, node: int, merged_into: int | None, want: RequestedChange) -> None:
        """Record a deletion (`merged_into` is None) or merge of an object. Raise a `Contradiction` if it has
        another.
        """
        other, earlier = self._deleted.setdefault(node, (merged_into, want))
        if other != merged_into:
            raise Contradiction(
                f"{self.describe(node)} is merged, but also deleted or merged into another object",
                earlier,
                want,
            )

    def _add_retyping(self, node: int, cls: str, want: RequestedChange) -> None:
        other, earlier = self._classes.setdefault(node, (cls, want))
        if other != cls:
            raise Contradiction(f"{self.describe(node)} is retyped to both `{other}` and `{cls}`", earlier, want)

    # --- links and values

    def _add_single_end(
        self, node: int, feature: Reference | None, value: object, want: RequestedChange, forced: bool
    ) -> None:
        """Record the only target of an object by a single-valued reference, or its container if `feature` is None.

        Raise a `Contradiction` if another target is recorded and one of the two is forced or `strict` is True.
        """
        other, earlier, others_forced = self._ends.setdefault((node, feature), (value, want, forced))
        if other == value:
            self._ends[node, feature] = other, earlier, others_forced or forced
        elif forced or others_forced or self.strict:
            refused = not (forced or others_forced)
            if feature is None:
                message = f"{self.describe(node)} gets two containers"
                raise Contradiction(message, earlier, want, refused=refused, always=False)
            raise self._two_values_error(node, feature, ((other,), earlier), ((value,), want), refused)

    def _add_value(self, node: int, feature: Attribute | Reference, value: object, want: RequestedChange) -> None:
        """Record the new value or targets of a feature. Raise a `Contradiction` if another value is recorded."""
        other, earlier = self._values.setdefault((node, feature), (value, want))
        if other != value:
            raise self._two_values_error(node, feature, (other, earlier), (value, want))

    def _add_element(
        self, node: int, attribute: Attribute, value: object, operator: str, want: RequestedChange
    ) -> None:
        """Record that a value is added to or removed from a value list. Raise a `Contradiction` if both happen."""
        other, earlier = self._elements.setdefault((node, attribute, value), (operator, want))
        if other != operator:
            message = f"{value!r} is both added to and removed from `{attribute.name}` of {self.describe(node)}"
            raise Contradiction(message, earlier, want, always=False)

    # --- messages

    def _two_values_error(
        self,
        node: int,
        feature: Attribute | Reference,
        one: tuple[object, RequestedChange],
        other: tuple[object, RequestedChange],
        refused: bool = False,
    ) -> Contradiction:
        texts = [self._format_value(feature, value) for value, _ in (one, other)]
        values = f": {texts[0]} and {texts[1]}" if None not in texts else ""
        message = f"{self.describe(node)} gets two values of `{feature}`{values}"
        return Contradiction(message, one[1], other[1], refused=refused, always=False)

    def _format_value(self, feature: Attribute | Reference, value: object) -> str | None:
        """Return the text of a value for messages, or None for lists and sums of attributes and for partial changes."""
        if value is PARTIAL_CHANGE:
            return None
        if isinstance(feature, Attribute):
            return None if isinstance(value, tuple) else "none" if value is None else repr(value)
        assert isinstance(value, tuple)
        return ", ".join(self.describe(target) for target in value) or "none"

    def _format_link(self, arrow: CanonicalLink) -> str:
        reference, source, target = arrow
        return f"{self.describe(source)} -{reference.name}-> {self.describe(target)}"


def _new_value(claim: Claim, slots: Sequence[Any]) -> object:
    """Return the value that a feature gets: a tuple of targets, one or many attribute values, or a partial change."""
    values = tuple(slots[slot] for slot in claim.others)
    if claim.operator:
        return (claim.operator, *values) if values else PARTIAL_CHANGE
    if isinstance(claim.subject, Reference):
        return tuple(target for target in values if target is not None)
    assert isinstance(claim.subject, Attribute)
    return values if claim.subject.many else values[0] if values else None


def format_change(want: RequestedChange, describe: Callable[[int], str]) -> str:
    """Format a match and its requested change on one line: `forall(a = `Item#0`): delete a`."""
    plan, slots, _ = want
    shown = [
        f"{name} = {_format_slot(plan, slots, slot, describe)}"
        for slot, name in enumerate(plan.names[: plan.inherited_count + plan.variable_count])
        if name and slots[slot] is not None and not isinstance(slots[slot], FreshObject)
    ]
    return f"{plan.kind}({', '.join(shown)}): {_format_operation(want, describe)}"


def _format_operation(want: RequestedChange, describe: Callable[[int], str]) -> str:
    """Format an operation in the syntax of `modify`."""
    plan, slots, operation = want

    def name(slot: int) -> str:
        return plan.names[slot] or _format_slot(plan, slots, slot, describe)

    match operation:
        case DeleteObject(node):
            return f"delete {name(node)}"
        case MergeObjects(kept, absorbed):
            return f"merge {name(kept)} <- {name(absorbed)}"
        case RetypeObject(node, cls):
            return f"retype {name(node)} : {cls}"
        case RemoveLink(source, reference, target):
            return f"delete {name(source)} -{reference.name}-> {name(target)}"
        case MoveToContainer(node, container, reference):
            return f"move {name(node)} to {name(container)}.{reference.name}"
        case AddLink(source, reference, target):
            return f"create {name(source)} -{reference.name}-> {name(target)}"
        case SetAttribute(node, attribute, value):
            return f"set {name(node)}.{attribute.name} = {'none' if value is None else name(value)}"
        case SetAttributeValues(node, attribute, values):
            return f"set {name(node)}.{attribute.name} = [{', '.join(map(name, values))}]"
        case AdjustAttribute(node, attribute, operator, value):
            return f"set {name(node)}.{attribute.name} {operator} {name(value)}"
        case SetTargets(node, reference, values):
            targets = [name(value) for value in values]
            text = targets[0] if len(targets) == 1 else f"[{', '.join(targets)}]" if targets else "none"
            return f"set {name(node)}.{reference.name} = {text}"
        case ChangeTargets(node, reference, operator, values):
            return f"set {name(node)}.{reference.name} {operator} {', '.join(name(value) for value in values)}"


def _format_slot(plan: BlockPlan, slots: Sequence[Any], slot: int, describe: Callable[[int], str]) -> str:
    value = slots[slot]
    if value is None:
        return "none"
    computed = next((each for each in plan.computed if each.slot == slot), None)
    is_object = plan.classes[slot] is not None or (computed is not None and computed.is_object)
    return describe(value) if is_object else repr(value)
