"""The call graph of patterns, and which of them are recursive."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

from envgraph.code import dataclass
from envgraph.errors import MOST_NESTED, EvaluationError
from envgraph.metamodel import components
from envgraph.pattern import (
    Absence,
    AggregateAtom,
    CallAtom,
    ClosureAtom,
    Goal,
    Library,
)


@dataclass(frozen=True, slots=True)
class Calls:
    """What a pattern reaches by calls.

    Attributes:
        component: the patterns that call each other with it; empty if it does not reach itself.
        linear: whether no body of these has two calls of them.
        searches: whether it, or one that it reaches, has a closure or is recursive.
        nesting: how many closures and circles of recursive patterns stand inside each other.
        paths: in how many ways one comes down from it; calls of recursive patterns are not followed.
        height: longest chain of calls below it; recursive patterns are the end of a chain.
    """

    component: frozenset[str]
    linear: bool
    searches: bool
    nesting: int
    paths: int
    height: int


class CallGraph:
    """Calls between the patterns of a library; grows with it, since a pattern is never redefined."""

    def __init__(self, library: Library) -> None:
        self._library = library
        self._known: dict[str, Calls] = {}

    def of(self, pattern: str) -> Calls:
        """Return what a pattern reaches."""
        if pattern not in self._known:
            for names, exits in components([pattern], lambda n: [] if n in self._known else self.called(n)):
                if names[0] not in self._known:
                    self._known.update(dict.fromkeys(names, self._calls(names, exits)))
        return self._known[pattern]

    def component(self, pattern: str) -> frozenset[str]:
        """The patterns that call each other with this one; empty if it does not reach itself."""
        return self.of(pattern).component

    def recursive(self, pattern: str) -> bool:
        """Return whether the pattern calls itself, directly or through others."""
        return bool(self.of(pattern).component)

    def called(self, pattern: str) -> list[str]:
        """The patterns that one calls, each once."""
        bodies = self._library.lowered(pattern).bodies
        return list(dict.fromkeys(name for body in bodies for goal in body.goals for name in _names(goal)))

    def _calls(self, names: Sequence[str], exits: Collection[str]) -> Calls:
        """Return what the patterns of a component reach, where that is known of the others that they call."""
        bodies = [body.goals for name in names for body in self._library.lowered(name).bodies]
        called = [[name for goal in goals for name in _names(goal)] for goals in bodies]
        circle = frozenset(names if len(names) > 1 or names[0] in exits else ())
        searches = bool(circle) or any(isinstance(goal, ClosureAtom) for goals in bodies for goal in goals)
        below = [self._known[name] for name in exits if name not in circle]
        down = [] if circle else [self._known[name] for each in called for name in each]
        return Calls(
            component=circle,
            linear=all(sum(name in circle for name in each) < 2 for each in called),
            searches=searches or any(one.searches for one in below),
            nesting=max((one.nesting for one in below), default=0) + searches,
            paths=1 + sum(one.paths for one in down),
            height=max((one.height for one in down), default=-1) + 1,
        )


def check_nesting(calls: CallGraph, pattern: str) -> None:
    """Check that a pattern can be evaluated with the stack that there is.

    Raises:
        EvaluationError: closures and recursive patterns stand inside each other too deep.
    """
    depth = calls.of(pattern).nesting
    if depth > MOST_NESTED:
        raise EvaluationError(
            f"pattern `{pattern}` cannot be evaluated: {depth} closures and recursive patterns stand inside each "
            f"other, and {MOST_NESTED} may"
        )


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
