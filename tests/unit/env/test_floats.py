"""Observations of floats, and of patterns for each object: spaces, values, and the same on all engines."""

from __future__ import annotations

import pickle
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

import envgraph
from envgraph.env import EnvgraphLiveEnv, FloatRange, GraphView, Simulator
from envgraph.env._flat_observations import FlatLayout
from envgraph.env._float_ranges import LARGEST_FLOAT32
from envgraph.env._observation_components import merge_sizes
from envgraph.env.compiled import CompiledEnv, Learner, program_of
from envgraph.errors import EnvgraphError, EvaluationError, LoadError
from envgraph.lang import TextFiles, load_workspace

FILES = {
    "drone.metamodel": """
metamodel drone
class Field { contains Pad[*] pads contains Drone[1] drone }
@key(x) class Pad { int x @range(-2.0, 5.0) float wind = 1.5 @range(1, 3) int parcels = 1 refers Pad[0..2] next }
class Drone { @range(0.0, 1.0) float battery = 1.0 refers Pad[1] at }
""",
    "drone.model": """
import "drone.metamodel"
model m : drone { field : Field { pads = [
    a : Pad { x = 0 next = [b] }, b : Pad { x = 1 next = [a] wind = -1.0 parcels = 9 },
    c : Pad { x = 2 next = [b] wind = 7.25 }
] drone = dr : Drone { at = a } } }
""",
    "drone.query": """
package drone
import "drone.metamodel"
pattern step(a : Drone, p : Pad) { Drone.at(a, at); Pad.next(at, p); }
pattern sees(d : Drone, p : Pad) { Drone.at(d, p); } or { find step(d, p); }
pattern empty(d : Drone) { Drone.battery(d, charge); check(charge <= 0.0); }
""",
    "drone.rules": """
package drone
import "drone.query"
rule fly(d : Drone, p : Pad) { lhs { find step(d, p); } modify { set d.at = p; set d.battery -= 0.3; } }
@semantics(spo) rule close { lhs { Pad(p); check p.x == 2; } modify { delete p; } }
""",
    "drone.environment": """
import "drone.rules"
environment Drone(drone : Drone) {
    action fly(pad : Pad) = fly(drone, pad)
    action close = close()
    on find empty(drone) terminate failure
    observe drone.battery
    observe pad.wind for pad : Pad if find sees(drone, pad)
    observe pad.parcels for pad : Pad
    observe find step(drone, pad) for pad : Pad
    observe count find step(_, pad) up to 2 for pad : Pad if find sees(drone, pad)
    observe drone.battery in 0.5..1
    draw grid Pad at (x, x)
    limit 60 steps
}
""",
    "family.toml": """
model = "drone.model"
environment = "drone.environment"
measures.empty = { kind = "count", of = "drone.empty" }
mutation.rules = ["drone.fly"]
""",
}
FULL = [
    *(1, 1.5, 0, -1, 0, -2, 1),
    *(1, 0, 0, 0, 0, 1, 1, 0, 0),
    *(1, 0, 0, 1, 1, 0),
    *(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 1),
    1,
]
"""Battery; wind, and whether it is out of sight; parcels, of 1 to 3; steps, 0 or 1; counts of 0 to 2, or hidden."""


@pytest.fixture
def domain(tmp_path: Path) -> str:
    for name, text in FILES.items():
        Path(tmp_path, name).write_text(text)
    return str(tmp_path)


def simulator(clauses: str) -> Simulator:
    lines = [line for line in FILES["drone.environment"].splitlines() if "observe" not in line and "draw" not in line]
    text = "\n".join(lines).replace("on find", f"{clauses}\n on find")
    workspace = load_workspace(
        ["drone.environment", "drone.model"], files=TextFiles({**FILES, "drone.environment": text})
    )
    return Simulator(workspace.engine(), workspace.behaviour())


def test_floats_are_entries_of_flat_observations_and_boxes_of_a_dictionary(domain: str) -> None:
    flat, parts = envgraph.make(domain=domain), envgraph.make(domain=domain, observation="dict")
    assert isinstance(flat.unwrapped, CompiledEnv), "there is no table, and floats are observed flat"
    space: Any = flat.observation_space
    assert (space.low[1:7].tolist(), space.high[1:7].tolist()) == ([-2, 0] * 3, [5, 1] * 3)
    one: Any = parts.observation_space
    assert one["drone battery"] == spaces.Box(0, 1, (1,)) and one["pad[0] parcels"] == spaces.Discrete(3)
    assert one["pad[0] step(drone, pad)"] == spaces.Discrete(2) and one["drone battery 2"].low.tolist() == [0.5]
    seen, named = flat.reset(seed=0)[0], parts.reset(seed=0)[0]
    assert seen.tolist() == np.array(FULL, np.float32).tolist()
    assert named["pad[1] wind"].tolist() == [-1, 0] and named["pad[2] wind"].tolist() == [-2, 1]


