"""Random units: the generated functions do what the naive interpreter does, and everything can be taken back."""

from __future__ import annotations

from contextlib import suppress
from random import Random

from hypothesis import given, settings, strategies as st

from envgraph.errors import EvaluationError, Source
from envgraph.lang import parse_trace
from envgraph.rewrite import Engine, trace_to_text
from tests.oracle.random_units import QUERIES, RULES, Writer
from tests.oracle.unit_interpreter import Interpreter
from tests.profile import examples
from tests.unit.rewrite.graphs import chain, definitions, patterns, snapshot

BASE = (*patterns(QUERIES), *definitions(RULES))
seeds = st.integers(0, 2**32 - 1)


WATCHED = ("up", "heavy", "urgent", "link", "adopt", "drop", "next")


def start(text: str, length: int, seed: int, watched: bool = False) -> Engine:
    model = chain(length)
    model.node(length - 1).links.append(model.node(0))
    made = Engine(model, seed=seed)
    made.add(*BASE, *definitions(text))
    if watched:
        made.watch(*WATCHED)
    made.step_limit = 3_000
    made.rng = Random(seed)  # type: ignore[assignment]
    return made


@settings(max_examples=examples(40))
@given(seeds, st.integers(1, 4), st.booleans())
def test_random_unit_runs_like_the_interpreter(seed: int, length: int, watched: bool) -> None:
    text = Writer(Random(seed)).unit()
    made, plain = start(text, length, seed, watched), start(text, length, seed, watched)
    interpreter = Interpreter(plain, seed)
    try:
        result = made.run("u", a=0)
    except EvaluationError as error:  # too many steps, or a sum that is too large: then nothing is left of it
        assert "steps" in str(error)
        assert snapshot(made.model) == snapshot(start(text, length, seed).model)
        return
    assert interpreter.run("u", a=0) is bool(result), text
    assert result.firings == tuple(interpreter.trace), text
    assert snapshot(made.model) == snapshot(plain.model), text
    assert made.rng.random() == interpreter.random.random(), text
    assert (result.reason is None) is bool(result)
    made.check_integrity()


@settings(max_examples=examples(25))
@given(seeds, st.integers(1, 4))
def test_random_unit_can_be_rolled_back_and_replayed(seed: int, length: int) -> None:
    text = Writer(Random(seed)).unit()
    made = start(text, length, seed)
    before, savepoint = snapshot(made.model), made.model.graph.history.savepoint()
    try:
        with made.recording() as trace:
            made.run("u", a=0)
    except EvaluationError:
        assert snapshot(made.model) == before
        return
    after = snapshot(made.model)
    made.model.graph.history.rollback(savepoint)
    assert snapshot(made.model) == before
    made.model.check_integrity()
    other = start(text, length, seed)
    other.replay(parse_trace(Source("u.trace", trace_to_text(made, trace)), other))
    assert snapshot(other.model) == after


@settings(max_examples=examples(15))
@given(seeds, st.integers(1, 4))
def test_failing_atomic_block_rolls_back_a_random_unit(seed: int, length: int) -> None:
    text = Writer(Random(seed)).unit()
    made = start(f"{text} unit whole(a : Item) {{ atomic {{ u(a); never; }} }}", length, seed)
    before = snapshot(made.model)
    with suppress(EvaluationError):
        assert not made.run("whole", a=0)
    assert snapshot(made.model) == before
