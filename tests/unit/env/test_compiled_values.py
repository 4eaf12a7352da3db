"""Objects of other classes in observations, models that change later, and sums of floats."""

from __future__ import annotations

from math import fsum

import numpy as np
import pytest
from hypothesis import given, strategies as st

from envgraph.env import KeyIndex, Simulator
from envgraph.env.compiled import CompiledBatch, program_of
from envgraph.env.compiled.kernels import add_exactly, sum_exactly
from envgraph.errors import EvaluationError
from tests.unit.env.corners.classes import GO, GONE
from tests.unit.env.corners.yard import MODEL, Yard


def test_an_object_of_another_class_is_observed_as_none() -> None:
    behaviour = GONE + "observe adam.at among Pit or none"
    seen = []
    first, _ = Yard(GO, behaviour).opened()
    for model in (MODEL, MODEL.replace("s2 : Pit", "s2 : Spot")):  # the other one has no pit of the same key
        engine, read = Yard(GO, behaviour, model=model).opened()
        live = Simulator(engine, read, KeyIndex.of_model(first.model, ["Pit", "Spot"]))
        rng = np.random.default_rng(0)
        seen += [[live.reset(rng), *(live.step(place, rng).observation for place in (1, 2, 3))]]
    assert seen == [[1, 1, 0, 1], [1, 1, 1, 1]]


def test_observing_an_object_of_another_class_without_none_is_an_error() -> None:
    engine, behaviour = Yard(GO, GONE + "observe adam.at among Pit").opened()
    with pytest.raises(EvaluationError) as caught:
        Simulator(engine, behaviour).reset(np.random.default_rng(0))
    assert caught.value.message == "an observed path leads to `s0`, which is not of class `Pit`"
    assert caught.value.hint == "write `among Spot`, or `among Pit or none`"
    assert caught.value.span is not None and caught.value.span.text == "adam.at"


def test_later_changes_of_the_model_do_not_change_the_program() -> None:
    rules = "@semantics(spo) rule kill { lhs { i : Item; check i.id > 0; } modify { delete i; } }"
    seen = "pattern item(i : Item) { Item(i); }\n"
    engine, behaviour = Yard(rules, "action kill = kill()\nobserve count find item(_) up to 9", seen).opened()
    program = program_of(engine, behaviour, native=False)
    while engine.apply("kill"):
        pass
    engine.apply("newSpot")
    batch = CompiledBatch(program, [0])
    batch.reset(np.ones(1, dtype=np.bool_))
    counted = [batch.observation.item()]
    for _ in range(5):
        batch.step(np.zeros(1, dtype=np.int64), resets_ended=False)
        counted.append(batch.observation.item())
    assert counted == [5, 4, 3, 2, 1, 1]


@given(st.lists(st.floats(-1e300, 1e300) | st.sampled_from([1.0, 2.0**-53, -(2.0**-53), 2.0**-106, 0.1])))
def test_compiled_sums_of_floats_equal_exact_sums(values: list[float]) -> None:
    kept, parts = np.zeros((2_000, 1)), 0
    for value in values:
        parts = add_exactly(kept, 3, parts, value)
    assert sum_exactly(kept, 3, parts) == fsum(values)
