"""Step bundled environments as users make them: one beside Gymnasium's FrozenLake, and 1,024 at once.

    python -m benchmarks steps

Environments are made with their default wrappers, and stepped with random actions, resets included. Short bursts
alternate with those of FrozenLake. Times are those of the processor, so that other programs disturb them less.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any, NamedTuple

import gymnasium
import numpy as np

from benchmarks.bench_compiled import alone, alternating
from envgraph.env.registration import BUNDLED
from envgraph.lang import bundled_domain
from envgraph.search import make, make_vec

PEERS = ("numba",)


class Sizes(NamedTuple):
    """What is measured.

    Attributes:
        domains: the domains; `together` is the warehouse with agents that act together.
        environments: that are stepped at once.
        bursts: of each of two things, in turns.
        rounds: steps of all environments in a burst.
    """

    domains: tuple[str, ...]
    environments: int
    bursts: int
    rounds: int


FULL = Sizes((*(domain for _, domain, _, _ in BUNDLED), "together"), 1024, 20, 40)
QUICK = Sizes(("keydoor",), 4, 1, 2)

ENGINES = {"network/diverse.toml": ("compiled",), "warehouse": ("compiled",), "together": ("compiled",)}
"""The engines that step a domain; other domains also have tables."""
VECTORS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("index", {}),
    ("flat (>= 8)", {"observation": "flat"}),
    ("masks (>= 5)", {"action_masks": True}),
    ("flat, masks (>= 5)", {"observation": "flat", "action_masks": True}),
    ("flat, history of 4", {"observation": "flat", "history": 4}),
)


def main(sizes: Sizes) -> None:
    """Print the figures."""
    with TemporaryDirectory() as folder:
        places = {name: _together(Path(folder)) if name == "together" else name for name in sizes.domains}
        print("one environment, times FrozenLake (>= 3): the median of the ratios of bursts, by observation")
        kinds = ("index", "flat", "multi", "dict")
        print(f"{'':31}{''.join(f'{kind:>8}' for kind in kinds)}   with masks")
        for name, domain in places.items():
            for engine in ENGINES.get(name, ("table", "compiled")):
                times = [_times_lake(sizes, domain=domain, engine=engine, observation=kind) for kind in kinds]
                masked = _times_lake(sizes, domain=domain, engine=engine, action_masks=True)
                print(f"{name:20} {engine:10}{''.join(f'{each:8.2f}' for each in times)} {masked:12.2f}", flush=True)
        print(f"{sizes.environments:,} compiled environments, M steps/s: the best, and the median of the bursts")
        print(f"{'':20}{''.join(f'{title:>20}' for title, _ in VECTORS)}")
        for name, domain in places.items():
            rates = [
                _rates(sizes, make_vec(domain=domain, num_envs=sizes.environments, engine="compiled", **options))
                for _, options in VECTORS
            ]
            print(f"{name:20}{''.join(f'{each:>20}' for each in rates)}", flush=True)


def _times_lake(sizes: Sizes, **options: Any) -> float:
    """Return how many times as fast as FrozenLake an environment is."""
    envs = make(**options), gymnasium.make("FrozenLake-v1")
    ours, lake = alternating(sizes.bursts, *(alone(env, None, 10 * sizes.rounds) for env in envs), clock=process_time)
    return median(theirs / own for theirs, own in zip(lake, ours, strict=True))


def _rates(sizes: Sizes, envs: gymnasium.vector.VectorEnv[Any, Any, Any]) -> str:
    """Return the rate of a vector environment."""
    (seconds,) = alternating(sizes.bursts, _burst(envs, sizes.rounds), clock=process_time)
    return f"{1e-6 / min(seconds):.1f} {1e-6 / median(seconds):.1f}"


def _burst(envs: gymnasium.vector.VectorEnv[Any, Any, Any], rounds: int) -> Callable[[], int]:
    space: Any = envs.single_action_space
    actions = np.random.default_rng(0).integers(space.n, size=(rounds, envs.num_envs))
    envs.reset(seed=0)

    def burst() -> int:
        for row in actions:
            envs.step(row)
        return actions.size

    return burst


def _together(folder: Path) -> str:
    """Write a copy of the warehouse whose robots act in the same step; return its folder."""
    for file in bundled_domain("warehouse").glob("*.*"):
        text = file.read_text("utf-8")
        if file.suffix == ".environment":
            text = text.replace("agent robot : Robot {", "agents together\n    agent robot : Robot {")
        (folder / file.name).write_text(text, "utf-8")
    return str(folder)
