"""The loop on lists and the compiled loop are one trainer."""

import sys
from dataclasses import replace
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest

from envgraph.env import Tabular
from envgraph.errors import InvalidArgument
from envgraph.learn import (
    Epsilon,
    Training,
    TrainingSettings,
    available_backends,
    train_curriculum,
)
from envgraph.solve.learning import Backend, choose_backend
from tests.profile import AT_NIGHT, NIGHTLY
from tests.unit.learn.forest_tables import published_family
from tests.unit.learn.small_tables import random_table

needs_numba = pytest.mark.skipif(find_spec("numba") is None, reason="numba, the extra `fast`, is not installed")
SETTINGS = TrainingSettings(steps_per_environment=3_000 if NIGHTLY else 1_000, checkpoint=300, limit=30)


def trained(tables: list[Tabular], settings: TrainingSettings, backend: Backend, seed: int = 5) -> Training:
    return train_curriculum(tables, settings, np.random.default_rng(seed), backend=backend)


def assert_identical(one: Training, other: Training) -> None:
    assert one.q.tobytes() == other.q.tobytes()
    assert (one.curve, one.epsilon) == (other.curve, other.epsilon)


@needs_numba
def test_loops_agree_on_the_published_family() -> None:
    settings = TrainingSettings(steps_per_environment=20_000)
    family = published_family()
    assert_identical(trained(family, settings, "python"), trained(family, settings, "numba"))


@needs_numba
@pytest.mark.parametrize(("outcomes", "starts"), [(1, 1), (3, 1), (1, 4), (4, 3)])
@pytest.mark.parametrize(
    "epsilon",
    [Epsilon(), Epsilon(decay=0.999, per="step", reset="never"), Epsilon(start=0.0, minimum=0.0)],
    ids=["episode", "step", "greedy"],
)
@pytest.mark.parametrize(
    ("agent", "n_step", "ties"),
    [
        ("q_learning", 1, "lowest"),
        pytest.param("q_learning", 1, "random", marks=AT_NIGHT),
        pytest.param("sarsa", 1, "lowest", marks=AT_NIGHT),
        ("sarsa", 3, "random"),
        pytest.param("expected_sarsa", 4, "lowest", marks=AT_NIGHT),
        ("double_q_learning", 1, "lowest"),
    ],
)
def test_loops_agree_on_random_tables(
    agent: Any, n_step: int, ties: Any, outcomes: int, starts: int, epsilon: Epsilon
) -> None:
    for seed in range(5 if agent == "q_learning" else 2):
        tables = [random_table(seed * 2 + stage, outcomes, starts) for stage in range(2)]
        settings = replace(
            SETTINGS,
            agent=agent,
            n_step=n_step,
            ties=ties,
            epsilon=epsilon,
            learning_rate=0.3,
            initial_value=0.5,
        )
        assert_identical(trained(tables, settings, "python"), trained(tables, settings, "numba"))


@needs_numba
def test_loops_agree_on_tables_with_many_tied_values() -> None:
    """Rewards of 0 and 1 with learning rate 1: Q-values meet again and again, and the lowest action counts."""
    for seed in range(10):
        table = random_table(seed)
        table = replace(table, reward=(table.reward > 0.0).astype(float))
        settings = replace(SETTINGS, learning_rate=1.0, discount=1.0, limit=5)
        assert_identical(trained([table], settings, "python"), trained([table], settings, "numba"))


@pytest.mark.parametrize("backend", available_backends())
def test_both_loops_leave_the_random_generator_in_the_same_state(backend: Backend) -> None:
    rng, expected = np.random.default_rng(3), np.random.default_rng(3)
    train_curriculum([random_table(1), random_table(2)], SETTINGS, rng, backend=backend)
    expected.random(2 * (1 + 3 * SETTINGS.steps_per_environment))
    assert rng.random() == expected.random()


@pytest.mark.parametrize(
    "settings, pays",
    [
        ({}, 4_000_000),
        ({"agent": "sarsa"}, 500_000),
        ({"ties": "random"}, 500_000),
    ],
)
def test_short_training_runs_on_lists(settings: dict[str, Any], pays: int) -> None:
    assert choose_backend("auto", pays - 1, TrainingSettings(**settings)) == "python"
    assert choose_backend("auto", pays, TrainingSettings(**settings)) == available_backends()[0]


@pytest.mark.parametrize("how", ["not installed", "switched off"])
def test_training_uses_the_python_backend_without_numba(how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if how == "not installed":
        monkeypatch.setitem(sys.modules, "numba", None)
    else:
        monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    assert available_backends() == ("python",)
    assert choose_backend("auto", 10**9, SETTINGS) == "python"
    with pytest.raises(InvalidArgument, match="envgraph\\[fast\\]"):
        choose_backend("numba", 1, SETTINGS)


def test_an_unknown_backend_is_refused() -> None:
    with pytest.raises(InvalidArgument, match="unknown backend 'jax'"):
        choose_backend("jax", 1, SETTINGS)  # type: ignore[arg-type]
