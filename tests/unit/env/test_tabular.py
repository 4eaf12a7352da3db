"""What a well-formed table is."""

from dataclasses import replace

import numpy as np
import pytest

from envgraph.env import Tabular
from envgraph.errors import InvalidArgument


def coin() -> Tabular:
    """One action that ends the episode in success or failure, each half of the time."""
    return Tabular(
        next_state=np.array([[[1, 2]], [[1, 1]], [[2, 2]]], np.int32),
        probability=np.array([[[0.5, 0.5]], [[1.0, 0.0]], [[1.0, 0.0]]]),
        reward=np.array([[[1.0, -1.0]], [[0.0, 0.0]], [[0.0, 0.0]]]),
        terminated=np.array([[[1, 2]], [[0, 0]], [[0, 0]]], np.int8),
        observation=np.array([0, 1, 2], np.int32),
        start_states=np.array([0], np.int32),
        start_probability=np.array([1.0]),
        n_observations=3,
        observation_shape=(3,),
        action_names=("flip",),
    )


def test_sizes_come_from_the_arrays() -> None:
    table = coin()
    table.check()
    assert (table.n_states, table.n_actions, table.deterministic) == (3, 1, False)


def test_a_table_with_one_outcome_an_action_is_deterministic() -> None:
    table = coin()
    first = {name: getattr(table, name)[..., :1] for name in ("next_state", "reward", "terminated")}
    single = replace(table, probability=np.ones((3, 1, 1)), **first)
    single.check()
    assert single.deterministic


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"next_state": np.array([[[1, 3]], [[1, 1]], [[2, 2]]], np.int32)}, "`next_state` contains a state"),
        ({"next_state": np.zeros((3, 1), np.int32)}, "three axes"),
        ({"next_state": np.zeros((0, 1, 1), np.int32)}, "at least one state"),
        ({"probability": np.full((3, 1, 2), 0.4)}, "`probability` does not sum to 1"),
        ({"probability": np.full((3, 1, 2), [1.5, -0.5])}, "`probability` has negative values"),
        ({"probability": np.full((3, 1, 2), np.nan)}, "`probability`"),
        ({"reward": np.zeros((3, 2, 1))}, "`reward` has shape"),
        ({"reward": np.full((3, 1, 2), np.inf)}, "`reward` has values"),
        ({"terminated": np.full((3, 1, 2), 3, np.int8)}, "`terminated`"),
        ({"observation": np.array([0, 1, 3], np.int32)}, "`observation` has a value outside"),
        ({"observation": np.array([0, 1], np.int32)}, "one value for each state"),
        ({"start_states": np.array([3], np.int32)}, "`start_states` contains a state"),
        ({"start_states": np.array([], np.int32), "start_probability": np.array([])}, "at least one state"),
        ({"start_states": np.array([0, 0], np.int32), "start_probability": np.array([0.5, 0.5])}, "twice"),
        ({"start_probability": np.array([0.5])}, "`start_probability` does not sum"),
        ({"start_probability": np.array([0.5, 0.5])}, "one value for each start state"),
        ({"observation_shape": (2, 2)}, "`observation_shape` gives 4 observations, `n_observations` is 3"),
        ({"action_names": ("flip", "spin")}, "one name for each action"),
    ],
)
def test_check_reports_invalid_arrays(change: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidArgument, match=message):
        replace(coin(), **change).check()  # type: ignore[arg-type]
