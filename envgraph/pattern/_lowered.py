"""The resolved, normalised form of a pattern, which matchers compile.

Variables are numbered within a body: parameters first, in their order, then local ones. Paths are split into
single steps, nested terms have become variables of their own, variables equal to each other are one variable,
every class and feature is resolved, and every parameter type is an atom.
"""

from __future__ import annotations

from dataclasses import field
from typing import Literal

from envgraph.code import dataclass
from envgraph.errors import Span
from envgraph.metamodel import Attribute, AttributeType, Reference, Value
from envgraph.pattern._queries import Closure
from envgraph.pattern._terms import Expression


@dataclass(frozen=True, slots=True)
class ObjectType:
    """The static type of a variable that stands for an object: an instance of this class."""

    cls: str


StaticType = ObjectType | AttributeType


@dataclass(frozen=True, slots=True)
class InstanceAtom:
    """`variable` is an object of class `cls` (of exactly that class, if `exact`)."""

    cls: str
    variable: int
    exact: bool = False


@dataclass(frozen=True, slots=True)
class AttributeAtom:
    """`object` has `value` in an attribute with one; an attribute without a value has no tuple."""

    attribute: Attribute
    object: int
    value: int


@dataclass(frozen=True, slots=True)
class LinkAtom:
    """There is a link from `source` to `target`, or `target` is one of the values of an attribute with many."""

    reference: Reference | Attribute
    source: int
    target: int


@dataclass(frozen=True, slots=True)
class CallAtom:
    """The tuple of `arguments` is a match of the pattern with this qualified name."""

    pattern: str
    arguments: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class ClosureAtom:
    """`target` is reached from `source` by one or more (`+`) or any number (`*`) of steps.

    A step is a match of the binary pattern `step`; `closure` is never `ONCE`. A path with closure is lowered to a
    generated binary pattern. With `*`, source and target are also related when they are the same object (of
    the step's source type).
    """

    step: str
    closure: Closure
    source: int
    target: int


RelationAtom = InstanceAtom | AttributeAtom | LinkAtom | CallAtom | ClosureAtom


@dataclass(frozen=True, slots=True)
class NegationAtom:
    """No tuple of `relation` agrees with the variables of the body; `local` variables are free inside."""

    relation: RelationAtom
    local: frozenset[int]


@dataclass(frozen=True, slots=True)
class AggregateAtom:
    """`result` is the aggregate over the tuples of `relation` that agree with the variables of the body.

    Attributes:
        local: variables that are free inside; distinct tuples of the relation are aggregated.
        column: the local variable that `#` marks; None for count.
    """

    function: Literal["count", "sum", "min", "max", "avg"]
    relation: RelationAtom
    local: frozenset[int]
    result: int
    column: int | None = None


@dataclass(frozen=True, slots=True)
class UnequalAtom:
    """The two variables have different values."""

    left: int
    right: int


@dataclass(frozen=True, slots=True)
class CheckAtom:
    """A boolean expression over the variables holds.

    Navigation is gone from the expression, enum literals are string constants, and every `Variable` in it is named
    by `names[i]` of the body for the variable number i. `variables` lists the numbers it reads.
    """

    expression: Expression
    variables: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class EvaluationAtom:
    """`result` has the value of an expression (as in `CheckAtom`); no value, no match."""

    expression: Expression
    variables: tuple[int, ...]
    result: int


Atom = RelationAtom | NegationAtom | AggregateAtom | UnequalAtom | CheckAtom | EvaluationAtom


@dataclass(frozen=True, slots=True)
class LoweredBody:
    """One conjunction.

    Attributes:
        names: unique name of every variable; an identifier, or "#n" for one that no text names.
        types: static type of every variable.
        constants: value of every variable that is fixed, in the order of the numbers.
        aliases: parameter number -> number of the variable that stands for it, for parameters united with others.
        atoms: in the order of the text.
        spans: of each atom the constraint that it comes from, if that was read from a text.
    """

    names: tuple[str, ...]
    types: tuple[StaticType, ...]
    constants: tuple[tuple[int, Value], ...]
    aliases: tuple[tuple[int, int], ...]
    atoms: tuple[Atom, ...]
    spans: tuple[Span | None, ...] = field(default=(), compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class LoweredPattern:
    """A resolved pattern; its matches are the union over the bodies, projected to the parameters.

    Attributes:
        inputs: numbers of the `in` parameters that nothing enumerates; whoever asks has to bind them.
    """

    name: str
    parameters: tuple[str, ...]
    types: tuple[StaticType, ...]
    bodies: tuple[LoweredBody, ...]
    inputs: tuple[int, ...] = ()
