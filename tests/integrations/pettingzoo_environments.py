"""Environments with several agents against the real PettingZoo: `make test-integrations` installs it, and runs this.

It is no `test_*.py`: `make test` does without.
"""

from __future__ import annotations

import copy
import pickle
import warnings
from collections.abc import Callable
from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
import pytest

import envgraph
from envgraph.env import EnvgraphLiveEnv, Simulator
from envgraph.env.multiagent import TogetherEnv, TurnEnv
from envgraph.errors import InvalidArgument
from envgraph.lang import bundled_domain
from tests.integrations.documented import run_example, run_section
from tests.unit.env.coins import RULES, loaded
from tests.unit.env.test_agents import HALLS, opened

pytest.importorskip("pettingzoo")  # modules are imported in `make test`, too, for their doctests

with warnings.catch_warnings():  # its tests import an environment of its own in a way that it calls old
    warnings.simplefilter("ignore", DeprecationWarning)
    from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test, seed_test
    from pettingzoo.utils import parallel_to_aec

CHASE = """
    {how}
    agent coin : Coin {{
        action hold = grab(hand, coin, value) reward value else reward -1.0
        action lose = lose(coin)
        action flip = 0.5: turnOver(coin) | 0.25: turnBack(coin)
        each step reward 0.5
        observe coin.side
    }}
    agent fist : Hand {{
        action drop = drop(fist) reward 3.0
        action add(n : 1..2) = count(fist, n)
        observe fist.moves in 0..3
        observe find held(fist, _)
    }}
    on find held(hand, other) reward other.value * 0.1
    on neg find up(_) reward 10.0 terminate success
    observe find up(_)
"""
"""Two blocks; coins may be lost for good."""

KNOWN = (
    "We recommend agents to be named in the format",  # they are named by their keys
    "Observation is not a NumPy array",  # of Discrete
    "Observation numpy array is all zeros",  # a state like any other
    "Observation space for each agent probably should be",  # of MultiDiscrete
)


def coins(how: str = "") -> Simulator:
    rules = RULES.replace("rule lose", "@semantics(spo) rule lose")
    return Simulator(*loaded(CHASE.format(how=how), texts={"coins.rules": rules}))


@pytest.fixture
def together(tmp_path: Path) -> Path:
    """The warehouse, with robots that act together."""
    copytree(bundled_domain("warehouse"), tmp_path / "halls")
    file = tmp_path / "halls" / "warehouse.environment"
    file.write_text(file.read_text().replace("    agent robot", "    agents together\n    agent robot"))
    return tmp_path / "halls"


