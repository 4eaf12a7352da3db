"""Many environments at once."""

from __future__ import annotations

from copy import deepcopy
from functools import partial
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from envgraph.env import EnvgraphEnv, EnvgraphLiveEnv, EnvgraphVectorEnv, Simulator, explore
from envgraph.env.compiled import CompiledEnv, CompiledVectorEnv, program_of
from envgraph.env.schedules import Batch, Outcomes, Shuffled
from envgraph.errors import InvalidArgument
from tests.unit.env import forest
from tests.unit.env.coins import loaded

FAMILY = [explore(forest.engine(rows), forest.behaviour(), pictures=True) for rows in forest.published_maps()]
TABLES = [member.tabular for member in FAMILY]

RANDOM = """
action turn = 0.5: turn() | 0.2: drop(hand)
on reset apply turn()
on neg find up(_) reward 1 terminate success
observe coin.side for coin : Coin
"""


def test_vector_steps_like_single_environments_and_resets_in_the_next_step() -> None:
    many = EnvgraphVectorEnv(TABLES, num_envs=9, max_episode_steps=7)
    single = [EnvgraphEnv(TABLES[i % 6]) for i in range(9)]
    assert many.observation_space == spaces.MultiDiscrete([128] * 9)
    assert many.action_space == spaces.MultiDiscrete([4] * 9)
    observations, infos = many.reset(seed=1)
    assert observations.tolist() == [int(env.reset(seed=1)[0]) for env in single]
    steps = [0] * 9
    done = [False] * 9
    rng = np.random.default_rng(2)
    for _ in range(60):
        actions = rng.integers(4, size=9)
        observations, rewards, terminations, truncations, infos = many.step(actions)
        for i, env in enumerate(single):
            if done[i]:
                index, info = env.reset()
                expected = (int(index), 0.0, False, False)
                steps[i] = 0
            else:
                index, reward, terminated, _, info = env.step(actions[i])
                steps[i] += 1
                expected = (int(index), reward, terminated, steps[i] >= 7)
            found = (int(observations[i]), rewards[i], terminations[i], truncations[i])
            assert found == expected
            assert tuple(infos[name][i] for name in ("state", "step", "success", "is_success")) == tuple(info.values())
            done[i] = expected[2] or expected[3]
    assert infos["_state"].all()


def test_starts_and_outcomes_are_drawn_with_their_probabilities() -> None:
    table = explore(*loaded(RANDOM)).tabular
    many = EnvgraphVectorEnv(table, num_envs=20_000)
    observations, _ = many.reset(seed=4)
    # b or a shows heads at the start, equally likely; then it is turned with probability one half.
    starts = np.bincount(observations, minlength=8)
    assert starts.sum() == starts[4 + 1] + starts[4 + 2]
    assert starts[5] == pytest.approx(10_000, abs=400)
    _, rewards, terminations, _, infos = many.step(np.zeros(20_000, dtype=np.int64))
    assert terminations.sum() == pytest.approx(10_000, abs=400)
    assert (rewards == terminations).all()
    assert (infos["success"] == terminations).all()


def test_seed_determines_starts_and_steps_of_a_vector() -> None:
    table = explore(*loaded(RANDOM)).tabular

    def run(seed: int) -> list[list[int]]:
        many = EnvgraphVectorEnv(table, num_envs=5)
        seen = [many.reset(seed=seed)[0].tolist()]
        seen += [many.step(np.zeros(5, dtype=np.int64))[0].tolist() for _ in range(20)]
        return seen

    assert run(1) == run(1)
    assert run(1) != run(2)


def test_vector_returns_component_observations_and_rendered_frames() -> None:
    pictures = [member.pictures for member in FAMILY]
    many = EnvgraphVectorEnv(TABLES, pictures=pictures, render_mode="rgb_array", observation="multi")
    assert many.num_envs == 6
    observations, _ = many.reset(seed=0)
    assert observations.tolist() == [[0, 0]] * 6
    assert observations in many.observation_space
    frames = many.render()
    assert frames is not None
    assert [frame.shape for frame in frames] == [(256, 256, 3)] * 6
    assert EnvgraphVectorEnv(TABLES).render() is None


