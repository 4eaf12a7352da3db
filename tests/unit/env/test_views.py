"""Observations as vectors, dictionaries, images and graphs."""

from __future__ import annotations

import copy
import pickle
import sys
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.spaces.utils import flatten
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import FrameStackObservation, TimeLimit

import envgraph
from envgraph.env import (
    EnvgraphEnv,
    EnvgraphLiveEnv,
    EnvgraphVectorEnv,
    GraphView,
    ImageView,
    ObservationKind,
    PaddedGraphView,
    Simulator,
    explore,
    torch_graph,
)
from envgraph.env.compiled import CompiledEnv, CompiledVectorEnv, program_of
from envgraph.errors import EvaluationError, InvalidArgument
from envgraph.lang import load_workspace
from envgraph.rewrite import Engine
from tests.unit.env.coins import loaded
from tests.unit.env.test_vector import same

SEEN = """
action turn = 0.5: turn()
action grab(coin : Coin) = grab(hand, coin, _)
on reset apply turn()
observe hand.holds among Coin or none
observe coin.side for coin : Coin
observe count find up(_) up to 2
"""
PLAIN = ("flat", "dict")
NAMES = ("hand holds", "coin[a] side", "coin[b] side", "coin[c] side", "count up(_)")


def maze(model: str | None = None) -> tuple[Engine, Any]:
    workspace = load_workspace(["keydoor"])
    return workspace.engine(model or workspace.models[0].model.name), workspace.behaviour()


def test_flat_observation_is_one_hot_and_dict_observation_has_names() -> None:
    engine, behaviour = loaded(SEEN)
    table = explore(engine, behaviour).tabular
    assert table.observation_names == NAMES
    multi, flat, named = (EnvgraphEnv(table, observation=kind) for kind in ("multi", "flat", "dict"))  # type: ignore[arg-type]
    assert named.observation_space == spaces.Dict(
        {name: spaces.Discrete(size) for name, size in zip(NAMES, (4, 2, 2, 2, 3), strict=True)}
    )
    first = [env.reset(seed=3)[0] for env in (multi, flat, named)]
    for seen in (first, [env.step(2)[0] for env in (multi, flat, named)]):
        assert seen[1].tolist() == flatten(multi.observation_space, seen[0]).tolist()
        assert seen[1].dtype == np.float32
        assert [*seen[2].values()] == seen[0].tolist()
    first[1][:] = 7.0
    first[2]["hand holds"] = 9
    assert flat.reset(seed=3)[0].max() == 1.0, "each observation is an object of its own"
    assert named.reset(seed=3)[0]["hand holds"] == 3


@pytest.mark.parametrize("kind", PLAIN)
def test_observations_agree_between_tables_programs_and_the_live_engine(kind: ObservationKind) -> None:
    engine, behaviour = loaded(SEEN)
    program = program_of(engine, behaviour, native=False)
    table = explore(engine, behaviour).tabular
    envs = [
        EnvgraphEnv(table, observation=kind),
        CompiledEnv(program, observation=kind),
        EnvgraphLiveEnv(Simulator(engine, behaviour), observation=kind),
    ]
    for env in envs:
        check_env(env, skip_render_check=True)
    many = [
        EnvgraphVectorEnv(table, 3, observation=kind),
        CompiledVectorEnv(program, 3, observation=kind),
    ]
    assert_same([env.reset(seed=1)[0] for env in envs])
    assert_same([env.reset(seed=1)[0] for env in many])
    for action in (0, 2, 0, 3):
        assert_same([env.step(action)[0] for env in envs])
        seen = [env.step(np.full(3, action))[0] for env in many]
        assert_same(seen)
        assert seen[0] in many[0].observation_space
    assert copy.deepcopy(envs[0]).step(1)[4] == pickle.loads(pickle.dumps(envs[0])).step(1)[4]


def assert_same(seen: list[Any]) -> None:
    for other in seen[1:]:
        parts = (one.items() if isinstance(one, dict) else enumerate(one) for one in (seen[0], other))
        for (name, mine), (other_name, theirs) in zip(*parts, strict=True):
            assert name == other_name
            assert np.array_equal(mine, theirs)
            assert np.asarray(mine).dtype == np.asarray(theirs).dtype


