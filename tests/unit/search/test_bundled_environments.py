"""All bundled domains: from the family file to Gymnasium."""

from __future__ import annotations

import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import envgraph.env
from envgraph.env.registration import BUNDLED
from envgraph.errors import EvaluationError, InvalidArgument
from envgraph.lang import bundled_domain, bundled_domains
from envgraph.search import Family, export_ga4cl, generate, make_environment, open_family, write_family

IDS = {domain: f"envgraph/{name}-v0" for name, domain, _, _ in BUNDLED}
ACTIONS = {"burning_forest": 4, "keydoor": 9, "network": 5, "warehouse": 7}


def test_every_bundled_domain_with_an_environment_is_registered() -> None:
    found = [name for name in bundled_domains() if list(bundled_domain(name).glob("*.environment"))]
    assert sorted(IDS) == found == sorted(ACTIONS)
    for name, domain, limit, _ in BUNDLED:
        text = (bundled_domain(domain) / f"{domain}.environment").read_text(encoding="utf-8")
        assert f"environment {name}(" in text and f"limit {limit} steps" in text
        assert gymnasium.spec(IDS[domain]).max_episode_steps == limit


@pytest.mark.parametrize("render_mode", [None, "ansi", "rgb_array"])
@pytest.mark.parametrize("domain", IDS)
def test_the_environment_checker_has_nothing_to_say(domain: str, render_mode: str | None) -> None:
    env = gymnasium.make(IDS[domain], render_mode=render_mode)
    assert env.action_space == gymnasium.spaces.Discrete(ACTIONS[domain])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=render_mode is None)


@pytest.fixture(scope="module", params=["keydoor", "network", "warehouse"])
def family(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Family:
    path = tmp_path_factory.mktemp(request.param)
    made = generate(request.param, path / "run.sqlite", generations=1, population=2)
    (path / "family.json").write_text(write_family(made), encoding="utf-8")
    return open_family(path / "family.json")


def test_members_of_a_family_share_actions_and_observations(family: Family, tmp_path: Path) -> None:
    path = tmp_path / "family.json"
    path.write_text(write_family(family), encoding="utf-8")
    (id_,) = (IDS[domain] for name, domain, _, _ in BUNDLED if name == family.name)
    spaces = set()
    for member in family.members:
        env = gymnasium.make(id_, family=path, variant=member.name, observation="multi")
        spaces.add((str(env.action_space), str(env.observation_space)))
        rng = np.random.default_rng(0)
        observation, _ = env.reset(seed=1)
        for _ in range(200):
            assert observation in env.observation_space
            observation, reward, terminated, truncated, _ = env.step(rng.integers(env.action_space.n))
            assert np.isfinite(reward)
            if terminated or truncated:
                observation, _ = env.reset()
    assert len(spaces) == 1


def test_only_what_one_agent_does_on_a_grid_is_written_as_ga4cl(family: Family) -> None:
    if family.name == "KeyDoor":
        assert '"env_1"' in export_ga4cl(family)
        return
    with pytest.raises(InvalidArgument, match="draws no grid" if family.name == "Routing" else "agent"):
        export_ga4cl(family)


def test_a_table_and_a_live_engine_have_the_same_episodes() -> None:
    rng = np.random.default_rng(0)
    table, live = make_environment("keydoor"), make_environment("keydoor", live=True)
    assert table.reset(seed=4)[0] == live.reset(seed=4)[0]
    for _ in range(100):
        action = int(rng.integers(9))
        one, other = table.step(action), live.step(action)
        assert one[:4] == other[:4]
        if one[2]:
            assert table.reset()[0] == live.reset()[0]


def test_live_environments_of_what_is_not_there_are_refused() -> None:
    with pytest.raises(InvalidArgument, match="give a `family`, or a `domain`"):
        make_environment(live=True)
    with pytest.raises(InvalidArgument, match="give `family` as well"):
        make_environment("keydoor", variant=1, live=True)


def test_too_many_states_for_a_table_are_told_with_a_way_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("envgraph.search._tables.explore", limited)
    with pytest.raises(EvaluationError, match=r"more than 500 states[\s\S]*hint: .* \(`live=True`\)"):
        make_environment("network")


def limited(*arguments: object, **options: object) -> object:
    return envgraph.env.explore(*arguments, **options, limit=500)  # type: ignore[arg-type]


def test_many_live_environments_side_by_side() -> None:
    many = gymnasium.make_vec("envgraph/Warehouse-v0", num_envs=2)
    many.reset(seed=3)
    rewards = [many.step(np.array([4, 2]))[1].tolist() for _ in range(3)]
    many.close()
    assert rewards == [[-0.01, -0.01], [-0.01, -0.11], [-0.01, -0.01]]
