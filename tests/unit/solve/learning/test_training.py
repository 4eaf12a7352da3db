"""What the trainer does, on tables small enough to follow by hand; with both loops."""

from dataclasses import replace

import numpy as np
import pytest

from envgraph.errors import InvalidArgument
from envgraph.learn import Epsilon, TrainingSettings, available_backends, train_curriculum
from envgraph.solve.learning import (
    Backend,
    Stage,
    flatten_tabular,
    initial_values,
    prepare,
    renumber_occurring,
    training_loop,
)
from tests.unit.learn.small_tables import random_table, table

HALVES = TrainingSettings(
    learning_rate=0.5, discount=0.5, epsilon=Epsilon(start=0.0, minimum=0.0), limit=2, checkpoint=1
)
RANDOM = replace(HALVES, epsilon=Epsilon(decay=1.0, minimum=1.0))
ABSORBING = [(1.0, 1, 0.0, 0)]


@pytest.fixture(params=available_backends())
def backend(request: pytest.FixtureRequest) -> Backend:
    found: Backend = request.param
    return found


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_an_update_moves_the_value_towards_reward_and_best_next_value(backend: Backend) -> None:
    loop = table([[[(1.0, 0, 1.0, 0)]]])
    values = [train_curriculum([loop], HALVES, rng(), steps=[n], backend=backend).q[0, 0] for n in (1, 2)]
    assert values == [0.5, 0.5 + 0.5 * (1.0 + 0.5 * 0.5 - 0.5)]


def test_a_truncated_step_bootstraps_and_a_terminated_one_does_not(backend: Backend) -> None:
    truncated = table([[[(1.0, 0, 1.0, 0)]]])
    terminated = table([[[(1.0, 0, 1.0, 1)]]])
    settings = replace(HALVES, limit=1, initial_value=4.0)
    assert train_curriculum([truncated], settings, rng(), steps=[1], backend=backend).q[0, 0] == 3.5
    assert train_curriculum([terminated], settings, rng(), steps=[1], backend=backend).q[0, 0] == 2.5


def test_the_lowest_of_equal_actions_is_chosen(backend: Backend) -> None:
    better_second = table([[[(1.0, 0, 0.0, 0)], [(1.0, 0, 1.0, 0)]]])
    found = train_curriculum([better_second], HALVES, rng(), steps=[50], backend=backend)
    assert found.q.tolist() == [[0.0, 0.0]]
    assert found.curve.reward[-1] == 0.0


def test_the_next_best_action_is_chosen_after_a_value_decreases(backend: Backend) -> None:
    """From (1, 1, 1) action 0 falls to 0.5, then action 1; action 2 pays and stays."""
    bandit = table([[[(1.0, 0, 0.0, 2)], [(1.0, 0, 0.0, 2)], [(1.0, 0, 1.0, 2)]]])
    found = train_curriculum([bandit], replace(HALVES, initial_value=1.0), rng(), steps=[10], backend=backend)
    assert found.q.tolist() == [[0.5, 0.5, 1.0]]
    assert found.curve.reward[-1] == 8.0


def test_an_episode_is_reset_at_the_step_limit(backend: Backend) -> None:
    chain = table([[[(1.0, 1, 1.0, 0)]], [[(1.0, 2, 10.0, 0)]], [[(1.0, 2, 100.0, 0)]]])
    found = train_curriculum([chain], HALVES, rng(), steps=[5], backend=backend)
    assert found.curve.steps == (1, 2, 3, 4, 5)
    assert found.curve.reward == (1.0, 11.0, 12.0, 22.0, 23.0)
    assert found.curve.episodes == (0, 1, 1, 2, 2)


def test_each_stage_begins_a_new_episode(backend: Backend) -> None:
    chain = table([[[(1.0, 1, 1.0, 0)]], [[(1.0, 1, 10.0, 0)]]])
    found = train_curriculum([chain, chain], HALVES, rng(), steps=[1, 2], backend=backend)
    assert found.curve.reward == (1.0, 2.0, 12.0)
    assert found.curve.episodes == (0, 0, 1)


