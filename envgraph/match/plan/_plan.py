"""Search plans as frozen data: what is looked for, in which order."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum

from envgraph.code import dataclass
from envgraph.metamodel import Attribute
from envgraph.pattern import AttributeAtom, Conjunction, Goal, LinkAtom


def held_value(goal: Goal) -> tuple[Attribute, int, int] | None:
    """The attribute of a goal that says that an object has a value, with the variables of both."""
    match goal:
        case AttributeAtom(attribute, owner, value) | LinkAtom(Attribute() as attribute, owner, value):
            return attribute, owner, value
    return None


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
