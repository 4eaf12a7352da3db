"""Observations in words: the picture, the components by name, and the actions that do something."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env

import envgraph
from envgraph.env import EnvgraphEnv, EnvgraphLiveEnv, Simulator, TextView, explore
from envgraph.errors import InvalidArgument
from envgraph.lang import load_workspace
from tests.unit.env.coins import loaded
from tests.unit.env.test_sight import load_partially_observed_coins

MAZE = """\
 #  #  #  #  #  #  #
 # (H) .  #  .  .  #
 #  . (K) #  .  X  #
 #  .  . (D) .  .  #
 #  #  #  #  #  #  #
Door 3, 3, red: column 3, row 3
Key 18, red: column 2, row 2
hero: column 1, row 1
# = Wall; . = Floor; X = Exit; D = Door; D = Door, red; H = Hero; K = Key, red
hero at: Cell[1, 1]
holds(hero, ::red): no
count holds(hero, _): 0
door[3, 3] open: no
actions: go(south), go(east)"""

COINS = """
action turn = turn()
action grab(coin : Coin) = grab(hand, coin, _)
observe hand.holds among Coin or none
observe coin.side for coin : Coin
observe hand.moves in 0..3
observe find held(hand, _)
"""

DOMAINS = ("burning_forest", "keydoor", "lava", "triage", "network/diverse.toml", "warehouse")


def test_text_has_the_picture_the_components_and_the_enabled_actions() -> None:
    env = envgraph.make(domain="keydoor", observation="text")
    check_env(env.unwrapped, skip_render_check=True)
    text, _ = env.reset(seed=0)
    assert text == MAZE
    assert text in env.observation_space
    assert "hero at: Cell[2, 1]" in env.step(1)[0]


def test_text_without_a_picture_has_components_and_actions() -> None:
    simulator = Simulator(*loaded(COINS))
    lines = TextView(simulator.behaviour).observe(simulator).splitlines()
    assert lines[0] == "hand holds: none"
    assert lines[1] == "coin[a] side: heads"
    assert lines[4:6] == ["hand moves: 0", "held(hand, _): no"]
    simulator.step_with(simulator.action_names.index("grab(b)"), 0.5)
    after = TextView(simulator.behaviour).observe(simulator).splitlines()
    assert after[0] == "hand holds: Coin[b]"
    assert after[5] == "held(hand, _): yes"
    allowed = [name for name, can in zip(simulator.action_names, simulator.action_mask(), strict=True) if can]
    assert after[-1] == f"actions: {', '.join(allowed)}"


def test_text_reveals_nothing_that_is_out_of_sight() -> None:
    engine, behaviour = load_partially_observed_coins()
    simulator = Simulator(engine, behaviour)
    lines = TextView(behaviour).observe(simulator).splitlines()
    assert lines[0] == "coin[a] side: out of sight"
    assert [line.partition(": ")[2] for line in lines[:-1]] == ["out of sight"] * 10
    assert lines[-1] == f"actions: {', '.join(simulator.action_names)}", "a mask tells where coins are"
    drawn = replace(behaviour, draw=load_workspace(["keydoor"]).behaviour().draw)
    assert TextView(drawn).observe(simulator) == "\n".join(lines), "a picture, too"


@pytest.mark.parametrize("domain", DOMAINS)
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_vectors_describe_states_as_single_environments_do(
    domain: str, mode: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("envgraph.env.compiled.programs._compiled_program.has_numba", lambda: False)  # it takes long
    options: dict[str, Any] = {"autoreset_mode": mode, "max_episode_steps": 9, "observation": "text"}
    many = envgraph.make_vec(domain=domain, num_envs=2, engine="compiled", streams="each", **options)
    singles = envgraph.make_vec(domain=domain, num_envs=2, engine="live", **options)
    assert many.observation_space == spaces.Tuple([many.single_observation_space] * 2)
    seen, wanted = many.reset(seed=3)[0], singles.reset(seed=3)[0]
    rng = np.random.default_rng(1)
    for _ in range(25):
        assert isinstance(seen, tuple)
        assert seen == wanted
        assert seen in many.observation_space
        actions = rng.integers(many.single_action_space.n, size=2)
        seen, _, _, _, infos = many.step(actions)
        wanted, _, _, _, others = singles.step(actions)
        assert infos.get("final_obs", np.zeros(0)).tolist() == others.get("final_obs", np.zeros(0)).tolist()


def test_text_of_agents_that_act_together_has_a_part_for_each_agent() -> None:
    clauses = """
    agents together
    agent me : Hand { action drop = drop(me)
        action take(coin : Coin) = grab(me, coin, _)
        observe me.holds among Coin or none }
    observe coin.side for coin : Coin
    """
    env = EnvgraphLiveEnv(Simulator(*loaded(clauses)), observation="text")
    first, *lines = env.reset(seed=0)[0].splitlines()
    assert first.startswith("agent: ")
    assert lines[0] == "me holds: none"
    assert lines[-1].startswith("actions: take(")


def test_letters_that_the_space_lacks_are_escaped() -> None:
    workspace = load_workspace(["network"])
    engine, behaviour = workspace.engine(workspace.models[0].model.name), workspace.behaviour("Routing")
    router = engine.model.nodes("Router")[0]
    with engine.transaction():
        router.name = "Zürich \u5317\n\x1b"
    view = TextView(behaviour)
    seen = view.observe(Simulator(engine, behaviour))
    assert "Zürich \\u5317\\n\\x1b" in seen
    assert seen in view.space


def test_tables_refuse_texts() -> None:
    with pytest.raises(InvalidArgument, match='"text" needs a model'):
        envgraph.make(domain="keydoor", observation="text", engine="table")
    with pytest.raises(InvalidArgument, match='an observation "text" is computed from the model'):
        EnvgraphEnv(explore(*loaded(COINS)).tabular, observation="text")
