"""Narrower spans: the word inside a construct that a diagnostic is about."""

from __future__ import annotations

import re

from envgraph.errors import Span


def part(span: Span | None, word: str, *, last: bool = False) -> Span | None:
    """Where a word stands in a span, its first or last place; the whole span if it is not there.

    The data keeps one span for a construct: `Tile.colour(t, c)` is one, and an unknown feature is a part of it.
    """
    if span is None:
        return None
    places = list(re.finditer(rf"(?<!\w){re.escape(word)}(?!\w)", span.text))
    if not places:
        return span
    found = places[-1 if last else 0]
    return span.source.span(span.start + found.start(), span.start + found.end())


def step(span: Span | None, features: tuple[str, ...], position: int) -> Span | None:
    """Where the step of a path stands: `f2` of `Type.f1.f2(a, b)`, or of an arrow `a -f2-> b`."""
    if span is None:
        return None
    # Steps are found from the left, each after the one before: a feature may be named like its class.
    start = span.start
    for name in features[: position + 1]:
        rest = span.source.span(start, span.end)
        found = re.search(rf"(?<=[.\-])\s*({re.escape(name)})(?!\w)", rest.text)
        if not found:
            return span
        where = span.source.span(start + found.start(1), start + found.end(1))
        start = where.end
    return where