def test_an_image_has_a_plane_for_each_class_and_each_clause() -> None:
    engine, behaviour = maze()
    view = ImageView(behaviour, [engine.model])
    channels = ("Wall", "Floor", "Exit", "Door", "Key", "Hero", "hero at", "holds(hero, ::red)")
    assert view.channels == (*channels, "count holds(hero, _)", "door open")
    assert view.space == spaces.Box(0, 255, (5, 7, 10), np.uint8)
    simulator = Simulator(engine, behaviour)
    planes = dict(zip(view.channels, np.moveaxis(view.observe(simulator), -1, 0), strict=True))
    door = engine.model.nodes("Door")[0]
    assert np.argwhere(planes["Hero"]).tolist() == np.argwhere(planes["hero at"]).tolist() == [[1, 1]]
    assert (planes["Wall"][[0, -1]] == 255).all()
    assert np.argwhere(planes["door open"]).tolist() == [[door.y, door.x]]
    assert planes["door open"][door.y, door.x] == 127, "closed, not absent"
    assert not planes["count holds(hero, _)"].any()
    with engine.transaction():
        door.open = True
        key = engine.model.nodes("Key")[0]
        key.cell = None
        engine.model.nodes("Hero")[0].inventory.append(key)
    planes = dict(zip(view.channels, np.moveaxis(view.observe(simulator), -1, 0), strict=True))
    assert planes["door open"][door.y, door.x] == 255
    assert (planes["count holds(hero, _)"] == 127).all()
    assert not planes["Key"].any()


def test_an_image_has_the_size_of_the_largest_member() -> None:
    (small, behaviour), (large, _) = maze(), maze()
    with large.transaction():
        large.model.create("Wall", x=9, y=3)
    view = ImageView(behaviour, [small.model, large.model])
    assert view.space.shape == (5, 10, 10)
    image = view.observe(Simulator(small, behaviour))
    assert not image[:, 7:].any()
    assert image in view.space
    with pytest.raises(InvalidArgument, match="has no image, because it draws no grid; write `draw grid"):
        ImageView(load_workspace(["network"]).behaviour("Routing"), [small.model])


def test_a_graph_has_the_objects_and_links_of_the_model() -> None:
    engine, behaviour = maze()
    view, model = GraphView(behaviour, engine.model.metamodel), engine.model
    graph = view.observe(Simulator(engine, behaviour))
    assert graph in view.space
    columns = dict(zip(view.features, graph.nodes.T, strict=True))
    assert columns["Door"].sum() == 1
    assert columns["hero"].tolist() == columns["Hero"].tolist()
    door = int(np.argmax(columns["Door"]))
    assert (columns["Door.open?"][door], columns["Door.open"][door]) == (1.0, 0.0)
    assert columns["Door.open?"].sum() == 1, "others have none"
    assert columns["Cell.x"][door] == model.nodes("Door")[0].x
    links = graph.edge_links[graph.edges == view.references.index("Hero.at")]
    assert columns["Hero"][links[:, 0]].tolist() == [1.0]
    assert (columns["Cell.x"][links[0, 1]], columns["Cell.y"][links[0, 1]]) == (1.0, 1.0)


@pytest.mark.parametrize("kind", ["image", "graph"])
def test_images_and_graphs_are_the_same_from_programs_and_the_live_engine(kind: ObservationKind) -> None:
    engine, behaviour = maze()
    program = program_of(*maze(), native=False)
    envs = [
        CompiledEnv(program, observation=kind),
        EnvgraphLiveEnv(Simulator(engine, behaviour), observation=kind),
    ]
    many = CompiledVectorEnv(program, 2, observation=kind, streams="each")
    seen = [env.reset(seed=0)[0] for env in envs]
    both = many.reset(seed=0)[0]
    for action in (1, 2, 3, 0, 1, 1, 4, 1):
        for other in (seen[1], both[0], both[1]):
            assert_same([[*seen[0]], [*other]])
        assert seen[0] in envs[0].observation_space
        assert both in many.observation_space
        seen = [env.step(action % len(program.action_names))[0] for env in envs]
        both = many.step(np.full(2, action % len(program.action_names)))[0]


def test_padded_graph_holds_the_graph_and_has_the_size_of_the_largest_member() -> None:
    (small, behaviour), (large, _) = maze(), maze()
    with large.transaction():
        large.model.create("Wall", x=9, y=3)
    view = PaddedGraphView(behaviour, [small.model, large.model])
    graph: Any = GraphView(behaviour, small.model.metamodel).observe(Simulator(small, behaviour))
    found = view.present(view.observe(Simulator(small, behaviour)))
    objects, links = len(graph.nodes), len(graph.edges)
    assert found in view.space
    assert (len(found["nodes"]), len(found["edges"])) == (objects + 1, len(found["edge_mask"]))
    for name, own in graph._asdict().items():
        assert np.array_equal(found[name][: len(own)], own)
        assert not found[name][len(own) :].any()
    assert found["node_mask"].tolist() == [1] * objects + [0]
    assert found["edge_mask"].tolist() == [1] * links + [0] * (len(found["edges"]) - links)
    with small.transaction():
        for x in (9, 10):
            small.model.create("Wall", x=x, y=3)
    with pytest.raises(EvaluationError, match=f"a state has {objects + 2} nodes, but .* has space for {objects + 1}"):
        view.present(view.observe(Simulator(small, behaviour)))


