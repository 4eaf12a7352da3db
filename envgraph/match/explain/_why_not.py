"""Explain why a pattern has no match: the partial match that satisfies most steps, and the constraint that it fails.

If this constraint is a `not` or `neg`, the explanation has a witness: the match that should not exist.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import field
from pathlib import PurePath
from typing import Any, Literal

from envgraph.code import dataclass
from envgraph.draw import html_text
from envgraph.errors import EnvgraphError, Span
from envgraph.match.explain._plan_text import VariableNames, goal_text
from envgraph.match.explain._plan_trace import Build, trace_plan
from envgraph.match.plan._planner import Planner
from envgraph.match.plan._search_plan import BodyPlan, PlanStep
from envgraph.metamodel import Reference, Value
from envgraph.pattern import (
    VALUES,
    AbsenceAtom,
    CallAtom,
    Conjunction,
    Goal,
    InstanceAtom,
    LinkAtom,
    ObjectType,
    UnequalAtom,
    is_relation,
    relation_variables,
    visible_variables,
)

_MOST_CALLS = 6
"""The nesting depth up to which called patterns are explained: recursive patterns call themselves with new objects."""

ExplainedCalls = tuple[tuple[str, dict[int, Value]], ...]
"""The explained calls: patterns with values by position."""


@dataclass(frozen=True, slots=True)
class Witness:
    """The match of a `not` or `neg` that makes it fail.

    Attributes:
        found: the values of its named variables; objects as ids.
        links: source, reference and target of the links in it; objects as ids.
        objects: the names of the variables that stand for objects.
    """

    found: Mapping[str, Value]
    links: tuple[tuple[int, str, int], ...] = ()
    objects: tuple[str, ...] = ()

    def text(self, show: Callable[[int], str], known: Mapping[str, Value]) -> str:
        """Return the witness in one line: `other = `right`; `right` -at-> `Aisle#6``. Omit values in `known`."""
        links = [f"{_object(source, show)} -{name}-> {_object(target, show)}" for source, name, target in self.links]
        new = {name: value for name, value in self.found.items() if known.get(name) != value}
        return "; ".join(
            text for text in (_format_values(new or self.found, self.objects, show), ", ".join(links)) if text
        )


@dataclass(frozen=True, slots=True)
class BodyFailure:
    """The explanation why one body has no match.

    Attributes:
        body: the number of the body, from 1; 0 for the step of a unit that fails, and for a rule of a group.
        found: the values of the named variables in the partial match with most steps; objects as ids.
        constraint: the constraint that fails, as written; "" if the given values contradict the body from the start.
            For a unit: the step, and the reason why it fails.
        objects: the names of the variables that stand for objects.
        inner: the explanation for a called pattern without a match, or for one rule of a group; else None.
        witness: the match of a `not` or `neg` constraint that fails; else None.
        span: the place of the constraint in its text, if it was read from a text; for a block of a rule, the block.
        distinct: the two names, if the constraint is that they are different objects and is not written in a text.
    """

    body: int
    found: Mapping[str, Value]
    constraint: str
    objects: tuple[str, ...] = ()
    inner: WhyNot | None = None
    witness: Witness | None = None
    span: Span | None = field(default=None, compare=False)
    distinct: tuple[str, str] | None = None

    def lines(self, show: Callable[[int], str], indent: str) -> list[str]:
        """Return the explanation as indented lines of text. `show` returns the text of an object."""
        reason = "the given values contradict this body"
        where = f" ({_format_position(self.span)})" if self.span else ""
        if self.constraint:
            found = _format_values(self.found, self.objects, show) or "nothing"
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
    """The explanation why a pattern has no match for given values.

    Attributes:
        pattern: the qualified name of the pattern, rule, unit or group.
        given: the given values, by parameter.
        match: the match, by parameter, if there is one after all; else None.
        failures: one for each body, the longest partial match first; empty if there is a match.
        objects: the names of the parameters that stand for objects.
        show: returns the text of an object, given its id.
        refusal: for a rule with a match, the reason why it cannot be applied there; None if it can.
        kind: the kind of definition; a unit "has a match" if it succeeds.
    """

    pattern: str
    given: Mapping[str, Value]
    match: Mapping[str, Value] | None
    failures: tuple[BodyFailure, ...]
    objects: tuple[str, ...] = ()
    show: Callable[[int], str] = field(default="#{}".format, compare=False, repr=False)
    refusal: EnvgraphError | None = field(default=None, compare=False)
    kind: Literal["pattern", "rule", "unit", "group"] = "pattern"

    def __str__(self) -> str:
        return "\n".join(self.lines(self.show, ""))

    _repr_html_ = html_text

    def lines(self, show: Callable[[int], str], indent: str) -> list[str]:
        """Return the explanation as indented lines of text. `show` returns the text of an object."""
        given = _format_values(self.given, self.objects, show)
        title = (_block_of_pattern(self.pattern) or f"`{self.pattern}`") + (f" for {given}" if given else "")
        if self.match is not None:
            found = _format_values(self.match, self.objects, show)
            refused = str(self.refusal).splitlines() if self.refusal else []
            verb = "succeeds" if self.kind == "unit" else "has a match"
            return [f"{indent}{title} {verb}" + (f": {found}" if found else ""), *refused]
        lines = [f"{indent}{title} {'fails' if self.kind == 'unit' else 'has no match'}"]
        for failure in self.failures:
            lines.extend(failure.lines(show, indent + "  "))
            if self.kind == "rule" and failure.distinct is not None:
                names = ", ".join(failure.distinct)
                lines.append(
                    f"{indent}    different names stand for different objects, unless the rule has `@hom({names})`"
                )
        if not self.failures:
            lines.append(f"{indent}  it never has a match: each of its bodies contradicts itself")
        return lines

    def failing_spans(self) -> list[Span]:
        """Return the spans of the failing constraints, each once. Those of called patterns follow those of callers."""
        found: dict[tuple[str, int], Span] = {}
        for failure in self.failures:
            spans = [failure.span] if failure.span else []
            for span in (*spans, *(failure.inner.failing_spans() if failure.inner else ())):
                found.setdefault((span.source.name, span.start), span)
        return [*found.values()]


