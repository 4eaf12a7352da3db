"""Choice of parents and survivors."""

from __future__ import annotations

from collections.abc import Sequence
from math import log2
from typing import cast

import pytest
from hypothesis import given, strategies as st
from numpy.random import default_rng

from envgraph.errors import InvalidArgument, LoadError
from envgraph.search import (
    BeamSearch,
    BinnedEntropy,
    Candidate,
    Domain,
    ElitistParents,
    ExactSelection,
    HillClimbing,
    Pool,
    RandomParents,
    SimulatedAnnealing,
    Statistic,
    StatisticMeasure,
    SurvivorSelection,
    TournamentParents,
    Variance,
    acceptance_probability,
)


class Valued:
    """A candidate of which only a number is known."""

    def __init__(self, value: float) -> None:
        self.measures = {"value": value}


def pool(values: Sequence[float], statistic: Statistic) -> Pool:
    candidates = cast("list[Candidate]", [Valued(value) for value in values])
    return Pool(candidates, [StatisticMeasure(statistic, "value")], "value")


SELECTIONS = [SimulatedAnnealing(), HillClimbing(), BeamSearch(), ExactSelection()]


@pytest.mark.parametrize("selection", SELECTIONS, ids=lambda selection: type(selection).__name__)
def test_survivors_reach_the_maximum_entropy_where_each_bin_has_a_candidate(
    selection: SurvivorSelection,
) -> None:
    values = [0.95, 0.9, 0.91, 0.92, 0.93, 0.94, 0.05, 0.2, 0.4, 0.6, 0.7, 0.06]
    chosen = selection.select(pool(values, BinnedEntropy(6)), 6, [0], list(range(6)), default_rng(1))
    assert BinnedEntropy(6).score([values[index] for index in chosen]) == pytest.approx(log2(6))
    assert 0 in chosen


@pytest.mark.parametrize("selection", SELECTIONS, ids=lambda selection: type(selection).__name__)
@given(values=st.lists(st.floats(0, 1), min_size=4, max_size=9), seed=st.integers(0, 2**32))
def test_survivors_are_distinct_contain_pinned_candidates_and_score_no_worse(
    selection: SurvivorSelection, values: list[float], seed: int
) -> None:
    measure = BinnedEntropy(3)
    chosen = selection.select(pool(values, measure), 3, [1], [0, 1, 2], default_rng(seed))
    assert chosen == sorted(set(chosen)) and len(chosen) == 3 and 1 in chosen
    assert measure.score([values[i] for i in chosen]) >= measure.score(values[:3]) - 1e-9


@given(values=st.lists(st.floats(0, 1), min_size=5, max_size=9), seed=st.integers(0, 2**32))
def test_annealing_reaches_the_score_of_exact_selection(values: list[float], seed: int) -> None:
    measure = BinnedEntropy(4)
    best = ExactSelection().select(pool(values, measure), 4, [0], [0, 1, 2, 3], default_rng(0))
    found = SimulatedAnnealing(rounds=2000).select(pool(values, measure), 4, [0], [0, 1, 2, 3], default_rng(seed))
    assert measure.score([values[i] for i in found]) == pytest.approx(measure.score([values[i] for i in best]))


def test_annealing_is_a_function_of_its_generator() -> None:
    values = default_rng(5).random(40).tolist()
    runs = [
        SimulatedAnnealing().select(pool(values, BinnedEntropy(10)), 10, [0], list(range(10)), default_rng(seed))
        for seed in (7, 7, 8)
    ]
    assert runs[0] == runs[1]


@pytest.mark.parametrize("selection", SELECTIONS, ids=lambda selection: type(selection).__name__)
def test_survivors_vary_with_the_seed_among_families_of_equal_score(selection: SurvivorSelection) -> None:
    found = {
        tuple(selection.select(pool([0.9] * 6, BinnedEntropy(3)), 3, [0], [0, 1, 2], default_rng(seed)))
        for seed in range(20)
    }
    assert len(found) > 5


@pytest.mark.parametrize("selection", SELECTIONS, ids=lambda selection: type(selection).__name__)
def test_family_of_the_largest_variance_survives_among_equal_scores(selection: SurvivorSelection) -> None:
    values = [1.0, 0.95, 0.96, 0.97, 0.94, 0.99]
    for seed in range(20):
        chosen = selection.select(pool(values, BinnedEntropy(3)), 3, [0], [0, 1, 2], default_rng(seed))
        assert chosen in ([0, 1, 4], [0, 4, 5])  # as far down as it goes, or both ends
        assert Variance().score([values[i] for i in chosen]) > Variance().score(values[:3])


@pytest.mark.parametrize("selection", SELECTIONS, ids=lambda selection: type(selection).__name__)
def test_best_family_survives_unchanged(selection: SurvivorSelection) -> None:
    values = [0.1, 0.35, 0.9, 0.2, 0.4, 0.8]
    assert selection.select(pool(values, BinnedEntropy(3)), 3, [0], [0, 1, 2], default_rng(3)) == [0, 1, 2]


