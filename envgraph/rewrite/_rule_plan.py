"""Plans of rules: the checked, resolved form to which both notations, `rhs` and `modify`, are translated.

A plan refers to variables by slots (numbers). The slots of a rule are the variables of its match, then the objects it
creates, then the values it computes. A nested block (`forall`, `optional`) has the slots of the enclosing block,
followed by its own in the same order. The fields of `BlockPlan` are executed in their order of definition; each field
is executed for all matches of all blocks before the next field. Operations carry the span of their source text.
"""

from __future__ import annotations

from dataclasses import field
from typing import Literal

from envgraph.code import dataclass
from envgraph.errors import Span
from envgraph.metamodel import Attribute, Reference
from envgraph.pattern import Expression, StaticType


@dataclass(frozen=True, slots=True)
class ComputeValue:
    """A value that is computed on the state before the rule and stored in a slot.

    Attributes:
        variables: name, slot and type of each variable that the expression reads.
        is_required: True if a missing value (a path over an empty reference) is an error; if False, the value is
            then None.
        is_object: True if the value is an object or None.
    """

    slot: int
    expression: Expression
    variables: tuple[tuple[str, int, StaticType | None], ...]
    is_required: bool = True
    is_object: bool = False


@dataclass(frozen=True, slots=True)
class RemoveLink:
    """An operation that removes a link. If `is_required` (unmatched `redirect`), the rule is refused without the
    link.
    """

    source: int
    reference: Reference
    target: int
    is_required: bool = False
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class DeleteObject:
    """An operation that deletes an object."""

    node: int
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class RetypeObject:
    """An operation that retypes an object to exactly the class `cls`."""

    node: int
    cls: str
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class CreateObject:
    """An operation that creates an object of the class `cls`."""

    node: int
    cls: str


@dataclass(frozen=True, slots=True)
class MergeObjects:
    """An operation that merges `absorbed` into `kept`: all links are moved to `kept`, then `absorbed` is deleted.

    The slot `links_slot` stores the links of `absorbed` until they are added to `kept`.
    """

    kept: int
    absorbed: int
    links_slot: int
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class MoveToContainer:
    """An operation that moves an object to another container. It leaves the old container before links are added."""

    node: int
    container: int
    reference: Reference
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class AddLink:
    """An operation that adds a link. It changes nothing if the link exists or if the `target` slot is None."""

    source: int
    reference: Reference
    target: int
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class SetAttribute:
    """An operation that sets a single-valued attribute to the value of a slot, or clears it if `value` is None."""

    object: int
    attribute: Attribute
    value: int | None
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class SetAttributeValues:
    """An operation that replaces all values of a multi-valued attribute."""

    object: int
    attribute: Attribute
    values: tuple[int, ...]
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class AdjustAttribute:
    """An operation that adds an amount to an attribute or subtracts it; amounts of several matches are added up.

    For a multi-valued attribute, the operation inserts or removes one value.
    """

    object: int
    attribute: Attribute
    operator: Literal["+=", "-="]
    value: int
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class SetTargets:
    """An operation that replaces all targets of a reference."""

    object: int
    reference: Reference
    values: tuple[int, ...]
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class ChangeTargets:
    """An operation that adds targets to a multi-valued reference, or removes targets from it."""

    object: int
    reference: Reference
    operator: Literal["+=", "-="]
    values: tuple[int, ...]
    span: Span | None = field(default=None, compare=False, repr=False)


AssignOperation = SetAttribute | SetAttributeValues | AdjustAttribute | SetTargets | ChangeTargets
Operation = RemoveLink | DeleteObject | RetypeObject | MergeObjects | MoveToContainer | AddLink | AssignOperation


