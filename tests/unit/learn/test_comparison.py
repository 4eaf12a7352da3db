"""What is said of a curriculum beside its controls."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from envgraph.errors import InvalidArgument
from envgraph.learn import (
    Comparison,
    Curve,
    Experiment,
    RunResult,
    bootstrap_interval,
    compare,
    findings,
    newcombe_interval,
    permutation_test,
)
from envgraph.learn._curricula import Kind


def runs(
    label: str,
    successes: Sequence[float],
    kind: Kind = "control",
    steps: int = 600,
    before: int = 0,
    returns: Sequence[float] | None = None,
) -> list[RunResult]:
    curve = Curve((steps,), (0.0,), (1,), (0,))
    totals = successes if returns is None else returns
    return [
        RunResult(kind, label, seed, steps, 1, success, total, 5.0, before, 0.0, curve)
        for seed, (success, total) in enumerate(zip(successes, totals, strict=True))
    ]


def compared(*groups: list[RunResult]) -> tuple[Comparison, ...]:
    return compare(Experiment(tuple(run for group in groups for run in group)))


HALF = [1.0, 0.0] * 500
WHOLE = runs("E1-E6", HALF, "curriculum")


def test_an_order_that_is_worse_than_its_reverse_is_said_to_be() -> None:
    (one,) = compared(WHOLE, runs("reversed", [1.0] * 820 + [0.0] * 180))
    assert one.verdict == "worse" and one.p_value < 1e-10 and one.seeds == 1_000
    assert str(one) == "E1-E6 is worse than its reverse (0.50 against 0.82 over 1,000 seeds, p < 0.001)"
    assert one.difference == newcombe_interval(0.5, 1_000, 0.82, 1_000)
    assert one.improvement == pytest.approx(0.5 * 0.18 + 0.5 * (0.5 * 0.82 + 0.5 * 0.18))


def test_as_much_needs_seeds_enough_and_else_nothing_is_told() -> None:
    (much,) = compared(runs("E1-E6", [1.0] * 1_000, "curriculum"), runs("optimistic", [1.0] * 1_000))
    expected = "reach as much (1.00 against 1.00 over 1,000 seeds, p = 1)"
    assert str(much) == f"E1-E6 and direct training with optimistic values {expected}"
    few = compared(runs("E1-E6", [1.0] * 30, "curriculum"), runs("optimistic", [1.0] * 30))
    assert few[0].verdict == "undecided"
    assert findings(few) == [
        "With 600 steps in all nothing can be told apart:",
        "E1-E6 and direct training with optimistic values cannot be told apart "
        "(1.00 against 1.00 over 30 seeds, p = 1)",
    ]


def test_few_seeds_cannot_tell_anything() -> None:
    found = compared(runs("E1-E6", [0.0] * 5, "curriculum"), runs("optimistic", [1.0] * 5))
    assert "cannot be told apart by so few seeds: it takes 6 (0.00 against 1.00" in str(found[0])
    found = compared(runs("E1-E6", [0.0] * 6, "curriculum"), runs("optimistic", [1.0] * 6))
    assert found[0].verdict == "worse"


def test_more_comparisons_take_more_seeds() -> None:
    def beside_six(seeds: int) -> tuple[Comparison, ...]:
        names = ["optimistic", "reversed", "randomised", "uniform", "plr", "band"]
        return compared(
            runs("E1-E6", [0.0] * seeds, "curriculum"), *(runs(name, [1.0] * seeds) for name in names)
        )

    for seeds in (6, 7):
        assert all("by so few seeds: it takes 8 (" in str(one) for one in beside_six(seeds))
    assert {one.verdict for one in beside_six(8)} == {"worse"}


def test_where_neither_succeeds_they_do_not_reach_as_much() -> None:
    first, third = runs("E1-E6", [0.0] * 500, "curriculum"), runs("randomised", [1.0] * 500)
    found = compared(first, runs("reversed", [0.0] * 500), third)
    assert str(found[0]) == "neither E1-E6 nor its reverse succeeds (0.00 against 0.00 over 500 seeds, p = 1)"


def test_p_values_are_corrected_for_all_comparisons() -> None:
    first = runs("E1-E6", [1.0] * 8, "curriculum")
    found = compared(first, runs("reversed", [0.0] * 8), runs("randomised", [0.0, 1.0] * 4))
    assert [one.p_value for one in found] == pytest.approx([2 * 2 / 2**8, 2 / 2**4])
    assert findings(found)[0] == "With 600 steps in all (p-values are corrected for 2 comparisons):"
    assert [one.verdict for one in found] == ["better", "undecided"]


def test_numbered_controls_are_one() -> None:
    others = [[1.0, 0.0, 1.0], [0.0, 0.0, 1.0]]
    (one,) = compared(
        runs("E1-E6", [0.0, 0.0, 1.0], "curriculum"),
        *(runs(f"shuffled {place}", row) for place, row in enumerate(others, start=1)),
    )
    assert (one.control, one.other) == ("shuffled", 0.5)
    assert one.p_value == permutation_test([0, 0, 1], [[1, 0], [0, 0], [1, 1]])


def test_only_training_on_the_target_and_controls_with_as_many_steps_are_compared() -> None:
    found = compared(
        WHOLE,
        runs("E2-E6", HALF, "curriculum", steps=500),
        runs("E1", HALF, "baseline", before=600),
        runs("E6", HALF, "baseline"),
        runs("reversed", HALF, steps=500),
    )
    assert [one.called for one in found] == ["training on E6 alone"]
    assert compared(runs("E6", HALF, "baseline")) == () and findings(()) == []


def test_where_nobody_succeeds_returns_are_compared() -> None:
    first = runs("E1-E6", [0.0] * 9, "curriculum", returns=[float(seed) for seed in range(9)])
    (one,) = compared(first, runs("reversed", [0.0] * 9, returns=[seed - 2.5 for seed in range(9)]))
    assert (one.by, one.verdict, one.difference) == ("return", "better", (2.5, 2.5))
    assert "(return 4.00 against 1.50 over 9 seeds, p = 0.0039)" in str(one)
    (single,) = compared(first[:1], runs("reversed", [0.0], returns=[1.0]))
    assert single.difference is None and "over 1 seed, p = 1" in str(single)
    assert bootstrap_interval([0.0]) is None


def test_runs_of_different_seeds_are_not_compared() -> None:
    with pytest.raises(InvalidArgument, match="`E1-E6` and `reversed` have different seeds"):
        compared(WHOLE, runs("reversed", [0.0]))
