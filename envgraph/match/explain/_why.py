"""Why a pattern has no match: the partial match that comes furthest, and the constraint that it fails.

Of a `not` or `neg` that fails there is a witness: the match that should not be there.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import field
from pathlib import PurePath
from typing import Any, Literal

from envgraph.code import dataclass
from envgraph.draw import markup
from envgraph.errors import EnvgraphError, Span
from envgraph.match.explain._explain import Names, goal_text
from envgraph.match.explain._trace import Build, trace
from envgraph.match.plan._plan import BodyPlan, Step
from envgraph.match.plan._planner import Planner
from envgraph.metamodel import Reference, Value
from envgraph.pattern import (
    VALUES,
    Absence,
    CallAtom,
    Conjunction,
    Goal,
    InstanceAtom,
    LinkAtom,
    ObjectType,
    arguments,
    is_relation,
    variables,
)

_MOST_CALLS = 6
"""Called patterns that are looked into, one inside the other: recursive ones ask about other objects each time."""

Asked = tuple[tuple[str, dict[int, Value]], ...]
"""Calls: patterns with values by position."""


@dataclass(frozen=True, slots=True)
class Witness:
    """What a `not` or `neg` finds, and should not.

    Attributes:
        found: values of the variables that have a name there; objects as ids.
        links: source, reference and target of the links that are asked for there; objects as ids.
        objects: the variables that stand for objects.
    """

    found: Mapping[str, Value]
    links: tuple[tuple[int, str, int], ...] = ()
    objects: tuple[str, ...] = ()

    def text(self, show: Callable[[int], str], known: Mapping[str, Value]) -> str:
        """In one line: `other = `right`; `right` -at-> `Aisle#6``."""
        links = [
            f"{_object(source, show)} -{name}-> {_object(target, show)}"
            for source, name, target in self.links
        ]
        new = {name: value for name, value in self.found.items() if known.get(name) != value}
        return "; ".join(
            text for text in (_listed(new or self.found, self.objects, show), ", ".join(links)) if text
        )


@dataclass(frozen=True, slots=True)
class Failure:
    """How far one body comes.

    Attributes:
        body: its number, from 1; 0 for the step of a unit that fails, and for a rule of a group.
        found: values of the variables of the deepest partial match, by name; objects as ids.
        constraint: what this partial match fails, as it is written; "" if the given values contradict the body from
            the start. Of a unit, the step and why it fails.
        objects: the variables that stand for objects.
        inner: of a called pattern that has no match, why not; of a group, why one of its rules has none.
        witness: where the constraint is a `not` or `neg`, what it finds.
        span: where the constraint is written, if it was read from a text; of a block of a rule, the block.
    """

    body: int
    found: Mapping[str, Value]
    constraint: str
    objects: tuple[str, ...] = ()
    inner: WhyNot | None = None
    witness: Witness | None = None
    span: Span | None = field(default=None, compare=False)

    def lines(self, show: Callable[[int], str], indent: str) -> list[str]:
        """As people read it."""
        reason = "the given values contradict it"
        where = f" ({_place(self.span)})" if self.span else ""
        if self.constraint:
            found = _listed(self.found, self.objects, show) or "nothing"
            reason = f"finds {found}; then fails {self.constraint}{where}"
        lines = [f"{indent}body {self.body}: {reason}"]
        if not self.body:
            lines = [f"{indent}{self.constraint}{where}"] if self.constraint else []
        if self.witness is not None:
            lines.append(f"{indent}  which finds {self.witness.text(show, self.found) or 'a match'}")
        if self.inner is not None:
            lines.extend(self.inner.lines(show, indent + "  "))
        return lines


