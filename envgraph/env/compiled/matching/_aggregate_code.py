"""Emit code for aggregates over the solutions of a part of a body: count, sum, mean, minimum and maximum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from envgraph import code
from envgraph.env.compiled.layout._program_layout import ONE, RF, ZERO, S, emit_error
from envgraph.match.generate import COUNT as COUNT_SINK, SolutionSink, VariableCode
from envgraph.match.plan import PlanStep, StepKind, query_of_call
from envgraph.metamodel import Scalar
from envgraph.pattern import AggregateAtom, CallAtom

if TYPE_CHECKING:
    from envgraph.env.compiled.matching._body_code import BodyEmitter

COUNT = code.Local("n", "int")
PARTS, SPACE = code.Local("parts", "int"), code.Local("space", "int")
"""The number of floats whose sum is exactly that of the values so far, and the row from which on they are stored. For
a sum of ints, how often it has left the range of 64 bits upwards minus downwards."""


def emit_aggregate(body: BodyEmitter, goal: AggregateAtom, step: PlanStep) -> None:
    """Emit code that computes an aggregate and binds the goal's result variable, or compares it if already bound."""
    relation = goal.relation
    if goal.function == "count" and isinstance(relation, CallAtom) and not body.is_static(relation):
        known = {v for v in relation.arguments if body.is_bound(v)}
        key = query_of_call(relation, known, body.unbound_variables(relation))
        values = [body.value_of(relation.arguments[position]) for position in key.bound]
        counter = body.matching.emit_count(key, body.arguments_fit(relation, key))
        body.bind_or_test(goal.result, body.emit_call(counter, values))
        return
    steps = step.inner[0].steps
    if len(steps) == 1 and steps[0].kind is StepKind.TEST:
        steps = (replace(steps[0], kind=StepKind.LOOP, binds=tuple(body.unbound_variables(relation))),)
    if goal.column is None:
        body.bind_or_test(goal.result, body.emit_function_call(steps, COUNT_SINK))
    else:
        _emit_fold(body, goal, goal.column, steps)


def _emit_fold(body: BodyEmitter, goal: AggregateAtom, variable: int, steps: Sequence[PlanStep]) -> None:
    """Emit code that binds the goal's result to the sum, mean, minimum or maximum of the variable `variable`.

    Without solutions, a sum is 0, and a mean, minimum or maximum makes the goal fail. So does a sum of ints beyond 64
    bits.
    """
    type_ = Scalar.FLOAT if goal.function == "avg" else body.conjunction.types[variable]
    exact = type_ is Scalar.FLOAT and goal.function in ("sum", "avg")
    of_ints = type_ is Scalar.INT and goal.function == "sum"
    folded, beyond = code.Local("folded", "float" if type_ is Scalar.FLOAT else "int"), code.Local("beyond")

    def emit_each(names: VariableCode) -> code.Body:
        value, counted = names(variable), code.Assign(COUNT, ONE, "+=")
        if exact:
            is_float = body.conjunction.types[variable] is Scalar.FLOAT
            added = value if is_float else code.emit_call("float", value)
            return code.Assign(PARTS, code.emit_call("add_exactly", RF, SPACE, PARTS, added)), counted
        if of_ints:
            sum_ = code.Assign(code.emit_tuple(folded, beyond), code.emit_call("add_checked", folded, value))
            way = code.ConditionalExpression(code.Operation(">", (value, ZERO)), ONE, code.Constant(-1))
            return sum_, code.If(beyond, (code.Assign(PARTS, way, "+="),)), counted
        better = code.Operation("<" if goal.function == "min" else ">", (value, folded))
        first = code.Operation("or", (code.emit_equal(COUNT, ZERO), better))
        return code.If(first, (code.Assign(folded, value),)), counted

    nothing: code.Expression = code.Constant(0.0 if type_ is Scalar.FLOAT else 0)
    parts = [code.Assign(PARTS, ZERO)] if exact or of_ints else []
    head = (code.Assign(COUNT, ZERO), *parts, *([] if exact else [code.Assign(folded, nothing)]))
    last = code.emit_call("sum_exactly", RF, SPACE, PARTS) if exact else folded
    sink = SolutionSink(
        (variable,), head, emit_each, (code.Return(code.emit_tuple(PARTS if of_ints else COUNT, last)),)
    )
    whole = body.emit_function_call(steps, sink, SPACE if exact else None)
    number, result = body.matching.module.new_local("n"), body.facts.new_local_for(type_)
    body.block.add(code.Assign(code.Tuple((number, result)), whole))
    if exact:  # the live engine knows sums that are beyond all floats on the way only
        finite = code.Operation("<", (code.emit_call("abs", result), code.Name("INFINITY")))
        body.block.add(code.If(code.emit_not(finite), (emit_error("FAILED"),)))
    if of_ints:
        body.block.open_test(code.emit_equal(number, ZERO))
        body.block.open_test(code.emit_call("within", S, result, code.FALSE))
    elif goal.function != "sum":
        body.block.open_test(code.Operation(">", (number, ZERO)))
    body.bind_or_test(goal.result, code.Operation("/", (result, number)) if goal.function == "avg" else result)
