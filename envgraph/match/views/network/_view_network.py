"""The view network: its operators, their schedule, and the values of symbols in generated source."""

from __future__ import annotations

from math import inf

from envgraph.graph import Store
from envgraph.match.generate._symbols import OperatorSymbol
from envgraph.match.passes._call_graph import CallGraph
from envgraph.match.plan._measured_sizes import LiveSizes
from envgraph.match.views.delta._delta_functions import Delta
from envgraph.match.views.delta._view_planner import ViewPlanner
from envgraph.match.views.explain._measured_rows import Build as DeltaBuild, measure_rows, tuples_of
from envgraph.match.views.explain._view_text import explain_views
from envgraph.match.views.network._builder import Build, Evaluate, NetworkBuilder
from envgraph.match.views.network._subscriptions import NetworkSubscriptions
from envgraph.match.views.operators._closure import ClosureOperator, CycleOperator
from envgraph.match.views.operators._delete_and_rederive import RecursiveComponent, RecursiveView
from envgraph.match.views.operators._group_aggregates import AggregateOperator
from envgraph.match.views.operators._materialized_view import (
    MaterializedView,
    RecomputedRows,
    RowOperator,
    recompute_unrecorded,
)
from envgraph.metamodel import reachable_nodes
from envgraph.pattern import Library


