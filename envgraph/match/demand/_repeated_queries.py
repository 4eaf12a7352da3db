"""Repeated evaluation of the same patterns, such as objectives at each step of a search.

A matcher inlines small patterns and plans with the metamodel alone. Here plans are made for the present model. Patterns
that aggregate matches of other patterns are called instead of inlined: their value for an object is computed once per
state of the model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from envgraph.graph import Model
from envgraph.match._matcher import Row
from envgraph.match.demand._compiled_functions import CompiledFunction, CompiledProgram
from envgraph.match.generate._symbols import PatternFunction, ResultMode, Symbol
from envgraph.match.passes._call_graph import CallGraph
from envgraph.match.plan._measured_sizes import LiveSizes
from envgraph.match.plan._planner import Planner
from envgraph.match.plan._search_plan import PatternQuery
from envgraph.pattern import AggregateAtom, CallAtom, Library


class RepeatedQueries:
    """Compiled queries without arguments, planned for the present model, for repeated evaluation.

    Rows may have another order than those of a matcher.
    """

    def __init__(self, model: Model, library: Library) -> None:
        self._program = _SharingProgram(model, library)
        self._functions: dict[tuple[str, ResultMode], Callable[[], Any]] = {}

    def rows(self, pattern: str) -> Sequence[Row]:
        """Return all matches of a pattern in the present state of the model."""
        return self._ask(pattern, ResultMode.ROWS)  # type: ignore[no-any-return]

    def count(self, pattern: str) -> int:
        """Return the number of matches of a pattern in the present state of the model."""
        return self._ask(pattern, ResultMode.COUNT)  # type: ignore[no-any-return]

    def _ask(self, pattern: str, mode: ResultMode) -> Any:
        """Return the result of a pattern in a result mode, for the present state of the model."""
        question = (pattern, mode)
        if question not in self._functions:
            self._functions[question] = self._program.query_function(pattern, (), mode)
        self._program.discard_outdated()
        return self._functions[question]()


class _ResultCache(dict[Any, Any]):
    """A cache of a function's results by argument, computed at the first lookup."""

    def __init__(self, function: CompiledFunction) -> None:
        super().__init__()
        self._function = function

    def __missing__(self, value: Any) -> Any:
        found = self[value] = self._function(value)
        return found


class _SharingProgram(CompiledProgram):
    """A program whose functions cache the values of aggregating patterns for each object and state."""

    def __init__(self, model: Model, library: Library) -> None:
        super().__init__(model, library)
        self._aggregating = _AggregatingPatterns(library, self.calls)
        self.planner = Planner(library, self.calls, LiveSizes(library, model.graph.store), self._aggregating)
        self._sharing: dict[tuple[PatternQuery, ResultMode], _ResultCache] = {}
        self._revision = -1

    def discard_outdated(self) -> None:
        """Discard all cached results if the model has changed."""
        if self._revision != self.model.graph.store.revision:
            for answers in self._sharing.values():
                answers.clear()
            self._revision = self.model.graph.store.revision

    def _value(self, symbol: Symbol, component: frozenset[str]) -> object:
        if not isinstance(symbol, PatternFunction) or len(symbol.key.bound) != 1 or symbol.mode is ResultMode.EACH:
            return super()._value(symbol, component)
        if symbol.mode is not ResultMode.COUNT and symbol.key.pattern not in self._aggregating:
            return super()._value(symbol, component)
        place = (symbol.key, symbol.mode)
        if place not in self._sharing:
            self._sharing[place] = _ResultCache(self.pattern_function(*place))
        return self._sharing[place].__getitem__


class _AggregatingPatterns:
    """The set of patterns that aggregate matches of other patterns, or call such a pattern. They are never inlined."""

    def __init__(self, library: Library, calls: CallGraph) -> None:
        self._library, self._calls = library, calls
        self._known: dict[str, bool] = {}

    def __contains__(self, pattern: object) -> bool:
        assert isinstance(pattern, str)
        if pattern not in self._known:
            self._known[pattern] = False  # ends the recursion for recursive patterns
            self._known[pattern] = any(
                isinstance(goal, AggregateAtom) and isinstance(goal.relation, CallAtom)
                for body in self._library.lowered_pattern(pattern).bodies
                for goal in body.goals
            ) or any(called in self for called in self._calls.called_patterns(pattern))
        return self._known[pattern]