def test_failure_is_not_counted_as_success(backend: Backend) -> None:
    for ended, successes in ((1, 3), (2, 0)):
        once = table([[[(1.0, 1, 0.0, ended)]], [ABSORBING]])
        curve = train_curriculum([once], HALVES, rng(), steps=[3], backend=backend).curve
        assert (curve.episodes[-1], curve.successes[-1]) == (3, successes)


def test_curve_has_points_at_each_checkpoint_and_stage_end(backend: Backend) -> None:
    loop = table([[[(1.0, 0, 1.0, 0)]]])
    settings = replace(HALVES, checkpoint=4)
    curve = train_curriculum([loop, loop], settings, rng(), steps=[10, 4], backend=backend).curve
    assert curve.steps == (4, 8, 10, 14)
    assert curve.reward == (4.0, 8.0, 10.0, 14.0)


@pytest.mark.parametrize(
    ("epsilon", "steps", "expected"),
    [
        (Epsilon(decay=0.5, minimum=0.1), [6], 0.125),
        (Epsilon(decay=0.5, minimum=0.1), [7], 0.125),
        (Epsilon(decay=0.5, minimum=0.1), [8], 0.1),
        (Epsilon(decay=0.5, minimum=0.1, per="step"), [3], 0.125),
        (Epsilon(decay=0.5, minimum=0.1, per="step"), [4], 0.1),
        (Epsilon(decay=0.5, minimum=0.1), [4, 2], 0.5),
        (Epsilon(decay=0.5, minimum=0.1, reset="never"), [4, 2], 0.125),
    ],
)
def test_epsilon_decays_per_finished_episode_or_step(
    backend: Backend, epsilon: Epsilon, steps: list[int], expected: float
) -> None:
    """Episodes are two steps long."""
    loop = table([[[(1.0, 0, 1.0, 0)]]])
    found = train_curriculum([loop] * len(steps), replace(HALVES, epsilon=epsilon), rng(), steps=steps, backend=backend)
    assert found.epsilon == expected


@pytest.mark.parametrize(("steps", "checkpoint"), [(200, 1), (40_000, 20_000)])
def test_a_step_draws_the_documented_random_numbers(backend: Backend, steps: int, checkpoint: int) -> None:
    """u picks the action, v the outcome and w the next start; 16,384 steps are drawn at once."""
    tabular, settings = random_table(4), replace(RANDOM, limit=3, checkpoint=checkpoint)
    curve = train_curriculum([tabular], settings, rng(9), steps=[steps], backend=backend).curve

    def pick(weights: np.ndarray, draw: float) -> int:
        return next(index for index in range(len(weights)) if draw < weights[: index + 1].sum())

    draws = rng(9)
    state = tabular.start_states[pick(tabular.start_probability, draws.random())]
    total, length, totals = 0.0, 0, []
    for _ in range(steps):
        u, v, w = draws.random(3)
        action = int(u * 3)
        index = (state, action, pick(tabular.probability[state, action], v))
        total += tabular.reward[index]
        length += 1
        state = tabular.next_state[index]
        if tabular.terminated[index] or length == 3:
            state, length = tabular.start_states[pick(tabular.start_probability, w)], 0
        totals.append(total)
    assert list(curve.reward) == totals[checkpoint - 1 :: checkpoint]


def test_rounding_never_selects_a_padded_outcome() -> None:
    """Ten times 0.1 is less than 1, but the tenth outcome takes the rest, not the eleventh."""
    tabular = replace(random_table(1, starts=11), start_probability=np.array([0.1] * 10 + [0.0]))
    assert np.searchsorted(flatten_tabular(tabular).start_cumulative, np.nextafter(1.0, 0.0), "right") == 9


