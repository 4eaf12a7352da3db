"""Episodes of networks in compiled code: what a loop through the environment does with the same network in NumPy."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

import envgraph
from envgraph.behaviour import Behaviour
from envgraph.env.compiled import CompiledBatch, CompiledProgram, has_numba, program_of
from envgraph.errors import InvalidArgument
from envgraph.learn import Evaluation, play_program
from envgraph.rewrite import Engine
from tests.profile import NIGHTLY
from tests.unit.env.side_by_side import BUNDLED, family_keys, mutants, opened

NATIVE = {
    "keydoor": [False, *([True] if has_numba() else [])],
    "network": [False, *([True] if has_numba() and NIGHTLY else [])],
}
"""Compiling takes most of the time."""
LIMIT = 30
Layers = list[tuple[NDArray[np.float64], NDArray[np.float64]]]


def domain(name: str) -> tuple[Engine, Behaviour]:
    model = {"keydoor": "two_rooms", "network": "backbone"}[name]
    return opened(BUNDLED / name / f"{model}.model", BUNDLED / name / f"{name}.environment")


def network(*sizes: int) -> Layers:
    rng = np.random.default_rng(4)
    return [(rng.normal(size=(a, b)), rng.normal(size=b)) for a, b in pairwise(sizes)]


def outputs(layers: Layers, seen: NDArray[np.float32]) -> NDArray[np.float64]:
    found = np.asarray(seen, np.float64)
    for number, (weights, bias) in enumerate(layers):
        found = (np.maximum(found, 0.0) if number else found) @ weights + bias
    return found


def evaluate_step_by_step(env: gymnasium.Env[NDArray[np.float32], int], layers: Layers, episodes: int) -> Evaluation:
    """The best actions of the network, step by step."""
    successes, total, steps = 0, 0.0, 0
    for number in range(episodes):
        seen, _ = env.reset(seed=None if number else 8)
        over = False
        while not over:
            seen, reward, ended, cut, info = env.step(int(outputs(layers, seen).argmax()))
            over = ended or cut
            total += float(reward)
            steps += 1
        successes += info["success"]
    return Evaluation(successes / episodes, total / episodes, steps / episodes, episodes, False)


@pytest.mark.parametrize("hidden", [(), (16,), (9, 5)])
@pytest.mark.parametrize("name", ["keydoor", "network"])
def test_greedy_episodes_agree_with_a_loop_over_environment_steps(name: str, hidden: tuple[int, ...]) -> None:
    """The first draws nothing, so that one episode is all of them."""
    env: Any = envgraph.make(
        domain=f"{name}/diverse.toml",
        observation="flat",
        engine="compiled",
        max_episode_steps=LIMIT,
        disable_env_checker=True,
    )
    layers = network(env.observation_space.shape[0], *hidden, env.action_space.n)
    count = 1 if name == "keydoor" else 12
    wanted = evaluate_step_by_step(env, layers, count)
    for native in NATIVE[name]:
        program = program_of(*domain(name), native=native)
        (found,) = play_program(program, layers, np.random.default_rng(8), episodes=count, limit=LIMIT)
        assert found == wanted
        (many,) = play_program(program, layers, np.random.default_rng(8), episodes=40, limit=LIMIT)
        assert (many.mean_return == pytest.approx(wanted.mean_return)) == (name == "keydoor")


def sampled_step_by_step(
    program: CompiledProgram, member: int, layers: Layers, episodes: int, rng: np.random.Generator
) -> Evaluation:
    """Each number is drawn here: for a beginning, for an action, for a step."""
    batch, first = CompiledBatch(program, [member]), np.cumsum([0, *program.observation_shape[:-1]])
    successes, total, steps = 0, 0.0, 0
    for _ in range(episodes):
        batch.reset(np.ones(1, np.bool_), rng.random(1))
        for _ in range(LIMIT):
            seen = np.zeros(sum(program.observation_shape), np.float32)
            seen[first + batch.components[0]] = 1.0
            preferences = outputs(layers, seen)
            chances = np.exp(preferences - preferences.max()).cumsum()
            action = int(np.searchsorted(chances, rng.random() * chances[-1], side="right"))
            batch.step(np.array([action]), resets_ended=False, uniforms=rng.random(1))
            total += float(batch.reward[0])
            steps += 1
            if batch.ended[0]:
                successes += int(batch.ended[0] == 1)
                break
    return Evaluation(successes / episodes, total / episodes, steps / episodes, episodes, False)


@pytest.mark.parametrize("name", ["keydoor", "network"])
def test_actions_are_sampled_from_the_softmax_of_the_outputs(name: str) -> None:
    engine, behaviour = domain(name)
    engines = mutants(engine, behaviour, 2)
    keys = family_keys(engines, behaviour)
    known = []
    for native in NATIVE[name]:
        program = program_of(engine, behaviour, engines, keys, native=native)
        layers = network(sum(program.observation_shape), 8, len(program.action_names))
        rng, other = np.random.default_rng(3), np.random.default_rng(3)
        found = play_program(program, layers, rng, members=[1, 0], episodes=10, limit=LIMIT, sampled=True)
        assert found == [sampled_step_by_step(program, one, layers, 10, other) for one in (1, 0)]
        known.append((*found, rng.random()))
    assert known.count(known[0]) == len(NATIVE[name])
    assert known[0][-1] == other.random()


def test_networks_that_do_not_fit_the_program_are_refused() -> None:
    program, rng = program_of(*domain("keydoor"), native=False), np.random.default_rng(0)
    inputs, actions = sum(program.observation_shape), len(program.action_names)
    layers = network(inputs, 8, actions)
    said = rf"network from {inputs} inputs to {actions} actions"
    transposed = [(weights.T, bias) for weights, bias in layers]
    for wrong in ([], layers[:1], layers[1:], transposed, network(inputs, actions + 1)):
        with pytest.raises(InvalidArgument, match=said):
            play_program(program, wrong, rng)
    with pytest.raises(InvalidArgument, match="finite"):
        play_program(program, [(np.full((inputs, actions), np.nan), np.zeros(actions))], rng)
    with pytest.raises(InvalidArgument, match=r"`members` must be numbers from 0 to 0"):
        play_program(program, layers, rng, members=[1])
    with pytest.raises(InvalidArgument, match="both must be at least 1"):
        play_program(program, layers, rng, episodes=0)
