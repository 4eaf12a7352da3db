"""Search plans as frozen data: the goals to solve, and their order."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum

from envgraph.code import dataclass
from envgraph.metamodel import Attribute
from envgraph.pattern import AttributeAtom, Conjunction, Goal, LinkAtom


def attribute_and_variables(goal: Goal) -> tuple[Attribute, int, int] | None:
    """Return attribute, object variable and value variable of a goal on an attribute's value; None for other goals."""
    match goal:
        case AttributeAtom(attribute, owner, value) | LinkAtom(Attribute() as attribute, owner, value):
            return attribute, owner, value
    return None


class StepKind(Enum):
    """The kind of a plan step: how the step solves its goal."""

    TEST = "test"
    """Check a goal whose variables all have values."""
    BIND = "bind"
    """Compute at most one value for one variable."""
    LOOP = "loop"
    """Loop over any number of values."""
    ABSENT = "absent"
    """Check that no inner plan has a solution."""
    EXISTS = "exists"
    """Check that the inner plan has a solution. Later steps do not use its variables."""


@dataclass(frozen=True, slots=True)
class PlanStep:
    """A step of a search plan.

    Attributes:
        goal: the goal to solve; for an `EXISTS` step the first goal of the inner plan.
        binds: the variables that get values in this step, in the order of the goal.
        cost: the estimated work of one execution, in accesses to the store.
        rows: the estimated number of partial matches after the step.
        inner: the plans inside an `ABSENT` or `EXISTS` step, or of the relation of an aggregate.
    """

    kind: StepKind
    goal: Goal
    binds: tuple[int, ...]
    cost: float
    rows: float
    inner: tuple[SearchPlan, ...] = ()


@dataclass(frozen=True, slots=True)
class SearchPlan:
    """A search plan: the steps that solve one conjunction, with the estimated number of solutions and total work."""

    steps: tuple[PlanStep, ...]
    rows: float
    cost: float

    def walk(self) -> Iterator[PlanStep]:
        """Yield all steps in order, each followed by the steps of its inner plans."""
        for step in self.steps:
            yield step
            for plan in step.inner:
                yield from plan.walk()


@dataclass(frozen=True, slots=True)
class PatternQuery:
    """A pattern query: a pattern, the positions of bound arguments, and the positions whose values are wanted."""

    pattern: str
    bound: tuple[int, ...]
    outputs: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class BodyPlan:
    """The plan of one body of a pattern query.

    Attributes:
        conjunction: the body.
        plan: the steps that solve it.
        may_repeat: True if several solutions of the plan may agree in all wanted values.
    """

    conjunction: Conjunction
    plan: SearchPlan
    may_repeat: bool


@dataclass(frozen=True, slots=True)
class PatternPlan:
    """The plans of all bodies of a pattern query. If `is_distinct`, no two solutions agree in all wanted values."""

    key: PatternQuery
    bodies: tuple[BodyPlan, ...]
    is_distinct: bool
    rows: float
    cost: float
