"""Running a plan and watching it: how many partial matches each step leaves, and how far the best one comes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from envgraph.code import Block, Body, Call, Constant, Local, call, dataclass, tuple_of, with_counters
from envgraph.errors import limit
from envgraph.match._limits import MOST_MATCHES
from envgraph.match.generate._generate import Executed, Translation
from envgraph.match.generate._sinks import Sink
from envgraph.match.generate._symbols import Held, Source
from envgraph.match.generate._write import Module, local
from envgraph.match.plan._plan import BodyPlan, Plan
from envgraph.match.plan._planner import Planner

Build = Callable[[Source, Callable[[Held], object]], Callable[..., Any]]
"""Makes a function of a source; the second argument gives what is held."""


@dataclass(frozen=True, slots=True)
class Trace:
    """What the steps of a plan did.

    Attributes:
        counts: number of partial matches after each step.
        first: the first partial match after each step, values by variable; None if there is none.
        whole: whether the plan was run to the end: it may have too many matches.
    """

    counts: tuple[int, ...]
    first: tuple[dict[int, Any] | None, ...]
    whole: bool = True


def trace(planner: Planner, body: BodyPlan, bound: dict[int, Any], build: Build) -> Trace:
    """Run the plan of one body to the end.

    Args:
        planner: that made the plan.
        body: the body.
        bound: values by position of the parameter.
        build: see `Build`.
    """
    counts = [0] * len(body.plan.steps)
    first: list[dict[int, Any] | None] = [None] * len(counts)

    most = limit(MOST_MATCHES)

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
    """A step has more partial matches than anybody wants to wait for."""


def _source(planner: Planner, body: BodyPlan, bound: tuple[int, ...]) -> Source:
    module, block = Module(), Block()
    given = {position: local("v", position) for position in bound}
    translation = Translation(planner, module, body.conjunction, block, given)
    translation.indexes = False
    translation.body(body.plan, Sink(body.conjunction.parameters, (), lambda names: (), (), repeatable=True))
    return noted(module, list(given.values()), block.body(), body.plan)


def noted(module: Module, parameters: Sequence[Local], body: Body, plan: Plan) -> Source:
    """The source of a function that calls `note` after each step of a plan.

    With the number of the step, and pairs of a variable and its value; it returns True.
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