def test_wrong_arguments_are_refused() -> None:
    many = EnvgraphVectorEnv(TABLES)
    with pytest.raises(ResetNeeded):
        many.step(np.zeros(6, dtype=np.int64))
    many.reset(seed=0)
    for actions in ([0] * 5, [4] * 6, [-1] * 6):
        with pytest.raises(InvalidArgument, match=r"6 numbers in 0\.\.3"):
            many.step(actions)
    coins = explore(*loaded(RANDOM)).tabular
    for arguments in ([()], [[TABLES[0], coins]], [TABLES, 0]):
        with pytest.raises(InvalidArgument):
            EnvgraphVectorEnv(*arguments)
    with pytest.raises(InvalidArgument, match="`max_episode_steps` is 0, but must be at least 1"):
        EnvgraphVectorEnv(TABLES, max_episode_steps=0)
    with pytest.raises(InvalidArgument, match="pictures"):
        EnvgraphVectorEnv(TABLES, render_mode="rgb_array")


@pytest.mark.parametrize("observation", ["index", "multi", "flat", "dict"])
@pytest.mark.parametrize("mode", AutoresetMode)
def test_every_autoreset_mode_behaves_like_a_gymnasium_vector(mode: AutoresetMode, observation: str) -> None:
    """Step by step the same as Gymnasium's own vector of the single environments, infos included."""

    def single(table: int) -> gymnasium.Env[object, object]:
        env = EnvgraphEnv(TABLES[table], observation=observation, action_masks=True)  # type: ignore[arg-type]
        return gymnasium.wrappers.TimeLimit(env, 7)

    theirs = SyncVectorEnv([partial(single, number) for number in range(6)], autoreset_mode=mode)
    ours = EnvgraphVectorEnv(
        TABLES,
        max_episode_steps=7,
        observation=observation,
        autoreset_mode=mode.value,  # type: ignore[arg-type]
        action_masks=True,
    )
    assert ours.metadata["autoreset_mode"] is mode
    assert same(ours.reset(seed=1), theirs.reset(seed=1))
    rng, ends = np.random.default_rng(2), 0
    for _ in range(40):
        actions = rng.integers(4, size=6)
        found, (seen, rewards, ended, late, infos) = ours.step(actions), theirs.step(actions)
        assert same(found, (seen, rewards, ended, late, infos))
        over = found[2] | found[3]
        ends += int(over.sum())
        if mode is AutoresetMode.DISABLED and over.any():
            with pytest.raises(
                ResetNeeded, match=f"the episodes of environments .*{np.flatnonzero(over)[0]}.* are over"
            ):
                ours.step(actions)
            options = {"reset_mask": over}
            assert same(ours.reset(options=dict(options)), theirs.reset(options=dict(options)))
    assert ends > 20


@pytest.mark.parametrize("engine", ["table", "compiled"])
@pytest.mark.parametrize("mode", AutoresetMode)
def test_a_list_of_seeds_gives_each_environment_its_own_generator(mode: AutoresetMode, engine: str) -> None:
    """Step by step the same as Gymnasium's vector of single environments with the same list."""
    table = explore(*loaded(RANDOM)).tabular

    def single() -> gymnasium.Env[object, object]:
        return gymnasium.wrappers.TimeLimit(EnvgraphEnv(table), 5)

    theirs = SyncVectorEnv([single] * 4, autoreset_mode=mode)
    options: dict[str, Any] = {"max_episode_steps": 5, "autoreset_mode": mode}
    if engine == "table":
        ours: EnvgraphVectorEnv | CompiledVectorEnv = EnvgraphVectorEnv(table, 4, **options)
    else:
        ours = CompiledVectorEnv(program_of(*loaded(RANDOM), native=False), 4, **options)
    actions, ends = np.zeros(4, dtype=np.int64), 0
    ours.reset(seed=9)  # one generator for all, until there is a list
    for seeds in ([4, 4, 2**70, 0], [None, 7, None, 1], np.array([5, 6, 7, 8]), None):
        given: Any = seeds.tolist() if isinstance(seeds, np.ndarray) else seeds  # theirs takes no array
        assert same(ours.reset(seed=seeds)[0], theirs.reset(seed=given)[0])
        for _ in range(80):  # more steps than numbers are drawn at once
            found, wanted = ours.step(actions), theirs.step(actions)
            assert same(found[:4], wanted[:4])
            over = found[2] | found[3]
            ends += int(over.sum())
            if mode is AutoresetMode.DISABLED and over.any():
                reset = {"seed": [3, None, 3, None], "options": {"reset_mask": over}}
                assert same(ours.reset(**deepcopy(reset))[0], theirs.reset(**deepcopy(reset))[0])
            ours = deepcopy(ours) if over.all() else ours
    assert ends > 200
    ours.reset(seed=9)  # and again one for all
    assert ours.reset(seed=9)[0].tolist() != ours.reset(seed=[9, 10, 11, 12])[0].tolist()


