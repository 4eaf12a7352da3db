"""A cache of the bodies of patterns as rewritten by a pipeline of passes."""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence

from envgraph.match.passes._calls import CallGraph
from envgraph.metamodel import components
from envgraph.pattern import Conjunction, Library


class Bodies:
    """The rewritten bodies of the patterns of a library. Each pattern is rewritten once and cached.

    Invariant: when a pass rewrites a body, the rewritten bodies of the patterns it calls are available, except those
    of recursive patterns.

    Args:
        library: the patterns.
        calls: their call graph.
        passes: the pipeline, applied to each body in this order.
        kept: names of patterns that are never inlined.
    """

    def __init__(
        self, library: Library, calls: CallGraph, passes: Sequence[Pass], kept: Container[str] = ()
    ) -> None:
        self.library = library
        self._calls = calls
        self._passes = passes
        self._kept = kept
        self._done: dict[str, tuple[Conjunction, ...]] = {}

    def of(self, pattern: str) -> tuple[Conjunction, ...]:
        """Return the rewritten bodies of a pattern, one for each body in the library; cache those of its callees."""
        if pattern not in self._done:
            # Bottom up, so that a long chain of calls does not exhaust the stack.
            for names, _ in components([pattern], lambda n: [] if n in self._done else self._calls.called(n)):
                for name in names:
                    if name not in self._done:
                        self._done[name] = tuple(map(self._rewritten, self.library.lowered(name).bodies))
        return self._done[pattern]

    def called(self, pattern: str) -> tuple[Conjunction, ...] | None:
        """Return the rewritten bodies that may replace a call; None if the pattern is recursive or not inlined."""
        return None if pattern in self._kept or self._calls.recursive(pattern) else self.of(pattern)

    def _rewritten(self, body: Conjunction) -> Conjunction:
        """Return a body after all passes have rewritten it in order."""
        for rewrite in self._passes:
            body = rewrite(body, self)
        return body


Pass = Callable[[Conjunction, Bodies], Conjunction]
"""A rewriting pass: returns an equivalent body. It can look up the rewritten bodies of called patterns in `Bodies`."""
