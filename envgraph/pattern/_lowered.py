"""The resolved, normalised form of a pattern: the one representation of a conjunction from the library to the plan.

Variables are numbered within a body: parameters first, in their order, then local ones. Paths are split into
single steps, nested terms have become variables of their own, variables equal to each other are one variable,
every class and feature is resolved, and every parameter type is an atom.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace
from typing import Literal, TypeGuard

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
class Condition:
    """A boolean expression holds.

    Attributes:
        expression: without navigation; enum literals are string constants.
        reads: each name in the expression with the number of the variable that it stands for.
    """

    expression: Expression
    reads: tuple[tuple[str, int], ...]


@dataclass(frozen=True, slots=True)
class Valuation:
    """`result` has the value of an expression (as in `Condition`); no value, no match."""

    expression: Expression
    reads: tuple[tuple[str, int], ...]
    result: int


@dataclass(frozen=True, slots=True)
class Absence:
    """None of the alternatives has a solution.

    Attributes:
        alternatives: conjunctions; one relation as a text says it, more when called patterns are inlined.
        outer: the variables of the body that stand inside; all others there are free.
    """

    alternatives: tuple[tuple[Goal, ...], ...]
    outer: tuple[int, ...]


Goal = RelationAtom | UnequalAtom | Condition | Valuation | AggregateAtom | Absence
"""One constraint of a conjunction."""


@dataclass(frozen=True, slots=True)
class Conjunction:
    """One body: what planners order and views are made of.

    Attributes:
        types: static type of every variable.
        constants: value of every variable that is fixed.
        parameters: for each parameter the number of the variable that stands for it: its own, or the one it equals.
        goals: what must hold; of a pattern as it is written, in the order of the text.
        names: unique name of every variable that the body as it is written has; an identifier, or "#n" for one that
            no text names. Variables of inlined bodies follow without names.
        spans: of each goal of a body as it is written the constraint that it comes from, if that was read from a
            text; () after goals have been rewritten.
    """

    types: tuple[StaticType, ...]
    constants: tuple[tuple[int, Value], ...]
    parameters: tuple[int, ...]
    goals: tuple[Goal, ...]
    names: tuple[str, ...] = field(default=(), compare=False, repr=False)
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
    bodies: tuple[Conjunction, ...]
    inputs: tuple[int, ...] = ()


def is_relation(goal: Goal) -> TypeGuard[RelationAtom]:
    """Return whether a goal is met by the tuples of one relation."""
    return isinstance(goal, InstanceAtom | AttributeAtom | LinkAtom | CallAtom | ClosureAtom)


def arguments(relation: RelationAtom) -> tuple[int, ...]:
    """The variables of a relation, in the order of its columns."""
    match relation:
        case InstanceAtom(_, variable):
            return (variable,)
        case AttributeAtom(_, owner, value):
            return (owner, value)
        case LinkAtom(_, source, target) | ClosureAtom(_, _, source, target):
            return (source, target)
        case CallAtom(_, variables):
            return variables


def inputs(goal: Goal) -> tuple[int, ...]:
    """The variables that must have a value before the goal can be met; relations need none."""
    match goal:
        case Condition(_, reads) | Valuation(_, reads):
            return tuple(variable for _, variable in reads)
        case AggregateAtom():
            return tuple(v for v in arguments(goal.relation) if v not in goal.local)
        case Absence(_, outer):
            return outer
        case UnequalAtom(left, right):
            return (left, right)
        case _:
            return ()


def outputs(goal: Goal) -> tuple[int, ...]:
    """The variables that the goal can give a value."""
    match goal:
        case Valuation() | AggregateAtom():
            return (goal.result,)
        case Condition() | Absence() | UnequalAtom():
            return ()
        case _:
            return arguments(goal)


def variables(goal: Goal) -> tuple[int, ...]:
    """All variables of a goal that its surroundings can see; some may stand twice."""
    return (*inputs(goal), *outputs(goal))


def mentioned(goal: Goal) -> tuple[int, ...]:
    """All variables of a goal, those that are free inside a negation or an aggregate as well; some may stand twice."""
    match goal:
        case Absence(alternatives):
            return tuple(v for alternative in alternatives for inner in alternative for v in mentioned(inner))
        case AggregateAtom():
            return (*arguments(goal.relation), goal.result)
        case _:
            return variables(goal)


def renumbered(goal: Goal, numbers: Mapping[int, int]) -> Goal:
    """The same goal over other variables: each replaced by what `numbers` has for it."""

    def reads(pairs: tuple[tuple[str, int], ...]) -> tuple[tuple[str, int], ...]:
        return tuple((name, numbers[number]) for name, number in pairs)

    match goal:
        case Condition():
            return replace(goal, reads=reads(goal.reads))
        case Valuation():
            return replace(goal, reads=reads(goal.reads), result=numbers[goal.result])
        case UnequalAtom(left, right):
            return UnequalAtom(numbers[left], numbers[right])
        case Absence(alternatives, outer):
            return Absence(
                tuple(tuple(renumbered(g, numbers) for g in alternative) for alternative in alternatives),
                tuple(dict.fromkeys(numbers[number] for number in outer)),
            )
        case AggregateAtom():
            return replace(
                goal,
                relation=renumbered_relation(goal.relation, numbers),
                local=frozenset(numbers[number] for number in goal.local),
                result=numbers[goal.result],
                column=None if goal.column is None else numbers[goal.column],
            )
        case _:
            return renumbered_relation(goal, numbers)


def renumbered_relation(relation: RelationAtom, numbers: Mapping[int, int]) -> RelationAtom:
    """The same relation over other variables."""
    match relation:
        case InstanceAtom():
            return replace(relation, variable=numbers[relation.variable])
        case AttributeAtom():
            return replace(relation, object=numbers[relation.object], value=numbers[relation.value])
        case LinkAtom() | ClosureAtom():
            return replace(relation, source=numbers[relation.source], target=numbers[relation.target])
        case CallAtom():
            return replace(relation, arguments=tuple(numbers[v] for v in relation.arguments))