def _object(value: Value, show: Callable[[int], str]) -> str:
    """Return the text of an object, given its id."""
    assert isinstance(value, int)
    return show(value)


def _format_values(values: Mapping[str, Value], objects: tuple[str, ...], show: Callable[[int], str]) -> str:
    """Return variables with their values as text, separated by commas."""
    return ", ".join(
        f"{name} = {show(value) if name in objects and isinstance(value, int) else repr(value)}"
        for name, value in values.items()
    )


@dataclass(frozen=True, slots=True)
class FailureSearch:
    """A search for the reasons why patterns have no match: runs each body up to the step that fails.

    Attributes:
        planner: the planner of the matcher.
        build: creates functions of source.
        first: returns the first match of a pattern for values at some positions, or None.
    """

    planner: Planner
    build: Build
    first: Callable[[str, dict[int, Value]], tuple[Value, ...] | None]

    def why_not(self, pattern: str, given: dict[int, Value], outer_calls: ExplainedCalls = ()) -> WhyNot:
        """Return the explanation why a pattern has no match for given values, or the match if there is one.

        Args:
            pattern: qualified name.
            given: the values by position.
            outer_calls: the calls around this one, which are not explained again.
        """
        library = self.planner.library
        parameters = [parameter.name for parameter in library.get(pattern).parameters]
        named = {parameters[position]: value for position, value in sorted(given.items())}
        typed = zip(parameters, library.parameter_types(pattern), strict=True)
        objects = tuple(name for name, type_ in typed if isinstance(type_, ObjectType))
        row = self.first(pattern, given)
        if row is not None:
            return WhyNot(pattern, named, dict(zip(parameters, row, strict=True)), (), objects)
        inside = (*outer_calls, (pattern, given))
        bodies = enumerate(library.lowered_pattern(pattern).bodies)
        found = [self._explain_body(pattern, number, body, given, inside) for number, body in bodies]
        found.sort(key=lambda each: -each[0])
        return WhyNot(pattern, named, None, tuple(failure for _, failure in found), objects)

    def _explain_body(
        self,
        pattern: str,
        number: int,
        conjunction: Conjunction,
        given: dict[int, Value],
        asked: ExplainedCalls,
    ) -> tuple[int, BodyFailure]:
        """Return how many steps of a body succeed, and the explanation of its failure.

        Each goal becomes one step, without inlining, so that the failed constraint is one that was written.
        """
        if _is_contradictory(conjunction, given):
            return 0, BodyFailure(number + 1, {}, "")
        body = BodyPlan(conjunction, self.planner.plan_all_variables(conjunction, tuple(sorted(given))), True)
        names = VariableNames(self.planner.library, pattern, number, body)
        names.hides_unnamed = True
        run = trace_plan(self.planner, body, given, self.build)
        depth = sum(1 for count in run.counts if count)
        start = {conjunction.parameters[position]: value for position, value in given.items()}
        partial = (run.first[depth - 1] or {}) if depth else start
        shown = {names(variable): value for variable, value in partial.items() if names.is_named(variable)}
        objects = _objects(names, partial, conjunction)
        if depth == len(run.counts):
            return depth, BodyFailure(number + 1, shown, "", objects)
        step = body.plan.steps[depth]
        position = _goal_of(step, conjunction)
        goal, span = conjunction.goals[position], conjunction.spans[position]
        relation = goal.alternatives[0][0] if isinstance(goal, AbsenceAtom) else goal
        constraint = _block_of_pattern(relation.pattern) if isinstance(relation, CallAtom) else None
        constraint = constraint or (_format_written(span, conjunction, step.goal) if span else goal_text(step, names))
        if isinstance(goal, InstanceAtom) and constraint == names(goal.variable):  # the declared type of a parameter
            constraint = f"{constraint} : {goal.cls}"
        values: dict[int, Any] = {**dict(conjunction.constants), **partial}
        inner = witness = None
        if isinstance(goal, AbsenceAtom):
            witness = self._witness(names, conjunction, goal, values)
        elif isinstance(goal, CallAtom) and not goal.pattern.startswith(f"{VALUES}.") and len(asked) <= _MOST_CALLS:
            known = {p: values[v] for p, v in enumerate(goal.arguments) if v in values}
            if (goal.pattern, known) not in asked:
                inner = self.why_not(goal.pattern, known, asked)
        distinct = (names(goal.left), names(goal.right)) if isinstance(goal, UnequalAtom) and span is None else None
        return depth, BodyFailure(number + 1, shown, constraint, objects, inner, witness, span, distinct)

    def _witness(
        self, names: VariableNames, conjunction: Conjunction, goal: AbsenceAtom, values: Mapping[int, Any]
    ) -> Witness:
        """Return the match that makes a `neg` or `not` fail."""
        ((relation,),) = goal.alternatives
        assert is_relation(relation)
        outer = tuple(sorted(goal.outer))
        body = Conjunction(conjunction.types, (), outer, (relation,))
        found = self._solution(body, {p: values[v] for p, v in enumerate(outer)})
        assert found is not None, "it has failed because of this"
        if isinstance(relation, CallAtom):
            given = {position: found[variable] for position, variable in enumerate(relation.arguments)}
            return self._witness_in_pattern(relation.pattern, given)
        return _make_witness(names, body, {variable: found[variable] for variable in relation_variables(relation)})

    def _solution(self, conjunction: Conjunction, given: dict[int, Value]) -> dict[int, Any] | None:
        """Return the values of all variables in the first solution of a conjunction; None if there is no solution."""
        plan = self.planner.plan_all_variables(conjunction, tuple(sorted(given)))
        run = trace_plan(self.planner, BodyPlan(conjunction, plan, True), given, self.build)
        return run.first[-1] if run.first else {}

    def _witness_in_pattern(self, pattern: str, given: dict[int, Value]) -> Witness:
        """Return the witness for a match of a called pattern: the first solution of a body; empty if none is found."""
        for number, body in enumerate(self.planner.library.lowered_pattern(pattern).bodies):
            found = None if _is_contradictory(body, given) else self._solution(body, given)
            if found is not None:
                return _make_witness(VariableNames(self.planner.library, pattern, number, body), body, found)
        return Witness({})


