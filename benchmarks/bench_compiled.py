"""Step compiled environments, beside the live engine, code by hand, MiniGrid and torch; compile, plan, learn.

    python -m benchmarks compiled

All ratios are of short bursts that alternate: the better and the middle one of many. Without numba there is nothing to
measure.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from types import FrameType
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

from benchmarks._peers import peer
from envgraph import code
from envgraph.behaviour import Behaviour, KeyIndex, indexed_classes
from envgraph.env import EnvgraphLiveEnv, Simulator, can_end, explore
from envgraph.env.compiled import (
    ActionPlan,
    CompiledBatch,
    CompiledEnv,
    CompiledProgram,
    PlanSearch,
    enumerate_states,
    program_of,
    with_guide_counts,
)
from envgraph.env.compiled.layout._program_layout import ProgramLayout
from envgraph.env.compiled.steps._program_text import emit_program
from envgraph.lang import load_workspace
from envgraph.learn import TrainingSettings, play_program, train_program
from envgraph.rewrite import Engine
from envgraph.search import make_vec
from envgraph.solve import certify, value_iteration

ROOT = Path(__file__).parents[1]
DOMAINS = {
    "keydoor": (ROOT / "rules/keydoor", "two_rooms", 500),
    "burning_forest": (ROOT / "rules/burning_forest", "target_8x8", 500),
    "network": (ROOT / "rules/network", "backbone", 450),
    "warehouse": (ROOT / "rules/warehouse", "small_hall", 350),
    "sokoban": (ROOT / "tests/data/compiled/sokoban", "small", 350),
    "wildfire": (ROOT / "tests/data/compiled/wildfire", "wild", 300),
}
"""The folder of a domain, a model, and how many times as fast as the live engine it has to be."""
PEERS = ("numba", "minigrid", "torch")


class Sizes(NamedTuple):
    """How much is measured.

    Attributes:
        domains: those of `DOMAINS` that are stepped and compiled.
        tables: domains whose states are visited.
        certificates: domains of whose tables all is certified.
        plans: domains in which plans are found.
        limits: states after which a search for a plan goes on by a beam.
        learned: the domain that agents learn.
        environments: that are stepped at once.
        bursts: of each of two things, in turns: the machine may be busy with something else.
        learning: lengths of training.
        seeds: agents of each length of training.
    """

    domains: tuple[str, ...]
    tables: tuple[str, ...]
    certificates: tuple[str, ...]
    plans: tuple[str, ...]
    limits: tuple[int, int]
    learned: str
    environments: int
    bursts: int
    learning: tuple[int, ...]
    seeds: int


FULL = Sizes(
    domains=tuple(DOMAINS),
    tables=("burning_forest", "keydoor", "sokoban", "network"),
    certificates=("burning_forest", "keydoor"),
    plans=("sokoban", "warehouse"),
    limits=(20_000, 2_000),
    learned="sokoban",
    environments=1024,
    bursts=40,
    learning=(500_000, 1_000_000, 2_000_000, 4_000_000),
    seeds=5,
)
ONE = ("keydoor",)
QUICK = Sizes(ONE, ONE, ONE, ONE, (20_000, 2), "keydoor", environments=4, bursts=1, learning=(1_000,), seeds=1)

Job = Callable[[], int]


def main(sizes: Sizes) -> None:
    """Print the figures."""
    if peer("numba") is None:
        return
    lake = gymnasium.make("FrozenLake-v1").unwrapped
    count, bursts = sizes.environments, sizes.bursts
    print(f"steps with random actions, {count:,} environments: the best, and the median of {bursts} bursts")
    print(f"{'':16} {'M steps/s':>15} {'times live':>15} {'needed':>7}   {'one, times FrozenLake':>21}")
    for name in sizes.domains:
        _, _, needed = DOMAINS[name]
        engine, behaviour = opened(name)
        program = program_of(engine, behaviour)
        live = EnvgraphLiveEnv(Simulator(opened(name)[0], behaviour))
        fast, slow = alternating(bursts, many(program, sizes), alone(live, behaviour.limit, 200))
        one, frozen = alternating(bursts, alone(CompiledEnv(program), behaviour.limit, 1000), alone(lake, None, 300))
        rates = f"{1e-6 / min(fast):7.1f} {1e-6 / median(fast):7.1f}"
        print(f"{name:16} {rates} {ratios(slow, fast)} {needed:7}   {ratios(frozen, one, 2):>21}", flush=True)
    _by_hand(sizes)
    _doorkey(sizes)
    _tables(sizes)
    _certificates(sizes)
    _plans(sizes)
    _learning(sizes)
    _networks(sizes)
    _compiling(sizes)
    _writing(sizes)


def opened(name: str) -> tuple[Engine, Behaviour]:
    """An engine and the behaviour of a domain."""
    folder, model, _ = DOMAINS[name]
    workspace = load_workspace([folder / f"{model}.model", *folder.glob("*.environment")])
    return workspace.engine(model), workspace.behaviour()


def many(program: CompiledProgram, sizes: Sizes) -> Job:
    """A burst of steps of many environments, each with a stream of its own."""
    batch = CompiledBatch(program, np.zeros(sizes.environments, dtype=np.int64))
    batch.seed(generators(sizes))
    batch.reset(np.ones(sizes.environments, dtype=np.bool_))
    limit = program.behaviour.limit or 0
    actions = np.random.default_rng(0).integers(len(program.action_names), size=(50, sizes.environments))

    def burst() -> int:
        for row in actions:
            batch.step(row, resets_ended=True, limit=limit)
        return actions.size

    return burst


def generators(sizes: Sizes) -> list[np.random.Generator]:
    """A generator for each environment."""
    return [np.random.Generator(np.random.PCG64(number)) for number in range(sizes.environments)]


def alone(env: gymnasium.Env[Any, Any], limit: int | None, steps: int) -> Job:
    """A burst of steps of one environment."""
    space: Any = env.action_space
    actions = np.random.default_rng(0).integers(space.n, size=steps).tolist()
    env.reset(seed=0)
    since = 0

    def burst() -> int:
        nonlocal since
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            since += 1
            if terminated or truncated or since == limit:
                env.reset()
                since = 0
        return steps

    return burst


def alternating(bursts: int, *jobs: Job, clock: Callable[[], float] = perf_counter) -> list[list[float]]:
    """Seconds that a step takes, for each burst of each job, after one that does not count."""
    seconds: list[list[float]] = [[] for _ in jobs]
    for number in range(bursts + 1):
        for job, found in zip(jobs, seconds, strict=True):
            start = clock()
            steps = job()
            if number:
                found.append((clock() - start) / steps)
    return seconds


def ratios(slow: Sequence[float], fast: Sequence[float], digits: int = 0) -> str:
    """How many times as fast: by the best bursts, and by the median."""
    return f"{min(slow) / min(fast):7.{digits}f} {median(slow) / median(fast):7.{digits}f}"


# --- beside others


def _by_hand(sizes: Sizes) -> None:
    """KeyDoor written by hand: the same streams, observations and rewards, then the speed."""
    from benchmarks._keydoor import HandWritten
    from envgraph.env.compiled.layout._batch_arrays import generator_states

    engine, behaviour = opened("keydoor")
    program = program_of(engine, behaviour)
    batch = CompiledBatch(program, np.zeros(sizes.environments, dtype=np.int64))
    batch.seed(generators(sizes))
    batch.reset(np.ones(sizes.environments, dtype=np.bool_))
    other = HandWritten(generator_states(generators(sizes)))
    for actions in np.random.default_rng(1).integers(len(program.action_names), size=(500, sizes.environments)):
        batch.step(actions, resets_ended=True, limit=behaviour.limit or 0)
        other.step(actions)
        same = [
            batch.observation == other.observation,
            batch.reward == other.reward,
            batch.over == other.over,
        ]
        if not np.all(same):
            raise AssertionError("KeyDoor written by hand does something else")
    chosen = np.random.default_rng(0).integers(len(program.action_names), size=(50, sizes.environments))

    def burst() -> int:
        for row in chosen:
            other.step(row)
        return chosen.size

    ours, hand = alternating(sizes.bursts, many(program, sizes), burst)
    print(f"keydoor by hand, with numba: {1e-6 / min(hand):.1f} M steps/s, {ratios(ours, hand, 2)} of ours (<= 2.0)")


def _doorkey(sizes: Sizes) -> None:
    if peer("minigrid") is None:  # importing it registers its environments
        return
    env = gymnasium.make("MiniGrid-DoorKey-6x6-v0")
    engine, behaviour = opened("keydoor")
    fast, slow = alternating(sizes.bursts, many(program_of(engine, behaviour), sizes), alone(env, None, 50))
    print(f"MiniGrid-DoorKey-6x6: {1 / min(slow):,.0f} steps/s; keydoor {ratios(slow, fast)} times")


# --- tables, and learning


def _tables(sizes: Sizes) -> None:
    """Visits of all states, beside the live engine where that takes less than a minute."""
    print("seconds to visit all states: the best of 5, and how many times that is the live engine's")
    for name in sizes.tables:
        engine, behaviour = opened(name)
        program = program_of(engine, behaviour)
        states = enumerate_states(program).n_states
        fast = _best(lambda program=program: enumerate_states(program))  # type: ignore[misc]
        keys = program.keys
        again = _best(lambda e=engine, k=keys, p=program: enumerate_states(p.with_model(e, k)))  # type: ignore[misc]
        slow = _best(lambda e=engine, b=behaviour: explore(e, b), 1) if states < 1_000 else None  # type: ignore[misc]
        times = "" if slow is None else f"{slow / fast:10,.0f}"
        print(f"{name:25} {states:8,} states {fast:10.5f} {times:>10}; of another model {again:.5f}", flush=True)


def _certificates(sizes: Sizes) -> None:
    """What is certain of one environment, with its table: of a member of the program, and of another model."""
    print("milliseconds for all certificates: the best of 20; with the table (<= 1); of another model (<= 1)")
    for name in sizes.certificates:
        engine, behaviour = opened(name)
        program = program_of(engine, behaviour)
        table = enumerate_states(program)
        policy = value_iteration(table).policy
        alone = _best(lambda t=table, p=policy: certify(t, p), 20)  # type: ignore[misc]
        whole = _best(lambda g=program, p=policy: certify(enumerate_states(g), p), 20)  # type: ignore[misc]
        keys = program.keys
        other = _best(
            lambda g=program, e=engine, k=keys, p=policy: certify(enumerate_states(g.with_model(e, k)), p),  # type: ignore[misc]
            20,
        )
        print(f"{name:25} {1e3 * alone:8.2f} {1e3 * whole:8.2f} {1e3 * other:8.2f}", flush=True)


def _plans(sizes: Sizes) -> None:
    """A plan, shortest or by a beam, beside the live engine's search for any way."""
    print(
        f"seconds to find a plan: the best of 5; after {sizes.limits[1]:,} states by a beam; any way on the live engine"
    )
    for name in sizes.plans:
        engine, behaviour = opened(name)
        with_guides, guides = with_guide_counts(behaviour)
        program = program_of(engine, with_guides)
        for limit in sizes.limits:
            job = partial(_planned, program, guides, limit)
            print(f"{name:25} {_best(job):10.5f}  {job()}", flush=True)
        print(f"{name:25} {_best(partial(can_end, engine, behaviour, 1), 1):10.5f}  live", flush=True)


