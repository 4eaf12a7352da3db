"""Why a pattern has no match: the partial match that comes furthest, and the constraint that it fails.

Of a `not` or `neg` that fails there is a witness: the match that should not be there.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Literal

from envgraph.errors import EnvgraphError, Span
from envgraph.match._explain import Names, goal_text, relation_text
from envgraph.match._options import Unplannable
from envgraph.match._plan import (
    Absence,
    BodyPlan,
    Condition,
    Conjunction,
    Kind,
    Step,
    Valuation,
    ViewKey,
    arguments,
)
from envgraph.match._planner import Planner
from envgraph.match._trace import Build, trace, whole
from envgraph.metamodel import Reference, Value
from envgraph.metamodel.picture import markup
from envgraph.pattern import (
    VALUES,
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    ClosureAtom,
    InstanceAtom,
    LinkAtom,
    NegationAtom,
    ObjectType,
    RelationAtom,
    UnequalAtom,
)

MOST_LEVELS = 6
"""Called patterns that are looked into."""

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
        constraint: what this partial match fails; "" if the given values contradict the body from the start. Of a
            unit, the step and why it fails.
        objects: the variables that stand for objects.
        inner: of a called pattern that has no match, why not; of a group, why one of its rules has none.
        witness: where the constraint is a `not` or `neg`, what it finds.
        span: where the constraint is written, if it was read from a text; of a `not` block, the block.
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
        where = f", line {self.span.line}" if self.span else ""
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
        title = f"`{self.pattern}`" + (f" for {given}" if given else "")
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
    negation = _violated(planner, build, pattern, number, partial) if step.kind is Kind.ABSENT else None
    constraint, span, witness = negation or (
        goal_text(step, names),
        _place(planner, pattern, number, step, names),
        None,
    )
    return depth, Failure(number + 1, shown, constraint, objects, inner, witness, span)


def _violated(
    planner: Planner, build: Build, pattern: str, number: int, partial: Mapping[int, Value]
) -> tuple[str, Span | None, Witness] | None:
    """The first `neg` or `not` of a body that finds something: how it reads, where it stands, and what it finds."""
    lowered = planner.library.lowered(pattern).bodies[number]
    values: dict[int, Any] = {**dict(lowered.constants), **partial}
    for atom in lowered.atoms:
        if not isinstance(atom, NegationAtom):
            continue
        relation = atom.relation
        outer = tuple(sorted({v for v in arguments(relation) if v not in atom.local}))
        if not all(variable in values for variable in outer):
            continue
        body = Conjunction(lowered.types, (), outer, (relation,))
        found = _solution(planner, build, body, {p: values[v] for p, v in enumerate(outer)})
        if found is None:
            continue
        names = Names(planner.library, pattern, number, body)
        names.anonymous = True
        if isinstance(relation, CallAtom):
            given = {position: found[variable] for position, variable in enumerate(relation.arguments)}
            witness = _inside(planner, build, relation.pattern, given)
            called = planner.library.get(relation.pattern)
            if "#" in called.name:  # a block of a rule
                return "the `not` block", called.span, witness
        else:
            spoken = [variable for variable in arguments(relation) if names.spoken(variable)]
            objects = tuple(
                names(variable) for variable in spoken if isinstance(lowered.types[variable], ObjectType)
            )
            named = {names(variable): found[variable] for variable in spoken}
            witness = Witness(named, tuple(_links((relation,), found)), objects)
        text = f"neg {relation_text(relation, names)}"
        return text, _written(planner, pattern, number, relation, names), witness
    return None


def _solution(
    planner: Planner, build: Build, conjunction: Conjunction, given: dict[int, Value]
) -> dict[int, Any] | None:
    """Values for all variables of a conjunction, or None where there are none."""
    try:
        plan = planner.whole(conjunction, tuple(sorted(given)))
    except Unplannable:
        return None
    run = trace(planner, BodyPlan(conjunction, plan, True), given, build)
    return run.first[-1] if run.first else {}


def _inside(planner: Planner, build: Build, pattern: str, given: dict[int, Value]) -> Witness:
    """What a pattern that matches finds inside."""
    for number, body in enumerate(planner.view(ViewKey(pattern, tuple(sorted(given)), ())).bodies):
        if _contradicted(body.conjunction, given):
            continue
        found = _solution(planner, build, body.conjunction, given)
        if found is not None:
            names = Names(planner.library, pattern, number, body)
            spoken = [variable for variable in found if names.spoken(variable)]
            types = body.conjunction.types
            objects = tuple(names(variable) for variable in spoken if isinstance(types[variable], ObjectType))
            links = tuple(_links(body.conjunction.goals, {**dict(body.conjunction.constants), **found}))
            return Witness({names(variable): found[variable] for variable in spoken}, links, objects)
    return Witness({})


def _links(goals: Iterable[object], values: Mapping[int, Any]) -> Iterator[tuple[int, str, int]]:
    for goal in goals:
        if not isinstance(goal, LinkAtom) or not isinstance(goal.reference, Reference):
            continue
        if goal.source in values and goal.target in values:
            yield values[goal.source], goal.reference.name, values[goal.target]


def _place(planner: Planner, pattern: str, number: int, step: Step, names: Names) -> Span | None:
    """Where the constraint of a step is written."""
    goal = step.goal
    if isinstance(goal, Condition | Valuation):
        return goal.expression.span
    if isinstance(goal, UnequalAtom | Absence):
        return None
    return _written(
        planner, pattern, number, goal.relation if isinstance(goal, AggregateAtom) else goal, names
    )


def _written(
    planner: Planner, pattern: str, number: int, relation: RelationAtom, names: Names
) -> Span | None:
    """The constraint of the text that names the relation, and of several the one with most of its variables."""
    match relation:
        case CallAtom(name) | ClosureAtom(name):
            word = name.rpartition(".")[2]
        case InstanceAtom(cls):
            word = cls
        case AttributeAtom(feature) | LinkAtom(feature):
            word = feature.name
    variables = {names(variable) for variable in arguments(relation)}
    source = planner.library.get(pattern).bodies[number]
    written = [constraint.span for constraint in source.constraints if constraint.span is not None]
    words = [(span, set(re.findall(r"\w+", span.text))) for span in written]
    asked = [(len(said & variables), span) for span, said in words if word in said]
    return max(asked, key=lambda each: each[0])[1] if asked else None


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
