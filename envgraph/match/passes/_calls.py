"""Which patterns call which, and which of them are recursive."""

from __future__ import annotations

from collections.abc import Iterator

from envgraph.errors import MOST_NESTED, EvaluationError
from envgraph.match._components import components
from envgraph.pattern import (
    Absence,
    AggregateAtom,
    CallAtom,
    ClosureAtom,
    Goal,
    Library,
)


class CallGraph:
    """Calls between the patterns of a library; grows with it, since a pattern is never redefined."""

    def __init__(self, library: Library) -> None:
        self._library = library
        self._components: dict[str, frozenset[str]] = {}
        self._paths: dict[str, int] = {}
        self._height: dict[str, int] = {}
        self._searches: dict[str, bool] = {}
        self._nesting: dict[str, int] = {}

    def component(self, pattern: str) -> frozenset[str]:
        """The patterns that call each other with this one; empty if it does not reach itself."""
        if pattern not in self._components:
            # A pattern that is known calls nothing that is new, and is not looked into again.
            for names, called in components([pattern], self._unknown):
                if names[0] not in self._components:
                    circle = len(names) > 1 or names[0] in called
                    self._components.update(dict.fromkeys(names, frozenset(names) if circle else frozenset()))
        return self._components[pattern]

    def recursive(self, pattern: str) -> bool:
        """Whether the pattern calls itself, directly or through others."""
        return bool(self.component(pattern))

    def searches(self, pattern: str) -> bool:
        """Whether the pattern, or one that it reaches by calls, has a closure or is recursive."""
        if pattern not in self._searches:
            for name in self.bottom_up(pattern):
                goals = [goal for body in self._library.lowered(name).bodies for goal in body.goals]
                below = any(self._searches.get(each, False) for goal in goals for each in _names(goal))
                closed = any(isinstance(goal, ClosureAtom) for goal in goals)
                self._searches[name] = closed or below or self.recursive(name)
        return self._searches[pattern]

    def nesting(self, pattern: str) -> int:
        """How many closures and circles of recursive patterns stand inside each other."""
        if pattern not in self._nesting:
            known, library = self._nesting, self._library
            called = lambda name: [] if name in known else list(dict.fromkeys(_called(library, name)))  # noqa: E731
            for names, exits in components([pattern], called):
                if names[0] not in known:
                    below = max((known[each] for each in exits if each not in names), default=0)
                    goals = [a for name in names for body in library.lowered(name).bodies for a in body.goals]
                    one = self.recursive(names[0]) or any(isinstance(goal, ClosureAtom) for goal in goals)
                    known.update(dict.fromkeys(names, below + one))
        return self._nesting[pattern]

    def linear(self, pattern: str) -> bool:
        """Whether no body of the patterns that call each other with this one has two such calls."""
        component = self.component(pattern)
        bodies = (body for name in component for body in self._library.lowered(name).bodies)
        return all(sum(name in component for a in body.goals for name in _names(a)) < 2 for body in bodies)

    def paths(self, pattern: str) -> int:
        """In how many ways one comes down from a pattern by calls; those of recursive patterns are not followed."""
        if pattern not in self._paths:
            for name in self.bottom_up(pattern):
                below = [] if self.recursive(name) else _called(self._library, name)
                self._paths[name] = 1 + sum(self._paths.get(each, 1) for each in below)
        return self._paths[pattern]

    def bottom_up(self, pattern: str) -> list[str]:
        """The pattern and all that it reaches, callees before callers as far as recursion allows."""
        order: dict[str, None] = {}
        open_: dict[str, None] = {}
        pending = [pattern]
        while pending:
            name = pending[-1]
            if name in order:
                pending.pop()
            elif name in open_:
                order[name] = None
                pending.pop()
            else:
                open_[name] = None
                pending.extend(called for called in _called(self._library, name) if called not in open_)
        return list(order)

    def height(self, pattern: str) -> int:
        """Longest chain of calls below a pattern; recursive patterns are the end of a chain."""
        if pattern not in self._height:
            for name in self.bottom_up(pattern):
                below = (
                    []
                    if self.recursive(name)
                    else [self.height(each) for each in _called(self._library, name)]
                )
                self._height[name] = max(below, default=-1) + 1
        return self._height[pattern]

    def _unknown(self, pattern: str) -> list[str]:
        """What a pattern calls, for one whose component is not known yet."""
        return [] if pattern in self._components else list(dict.fromkeys(_called(self._library, pattern)))


def check_nesting(calls: CallGraph, pattern: str) -> None:
    """Whether a pattern can be evaluated with the stack that there is.

    Raises:
        EvaluationError: closures and recursive patterns stand inside each other too deep.
    """
    depth = calls.nesting(pattern)
    if depth > MOST_NESTED:
        raise EvaluationError(
            f"pattern `{pattern}` cannot be evaluated: {depth} closures and recursive patterns stand inside each "
            f"other, and {MOST_NESTED} may"
        )


def _called(library: Library, pattern: str) -> Iterator[str]:
    for body in library.lowered(pattern).bodies:
        for goal in body.goals:
            yield from _names(goal)


def _names(goal: Goal) -> Iterator[str]:
    match goal:
        case CallAtom(name, _):
            yield name
        case ClosureAtom(step):
            yield step
        case AggregateAtom(_, relation):
            yield from _names(relation)
        case Absence(alternatives):
            for alternative in alternatives:
                for inner in alternative:
                    yield from _names(inner)
        case _:
            pass
