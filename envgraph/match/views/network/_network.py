"""The network of views: its operators, their turns, and what generated source asks of them."""

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
    """Operators in an order in which each stands after those that it is made of.

    Args:
        store: what the views are about.
        library: the patterns.
        calls: which of them are recursive.
        build: makes functions of source; asks `held`.
        evaluate: all rows of a pattern, on demand.

    Attributes:
        wiring: registers the functions of all operators in the store.
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
        """The operator that holds the matches of a pattern, made if there is none."""
        view = self._builder.view(pattern)
        view.asked = True
        return view

    def limit_closures(self, most: float) -> None:
        """Set the number of pairs above which making a closure raises an `EvaluationError`."""
        self._builder.most = most

    def largest(self) -> float:
        """Return the number of tuples of the largest operator; infinite if one is recomputed at every change."""
        each = self.operators.values()
        return max(inf if isinstance(operator, Evaluated) else operator.size() for operator in each)

    def recursive(self, pattern: str) -> Member | None:
        """The operator of a recursive pattern, if it has deltas."""
        return self._builder.recursive(pattern)

    # --- what plans ask

    def rows(self, view: str) -> float:
        """Return the number of matches of a view; before it is made, the number of objects as an estimate."""
        operator = self.operators.get(view)
        return max(operator.size() if operator else self._objects(), 0.5)

    def _objects(self) -> float:
        return float(sum(map(len, self._store.extents)))

    def matching(self, view: str, positions: tuple[int, ...]) -> float:
        """Matches of a view that agree with values at these positions, on average."""
        operator = self.operators.get(view)
        if operator is None:
            return 1.0
        assert isinstance(operator, Rows)
        keys = len({tuple([row[p] for p in positions]) for row in operator.rows[:512]})
        sample = min(len(operator.rows), 512)
        return max(sample / keys, 0.5) if keys else 0.5

    def reached(self, closure: str) -> tuple[bool, float, float]:
        """Return whether it is followed from the source, how many starts it has, and what each reaches."""
        operator = self.operators.get(closure)
        if operator is None:
            return True, self._objects(), 1.0
        assert isinstance(operator, ClosureOperator)
        starts = max(len(operator.begun), 1)
        return operator.forward, float(starts), max(operator.size() / starts, 1.0)

    # --- turns

    def settle(self) -> None:
        """Bring everything up to date: each operator once, after those that it is made of."""
        if self._settled == self._store.revision:
            return
        for operator in self.wiring.turns:
            if operator.pending:
                operator.process()
        self._settled = self._store.revision

    def forget(self) -> None:
        """The state that the operators hold is right as it is: what is pending is void."""
        for operator in self.wiring.turns:
            operator.forget()
        self._settled = self._store.revision

    def rolled_back(self) -> None:
        """The state has been replaced, once, by one that the operators hold already: what is pending is void."""
        if self._settled != self._store.revision - 1:
            self.forget()
            return
        for operator in self.wiring.evaluated:  # nothing is pending: there was no change since the last turns
            operator.forget()
        self._settled = self._store.revision

    def refill(self) -> None:
        """Compute everything anew, unrecorded."""
        self.forget()
        for operator in self.operators.values():
            fill_unrecorded(operator)
        self._settled = self._store.revision

    def recount(self) -> None:
        """Compute everything anew, and record what differs."""
        self.forget()
        for operator in self.operators.values():
            operator.fill()
        self.forget()

    def held(self, symbol: Held) -> object:
        """Return what a name in generated source stands for."""
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
        """Return what a watched pattern is made of, and how it is kept current.

        Args:
            pattern: qualified name.
            build: makes a function of source; asks the second argument what is held.
        """
        needed = reached([pattern], self._builder.made_of)
        operators = [operator for name, operator in self.operators.items() if name in needed]

        def actual(delta: Delta) -> list[float]:
            tuples = tuples_of(delta, self._store, self.operators)
            return actual_rows(self._planner, delta, tuples, build, self.held)

        deltas = [*self.wiring.deltas, *self._builder.spreading]
        return explain_views(operators, deltas, self._planner, pattern, actual)

    def check(self) -> None:
        """Assert that every operator holds what a new computation finds."""
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
