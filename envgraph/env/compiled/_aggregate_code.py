"""Emit code for aggregates over the solutions of a part of a body: count, sum, mean, minimum and maximum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from envgraph import code
from envgraph.env.compiled._program_layout import ONE, RF, ZERO, S, emit_error
from envgraph.match.plan import PlanStep, StepKind, query_of_call
from envgraph.metamodel import Scalar
from envgraph.pattern import AggregateAtom, CallAtom

if TYPE_CHECKING:
    from envgraph.env.compiled._body_code import BodyEmitter

COUNT = code.Local("n", "int")
PARTS, SPACE = code.Local("parts", "int"), code.Local("space", "int")
"""The number of floats whose sum is exactly that of the values so far, and the row from which on they are stored. For
a sum of ints, how often it has left the range of 64 bits upwards minus downwards."""


def emit_count(body: BodyEmitter, number: code.Local) -> None:
    """Emit code that adds 1 to `number`, or if `body` finds solutions as bits of a word, the number of 1 bits."""
    one = ONE if body.word is None else code.emit_call("count_bits", body.word.word)
    body.block.add(code.Assign(number, one, "+="))


def emit_aggregate(body: BodyEmitter, goal: AggregateAtom, step: PlanStep) -> None:
    """Emit code that computes an aggregate and binds the goal's result variable, or compares it if already bound."""
    relation = goal.relation
    if goal.function == "count" and isinstance(relation, CallAtom) and not body.is_static(relation):
        unknown = [v for v in relation.arguments if not body.is_bound(v)]
        key = query_of_call(relation, {v for v in relation.arguments if body.is_bound(v)}, unknown)
        values = [body.value_of(relation.arguments[position]) for position in key.bound]
        counter = body.matching.emit_count(key, body.arguments_fit(relation, key))
        body.bind_or_test(goal.result, body.emit_call(counter, values))
        return
    steps = step.inner[0].steps
    if len(steps) == 1 and steps[0].kind is StepKind.TEST:
        steps = (replace(steps[0], kind=StepKind.LOOP, binds=tuple(body.unbound_variables(relation))),)
    if goal.column is not None:
        _emit_fold(body, goal, goal.column, steps)
        return
    head = (code.Assign(COUNT, ZERO),)
    counted = body.emit_function(lambda part: part.emit_steps(steps, lambda one: emit_count(one, COUNT)), COUNT, head)
    body.bind_or_test(goal.result, counted)


def _emit_fold(body: BodyEmitter, goal: AggregateAtom, variable: int, steps: Sequence[PlanStep]) -> None:
    """Emit code that binds the goal's result to the sum, mean, minimum or maximum of the variable `variable`.

    Without solutions, a sum is 0, and a mean, minimum or maximum makes the goal fail. So does a sum of ints beyond 64
    bits.
    """
    type_ = Scalar.FLOAT if goal.function == "avg" else body.conjunction.types[variable]
    exact = type_ is Scalar.FLOAT and goal.function in ("sum", "avg")
    of_ints = type_ is Scalar.INT and goal.function == "sum"
    folded, beyond = code.Local("folded", "float" if type_ is Scalar.FLOAT else "int"), code.Local("beyond")

    def emit_accumulate(part: BodyEmitter) -> None:
        value = part.value_of(variable)
        if exact:
            is_float = part.conjunction.types[variable] is Scalar.FLOAT
            added = value if is_float else code.emit_call("float", value)
            part.block.add(code.Assign(PARTS, code.emit_call("add_exactly", RF, SPACE, PARTS, added)))
        elif of_ints:
            part.block.add(code.Assign(code.emit_tuple(folded, beyond), code.emit_call("add_checked", folded, value)))
            way = code.ConditionalExpression(code.Operation(">", (value, ZERO)), ONE, code.Constant(-1))
            part.block.add(code.If(beyond, (code.Assign(PARTS, way, "+="),)))
        else:
            operator = "<" if goal.function == "min" else ">"
            better = code.Operation(operator, (value, folded))
            first = code.Operation("or", (code.emit_equal(COUNT, ZERO), better))
            part.block.add(code.If(first, (code.Assign(folded, value),)))
        emit_count(part, COUNT)

    def emit_loop(part: BodyEmitter) -> None:
        if exact:
            part.reserve_rows(SPACE)
        part.emit_steps(steps, emit_accumulate)

    nothing: code.Expression = code.Constant(0.0 if type_ is Scalar.FLOAT else 0)
    parts = [code.Assign(PARTS, ZERO)] if exact or of_ints else []
    head = (code.Assign(COUNT, ZERO), *parts, *([] if exact else [code.Assign(folded, nothing)]))
    last = code.emit_call("sum_exactly", RF, SPACE, PARTS) if exact else folded
    whole = body.emit_function(emit_loop, code.emit_tuple(PARTS if of_ints else COUNT, last), head)
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