def test_annealing_survives_a_temperature_that_underflows() -> None:
    cold = SimulatedAnnealing(rounds=5000, initial_temperature=0.1, cooling_rate=0.5)
    assert len(cold.select(pool([0.1, 0.2, 0.9, 0.8], BinnedEntropy(2)), 2, [], [0, 1], default_rng(1))) == 2


def test_acceptance_follows_the_metropolis_rule() -> None:
    assert acceptance_probability(0.0, 0.1) == 1.0
    assert acceptance_probability(0.2, 0.1) == pytest.approx(0.1353352832366127)
    assert (acceptance_probability(0.1, 0.0), acceptance_probability(0.0, 0.0)) == (0.0, 1.0)


class Downhill:
    """A measure by which every exchange loses 0.1; it counts those that are made."""

    made = 0

    def score(self, values: Sequence[float]) -> float:
        return 0.0

    def swaps(self, values: Sequence[float], members: Sequence[int]) -> Downhill:
        return self

    def delta(self, leaving: int, entering: int) -> float:
        return -0.1

    def swap(self, leaving: int, entering: int) -> None:
        self.made += 1


@pytest.mark.parametrize("temperature", [0.05, 0.1, 1.0])
def test_annealing_accepts_worse_families_by_the_metropolis_rule(temperature: float) -> None:
    measure = Downhill()
    constant = SimulatedAnnealing(rounds=10_000, initial_temperature=temperature, cooling_rate=1.0)
    constant.select(pool([0.1, 0.2], measure), 1, [], [0], default_rng(8))
    assert measure.made / 10_000 == pytest.approx(acceptance_probability(0.1, temperature), abs=0.02)


@pytest.mark.parametrize("arguments", [{"rounds": -1}, {"initial_temperature": 0.0}, {"cooling_rate": 1.5}])
def test_impossible_annealing_is_refused(arguments: dict[str, float]) -> None:
    with pytest.raises(InvalidArgument):
        SimulatedAnnealing(**arguments)  # type: ignore[arg-type]


def test_exhaustive_selection_refuses_too_many_families() -> None:
    with pytest.raises(InvalidArgument, match="Annealing"):
        ExactSelection(limit=10).select(pool([0.1] * 20, Variance()), 5, [], list(range(5)), default_rng(0))


def test_random_parents_are_uniform() -> None:
    drawn = RandomParents().select([0.0, 9.0, 1.0], 3000, default_rng(0))
    assert all(900 < drawn.count(index) < 1100 for index in range(3))


def test_tournament_prefers_the_fitter_and_elitism_takes_only_the_best() -> None:
    drawn = TournamentParents(rounds=2).select([0.0, 1.0], 1000, default_rng(0))
    assert 700 < drawn.count(1) < 800
    assert ElitistParents(share=0.5).select([3.0, 1.0, 2.0, 0.0], 3, default_rng(0)) == [0, 2, 0]


@given(
    values=st.lists(st.floats(0, 1), min_size=4, max_size=10),
    size=st.integers(1, 4),
    pinned=st.sampled_from([[], [0], [1, 3]]),
    bins=st.integers(1, 6),
)
def test_filling_bins_reaches_the_entropy_of_trying_all_families(
    values: list[float], size: int, pinned: list[int], bins: int
) -> None:
    measure, size = BinnedEntropy(bins), max(size, len(pinned))
    found, best = (
        selection.select(pool(values, measure), size, pinned, [], default_rng(3))
        for selection in (ExactSelection(limit=0), ExactSelection())
    )
    assert found == sorted(set(found)) and len(found) == size and set(pinned) <= set(found)
    assert measure.score([values[one] for one in found]) == pytest.approx(
        measure.score([values[one] for one in best]), abs=1e-12
    )


def test_filling_bins_of_a_large_pool_is_never_worse_than_annealing() -> None:
    for seed in range(20):
        rng = default_rng(seed)
        values, measure = (rng.random(60) ** 3).tolist(), BinnedEntropy(20)
        chosen = [
            selection.select(pool(values, measure), 20, [0], list(range(20)), default_rng(seed))
            for selection in (ExactSelection(), SimulatedAnnealing(rounds=3000))
        ]
        exact, annealed = (measure.score([values[one] for one in each]) for each in chosen)
        assert exact >= annealed - 1e-9


def test_too_many_families_to_try_are_reported_before_the_run() -> None:
    given = ["search.survivors=exact", "search.population=20"]
    Domain.load("burning_forest/paper.toml", overrides=given)
    with pytest.raises(LoadError, match="up to 68,923,264,410 families must be tried"):
        Domain.load("burning_forest/paper.toml", overrides=[*given, "diversity.kind=variance"])
