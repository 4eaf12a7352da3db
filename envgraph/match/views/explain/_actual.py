"""Measure delta functions in the present model: the average number of partial matches after each step."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

from envgraph.code import Block
from envgraph.graph import Store
from envgraph.match._costs import VIEWS
from envgraph.match.explain._trace import noted
from envgraph.match.generate._sinks import Sink
from envgraph.match.generate._symbols import Held, Source
from envgraph.match.generate._write import Module
from envgraph.match.views.delta._delta import Delta, DeltaTranslation, delta_plan, tuple_names
from envgraph.match.views.delta._occurrences import Role
from envgraph.match.views.delta._planning import ViewPlanner
from envgraph.match.views.operators._closure import ClosureOperator
from envgraph.match.views.operators._group_aggregates import Fold
from envgraph.match.views.operators._operators import Operator, Rows
from envgraph.metamodel import Attribute
from envgraph.pattern import (
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    ClosureAtom,
    InstanceAtom,
    LinkAtom,
)

Build = Callable[[Source, Callable[[Held], object]], Callable[..., Any]]
"""Creates a function of source; the second argument returns the values of `Held` symbols."""


def actual_rows(
    planner: ViewPlanner,
    delta: Delta,
    tuples: Iterable[tuple[Any, ...]],
    build: Build,
    held: Callable[[Held], object],
) -> list[float]:
    """Return the average number of partial matches after each step of a delta's plan, for an inserted tuple.

    Args:
        planner: the planner that made the plan.
        delta: the delta.
        tuples: the present tuples of its relation.
        build: see `Build`.
        held: returns the values of symbols.

    Returns:
        averages over a sample of the tuples; empty if there are no tuples.
    """
    known = list(tuples)
    sample = known[:: max(1, len(known) // VIEWS.tried)]
    counts = [0] * len(delta_plan(planner, delta).steps)

    def note(step: int, _: object) -> bool:
        counts[step] += 1
        return True

    run = build(_source(planner, delta), lambda symbol: note if symbol.what == "note" else held(symbol))
    for row in sample:
        run(*row)
    return [count / len(sample) for count in counts] if sample else []


def _source(planner: ViewPlanner, delta: Delta) -> Source:
    """Return the source of a function that runs a delta's plan without changes, and calls `note` after each step."""
    module, block = Module(), Block()
    occurrence = delta.occurrence
    names = tuple_names(occurrence)
    plan = delta_plan(planner, delta)
    translation = DeltaTranslation(planner, module, block, delta, names)
    given = {}
    if occurrence.role is Role.NUMBER:
        goal = delta.conjunction.goals[occurrence.goal]
        assert isinstance(goal, AggregateAtom)
        given = {goal.result: translation.number(occurrence, names, 0)}
    else:
        translation.alone(occurrence, names)
    translation.run(plan, Sink((), (), lambda _: (), ()), given)
    return noted(module, names, block.body(), plan)


def tuples_of(delta: Delta, store: Store, operators: Mapping[str, Operator]) -> Iterator[tuple[Any, ...]]:
    """Yield the present tuples of the relation that a delta starts from."""
    match delta.occurrence.relation:
        case InstanceAtom(cls, _, exact):
            names = {cls} if exact else set(store.metamodel.concrete(cls))
            extents = (
                store.extents[i] for i, each in enumerate(store.metamodel.class_list) if each.name in names
            )
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
        case Rows() if operator.listed:
            yield from operator.rows
        case Fold():
            yield from ((*key, value) for key, value in operator.values.items() if value is not None)
        case ClosureOperator():
            yield from operator.pairs()
