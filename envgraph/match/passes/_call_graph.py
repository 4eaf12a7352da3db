"""The call graph of patterns: recursive components, nesting depth and number of call paths."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

from envgraph.code import dataclass
from envgraph.errors import MAX_NESTING, EvaluationError
from envgraph.metamodel import strong_components
from envgraph.pattern import (
    AbsenceAtom,
    AggregateAtom,
    CallAtom,
    ClosureAtom,
    Goal,
    Library,
)


@dataclass(frozen=True, slots=True)
class CallSummary:
    """A summary of the part of the call graph that a pattern reaches.

    Attributes:
        component: names of the patterns in the same recursive component (mutual calls); empty if not recursive.
        is_linear: True if no body of the component contains two calls of patterns of the component.
        has_closure_or_recursion: True if the pattern, or a pattern that it reaches, is recursive or contains a closure.
        nesting: the largest number of closures and recursive components nested inside each other.
        paths: the number of call paths that start at the pattern; calls of recursive patterns are not followed.
        height: the length of the longest chain of calls from the pattern; a recursive pattern ends a chain.
    """

    component: frozenset[str]
    is_linear: bool
    has_closure_or_recursion: bool
    nesting: int
    paths: int
    height: int


class CallGraph:
    """The call graph of the patterns of a library. Summaries are cached, so patterns must not be redefined."""

    def __init__(self, library: Library) -> None:
        self._library = library
        self._known: dict[str, CallSummary] = {}

    def summary_of(self, pattern: str) -> CallSummary:
        """Return the summary of the part of the call graph that a pattern reaches."""
        if pattern not in self._known:
            for names, exits in strong_components(
                [pattern], lambda n: [] if n in self._known else self.called_patterns(n)
            ):
                if names[0] not in self._known:
                    self._known.update(dict.fromkeys(names, self._summarise(names, exits)))
        return self._known[pattern]

    def component(self, pattern: str) -> frozenset[str]:
        """Return the names of the patterns in the same recursive component; empty if the pattern is not recursive."""
        return self.summary_of(pattern).component

    def is_recursive(self, pattern: str) -> bool:
        """Return True if the pattern calls itself, directly or through other patterns."""
        return bool(self.summary_of(pattern).component)

    def called_patterns(self, pattern: str) -> list[str]:
        """Return the names of the patterns that a pattern calls directly, each once."""
        bodies = self._library.lowered_pattern(pattern).bodies
        return list(dict.fromkeys(name for body in bodies for goal in body.goals for name in _names(goal)))

    def _summarise(self, names: Sequence[str], exits: Collection[str]) -> CallSummary:
        """Return the summary of a strongly connected component of patterns; those of `exits` must be cached already.

        Args:
            names: the patterns of the component.
            exits: the patterns that the component calls; a single pattern that calls itself is among them.
        """
        bodies = [body.goals for name in names for body in self._library.lowered_pattern(name).bodies]
        called = [[name for goal in goals for name in _names(goal)] for goals in bodies]
        circle = frozenset(names if len(names) > 1 or names[0] in exits else ())
        searches = bool(circle) or any(isinstance(goal, ClosureAtom) for goals in bodies for goal in goals)
        below = [self._known[name] for name in exits if name not in circle]
        down = [] if circle else [self._known[name] for each in called for name in each]
        return CallSummary(
            component=circle,
            is_linear=all(sum(name in circle for name in each) < 2 for each in called),
            has_closure_or_recursion=searches or any(one.has_closure_or_recursion for one in below),
            nesting=max((one.nesting for one in below), default=0) + searches,
            paths=1 + sum(one.paths for one in down),
            height=max((one.height for one in down), default=-1) + 1,
        )


def check_nesting(calls: CallGraph, pattern: str) -> None:
    """Raise an error if closures and recursive patterns are nested too deeply for the Python stack.

    Raises:
        EvaluationError: the nesting depth is above the limit.
    """
    depth = calls.summary_of(pattern).nesting
    if depth > MAX_NESTING:
        raise EvaluationError(
            f"pattern `{pattern}` cannot be evaluated: it nests {depth} closures and recursive patterns inside each "
            f"other, but at most {MAX_NESTING} are allowed: let fewer patterns call each other"
        )


def _names(goal: Goal) -> Iterator[str]:
    """Yield the names of the patterns that a goal calls, also in aggregates and negations. Names may be repeated."""
    match goal:
        case CallAtom(name, _):
            yield name
        case ClosureAtom(step):
            yield step
        case AggregateAtom(_, relation):
            yield from _names(relation)
        case AbsenceAtom(alternatives):
            for alternative in alternatives:
                for inner in alternative:
                    yield from _names(inner)
        case _:
            pass