def test_wrong_seeds_of_vectors_are_refused() -> None:
    many = EnvgraphVectorEnv(TABLES[:2])
    with pytest.raises(InvalidArgument, match="`seed` lists 1 seeds, but must list 2, one per environment"):
        many.reset(seed=[1])
    for seed in ([1, -1], [1, "2"], [0.5, 1], 1.0):
        with pytest.raises((ValueError, TypeError), match=r"integer|iterable"):
            many.reset(seed=seed)  # type: ignore[arg-type]


@pytest.mark.parametrize("observation", ["index", "multi", "flat", "dict"])
def test_returned_observations_are_not_changed_by_later_steps(observation: str) -> None:
    engine, behaviour = loaded(RANDOM)
    program, table = program_of(engine, behaviour), explore(engine, behaviour).tabular
    options: Any = {"observation": observation}
    envs: list[Any] = [EnvgraphEnv(table, **options), CompiledEnv(program, **options)]
    envs += [EnvgraphVectorEnv(table, 3, **options), CompiledVectorEnv(program, 3, **options)]
    for env in envs:
        seen = [env.reset(seed=0)[0]]
        before = deepcopy(seen)
        for _ in range(12):
            alone, action = isinstance(env, gymnasium.Env), np.zeros(3, dtype=np.int64)
            observed, _, ended, _, _ = env.step(0 if alone else action)
            seen += [observed, env.reset()[0]] if alone and ended else [observed]
            before += deepcopy(seen[len(before) :])
        assert all(map(same, seen, before)) and not all(same(seen[0], one) for one in seen)


@pytest.mark.parametrize("observation", ["index", "multi", "flat", "dict"])
def test_environment_that_observes_nothing_has_one_observation(observation: str) -> None:
    engine, behaviour = loaded("action turn = turn()")
    program, table = program_of(engine, behaviour), explore(engine, behaviour).tabular
    options: Any = {"observation": observation}
    envs: list[Any] = [EnvgraphEnv(table, **options), CompiledEnv(program, **options)]
    envs += [EnvgraphLiveEnv(Simulator(engine, behaviour), **options), CompiledVectorEnv(program, 1, **options)]
    seen = [env.reset(seed=0)[0] for env in envs]
    assert all(one in env.observation_space for one, env in zip(seen, envs, strict=True))
    assert same(seen[0], seen[1]) and same(seen[0], seen[2])