def without_other_warnings(test: Callable[[], None]) -> None:
    """Run a test of PettingZoo, whose warnings are those that we know of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        test()
    told = {str(one.message) for one in caught}
    assert [text for text in told if not text.startswith(KNOWN)] == []


@pytest.mark.parametrize("observation", ["index", "multi"])
def test_turns_are_an_aec_environment(observation: Any) -> None:
    env = envgraph.make_aec(domain="warehouse", observation=observation, max_episode_steps=70)
    without_other_warnings(lambda: api_test(env, num_cycles=300))
    env.close()
    without_other_warnings(lambda: api_test(TurnEnv(coins(), observation=observation, limit=50), num_cycles=300))


@pytest.mark.parametrize("observation", ["index", "multi"])
def test_acting_together_is_a_parallel_environment(together: Path, observation: Any) -> None:
    env = envgraph.make_parallel(domain=together, observation=observation, max_episode_steps=70)
    without_other_warnings(lambda: parallel_api_test(env, num_cycles=300))
    env.close()
    env = TogetherEnv(coins("agents together"), observation=observation, limit=50)
    without_other_warnings(lambda: parallel_api_test(env, num_cycles=300))


def test_a_parallel_environment_becomes_an_aec_one(together: Path) -> None:
    env = parallel_to_aec(envgraph.make_parallel(domain=together, max_episode_steps=40))
    without_other_warnings(lambda: api_test(env, num_cycles=100))


def test_a_seed_has_one_result(together: Path) -> None:
    without_other_warnings(lambda: seed_test(lambda: TurnEnv(coins(), limit=50), num_cycles=50))
    without_other_warnings(
        lambda: parallel_seed_test(lambda: TogetherEnv(coins("agents together"), limit=50), num_cycles=50)
    )


def test_turns_are_those_of_the_single_environment() -> None:
    env, same = TurnEnv(coins(), observation="multi"), EnvgraphLiveEnv(coins(), observation="multi")
    actions = np.random.default_rng(2)
    for seed in range(30):
        env.reset(seed=seed)
        seen, info = same.reset(seed=seed)
        for _ in range(60):
            agent = env.agent_selection
            assert agent == info["agent"] and not env.terminations[agent]
            assert np.array_equal(env.observe(agent), seen)
            action = actions.integers(env.action_space(agent).n)
            env.step(action)
            seen, reward, ended, _, info = same.step(action)
            if agent in env.rewards:
                assert env.rewards[agent] == reward
            while env.agents and env.terminations[env.agent_selection]:  # coins that are lost
                env.step(None)
            if ended or not env.agents:
                break


def test_each_gets_its_own_reward_and_observation_of_a_step_together() -> None:
    hall = HALLS[1]
    env = TogetherEnv(Simulator(*opened(hall.text(), together=True)), observation="multi")
    seen, _ = env.reset(seed=0)
    assert seen["a"].tolist() == [0, 2, 3, 0, 3, 0, 3] and seen["b"].tolist() == [3, 2, 3, 0, 3, 0, 3]
    assert env.state().tolist() == [*seen["a"], *seen["b"]] and env.state_space.contains(env.state())
    lift = env.action_names.index("lift")
    seen, rewards, ended, cut, infos = env.step({"a": lift, "b": 0})  # b goes west
    assert rewards == {"a": pytest.approx(0.99), "b": pytest.approx(-0.01)}
    assert seen["a"].tolist() == [0, 0, 3, 0, 2, 4, 3] and seen["b"].tolist() == [2, 2, 2, 0, 2, 4, 3]
    assert not any((*ended.values(), *cut.values())) and infos["a"] == {"step": 1, "success": False}


def test_one_whose_object_is_deleted_is_terminated_and_the_others_go_on() -> None:
    env = TogetherEnv(coins("agents together"))
    env.reset(seed=0)
    lose, hold = env.action_names.index("lose"), env.action_names.index("hold")
    _, rewards, ended, _, _ = env.step({name: lose if name == "b" else hold for name in env.agents})
    assert ended == {"a": False, "b": True, "c": False, "fist 0": False}
    assert rewards["b"] == pytest.approx(0.9) and env.agents == ["a", "c", "fist 0"]
    seen, *_ = env.step(dict.fromkeys(env.agents, hold))
    assert set(seen) == {"a", "c", "fist 0"}

    turns = TurnEnv(coins())
    turns.reset(seed=0)
    order = []
    for agent in turns.agent_iter(8):
        *_, terminated, _, _ = turns.last()
        order.append((agent, terminated))
        turns.step(None if terminated else lose if agent == "b" else hold)
    assert order[:4] == [("a", False), ("b", False), ("b", True), ("c", False)]
    assert order[4:] == [("fist 0", False), ("a", False), ("c", False), ("fist 0", False)]


def test_the_limit_truncates_for_all() -> None:
    env = TurnEnv(coins(), limit=3)
    env.reset(seed=0)
    for _ in range(3):
        env.step(env.action_names.index("hold"))
    assert all(env.truncations.values()) and not any(env.terminations.values())
    for _ in range(4):
        env.step(None)
    assert env.agents == []


def test_pictures_are_those_of_the_single_environment() -> None:
    hall = bundled_domain("warehouse")  # its files are enough, without the family
    model, environment = hall / "small_hall.model", hall / "warehouse.environment"
    env = envgraph.make_aec(model=model, environment=environment, render_mode="ansi")
    same = envgraph.make(domain="warehouse", render_mode="ansi", engine="live")
    env.reset(seed=0)
    same.reset(seed=0)
    env.step(2)
    same.step(2)
    assert env.render() == same.render()


def test_environments_of_another_kind_are_refused(together: Path) -> None:
    with pytest.raises(InvalidArgument, match=r"act together; use `envgraph\.make_parallel`"):
        envgraph.make_aec(domain=together)
    with pytest.raises(InvalidArgument, match=r"take turns; use `envgraph\.make_aec`"):
        envgraph.make_parallel(domain="warehouse")
    with pytest.raises(InvalidArgument, match="has no `agent` blocks"):
        envgraph.make_aec(domain="keydoor")
    with pytest.raises(InvalidArgument, match='see no "graph"; use "flat", "dict" or "text"'):
        envgraph.make_aec(domain="warehouse", observation="graph")
    env = envgraph.make_parallel(domain=together)
    env.reset(seed=0)
    with pytest.raises(InvalidArgument, match="`actions` has no action for `right`"):
        env.step({"left": 0})
    with pytest.raises(InvalidArgument, match=r"action 7 of `right` is not in 0\.\.6"):
        env.step({"left": 0, "right": 7})


def test_the_examples_of_the_documentation_learn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    pytest.importorskip("supersuit")
    said = run_section("howto/pettingzoo.md", {}, last="```sh skip")
    assert said == ["['left', 'right'] Discrete(7) -0.01\n"]
    assert run_example("independent_learners.py", "hall") == "success after 6 steps\n"
    assert run_example("self_play.py", "hall").startswith("success after ")


def test_the_nurses_of_the_tutorial_get_rewards_of_their_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    played = run_section("tutorials/clinic.md", {}, "## 1. Write objects", "## 5. Make a family")
    assert "{'day': 0.0, 'night': -0.1} False" in played[-1]


@pytest.mark.parametrize("made", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_copies_go_on_as_the_original_does_and_leave_it_alone(together: Path, made: Any) -> None:
    def played(env: Any, steps: int) -> list[object]:
        rng, found = np.random.default_rng(2), list[object]()
        for _ in range(steps):
            if not env.agents:
                env.reset()
            if isinstance(env, TogetherEnv):
                found.append(env.step({name: int(rng.integers(5)) for name in env.agents}))
            else:
                env.step(None if env.last()[2] or env.last()[3] else int(rng.integers(5)))
                found.append((env.agent_selection, env.rewards, env.terminations, env.infos, [*env.agents]))
            found.append(env.state().tolist())
        return found

    for env in (
        envgraph.make_parallel(domain=together, max_episode_steps=9),
        envgraph.make_aec(domain="warehouse", max_episode_steps=9),
        TurnEnv(coins()),
    ):
        env.reset(seed=0)
        played(env, 5)
        copies = [made(env), made(made(env))]
        assert str([played(one, 30) for one in copies]) == str(2 * [played(env, 30)])


@pytest.mark.parametrize("kind", [TurnEnv, TogetherEnv])
def test_all_agents_are_truncated_together_and_know_what_each_can_do(kind: Any) -> None:
    how = "agents together" if kind is TogetherEnv else ""
    own = "action turn = turnOver(me)\naction back = turnBack(me)\nobserve me.side"
    clauses = f"{how}\nagent me : Coin {{ {own} }}\non find any(hand) truncate"
    env = kind(Simulator(*loaded(clauses)), action_masks=True)
    begun = env.reset(seed=1)
    told = begun[1] if begun else env.infos
    assert {name: info["action_mask"].tolist() for name, info in told.items()} == {
        "a": [1, 0],
        "b": [1, 0],
        "c": [0, 1],
    }
    if kind is TogetherEnv:
        _, _, terminations, truncations, infos = env.step(dict.fromkeys("abc", 0))
    else:
        env.step(0)
        terminations, truncations, infos = env.terminations, env.truncations, env.infos
    assert truncations == dict.fromkeys("abc", True)
    assert terminations == dict.fromkeys("abc", False)
    assert infos["a"]["action_mask"].tolist() == [0, 1]


LOADERS = {
    "load.metamodel": "metamodel load\n@key(name) class Arm { string name int lifted = 0 }",
    "load.model": 'import "load.metamodel"\nmodel m : load { a : Arm { name = "a" } b : Arm { name = "b" } }',
    "load.query": 'package load\nimport "load.metamodel"\npattern up(arm : Arm) { Arm.lifted(arm, 1); }',
    "load.rules": """package load
