"""The view network: its operators, their schedule, and the values of symbols in generated source."""

from __future__ import annotations

from math import inf

from envgraph.graph import Store
from envgraph.match.generate._symbols import Held
from envgraph.match.passes._calls import CallGraph
from envgraph.match.plan._live import LiveSizes
from envgraph.match.views.delta._delta import Delta
from envgraph.match.views.delta._planning import ViewPlanner
from envgraph.match.views.explain._actual import Build as DeltaBuild, actual_rows, tuples_of
from envgraph.match.views.explain._explain import explain_views
from envgraph.match.views.network._builder import Build, Evaluate, NetworkBuilder
from envgraph.match.views.network._wiring import Wiring
from envgraph.match.views.operators._closure import CircleOperator, ClosureOperator
from envgraph.match.views.operators._group_aggregates import Fold
from envgraph.match.views.operators._operators import Evaluated, Rows, View, fill_unrecorded
from envgraph.match.views.operators._recursive import Component, Member
from envgraph.metamodel import reached
from envgraph.pattern import Library


class Network:
    """A view network: operators in an order in which each comes after the operators that it reads.

    Args:
        store: the store of the model.
        library: the patterns.
        calls: their call graph.
        build: creates a function from source; gets the values of symbols from `held`.
        evaluate: returns a function that lists all rows of a pattern on demand.

    Attributes:
        wiring: subscribes the functions of all operators to the store.
    """

    def __init__(
        self, store: Store, library: Library, calls: CallGraph, build: Build, evaluate: Evaluate
    ) -> None:
        self._planner = ViewPlanner(library, calls, LiveSizes(library, store), self)
        self._builder = NetworkBuilder(store, calls, self._planner, build, evaluate)
        self.wiring = Wiring(store, self._builder, self._planner, build)
        self._evaluate = evaluate
        self._store = store
        self._settled = -1
        self.operators = self._builder.operators
        self.definitions = self._builder.definitions

    def view(self, pattern: str) -> Rows:
        """Return the operator with the matches of a pattern, created if necessary, and mark it as read (`asked`)."""
        view = self._builder.view(pattern)
        view.asked = True
        return view

    def limit_closures(self, most: float) -> None:
        """Set the number of pairs above which the creation of a closure raises an `EvaluationError`."""
        self._builder.most = most

    def largest(self) -> float:
        """Return the largest number of tuples of an operator; infinity if one is recomputed after every change."""
        each = self.operators.values()
        return max(inf if isinstance(operator, Evaluated) else operator.size() for operator in each)

    def recursive(self, pattern: str) -> Member | None:
        """Create and return the operator of a recursive pattern; None if the pattern has no delta functions."""
        return self._builder.recursive(pattern)

    # --- sizes for planning

    def rows(self, view: str) -> float:
        """Return the number of matches of a view, at least 0.5; before its creation the number of all objects."""
        operator = self.operators.get(view)
        return max(operator.size() if operator else self._objects(), 0.5)

    def _objects(self) -> float:
        """Return the number of objects in the model."""
        return float(sum(map(len, self._store.extents)))

    def matching(self, view: str, positions: tuple[int, ...]) -> float:
        """Return how many matches of a view share their values at some positions, on average, but at least 0.5.

        The average is of a sample. Before the creation of the view return 1.
        """
        operator = self.operators.get(view)
        if operator is None:
            return 1.0
        assert isinstance(operator, Rows)
        keys = len({tuple([row[p] for p in positions]) for row in operator.rows[:512]})
        sample = min(len(operator.rows), 512)
        return max(sample / keys, 0.5) if keys else 0.5

    def reached(self, closure: str) -> tuple[bool, float, float]:
        """Return for a closure: True if starts are sources, the number of starts, and the nodes reached per start.

        Before its creation return True, the number of objects in the model, and 1.
        """
        operator = self.operators.get(closure)
        if operator is None:
            return True, self._objects(), 1.0
        assert isinstance(operator, ClosureOperator)
        starts = max(len(operator.begun), 1)
        return operator.forward, float(starts), max(operator.size() / starts, 1.0)

    # --- updates

    def settle(self) -> None:
        """Process all operators with pending changes in network order. Do nothing if the model is unchanged."""
        if self._settled == self._store.revision:
            return
        for operator in self.wiring.turns:
            if operator.pending:
                operator.process()
        self._settled = self._store.revision

    def forget(self) -> None:
        """Discard all pending changes, and treat all operators as up to date with the model."""
        for operator in self.wiring.turns:
            operator.forget()
        self._settled = self._store.revision

    def rolled_back(self) -> None:
        """Discard all pending changes after a rollback, because the journal has already restored the operators."""
        if self._settled != self._store.revision - 1:
            self.forget()
            return
        for operator in self.wiring.evaluated:  # no other operator has pending changes
            operator.forget()
        self._settled = self._store.revision

    def refill(self) -> None:
        """Discard all pending changes, and recompute all operators without journalling."""
        self.forget()
        for operator in self.operators.values():
            fill_unrecorded(operator)
        self._settled = self._store.revision

    def recount(self) -> None:
        """Discard all pending changes, recompute all operators, and journal the differences."""
        self.forget()
        for operator in self.operators.values():
            operator.fill()
        self.forget()

    def held(self, symbol: Held) -> object:
        """Return the part of an operator that a symbol in generated source refers to: a data structure or method."""
        operator = self.operators[symbol.name]
        if isinstance(operator, Rows) and symbol.what in ("position", "rows", "group"):
            operator.asked = True
        match symbol.what, operator:
            case "derive", View():
                return operator.derive
            case "underive", View():
                return operator.underive
            case "queue", View() | Member():
                return operator.queue.extend
            case "size", View() | Member():
                rows, queue = operator.rows, operator.queue
                return lambda: len(rows) + len(queue) // 2
            case "position", Rows():
                return operator.rows.position
            case "rows", Rows():
                return operator.rows
            case "group", Rows():
                return operator.group(symbol.positions).table.get
            case "fold", Fold():
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
        needed = reached([pattern], self._builder.made_of)
        operators = [operator for name, operator in self.operators.items() if name in needed]

        def actual(delta: Delta) -> list[float]:
            tuples = tuples_of(delta, self._store, self.operators)
            return actual_rows(self._planner, delta, tuples, build, self.held)

        deltas = [*self.wiring.deltas, *self._builder.spreading]
        return explain_views(operators, deltas, self._planner, pattern, actual)

    def check(self) -> None:
        """Assert that every operator holds the tuples that a new computation finds."""
        for operator in self.operators.values():
            match operator:
                case View():
                    operator.check_derivations()
                case Fold() | ClosureOperator():
                    operator.check()
                case CircleOperator():
                    operator.check(operator.circles())
                case Component():
                    assert not operator.pending
                case Rows() if operator.name in self._planner.library.names():
                    operator.check(self._evaluate(operator.name)())
