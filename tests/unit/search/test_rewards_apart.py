"""Each reward of a step by itself, on whatever steps."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import envgraph
from envgraph.behaviour import reward_names
from envgraph.errors import InvalidArgument
from envgraph.search import Domain, generate, make_environment
from envgraph.solve import certify, value_iteration


def test_each_reward_clause_has_a_name() -> None:
    names = [reward_names(Domain.load(one).behaviour) for one in ("taxi", "triage", "warehouse")]  # type: ignore[arg-type]
    assert names[0] == ("pickUp", "dropOff", "each step", "arrived")
    assert names[1] == ("treat", "each step", "dead", "neg inHouse")
    assert "lift" in names[2]


@pytest.mark.parametrize(("domain", "engine"), [("taxi", "table"), ("triage", "live"), ("triage", "compiled")])
def test_separate_rewards_in_info_sum_to_the_reward_and_change_nothing_else(
    domain: str, engine: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("envgraph.env.compiled.programs._compiled_program.has_numba", lambda: False)
    apart: Any = envgraph.make(domain=domain, engine=engine, rewards=True, max_episode_steps=40)
    plain: Any = envgraph.make(domain=domain, engine=engine, max_episode_steps=40)
    names = reward_names(Domain.load(domain).behaviour)  # type: ignore[arg-type]
    assert apart.reset(seed=3) == plain.reset(seed=3)
    rng, paid = np.random.default_rng(0), dict.fromkeys(names, 0.0)
    for _ in range(200):
        action = int(rng.integers(plain.action_space.n))
        *found, info = apart.step(action)
        *expected, told = plain.step(action)
        rewards = info.pop("rewards")
        assert found == expected and info == told and tuple(rewards) == names
        assert sum(rewards.values()) == pytest.approx(found[1])
        paid = {name: paid[name] + abs(gain) for name, gain in rewards.items()}
        if found[2] or found[3]:
            assert apart.reset() == plain.reset()
    assert sum(gain > 0 for gain in paid.values()) >= 3


def test_separate_rewards_work_after_switching_members(tmp_path: Path) -> None:
    family = generate(
        "burning_forest/paper.toml",
        tmp_path / "run.sqlite",
        overrides=["search.generations=1", "search.population=2"],
    )
    env: Any = make_environment(family=family, variant="E1", rewards=True)
    check_env(env.unwrapped, skip_render_check=True)
    env.reset()  # without a seed, too
    copy = pickle.loads(pickle.dumps(env))
    for one in (env, copy):
        for variant in ("E2", "E1"):
            assert one.reset(options={"variant": variant})[1]["variant"] == variant
            for action in (1, 2, 1, 2, 0):
                _, reward, over, _, info = one.step(action)
                assert info["variant"] == variant and sum(info["rewards"].values()) == pytest.approx(reward)
                if over:
                    break
    many = envgraph.make_vec(tmp_path / "run.sqlite", 2, rewards=True, vectorization_mode="sync")
    many.reset(seed=0)
    rewards = many.step(np.array([1, 2]))[4]["rewards"]
    assert rewards["onFire"].shape == rewards["_onFire"].shape == (2,)
    with pytest.raises(InvalidArgument, match='use `vectorization_mode="sync"`'):
        envgraph.make_vec(tmp_path / "run.sqlite", 2, rewards=True)
    with pytest.raises(InvalidArgument, match="has no reward `goal`"):
        family.paying("goal")
    paying = family.paying("onFire")  # what is best of it is computed as of all
    tables = [one.explored(one.member("E1")).tabular for one in (family, paying)]
    assert tables[1].n_states == tables[0].n_states
    best = [certify(table, value_iteration(table).policy, limit=200).optimal_return for table in tables]
    assert best[1] == 0.0 < best[0]
