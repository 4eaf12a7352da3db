"""The bodies of patterns after all passes of a pipeline."""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence

from envgraph.match.passes._calls import CallGraph
from envgraph.metamodel import components
from envgraph.pattern import Conjunction, Library


class Bodies:
    """The bodies of the patterns of a library as a pipeline leaves them, each worked out once.

    Invariant: when a pass looks at a body, those of the patterns that it calls are there, recursive ones excepted.

    Args:
        library: the patterns.
        calls: which of them call which.
        passes: the pipeline.
        kept: patterns whose calls stay calls.
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
        """One conjunction for each body of a pattern."""
        if pattern not in self._done:
            # Bottom up, so that a long chain of calls needs no deep stack.
            for names, _ in components([pattern], lambda n: [] if n in self._done else self._calls.called(n)):
                for name in names:
                    if name not in self._done:
                        self._done[name] = tuple(map(self._rewritten, self.library.lowered(name).bodies))
        return self._done[pattern]

    def called(self, pattern: str) -> tuple[Conjunction, ...] | None:
        """The bodies that may stand in place of a call; None for a recursive pattern, and where the call stays."""
        return None if pattern in self._kept or self._calls.recursive(pattern) else self.of(pattern)

    def _rewritten(self, body: Conjunction) -> Conjunction:
        for rewrite in self._passes:
            body = rewrite(body, self)
        return body


Pass = Callable[[Conjunction, Bodies], Conjunction]
"""Rewrites one body, with those of the patterns that it calls at hand; the matches stay the same."""
