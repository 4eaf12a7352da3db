"""Reuse what was read from files that have not changed since an earlier check."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from typing import TYPE_CHECKING, Any, TypeVar, TypeVarTuple

from envgraph.code import dataclass

if TYPE_CHECKING:
    from envgraph.pattern import CheckedPatterns

_Arguments = TypeVarTuple("_Arguments")
_Result = TypeVar("_Result")
_Known = Mapping[tuple[Any, str], tuple[tuple[Any, ...], Any]]


@dataclass(slots=True)
class ReadingCache:
    """The results of reading and checking files, for the next check of nearly the same files.

    Attributes:
        known: the results of an earlier check by function and file, each with the arguments of the function.
        results: the results of this check.
        patterns: the patterns as an earlier check, and then this one, found them; None if they call declared functions.
    """

    known: _Known = field(default_factory=dict)
    results: dict[tuple[Any, str], tuple[tuple[Any, ...], Any]] = field(default_factory=dict)
    patterns: CheckedPatterns | None = None

    def call(self, name: str, function: Callable[[*_Arguments], _Result], *args: *_Arguments) -> _Result:
        """Return what a function returns for a file: the earlier result if the arguments are still equal."""
        known = self.known.get((function, name))
        if known is None or known[0] != args:
            known = args, function(*args)
        self.results[function, name] = known
        result: _Result = known[1]
        return result

    def next(self) -> ReadingCache:
        """Return a cache for the next check, which reuses the results of this one."""
        return ReadingCache(self.results, patterns=self.patterns)
