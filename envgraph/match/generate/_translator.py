"""Translate search plans into code, with one answer for each kind of goal: from the store's columns, or from arrays."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import assert_never

from envgraph import code
from envgraph.match.generate._bindings import VariableBindings
from envgraph.match.generate._sinks import EXISTENCE, SolutionSink
from envgraph.match.plan._search_plan import PlanStep, SearchPlan, StepKind
from envgraph.pattern import (
    AbsenceAtom,
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    ClosureAtom,
    ConditionAtom,
    Conjunction,
    InstanceAtom,
    LinkAtom,
    UnequalAtom,
    ValuationAtom,
)


class PlanTranslator(ABC):
    """A translator of the plan of one conjunction into code.

    The `solve_` methods are the answers of the data to goals: they add loops, tests and statements to the block, so
    that later code runs for each tuple that agrees with the bound variables (once, if the step is a test), and bind the
    variables of the step. The code changes nothing but new variables.

    Attributes:
        block: receives the code.
        bindings: the variables with values, and code for these.
    """

    def __init__(self, conjunction: Conjunction, block: code.BodyBuilder, bindings: VariableBindings) -> None:
        self.conjunction = conjunction
        self.block = block
        self.bindings = bindings

    def is_bound(self, variable: int) -> bool:
        """Return True if a variable has a value, or is a constant."""
        return self.bindings.has_value(variable)

    def value_of(self, variable: int) -> code.Expression:
        """Return code for the value of a variable that is bound."""
        return self.bindings.expression_of(variable)

    def bind_parameters(self, given: Mapping[int, code.Expression]) -> None:
        """Bind parameters to values, given by position. Two values of the same variable are compared."""
        for position, value in given.items():
            variable = self.conjunction.parameters[position]
            if self.is_bound(variable):
                self.block.open_test(code.emit_equal(self.value_of(variable), value))
            else:
                self.bindings.expressions[variable] = value

    def emit_steps(self, steps: Sequence[PlanStep], sink: SolutionSink) -> None:
        """Emit code that executes steps, with the statements of the sink for each solution."""
        left: Sequence[PlanStep] | None = steps
        while left:
            left = self.emit_first(left, sink)
        if left is not None:
            self.emit_solution(sink)

    def emit_first(self, steps: Sequence[PlanStep], sink: SolutionSink) -> Sequence[PlanStep] | None:
        """Emit code for the first of some steps. Return the steps left; None if these and the sink are emitted, too."""
        self.solve(steps[0])
        return steps[1:]

    def emit_solution(self, sink: SolutionSink) -> None:
        """Emit the statements of a sink for a solution."""
        self.block.add(*sink.emit_each(self.value_of))

    def solve(self, step: PlanStep) -> None:
        """Emit code that solves the goal of a step."""
        goal = step.goal
        match goal:
            case _ if step.kind is StepKind.EXISTS:
                self.block.open_test(self.emit_existence(step.inner[0]))
            case AbsenceAtom():
                self.solve_absence(goal, step)
            case InstanceAtom():
                self.solve_instance(goal, step)
            case AttributeAtom():
                self.solve_attribute(goal, step)
            case LinkAtom():
                self.solve_link(goal, step)
            case CallAtom():
                self.solve_call(goal, step)
            case ClosureAtom():
                self.solve_closure(goal, step)
            case AggregateAtom():
                self.solve_aggregate(goal, step)
            case UnequalAtom(left, right):
                self.block.open_test(code.Operation("!=", (self.value_of(left), self.value_of(right))))
            case ConditionAtom():
                self.solve_condition(goal)
            case ValuationAtom():
                self.solve_valuation(goal, step)
            case _:
                assert_never(goal)

    def solve_absence(self, goal: AbsenceAtom, step: PlanStep) -> None:
        none = [code.emit_not(self.emit_existence(plan)) for plan in step.inner]
        self.block.open_test(code.emit_joined("and", none, True))

    def emit_existence(self, plan: SearchPlan) -> code.Expression:
        """Return code that tests if a plan has a solution: a call of a new function, if the data has nothing better."""
        return self.emit_function_call(plan.steps, EXISTENCE)

    @abstractmethod
    def emit_function_call(self, steps: Sequence[PlanStep], sink: SolutionSink) -> code.Expression:
        """Emit an inner function that executes some steps with a sink, and return a call of the function."""

    @abstractmethod
    def solve_instance(self, goal: InstanceAtom, step: PlanStep) -> None: ...

    @abstractmethod
    def solve_attribute(self, goal: AttributeAtom, step: PlanStep) -> None: ...

    @abstractmethod
    def solve_link(self, goal: LinkAtom, step: PlanStep) -> None: ...

    @abstractmethod
    def solve_call(self, goal: CallAtom, step: PlanStep) -> None: ...

    @abstractmethod
    def solve_closure(self, goal: ClosureAtom, step: PlanStep) -> None: ...

    @abstractmethod
    def solve_aggregate(self, goal: AggregateAtom, step: PlanStep) -> None: ...

    @abstractmethod
    def solve_condition(self, goal: ConditionAtom) -> None: ...

    @abstractmethod
    def solve_valuation(self, goal: ValuationAtom, step: PlanStep) -> None: ...
