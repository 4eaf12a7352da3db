"""Training settings."""

from types import SimpleNamespace

import pytest

from envgraph.errors import InvalidArgument
from envgraph.learn import Epsilon, TrainingSettings


def test_the_defaults_are_the_published_settings() -> None:
    settings = TrainingSettings()
    assert (settings.learning_rate, settings.discount, settings.initial_value) == (0.1, 0.99, 0.0)
    assert settings.epsilon == Epsilon(start=1.0, decay=0.995, minimum=0.05, per="episode", reset="stage")
    assert (settings.steps_per_environment, settings.evaluation_episodes, settings.limit) == (
        50_000,
        3_000,
        200,
    )


@pytest.mark.parametrize(
    "values",
    [
        {"learning_rate": 0.0},
        {"learning_rate": 1.5},
        {"learning_rate": True},
        {"learning_rate": float("nan")},
        {"discount": -0.1},
        {"discount": "0.9"},
        {"steps_per_environment": 0},
        {"steps_per_environment": 1.5},
        {"evaluation_episodes": 0},
        {"seeds": 0},
        {"seeds": True},
        {"limit": 0},
        {"checkpoint": 0},
        {"initial_value": float("inf")},
    ],
)
def test_values_outside_their_range_are_refused_by_name(values: dict[str, float]) -> None:
    (name,) = values
    with pytest.raises(InvalidArgument, match=f"`{name}`"):
        TrainingSettings(**values)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"start": 1.1}, "`epsilon.start`"),
        ({"decay": -1.0}, "`epsilon.decay`"),
        ({"start": 0.5, "minimum": 0.6}, "`epsilon.minimum`"),
        ({"per": "episodes"}, "did you mean `episode`"),
        ({"reset": "always"}, "'stage' or 'never'"),
    ],
)
def test_exploration_outside_its_range_is_refused(values: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidArgument, match=message):
        Epsilon(**values)  # type: ignore[arg-type]


def test_a_family_file_gives_settings() -> None:
    spec = {
        "agent": "q_learning",
        "learning_rate": 0.2,
        "epsilon": {"start": 0.9, "decay": 0.99, "minimum": 0.1, "per": "step", "reset": "never"},
        "seeds": 5,
    }
    expected = TrainingSettings(learning_rate=0.2, epsilon=Epsilon(0.9, 0.99, 0.1, "step", "never"), seeds=5, limit=60)
    assert TrainingSettings.from_spec(spec, limit=60) == expected
    epsilon = SimpleNamespace(**spec["epsilon"])  # type: ignore[arg-type]
    assert TrainingSettings.from_spec(SimpleNamespace(**(spec | {"epsilon": epsilon})), limit=60) == expected


def test_missing_values_of_a_spec_keep_their_defaults() -> None:
    assert TrainingSettings.from_spec({}) == TrainingSettings()
    assert TrainingSettings.from_spec(SimpleNamespace(seeds=None), limit=None) == TrainingSettings()


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ({"learning_rat": 0.1}, "did you mean `learning_rate`"),
        ({"epsilon": {"floor": 0.1}}, "unknown training setting `floor`"),
        ({"agent": "qlearning"}, "did you mean `q_learning`"),
        ({"seeds": 0}, "`seeds`"),
    ],
)
def test_an_invalid_spec_is_refused(spec: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidArgument, match=message):
        TrainingSettings.from_spec(spec)