def test_exploration_is_uniform_below_epsilon(backend: Backend) -> None:
    """Action 3 is greedy, the others are explored at 0.1 each, epsilon being 0.4; rewards are powers of 1,000."""
    bandit = table([[[(1.0, 0, 1e-9, 2)], [(1.0, 0, 1e-6, 2)], [(1.0, 0, 1e-3, 2)], [(1.0, 0, 1.0, 2)]]])
    settings = replace(HALVES, epsilon=Epsilon(start=0.4, decay=1.0), checkpoint=100_000)
    q = np.array([[0.0, 0.0, 0.0, 1.0]])
    curve = train_curriculum([bandit], settings, rng(), steps=[10_000], q=q, backend=backend).curve
    fourth, rest = divmod(curve.reward[-1], 1.0)
    third = rest // 1e-3
    assert fourth == pytest.approx(7_000, abs=250) and third == pytest.approx(1_000, abs=150)


def test_training_starts_from_given_values_and_does_not_change_them(backend: Backend) -> None:
    loop = table([[[(1.0, 0, 1.0, 0)]]])
    q = np.array([[8.0]])
    assert train_curriculum([loop], HALVES, rng(), steps=[1], q=q, backend=backend).q[0, 0] == 6.5
    assert q.tolist() == [[8.0]]


def test_states_with_the_same_observation_share_their_values(backend: Backend) -> None:
    chain = table([[[(1.0, 1, 1.0, 0)]], [[(1.0, 1, 1.0, 0)]]], observation=[0, 0])
    found = train_curriculum([chain], HALVES, rng(), steps=[2], backend=backend)
    assert found.q.tolist() == [[0.5 + 0.5 * (1.0 + 0.25 - 0.5)]]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"tabulars": []}, "needs at least one environment"),
        ({"steps": [1, 2]}, "positive length for each of 1"),
        ({"steps": [0]}, "positive length"),
        ({"q": np.zeros((2, 2))}, "`q` has the shape"),
        ({"q": np.array([[np.nan]])}, "finite"),
        (
            {"tabulars": [table([[[(1.0, 0, 0.0, 0)]]]), table([[[(1.0, 0, 0.0, 0)]] * 1] * 2)]},
            "same observations",
        ),
        ({"tabulars": [replace(table([[[(1.0, 0, 0.0, 0)]]]), action_names=())]}, "action_names"),
        (
            {"tabulars": [replace(table([[[(1.0, 0, 0.0, 0)]]]), n_observations=10**12)]},
            "1,000,000,000,000 observations and 1 actions is too large",
        ),
    ],
)
def test_invalid_arguments_are_refused(arguments: dict[str, object], message: str) -> None:
    call = {"tabulars": [table([[[(1.0, 0, 0.0, 0)]]])], "settings": HALVES, "rng": rng()} | arguments
    with pytest.raises(InvalidArgument, match=message):
        train_curriculum(**call)  # type: ignore[arg-type]


def test_padding_and_unvisited_states_are_not_prepared_for_the_loop() -> None:
    row = [[(0.5, 1, 0.0, 0), (0.5, 0, 0.0, 0)], [(1.0, 0, 0.0, 0)]]
    wide = table([row] * 500, observation=[state * 10 for state in range(500)])
    (ready,) = prepare([wide])
    assert len(ready.next_state) == 500 * 3 < wide.next_state.size
    settings = TrainingSettings(steps_per_environment=1_000)
    values = initial_values(ready, settings)
    training_loop("python", settings)(ready, Stage(1_000, 1.0, settings), values, np.random.default_rng(0))
    assert {place for place, read in enumerate(ready.cached_outcomes) if read} == {
        0,
        1,
        2,
        3,
    }  # of states 0 and 1


def test_occurring_observations_are_renumbered_if_there_are_too_many() -> None:
    small = random_table(1)
    rare = replace(
        small,
        observation=small.observation.astype(np.int64) * 10**8,
        n_observations=10**9,
        observation_shape=(10, 10**8),
        observation_names=("here", "there"),
    )
    [found] = renumber_occurring([rare])
    found.check()
    assert found.n_observations == len(set(small.observation.tolist()))
    learnt = [train_curriculum([one], RANDOM, rng(), steps=[200]).q for one in (small, found)]
    assert learnt[0][np.unique(small.observation)].tolist() == learnt[1].tolist()
