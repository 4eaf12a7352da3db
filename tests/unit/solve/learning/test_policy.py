"""The learner with a network, held against plain definitions in NumPy."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest

from envgraph.env import Tabular
from envgraph.errors import InvalidArgument
from envgraph.solve import evaluate_policy
from envgraph.solve.learning import LevelTables, PolicyLearner, PolicySettings
from tests.profile import AT_NIGHT

SETTINGS = PolicySettings(hidden=4, levels=4, minibatches=1, epochs=1, steps=12, limit=6, norm=1e9)
ACTIONS, INPUTS = 2, 5


def levels() -> LevelTables:
    """Two corridors, of three states and of four; the second has two start states, and slips now and then."""
    to = [[[0, 0], [1, 1]], [[0, 0], [2, 2]], [[2, 2], [2, 2]]]
    to += [[[3, 3], [4, 3]], [[3, 3], [5, 4]], [[4, 4], [6, 5]], [[6, 6], [6, 6]]]
    chance = [[[1, 0], [1, 0]]] * 3 + [[[1, 0], [0.7, 0.3]]] * 3 + [[[1, 0], [1, 0]]]
    reward = [[[0, 0], [0.1, 0]], [[-0.5, 0], [1, 0]], [[0, 0], [0, 0]]]
    reward += [[[0, 0], [0, 0]], [[0, 0], [0.2, 0]], [[0, 0], [1, -1]], [[0, 0], [0, 0]]]
    ended = [[[0, 0], [0, 0]], [[0, 0], [1, 0]], [[0, 0], [0, 0]]]
    ended += [[[0, 0], [0, 0]], [[2, 0], [0, 0]], [[0, 0], [1, 0]], [[0, 0], [0, 0]]]
    seen = [[0], [1, 4], [], [0, 2], [1], [3, 4], []]
    return LevelTables(
        first=np.array([0, 3, 7]),
        start_first=np.array([0, 1, 3]),
        starts=np.array([0, 3, 4]),
        start_chance=np.array([1.0, 0.25, 0.75]),
        to=np.array(to, np.int32).reshape(-1),
        chance=np.array(chance, np.float64).reshape(-1),
        reward=np.array(reward, np.float64).reshape(-1),
        ended=np.array(ended, np.int8).reshape(-1),
        seen_first=np.cumsum([0, *map(len, seen)]),
        seen=np.array([one for row in seen for one in row], np.int32),
        inputs=INPUTS,
        actions=ACTIONS,
        width=2,
    )


def small(shape: tuple[int, ...], names: tuple[str, ...] = ("stay", "go"), width: int = 1) -> Tabular:
    """Two states, seen as the last of all observations and the first; `go` wins in the first state."""
    zeros = np.zeros((2, 2, width))
    to, chance, reward, ended = zeros.astype(np.int32), zeros.copy(), zeros.copy(), zeros.astype(np.int8)
    to[:, :, 0], chance[:, :, 0] = [[0, 1], [1, 1]], 1.0
    reward[0, 1, 0], ended[0, 1, 0] = 3.0, 1
    size = int(np.prod(shape))
    return Tabular(
        next_state=to,
        probability=chance,
        reward=reward,
        terminated=ended,
        observation=np.array([size - 1, 0]),
        start_states=np.array([0], np.int32),
        start_probability=np.array([1.0]),
        n_observations=size,
        observation_shape=shape,
        action_names=names,
    )


def test_tables_are_converted_to_levels_with_one_hot_inputs() -> None:
    found = LevelTables.of([small((3, 2)), small((3, 2), width=2)], scale=0.5)
    assert (found.inputs, found.actions, found.width, len(found)) == (5, 2, 2, 2)
    assert found.first.tolist() == [0, 2, 4]
    assert found.starts.tolist() == [0, 2]
    assert found.seen.reshape(-1, 2).tolist() == [[2, 4], [0, 3], [2, 4], [0, 3]]
    assert found.to.reshape(4, 2, 2)[:, :, 0].tolist() == [[0, 1], [1, 1], [2, 3], [3, 3]]
    assert found.chance.reshape(4, 2, 2)[:, :, 1].sum() == 0
    assert found.reward.reshape(4, 2, 2)[2, 1, 0] == 1.5
    student = PolicyLearner(found, replace(SETTINGS, steps=20, entropy=0.0), 0, native=False)
    for _ in range(40):
        student.play(np.array([0, 1, 0, 1]))
        student.improve(np.random.default_rng(0))
    assert student.evaluate([0, 1], greedy=True)[0].tolist() == [1.0, 1.0]


def test_levels_with_different_actions_or_observations_are_refused() -> None:
    for others in ([small((3, 2)), small((2, 3))], [small((3,)), small((3,), ("go", "stay"))], []):
        with pytest.raises(InvalidArgument, match="with the same actions and observations"):
            LevelTables.of(others)
    one, other = small((3,)), small((4,))
    assert LevelTables.of([one, other], [[[0], [1]], [[], [6]]]).inputs == 7


def learner(seed: int = 3, settings: PolicySettings = SETTINGS, native: bool = False) -> PolicyLearner:
    found = PolicyLearner(levels(), settings, seed, native=native)
    found.parameters[:] += np.random.default_rng(seed).standard_normal(len(found.parameters)) * 0.5
    return found


def outputs(tables: LevelTables, parameters: np.ndarray, hidden: int) -> tuple[np.ndarray, np.ndarray]:
    """Probabilities and values of all states, by the definition of the network."""
    parts = np.split(parameters, np.cumsum([INPUTS * hidden, hidden, hidden * (ACTIONS + 1)]))
    first, second = parts[0].reshape(INPUTS, hidden), parts[2].reshape(hidden, ACTIONS + 1)
    inputs = np.zeros((len(tables.seen_first) - 1, INPUTS))
    for state in range(len(inputs)):
        inputs[state, tables.seen[tables.seen_first[state] : tables.seen_first[state + 1]]] = 1.0
    out = np.maximum(0.0, inputs @ first + parts[1]) @ second + parts[3]
    chances = np.exp(out[:, :-1])
    return chances / chances.sum(axis=1, keepdims=True), out[:, -1]


def tabular(tables: LevelTables, level: int) -> Tabular:
    begin, end = tables.first[level : level + 2]
    shape = (end - begin, ACTIONS, tables.width)
    rows = slice(begin * ACTIONS * tables.width, end * ACTIONS * tables.width)
    starts = slice(*tables.start_first[level : level + 2])
    return Tabular(
        next_state=tables.to[rows].reshape(shape) - begin,
        probability=tables.chance[rows].reshape(shape),
        reward=tables.reward[rows].reshape(shape),
        terminated=tables.ended[rows].reshape(shape),
        observation=np.arange(end - begin),
        start_states=(tables.starts[starts] - begin).astype(np.int32),
        start_probability=tables.start_chance[starts],
        n_observations=int(end - begin),
        observation_shape=(int(end - begin),),
        action_names=("left", "right"),
    )


def test_evaluated_success_and_return_agree_with_policy_evaluation() -> None:
    one, tables = learner(), levels()
    policy, _ = outputs(tables, one.parameters, SETTINGS.hidden)
    for greedy in (False, True):
        success, value = one.evaluate([1, 0], greedy=greedy)
        for place, level in enumerate((1, 0)):
            own = policy[tables.first[level] : tables.first[level + 1]]
            own = own.argmax(axis=1) if greedy else own
            found = evaluate_policy(tabular(tables, level), own, SETTINGS.limit, discount=SETTINGS.discount)
            assert success[place] == pytest.approx(found.success_rate, abs=1e-12)
            assert value[place] == pytest.approx(found.mean_return, abs=1e-12)


def test_sampled_success_agrees_with_the_exact_probability() -> None:
    one = learner()
    exact, _ = one.evaluate([0, 1])
    played = one.play(np.array([0, 1]), episodes=2000)
    spread = np.sqrt(exact * (1.0 - exact) / 2000)
    assert (np.abs(played.success - exact) < 4.0 * spread).all()


def test_scores_are_those_of_their_definitions() -> None:
    one, tables = learner(), levels()
    _, values = outputs(tables, one.parameters, SETTINGS.hidden)
    played = one.play(np.array([0, 1, 1, 0]))
    visited, most = one._student[2], SETTINGS.steps
    at, after, _, gain, how, steps = one._tracks
    best = [-inf, -inf]
    for b, level in enumerate([0, 1, 1, 0]):
        episodes, episode = [], []
        for place in range(b * most, b * most + steps[b]):
            follows = 0.0 if how[place] == 1 else values[visited[after[place]]]
            episode.append((values[visited[at[place]]], gain[place], follows))
            if how[place] or place == b * most + steps[b] - 1:
                episodes.append((episode, bool(how[place]), how[place] == 1 and after[place] == -1))
                episode = []
        advantages, lost = [], []
        for steps_of, whole, _ in episodes:
            advantages += naive_gae(steps_of)
            lost += naive_minimum(steps_of)
            if whole:
                total = sum(SETTINGS.discount**t * reward for t, (_, reward, _) in enumerate(steps_of))
                best[level] = max(best[level], total)
        assert played.positive[b] == pytest.approx(np.maximum(0.0, advantages).mean())
        assert played.absolute[b] == pytest.approx(np.abs(advantages).mean())
        solved = [success for _, whole, success in episodes if whole]
        assert played.success[b] == np.mean(solved)
        assert played.negative[b] == pytest.approx(-np.mean(lost) if any(solved) else 0.0)
        state_values = [value for steps_of, *_ in episodes for value, *_ in steps_of]
        if b == [0, 1, 1, 0].index(level):
            assert played.best_return[b] == pytest.approx(best[level] - np.mean(state_values))
    assert one.best.tolist() == pytest.approx(best)


def naive_gae(episode: list[tuple[float, float, float]]) -> list[float]:
    """Sums of (discount x lambda) ** l times the error of the value l steps later."""
    errors = [reward + SETTINGS.discount * follows - value for value, reward, follows in episode]
    factor = SETTINGS.discount * SETTINGS.smoothing
    return [sum(factor**later * error for later, error in enumerate(errors[begin:])) for begin in range(len(errors))]


def naive_minimum(episode: list[tuple[float, float, float]]) -> list[float]:
    """The lambda-average of n-step advantages, each the least of those before it and itself."""
    found = []
    for begin in range(len(episode)):
        rest = episode[begin:]
        advantages = [
            sum(SETTINGS.discount**t * reward for t, (_, reward, _) in enumerate(rest[:n]))
            + SETTINGS.discount**n * rest[n - 1][2]
            - rest[0][0]
            for n in range(1, len(rest) + 1)
        ]
        least = np.minimum.accumulate(advantages)
        shares = [SETTINGS.smoothing ** (n - 1) * (1.0 - SETTINGS.smoothing) for n in range(1, len(rest))]
        found.append(float(np.dot([*shares, SETTINGS.smoothing ** (len(rest) - 1)], least)))
    return found


def test_the_gradient_is_that_of_the_loss() -> None:
    one, tables = learner(settings=replace(SETTINGS, learning_rate=1e-3)), levels()
    one.play(np.array([0, 1, 1, 0]))
    one.parameters[:] += np.random.default_rng(5).standard_normal(len(one.parameters)) * 0.05
    visited, at, action = one._student[2], one._tracks[0], one._tracks[2]
    states = visited[at]
    old = one._student[5].reshape(-1, ACTIONS + 1)[at]
    advantages = one._advantages.copy()

    def loss(parameters: np.ndarray) -> float:
        chances, values = outputs(tables, parameters, SETTINGS.hidden)
        ratio = chances[states, action] / old[np.arange(len(at)), action]
        scaled = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        objective = np.minimum(ratio * scaled, np.clip(ratio, 1 - SETTINGS.clip, 1 + SETTINGS.clip) * scaled)
        error = 0.5 * (values[states] - advantages - old[:, -1]) ** 2
        entropy = -(chances * np.log(chances)).sum(axis=1)[states]
        return float((-objective + SETTINGS.value * error - SETTINGS.entropy * entropy).mean())

    before = one.parameters.copy()
    numeric = np.zeros_like(before)
    for place in range(len(before)):
        step = np.zeros_like(before)
        step[place] = 1e-6
        numeric[place] = (loss(before + step) - loss(before - step)) / 2e-6
    one.improve(np.random.default_rng(0))
    assert one._moments[2] == pytest.approx(numeric, abs=1e-7)
    assert (np.abs(one.parameters - before) <= 1e-3 + 1e-9).all(), "Adam's first step is as long as the rate"
    assert one.parameters @ numeric < before @ numeric


def test_episodes_of_a_copied_learner_do_not_change_the_learner() -> None:
    one, other = learner(), learner()
    one.copy_with_seed(7).play(np.array([0, 1]), episodes=3)
    first, second = (each.play(np.array([0, 1])) for each in (one, other))
    assert first.positive.tolist() == second.positive.tolist()
    assert one.best.tolist() == other.best.tolist()


@AT_NIGHT
def test_numba_and_python_give_the_same_bit_for_bit() -> None:
    pytest.importorskip("numba")
    found = []
    for native in (False, True):
        one, rng = (
            learner(settings=replace(SETTINGS, minibatches=2, epochs=2, norm=0.5), native=native),
            np.random.default_rng(1),
        )
        for _ in range(5):
            one.play(np.array([0, 1, 1, 0]))
            one.improve(rng)
        played = one.play(np.array([1, 0]), episodes=9)
        success, value = one.evaluate([0, 1])
        found.append((one.parameters.tobytes(), played.negative.tobytes(), success.tobytes(), value.tobytes()))
    assert found[0] == found[1]


def test_levels_added_later_are_trained_like_initial_levels() -> None:
    one, both = learner(), learner()
    twice = levels().extended_by(levels())
    assert len(twice) == 4
    both.replace_levels(twice)
    for mine, others in zip(one.evaluate([0, 1, 0, 1]), both.evaluate([2, 3, 0, 1]), strict=True):
        assert np.array_equal(mine, others)
    first, second = one.play(np.array([0, 1, 1, 0])), both.play(np.array([2, 3, 3, 2]))
    assert np.array_equal(first.returns, second.returns) and np.array_equal(first.positive, second.positive)
    for student in (one, both):
        student.improve(np.random.default_rng(0))
    assert np.array_equal(one.parameters, both.parameters)
