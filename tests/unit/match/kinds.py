"""The matchers that the shared tests run on."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from envgraph.graph import Model
from envgraph.match import CompiledMatcher, Matcher, ViewMatcher
from envgraph.pattern import Library
from tests.oracle.naive._naive import NaiveMatcher

Kind = Callable[[Model, Library], Matcher]


def watchable(library: Library) -> list[str]:
    """The patterns that may be watched."""
    return [
        pattern.qualified_name
        for pattern in library.patterns
        if pattern.strategy != "search" and not library.inputs(pattern.qualified_name)
    ]


def watched(model: Model, library: Library) -> ViewMatcher:
    """Views of all patterns from now on, whatever is in the model yet."""
    matcher = ViewMatcher(model, library)
    matcher.watch(*watchable(library))
    return matcher


def watched_later(model: Model, library: Library) -> ViewMatcher:
    """Views of all patterns from the first question on."""
    matcher = ViewMatcher(model, library)
    matcher.watch_later(*watchable(library))
    return matcher


KINDS: dict[str, Kind] = {
    "compiled": CompiledMatcher,
    "naive": NaiveMatcher,
    "watched": watched,
    "watched_later": watched_later,
}

every_kind = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)


def assert_sound(matcher: Matcher) -> None:
    """If it has views, they hold what a new computation finds."""
    if isinstance(matcher, ViewMatcher):
        matcher.check_integrity()
