"""Measure delta functions in the present model: the average number of partial matches after each step."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

from envgraph.code import BodyBuilder
from envgraph.graph import Store
from envgraph.match._match_costs import VIEWS
from envgraph.match.explain._plan_trace import traced_function_source
from envgraph.match.generate._sinks import SolutionSink
from envgraph.match.generate._source_builder import SourceBuilder
from envgraph.match.generate._symbols import GeneratedSource, OperatorSymbol
from envgraph.match.views.delta._delta_functions import Delta, DeltaTranslation, delta_plan, tuple_names
from envgraph.match.views.delta._occurrences import TupleEffect
from envgraph.match.views.delta._view_planner import ViewPlanner
from envgraph.match.views.operators._closure import ClosureOperator
from envgraph.match.views.operators._group_aggregates import AggregateOperator
from envgraph.match.views.operators._materialized_view import Operator, RowOperator
from envgraph.metamodel import Attribute
from envgraph.pattern import (
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    ClosureAtom,
    InstanceAtom,
    LinkAtom,
)

Build = Callable[[GeneratedSource, Callable[[OperatorSymbol], object]], Callable[..., Any]]
"""Creates a function of source; the second argument returns the values of `Held` symbols."""


def measure_rows(
    planner: ViewPlanner,
    delta: Delta,
    tuples: Iterable[tuple[Any, ...]],
    build: Build,
    operator_value: Callable[[OperatorSymbol], object],
) -> list[float]:
    """Return the average number of partial matches after each step of a delta's plan, for an inserted tuple.

    Args:
        planner: the planner that made the plan.
        delta: the delta.
        tuples: the present tuples of its relation.
        build: see `Build`.
        operator_value: returns the values of symbols.

    Returns:
        averages over a sample of the tuples; empty if there are no tuples.
    """
    known = list(tuples)
    sample = known[:: max(1, len(known) // VIEWS.tried)]
    counts = [0] * len(delta_plan(planner, delta).steps)

    def count_solution(step: int, _: object) -> bool:
        counts[step] += 1
        return True

    run = build(
        _source(planner, delta),
        lambda symbol: count_solution if symbol.kind == "note" else operator_value(symbol),
    )
    for row in sample:
        run(*row)
    return [count / len(sample) for count in counts] if sample else []


def _source(planner: ViewPlanner, delta: Delta) -> GeneratedSource:
    """Return the source of a function that runs a delta's plan without changes, and calls `count_solution` after each
    step.
    """
    module, block = SourceBuilder(), BodyBuilder()
    occurrence = delta.occurrence
    names = tuple_names(occurrence)
    plan = delta_plan(planner, delta)
    translation = DeltaTranslation(planner, module, block, delta, names)
    given = {}
    if occurrence.role is TupleEffect.COUNT:
        goal = delta.conjunction.goals[occurrence.goal]
        assert isinstance(goal, AggregateAtom)
        given = {goal.result: translation.emit_group_size(occurrence, names, 0)}
    else:
        translation.emit_only_link_test(occurrence, names)
    translation.emit_all(plan, SolutionSink((), (), lambda _: (), ()), given)
    return traced_function_source(module, names, block.finish_body(), plan)


def tuples_of(delta: Delta, store: Store, operators: Mapping[str, Operator]) -> Iterator[tuple[Any, ...]]:
    """Yield the present tuples of the relation that a delta starts from."""
    match delta.occurrence.relation:
        case InstanceAtom(cls, _, exact):
            names = {cls} if exact else set(store.metamodel.concrete_classes(cls))
            extents = (store.extents[i] for i, each in enumerate(store.metamodel.class_list) if each.name in names)
            yield from ((node,) for node in chain.from_iterable(extents))
        case AttributeAtom(attribute):
            column = store.values[attribute.index]
            yield from ((node, value) for node, value in enumerate(column) if value is not None)
        case LinkAtom(feature):
            columns: Sequence[Sequence[Iterable[Any]]] = store.forward
            columns = store.distinct if isinstance(feature, Attribute) else columns
            for node, ends in enumerate(columns[feature.index]):
                yield from ((node, other) for other in ends)
        case CallAtom(name) | ClosureAtom(name):
            yield from _rows_of(operators[name])


def _rows_of(operator: Operator) -> Iterator[tuple[Any, ...]]:
    """Yield the tuples of an operator; nothing if the operator does not store them."""
    match operator:
        case RowOperator() if operator.stores_rows:
            yield from operator.rows
        case AggregateOperator():
            yield from ((*key, value) for key, value in operator.values.items() if value is not None)
        case ClosureOperator():
            yield from operator.pairs()