import "load.query"
rule lift(arm : Arm) { lhs { check arm.lifted < 1; } modify { set arm.lifted += 1; } }
rule hire { lhs { neg find up(_); } modify { create extra : Arm { name = "c", lifted = 1 }; } }""",
    "load.environment": """import "load.rules"
environment Load {
    {how}
    agent arm : Arm { action lift = lift(arm)  observe other.lifted in 0..1 for other : Arm }
}""",
    "family.toml": 'name = "Load"\nmodel = "load.model"\nenvironment = "load.environment"\n'
    'measures.up = { kind = "count", of = "up" }\ndiversity = { kind = "variance", of = "up" }\n'
    'mutation.rules = ["{rule}"]\nsearch = { population = 2, generations = 20 }\n',
}


def family_of_arms(folder: Path, how: str, rule: str) -> Path:
    """A family whose other members differ by a rule."""
    for name, text in LOADERS.items():
        (folder / name).write_text(text.replace("{how}", how).replace("{rule}", rule))
    write = envgraph.search.write_family
    (folder / "load.json").write_text(write(envgraph.search.generate(str(folder), folder / "run.sqlite")))
    return folder / "load.json"


@pytest.mark.parametrize("how", ["agents together", ""])
def test_a_reset_goes_over_to_a_variant_and_refuses_other_options(tmp_path: Path, how: str) -> None:
    make = envgraph.make_parallel if how else envgraph.make_aec
    env = make(family_of_arms(tmp_path, how, "lift"), observation="multi")

    def reset(**options: object) -> Any:
        found = env.reset(seed=0, options=options)
        seen, infos = found or ({name: env.observe(name) for name in env.agents}, env.infos)
        return seen["a"].tolist(), infos["a"]["variant"], infos["b"]["certificates"]

    assert reset() == ([0, 0], "E2", {})
    assert reset(variant="E1") == ([1, 1], "E1", {}) == reset()
    other = pickle.loads(pickle.dumps(env))
    other.reset(seed=0)
    assert other.observe("a").tolist() == [1, 1]
    with pytest.raises(InvalidArgument, match="`E99`"):
        reset(variant="E99")
    for name in ("state", "nonsense"):
        with pytest.raises(InvalidArgument, match=f"unknown reset option `{name}`: the options are `variant`"):
            reset(**{name: 1})


def test_a_variant_with_other_agents_is_another_environment(tmp_path: Path) -> None:
    env = envgraph.make_aec(family_of_arms(tmp_path, "", "hire"))
    with pytest.raises(InvalidArgument, match="this environment has the agents `a`, `b`, but that"):
        env.reset(options={"variant": "E1"})
    with pytest.raises(InvalidArgument, match="unknown reset option `variant`: this environment cannot"):
        envgraph.make_aec(domain="warehouse").reset(options={"variant": "E1"})


def test_agents_observe_texts_of_their_own() -> None:
    env, single = (make(domain="warehouse", observation="text") for make in (envgraph.make_aec, envgraph.make))
    env.reset(seed=0)
    seen, _ = single.reset(seed=0)
    for step in range(20):
        agent = env.agent_selection
        assert env.observe(agent) == seen
        assert seen in env.observation_space(agent)
        other = next(name for name in env.agents if name != agent)
        assert f"agent: {other}\n" in env.observe(other)
        action = step * 3 % 7
        env.step(action)
        seen = single.step(action)[0]
