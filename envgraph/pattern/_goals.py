"""The lowered (resolved and normalised) form of patterns, which all passes, planners and views use.

Variables are numbered within a body: first the parameters in their order, then local variables. Paths are split into
single steps. Nested terms have variables of their own. Variables that are equal to each other are one variable. Every
class and feature is resolved. The declared class of a parameter is a goal, unless other goals imply it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace
from typing import Literal, TypeGuard

from envgraph.code import dataclass
from envgraph.errors import Span
from envgraph.metamodel import Attribute, AttributeType, Reference, Value
from envgraph.pattern._expression_data import Expression
from envgraph.pattern._query_data import Closure


@dataclass(frozen=True, slots=True)
class ObjectType:
    """The static type of a variable for objects: an instance of this class."""

    cls: str


StaticType = ObjectType | AttributeType


@dataclass(frozen=True, slots=True)
class InstanceAtom:
    """The goal that `variable` is an object of class `cls` (a direct instance, if `exact`)."""

    cls: str
    variable: int
    exact: bool = False


@dataclass(frozen=True, slots=True)
class AttributeAtom:
    """The goal that `object` has `value` in a single-valued attribute. It fails if the attribute is unset."""

    attribute: Attribute
    object: int
    value: int


@dataclass(frozen=True, slots=True)
class LinkAtom:
    """The goal that `source` has a link to `target`, or `target` as a value of a multi-valued attribute."""

    reference: Reference | Attribute
    source: int
    target: int


@dataclass(frozen=True, slots=True)
class CallAtom:
    """The goal that the tuple of `arguments` is a match of the pattern with this qualified name."""

    pattern: str
    arguments: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class ClosureAtom:
    """The goal that `target` can be reached from `source` by one or more (`+`) or any number (`*`) of steps.

    A step is a match of the binary pattern `step`. `closure` is never `ONCE`. A path with a closure is lowered to a
    generated binary pattern. With `*`, each object of the step's source type is also related to itself.
    """

    step: str
    closure: Closure
    source: int
    target: int


RelationAtom = InstanceAtom | AttributeAtom | LinkAtom | CallAtom | ClosureAtom


@dataclass(frozen=True, slots=True)
class AggregateAtom:
    """The goal that `result` is the aggregate over the tuples of `relation` that agree with the variables of the body.

    Attributes:
        local: variables that occur only inside the aggregate. Each tuple of the relation is counted once.
        column: the local variable marked by `#`, whose values are aggregated; None for count.
    """

    function: Literal["count", "sum", "min", "max", "avg"]
    relation: RelationAtom
    local: frozenset[int]
    result: int
    column: int | None = None


@dataclass(frozen=True, slots=True)
class UnequalAtom:
    """The goal that two variables have different values."""

    left: int
    right: int


@dataclass(frozen=True, slots=True)
class ConditionAtom:
    """The goal that a boolean expression is true.

    Attributes:
        expression: an expression without navigation, in which enum literals are string constants.
        reads: each name in the expression, with the number of its variable.
    """

    expression: Expression
    reads: tuple[tuple[str, int], ...]


@dataclass(frozen=True, slots=True)
class ValuationAtom:
    """The goal that `result` has the value of an expression (as in `ConditionAtom`). It fails if there is no value."""

    expression: Expression
    reads: tuple[tuple[str, int], ...]
    result: int


@dataclass(frozen=True, slots=True)
class AbsenceAtom:
    """The goal that none of the alternatives has a solution.

    Attributes:
        alternatives: conjunctions of goals. A negation as written has one relation; inlining patterns can add more.
        outer: the variables of the body that occur inside. All other variables inside are local.
    """

    alternatives: tuple[tuple[Goal, ...], ...]
    outer: tuple[int, ...]


Goal = RelationAtom | UnequalAtom | ConditionAtom | ValuationAtom | AggregateAtom | AbsenceAtom
"""A constraint of a conjunction."""


@dataclass(frozen=True, slots=True)
class Conjunction:
    """The lowered form of one body, which planners order and views are built from.

    Attributes:
        types: the static type of every variable.
        constants: the value of every fixed variable.
        parameters: for each parameter the number of its variable, or of the variable that it equals.
        goals: the goals that must hold; in the order of the text, unless they were rewritten.
        names: the unique name of every variable of the written body: an identifier, or "#n" if it has no name in the
            text. Variables of inlined bodies follow without names.
        spans: for each goal of a written body the span of its constraint, or None; () after goals were rewritten.
    """

    types: tuple[StaticType, ...]
    constants: tuple[tuple[int, Value], ...]
    parameters: tuple[int, ...]
    goals: tuple[Goal, ...]
    names: tuple[str, ...] = field(default=(), compare=False, repr=False)
    spans: tuple[Span | None, ...] = field(default=(), compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class LoweredPattern:
    """A resolved pattern. Its matches are the matches of all its bodies, restricted to the parameters.

    Attributes:
        inputs: numbers of the `in` parameters that the pattern does not enumerate, so that callers must bind them.
    """

    name: str
    parameters: tuple[str, ...]
    types: tuple[StaticType, ...]
    bodies: tuple[Conjunction, ...]
    inputs: tuple[int, ...] = ()


def is_relation(goal: Goal) -> TypeGuard[RelationAtom]:
    """Return True if the goal is an atom of a relation: a class, attribute, link, call or closure, without negation."""
    return isinstance(goal, InstanceAtom | AttributeAtom | LinkAtom | CallAtom | ClosureAtom)


def relation_variables(relation: RelationAtom) -> tuple[int, ...]:
    """Return the variables of a relation atom, in the order of its columns."""
    match relation:
        case InstanceAtom(_, variable):
            return (variable,)
        case AttributeAtom(_, owner, value):
            return (owner, value)
        case LinkAtom(_, source, target) | ClosureAtom(_, _, source, target):
            return (source, target)
        case CallAtom(_, variables):
            return variables


def required_variables(goal: Goal) -> tuple[int, ...]:
    """Return the variables that must have a value before the goal can be evaluated: () for an atom of a relation."""
    match goal:
        case ConditionAtom(_, reads) | ValuationAtom(_, reads):
            return tuple(variable for _, variable in reads)
        case AggregateAtom():
            return tuple(v for v in relation_variables(goal.relation) if v not in goal.local)
        case AbsenceAtom(_, outer):
            return outer
        case UnequalAtom(left, right):
            return (left, right)
        case _:
            return ()


def bound_variables(goal: Goal) -> tuple[int, ...]:
    """Return the variables to which the goal can give a value: () for conditions, negations and inequalities."""
    match goal:
        case ValuationAtom() | AggregateAtom():
            return (goal.result,)
        case ConditionAtom() | AbsenceAtom() | UnequalAtom():
            return ()
        case _:
            return relation_variables(goal)


def visible_variables(goal: Goal) -> tuple[int, ...]:
    """Return all variables of a goal except variables local to a negation or aggregate. A variable may occur twice."""
    return (*required_variables(goal), *bound_variables(goal))


def all_variables(goal: Goal) -> tuple[int, ...]:
    """Return all variables of a goal, also variables local to a negation or aggregate. A variable may occur twice."""
    match goal:
        case AbsenceAtom(alternatives):
            return tuple(v for alternative in alternatives for inner in alternative for v in all_variables(inner))
        case AggregateAtom():
            return (*relation_variables(goal.relation), goal.result)
        case _:
            return visible_variables(goal)


def renumber_goal(goal: Goal, numbers: Mapping[int, int]) -> Goal:
    """Return a copy of the goal in which each variable, given by its number, is replaced by `numbers[variable]`."""

    def reads(pairs: tuple[tuple[str, int], ...]) -> tuple[tuple[str, int], ...]:
        return tuple((name, numbers[number]) for name, number in pairs)

    match goal:
        case ConditionAtom():
            return replace(goal, reads=reads(goal.reads))
        case ValuationAtom():
            return replace(goal, reads=reads(goal.reads), result=numbers[goal.result])
        case UnequalAtom(left, right):
            return UnequalAtom(numbers[left], numbers[right])
        case AbsenceAtom(alternatives, outer):
            return AbsenceAtom(
                tuple(tuple(renumber_goal(g, numbers) for g in alternative) for alternative in alternatives),
                tuple(dict.fromkeys(numbers[number] for number in outer)),
            )
        case AggregateAtom():
            return replace(
                goal,
                relation=renumber_relation(goal.relation, numbers),
                local=frozenset(numbers[number] for number in goal.local),
                result=numbers[goal.result],
                column=None if goal.column is None else numbers[goal.column],
            )
        case _:
            return renumber_relation(goal, numbers)


def renumber_relation(relation: RelationAtom, numbers: Mapping[int, int]) -> RelationAtom:
    """Return a copy of the relation in which each variable, given by its number, is replaced by `numbers[variable]`."""
    match relation:
        case InstanceAtom():
            return replace(relation, variable=numbers[relation.variable])
        case AttributeAtom():
            return replace(relation, object=numbers[relation.object], value=numbers[relation.value])
        case LinkAtom() | ClosureAtom():
            return replace(relation, source=numbers[relation.source], target=numbers[relation.target])
        case CallAtom():
            return replace(relation, arguments=tuple(numbers[v] for v in relation.arguments))
