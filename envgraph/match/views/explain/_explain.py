"""Explains as text how a view is made and kept current."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from envgraph.match.explain._explain import Names, relation_text, steps_text
from envgraph.match.views.delta._delta import Delta, delta_plan, delta_source
from envgraph.match.views.delta._occurrences import Role
from envgraph.match.views.delta._planning import ViewPlanner
from envgraph.match.views.operators._closure import ClosureOperator
from envgraph.match.views.operators._group_aggregates import Fold
from envgraph.match.views.operators._operators import Evaluated, Operator, View
from envgraph.match.views.operators._recursive import Component, Member

_ROLES = {
    Role.EACH: "",
    Role.SOME: ", if there is no other",
    Role.NONE: ", which is excluded",
    Role.NUMBER: ", which is counted",
}


Actual = Callable[[Delta], Sequence[float]]
"""Partial matches after each step of a delta's plan, on average; empty if there is no tuple to try."""


def explain_views(
    operators: list[Operator], deltas: list[Delta], planner: ViewPlanner, pattern: str, actual: Actual
) -> str:
    """The operators behind a watched pattern, in the order of their turns, and the delta functions of the last one.

    Rows are for one tuple that comes: as estimated, and as they are for those that there are.

    Args:
        operators: those that the pattern is made of, itself last.
        deltas: of all views.
        planner: made their plans.
        pattern: qualified name.
        actual: see `Actual`.
    """
    lines = [f"{pattern} is watched (functions that hear of the same change run as one). It is made of:"]
    lines.extend(f"  {_operator(each)}" for each in operators)
    for delta in deltas:
        if delta.name == pattern:
            lines.extend(["", *_delta(delta, planner, actual)])
    return "\n".join(lines)


def _operator(operator: Operator) -> str:
    size = f"{operator.size():.0f}"
    match operator:
        case View(counts=None):
            return f"{operator.name}: {size} rows, each with one derivation"
        case View():
            return f"{operator.name}: {size} rows, derivations counted"
        case Evaluated():
            return f"{operator.name}: {size} rows, evaluated anew after every change"
        case Fold():
            return f"{operator.name}: {operator.function} over {operator.source.name}, {size} groups"
        case ClosureOperator():
            end = "source" if operator.forward else "target"
            return f"{operator.name}: closure from {len(operator.begun)} {end}s, {size} pairs"
        case Member():
            return f"{operator.name}: {size} rows, recursive"
        case Component():
            return f"{operator.name}: brings {len(operator.members)} recursive patterns up to date together"
    return f"{operator.name}: {size} rows"


def _delta(delta: Delta, planner: ViewPlanner, actual: Actual) -> Iterator[str]:
    names = Names(planner.library, delta.name, delta.body, delta.conjunction)
    text = relation_text(delta.occurrence.relation, names)
    yield f"body {delta.body + 1}: when {text} comes or goes{_ROLES[delta.occurrence.role]}"
    known = [variable for variable in delta.occurrence.columns if variable is not None]
    yield from steps_text(delta_plan(planner, delta), names, "  ", actual(delta), known, watched=True)
    if delta.own is not None:
        yield "  the rows that are lost are looked up in the view itself"
    yield delta_source(planner, delta, True).text
