"""Run a plan and count the partial matches after each step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from envgraph.code import Block, Body, Call, Constant, Local, call, dataclass, tuple_of, with_counters
from envgraph.errors import limit
from envgraph.match.generate._generate import Executed, Translation
from envgraph.match.generate._sinks import Sink
from envgraph.match.generate._symbols import Held, Source
from envgraph.match.generate._write import Module, local
from envgraph.match.plan._plan import BodyPlan, Plan
from envgraph.match.plan._planner import Planner

Build = Callable[[Source, Callable[[Held], object]], Callable[..., Any]]
"""Creates the function of a source; the second argument gives the values of `Held` symbols."""


@dataclass(frozen=True, slots=True)
class Trace:
    """The record of one run of a plan.

    Attributes:
        counts: the number of partial matches after each step.
        first: the first partial match after each step, as values by variable; None if there is none.
        whole: False if the run was stopped because of too many partial matches.
    """

    counts: tuple[int, ...]
    first: tuple[dict[int, Any] | None, ...]
    whole: bool = True


def trace(planner: Planner, body: BodyPlan, bound: dict[int, Any], build: Build) -> Trace:
    """Run the plan of one body, and return the trace. The run stops if a step gives too many partial matches.

    Args:
        planner: the planner that made the plan.
        body: the body with its plan.
        bound: the values by position of the parameter.
        build: see `Build`.
    """
    counts = [0] * len(body.plan.steps)
    first: list[dict[int, Any] | None] = [None] * len(counts)

    most = limit("matches")

    def note(step: int, values: tuple[tuple[int, Any], ...]) -> bool:
        counts[step] += 1
        if counts[step] > most:
            raise _TooMany
        if first[step] is None:
            first[step] = dict(values)
        return True

    source = _source(planner, body, tuple(sorted(bound)))
    run = build(source, lambda _: note)
    try:
        run(*(bound[position] for position in sorted(bound)))
    except _TooMany:
        return Trace(tuple(counts), tuple(first), whole=False)
    return Trace(tuple(counts), tuple(first))


class _TooMany(Exception):
    """The error that stops a run with too many partial matches."""


def _source(planner: Planner, body: BodyPlan, bound: tuple[int, ...]) -> Source:
    """Return the source of a function that runs the plan of a body and records each step."""
    module, block = Module(), Block()
    given = {position: local("v", position) for position in bound}
    translation = Translation(planner, module, body.conjunction, block, given)
    translation.indexes = False
    translation.body(body.plan, Sink(body.conjunction.parameters, (), lambda names: (), (), repeatable=True))
    return noted(module, list(given.values()), block.body(), body.plan)


def noted(module: Module, parameters: Sequence[Local], body: Body, plan: Plan) -> Source:
    """Return the source of a function that calls `note` after each step of a plan.

    `note` gets the number of the step, and the pairs of variables and values. It must return True.
    """
    note = module.name(Held("note", ""))
    source = module.source(module.function("traced", parameters, body))
    numbers = {id(step): number for number, step in enumerate(plan.steps)}

    def counter(origin: object) -> Call | None:
        if not isinstance(origin, Executed) or id(origin.step) not in numbers:
            return None
        known = [tuple_of(Constant(variable), each) for variable, each in sorted(origin.known.items())]
        return call(note, Constant(numbers[id(origin.step)]), tuple_of(*known))

    return replace(source, build=with_counters(source.build, counter))
