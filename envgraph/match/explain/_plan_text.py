"""Format plans and generated source as text."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from envgraph.code import shorten_repr
from envgraph.draw import html_text
from envgraph.match.explain._plan_trace import PlanTrace
from envgraph.match.generate._sources import view_source
from envgraph.match.generate._symbols import ResultMode
from envgraph.match.generate._value_joins import value_join
from envgraph.match.plan._planner import Planner
from envgraph.match.plan._search_plan import BodyPlan, PatternQuery, PlanStep, SearchPlan, StepKind
from envgraph.pattern import (
    PATHS,
    VALUES,
    AbsenceAtom,
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    Closure,
    ClosureAtom,
    ConditionAtom,
    Conjunction,
    Expression,
    InstanceAtom,
    Library,
    LinkAtom,
    RelationAtom,
    UnequalAtom,
    ValuationAtom,
    relation_variables,
)

Actual = Callable[[BodyPlan], PlanTrace]
"""Runs the plan of a body, and returns its trace."""


@shorten_repr
class Explanation(str):
    """A plan as text, with its line breaks shown in notebooks."""

    __slots__ = ()

    def __repr__(self) -> str:
        return f"<explanation of {self.count(chr(10)) + 1} lines: {self.partition(chr(10))[0]}>"

    _repr_html_ = html_text


def explain_view(planner: Planner, key: PatternQuery, actual: Actual | None) -> str:
    """Return as text the plan of every body of a pattern query, and its generated source.

    Args:
        planner: makes the plan.
        key: the pattern query.
        actual: runs a plan and counts rows; None if rows cannot be counted.

    Raises:
        Unplannable: a parameter without a value cannot be enumerated.
    """
    view = planner.plan_pattern(key)
    names = [parameter.name for parameter in planner.library.get(key.pattern).parameters]
    given = ", ".join(names[position] for position in key.bound) or "nothing"
    lines = [f"pattern {key.pattern}({', '.join(names)}), given {given}"]
    for number, body in enumerate(view.bodies, 1):
        lines.append(
            f"body {number}: about {_format_estimate(body.plan.rows)} rows, cost {_format_estimate(body.plan.cost)}"
        )
        run = actual(body) if actual is not None else None
        counts = run.counts if run is not None and run.is_complete else ()
        own = VariableNames(planner.library, key.pattern, number - 1, body)
        bound = [body.conjunction.parameters[position] for position in key.bound]
        lines.extend(steps_text(body.plan, own, "  ", counts, bound))
    if not view.is_distinct:
        lines.append("the plan may find the same row more than once: repeated rows are removed")
    if planner.calls.is_recursive(key.pattern):
        lines.append("recursive: evaluated until no row is added, then the rows are sorted")
    return "\n".join([*lines, "", view_source(planner, key, ResultMode.ROWS).text])


class VariableNames:
    """The names of the variables of a conjunction. Variables added by inlining have only numbers, written `#5`."""

    def __init__(self, library: Library, pattern: str, number: int, body: BodyPlan | Conjunction) -> None:
        lowered = library.lowered_pattern(pattern).bodies[number]
        self._names = dict(enumerate(lowered.names))
        conjunction = body.conjunction if isinstance(body, BodyPlan) else body
        self.constants = dict(conjunction.constants)
        self.types = conjunction.types

    def __call__(self, variable: int) -> str:
        if variable in self.constants:
            return repr(self.constants[variable])
        if self.hides_unnamed and not self.is_named(variable):
            return "_"
        return self._names.get(variable, f"#{variable}")

    hides_unnamed = False
    """True if unnamed variables are written `_`; else they are written as numbers."""

    def is_named(self, variable: int) -> bool:
        """Return True if the text of the pattern names a variable, and the variable is no constant."""
        return variable not in self.constants and not self._names.get(variable, "#").startswith("#")

    def has_name(self, variable: int, name: str) -> bool:
        """Return True if a variable has the given name in the text of this pattern."""
        return self._names.get(variable) == name

    def format_all(self, variables: tuple[int, ...]) -> str:
        """Return the names of some variables, separated by commas."""
        return ", ".join(map(self, variables))


def steps_text(
    plan: SearchPlan,
    names: VariableNames,
    indent: str,
    counts: Sequence[float] = (),
    known: Iterable[int] = (),
    is_view: bool = False,
) -> Iterator[str]:
    """Yield one line for each step of a plan, followed by the indented lines of inner plans.

    Args:
        plan: the plan.
        names: the names of its variables.
        indent: the spaces at the start of each line.
        counts: the measured number of rows after each outer step; empty if not measured.
        known: variables with values before the first step.
        is_view: True if the plan belongs to a view.
    """
    found = frozenset(known) - names.constants.keys()
    for number, step in enumerate(plan.steps):
        join = value_join(step, plan.steps[number + 1 :], found, names.constants, names.types)
        how = ", looked up by value" if join and join.is_usable(is_view) else ""
        count = counts[number] if counts else None
        actual = f", actually {count:.3g}" if isinstance(count, float) else f", actually {count}" if counts else ""
        yield (
            f"{indent}{_VERBS[step.kind]:7} {goal_text(step, names)}{how}  (rows {_format_estimate(step.rows)}{actual})"
        )
        for inner in step.inner:
            if not isinstance(step.goal, AggregateAtom):
                yield from steps_text(inner, names, indent + "  ", (), found, is_view)
        found = found.union(step.binds)


_VERBS = {
    StepKind.TEST: "test",
    StepKind.BIND: "bind",
    StepKind.LOOP: "for",
    StepKind.ABSENT: "test",
    StepKind.EXISTS: "if any",
}


def goal_text(step: PlanStep, names: VariableNames) -> str:
    """Return the constraint of a step as text; "of" for an existence test, since the steps inside it follow."""
    goal = step.goal
    if step.kind is StepKind.EXISTS:
        return "of"
    match goal:
        case AbsenceAtom(alternatives) if all(len(each) == 1 for each in alternatives):
            negated = (replace(step, goal=goal, kind=StepKind.TEST) for (goal,) in alternatives)
            return " and ".join(f"neg {goal_text(test, names)}" for test in negated)
        case AbsenceAtom(alternatives, outer):
            return f"neg any of {len(alternatives)} for {names.format_all(outer) or 'nothing'}"
        case ConditionAtom(expression, reads):
            return f"check({_expression_text(expression, reads, names)})"
        case ValuationAtom(expression, reads, result):
            return f"{names(result)} == eval({_expression_text(expression, reads, names)})"
        case AggregateAtom(function, relation, local, result, column):
            inside = {v: "#" if v == column else "_" for v in local}
            return f"{names(result)} == {function} {relation_text(relation, names, inside)}"
        case UnequalAtom(left, right):
            return f"{names(left)} != {names(right)}"
        case _:
            return relation_text(goal, names)


def _expression_text(expression: Expression, reads: Sequence[tuple[str, int]], names: VariableNames) -> str:
    """Return an expression as written; if it has no text, or its variables other names here, return its variables."""
    if expression.span is not None and all(names.has_name(variable, name) for name, variable in reads):
        return " ".join(expression.span.text.split())
    return names.format_all(tuple(variable for _, variable in reads))


def relation_text(relation: RelationAtom, names: VariableNames, inside: Mapping[int, str] | None = None) -> str:
    """Return a relation with its variables as text. `inside` gives the text of variables local to an aggregate."""
    listed = ", ".join((inside or {}).get(v) or names(v) for v in relation_variables(relation))
    match relation:
        case InstanceAtom(cls, _, exact):
            return f"{cls}({listed}){' exactly' if exact else ''}"
        case AttributeAtom(feature) | LinkAtom(feature):
            return f"{feature}({listed})"
        case CallAtom(pattern):
            package, _, name = pattern.partition(".")
            return f"{name}({listed})" if package == VALUES else f"find {pattern}({listed})"
        case ClosureAtom(step, closure):
            sign = "*" if closure is Closure.STAR else "+"
            package, _, path = step.partition(".")
            return f"{path}{sign}({listed})" if package == PATHS else f"find {step}{sign}({listed})"


def _format_estimate(value: float) -> str:
    """Return an estimate as text, with two significant digits if it is below 10."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"
