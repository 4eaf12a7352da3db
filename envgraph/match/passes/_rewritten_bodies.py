"""A cache of the bodies of patterns as rewritten by a pipeline of passes."""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence

from envgraph.match.passes._call_graph import CallGraph
from envgraph.metamodel import strong_components
from envgraph.pattern import Conjunction, Library


class RewrittenBodies:
    """The rewritten bodies of the patterns of a library. Each pattern is rewritten once and cached.

    Invariant: when a pass rewrites a body, the rewritten bodies of the patterns it calls are available, except those
    of recursive patterns.

    Args:
        library: the patterns.
        calls: their call graph.
        passes: the pipeline, applied to each body in this order.
        not_inlined: names of patterns that are never inlined.
    """

    def __init__(
        self, library: Library, calls: CallGraph, passes: Sequence[Pass], not_inlined: Container[str] = ()
    ) -> None:
        self.library = library
        self._calls = calls
        self._passes = passes
        self._kept = not_inlined
        self._done: dict[str, tuple[Conjunction, ...]] = {}

    def bodies_of(self, pattern: str) -> tuple[Conjunction, ...]:
        """Return the rewritten bodies of a pattern, one for each body in the library; cache those of its callees."""
        if pattern not in self._done:
            # Bottom up, so that a long chain of calls does not exhaust the stack.
            for names, _ in strong_components(
                [pattern], lambda n: [] if n in self._done else self._calls.called_patterns(n)
            ):
                for name in names:
                    if name not in self._done:
                        self._done[name] = tuple(map(self._run_passes, self.library.lowered_pattern(name).bodies))
        return self._done[pattern]

    def inlinable_bodies(self, pattern: str) -> tuple[Conjunction, ...] | None:
        """Return the rewritten bodies that may replace a call; None if the pattern is recursive or not inlined."""
        return None if pattern in self._kept or self._calls.is_recursive(pattern) else self.bodies_of(pattern)

    def _run_passes(self, body: Conjunction) -> Conjunction:
        """Return a body after all passes have rewritten it in order."""
        for rewrite in self._passes:
            body = rewrite(body, self)
        return body


Pass = Callable[[Conjunction, RewrittenBodies], Conjunction]
"""A rewriting pass: returns an equivalent body. It can look up the rewritten bodies of called patterns in `Bodies`."""
