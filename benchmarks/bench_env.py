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
from envgraph.errors import Source
from envgraph.lang import bundled_domain, load_workspace
from envgraph.report import reproduction
from envgraph.search import import_ga4cl, make, make_vec, write_family

STEPS = 50_000
PUBLISHED = Path(reproduction.__file__).parent / "data" / "environment-config.json"

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
    _family(lake)
    scene = explored.pictures[0]
    print(f"{'picture of 256 x 256 pixels':34} {_best(lambda: scene_rgb(scene)) * 1e3:12.2f} ms")
    with TemporaryDirectory() as directory:
        _large(Path(directory))


def _family(lake: float) -> None:
    """Members of a family: making one, stepping with masks, and as vectors, dictionaries and images."""
    with TemporaryDirectory() as directory:
        os.environ["ENVGRAPH_CACHE"] = str(Path(directory) / "cache")
        path = Path(directory) / "family.json"
        run = import_ga4cl(
            Source("family.json", PUBLISHED.read_text("utf-8")),
            "burning_forest",
            Path(directory) / "run.sqlite",
        )
        path.write_text(write_family(run[0]), "utf-8")
        make(path)
        print(f"{'make of a stored family':34} {_best(lambda: make(path)) * 1e3:12.1f} ms")
        options: tuple[dict[str, object], ...] = (
            {},
            {"action_masks": True},
            *({"observation": kind} for kind in ("multi", "flat", "dict")),
            {"observation": "image", "engine": "live"},
        )
        for given in options:
            steps = _steps(make(path, **given).unwrapped, STEPS // 5)  # type: ignore[arg-type]
            name = (
                ", ".join(map(str, given.values())) if given.get("action_masks") is None else "action masks"
            )
            print(f"{f'one of a family {name}':34} {steps:12,.0f} steps/s  {steps / lake:6.2f} x FrozenLake")
        for masked in (False, True):
            many = make_vec(path, 1024, action_masks=masked)
            name = f"1024 of a family{', action masks' * masked}"
            print(f"{name:34} {_vector_steps(many, 1024):12,.0f} steps/s")


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