def test_floats_are_cut_to_their_range_and_rounded_to_float32(domain: str) -> None:
    env = envgraph.make(domain=domain, engine="live", disable_env_checker=True)
    env.reset(seed=0)
    for expected, cut in ((0.7, 0.7), (0.4, 0.5), (0.1, 0.5)):
        seen = env.step(0 if expected == 0.4 else 1)[0]
        battery = next(iter(env.unwrapped.simulator.engine.model.nodes("Drone"))).battery  # type: ignore[attr-defined]
        assert seen[0] == np.float32(battery) == np.float32(expected) and seen[-1] == np.float32(cut)
    assert env.step(0)[0][0] == 0.0, "below 0"


@pytest.mark.parametrize("kind", ["flat", "dict"])
def test_engines_and_vectors_observe_floats_alike(domain: str, kind: str) -> None:
    many: list[Any] = [
        envgraph.make_vec(domain=domain, num_envs=3, observation=kind, streams="each"),
        *(
            envgraph.make_vec(domain=domain, num_envs=3, observation=kind, vectorization_mode="sync", engine=engine)
            for engine in ("live", "compiled")
        ),
    ]
    many.append(deepcopy(many[0]))
    seen = [env.reset(seed=1)[0] for env in many]
    actions = np.random.default_rng(0)
    for _ in range(60):
        for other in seen[1:]:
            np.testing.assert_equal(other, seen[0])
        assert many[0].observation_space.contains(seen[0])
        chosen = actions.integers(4, size=3)
        seen = [env.step(chosen)[0] for env in many]


def test_missing_objects_are_observed_as_the_lowest_value(domain: str) -> None:
    env = envgraph.make(domain=domain, observation="dict")
    env.reset(seed=0)
    seen = env.step(3)[0]
    assert seen["pad[2] wind"].tolist() == [-2, 0], "gone is not out of sight"
    assert seen["pad[2] count step(_, pad)"] == 0 and seen["pad[2] step(drone, pad)"] == 0


def test_floats_and_patterns_have_channels_of_an_image() -> None:
    plain = "observe pad.wind for pad : Pad observe find step(drone, pad) for pad : Pad observe drone.battery in 0..2"
    made = simulator(plain + " draw grid Pad at (x, x)")
    env = EnvgraphLiveEnv(made, observation="image")
    wind, step, battery = np.moveaxis(env.reset(seed=0)[0], -1, 0)[-3:]
    assert wind.diagonal().tolist() == [round(255 * 3.5 / 7), round(255 / 7), 255]
    assert step.diagonal().tolist() == [127, 255, 127] and (battery == 128).all()


def test_floats_of_a_graph_are_cut_to_those_of_32_bits() -> None:
    made = simulator("observe drone.battery")
    view = GraphView(made.behaviour, made.engine.model.metamodel)
    with made.engine.transaction():
        next(iter(made.engine.model.nodes("Drone"))).battery = -1e300
    column = view.observe(made).nodes[:, view.features.index("Drone.battery")]
    assert column.min() == np.float32(-LARGEST_FLOAT32)


@pytest.mark.parametrize("kind", ["index", "multi"])
def test_floats_have_no_index(domain: str, kind: str) -> None:
    message = f'the float `drone battery` has no index, which an observation "{kind}" needs; use `observation="flat"`'
    with pytest.raises(EnvgraphError, match=message):
        envgraph.make(domain=domain, observation=kind)


def test_there_are_no_tables_of_floats(domain: str) -> None:
    with pytest.raises(
        EvaluationError, match="`Drone` observes the float `drone battery`, which has no index"
    ) as caught:
        envgraph.make(domain=domain, engine="table")
    assert 'use `envgraph.make` with `observation="flat"`' in str(caught.value)
    made = simulator("observe drone.battery")
    with pytest.raises(EvaluationError, match="the float `drone battery`"):
        Learner(program_of(made.engine, made.behaviour, native=False))


def test_floats_of_different_blocks_are_not_mixed() -> None:
    blocks = "agent d : Drone { observe d.battery in 0..1 } agent p : Pad { observe p.wind in 0..2 }"
    with pytest.raises(LoadError, match="each `agent` block must observe this float at the same place"):
        simulator(blocks)
    known = "agent d : Drone { observe q.x in 0..2 for q : Pad observe d.battery in 0..1 }"
    later = known + "agent p : Pad { observe e.at among Pad for e : Drone observe p.wind in 0..1 }"
    with pytest.raises(EvaluationError, match="component 2 of an observation is a float for agents of one block"):
        simulator(later)  # the number of objects is that of the model
    assert simulator(blocks.replace("0..2", "0..1")).observation_shape == (2, FloatRange(0.0, 1.0, False))
    together = simulator(f"agents together {blocks}")
    assert together.observation_shape == (FloatRange(0.0, 1.0, False), *[FloatRange(0.0, 2.0, False)] * 3)
    with pytest.raises(EvaluationError, match="component 1 of an observation is a float for agents of one block"):
        merge_sizes(together.agents.block_sizes)


def test_sizes_of_floats_can_be_copied() -> None:
    size = FloatRange(-LARGEST_FLOAT32, 0.0, True)
    for other in (deepcopy(size), pickle.loads(pickle.dumps(size))):
        assert (other, other.limits) == (size, size.limits)
    lowest = [-LARGEST_FLOAT32, 0.0]
    parts = np.array([[0], [size - 2], [size - 1]])
    assert FlatLayout([size]).encode(parts).tolist() == [lowest, [0.0, 0.0], [lowest[0], 1.0]]
