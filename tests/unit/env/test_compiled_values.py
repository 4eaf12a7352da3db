"""Objects of other classes in observations, models that change later, and sums of floats."""

from __future__ import annotations

from math import fsum

import numpy as np
import pytest
from hypothesis import given, strategies as st

from envgraph.env import KeyIndex, Simulator
from envgraph.env.compiled import CompiledBatch, NotCompiled, program_of
from envgraph.env.compiled.kernels import _python_kernels
from envgraph.env.compiled.kernels.step_kernels import add_exactly, nearest, order, sum_exactly, whole
from envgraph.errors import EvaluationError
from envgraph.pattern import FUNCTIONS
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


LARGE = st.integers(-(2**63) + 1, 2**63 - 1) | st.integers(-5, 5)


@given(LARGE, LARGE)
def test_checked_operations_return_64_bits_and_whether_there_are_more(left: int, right: int) -> None:
    pairs = {
        _python_kernels.add_checked: left + right,
        _python_kernels.subtract_checked: left - right,
        _python_kernels.multiply_checked: left * right,
    }
    for function, exact in pairs.items():
        cut, beyond = function(np.int64(left), right)
        assert (cut - exact) % 2**64 == 0 and -(2**63) <= cut < 2**63
        assert beyond == (cut != exact)


@given(LARGE, LARGE.map(float) | st.floats(allow_nan=False, allow_infinity=False), st.integers(-2, 2))
def test_ints_and_floats_are_compared_exactly(one: int, other: float, near: int) -> None:
    for number in (other, float(one), float(one + near)):
        assert (order(one, number) > 0) - (order(one, number) < 0) == (one > number) - (one < number)


@given(st.floats(-1e19, 1e19) | st.integers(-9, 9).map(lambda n: n + 0.5) | st.just(0.49999999999999994))
def test_floats_are_rounded_as_by_expressions(number: float) -> None:
    exact = FUNCTIONS["round"].implementation(number)
    assert whole(nearest(number)) == ((exact, False) if -(2**63) <= exact < 2**63 else (0, True))


def test_numba_calls_the_same_functions_of_floats_as_python() -> None:
    """LLVM would compute `pow(x, 2.0)` as `x * x`, and vectorize `exp`, if it knew these functions."""
    numba = pytest.importorskip("numba")
    from envgraph.env.compiled.kernels import _arrays

    rng, bits = np.random.default_rng(0), np.random.default_rng(1).integers(0, 2**64, 5_000, dtype=np.uint64)
    numbers = np.concatenate([rng.normal(size=20_000) * 10, np.nan_to_num(bits.view(np.float64), nan=0.5)])
    powers = np.resize([2.0, 0.5, -1.0, 3.7, -0.2], len(numbers))
    for name in ("exp", "log", "sqrt", "pow"):
        called, python = getattr(_arrays, name), getattr(_python_kernels, name)

        @numba.njit
        def call(*row: float) -> float:
            return called(*row)  # type: ignore[no-any-return]  # noqa: B023

        rows = list(zip(numbers, powers, strict=True)) if name == "pow" else [(number,) for number in numbers]
        found, wanted = (np.array([function(*row) for row in rows]) for function in (call, python))
        same = (found.view(np.int64) == wanted.view(np.int64)) | ~(np.isfinite(found) | np.isfinite(wanted))
        assert same.all(), name


@pytest.mark.parametrize("value", ["s.n * s.n / s.n", "-s.n - 1", "s.n < 5 ? 1 : s.n * 4 - s.n * 3"])
def test_parts_of_expressions_beyond_64_bits_are_an_error(value: str) -> None:
    rule = f"rule compute(s : Spot) {{ lhs {{ s : Spot; }} modify {{ set s.n = {value}; }} }}"
    model = MODEL.replace("x = 1 ", "x = 1 n = 9223372036854775807 ")
    engine, behaviour = Yard(rule, "action compute(s : Spot) = compute(s)", model=model).opened()
    batch = CompiledBatch(program_of(engine, behaviour, native=False), [0])
    batch.reset(np.ones(1, dtype=np.bool_))
    with pytest.raises(EvaluationError, match=r"compiled environments do not support the int -9223372036854775808, or"):
        batch.step(np.array([1]), resets_ended=False)


def test_the_lowest_int_of_a_model_is_refused() -> None:
    model = MODEL.replace("x = 1 ", "x = 1 n = -9223372036854775808 ")
    with pytest.raises(NotCompiled, match="the int -9223372036854775808, which represents a missing value"):
        program_of(*Yard("", "action stay = nothing()\nobserve adam.at.n in 0..1", model=model).opened(), native=False)