def _learning(sizes: Sizes) -> None:
    """Q-learning of states, until the best actions succeed; Sokoban has two boxes."""
    engine, behaviour = opened(sizes.learned)
    program = program_of(engine, behaviour)
    settings = TrainingSettings(limit=100, checkpoint=1_000_000)
    train_program(program, settings, np.random.default_rng(0), of="state", steps=[1_000])
    for steps in sizes.learning:
        start = perf_counter()
        agents = [
            train_program(program, settings, np.random.default_rng(seed), of="state", steps=[steps])
            for seed in range(sizes.seeds)
        ]
        seconds = (perf_counter() - start) / sizes.seeds
        solved = [one.learner.play(0, 1, 100, np.random.default_rng(9))[0] for one in agents]
        times = f"{seconds:.2f} s (<= 2; {steps / seconds / 1e6:.1f} M/s)"
        solve = f"{sum(solved):.0f} of {sizes.seeds} solve it"
        print(f"{sizes.learned}, {steps:,} steps: {times}, {solve}", flush=True)


def _networks(sizes: Sizes) -> None:
    """A network of 64 units that draws its actions: in the program, and torch's beside many environments."""
    program = program_of(*opened("keydoor"))
    units = sum(program.observation_shape), 64, len(program.action_names)
    rng = np.random.default_rng(0)
    layers = [(rng.normal(size=ends) / 8, np.zeros(ends[1])) for ends in pairwise(units)]

    def burst() -> int:
        (found,) = play_program(program, layers, rng, episodes=sizes.environments, limit=100, sampled=True)
        return round(found.mean_length * sizes.environments)

    if peer("torch") is None:
        (inside,) = alternating(sizes.bursts, burst)
    else:
        inside, beside = alternating(sizes.bursts, burst, _with_torch(layers, sizes))
        made = f"torch, make_vec of {sizes.environments:,}: {_rates(beside)} M steps/s"
        print(f"{made}; inside {ratios(beside, inside, 1)} times")
    print(f"network of 64 units, in the program: {_rates(inside)} M steps/s", flush=True)


