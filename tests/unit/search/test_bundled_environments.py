"""All bundled domains: from the family file to Gymnasium."""

from __future__ import annotations

import warnings
from functools import partial
from math import log2
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import envgraph
import envgraph.env
from envgraph.cli import main
from envgraph.env import EnvgraphEnv, EnvgraphLiveEnv
from envgraph.env.compiled import CompiledEnv, CompiledVectorEnv
from envgraph.env.registration import BUNDLED
from envgraph.errors import EvaluationError, InvalidArgument
from envgraph.lang import bundled_domain, bundled_domains
from envgraph.search import (
    Family,
    export_ga4cl,
    generate,
    make_environment,
    make_vector_environment,
    open_family,
    write_family,
)
from tests.profile import NIGHTLY

IDS = {file.partition("/")[0]: f"envgraph/{name}-v0" for name, file, _, _ in BUNDLED}
ACTIONS = {
    "burning_forest": 4,
    "jobshop": 4,
    "keydoor": 9,
    "lava": 6,
    "network": 5,
    "sokoban": 4,
    "taxi": 6,
    "triage": 4,
    "warehouse": 7,
}


def test_every_bundled_domain_with_an_environment_is_registered() -> None:
    found = [name for name in bundled_domains() if list(bundled_domain(name).glob("*.environment"))]
    assert sorted(IDS) == found == sorted(ACTIONS)
    for name, file, limit, _ in BUNDLED:
        domain = file.partition("/")[0]
        text = (bundled_domain(domain) / f"{domain}.environment").read_text(encoding="utf-8")
        assert f"environment {name}" in text and f"limit {limit} steps" in text
        assert gymnasium.spec(IDS[domain]).max_episode_steps == limit


MODES = (None, "ansi", "rgb_array")
CHECKED = [(domain, mode) for domain in IDS for mode in MODES]
BY_DAY = [(domain, MODES[number % 3]) for number, domain in enumerate(IDS)]


@pytest.mark.parametrize(("domain", "render_mode"), CHECKED if NIGHTLY else BY_DAY)
def test_bundled_environments_pass_the_gymnasium_checker(domain: str, render_mode: str | None) -> None:
    env = gymnasium.make(IDS[domain], render_mode=render_mode)
    assert env.action_space == gymnasium.spaces.Discrete(ACTIONS[domain])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=render_mode is None)


@pytest.mark.parametrize(
    "domain", ["jobshop", "lava", "network", "sokoban", "taxi", "triage"] if NIGHTLY else ["network"]
)
def test_generated_family_of_each_domain_has_nearly_maximal_diversity(domain: str, tmp_path: Path) -> None:
    generations = {"generations": 20} if domain == "network" else {}
    family = generate(f"{domain}/diverse.toml", tmp_path / "run.sqlite", **generations)
    assert family.diversity() >= 0.9 * log2(6)


