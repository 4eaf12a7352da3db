"""Experiments: curricula times seeds."""

from dataclasses import replace

import numpy as np
import pytest
from joblib import parallel_config

from envgraph.env import Tabular
from envgraph.errors import LIMITS, InvalidArgument
from envgraph.learn import (
    Curriculum,
    Experiment,
    FamilyMember,
    RunResult,
    Training,
    TrainingSettings,
    available_backends,
    evaluate,
    run_experiment,
    run_stages,
    sequences,
    train_curriculum,
    train_run,
)
from envgraph.solve.learning import Backend
from tests.unit.learn.small_tables import random_table

FAMILY = [FamilyMember(f"E{number}", random_table(number), number / 3) for number in (1, 2, 3)]
NAMES = [member.name for member in FAMILY]
SETTINGS = TrainingSettings(steps_per_environment=400, evaluation_episodes=20, limit=25, checkpoint=100, seeds=3)


def small(backend: Backend = "python", workers: int = 1) -> Experiment:
    return run_experiment(FAMILY, SETTINGS, workers=workers, backend=backend)


def test_runs_are_the_papers_curricula_and_baselines_for_each_seed() -> None:
    found = [(run.kind, run.label, run.seed, run.steps) for run in small().runs]
    curricula = [("curriculum", "E1-E3", 1_200), ("curriculum", "E2-E3", 800)]
    baselines = [("baseline", name, 1_200) for name in NAMES]
    expected = [(kind, label, seed, steps) for kind, label, steps in curricula + baselines for seed in range(3)]
    assert found == expected


@pytest.mark.parametrize("backend", available_backends())
def test_results_do_not_depend_on_workers_or_loop(backend: Backend) -> None:
    """The loop on lists runs in processes, the compiled one in threads."""
    assert small(backend, workers=2) == small()


