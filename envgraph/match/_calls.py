"""Which patterns call which, and which of them are recursive."""

from __future__ import annotations

from collections.abc import Iterator

from envgraph.pattern import (
    AggregateAtom,
    Atom,
    CallAtom,
    ClosureAtom,
    Library,
    NegationAtom,
)


class CallGraph:
    """Calls between the patterns of a library; grows with it, since a pattern is never redefined."""

    def __init__(self, library: Library) -> None:
        self._library = library
        self._reached: dict[str, frozenset[str]] = {}
        self._height: dict[str, int] = {}

    def component(self, pattern: str) -> frozenset[str]:
        """The patterns that call each other with this one; empty if it does not reach itself."""
        reached = self._reach(pattern)
        if pattern not in reached:
            return frozenset()
        return frozenset(name for name in reached if pattern in self._reach(name))

    def recursive(self, pattern: str) -> bool:
        """Whether the pattern calls itself, directly or through others."""
        return pattern in self._reach(pattern)

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

    def _reach(self, pattern: str) -> frozenset[str]:
        if pattern not in self._reached:
            found: dict[str, None] = {}
            queue = [pattern]
            for name in queue:
                for called in _called(self._library, name):
                    if called not in found:
                        found[called] = None
                        queue.append(called)
            self._reached[pattern] = frozenset(found)
        return self._reached[pattern]


def _called(library: Library, pattern: str) -> Iterator[str]:
    for body in library.lowered(pattern).bodies:
        for atom in body.atoms:
            yield from _names(atom)


def _names(atom: Atom) -> Iterator[str]:
    match atom:
        case CallAtom(name, _):
            yield name
        case ClosureAtom(step):
            yield step
        case NegationAtom(relation) | AggregateAtom(_, relation):
            yield from _names(relation)
        case _:
            pass