@pytest.fixture(scope="module", params=["keydoor", "network", "warehouse"])
def family(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Family:
    path = tmp_path_factory.mktemp(request.param)
    made = generate(
        f"{request.param}/diverse.toml",
        path / "run.sqlite",
        generations=1,
        population=2,
        overrides=["constraints.reachable=[]"],
    )
    (path / "family.json").write_text(write_family(made), encoding="utf-8")
    return open_family(path / "family.json")


def test_members_of_a_family_share_actions_and_observations(family: Family, tmp_path: Path) -> None:
    path = tmp_path / "family.json"
    path.write_text(write_family(family), encoding="utf-8")
    id_ = f"envgraph/{family.name}-v0"
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


def test_ga4cl_export_refuses_families_without_a_single_agent_on_a_grid(family: Family) -> None:
    refused = {"Routing": "does not draw a grid", "KeyDoor": "of `E1`"}
    with pytest.raises(InvalidArgument, match=refused.get(family.name, "agent")):
        export_ga4cl(family)


def test_table_and_live_environment_have_the_same_episodes() -> None:
    rng = np.random.default_rng(0)
    table, live = make_environment("keydoor"), make_environment("keydoor", live=True)
    assert table.reset(seed=4)[0] == live.reset(seed=4)[0]
    for _ in range(100):
        action = int(rng.integers(9))
        one, other = table.step(action), live.step(action)
        assert one[:4] == other[:4]
        if one[2]:
            assert table.reset()[0] == live.reset()[0]


def test_live_environment_without_a_family_or_domain_is_refused() -> None:
    with pytest.raises(InvalidArgument, match="neither `family` nor `domain` is given"):
        make_environment(live=True)
    with pytest.raises(InvalidArgument, match="`variant` is given without `family`"):
        make_environment("keydoor", variant=1, live=True)


def test_too_many_states_for_a_table_are_reported_with_an_alternative_engine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("envgraph.env.compiled.explore_fast", limited)
    with pytest.raises(EvaluationError, match=r"more than 500 states[\s\S]*hint: .*`engine=\"compiled\"`"):
        make_environment("network/diverse.toml", engine="table")
    assert isinstance(make_environment("network/diverse.toml"), CompiledEnv)


def test_engine_argument_selects_the_environment_class() -> None:
    kinds = {"table": EnvgraphEnv, "compiled": CompiledEnv, "live": EnvgraphLiveEnv}
    for engine, kind in kinds.items():
        assert type(envgraph.make(domain="keydoor", engine=engine).unwrapped) is kind
    assert isinstance(envgraph.make_vec(domain="keydoor", num_envs=2, streams="each"), CompiledVectorEnv)
    with pytest.raises(InvalidArgument, match="unknown engine 'fast'"):
        make_environment("keydoor", engine="fast")  # type: ignore[arg-type]
    with pytest.raises(InvalidArgument, match="`live=True` contradicts"):
        make_environment("keydoor", engine="table", live=True)
    with pytest.raises(InvalidArgument, match="needs single environments"):
        make_vector_environment(2, "keydoor", engine="live")
    with pytest.raises(InvalidArgument, match='`streams` needs `engine="compiled"`, but `engine="table"` is given'):
        make_vector_environment(2, "keydoor", engine="table", streams="each")


def test_behaviour_that_is_not_compiled_is_reported_and_runs_on_the_live_engine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    source = bundled_domain("keydoor")
    for file in source.glob("*.*"):
        text = file.read_text("utf-8")
        if file.suffix == ".environment":
            text = text.replace("action take = take(hero)", "action take = grab(hero)")
        if file.suffix == ".rules":
            text += "\nunit grab(hero : Hero) { try { take(hero); grab(hero); } }\n"
        (tmp_path / file.name).write_text(text, "utf-8")
    files = [str(next(tmp_path.glob("*.model"))), str(tmp_path / "keydoor.environment")]
    monkeypatch.setattr("sys.argv", ["envgraph", "explain", *files, "KeyDoor"])
    assert main() == 0
    said = capsys.readouterr().out
    unsupported = "compiled environments do not support the unit `grab`, which calls itself"
    assert said.startswith(f"environment KeyDoor steps on the live engine: {unsupported}\n")
    assert "unit grab(hero : Hero) { try { take(hero); grab(hero); } }\n" in said and said.endswith("^^^^^^^^^^\n")
    with pytest.raises(
        EvaluationError,
        match=rf"cannot be compiled: {unsupported}[\s\S]*unit grab",
    ):
        make_environment(str(tmp_path), engine="compiled")
    monkeypatch.setattr("envgraph.env.compiled.explore_fast", partial(limited, limit=5))
    with pytest.warns(
        UserWarning,
        match=f"{unsupported}; the live engine is used instead",
    ):
        assert isinstance(make_environment(str(tmp_path)), EnvgraphLiveEnv)
    with pytest.raises(
        EvaluationError,
        match=r"compiled environments do not support the unit `grab`, which calls itself[\s\S]*`engine=\"live\"`",
    ):
        make_vector_environment(2, str(tmp_path))  # and no warning that it steps


def limited(*arguments: object, limit: int = 500, **options: object) -> object:
    return envgraph.env.explore(*arguments, **options, limit=limit)  # type: ignore[arg-type]


def test_live_environments_can_be_stepped_as_a_vector() -> None:
    many = gymnasium.make_vec("envgraph/Warehouse-v0", num_envs=2)
    many.reset(seed=3)
    rewards = [many.step(np.array([4, 2]))[1].tolist() for _ in range(3)]
    many.close()
    assert rewards == [[-0.01, -0.01], [-0.01, -0.11], [-0.01, -0.01]]