def test_padded_graph_has_space_for_all_links_that_rules_can_add() -> None:
    env, rng = EnvgraphLiveEnv(Simulator(*maze()), observation="padded_graph"), np.random.default_rng(0)
    env.reset(seed=0)
    links = set()
    for _ in range(60):
        observed, _, ended, _, _ = env.step(rng.choice(np.flatnonzero(env.action_masks())))
        assert observed in env.observation_space
        links.add(int(observed["edge_mask"].sum()))
        if ended:
            env.reset()
    assert len(links) > 1


@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("kind", ["index", "multi", *PLAIN, "image", "padded_graph"])
def test_history_of_a_vector_equals_that_of_single_environments(kind: ObservationKind, mode: AutoresetMode) -> None:
    program = program_of(*maze(), native=False)
    options: dict[str, Any] = {"max_episode_steps": 4, "autoreset_mode": mode}
    makers: list[Callable[[], Any]] = [
        lambda: EnvgraphLiveEnv(Simulator(*maze()), observation=kind),
        lambda: CompiledEnv(program, observation=kind),
    ]
    stacked = [partial(lambda make: TimeLimit(FrameStackObservation(make(), 3), 4), make) for make in makers]
    theirs: Any = SyncVectorEnv(stacked, autoreset_mode=mode)
    ours: list[Any] = [CompiledVectorEnv(program, 2, observation=kind, streams="each", **options)]
    if kind in ("index", "multi", *PLAIN):
        ours.append(EnvgraphVectorEnv(explore(*maze()).tabular, 2, observation=kind, **options))
    for envs in ours:
        envs.set_history(3)
        assert envs.observation_space == theirs.observation_space
    expected = theirs.reset(seed=1)
    found = [envs.reset(seed=1) for envs in ours]
    assert same(found[0], expected) and all(same(one[0], expected[0]) for one in found)
    for action in (1, 2, 3, 0, 4, 1, 1, 4, 1, 2, 8):
        actions = np.array([action, 0])
        expected, found = theirs.step(actions), [envs.step(actions) for envs in ours]
        over = expected[2] | expected[3]
        assert same(found[0], expected) and all(same(one[:4], expected[:4]) for one in found)
        if mode is AutoresetMode.SAME_STEP and over.any():
            assert all(same(one[4]["final_obs"], expected[4]["final_obs"]) for one in found)
        if mode is AutoresetMode.DISABLED and over.any():
            over = np.array([True, bool(over[1])])
            expected = theirs.reset(options={"reset_mask": over.copy()})
            found = [envs.reset(options={"reset_mask": over.copy()}) for envs in ours]
            assert same(found[0], expected) and all(same(one[0], expected[0]) for one in found)


def test_pytorch_graph_without_torch_geometric_names_the_missing_extra(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "torch_geometric.data", None)
    with pytest.raises(InvalidArgument, match=r"pip install .envgraph\[pyg\]"):
        torch_graph(spaces.GraphInstance(np.zeros((0, 1)), None, None))


def test_kinds_of_observations_are_checked() -> None:
    with pytest.raises(InvalidArgument, match="unknown kind of observation 'imag'; did you mean `image`"):
        envgraph.make(domain="keydoor", observation="imag")
    with pytest.raises(InvalidArgument, match="`history` is 0, but must be an int of at least 1"):
        envgraph.make(domain="keydoor", history=0)
    with pytest.raises(InvalidArgument, match=r'observations of one size; use `observation="padded_graph"`'):
        envgraph.make_vec(domain="keydoor", history=2, observation="graph")
    with pytest.raises(InvalidArgument, match='"graph" needs a model'):
        envgraph.make_vec(domain="keydoor", observation="graph", engine="table")
    with pytest.raises(InvalidArgument, match='an observation "image" is computed from the model'):
        EnvgraphEnv(explore(*loaded(SEEN)).tabular, observation="image")
    assert envgraph.make(domain="keydoor", observation="image", engine="live").reset(seed=0)[0].shape == (
        5,
        7,
        10,
    )