def same(one: object, other: object) -> bool:
    """Whether results of vector environments are equal, arrays and what they are in."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(same(one[name], other[name]) for name in one)
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if one is None or other is None:
        return one is other
    mine, others = np.asarray(one), np.asarray(other)
    if mine.dtype == object:
        return mine.shape == others.shape and all(map(same, mine, others))
    return mine.dtype == others.dtype and np.array_equal(mine, others, equal_nan=mine.dtype.kind == "f")


def test_invalid_reset_options_and_autoreset_modes_are_refused() -> None:
    many = EnvgraphVectorEnv(TABLES[:2])
    with pytest.raises(ResetNeeded, match="must reset all environments"):
        many.reset(options={"reset_mask": np.array([True, False])})
    many.reset()
    for mask in ([True], [False, False], [1, 0], "yes"):
        with pytest.raises(InvalidArgument, match="2 bools"):
            many.reset(options={"reset_mask": mask})
    with pytest.raises(InvalidArgument, match="unknown reset option `state`: the options are `reset_mask`"):
        many.reset(options={"state": 3})
    with pytest.raises(InvalidArgument, match="unknown autoreset mode 'never'; the modes are `Disabled`, `NextStep`"):
        EnvgraphVectorEnv(TABLES, autoreset_mode="never")


class RecordingSchedule(Shuffled):
    """Remembers what it has given and what it was told."""

    def __init__(self, members: int) -> None:
        super().__init__(np.arange(members))
        self.given: list[int] = []
        self.told: list[tuple[int, float, float, int]] = []

    def ask(self, count: int, rng: np.random.Generator) -> Batch:
        batch = super().ask(count, rng)
        self.given += batch.members.tolist()
        return Batch(batch.members, learn=batch.members[0] > 1)

    def tell(self, outcomes: Outcomes) -> None:
        rows = outcomes.members, outcomes.success, outcomes.returns, outcomes.length
        self.told += zip(*(row.tolist() for row in rows), strict=True)


@pytest.mark.parametrize("mode", AutoresetMode)
def test_each_episode_uses_the_member_that_the_schedule_returns(mode: AutoresetMode) -> None:
    schedule = RecordingSchedule(6)
    many = EnvgraphVectorEnv(TABLES, 4, max_episode_steps=9, autoreset_mode=mode, schedule=schedule)
    _, infos = many.reset(seed=1)
    rng, done, totals, told = np.random.default_rng(2), np.zeros(4, np.bool_), np.zeros(4), []
    for _ in range(60):
        before, member = infos["state"], infos["member"]
        actions = rng.integers(4, size=4)
        _, reward, ended, late, infos = many.step(actions)
        for i in range(4):
            if not (done[i] and mode is AutoresetMode.NEXT_STEP):
                assert reward[i] == TABLES[member[i]].reward[before[i], actions[i], 0]
        totals = np.where(done, 0.0, totals) + reward
        done = ended | late
        last = infos.get("final_info", infos)
        told += [
            (int(member[i]), float(last["success"][i]), totals[i], int(last["step"][i])) for i in np.flatnonzero(done)
        ]
        if done.any() and mode is AutoresetMode.DISABLED:
            _, infos = many.reset(options={"reset_mask": done.copy()})
            infos |= {name: getattr(many._scheduled_members, name) for name in ("member", "learn")}
            infos["state"] = many._state - many._first[many._member_numbers]
    assert schedule.told == told
    assert len(told) >= 20
    assert schedule.given[: len(told)].count(0) >= 3


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_compiled_vector_with_a_schedule_steps_like_tables(mode: AutoresetMode) -> None:
    engines = [forest.engine(rows) for rows in forest.published_maps()]
    program = program_of(engines[0], forest.behaviour(), engines, native=False)
    tables = EnvgraphVectorEnv(TABLES[1:4], 3, max_episode_steps=8, autoreset_mode=mode, schedule=RecordingSchedule(3))
    compiled = CompiledVectorEnv(
        program, 3, members=[1, 2, 3], max_episode_steps=8, autoreset_mode=mode, schedule=RecordingSchedule(3)
    )
    rng = np.random.default_rng(3)
    mine, other = tables.reset(seed=5), compiled.reset(seed=5)
    for _ in range(40):
        assert np.array_equal(mine[0], other[0])
        for name in ("member", "learn", "step", "success"):
            assert np.array_equal(mine[-1][name], other[-1][name])
        actions = rng.integers(4, size=3)
        mine, other = tables.step(actions), compiled.step(actions)
    assert isinstance(tables.schedule, RecordingSchedule)
    assert isinstance(compiled.schedule, RecordingSchedule)
    assert tables.schedule.told == compiled.schedule.told
    assert len(tables.schedule.told) > 9


def test_schedule_does_not_change_the_steps_of_an_episode() -> None:
    plain = EnvgraphVectorEnv(TABLES[:1], 5, max_episode_steps=6)
    scheduled = EnvgraphVectorEnv(TABLES[:1], 5, max_episode_steps=6, schedule=Shuffled(np.zeros(1, np.int64)))
    assert np.array_equal(plain.reset(seed=3)[0], scheduled.reset(seed=3)[0])
    rng = np.random.default_rng(0)
    for _ in range(20):
        actions = rng.integers(4, size=5)
        assert np.array_equal(plain.step(actions)[0], scheduled.step(actions)[0])
