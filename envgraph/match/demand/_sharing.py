"""Questions that are asked again and again, as that for an objective at each step of a search.

A matcher inlines small patterns, so that their goals are met in the best order with those around them, and its plans
depend on the metamodel alone. Here plans are made for the model as it is, and what aggregates the matches of other
patterns is called: in one state it is computed once for each object, however often it is asked for.
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
    """Patterns without arguments that are asked again and again, planned for the model as it is now.

    The rows may come in another order than those of a matcher.
    """

    def __init__(self, model: Model, library: Library) -> None:
        self._program = _Sharing(model, library)
        self._functions: dict[tuple[str, Mode], Callable[[], Any]] = {}

    def rows(self, pattern: str) -> Sequence[Row]:
        """All matches."""
        return self._ask(pattern, Mode.ROWS)  # type: ignore[no-any-return]

    def count(self, pattern: str) -> int:
        """How many there are."""
        return self._ask(pattern, Mode.COUNT)  # type: ignore[no-any-return]

    def _ask(self, pattern: str, mode: Mode) -> Any:
        question = (pattern, mode)
        if question not in self._functions:
            self._functions[question] = self._program.answering(pattern, (), mode)
        self._program.begin()
        return self._functions[question]()


class _Answers(dict[Any, Any]):
    """What a function gives for each value, computed where it is first looked up."""

    def __init__(self, function: Function) -> None:
        super().__init__()
        self._function = function

    def __missing__(self, value: Any) -> Any:
        found = self[value] = self._function(value)
        return found


class _Sharing(Program):
    """Functions that ask once for what aggregates the matches of another pattern for an object."""

    def __init__(self, model: Model, library: Library) -> None:
        super().__init__(model, library)
        self._aggregating = _Aggregating(library, self.calls)
        self.planner = Planner(library, self.calls, LiveSizes(library, model.graph.store), self._aggregating)
        self._sharing: dict[tuple[ViewKey, Mode], _Answers] = {}
        self._revision = -1

    def begin(self) -> None:
        """Something is asked: of another state nothing is known."""
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
    """The patterns that aggregate the matches of others, or call such a pattern: their calls stay calls."""

    def __init__(self, library: Library, calls: CallGraph) -> None:
        self._library, self._calls = library, calls
        self._known: dict[str, bool] = {}

    def __contains__(self, pattern: object) -> bool:
        assert isinstance(pattern, str)
        if pattern not in self._known:
            self._known[pattern] = False  # of a circle nothing else is known
            self._known[pattern] = any(
                isinstance(goal, AggregateAtom) and isinstance(goal.relation, CallAtom)
                for body in self._library.lowered(pattern).bodies
                for goal in body.goals
            ) or any(called in self for called in self._calls.called(pattern))
        return self._known[pattern]
