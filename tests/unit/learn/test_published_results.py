"""The paper's experiment on its published maps, from tables that no code of envgraph made."""

import csv

import pytest

from envgraph.learn import (
    FamilyMember,
    TrainingSettings,
    available_backends,
    controls,
    optimal_return,
    optimistic_values,
    other_starts,
    run_experiment,
    sequences,
)
from tests.unit.learn.forest_tables import DATA, family, published_family

NAMES = ["E1", "E2", "E3", "E4", "E5", "E6"]
PUBLISHED = [FamilyMember(name, table) for name, table in zip(NAMES, published_family(), strict=True)]
# Compiled, 20 seeds take a third of a second; on lists two seeds take about a second.
SEEDS = range(20) if "numba" in available_backends() else range(2)
BACKEND = available_backends()[0]


def test_the_best_return_on_the_target_is_10_2() -> None:
    assert optimal_return(PUBLISHED[-1].tabular) == pytest.approx(10.2, abs=1e-12)


def test_the_full_curriculum_always_succeeds_and_direct_training_never() -> None:
    curricula = (*sequences(NAMES, "full"), *sequences(NAMES, "direct"))
    found = run_experiment(PUBLISHED, TrainingSettings(), curricula, seeds=SEEDS, backend=BACKEND)
    taught, direct = found.runs[: len(SEEDS)], found.runs[len(SEEDS) :]
    assert [(run.label, run.steps, run.success_rate) for run in taught] == [("E1-E6", 300_000, 1.0)] * len(SEEDS)
    assert [run.mean_return for run in taught] == pytest.approx([10.2] * len(SEEDS))
    assert [(run.label, run.steps, run.success_rate) for run in direct] == [("E6", 300_000, 0.0)] * len(SEEDS)


def test_the_baselines_give_the_published_table() -> None:
    with (DATA / "evaluation_results.csv").open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["agent_type"] == "baseline"]
    found = run_experiment(
        PUBLISHED, TrainingSettings(), sequences(NAMES, "baselines"), seeds=SEEDS[:2], backend=BACKEND
    )
    for row, summary in zip(rows, found.summaries(), strict=True):
        assert row["label"] == f"Baseline ({summary.label})"
        assert (summary.mean_return, summary.success_rate) == pytest.approx(
            (float(row["mean_reward"]), float(row["success_rate"]))
        )


def test_direct_training_with_optimistic_values_solves_the_target() -> None:
    settings = TrainingSettings(steps_per_environment=5_000, initial_value=1.0)
    found = run_experiment(PUBLISHED, settings, sequences(NAMES, "direct"), seeds=range(5))
    assert found.summaries()[0].success_rate == 1.0


def test_optimistic_values_with_low_epsilon_solve_the_target_in_6000_steps() -> None:
    """Of 200 seeds at 6,000 steps .995 succeed, and .010 where exploration decays as in the settings."""
    settings = TrainingSettings(steps_per_environment=1_000)
    values = optimistic_values(PUBLISHED[-1].tabular, settings)
    chosen = controls(NAMES, ["optimistic"], optimism=values)
    assert len(chosen) == 6
    found = run_experiment(PUBLISHED, settings, chosen, seeds=range(5))
    rates = {one.label: one.success_rate for one in found.summaries()}
    assert (rates["optimistic 4.394, epsilon 0.05"], rates["optimistic 4.394"]) == (1.0, 0.0)
    assert {run.label for run in found.best_optimistic().runs} == {"optimistic 4.394, epsilon 0.05"}


def test_backplay_solves_the_target_in_6000_steps() -> None:
    settings = TrainingSettings(steps_per_environment=1_000)
    begun = other_starts("E6", PUBLISHED[-1].tabular, settings.limit)
    chosen = controls(NAMES, ["backplay"], starts=[*begun])
    found = run_experiment(PUBLISHED, settings, chosen, seeds=range(5), starts=begun)
    assert {one.label: one.success_rate for one in found.summaries()} == {
        "backplay": 1.0,
        "backplay, 6 stages": 1.0,
    }
    assert {run.steps for run in found.runs} == {6_000}


@pytest.mark.skipif(BACKEND != "numba", reason="a minute on lists")
def test_the_published_order_is_worse_than_its_reverse() -> None:
    """Of 1,000 seeds at 10,000 steps .50 succeed, reversed .82."""
    curricula = (*sequences(NAMES, "full"), *controls(NAMES, ["reversed"]))
    settings = TrainingSettings(steps_per_environment=10_000)
    given, backwards = run_experiment(PUBLISHED, settings, curricula, seeds=range(300), backend=BACKEND).summaries()
    assert given.success_rate == pytest.approx(0.50, abs=0.1)
    assert backwards.success_rate == pytest.approx(0.82, abs=0.1)


def test_tables_of_all_published_random_maps_are_valid() -> None:
    files = sorted((DATA / "random-families").glob("*.json"))
    assert len(files) == 30
    for path in files:
        for table in family(f"random-families/{path.name}"):
            table.check()
