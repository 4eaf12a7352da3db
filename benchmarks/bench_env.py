"""Make, enumerate and step environments, beside Gymnasium's FrozenLake.

    python -m benchmarks env

Steps a second are those of random actions, resets included.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import NamedTuple
from unittest.mock import patch

import gymnasium
import numpy as np
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import SyncVectorEnv

from envgraph.env import EnvgraphEnv, EnvgraphLiveEnv, EnvgraphVectorEnv, Simulator, explore, scene_rgb
from envgraph.errors import Source
from envgraph.lang import bundled_domain, load_workspace
from envgraph.report import reproduction
from envgraph.search import import_ga4cl, make, make_vec, write_family

PUBLISHED = Path(reproduction.__file__).parent / "data" / "environment-config.json"

KEYDOOR = """
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
ROWS
\"""
        }
        hero = hero : Hero { at = cell[1, 1] }
    }
}
"""


SIX_KEYS = """\
#############
#.........#.#
#.r.b.r.b.R.#
#.........#.#
######.####B#
#.r.....b.#.#
#.........RX#
#############"""


class Sizes(NamedTuple):
    """Steps of a measurement, numbers of environments in a vector, and the rows of a larger map."""

    steps: int
    vectors: tuple[int, int]
    rows: str


FULL = Sizes(50_000, (64, 1024), SIX_KEYS)
QUICK = Sizes(100, (2, 4), "#####\n#.rR#\n###X#\n#####")


def main(sizes: Sizes) -> None:
    """Print the figures."""
    few, many = sizes.vectors
    workspace = load_workspace(["burning_forest"])
    engine, behaviour = workspace.engine("target_8x8"), workspace.behaviour()
    explored = explore(engine, behaviour, pictures=True)
    table = explored.tabular
    seconds = _best(lambda: explore(engine, behaviour))
    moves = int((table.probability > 0).sum())
    print(f"enumerate E6: {table.n_states} states, {moves} moves in {seconds * 1e3:.1f} ms, {moves / seconds:,.0f}/s")
    lake = _steps(gymnasium.make("FrozenLake8x8-v1").unwrapped, sizes.steps)
    print(f"{'FrozenLake 8x8, unwrapped':34} {lake:12,.0f} steps/s")
    single = _steps(EnvgraphEnv(table), sizes.steps)
    print(f"{'EnvgraphEnv':34} {single:12,.0f} steps/s  {single / lake:6.2f} x FrozenLake")
    live = _steps(EnvgraphLiveEnv(Simulator(engine, behaviour)), sizes.steps // 5)
    print(f"{'EnvgraphLiveEnv':34} {live:12,.0f} steps/s  {live / lake:6.2f} x FrozenLake")
    wrapped = _steps(gymnasium.make("envgraph/BurningForest-v0"), sizes.steps)
    lake_made = _steps(gymnasium.make("FrozenLake8x8-v1"), sizes.steps)
    print(f"{'make, FrozenLake 8x8':34} {lake_made:12,.0f} steps/s")
    print(f"{'make, BurningForest':34} {wrapped:12,.0f} steps/s  {wrapped / lake_made:6.2f} x FrozenLake")
    lakes = SyncVectorEnv([lambda: gymnasium.make("FrozenLake8x8-v1")] * few)
    sync = _vector_steps(lakes, sizes.steps)
    print(f"{f'SyncVectorEnv of {few}, FrozenLake':34} {sync:12,.0f} steps/s")
    for count in (few, many):
        rate = _vector_steps(EnvgraphVectorEnv(table, count, max_episode_steps=200), sizes.steps)
        print(f"{f'EnvgraphVectorEnv of {count}':34} {rate:12,.0f} steps/s  {rate / sync:6.2f} x SyncVectorEnv")
    with _new_cache() as directory:
        _family(directory, lake, sizes)
    scene = explored.pictures[0]
    print(f"{'picture of 256 x 256 pixels':34} {_best(lambda: scene_rgb(scene)) * 1e3:12.2f} ms")
    with _new_cache() as directory:
        _large(directory, sizes.rows)


@contextmanager
def _new_cache() -> Iterator[Path]:
    """Give a temporary directory, in which tables of states are cached meanwhile."""
    with TemporaryDirectory() as directory, patch.dict(os.environ, ENVGRAPH_CACHE=f"{directory}/cache"):
        yield Path(directory)


def _family(directory: Path, lake: float, sizes: Sizes) -> None:
    """Members of a family: making one, stepping with masks, and as vectors, dictionaries and images."""
    path = directory / "family.json"
    run = import_ga4cl(
        Source("family.json", PUBLISHED.read_text("utf-8")),
        "burning_forest/paper.toml",
        directory / "run.sqlite",
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
        steps = _steps(make(path, **given).unwrapped, sizes.steps // 5)  # type: ignore[arg-type]
        name = ", ".join(map(str, given.values())) if given.get("action_masks") is None else "action masks"
        print(f"{f'one of a family {name}':34} {steps:12,.0f} steps/s  {steps / lake:6.2f} x FrozenLake")
    for masked in (False, True):
        count = sizes.vectors[1]
        rate = _vector_steps(make_vec(path, count, action_masks=masked), sizes.steps)
        name = f"{count} of a family{', action masks' * masked}"
        print(f"{name:34} {rate:12,.0f} steps/s")


def _large(directory: Path, rows: str) -> None:
    """Making an environment of many states, again, and having Gymnasium check it."""
    for file in bundled_domain("keydoor").glob("*.*"):
        (directory / file.name).write_text(file.read_text("utf-8"), "utf-8")
    (directory / "two_rooms.model").write_text(KEYDOOR.replace("ROWS", rows), "utf-8")
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


def _steps(env: gymnasium.Env[object, object], count: int) -> float:
    """Steps a second under random actions, resets included."""
    actions = np.random.default_rng(0).integers(4, size=count).tolist()
    env.reset(seed=0)
    start = perf_counter()
    for action in actions:
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()
    return count / (perf_counter() - start)


def _vector_steps(env: gymnasium.vector.VectorEnv[object, object, object], steps: int) -> float:
    rounds = max(20, steps // env.num_envs)
    actions = np.random.default_rng(0).integers(4, size=(rounds, env.num_envs))
    env.reset(seed=0)
    start = perf_counter()
    for row in actions:
        env.step(row)
    return actions.size / (perf_counter() - start)