class Network:
    """A view network: operators in an order in which each comes after the operators that it reads.

    Args:
        store: the store of the model.
        library: the patterns.
        calls: their call graph.
        build: creates a function from source; gets the values of symbols from `operator_value`.
        evaluate: returns a function that lists all rows of a pattern on demand.

    Attributes:
        subscriptions: subscribes the functions of all operators to the store.
    """

    def __init__(self, store: Store, library: Library, calls: CallGraph, build: Build, evaluate: Evaluate) -> None:
        self._planner = ViewPlanner(library, calls, LiveSizes(library, store), self)
        self._builder = NetworkBuilder(store, calls, self._planner, build, evaluate)
        self.subscriptions = NetworkSubscriptions(store, self._builder, self._planner, build)
        self._evaluate = evaluate
        self._store = store
        self._settled = -1
        self.operators = self._builder.operators
        self.definitions = self._builder.definitions

    def view(self, pattern: str) -> RowOperator:
        """Return the operator with the matches of a pattern, created if necessary, and mark it as read (`is_read`)."""
        view = self._builder.view(pattern)
        view.is_read = True
        return view

    def limit_closures(self, max_pairs: float) -> None:
        """Set the number of pairs above which the creation of a closure raises an `EvaluationError`."""
        self._builder.max_closure_pairs = max_pairs

    def largest_size(self) -> float:
        """Return the largest number of tuples of an operator; infinity if one is recomputed after every change."""
        each = self.operators.values()
        return max(inf if isinstance(operator, RecomputedRows) else operator.size() for operator in each)

    def recursive(self, pattern: str) -> RecursiveView | None:
        """Create and return the operator of a recursive pattern; None if the pattern has no delta functions."""
        return self._builder.recursive(pattern)

    # --- sizes for planning

    def row_count(self, view: str) -> float:
        """Return the number of matches of a view, at least 0.5; before its creation the number of all objects."""
        operator = self.operators.get(view)
        return max(operator.size() if operator else self._objects(), 0.5)

    def _objects(self) -> float:
        """Return the number of objects in the model."""
        return float(sum(map(len, self._store.extents)))

    def rows_per_key(self, view: str, positions: tuple[int, ...]) -> float:
        """Return how many matches of a view share their values at some positions, on average, but at least 0.5.

        The average is of a sample. Before the creation of the view return 1.
        """
        operator = self.operators.get(view)
        if operator is None:
            return 1.0
        assert isinstance(operator, RowOperator)
        keys = len({tuple([row[p] for p in positions]) for row in operator.rows[:512]})
        sample = min(len(operator.rows), 512)
        return max(sample / keys, 0.5) if keys else 0.5

    def closure_sizes(self, closure: str) -> tuple[bool, float, float]:
        """Return for a closure: True if starts are sources, the number of starts, and the nodes reached per start.

        Before its creation return True, the number of objects in the model, and 1.
        """
        operator = self.operators.get(closure)
        if operator is None:
            return True, self._objects(), 1.0
        assert isinstance(operator, ClosureOperator)
        starts = max(len(operator.present_starts), 1)
        return operator.is_forward, float(starts), max(operator.size() / starts, 1.0)

    # --- updates

    def settle(self) -> None:
        """Process all operators with pending changes in network order. Do nothing if the model is unchanged."""
        if self._settled == self._store.revision:
            return
        for operator in self.subscriptions.scheduled:
            if operator.is_pending:
                operator.process()
        self._settled = self._store.revision

    def discard_pending(self) -> None:
        """Discard all pending changes, and treat all operators as up to date with the model."""
        for operator in self.subscriptions.scheduled:
            operator.discard_pending()
        self._settled = self._store.revision

    def rolled_back(self) -> None:
        """Discard all pending changes after a rollback, because the journal has already restored the operators."""
        if self._settled != self._store.revision - 1:
            self.discard_pending()
            return
        for operator in self.subscriptions.recomputed:  # no other operator has pending changes
            operator.discard_pending()
        self._settled = self._store.revision

    def recompute_unrecorded(self) -> None:
        """Discard all pending changes, and recompute all operators without journalling."""
        self.discard_pending()
        for operator in self.operators.values():
            recompute_unrecorded(operator)
        self._settled = self._store.revision

    def recompute(self) -> None:
        """Discard all pending changes, recompute all operators, and journal the differences."""
        self.discard_pending()
        for operator in self.operators.values():
            operator.recompute()
        self.discard_pending()

    def operator_value(self, symbol: OperatorSymbol) -> object:
        """Return the part of an operator that a symbol in generated source refers to: a data structure or method."""
        operator = self.operators[symbol.name]
        if isinstance(operator, RowOperator) and symbol.kind in ("position", "rows", "group"):
            operator.is_read = True
        match symbol.kind, operator:
            case "derive", MaterializedView():
                return operator.add_derivation
            case "underive", MaterializedView():
                return operator.remove_derivation
            case "queue", MaterializedView() | RecursiveView():
                return operator.queue.extend
            case "size", MaterializedView() | RecursiveView():
                rows, queue = operator.rows, operator.queue
                return lambda: len(rows) + len(queue) // 2
            case "position", RowOperator():
                return operator.rows.position
            case "rows", RowOperator():
                return operator.rows
            case "group", RowOperator():
                return operator.group(symbol.positions).table.get
            case "fold", AggregateOperator():
                return operator.values.__getitem__
            case "reach", ClosureOperator():
                return operator.reached.get
            case "starts", ClosureOperator():
                return operator.starts_to
            case "pairs", ClosureOperator():
                return operator.pairs
        raise AssertionError(symbol)

    def explain(self, pattern: str, build: DeltaBuild) -> str:
        """Return as text the operators of a watched pattern, and the plans of its delta functions.

        Args:
            pattern: qualified name.
            build: creates a function from source; its second argument is a function that returns the values of symbols.
        """
        needed = reachable_nodes([pattern], self._builder.inputs_of)
        operators = [operator for name, operator in self.operators.items() if name in needed]

        def actual(delta: Delta) -> list[float]:
            tuples = tuples_of(delta, self._store, self.operators)
            return measure_rows(self._planner, delta, tuples, build, self.operator_value)

        deltas = [*self.subscriptions.deltas, *self._builder.component_deltas]
        return explain_views(operators, deltas, self._planner, pattern, actual)

    def check(self) -> None:
        """Assert that every operator holds the tuples that a new computation finds."""
        for operator in self.operators.values():
            match operator:
                case MaterializedView():
                    operator.check_derivations()
                case AggregateOperator() | ClosureOperator():
                    operator.check_rows()
                case CycleOperator():
                    operator.check_rows(operator.search_cycles())
                case RecursiveComponent():
                    assert not operator.is_pending
                case RowOperator() if operator.name in self._planner.library.names():
                    operator.check_rows(self._evaluate(operator.name)())
