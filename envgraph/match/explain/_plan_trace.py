"""Run a plan and count the partial matches after each step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from envgraph.code import (
    Body,
    BodyBuilder,
    Call,
    Constant,
    Local,
    dataclass,
    emit_call,
    emit_tuple,
    with_counters,
)
from envgraph.errors import scaled_limit
from envgraph.match.generate._sinks import SolutionSink
from envgraph.match.generate._source_builder import SourceBuilder, local_variable
from envgraph.match.generate._symbols import GeneratedSource, OperatorSymbol
from envgraph.match.generate._translation import PlanTranslation, StepOrigin
from envgraph.match.plan._planner import Planner
from envgraph.match.plan._search_plan import BodyPlan, SearchPlan

Build = Callable[[GeneratedSource, Callable[[OperatorSymbol], object]], Callable[..., Any]]
"""Creates the function of a source; the second argument gives the values of `Held` symbols."""


@dataclass(frozen=True, slots=True)
class PlanTrace:
    """The record of one run of a plan.

    Attributes:
        counts: the number of partial matches after each step.
        first: the first partial match after each step, as values by variable; None if there is none.
        is_complete: False if the run was stopped because of too many partial matches.
    """

    counts: tuple[int, ...]
    first: tuple[dict[int, Any] | None, ...]
    is_complete: bool = True


def trace_plan(planner: Planner, body: BodyPlan, bound: dict[int, Any], build: Build) -> PlanTrace:
    """Run the plan of one body, and return the trace. The run stops if a step gives too many partial matches.

    Args:
        planner: the planner that made the plan.
        body: the body with its plan.
        bound: the values by position of the parameter.
        build: see `Build`.
    """
    counts = [0] * len(body.plan.steps)
    first: list[dict[int, Any] | None] = [None] * len(counts)

    most = scaled_limit("matches")

    def record_solution(step: int, values: tuple[tuple[int, Any], ...]) -> bool:
        counts[step] += 1
        if counts[step] > most:
            raise _TooManyMatches
        if first[step] is None:
            first[step] = dict(values)
        return True

    source = _source(planner, body, tuple(sorted(bound)))
    run = build(source, lambda _: record_solution)
    try:
        run(*(bound[position] for position in sorted(bound)))
    except _TooManyMatches:
        return PlanTrace(tuple(counts), tuple(first), is_complete=False)
    return PlanTrace(tuple(counts), tuple(first))


class _TooManyMatches(Exception):
    """The error that stops a run with too many partial matches."""


def _source(planner: Planner, body: BodyPlan, bound: tuple[int, ...]) -> GeneratedSource:
    """Return the source of a function that runs the plan of a body and records each step."""
    module, block = SourceBuilder(), BodyBuilder()
    given = {position: local_variable("v", position) for position in bound}
    translation = PlanTranslation(planner, module, body.conjunction, block, given)
    translation.uses_indexes = False
    translation.emit_plan(
        body.plan, SolutionSink(body.conjunction.parameters, (), lambda names: (), (), repeatable=True)
    )
    return traced_function_source(module, list(given.values()), block.finish_body(), body.plan)


def traced_function_source(
    module: SourceBuilder, parameters: Sequence[Local], body: Body, plan: SearchPlan
) -> GeneratedSource:
    """Return the source of a function that calls `note` after each step of a plan.

    `note` gets the number of the step, and the pairs of variables and values. It must return True.
    """
    note = module.name_of(OperatorSymbol("note", ""))
    source = module.finish(module.add_function("traced", parameters, body))
    numbers = {id(step): number for number, step in enumerate(plan.steps)}

    def counter(origin: object) -> Call | None:
        if not isinstance(origin, StepOrigin) or id(origin.step) not in numbers:
            return None
        known = [emit_tuple(Constant(variable), each) for variable, each in sorted(origin.known.items())]
        return emit_call(note, Constant(numbers[id(origin.step)]), emit_tuple(*known))

    return replace(source, build=with_counters(source.build, counter))
