"""Emit code for aggregates over the solutions of a part of a body: count, sum, mean, minimum and maximum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from envgraph import code
from envgraph.env.compiled._layout import ONE, RF, ZERO, failed
from envgraph.match.plan import Kind, Step, call_key
from envgraph.metamodel import Scalar
from envgraph.pattern import AggregateAtom, CallAtom

if TYPE_CHECKING:
    from envgraph.env.compiled._bodies import Body

COUNT = code.Local("n", "int")
PARTS, SPACE = code.Local("parts", "int"), code.Local("space", "int")
"""The number of floats whose sum is exactly that of the values so far, and the row from which on they are stored."""


def count_solutions(body: Body, number: code.Local) -> None:
    """Emit code that adds 1 to `number`, or if `body` finds solutions as bits of a word, the number of 1 bits."""
    one = ONE if body.word is None else code.call("count_bits", body.word.word)
    body.block.add(code.Assign(number, one, "+="))


def aggregated(body: Body, goal: AggregateAtom, step: Step) -> None:
    """Emit code that computes an aggregate and binds the goal's result variable, or compares it if already bound."""
    relation = goal.relation
    if goal.function == "count" and isinstance(relation, CallAtom) and not body.static(relation):
        unknown = [v for v in relation.arguments if not body.known(v)]
        key = call_key(relation, {v for v in relation.arguments if body.known(v)}, unknown)
        values = [body.source(relation.arguments[position]) for position in key.bound]
        counter = body.matching.count(key, body.suits(relation, key))
        body.give(goal.result, body.called(counter, values))
        return
    steps = step.inner[0].steps
    if len(steps) == 1 and steps[0].kind is Kind.TEST:
        steps = (replace(steps[0], kind=Kind.LOOP, binds=tuple(body.free(relation))),)
    if goal.column is not None:
        _fold(body, goal, goal.column, steps)
        return
    head = (code.Assign(COUNT, ZERO),)
    counted = body.inside(
        lambda part: part.steps(steps, lambda one: count_solutions(one, COUNT)), COUNT, head
    )
    body.give(goal.result, counted)


def _fold(body: Body, goal: AggregateAtom, column: int, steps: Sequence[Step]) -> None:
    """Emit code that binds the goal's result to the sum, mean, minimum or maximum of the variable `column`.

    Without solutions, a sum is 0, and a mean, minimum or maximum makes the goal fail.
    """
    type_ = body.conjunction.types[column]
    exact = type_ is Scalar.FLOAT and goal.function in ("sum", "avg")
    folded = code.Local("folded", "float" if type_ is Scalar.FLOAT else "int")

    def found(part: Body) -> None:
        value = part.source(column)
        if exact:
            part.block.add(code.Assign(PARTS, code.call("add_exactly", RF, SPACE, PARTS, value)))
        elif goal.function in ("sum", "avg"):
            part.block.add(code.Assign(folded, value, "+="))
        else:
            operator = "<" if goal.function == "min" else ">"
            better = code.Operation(operator, (value, folded))
            first = code.Operation("or", (code.equal(COUNT, ZERO), better))
            part.block.add(code.If(first, (code.Assign(folded, value),)))
        count_solutions(part, COUNT)

    def write(part: Body) -> None:
        if exact:
            part.take_space(SPACE)
        part.steps(steps, found)

    nothing: code.Expression = code.Constant(0.0 if type_ is Scalar.FLOAT else 0)
    head = (code.Assign(COUNT, ZERO), code.Assign(PARTS, ZERO) if exact else code.Assign(folded, nothing))
    last = code.call("sum_exactly", RF, SPACE, PARTS) if exact else folded
    whole = body.inside(write, code.tuple_of(COUNT, last), head)
    number, result = body.matching.module.fresh("n"), body.facts.local(type_)
    body.block.add(code.Assign(code.Tuple((number, result)), whole))
    if exact:  # the live engine knows sums that are beyond all floats on the way only
        finite = code.Operation("<", (code.call("abs", result), code.Name("INFINITY")))
        body.block.add(code.If(code.inverse(finite), (failed("FAILED"),)))
    if goal.function != "sum":
        body.block.test(code.Operation(">", (number, ZERO)))
    body.give(goal.result, code.Operation("/", (result, number)) if goal.function == "avg" else result)