def test_only_occurring_observations_have_values_if_there_are_too_many(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Results are those of a table of values with a row for each."""
    monkeypatch.setitem(LIMITS, "action values", 10_000)
    assert max(member.tabular.observation.max() for member in FAMILY) == 6  # type: ignore[union-attr]
    wide = [replace(member, tabular=scattered(member.tabular)) for member in FAMILY]  # type: ignore[arg-type]
    drawn = Curriculum("control", "drawn", (tuple(NAMES), "E3"), (2, 1))
    for curriculum in (*sequences(NAMES), drawn):
        assert run_experiment(wide, SETTINGS, [curriculum]) == run_experiment(FAMILY, SETTINGS, [curriculum])
    one = sequences(NAMES, "full")[0]
    found, training = train_run(wide, one, SETTINGS, 1)
    expected, whole = train_run(FAMILY, one, SETTINGS, 1)
    assert isinstance(training, Training) and isinstance(whole, Training)
    assert found == expected and np.array_equal(training.q, whole.q)
    other = replace(wide[0], tabular=replace(wide[0].tabular, n_observations=8, observation_shape=(8,)))  # type: ignore[type-var]
    with pytest.raises(InvalidArgument, match="the same observations"):
        run_experiment([other, *wide[1:]], SETTINGS)


def scattered(table: Tabular) -> Tabular:
    """The same environment, with its observations among a hundred thousand."""
    return replace(
        table,
        observation=table.observation * 16_000 + 3,
        n_observations=10**5,
        observation_shape=(10, 10**4),
        observation_names=("at", "seen"),
    )


def test_a_run_does_not_depend_on_other_runs() -> None:
    alone = run_experiment(FAMILY, SETTINGS, sequences(NAMES)[1:], seeds=[2])
    assert alone.runs == tuple(run for run in small().runs if (run.label, run.seed) == ("E2-E3", 2))


def test_runs_of_different_seeds_and_curricula_differ() -> None:
    rewards = [run.curve.reward for run in small().runs]
    assert len(set(rewards)) == len(rewards)


def test_evaluation_does_not_disturb_training() -> None:
    thorough = TrainingSettings(**{name: getattr(SETTINGS, name) for name in ("steps_per_environment", "limit")})
    curves = [run_experiment(FAMILY, settings, seeds=[0]).runs[0].curve.reward[-1] for settings in (SETTINGS, thorough)]
    assert curves[0] == curves[1]


def test_a_single_run_equals_the_run_of_the_experiment() -> None:
    result, training = train_run(FAMILY, sequences(NAMES, "baselines")[0], SETTINGS, 1)
    assert result in small().runs
    assert training.q.shape == (7, 3) and training.curve == result.curve


def test_agents_are_evaluated_on_the_target() -> None:
    family = [FamilyMember(f"E{seed}", random_table(seed, outcomes=1)) for seed in (1, 2, 3)]
    for curriculum in sequences(NAMES, "baselines"):
        result, training = train_run(family, curriculum, SETTINGS, 0)
        target, first = (evaluate(training.q, family[at].tabular, 1, 25, np.random.default_rng(0)) for at in (-1, 0))
        assert (result.success_rate, result.mean_return) == (target.success_rate, target.mean_return)
        assert result.mean_return != first.mean_return


def test_sequences_of_different_environments_use_different_random_numbers() -> None:
    twins = [FamilyMember(name, random_table(1)) for name in NAMES]
    rewards = {run.curve.reward[-1] for run in run_experiment(twins, SETTINGS, sequences(NAMES, "baselines")).runs}
    assert len(rewards) == 9


def test_progress_is_reported_after_each_run() -> None:
    told: list[tuple[int, int]] = []
    run_experiment(FAMILY, SETTINGS, sequences(NAMES), progress=lambda *numbers: told.append(numbers))
    assert told == [(number, 6) for number in range(1, 7)]


def test_known_results_are_not_trained_again() -> None:
    whole, told, ended = small().runs, list[tuple[int, int]](), list[RunResult]()
    other = replace(whole[0], label="E7")
    again = run_experiment(
        FAMILY,
        SETTINGS,
        known=[other, *whole[3:], whole[1]],
        found=ended.append,
        progress=lambda *numbers: told.append(numbers),
    )
    assert again.runs == whole and ended == [whole[0], whole[2]]
    assert told == [(14, 15), (15, 15)]


def test_results_of_stages_are_reported_with_their_target() -> None:
    ended: list[tuple[str, RunResult]] = []
    whole = run_stages(FAMILY, SETTINGS, found=lambda target, result: ended.append((target, result)))
    assert [target for target, _ in ended] == ["E1"] * 3 + ["E2"] * 3 + ["E3"] * 3
    known = {"E1": whole.runs[:3], "E3": whole.runs[6:8]}
    rest: list[RunResult] = []
    again = run_stages(
        FAMILY,
        SETTINGS,
        known=lambda target: known.get(target, ()),
        found=lambda _, result: rest.append(result),
    )
    assert again == whole and rest == [*whole.runs[3:6], whole.runs[8]]


def test_results_are_reported_with_a_backend_that_returns_whole_lists() -> None:
    """As Ray's does."""
    ended: list[RunResult] = []
    with parallel_config("multiprocessing"):
        found = run_experiment(FAMILY, SETTINGS, workers=2, backend="python", found=ended.append)
    assert found == small() and ended == list(found.runs)


def test_a_custom_curriculum_can_repeat_an_environment() -> None:
    mine = Curriculum("curriculum", "there and back", ("E1", "E3", "E1", "E3"), (1, 2, 1, 1))
    (run,) = run_experiment(FAMILY, SETTINGS, [mine], seeds=[0]).runs
    assert (run.label, run.steps) == ("there and back", 2_000)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"family": []}, "different names"),
        ({"family": [FAMILY[0], FAMILY[0]]}, "different names"),
        ({"curricula": []}, "different labels"),
        ({"curricula": sequences(NAMES) * 2}, "different labels"),
        ({"curricula": sequences(["E1", "E22"])}, "no environment is called `E22`; did you mean `E2`"),
        ({"seeds": []}, "seeds"),
        ({"seeds": [1, 1]}, "seeds"),
        ({"seeds": [-1]}, "seeds"),
        ({"workers": 0}, "`workers`"),
        (
            {"family": [*FAMILY[:2], FamilyMember("E3", random_table(1, starts=1), None)], "backend": "x"},
            "backend",
        ),
    ],
)
def test_invalid_arguments_are_refused(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidArgument, match=message):
        run_experiment(**({"family": FAMILY, "settings": SETTINGS} | arguments))  # type: ignore[arg-type]


def test_a_complexity_that_is_not_a_number_is_refused() -> None:
    with pytest.raises(InvalidArgument, match="complexity of `E1`"):
        FamilyMember("E1", random_table(1), float("nan"))


@pytest.mark.parametrize("backend", available_backends())
def test_success_before_equals_the_success_of_training_without_the_last_stage(backend: Backend) -> None:
    """In environments without chance, whose evaluation draws nothing."""
    family = [FamilyMember(f"E{seed}", random_table(seed, outcomes=1)) for seed in (1, 2, 3)]
    (whole,) = sequences(NAMES, "full")
    found, _ = train_run(family, whole, SETTINGS, 0, backend=backend)
    tables = [one.tabular for one in family]
    rng = np.random.default_rng(np.random.SeedSequence(0, spawn_key=(0, 0, 1, 2)))
    q = train_curriculum(tables[:2], SETTINGS, rng).q  # type: ignore[arg-type]
    before = evaluate(q, family[-1].tabular, 1, SETTINGS.limit, rng)  # type: ignore[arg-type]
    assert found.success_before == before.success_rate and found.steps_before == 800


def test_steps_before_are_all_steps_if_the_last_stage_is_not_the_target() -> None:
    mixed = Curriculum("control", "mixed", (("E1", "E3"),), (3,))
    chosen = [*sequences(NAMES, "baselines"), mixed]
    found = {run.label: run.steps_before for run in run_experiment(FAMILY, SETTINGS, chosen, seeds=[0]).runs}
    assert found == {"E1": 1_200, "E2": 1_200, "E3": 0, "mixed": 1_200}
