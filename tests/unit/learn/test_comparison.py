"""What is said of a curriculum beside its controls."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import Any

import pytest

from envgraph.errors import InvalidArgument
from envgraph.learn import (
    Comparison,
    Curve,
    Experiment,
    RunResult,
    best_way,
    bootstrap_interval,
    compare,
    findings,
    wilson_interval,
)


def runs(
    label: str,
    successes: Sequence[float],
    kind: Any = "control",
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


def test_an_order_worse_than_its_reverse_has_the_verdict_worse() -> None:
    (one,) = compared(WHOLE, runs("reversed", [1.0] * 820 + [0.0] * 180))
    assert one.verdict == "worse" and one.p_value < 1e-10 and one.seeds == 1_000
    assert str(one) == "E1-E6 is worse than its reverse (0.50 against 0.82 over 1,000 seeds, p < 0.001)"
    (low, high), (other_low, other_high) = wilson_interval(0.5, 1_000), wilson_interval(0.82, 1_000)
    below = -0.32 - sqrt((0.5 - low) ** 2 + (other_high - 0.82) ** 2)  # Newcombe 1998, method 10
    above = -0.32 + sqrt((high - 0.5) ** 2 + (0.82 - other_low) ** 2)
    assert one.difference == pytest.approx((below, above), abs=1e-12)
    assert one.improvement == pytest.approx(0.5 * 0.18 + 0.5 * (0.5 * 0.82 + 0.5 * 0.18))


def test_the_verdict_equal_needs_enough_seeds() -> None:
    (much,) = compared(runs("E1-E6", [1.0] * 1_000, "curriculum"), runs("randomised", [1.0] * 1_000))
    expected = "differ by at most 0.05 (1.00 against 1.00 over 1,000 seeds, p = 1)"
    assert str(much) == f"E1-E6 and domain randomisation {expected}" and much.verdict == "equal"
    few = compared(runs("E1-E6", [1.0] * 30, "curriculum"), runs("optimistic 4.4", [1.0] * 30))
    assert few[0].verdict == "undecided" and few[0].is_tie
    assert findings(few) == [
        "With 600 steps in all no difference is significant:",
        "no significant difference between E1-E6 and direct training with optimistic values of 4.4 "
        "(1.00 against 1.00 over 30 seeds, p = 1)",
    ]


def test_few_seeds_show_no_difference() -> None:
    found = compared(runs("E1-E6", [0.0] * 5, "curriculum"), runs("randomised", [1.0] * 5))
    assert str(found[0]).startswith(
        "E1-E6 and domain randomisation: a significant difference takes at least 6 seeds (0.00 against"
    )
    found = compared(runs("E1-E6", [0.0] * 6, "curriculum"), runs("randomised", [1.0] * 6))
    assert found[0].verdict == "worse"


def test_more_comparisons_take_more_seeds() -> None:
    def beside_six(seeds: int) -> tuple[Comparison, ...]:
        names = ["optimistic 1", "reversed", "randomised", "uniform", "plr", "band"]
        return compared(runs("E1-E6", [0.0] * seeds, "curriculum"), *(runs(name, [1.0] * seeds) for name in names))

    for seeds in (6, 7):
        assert all("takes at least 8 seeds (" in str(one) for one in beside_six(seeds))
    assert {one.verdict for one in beside_six(8)} == {"worse"}


def test_returns_are_not_compared_if_neither_side_succeeds() -> None:
    """Standing still may cost nothing, so that its return is better than that of a way to the goal."""
    first = runs("E1-E6", [0.0] * 500, "curriculum", returns=[-1.0] * 500)
    still = runs("reversed", [0.0] * 500, returns=[0.0] * 500)
    found = compared(first, still, runs("randomised", [1.0] * 500))
    assert [one.verdict for one in found] == ["neither", "worse"]
    assert str(found[0]) == "neither E1-E6 nor its reverse succeeds (0.00 against 0.00 over 500 seeds, p = 1)"
    (alone,) = compared(first, still)
    assert (alone.verdict, alone.by) == ("neither", "success")


def test_p_values_are_corrected_for_all_comparisons() -> None:
    first = runs("E1-E6", [1.0] * 8, "curriculum")
    found = compared(first, runs("reversed", [0.0] * 8), runs("randomised", [0.0, 1.0] * 4))
    assert [one.p_value for one in found] == pytest.approx([2 * 2 / 2**8, 2 / 2**4])
    assert findings(found)[0] == "With 600 steps in all (p-values are corrected for 2 comparisons):"
    assert [one.verdict for one in found] == ["better", "undecided"]


def test_only_the_best_optimistic_control_is_compared() -> None:
    """By mean success, then by mean return; what is not compared stays in the experiment."""
    given = runs("E1-E6", [0.0, 0.0, 1.0], "curriculum")
    half, full = (
        runs("optimistic 1", [1.0, 0.0, 1.0]),
        runs("optimistic 2", [1.0, 1.0, 0.0], returns=[9.0] * 3),
    )
    none, other = runs("optimistic 4, epsilon 0.05", [0.0] * 3), runs("reversed", [0.0] * 3)
    experiment = Experiment((*given, *half, *full, *none, *other))
    assert experiment.best_optimistic().runs == (*given, *full, *other)
    found = compare(experiment)
    assert [one.control for one in found] == ["optimistic 2", "reversed"]
    assert found[0].called == "direct training with optimistic values of 2"
    assert Experiment((*given, *other)).best_optimistic().runs == (*given, *other)
    assert compared(given, runs("optimistic", [0.0] * 3))[0].called == "direct training with optimistic values"


def test_only_direct_training_and_controls_with_equal_steps_are_compared() -> None:
    found = compared(
        WHOLE,
        runs("E2-E6", HALF, "curriculum", steps=500),
        runs("E1", HALF, "baseline", before=600),
        runs("E6", HALF, "baseline"),
        runs("reversed", HALF, steps=500),
    )
    assert [one.called for one in found] == ["training on E6 alone"]
    assert compared(runs("E6", HALF, "baseline")) == () and findings(()) == []


def test_returns_are_compared_if_no_episode_can_succeed() -> None:
    def beside(*groups: list[RunResult]) -> Comparison:
        return compare(Experiment(tuple(run for group in groups for run in group)), can_succeed=False)[0]

    first = runs("E1-E6", [0.0] * 9, "curriculum", returns=[float(seed) for seed in range(9)])
    second = runs("reversed", [0.0] * 9, returns=[seed - 2.5 for seed in range(9)])
    one = beside(first, second)
    assert (one.by, one.verdict, one.difference) == ("return", "better", (2.5, 2.5))
    assert "(return 4.00 against 1.50 over 9 seeds, p = 0.0039)" in str(one)
    single = beside(first[:1], runs("reversed", [0.0], returns=[1.0]))
    assert single.difference is None and "over 1 seed, p = 1" in str(single)
    assert bootstrap_interval([0.0]) is None
    way = best_way(Experiment((*second, *first)), "E6", can_succeed=False)
    assert str(way) == (
        "Best of 2 ways to train E6 with 600 steps: the curriculum E1-E6, a mean return of 4.00 of "
        "9 agents; next its reverse, a mean return of 1.50."
    )


def best_line(*groups: list[RunResult]) -> str:
    return str(best_way(Experiment(tuple(run for group in groups for run in group)), "E6"))


def test_the_best_and_second_best_trainings_are_named() -> None:
    others = runs("reversed", HALF), runs("backplay, 6 stages", [1.0] * 800 + [0.0] * 200)
    first = runs("E1-E6", [1.0] * 970 + [0.0] * 30, "curriculum")
    assert best_line(first, *others) == (
        "Best of 3 ways to train E6 with 600 steps: the curriculum E1-E6, 97 % of 1,000 agents; "
        "next backplay in 6 stages, 80 %."
    )
    assert best_line(*others, first) == best_line(first, *others)
    assert best_line(*others) == (
        "Best of 2 ways to train E6 with 600 steps: backplay in 6 stages, 80 % of 1,000 agents; next its reverse, 50 %."
    )
    assert (
        best_line(first)
        == "None"
        == best_line(first, runs("E5-E6", HALF, "curriculum"), runs("E1", HALF, "baseline", before=600))
    )


def test_trainings_without_a_significant_difference_tie() -> None:
    first, other = runs("E1-E6", [1.0] * 100, "curriculum"), runs("reversed", [0.0] * 100)
    found = best_line(runs("backplay", [1.0] * 99 + [0.0]), other, first)
    assert found == (
        "Best of 3 ways to train E6 with 600 steps: the curriculum E1-E6 and backplay tie, at best 100 % of "
        "100 agents; "
        "next its reverse, 0 %."
    )
    way = best_way(Experiment((*first, *runs("backplay", [1.0] * 100), *other)), "E6")
    assert way is not None and way.best == ["the curriculum E1-E6", "backplay"] and way.needs_curriculum


def test_a_target_learned_by_direct_training_needs_no_curriculum() -> None:
    first = runs("E1-E6", [1.0] * 100, "curriculum")
    for direct in (runs("E6", [1.0] * 100, "baseline"), runs("optimistic 4.4", [1.0] * 98 + [0.0] * 2)):
        found = best_line(first, direct, runs("reversed", [0.0] * 100))
        assert " tie, at best 100 % of 100 agents; " in found
        assert found.endswith("next its reverse, 0 %. The target needs no curriculum with so many steps.")
    found = best_line(runs("E1-E6", [0.0] * 199 + [1.0], "curriculum"), runs("E6", [0.0] * 200, "baseline"))
    assert found == "All 2 ways to train E6 with 600 steps tie, at best 0.5 % of 200 agents."


def test_the_first_line_reports_that_no_training_succeeds() -> None:
    found = best_line(runs("E1-E6", [0.0] * 8, "curriculum"), runs("E6", [0.0] * 8, "baseline"))
    assert found == "None of 2 ways to train E6 with 600 steps succeeds with any of 8 agents."


def test_few_agents_tie_only_if_their_means_are_equal() -> None:
    first, same = runs("E1-E6", [1.0] * 3, "curriculum"), runs("backplay", [1.0] * 3)
    assert best_line(first, runs("reversed", [0.0, 1.0, 1.0]), same) == (
        "Best of 3 ways to train E6 with 600 steps: the curriculum E1-E6 and backplay tie, at best 100 % of 3 agents; "
        "next its reverse, 66.7 %; a significant difference takes at least 7 agents."
    )


def test_runs_of_different_seeds_are_not_compared() -> None:
    with pytest.raises(InvalidArgument, match="`E1-E6` and `reversed` have different seeds"):
        compared(WHOLE, runs("reversed", [0.0]))