def _make_witness(names: VariableNames, body: Conjunction, values: Mapping[int, Any]) -> Witness:
    """Return a solution of a body as a witness: the values of its named variables, and its links."""
    shown = {names(variable): value for variable, value in values.items() if names.is_named(variable)}
    links = tuple(_links(body.goals, {**dict(body.constants), **values}))
    return Witness(shown, links, _objects(names, filter(names.is_named, values), body))


def _objects(names: VariableNames, variables_: Iterable[int], body: Conjunction) -> tuple[str, ...]:
    """Return the names of those of the given variables that stand for objects."""
    return tuple(names(v) for v in variables_ if isinstance(body.types[v], ObjectType))


def _goal_of(step: PlanStep, conjunction: Conjunction) -> int:
    """Return the number of the goal that a step solves; for a loop without a goal, of a goal with its variable."""
    goals = conjunction.goals
    met = [number for number, goal in enumerate(goals) if goal is step.goal]
    return (met or [n for n, goal in enumerate(goals) if not set(step.binds).isdisjoint(visible_variables(goal))])[0]


def _links(goals: Iterable[object], values: Mapping[int, Any]) -> Iterator[tuple[int, str, int]]:
    """Yield source, reference and target of the link goals whose ends have values."""
    for goal in goals:
        if not isinstance(goal, LinkAtom) or not isinstance(goal.reference, Reference):
            continue
        if goal.source in values and goal.target in values:
            yield values[goal.source], goal.reference.name, values[goal.target]


def _format_position(span: Span) -> str:
    """Return the position of a text without its directory: `forest.query:12:5`."""
    return PurePath(str(span)).name


def _format_written(span: Span, body: Conjunction, goal: Goal) -> str:
    """Return a constraint as written, with the values that constraints such as `x == 0` give its variables."""
    fixed = {v: value for v, value in body.constants if not body.names[v].startswith("#")}
    equal = [f"{body.names[v]} == {fixed[v]!r}" for v in dict.fromkeys(visible_variables(goal)) if v in fixed]
    return " ".join(span.text.rstrip(";").split()) + (f" where {', '.join(equal)}" if equal else "")


def _block_of_pattern(pattern: str) -> str | None:
    """Return the rule block that a pattern was made from ("the `not` block" for `drive#not1`); None for others."""
    kind = re.search(r"#(not|require|forall|optional)\d+$", pattern)
    return f"the `{kind[1]}` block" if kind else None


def _is_contradictory(conjunction: Conjunction, given: Mapping[int, Value]) -> bool:
    """Return True if the given values contradict each other or a constant, because `==` unites two variables."""
    values: dict[int, Value] = dict(conjunction.constants)
    return any(values.setdefault(conjunction.parameters[position], value) != value for position, value in given.items())