def _with_torch(layers: Sequence[tuple[NDArray[Any], NDArray[Any]]], sizes: Sizes) -> Job:
    """A burst of steps of many environments, whose actions torch draws on one core."""
    torch = peer("torch")
    torch.set_num_threads(1)
    linear = [torch.nn.Linear(*weights.shape) for weights, _ in layers]
    net = torch.nn.Sequential(linear[0], torch.nn.ReLU(), linear[1])
    for one, (weights, bias) in zip(linear, layers, strict=True):
        one.load_state_dict({"weight": torch.tensor(weights.T), "bias": torch.tensor(bias)})
    envs = make_vec(domain="keydoor", num_envs=sizes.environments, observation="flat", engine="compiled")
    seen, _ = envs.reset(seed=0)

    def burst() -> int:
        nonlocal seen
        with torch.no_grad():
            for _ in range(20):
                chances = net(torch.from_numpy(seen)).softmax(dim=1)
                seen, *_ = envs.step(torch.multinomial(chances, 1)[:, 0].numpy())
        return 20 * sizes.environments

    return burst


def _rates(seconds: Sequence[float]) -> str:
    """Million steps a second: by the best burst, and by the median."""
    return f"{1e-6 / min(seconds):.2f} {1e-6 / median(seconds):.2f}"


