"""Running a plan and watching it: how many partial matches each step leaves, and how far the best one comes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from envgraph.code import dataclass
from envgraph.errors import limit
from envgraph.match._limits import MOST_MATCHES
from envgraph.match.generate._generate import Translation
from envgraph.match.generate._sinks import Sink
from envgraph.match.generate._symbols import Held, Source
from envgraph.match.generate._write import Block, Module
from envgraph.match.plan._plan import BodyPlan, Step
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


class _Tracing(Translation):
    """Reports every partial match."""

    numbers: dict[int, int]
    _deepens = True
    _indexes = False

    def _after(self, step: Step) -> None:
        if id(step) in self.numbers:
            note = self._module.name(Held("note", ""))
            known = ", ".join(f"({variable}, {source})" for variable, source in sorted(self._names.items()))
            self._block.line(f"{note}({self.numbers[id(step)]}, ({known}{',' if known else ''}))")

    def _fork(self, block: Block, continuation: bool) -> Translation:
        if not continuation:
            return super()._fork(block, continuation)
        inner = _Tracing(self._planner, self._module, self._conjunction, block, {})
        inner.numbers = self.numbers
        return inner


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

    def note(step: int, values: tuple[tuple[int, Any], ...]) -> None:
        counts[step] += 1
        if counts[step] > most:
            raise _TooMany
        if first[step] is None:
            first[step] = dict(values)

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
    given = {position: f"v{position}" for position in bound}
    translation = _Tracing(planner, module, body.conjunction, block, given)
    translation.numbers = {id(step): number for number, step in enumerate(body.plan.steps)}
    results = Sink(body.conjunction.parameters, (), lambda names: ["pass"], (), repeatable=True)
    translation.body(body.plan, results)
    module.function("traced", list(given.values()), block)
    return module.source("traced")
