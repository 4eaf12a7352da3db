"""Plans of rules, worked out once: both notations, `rhs` and `modify`, end here.

A plan speaks of slots. The slots of a rule are the variables of its match, then the objects it creates, then the
values it computes; a nested block (`forall`, `optional`) sees the slots of the enclosing one and adds its own in the
same order. The parts of a plan are carried out in the order of the fields of `BlockPlan`, each for all matches of all
blocks before the next. Operations know where they stand in a text.
"""

from __future__ import annotations

from dataclasses import field
from typing import Literal

from envgraph.code import dataclass
from envgraph.errors import Span
from envgraph.metamodel import Attribute, Reference
from envgraph.pattern import Expression, StaticType


@dataclass(frozen=True, slots=True)
class Compute:
    """A value, computed on the state before the rule.

    Attributes:
        scope: slot and type of the variables it reads.
        needed: a path that leads nowhere is an error; else it is None.
        object: it is an object, or None.
    """

    slot: int
    expression: Expression
    scope: tuple[tuple[str, int, StaticType | None], ...]
    needed: bool = True
    object: bool = False


@dataclass(frozen=True, slots=True)
class Unlink:
    """Remove a link that the left side has; if it need not have it, `required` refuses the rule where it is missing."""

    source: int
    reference: Reference
    target: int
    required: bool = False
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Delete:
    """Delete an object."""

    node: int
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class ChangeClass:
    """Retype an object to exactly a class."""

    node: int
    cls: str
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class New:
    """Create an object of a class."""

    node: int
    cls: str


@dataclass(frozen=True, slots=True)
class Absorb:
    """Merge: links of `absorbed` go over to `kept`, and `absorbed` goes; in between the slot `links` keeps them."""

    kept: int
    absorbed: int
    links: int
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Rehome:
    """Move an object to a container; it leaves the old one before anything is linked."""

    node: int
    container: int
    reference: Reference
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Link:
    """Add a link; an existing one stays. A `target` slot without a value adds none."""

    source: int
    reference: Reference
    target: int
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class SetValue:
    """Set an attribute; `value` None clears it."""

    object: int
    attribute: Attribute
    value: int | None
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class SetValues:
    """Replace all values of an attribute with many."""

    object: int
    attribute: Attribute
    values: tuple[int, ...]
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Increase:
    """Add to an attribute, or subtract from it; the amounts of several matches add up.

    Of an attribute with many values it is one value that comes or goes.
    """

    object: int
    attribute: Attribute
    operator: Literal["+=", "-="]
    value: int
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class SetTargets:
    """Replace all targets of a reference."""

    object: int
    reference: Reference
    values: tuple[int, ...]
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class ChangeTargets:
    """Add targets to a many-valued reference, or remove some."""

    object: int
    reference: Reference
    operator: Literal["+=", "-="]
    values: tuple[int, ...]
    span: Span | None = field(default=None, compare=False, repr=False)


Assign = SetValue | SetValues | Increase | SetTargets | ChangeTargets


@dataclass(frozen=True, slots=True)
class BlockPlan:
    """A rule, or a block of it that rewrites.

    Attributes:
        pattern: qualified name of the pattern of its left side.
        arguments: slots of the enclosing block that the pattern takes as its leading arguments.
        inherited: number of slots of the enclosing block.
        names: name of every slot, for messages; computed values have the name "".
        classes: class on the left side of every slot that is an object then, else None.
        variables: number of slots that the match adds.
        coinciding: two variables may stand for one object.
        identified: pairs of slots where the first is deleted, and which may stand for one object; then the rule is
            refused (identification condition).
        identified_links: pairs of links, as for `identified`.
    """

    kind: Literal["rule", "forall", "forall+", "optional"]
    pattern: str
    arguments: tuple[int, ...]
    inherited: int
    names: tuple[str, ...]
    classes: tuple[str | None, ...]
    variables: int
    coinciding: bool
    identified: tuple[tuple[int, int], ...]
    identified_links: tuple[tuple[Unlink, Unlink], ...]
    computed: tuple[Compute, ...]
    unlinks: tuple[Unlink, ...]
    deletes: tuple[Delete, ...]
    retypes: tuple[ChangeClass, ...]
    creates: tuple[New, ...]
    absorbs: tuple[Absorb, ...]
    moves: tuple[Rehome, ...]
    links: tuple[Link, ...]
    sets: tuple[Assign, ...]
    nested: tuple[BlockPlan, ...]
    span: Span | None = field(default=None, compare=False)

    @property
    def operations(self) -> int:
        """How many things the block changes itself."""
        parts = (self.unlinks, self.deletes, self.retypes, self.creates, self.absorbs, self.moves, self.links)
        return sum(map(len, parts)) + len(self.sets)

    @property
    def contended(self) -> bool:
        """Whether objects that only values name may be changed otherwise, too."""
        computed = {each.slot for each in self.computed if each.object}
        named = [link.target for link in self.links]
        for change in self.sets:
            named += change.values if isinstance(change, SetTargets | ChangeTargets) else ()
        others = sum(map(len, (self.unlinks, self.deletes, self.retypes, self.absorbs, self.moves)))
        return not computed.isdisjoint(named) and (others > 0 or len(named) > 1)

    @property
    def kept(self) -> tuple[int, ...]:
        """Slots of the objects that the block finds and does not delete."""
        gone = {delete.node for delete in self.deletes} | {absorb.absorbed for absorb in self.absorbs}
        return tuple(slot for slot, cls in enumerate(self.classes) if cls is not None and slot not in gone)

    @property
    def slots(self) -> int:
        """Number of slots, those of the enclosing block included."""
        return len(self.names)


@dataclass(frozen=True, slots=True)
class RulePlan:
    """A rule, checked and worked out.

    Attributes:
        name: qualified name.
        parameters: names of the parameters, in order.
        variables: names of the match: parameters that the left side binds, then the other variables.
        types: their types.
        inputs: variables that only a caller can bind.
        outputs: name and slot of every `out` parameter.
        lossy: SPO: dangling links and links that a retyping cannot keep are removed instead of refused.
        exact: the class, if the left side is `x : Class` without subclasses and nothing else.
    """

    name: str
    weight: float
    priority: int
    parameters: tuple[str, ...]
    variables: tuple[str, ...]
    types: tuple[StaticType, ...]
    inputs: tuple[str, ...]
    outputs: tuple[tuple[str, int], ...]
    lossy: bool
    body: BlockPlan
    exact: str | None = None
    span: Span | None = field(default=None, compare=False, repr=False)

    @property
    def blocks(self) -> list[BlockPlan]:
        """The rule itself, and the blocks of it that rewrite, outer ones first."""
        found = [self.body]
        for block in found:
            found += block.nested
        return found