@dataclass(frozen=True, slots=True)
class BlockPlan:
    """The plan of a rule, or of a nested block with a right-hand side (RHS).

    Attributes:
        pattern: qualified name of the pattern that is the LHS of the block.
        arguments: slots of the enclosing block that the pattern takes as its leading arguments.
        inherited_count: number of slots of the enclosing block.
        names: name of every slot, for messages; computed values have the name "".
        classes: for every slot, the class of its object in the LHS; None if the slot is no object of the LHS.
        variable_count: number of slots that the match adds.
        may_coincide: True if two variables may refer to the same object.
        identification_pairs: pairs of slots that may refer to the same object, of which the first is deleted. The
            rule is refused if they do (identification condition).
        identification_link_pairs: pairs of links that may be the same link, of which the first is deleted; also
            refused.
    """

    kind: Literal["rule", "forall", "forall+", "optional"]
    pattern: str
    arguments: tuple[int, ...]
    inherited_count: int
    names: tuple[str, ...]
    classes: tuple[str | None, ...]
    variable_count: int
    may_coincide: bool
    identification_pairs: tuple[tuple[int, int], ...]
    identification_link_pairs: tuple[tuple[RemoveLink, RemoveLink], ...]
    computed: tuple[ComputeValue, ...]
    unlinks: tuple[RemoveLink, ...]
    deletes: tuple[DeleteObject, ...]
    retypes: tuple[RetypeObject, ...]
    creates: tuple[CreateObject, ...]
    absorbs: tuple[MergeObjects, ...]
    moves: tuple[MoveToContainer, ...]
    links: tuple[AddLink, ...]
    sets: tuple[AssignOperation, ...]
    nested: tuple[BlockPlan, ...]
    span: Span | None = field(default=None, compare=False)

    @property
    def operations(self) -> tuple[Operation | CreateObject, ...]:
        """Return the operations of this block, without those of nested blocks, in the order of their execution."""
        found: list[Operation | CreateObject] = [*self.unlinks, *self.deletes, *self.retypes, *self.creates]
        return (*found, *self.absorbs, *self.moves, *self.links, *self.sets)

    @property
    def may_contradict(self) -> bool:
        """Return True if two matches of a rule, or two variables for one object, may ask for different changes."""
        return bool(self.nested) or self.may_coincide or self.has_contended_objects

    @property
    def has_contended_objects(self) -> bool:
        """Return True if a computed object becomes a target and another operation of this block may change it too."""
        computed = {each.slot for each in self.computed if each.is_object}
        named = [link.target for link in self.links]
        for change in self.sets:
            named += change.values if isinstance(change, SetTargets | ChangeTargets) else ()
        others = sum(map(len, (self.unlinks, self.deletes, self.retypes, self.absorbs, self.moves)))
        return not computed.isdisjoint(named) and (others > 0 or len(named) > 1)

    @property
    def preserved_slots(self) -> tuple[int, ...]:
        """Return the slots of matched objects, also of enclosing blocks, that this block neither deletes nor merges."""
        gone = {delete.node for delete in self.deletes} | {absorb.absorbed for absorb in self.absorbs}
        return tuple(slot for slot, cls in enumerate(self.classes) if cls is not None and slot not in gone)

    @property
    def slot_count(self) -> int:
        """Return the number of slots, including the slots of the enclosing block."""
        return len(self.names)


@dataclass(frozen=True, slots=True)
class RulePlan:
    """The plan of a whole rule without errors.

    Attributes:
        name: qualified name.
        parameters: names of the parameters, in order.
        variables: names of the variables of a match: parameters that the LHS binds, then the other variables.
        types: types of `variables`, in the same order.
        inputs: variables that only a caller can bind.
        outputs: name and slot of every `out` parameter.
        is_spo: True under SPO semantics: dangling links, and links that a retyped object cannot keep, are removed. If
            False (DPO), the rule is refused.
        exact_class: the class `C` if the LHS consists only of `x : C` without subclasses, else None.
    """

    name: str
    weight: float
    priority: int
    parameters: tuple[str, ...]
    variables: tuple[str, ...]
    types: tuple[StaticType, ...]
    inputs: tuple[str, ...]
    outputs: tuple[tuple[str, int], ...]
    is_spo: bool
    body: BlockPlan
    exact_class: str | None = None
    span: Span | None = field(default=None, compare=False, repr=False)

    @property
    def blocks(self) -> list[BlockPlan]:
        """Return the plans of the rule and of all nested blocks that have an RHS, outer blocks first."""
        found = [self.body]
        for block in found:
            found += block.nested
        return found
