"""Search plans as frozen data: what is looked for, in which order."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum

from envgraph.code import dataclass
from envgraph.metamodel import Attribute, Value
from envgraph.pattern import (
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    ClosureAtom,
    Expression,
    InstanceAtom,
    LinkAtom,
    RelationAtom,
    StaticType,
    UnequalAtom,
)


@dataclass(frozen=True, slots=True)
class Condition:
    """An expression is true; `reads` gives the number of the variable that each name in it stands for."""

    expression: Expression
    reads: tuple[tuple[str, int], ...]


@dataclass(frozen=True, slots=True)
class Valuation:
    """`result` has the value of an expression (as in `Condition`)."""

    expression: Expression
    reads: tuple[tuple[str, int], ...]
    result: int


@dataclass(frozen=True, slots=True)
class Absence:
    """None of the alternatives has a solution; variables that stand nowhere else are free inside."""

    alternatives: tuple[tuple[Goal, ...], ...]
    outer: tuple[int, ...]


Goal = RelationAtom | UnequalAtom | Condition | Valuation | AggregateAtom | Absence
"""One constraint of a conjunction."""


@dataclass(frozen=True, slots=True)
class Conjunction:
    """One body, ready to be planned.

    Attributes:
        types: static type of every variable.
        constants: values of variables that are fixed.
        parameters: number of the variable that stands for each parameter.
        goals: what must hold.
    """

    types: tuple[StaticType, ...]
    constants: tuple[tuple[int, Value], ...]
    parameters: tuple[int, ...]
    goals: tuple[Goal, ...]


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


def held_value(goal: Goal) -> tuple[Attribute, int, int] | None:
    """The attribute of a goal that says that an object has a value, with the variables of both."""
    match goal:
        case AttributeAtom(attribute, owner, value) | LinkAtom(Attribute() as attribute, owner, value):
            return attribute, owner, value
    return None


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


class Kind(Enum):
    """What a step does."""

    TEST = "test"
    """All variables have values: hold or fail."""
    BIND = "bind"
    """At most one value for one variable."""
    LOOP = "loop"
    """Any number of values."""
    ABSENT = "absent"
    """None of the plans inside has a solution."""
    EXISTS = "exists"
    """The plan inside has a solution; its variables are not needed further on."""


@dataclass(frozen=True, slots=True)
class Step:
    """One step of a plan.

    Attributes:
        goal: what is met; of an `EXISTS` step the first goal of the plan inside.
        binds: variables that have a value afterwards, in the order in which they appear in the goal.
        cost: estimated work of one execution, in elementary accesses.
        rows: estimated number of partial matches after the step.
        inner: plans of an `ABSENT` or `EXISTS` step.
    """

    kind: Kind
    goal: Goal
    binds: tuple[int, ...]
    cost: float
    rows: float
    inner: tuple[Plan, ...] = ()


@dataclass(frozen=True, slots=True)
class Plan:
    """The steps that solve one conjunction, with the estimated number of solutions and the work of finding them."""

    steps: tuple[Step, ...]
    rows: float
    cost: float

    def walk(self) -> Iterator[Step]:
        """All steps, those inside others included."""
        for step in self.steps:
            yield step
            for plan in step.inner:
                yield from plan.walk()


@dataclass(frozen=True, slots=True)
class ViewKey:
    """What is asked of a pattern: positions that are given, and positions whose values are wanted."""

    pattern: str
    bound: tuple[int, ...]
    outputs: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class BodyPlan:
    """The plan of one body for one view.

    Attributes:
        conjunction: what the plan solves.
        plan: the steps.
        repeats: whether it may come to the same wanted values more than once.
    """

    conjunction: Conjunction
    plan: Plan
    repeats: bool


@dataclass(frozen=True, slots=True)
class ViewPlan:
    """All bodies of a view; `distinct` says that they never give the same wanted values twice."""

    key: ViewKey
    bodies: tuple[BodyPlan, ...]
    distinct: bool
    rows: float
    cost: float
