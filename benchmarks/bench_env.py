"""Environments: states enumerated a second, steps a second, beside Gymnasium's FrozenLake; a second `make`."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import gymnasium
import numpy as np
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import SyncVectorEnv

from envgraph.env import EnvgraphEnv, EnvgraphLiveEnv, EnvgraphVectorEnv, Simulator, explore, scene_rgb
from envgraph.lang import bundled_domain, load_workspace

STEPS = 50_000

SIX_KEYS = """
import "keydoor.metamodel"
model two_rooms : keydoor {
    maze : Maze {
        cells = grid cell {
            legend "#" = Wall, "." = Floor, X = Exit,
                   r = Floor { item = Key { colour = ::red } }, R = Door { colour = ::red },
                   b = Floor { item = Key { colour = ::blue } }, B = Door { colour = ::blue }
            column x next east
            row y next south
            rows \"""
                #############
                #.........#.#
                #.r.b.r.b.R.#
                #.........#.#
                ######.####B#
                #.r.....b.#.#
                #.........RX#
                #############
                \"""
        }
        hero = hero : Hero { at = cell[1, 1] }
    }
}
"""


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
    with TemporaryDirectory() as directory:
        _large(Path(directory))


def _large(directory: Path) -> None:
    """Making an environment of many states, again, and having Gymnasium check it."""
    for file in bundled_domain("keydoor").glob("*.*"):
        (directory / file.name).write_text(file.read_text("utf-8"), "utf-8")
    (directory / "two_rooms.model").write_text(SIX_KEYS, "utf-8")
    os.environ["ENVGRAPH_CACHE"] = str(directory / "cache")
    options = {"domain": str(directory), "render_mode": "ansi"}
    for name in ("first", "second"):
        start = perf_counter()
        env = gymnasium.make("envgraph/KeyDoor-v0", **options)
        seconds = perf_counter() - start
        states = env.get_wrapper_attr("tabular").n_states
        print(f"{f'{name} make, {states:,} states':34} {seconds:12.2f} s")
    start = perf_counter()
    check_env(env.unwrapped)
    print(f"{'check_env':34} {perf_counter() - start:12.2f} s")


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