@dataclass(frozen=True, slots=True)
class WhyNot:
    """Why a pattern has no match for some values.

    Attributes:
        pattern: its qualified name; that of a rule, unit or group where one was asked for.
        given: the values, by parameter.
        match: a match all the same, by parameter; None if there is none.
        failures: one for each body, the furthest first; none if there is a match.
        objects: the parameters that stand for objects.
        show: the text of an object, by its id.
        refusal: of a rule that has the match, why it cannot be applied there; None if it can.
        kind: what was asked for; a unit "has a match" if it succeeds.
    """

    pattern: str
    given: Mapping[str, Value]
    match: Mapping[str, Value] | None
    failures: tuple[Failure, ...]
    objects: tuple[str, ...] = ()
    show: Callable[[int], str] = field(default="#{}".format, compare=False, repr=False)
    refusal: EnvgraphError | None = field(default=None, compare=False)
    kind: Literal["pattern", "rule", "unit", "group"] = "pattern"

    def __str__(self) -> str:
        return "\n".join(self.lines(self.show, ""))

    def _repr_html_(self) -> str:
        return f"<pre>{'<br>'.join(map(markup, str(self).splitlines()))}</pre>"

    def lines(self, show: Callable[[int], str], indent: str) -> list[str]:
        """As people read it."""
        given = _listed(self.given, self.objects, show)
        title = (_block(self.pattern) or f"`{self.pattern}`") + (f" for {given}" if given else "")
        if self.match is not None:
            found = _listed(self.match, self.objects, show)
            refused = str(self.refusal).splitlines() if self.refusal else []
            verb = "succeeds" if self.kind == "unit" else "has a match"
            return [f"{indent}{title} {verb}" + (f": {found}" if found else ""), *refused]
        lines = [f"{indent}{title} {'fails' if self.kind == 'unit' else 'has no match'}"]
        for failure in self.failures:
            lines.extend(failure.lines(show, indent + "  "))
        if not self.failures:
            lines.append(f"{indent}  no body of it can ever hold")
        return lines


def _object(value: Value, show: Callable[[int], str]) -> str:
    assert isinstance(value, int)
    return show(value)


def _listed(values: Mapping[str, Value], objects: tuple[str, ...], show: Callable[[int], str]) -> str:
    return ", ".join(
        f"{name} = {show(value) if name in objects and isinstance(value, int) else repr(value)}"
        for name, value in values.items()
    )


@dataclass(frozen=True, slots=True)
class Reasons:
    """Finds out why patterns have no match: runs each body as far as it goes.

    Attributes:
        planner: of the matcher.
        build: makes functions.
        first: gives the first match of a pattern for values at some positions.
    """

    planner: Planner
    build: Build
    first: Callable[[str, dict[int, Value]], tuple[Value, ...] | None]

    def why_not(self, pattern: str, given: dict[int, Value], asked: Asked = ()) -> WhyNot:
        """Run each body of a pattern as far as it goes.

        Args:
            pattern: qualified name.
            given: values by position.
            asked: the calls around this one, which are not looked into once more.
        """
        library = self.planner.library
        parameters = [parameter.name for parameter in library.get(pattern).parameters]
        named = {parameters[position]: value for position, value in sorted(given.items())}
        typed = zip(parameters, library.parameter_types(pattern), strict=True)
        objects = tuple(name for name, type_ in typed if isinstance(type_, ObjectType))
        row = self.first(pattern, given)
        if row is not None:
            return WhyNot(pattern, named, dict(zip(parameters, row, strict=True)), (), objects)
        inside = (*asked, (pattern, given))
        bodies = enumerate(library.lowered(pattern).bodies)
        found = [self._failure(pattern, number, body, given, inside) for number, body in bodies]
        found.sort(key=lambda each: -each[0])
        return WhyNot(pattern, named, None, tuple(failure for _, failure in found), objects)

    def _failure(
        self, pattern: str, number: int, conjunction: Conjunction, given: dict[int, Value], asked: Asked
    ) -> tuple[int, Failure]:
        """Return how many steps a body takes, and what it fails then.

        Each goal is a step of its own: what it comes from is what was written, though a plan for matching inlines it.
        """
        if _contradicted(conjunction, given):
            return 0, Failure(number + 1, {}, "")
        body = BodyPlan(conjunction, self.planner.whole(conjunction, tuple(sorted(given))), True)
        names = Names(self.planner.library, pattern, number, body)
        names.anonymous = True
        run = trace(self.planner, body, given, self.build)
        depth = sum(1 for count in run.counts if count)
        start = {conjunction.parameters[position]: value for position, value in given.items()}
        partial = (run.first[depth - 1] or {}) if depth else start
        shown = {names(variable): value for variable, value in partial.items() if names.spoken(variable)}
        objects = _objects(names, partial, conjunction)
        if depth == len(run.counts):
            return depth, Failure(number + 1, shown, "", objects)
        step = body.plan.steps[depth]
        position = _goal_of(step, conjunction)
        goal, span = conjunction.goals[position], conjunction.spans[position]
        relation = goal.alternatives[0][0] if isinstance(goal, Absence) else goal
        constraint = _block(relation.pattern) if isinstance(relation, CallAtom) else None
        constraint = constraint or (
            _written(span, conjunction, step.goal) if span else goal_text(step, names)
        )
        if isinstance(goal, InstanceAtom) and constraint == names(goal.variable):  # the type of a parameter
            constraint = f"{constraint} : {goal.cls}"
        values: dict[int, Any] = {**dict(conjunction.constants), **partial}
        inner = witness = None
        if isinstance(goal, Absence):
            witness = self._witness(names, conjunction, goal, values)
        elif isinstance(goal, CallAtom) and _has_text(goal.pattern) and len(asked) <= _MOST_CALLS:
            known = {p: values[v] for p, v in enumerate(goal.arguments) if v in values}
            if (goal.pattern, known) not in asked:
                inner = self.why_not(goal.pattern, known, asked)
        return depth, Failure(number + 1, shown, constraint, objects, inner, witness, span)

    def _witness(
        self, names: Names, conjunction: Conjunction, goal: Absence, values: Mapping[int, Any]
    ) -> Witness:
        """Return what a `neg` or `not` that fails finds."""
        ((relation,),) = goal.alternatives
        assert is_relation(relation)
        outer = tuple(sorted(goal.outer))
        body = Conjunction(conjunction.types, (), outer, (relation,))
        found = self._solution(body, {p: values[v] for p, v in enumerate(outer)})
        assert found is not None, "it has failed because of this"
        if isinstance(relation, CallAtom):
            given = {position: found[variable] for position, variable in enumerate(relation.arguments)}
            return self._inside(relation.pattern, given)
        return _found(names, body, {variable: found[variable] for variable in arguments(relation)})

    def _solution(self, conjunction: Conjunction, given: dict[int, Value]) -> dict[int, Any] | None:
        """Values for all variables of a conjunction, or None where there are none."""
        plan = self.planner.whole(conjunction, tuple(sorted(given)))
        run = trace(self.planner, BodyPlan(conjunction, plan, True), given, self.build)
        return run.first[-1] if run.first else {}

    def _inside(self, pattern: str, given: dict[int, Value]) -> Witness:
        """Return what a pattern that matches finds inside."""
        for number, body in enumerate(self.planner.library.lowered(pattern).bodies):
            found = None if _contradicted(body, given) else self._solution(body, given)
            if found is not None:
                return _found(Names(self.planner.library, pattern, number, body), body, found)
        return Witness({})


