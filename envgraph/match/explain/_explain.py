"""Format plans and generated source as text."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from envgraph.code import short_repr
from envgraph.draw import markup
from envgraph.match.explain._trace import Trace
from envgraph.match.generate._sources import view_source
from envgraph.match.generate._symbols import Mode
from envgraph.match.generate._value_joins import value_join
from envgraph.match.plan._plan import BodyPlan, Kind, Plan, Step, ViewKey
from envgraph.match.plan._planner import Planner
from envgraph.pattern import (
    PATHS,
    VALUES,
    Absence,
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    Closure,
    ClosureAtom,
    Condition,
    Conjunction,
    Expression,
    Goal,
    InstanceAtom,
    Library,
    LinkAtom,
    RelationAtom,
    UnequalAtom,
    Valuation,
    arguments,
)

Actual = Callable[[BodyPlan], Trace]
"""Runs the plan of a body, and returns its trace."""


@short_repr
class Explanation(str):
    """A plan as text, with its line breaks shown in notebooks."""

    __slots__ = ()

    def __repr__(self) -> str:
        return f"<explanation of {self.count(chr(10)) + 1} lines: {self.partition(chr(10))[0]}>"

    def _repr_html_(self) -> str:
        return f"<pre>{'<br>'.join(map(markup, self.splitlines()))}</pre>"


def explain_view(planner: Planner, key: ViewKey, actual: Actual | None) -> str:
    """Return as text the plan of every body of a pattern query, and its generated source.

    Args:
        planner: makes the plan.
        key: the pattern query.
        actual: runs a plan and counts rows; None if rows cannot be counted.

    Raises:
        Unplannable: a parameter without a value cannot be enumerated.
    """
    view = planner.view(key)
    names = [parameter.name for parameter in planner.library.get(key.pattern).parameters]
    given = ", ".join(names[position] for position in key.bound) or "nothing"
    lines = [f"pattern {key.pattern}({', '.join(names)}), given {given}"]
    for number, body in enumerate(view.bodies, 1):
        lines.append(f"body {number}: about {_number(body.plan.rows)} rows, cost {_number(body.plan.cost)}")
        run = actual(body) if actual is not None else None
        counts = run.counts if run is not None and run.whole else ()
        own = Names(planner.library, key.pattern, number - 1, body)
        bound = [body.conjunction.parameters[position] for position in key.bound]
        lines.extend(steps_text(body.plan, own, "  ", counts, bound))
    if not view.distinct:
        lines.append("the plan may find the same row more than once: repeated rows are removed")
    if planner.calls.recursive(key.pattern):
        lines.append("recursive: evaluated until no row is added, then the rows are sorted")
    return "\n".join([*lines, "", view_source(planner, key, Mode.ROWS).text])


class Names:
    """The names of the variables of a conjunction. Variables added by inlining have only numbers, written `#5`."""

    def __init__(self, library: Library, pattern: str, number: int, body: BodyPlan | Conjunction) -> None:
        lowered = library.lowered(pattern).bodies[number]
        self._names = dict(enumerate(lowered.names))
        conjunction = body.conjunction if isinstance(body, BodyPlan) else body
        self.constants = dict(conjunction.constants)
        self.types = conjunction.types

    def __call__(self, variable: int) -> str:
        if variable in self.constants:
            return repr(self.constants[variable])
        if self.anonymous and not self.spoken(variable):
            return "_"
        return self._names.get(variable, f"#{variable}")

    anonymous = False
    """True if unnamed variables are written `_`; else they are written as numbers."""

    def spoken(self, variable: int) -> bool:
        """Return True if the text of the pattern names a variable, and the variable is no constant."""
        return variable not in self.constants and not self._names.get(variable, "#").startswith("#")

    def called(self, variable: int, name: str) -> bool:
        """Return True if a variable has the given name in the text of this pattern."""
        return self._names.get(variable) == name

    def all(self, variables: tuple[int, ...]) -> str:
        """Return the names of some variables, separated by commas."""
        return ", ".join(map(self, variables))


def steps_text(
    plan: Plan,
    names: Names,
    indent: str,
    counts: Sequence[float] = (),
    known: Iterable[int] = (),
    watched: bool = False,
) -> Iterator[str]:
    """Yield one line for each step of a plan, followed by the indented lines of inner plans.

    Args:
        plan: the plan.
        names: the names of its variables.
        indent: the spaces at the start of each line.
        counts: the measured number of rows after each outer step; empty if not measured.
        known: variables with values before the first step.
        watched: True if the plan belongs to a view.
    """
    found = frozenset(known) - names.constants.keys()
    for number, step in enumerate(plan.steps):
        join = value_join(step, plan.steps[number + 1 :], found, names.constants, names.types)
        how = ", looked up by value" if join and join.usable(watched) else ""
        actual = f", actually {_exactly(counts[number])}" if counts else ""
        yield f"{indent}{_VERBS[step.kind]:7} {goal_text(step, names)}{how}  (rows {_number(step.rows)}{actual})"
        for inner in step.inner:
            if not isinstance(step.goal, AggregateAtom):
                yield from steps_text(inner, names, indent + "  ", (), found, watched)
        found = found.union(step.binds)


_VERBS = {
    Kind.TEST: "test",
    Kind.BIND: "bind",
    Kind.LOOP: "for",
    Kind.ABSENT: "test",
    Kind.EXISTS: "if any",
}


def goal_text(step: Step, names: Names) -> str:
    """Return the constraint of a step as text; "of" for an existence test, since the steps inside it follow."""
    goal = step.goal
    if step.kind is Kind.EXISTS:
        return "of"
    match goal:
        case Absence(alternatives) if all(len(each) == 1 for each in alternatives):
            return " and ".join(_negated(each[0], step, names) for each in alternatives)
        case Absence(alternatives, outer):
            return f"neg any of {len(alternatives)} for {names.all(outer) or 'nothing'}"
        case Condition(expression, reads):
            return f"check({_expression_text(expression, reads, names)})"
        case Valuation(expression, reads, result):
            return f"{names(result)} == eval({_expression_text(expression, reads, names)})"
        case AggregateAtom(function, relation, local, result, column):
            inside = {v: "#" if v == column else "_" for v in local}
            return f"{names(result)} == {function} {relation_text(relation, names, inside)}"
        case UnequalAtom(left, right):
            return f"{names(left)} != {names(right)}"
        case _:
            return relation_text(goal, names)


def _expression_text(expression: Expression, reads: Sequence[tuple[str, int]], names: Names) -> str:
    """Return an expression as written; if it has no text, or its variables other names here, return its variables."""
    if expression.span is not None and all(names.called(variable, name) for name, variable in reads):
        return " ".join(expression.span.text.split())
    return names.all(tuple(variable for _, variable in reads))


def _negated(goal: Goal, step: Step, names: Names) -> str:
    """Return a negated goal as text."""
    return f"neg {goal_text(replace(step, goal=goal, kind=Kind.TEST), names)}"


def relation_text(relation: RelationAtom, names: Names, inside: Mapping[int, str] | None = None) -> str:
    """Return a relation with its variables as text. `inside` gives the text of variables local to an aggregate."""
    listed = ", ".join((inside or {}).get(v) or names(v) for v in arguments(relation))
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


def _exactly(value: float) -> str:
    """Return a measured number of rows as text; a float has three significant digits."""
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _number(value: float) -> str:
    """Return an estimate as text, with two significant digits if it is below 10."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"
