"""Episodes that people play: the same as those of environments, with steps that can be undone."""

from __future__ import annotations

import random
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import envgraph
from envgraph.env import PlayedEpisode, Simulator
from envgraph.errors import InvalidArgument, RuleError
from envgraph.lang import data_path
from tests.unit.env.coins import simulator


def live(**given: Any) -> Simulator:
    found: Simulator = envgraph.make(engine="live", **given).unwrapped.simulator  # type: ignore[attr-defined]
    return found


@pytest.mark.parametrize("domain", ["lava", "triage", "warehouse", "network/diverse.toml"])
def test_episode_has_the_steps_of_the_environment_and_undone_steps_repeat(domain: str) -> None:
    env = envgraph.make(domain=domain, engine="live", action_masks=True)
    episode = PlayedEpisode(live(domain=domain), None, np.random.default_rng(5).random)
    model, chosen = episode.simulator.engine.model, random.Random(1)
    _, info = env.reset(seed=5)
    hashes, rewards = [model.state_hash()], list[float]()
    while not episode.end and len(episode.steps) < 40:
        assert episode.allowed == [bool(one) for one in info["action_mask"]]
        assert episode.agent == info.get("agent", "")
        if episode.steps and chosen.random() < 0.3:
            action = episode.steps[-1].action
            assert episode.undo() and model.state_hash() == hashes[-2]
            step = episode.choose(action)
            assert step and (step.reward, model.state_hash()) == (rewards[-1], hashes[-1])
        action = chosen.choice([number for number, one in enumerate(episode.allowed) if one])
        step = episode.choose(action)
        _, reward, terminated, truncated, info = env.step(action)
        assert step and (step.reward, step.end != 0) == (reward, terminated or truncated)
        hashes.append(model.state_hash())
        rewards.append(step.reward)
    assert len(episode.steps) > 1 and episode.totals[-1] == sum(rewards)
    for wanted in reversed(hashes[:-1]):
        assert episode.undo() and model.state_hash() == wanted
    assert not episode.undo()
    model.graph.check_integrity()


def test_end_is_explained_by_the_clauses_that_caused_it() -> None:
    episode = PlayedEpisode(live(domain="burning_forest"), 3, random.Random(0).random)
    for key in ("ArrowRight", "ArrowLeft", "ArrowRight"):
        step = episode.choose(episode.bindings[key])
    assert step and (step.end, step.reason) == (-1, "limit 3 steps")
    with pytest.raises(InvalidArgument, match="the episode is over; undo the last step, or restart"):
        episode.choose(0)
    assert episode.allowed == [False] * 4
    episode.restart()
    assert (episode.steps, episode.end, len(episode.uniforms)) == ([], 0, 1)


def test_reason_is_the_text_of_each_clause_with_a_match() -> None:
    clauses = (
        "on find held(hand, coin) terminate failure\non neg find up(_) truncate\non find   any(hand) terminate failure"
    )
    episode = PlayedEpisode(
        simulator("action grab(coin : Coin) = grab(hand, coin, _)\n" + clauses), None, random.Random(0).random
    )
    step = episode.choose(0)
    assert step and step.reason == "on find held(hand, coin) terminate failure; on find any(hand) terminate failure"


def test_step_that_raises_an_error_changes_nothing() -> None:
    engine = simulator("action grab(coin : Coin) = grab(hand, coin, _)\naction lose(coin : Coin) = lose(coin)")
    episode = PlayedEpisode(engine, None, random.Random(0).random)
    episode.choose(0)
    before = engine.engine.model.state_hash()
    with pytest.raises(RuleError, match="lose"):
        episode.choose(3)
    assert engine.engine.model.state_hash() == before and len(episode.steps) == 1
    assert episode.undo() and episode.choose(3)


def test_agents_that_act_together_choose_one_after_the_other(tmp_path: Path) -> None:
    place = shutil.copytree(data_path("rules") / "warehouse", tmp_path / "warehouse")
    text = (place / "warehouse.environment").read_text().replace("limit 300", "agents together\n    limit 300")
    (place / "warehouse.environment").write_text(text)
    given: dict[str, Any] = {"model": place / "small_hall.model", "environment": place / "warehouse.environment"}
    episode = PlayedEpisode(live(**given), None, random.Random(0).random)
    agents = [agent.name for agent in episode.simulator.agents.prepared_agents]
    right, wait = episode.bindings["ArrowRight"], episode.bindings[" "]
    assert len(agents) > 1
    for agent in agents[:-1]:
        assert episode.agent == agent
        assert episode.choose(right) is None
    assert episode.undo() and episode.agent == agents[0] and not episode.undo()
    for agent in agents:
        step = episode.choose(right if agent == agents[0] else wait)
    assert step and step.name == ", ".join(f"{one}: {'go(east)' if one == agents[0] else 'wait'}" for one in agents)
    env = envgraph.make(engine="live", **given).unwrapped
    env.reset()
    assert env.action_names[step.action] == step.name  # type: ignore[attr-defined]
