"""Why a pattern has no match: the partial match that comes furthest, and the constraint that it fails."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from envgraph.errors import EnvgraphError
from envgraph.match._explain import Names, goal_text
from envgraph.match._options import Unplannable
from envgraph.match._plan import BodyPlan, Conjunction, ViewKey
from envgraph.match._planner import Planner
from envgraph.match._trace import Build, trace, whole
from envgraph.metamodel import Value
from envgraph.pattern import VALUES, CallAtom, ObjectType

MOST_LEVELS = 6
"""Called patterns that are looked into."""

Asked = tuple[tuple[str, dict[int, Value]], ...]
"""Calls: patterns with values by position."""


@dataclass(frozen=True, slots=True)
class Failure:
    """How far one body comes.

    Attributes:
        body: its number, from 1.
        found: values of the variables of the deepest partial match, by name; objects as ids.
        constraint: what this partial match fails; "" if the given values contradict the body from the start.
        objects: the variables that stand for objects.
        inner: of a called pattern that has no match, why not.
    """

    body: int
    found: Mapping[str, Value]
    constraint: str
    objects: tuple[str, ...] = ()
    inner: WhyNot | None = None


@dataclass(frozen=True, slots=True)
class WhyNot:
    """Why a pattern has no match for some values.

    Attributes:
        pattern: its qualified name.
        given: the values, by parameter.
        match: a match all the same, by parameter; None if there is none.
        failures: one for each body, the furthest first; none if there is a match.
        objects: the parameters that stand for objects.
        show: the text of an object, by its id.
        refusal: of a rule that has the match, why it cannot be applied there; None if it can.
    """

    pattern: str
    given: Mapping[str, Value]
    match: Mapping[str, Value] | None
    failures: tuple[Failure, ...]
    objects: tuple[str, ...] = ()
    show: Callable[[int], str] = field(default="#{}".format, compare=False, repr=False)
    refusal: EnvgraphError | None = field(default=None, compare=False)

    def __str__(self) -> str:
        return "\n".join(self._lines(self.show, ""))

    def _lines(self, show: Callable[[int], str], indent: str) -> list[str]:
        given = _listed(self.given, self.objects, show)
        title = f"`{self.pattern}`" + (f" for {given}" if given else "")
        if self.match is not None:
            found = _listed(self.match, self.objects, show)
            refused = str(self.refusal).splitlines() if self.refusal else []
            return [f"{indent}{title} has a match" + (f": {found}" if found else ""), *refused]
        lines = [f"{indent}{title} has no match"]
        for failure in self.failures:
            reason = "the given values contradict it"
            if failure.constraint:
                found = _listed(failure.found, failure.objects, show) or "nothing"
                reason = f"finds {found}; then fails {failure.constraint}"
            lines.append(f"{indent}  body {failure.body}: {reason}")
            if failure.inner is not None:
                lines.extend(failure.inner._lines(show, indent + "    "))
        if not self.failures:
            lines.append(f"{indent}  no body of it can ever hold")
        return lines


def _listed(values: Mapping[str, Value], objects: tuple[str, ...], show: Callable[[int], str]) -> str:
    return ", ".join(
        f"{name} = {show(value) if name in objects and isinstance(value, int) else repr(value)}"
        for name, value in values.items()
    )


def why_not(
    planner: Planner,
    build: Build,
    first: Callable[[str, dict[int, Value]], tuple[Value, ...] | None],
    pattern: str,
    given: dict[int, Value],
    asked: Asked = (),
) -> WhyNot:
    """Run each body as far as it goes.

    Args:
        planner: of the matcher.
        build: makes functions.
        first: the first match of a pattern for values at some positions.
        pattern: qualified name.
        given: values by position.
        asked: the calls around this one, which are not looked into once more.
    """
    parameters = [parameter.name for parameter in planner.library.get(pattern).parameters]
    named = {parameters[position]: value for position, value in sorted(given.items())}
    types = planner.library.parameter_types(pattern)
    objects = tuple(
        name for name, type_ in zip(parameters, types, strict=True) if isinstance(type_, ObjectType)
    )
    row = first(pattern, given)
    if row is not None:
        return WhyNot(pattern, named, dict(zip(parameters, row, strict=True)), (), objects)
    found: list[tuple[int, Failure]] = []
    view = planner.view(ViewKey(pattern, tuple(sorted(given)), ()))
    for number, body in enumerate(view.bodies):
        found.append(
            _failure(planner, build, first, pattern, number, body, given, (*asked, (pattern, given)))
        )
    found.sort(key=lambda each: -each[0])
    return WhyNot(pattern, named, None, tuple(failure for _, failure in found), objects)


def _failure(
    planner: Planner,
    build: Build,
    first: Callable[[str, dict[int, Value]], tuple[Value, ...] | None],
    pattern: str,
    number: int,
    body: BodyPlan,
    given: dict[int, Value],
    asked: Asked,
) -> tuple[int, Failure]:
    """How many steps a body takes, and what it fails then."""
    if _contradicted(body.conjunction, given):
        return 0, Failure(number + 1, {}, "")
    with suppress(Unplannable):  # else the plan as it is, which leaves some constraints together
        body = whole(planner, body, tuple(sorted(given)))
    names = Names(planner.library, pattern, number, body)
    names.anonymous = True
    run = trace(planner, body, given, build)
    depth = sum(1 for count in run.counts if count)
    start = {body.conjunction.parameters[position]: value for position, value in given.items()}
    partial = (run.first[depth - 1] or {}) if depth else start
    shown = {names(variable): value for variable, value in partial.items() if names.spoken(variable)}
    types = body.conjunction.types
    objects = tuple(names(variable) for variable in partial if isinstance(types[variable], ObjectType))
    if depth == len(run.counts):
        return depth, Failure(number + 1, shown, "", objects)
    step = body.plan.steps[depth]
    inner = None
    if isinstance(step.goal, CallAtom) and _has_text(step.goal.pattern) and len(asked) <= MOST_LEVELS:
        values: dict[int, Any] = {**dict(body.conjunction.constants), **partial}
        known = {p: values[v] for p, v in enumerate(step.goal.arguments) if v in values}
        if (step.goal.pattern, known) not in asked:
            inner = why_not(planner, build, first, step.goal.pattern, known, asked)
    return depth, Failure(number + 1, shown, goal_text(step, names), objects, inner)


def _has_text(pattern: str) -> bool:
    """Whether a called pattern is one that somebody has written, and not the values of an enum."""
    return not pattern.startswith(f"{VALUES}.")


def _contradicted(conjunction: Conjunction, given: Mapping[int, Value]) -> bool:
    """Whether `==` makes one variable of two that are given different values, or of one and another constant."""
    values: dict[int, Value] = dict(conjunction.constants)
    return any(
        values.setdefault(conjunction.parameters[position], value) != value
        for position, value in given.items()
    )
