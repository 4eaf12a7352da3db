"""Environments: states enumerated a second, steps a second, beside Gymnasium's FrozenLake."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import gymnasium
import numpy as np
from gymnasium.vector import SyncVectorEnv

from envgraph.env import EnvgraphEnv, EnvgraphLiveEnv, EnvgraphVectorEnv, Simulator, explore, scene_rgb
from envgraph.lang import load_workspace

STEPS = 50_000


def main() -> None:
    """Print the figures."""
    workspace = load_workspace(["burning_forest"])
    engine, behaviour = workspace.engine("target_8x8"), workspace.behaviour()
    explored = explore(engine, behaviour, pictures=True)
    table = explored.tabular
    seconds = _best(lambda: explore(engine, behaviour))
    moves = int((table.probability > 0).sum())
    print(
        f"enumerate E6: {table.n_states} states, {moves} moves in {seconds * 1e3:.1f} ms, {moves / seconds:,.0f}/s"
    )
    lake = _steps(gymnasium.make("FrozenLake8x8-v1").unwrapped)
    print(f"{'FrozenLake 8x8, unwrapped':34} {lake:12,.0f} steps/s")
    single = _steps(EnvgraphEnv(table))
    print(f"{'EnvgraphEnv':34} {single:12,.0f} steps/s  {single / lake:6.2f} x FrozenLake")
    live = _steps(EnvgraphLiveEnv(Simulator(engine, behaviour)), STEPS // 5)
    print(f"{'EnvgraphLiveEnv':34} {live:12,.0f} steps/s  {live / lake:6.2f} x FrozenLake")
    wrapped = _steps(gymnasium.make("envgraph/BurningForest-v0"))
    lake_made = _steps(gymnasium.make("FrozenLake8x8-v1"))
    print(f"{'make, FrozenLake 8x8':34} {lake_made:12,.0f} steps/s")
    print(f"{'make, BurningForest':34} {wrapped:12,.0f} steps/s  {wrapped / lake_made:6.2f} x FrozenLake")
    sync = _vector_steps(SyncVectorEnv([lambda: gymnasium.make("FrozenLake8x8-v1")] * 64), 64)
    print(f"{'SyncVectorEnv of 64, FrozenLake':34} {sync:12,.0f} steps/s")
    for count in (64, 1024):
        many = _vector_steps(EnvgraphVectorEnv(table, count, max_episode_steps=200), count)
        print(
            f"{f'EnvgraphVectorEnv of {count}':34} {many:12,.0f} steps/s  {many / sync:6.2f} x SyncVectorEnv"
        )
    scene = explored.pictures[0]
    print(f"{'picture of 256 x 256 pixels':34} {_best(lambda: scene_rgb(scene)) * 1e3:12.2f} ms")


def _best(job: Callable[[], object], rounds: int = 5) -> float:
    times = []
    for _ in range(rounds):
        start = perf_counter()
        job()
        times.append(perf_counter() - start)
    return min(times)


def _steps(env: gymnasium.Env[object, object], count: int = STEPS) -> float:
    """Steps a second under random actions, resets included."""
    actions = np.random.default_rng(0).integers(4, size=count).tolist()
    env.reset(seed=0)
    start = perf_counter()
    for action in actions:
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()
    return count / (perf_counter() - start)


def _vector_steps(env: gymnasium.vector.VectorEnv[object, object, object], count: int) -> float:
    rounds = max(20, STEPS // count)
    actions = np.random.default_rng(0).integers(4, size=(rounds, count))
    env.reset(seed=0)
    start = perf_counter()
    for row in actions:
        env.step(row)
    return rounds * count / (perf_counter() - start)


if __name__ == "__main__":
    main()
