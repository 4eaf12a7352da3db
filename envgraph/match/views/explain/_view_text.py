"""Format as text the operators of a view, and the plans that keep the view up to date."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from envgraph.match.explain._plan_text import VariableNames, relation_text, steps_text
from envgraph.match.views.delta._delta_functions import Delta, delta_plan, delta_source
from envgraph.match.views.delta._occurrences import TupleEffect
from envgraph.match.views.delta._view_planner import ViewPlanner
from envgraph.match.views.operators._closure import ClosureOperator
from envgraph.match.views.operators._delete_and_rederive import RecursiveComponent, RecursiveView
from envgraph.match.views.operators._group_aggregates import AggregateOperator
from envgraph.match.views.operators._materialized_view import MaterializedView, Operator, RecomputedRows

_ROLES = {
    TupleEffect.EACH: "",
    TupleEffect.EXISTS: ", if no other tuple of its group exists",
    TupleEffect.NEGATED: " (negated)",
    TupleEffect.COUNT: " (counted)",
}


Actual = Callable[[Delta], Sequence[float]]
"""Returns the average number of partial matches after each step of a delta's plan; empty if there are no tuples."""


def explain_views(
    operators: list[Operator], deltas: list[Delta], planner: ViewPlanner, pattern: str, actual: Actual
) -> str:
    """Return as text the operators of a watched pattern in processing order, and the pattern's delta functions.

    Each step shows how many partial matches one inserted tuple has after it: as estimated by the planner, and as
    measured on average over the present tuples.

    Args:
        operators: the operators that the pattern needs; the last one holds its matches.
        deltas: the deltas of all views.
        planner: the planner that made their plans.
        pattern: qualified name.
        actual: see `Actual`.
    """
    lines = [f"{pattern} is watched. Its operators (delta functions of the same change run as one function):"]
    lines.extend(f"  {_operator(each)}" for each in operators)
    for delta in deltas:
        if delta.name == pattern:
            lines.extend(["", *_delta(delta, planner, actual)])
    return "\n".join(lines)


def _operator(operator: Operator) -> str:
    """Return one line about an operator: its name, its kind and its size."""
    size = f"{operator.size():.0f}"
    match operator:
        case MaterializedView(counts=None):
            return f"{operator.name}: {size} rows, each with one derivation"
        case MaterializedView():
            return f"{operator.name}: {size} rows, derivations counted"
        case RecomputedRows():
            return f"{operator.name}: {size} rows, recomputed after every change"
        case AggregateOperator():
            return f"{operator.name}: {operator.function} over {operator.source.name}, {size} groups"
        case ClosureOperator():
            end = "source" if operator.is_forward else "target"
            return f"{operator.name}: closure from {len(operator.present_starts)} {end}s, {size} pairs"
        case RecursiveView():
            return f"{operator.name}: {size} rows, recursive"
        case RecursiveComponent():
            return f"{operator.name}: updates {len(operator.members)} recursive patterns together"
    return f"{operator.name}: {size} rows"


def _delta(delta: Delta, planner: ViewPlanner, actual: Actual) -> Iterator[str]:
    """Yield the lines about a delta: its occurrence, its plan and its source."""
    names = VariableNames(planner.library, delta.name, delta.body, delta.conjunction)
    text = relation_text(delta.occurrence.relation, names)
    yield f"body {delta.body + 1}: when {text} is inserted or deleted{_ROLES[delta.occurrence.role]}"
    known = [variable for variable in delta.occurrence.columns if variable is not None]
    yield from steps_text(delta_plan(planner, delta), names, "  ", actual(delta), known, is_view=True)
    if delta.own is not None:
        yield "  lost rows are looked up in an index of the view itself"
    yield delta_source(planner, delta, True).text
