"""Traces that somebody has changed: they are refused at a place, or still lead to a state; nothing else happens."""

from __future__ import annotations

from functools import cache

from hypothesis import given, settings, strategies as st

from envgraph.errors import Source, TraceError
from envgraph.lang import parse_trace
from envgraph.rewrite import Engine, trace_to_text
from tests.profile import examples
from tests.unit.rewrite.graphs import chain, engine, snapshot

RULES = """
rule up(a : Item) { lhs { check a.n < 9; } modify { set a.n = a.n + 1; } }
rule name(a : Item, value : string) { lhs { } modify { set a.label = value; } }
rule grow { lhs { } modify { create new : Item { n = 5 }; } }
"""
PIECES = [
    "", "", "", "null", "[]", "{}", '"', "NaN", "1e999", "-1", "true", "9" * 30, "9" * 5000, "\\ud800", ",", ":", "\n",
    '{"end": 3}', '"state"', '"match"', '"rule"', "0", "a", "}", "{", "[" * 500, '"up"', '{"a": 1}',
]  # fmt: skip


def made() -> Engine:
    return engine(RULES, model=chain(2))


@cache
def recorded() -> str:
    one = made()
    with one.recording() as trace:
        one.apply("grow")
        one.apply("up", a=1)
        one.apply("name", a=0, value='a "name"')
    return trace_to_text(one, trace)


edits = st.deferred(
    lambda: st.tuples(
        st.integers(0, len(recorded())),
        st.sampled_from([0, 0, 1, 1, 2, 5, 20]),
        st.sampled_from(PIECES) | st.text(max_size=3),
    )
)


@settings(max_examples=examples(50))
@given(st.lists(edits, min_size=1, max_size=3))
def test_edited_trace_is_replayed_or_refused_with_a_position(
    changes: list[tuple[int, int, str]],
) -> None:
    text = recorded()
    for start, length, piece in changes:
        text = text[:start] + piece + text[start + length :]
    one = made()
    before = snapshot(one.model)
    try:
        one.replay(parse_trace(Source("a.trace", text), one))
    except TraceError as error:
        assert all(problem.span is not None for problem in error.diagnostics)
        assert str(error)
        assert snapshot(one.model) == before
    one.check_integrity()