def _planned(program: CompiledProgram, guides: int, limit: int) -> ActionPlan:
    """Search for a plan in arrays of its own."""
    return PlanSearch(program, limit=limit).plan(guides)


def _best(job: Callable[[], object], times: int = 5) -> float:
    found = []
    for _ in range(times):
        start = perf_counter()
        job()
        found.append(perf_counter() - start)
    return min(found)


# --- compiling, in processes of their own


def _compiling(sizes: Sizes) -> None:
    """How long it takes until the first step, with nothing in numba's cache, and again."""
    print(f"seconds of CPU to compile:{'text, arrays':>16} (<= 0.2) {'cold':>7} (<= 5) {'cached':>7} (<= 0.3)")
    for name in sizes.domains:
        with TemporaryDirectory() as folder:
            environment = {**os.environ, "ENVGRAPH_CACHE": folder}
            command = [sys.executable, "-m", "benchmarks.bench_compiled", name]
            runs = [
                json.loads(
                    subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, cwd=ROOT).stdout
                )
                for _ in range(2)
            ]
        (text, cold), (_, cached) = runs
        print(f"{name:25} {text:16.2f} {cold:16.2f} {cached:14.2f}", flush=True)


def _writing(sizes: Sizes) -> None:
    """How many calls of functions of envgraph lead from a behaviour that is loaded to its program's text."""
    most = {"keydoor": 23_000, "warehouse": 21_000}
    for name in sizes.domains:
        needed = f" (<= {most[name]:,})" if name in most else ""
        print(f"{name:25} {calls_to_text(name):16,} calls to write the text{needed}", flush=True)


def calls_to_text(name: str) -> int:
    """Count the calls; those of a first program in a process do not count, since it imports modules."""
    found = 0

    def see(frame: FrameType, event: str, _: object) -> None:
        nonlocal found
        found += event == "call" and frame.f_code.co_filename.startswith(str(ROOT / "envgraph"))

    for _ in range(2):
        engine, behaviour = opened(name)
        found = 0
        sys.setprofile(see)
        behaviour = engine.library.with_functions_resolved(behaviour)
        keys = KeyIndex.of_model(engine.model, indexed_classes(behaviour, engine.model.metamodel))
        code.print_source(emit_program(engine, behaviour, keys, ProgramLayout()).functions)
        sys.setprofile(None)
    return found


def _compile(name: str) -> None:
    from numba import njit

    njit(lambda x: x)(0)
    engine, behaviour = opened(name)
    start = process_time()
    program = program_of(engine, behaviour)
    written = process_time()
    batch = CompiledBatch(program, [0])
    batch.reset(np.ones(1, dtype=np.bool_))
    batch.step(np.zeros(1, dtype=np.int64), resets_ended=True)
    print(json.dumps([written - start, process_time() - written]))


if __name__ == "__main__":
    _compile(sys.argv[1])
