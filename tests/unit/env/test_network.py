"""The routing network: chance, outputs, a start distribution, and more states than anyone wants to enumerate."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
import pytest
from gymnasium.wrappers import TimeLimit

from envgraph.env import Behaviour, EnvgraphLiveEnv, Simulator, explore, scene_of, scene_text
from envgraph.errors import EvaluationError
from envgraph.lang import TextFiles, bundled_domain, load_workspace
from envgraph.rewrite import Engine

FILES = bundled_domain("network")
CITIES = ("Amsterdam", "Berlin", "Budapest", "Geneva", "Lisbon")


def loaded() -> tuple[Engine, Behaviour]:
    texts = {path.name: path.read_text() for path in FILES.glob("*.*") if path.suffix != ".toml"}
    workspace = load_workspace(["backbone.model", "network.environment"], files=TextFiles(texts))
    return workspace.engine(), workspace.behaviour()


def test_there_is_one_send_action_per_router_in_name_order() -> None:
    simulator = Simulator(*loaded())
    assert simulator.action_names == tuple(f"send({city})" for city in CITIES)
    assert simulator.observation_shape == (5, 5, 18)


def test_reset_samples_two_different_routers_as_source_and_destination() -> None:
    simulator = Simulator(*loaded())
    seen = []
    for probability in simulator.reset_outcomes():
        assert probability == pytest.approx(1 / 20)
        seen.append(simulator.observe())
    assert sorted(seen) == [a + 5 * b for b in range(5) for a in range(5) if a != b]


def test_hop_has_the_expected_outcomes_and_probabilities() -> None:
    # At Amsterdam, for Lisbon. A hop to Geneva takes 8.2; afterwards one of nine links fails with probability 0.02 ...
    simulator = Simulator(*loaded())
    found: dict[tuple[float, int], list[float]] = defaultdict(list)
    for probability, reward, _ in simulator.outcomes(3):
        found[reward, simulator.observe()].append(probability)
    assert list(found) == [(-8.2, 3 + 5 * 4 + 25 * 1)]
    (probabilities,) = found.values()
    # ... no link is down that could recover, and with 0.88 nothing happens.
    assert probabilities == pytest.approx([0.02 / 9] * 9 + [0.1, 0.88])


def test_a_hop_without_a_link_costs_and_changes_nothing() -> None:
    simulator = Simulator(*loaded())
    found = {(reward, end, simulator.observe()) for _, reward, end in simulator.outcomes(4)}
    assert found == {(-5.0, 0, 0 + 5 * 4)}


def test_delivery_ends_in_success() -> None:
    simulator = Simulator(*loaded())
    engine = simulator.engine
    engine.model["parcel"].destination = engine.model["gva"]
    assert {(round(reward, 9), end) for _, reward, end in simulator.outcomes(3)} == {(91.8, 1)}


def test_links_that_are_down_carry_nothing_and_recover() -> None:
    simulator = Simulator(*loaded())
    for link in simulator.engine.model.nodes("Link"):
        link.up = False
    outcomes = list(simulator.outcomes(3))
    assert {reward for _, reward, _ in outcomes} == {-5.0}
    assert [round(p, 9) for p, _, _ in outcomes] == [0.02, *[round(0.1 / 9, 9)] * 9, 0.88]


def test_network_can_be_stepped_but_has_too_many_states_to_enumerate() -> None:
    engine, behaviour = loaded()
    with pytest.raises(EvaluationError, match="which need no table"):
        explore(engine, behaviour, limit=500)
    assert behaviour.limit == 64
    env = TimeLimit(EnvgraphLiveEnv(Simulator(engine, behaviour), render_mode="ansi"), behaviour.limit)
    rng = np.random.default_rng(0)
    ends = {"delivered": 0, "lost": 0, "late": 0}
    env.reset(seed=5)
    for _ in range(3000):
        observation, reward, terminated, truncated, info = env.step(int(rng.integers(5)))
        assert observation in env.observation_space
        assert reward in (-5.0, 95.0) or -15.0 <= float(reward) <= 94.0
        if terminated or truncated:
            ends["late" if truncated else "delivered" if info["success"] else "lost"] += 1
            env.reset()
    assert ends["delivered"] > 50
    assert ends["lost"] + ends["late"] > 0


def test_the_network_is_drawn_without_its_packet_as_an_edge() -> None:
    engine, behaviour = loaded()
    assert behaviour.draw is not None
    assert scene_text(scene_of(engine.model, behaviour.draw, behaviour.parameters)).splitlines() == [
        "(Amsterdam) -> Berlin (6.5), Geneva (8.2)",
        " Berlin     -> Amsterdam (6.5), Budapest (9)",
        " Budapest   -> Berlin (9)",
        " Geneva     -> Amsterdam (8.2), Lisbon (14), Budapest (11.1)",
        "(Lisbon)    -> Geneva (14)",
        "packet, destination: Lisbon",
        "packet: Amsterdam",
    ]