def _found(names: Names, body: Conjunction, values: Mapping[int, Any]) -> Witness:
    """Return what a body finds with these values."""
    shown = {names(variable): value for variable, value in values.items() if names.spoken(variable)}
    links = tuple(_links(body.goals, {**dict(body.constants), **values}))
    return Witness(shown, links, _objects(names, filter(names.spoken, values), body))


def _objects(names: Names, variables_: Iterable[int], body: Conjunction) -> tuple[str, ...]:
    return tuple(names(v) for v in variables_ if isinstance(body.types[v], ObjectType))


def _goal_of(step: Step, conjunction: Conjunction) -> int:
    """The goal that a step meets, or whose objects it lists where none of its class was asked for."""
    goals = conjunction.goals
    met = [number for number, goal in enumerate(goals) if goal is step.goal]
    return (met or [n for n, goal in enumerate(goals) if not set(step.binds).isdisjoint(variables(goal))])[0]


def _links(goals: Iterable[object], values: Mapping[int, Any]) -> Iterator[tuple[int, str, int]]:
    for goal in goals:
        if not isinstance(goal, LinkAtom) or not isinstance(goal.reference, Reference):
            continue
        if goal.source in values and goal.target in values:
            yield values[goal.source], goal.reference.name, values[goal.target]


def _place(span: Span) -> str:
    """Return where a text stands, without the directory: `forest.query:12:5`."""
    return PurePath(str(span)).name


def _written(span: Span, body: Conjunction, goal: Goal) -> str:
    """A constraint as it is written, with the values that other constraints, `x == 0`, give its variables."""
    fixed = {v: value for v, value in body.constants if not body.names[v].startswith("#")}
    equal = [f"{body.names[v]} == {fixed[v]!r}" for v in dict.fromkeys(variables(goal)) if v in fixed]
    return " ".join(span.text.rstrip(";").split()) + (f" where {', '.join(equal)}" if equal else "")


def _block(pattern: str) -> str | None:
    """The block of a rule that a pattern was made of, for `drive#not1` the `not` block; None of any other."""
    kind = re.search(r"#(not|require|forall|optional)\d+$", pattern)
    return f"the `{kind[1]}` block" if kind else None


def _has_text(pattern: str) -> bool:
    """Return whether a called pattern is one that somebody has written, and not the values of an enum."""
    return not pattern.startswith(f"{VALUES}.")


def _contradicted(conjunction: Conjunction, given: Mapping[int, Value]) -> bool:
    """Return whether `==` makes one variable of two that are given different values, or of one and another constant."""
    values: dict[int, Value] = dict(conjunction.constants)
    return any(
        values.setdefault(conjunction.parameters[position], value) != value
        for position, value in given.items()
    )
