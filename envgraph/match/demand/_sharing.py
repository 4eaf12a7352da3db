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
from envgraph.match.demand._program import Function, Program
from envgraph.match.generate._symbols import Mode, Symbol, View
from envgraph.match.passes._calls import CallGraph
from envgraph.match.plan._live import LiveSizes
from envgraph.match.plan._plan import ViewKey
from envgraph.match.plan._planner import Planner
from envgraph.pattern import AggregateAtom, CallAtom, Library


class Questions:
    """Compiled queries without arguments, planned for the present model, for repeated evaluation.

    Rows may have another order than those of a matcher.
    """

    def __init__(self, model: Model, library: Library) -> None:
        self._program = _Sharing(model, library)
        self._functions: dict[tuple[str, Mode], Callable[[], Any]] = {}

    def rows(self, pattern: str) -> Sequence[Row]:
        """Return all matches of a pattern in the present state of the model."""
        return self._ask(pattern, Mode.ROWS)  # type: ignore[no-any-return]

    def count(self, pattern: str) -> int:
        """Return the number of matches of a pattern in the present state of the model."""
        return self._ask(pattern, Mode.COUNT)  # type: ignore[no-any-return]

    def _ask(self, pattern: str, mode: Mode) -> Any:
        """Return the result of a pattern in a result mode, for the present state of the model."""
        question = (pattern, mode)
        if question not in self._functions:
            self._functions[question] = self._program.answering(pattern, (), mode)
        self._program.begin()
        return self._functions[question]()


class _Answers(dict[Any, Any]):
    """A cache of a function's results by argument, computed at the first lookup."""

    def __init__(self, function: Function) -> None:
        super().__init__()
        self._function = function

    def __missing__(self, value: Any) -> Any:
        found = self[value] = self._function(value)
        return found


class _Sharing(Program):
    """A program whose functions cache the values of aggregating patterns for each object and state."""

    def __init__(self, model: Model, library: Library) -> None:
        super().__init__(model, library)
        self._aggregating = _Aggregating(library, self.calls)
        self.planner = Planner(library, self.calls, LiveSizes(library, model.graph.store), self._aggregating)
        self._sharing: dict[tuple[ViewKey, Mode], _Answers] = {}
        self._revision = -1

    def begin(self) -> None:
        """Discard all cached results if the model has changed."""
        if self._revision != self.model.graph.store.revision:
            for answers in self._sharing.values():
                answers.clear()
            self._revision = self.model.graph.store.revision

    def _value(self, symbol: Symbol, inside: frozenset[str]) -> object:
        if not isinstance(symbol, View) or len(symbol.key.bound) != 1 or symbol.mode is Mode.EACH:
            return super()._value(symbol, inside)
        if symbol.mode is not Mode.COUNT and symbol.key.pattern not in self._aggregating:
            return super()._value(symbol, inside)
        place = (symbol.key, symbol.mode)
        if place not in self._sharing:
            self._sharing[place] = _Answers(self.function(*place))
        return self._sharing[place].__getitem__


class _Aggregating:
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
                for body in self._library.lowered(pattern).bodies
                for goal in body.goals
            ) or any(called in self for called in self._calls.called(pattern))
        return self._known[pattern]
