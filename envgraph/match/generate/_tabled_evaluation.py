"""Generate code that evaluates calls of recursive patterns, suspended at each call of the same component."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain
from typing import Final

from envgraph.code import (
    BodyBuilder,
    Expression,
    ExpressionStatement,
    Local,
    Name,
    Tuple,
    emit_equal,
    emit_method_call,
)
from envgraph.match.generate._sinks import SolutionSink, VariableCode, row
from envgraph.match.generate._source_builder import SourceBuilder, local_variable
from envgraph.match.generate._symbols import GeneratedSource, RecursiveFunction
from envgraph.match.generate._translation import PlanTranslation
from envgraph.match.plan._planner import Planner
from envgraph.match.plan._search_plan import PatternQuery, PlanStep, StepKind
from envgraph.match.plan._shared_searches import variables_used_by
from envgraph.pattern import CallAtom


def evaluation_source(planner: Planner, key: PatternQuery) -> GeneratedSource:
    """Return the source of a function that evaluates a call of a recursive pattern; all unbound positions are wanted.

    `evaluate(t, *values)` adds rows to the table `t` that need no rows of the component. If a call of the component is
    next, the rest of the plan becomes a continuation. It is registered, with the values that it needs, at the table of
    that call. (See `Calls` in `envgraph.match.demand._tabling`.)

    Raises:
        Unplannable: a parameter without a value cannot be enumerated.
    """
    view = planner.plan_pattern(key)
    module, block = SourceBuilder(), BodyBuilder()
    given = {position: local_variable("v", position) for position in key.bound}
    for body in view.bodies:
        outputs = tuple(body.conjunction.parameters[position] for position in key.outputs)
        translation = SuspendingTranslation(planner, module, body.conjunction, block, given)
        translation.key = key
        translation.first = _flatten_tests(body.plan.steps, planner, key)[:1]
        add = lambda names, outputs=outputs: emit_method_call(_TABLE, "add", row(outputs, names))  # noqa: E731
        translation.emit_plan(body.plan, _answer_sink(outputs, add))
    return module.finish(module.add_function("evaluate", [_TABLE, *given.values()], block.finish_body()))


_TABLE: Final = Local("t")


def _answer_sink(variables: tuple[int, ...], each: Callable[[VariableCode], Expression]) -> SolutionSink:
    """Return a sink that executes the expression `each` for every solution. The expression may use the table `t`."""
    return SolutionSink(
        variables, (), lambda names: (ExpressionStatement(each(names)),), (), (_TABLE,), repeatable=True
    )


def _is_component_call(step: PlanStep, planner: Planner, key: PatternQuery) -> bool:
    """Return True if a step calls a pattern of the recursive component."""
    goal = step.goal
    return isinstance(goal, CallAtom) and goal.pattern in planner.calls.component(key.pattern)


def _flatten_tests(steps: Sequence[PlanStep], planner: Planner, key: PatternQuery) -> list[PlanStep]:
    """Return the steps. An existence test that calls the recursive component is replaced by its inner steps."""
    found: list[PlanStep] = []
    for step in steps:
        if step.kind is StepKind.EXISTS:
            inner = _flatten_tests(step.inner[0].steps, planner, key)
            if any(_is_component_call(each, planner, key) for each in inner):
                found += inner
                continue
        found.append(step)
    return found


class SuspendingTranslation(PlanTranslation):
    """A translation of a plan that turns the steps after a call of the recursive component into continuations.

    Attributes:
        key: the pattern query that is evaluated.
        first: the first step of the body, or an empty list.
    """

    key: PatternQuery
    first: list[PlanStep]

    def _new_part(self, continuation: bool) -> PlanTranslation:
        if not continuation:
            return super()._new_part(continuation)
        inner = SuspendingTranslation(self._planner, self._module, self.conjunction, BodyBuilder(), {})
        inner.key, inner.first = self.key, self.first
        return inner

    def emit_steps(self, steps: Sequence[PlanStep], sink: SolutionSink) -> None:
        assert isinstance(self._planner, Planner)
        steps = _flatten_tests(steps, self._planner, self.key)
        number = next((n for n, s in enumerate(steps) if _is_component_call(s, self._planner, self.key)), None)
        if number is None:
            super().emit_steps(steps, sink)
            return
        before, step, rest = steps[:number], steps[number], steps[number + 1 :]
        known = {
            *self.bindings.expressions,
            *chain.from_iterable(s.binds for s in before),
        } - self.bindings.constants.keys()
        super().emit_steps(before, self._suspension(step, rest, sink, known))

    def _suspension(
        self, step: PlanStep, rest: Sequence[PlanStep], sink: SolutionSink, known: set[int]
    ) -> SolutionSink:
        """Return the sink that registers a continuation for the rows of a call.

        If these rows are the rows of the plan, the sink evaluates the call for the table of its caller instead.

        Args:
            step: the call.
            rest: the steps after the call.
            sink: the sink of the whole plan.
            known: the variables with values at the call, without constants.
        """
        goal = step.goal
        assert isinstance(goal, CallAtom)
        bound = tuple(p for p, v in enumerate(goal.arguments) if v in known or v in self.bindings.constants)
        given = tuple(goal.arguments[position] for position in bound)
        free = tuple(v for p, v in enumerate(goal.arguments) if p not in bound)
        calls = self._module.name_of(RecursiveFunction(goal.pattern, bound))
        if not rest and step.binds and free == sink.variables and len(set(free)) == len(free):
            return _answer_sink(given, lambda names: emit_method_call(calls, "enter", _TABLE, row(given, names)))
        read = {*sink.variables, *(v for each in rest for v in variables_used_by(each))}
        inputs = tuple(sorted(read & known))
        how = "read" if step.binds else "once"
        if self._is_own_call(step, bound, given) and step.binds and not inputs:
            how = "again"

        def each(names: VariableCode) -> Expression:
            goes_on = self._emit_continuation(inputs, free if step.binds else (), len(free), rest, sink)
            known_there = Tuple((_TABLE, *map(names, inputs)))
            return emit_method_call(calls, how, row(given, names), goes_on, known_there)

        return _answer_sink((*given, *inputs), each)

    def _is_own_call(self, step: PlanStep, bound: tuple[int, ...], given: tuple[int, ...]) -> bool:
        """Return True if a step is the first of its body and repeats the call that is evaluated, with its values."""
        assert isinstance(step.goal, CallAtom)
        heads = tuple(self.conjunction.parameters[position] for position in self.key.bound)
        are_distinct = len(set(heads)) == len(heads) and self.bindings.constants.keys().isdisjoint(heads)
        same = step.goal.pattern == self.key.pattern and bound == self.key.bound and given == heads
        return are_distinct and same and any(each is step for each in self.first)

    def _emit_continuation(
        self,
        inputs: Sequence[int],
        columns: Sequence[int],
        width: int,
        rest: Sequence[PlanStep],
        sink: SolutionSink,
    ) -> Name:
        """Emit the continuation for a row of a call, and return its name.

        Args:
            inputs: the variables with values that the continuation reads.
            columns: the variables that the row's values are bound to; empty if they are not needed.
            width: the number of values in the row.
            rest: the steps after the call.
            sink: the sink of the whole plan.
        """
        inner = self._new_part(continuation=True)
        inner.bindings.expressions = {v: self.bindings.local(v) for v in inputs}
        inner._allows_joins = self._allows_joins
        parameters = [local_variable("w", number) for number in range(width)]
        for number, variable in enumerate(columns):
            if variable in inner.bindings.expressions:
                inner.block.open_test(emit_equal(parameters[number], self.bindings.local(variable)))
            else:
                inner.bindings.expressions[variable] = parameters[number] = self.bindings.local(variable)
        inner.emit_steps(rest, sink)
        known = [_TABLE, *(self.bindings.local(v) for v in inputs)]
        return self._module.add_function(self._module.fresh_name("h"), [*known, *parameters], inner.block.finish_body())
