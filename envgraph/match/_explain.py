"""Plans and generated source as text."""

from __future__ import annotations

from collections.abc import Iterator

from envgraph.match._generate import view_source
from envgraph.match._plan import (
    Absence,
    BodyPlan,
    Condition,
    Kind,
    Plan,
    Step,
    Valuation,
    ViewKey,
    arguments,
    inputs,
)
from envgraph.match._planner import Planner
from envgraph.match._symbols import Mode
from envgraph.pattern import (
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    Closure,
    ClosureAtom,
    InstanceAtom,
    Library,
    LinkAtom,
    RelationAtom,
    UnequalAtom,
)


def explain_view(planner: Planner, key: ViewKey) -> str:
    """The plan of every body, and the source.

    Raises:
        Unplannable: a free parameter cannot be enumerated.
    """
    view = planner.view(key)
    names = [parameter.name for parameter in planner.library.get(key.pattern).parameters]
    given = ", ".join(names[position] for position in key.bound) or "nothing"
    lines = [f"pattern {key.pattern}({', '.join(names)}), given {given}"]
    for number, body in enumerate(view.bodies, 1):
        lines.append(f"body {number}: about {_number(body.plan.rows)} rows, cost {_number(body.plan.cost)}")
        lines.extend(_steps(body.plan, _Names(planner.library, key.pattern, number - 1, body), "  "))
    if not view.distinct:
        lines.append("the same row may be found more than once and is reported once")
    if planner.calls.recursive(key.pattern):
        lines.append("recursive: evaluated until nothing is added, rows sorted")
    return "\n".join([*lines, "", view_source(planner, key, Mode.ROWS).text])


class _Names:
    """What the variables of a conjunction are called; those that inlining has added have numbers only."""

    def __init__(self, library: Library, pattern: str, number: int, body: BodyPlan) -> None:
        lowered = library.lowered(pattern).bodies[number]
        self._names = dict(enumerate(lowered.names))
        self._constants = dict(body.conjunction.constants)

    def __call__(self, variable: int) -> str:
        if variable in self._constants:
            return repr(self._constants[variable])
        return self._names.get(variable, f"#{variable}")

    def all(self, variables: tuple[int, ...]) -> str:
        return ", ".join(map(self, variables))


def _steps(plan: Plan, names: _Names, indent: str) -> Iterator[str]:
    for step in plan.steps:
        yield f"{indent}{_VERBS[step.kind]:7} {_goal(step, names)}  (rows {_number(step.rows)})"
        for inner in step.inner:
            if not isinstance(step.goal, AggregateAtom):
                yield from _steps(inner, names, indent + "  ")


_VERBS = {
    Kind.TEST: "test",
    Kind.BIND: "bind",
    Kind.LOOP: "for",
    Kind.ABSENT: "unless",
    Kind.EXISTS: "if any",
}


def _goal(step: Step, names: _Names) -> str:
    goal = step.goal
    if step.kind is Kind.EXISTS:
        return "of"
    match goal:
        case Absence(alternatives, outer):
            return f"any of {len(alternatives)} for {names.all(outer) or 'nothing'}"
        case Condition():
            return f"check({names.all(inputs(goal))})"
        case Valuation(_, _, result):
            return f"{names(result)} == eval({names.all(inputs(goal))})"
        case AggregateAtom(function, relation, _, result):
            return f"{names(result)} == {function} {_relation(relation, names)}"
        case UnequalAtom(left, right):
            return f"{names(left)} != {names(right)}"
        case _:
            return _relation(goal, names)


def _relation(relation: RelationAtom, names: _Names) -> str:
    listed = names.all(arguments(relation))
    match relation:
        case InstanceAtom(cls, _, exact):
            return f"{cls}({listed}){' exactly' if exact else ''}"
        case AttributeAtom(feature) | LinkAtom(feature):
            return f"{feature}({listed})"
        case CallAtom(pattern):
            return f"find {pattern}({listed})"
        case ClosureAtom(step, closure):
            return f"find {step}{'*' if closure is Closure.STAR else '+'}({listed})"


def _number(value: float) -> str:
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"
