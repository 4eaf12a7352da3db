"""Windows around an object, and images and graphs of what agents see; live and compiled."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from envgraph.behaviour import Behaviour
from envgraph.env import EnvgraphLiveEnv, GraphView, ImageView, ObservationKind, PaddedGraphView, Simulator
from envgraph.env.compiled import CompiledEnv, CompiledVectorEnv, program_of
from envgraph.errors import InvalidArgument
from envgraph.lang import TextFiles, bundled_domain, load_workspace
from envgraph.rewrite import Engine
from tests.unit.env.corners.windows import CORNERS, RULES
from tests.unit.env.corners.yard import Yard

SEES = """
pattern sees(hero : Hero, cell : Cell) { Hero.at(hero, here); Cell.x(here, x); Cell.x(cell, x); }
pattern near(hero : Hero, door : Door) { Hero.at(hero, here); Cell.east(here, door); } or { Hero.at(hero, door); }
"""
AROUND = "observe around hero 5 x 3"
SEEN = f"{AROUND} if find sees(hero, cell)"
LOOKS = ["", "Wall", "Floor", "Exit", *(f"Door {colour}{is_open}" for colour in "rgb" for is_open in ("", " open"))]


def keydoor(observed: str) -> tuple[Engine, Behaviour]:
    """Return the two rooms of keydoor; a first clause says what the hero observes."""
    files = {path.name: path.read_text("utf-8") for path in bundled_domain("keydoor").iterdir() if path.is_file()}
    files["keydoor.query"] += SEES
    files["keydoor.environment"] = files["keydoor.environment"].replace("observe hero.at among Cell", observed)
    workspace = load_workspace(["two_rooms.model", "keydoor.environment"], files=TextFiles(files))
    return workspace.engine(), workspace.behaviour()


def components(simulator: Simulator) -> list[int]:
    """Return the components of the current observation."""
    index, found = simulator.observe(), list[int]()
    for size in simulator.observation_shape:
        index, value = divmod(index, size)
        found.append(value)
    return found


def expected(model: Any, width: int, height: int) -> Iterator[tuple[str, str]]:
    """Yield what stands on each place around the hero, row by row: a cell and an object, in plain Python."""
    at = {(cell.x, cell.y): cell for cell in model.nodes("Cell")}
    (hero,) = model.nodes("Hero")
    for y in range(hero.at.y - height // 2, hero.at.y + height // 2 + 1):
        for x in range(hero.at.x - width // 2, hero.at.x + width // 2 + 1):
            cell = at.get((x, y))
            if cell is None:
                yield "", ""
                continue
            look = cell.cls if cell.cls != "Door" else f"Door {cell.colour[0]}{' open' if cell.open else ''}"
            yield look, "hero" if hero.at == cell else cell.item.colour if cell.item is not None else ""


def test_a_window_shows_cells_and_objects_by_their_looks() -> None:
    engine, behaviour = keydoor(AROUND)
    simulator, rng = Simulator(engine, behaviour), np.random.default_rng(0)
    assert simulator.observation_shape[:30] == (10, 5) * 15, (
        "3 classes, doors of 3 colours, closed or open; 3 keys, 1 hero"
    )
    assert simulator.observation_names[:3] == (
        "around hero -2 -1 cell",
        "around hero -2 -1 object",
        "around hero -1 -1 cell",
    )
    objects = ["", "red", "green", "blue", "hero"]
    simulator.reset(rng)
    opened = 0
    for _ in range(300):
        seen = components(simulator)[:30]
        wanted = [(LOOKS.index(cell), objects.index(item)) for cell, item in expected(engine.model, 5, 3)]
        assert [*zip(seen[::2], seen[1::2], strict=True)] == wanted
        opened += LOOKS.index("Door r open") in seen[::2]
        simulator.step(int(rng.integers(len(simulator.action_names))), rng)
    assert opened > 0


def test_cells_out_of_sight_have_a_number_and_hide_objects() -> None:
    engine, behaviour = keydoor(SEEN)
    simulator = Simulator(engine, behaviour)
    seen = components(simulator)
    assert simulator.observation_shape[0] == 11
    assert seen[:30:2] == [0, 1, 2, 1, 1, 0, 1, 3, 1, 1, 0, 1, 3, 1, 1], (
        "0 outside, 1 out of sight, 2 a wall, 3 the floor"
    )
    assert seen[1:30:2] == [0] * 7 + [4] + [0] * 7, "no key: it is out of sight"


def test_an_image_is_cropped_to_the_window() -> None:
    planes = {}
    for clause in (AROUND, SEEN):
        engine, behaviour = keydoor(clause)
        view = ImageView(behaviour, [engine.model])
        assert view.space.shape == (3, 5, 9)
        assert "around hero" not in view.channels
        image = view.observe(Simulator(engine, behaviour))
        planes[clause] = dict(zip(view.channels, np.moveaxis(image, -1, 0), strict=True))
    assert np.argwhere(planes[AROUND]["Hero"]).tolist() == [[1, 2]], "in the middle"
    assert np.argwhere(planes[AROUND]["Key"]).tolist() == [[2, 3]]
    assert not planes[SEEN]["Key"].any()
    assert np.argwhere(planes[SEEN]["Floor"]).tolist() == [[1, 2], [2, 2]]
    assert not planes[AROUND]["Exit"].any(), "further away"
    assert not planes[AROUND]["door open"].any(), "the door is outside of the window"


def test_an_image_without_a_window_shows_what_conditions_let_agents_see() -> None:
    engine, behaviour = keydoor("observe door.colour for door : Door if find near(hero, door)")
    view, simulator = ImageView(behaviour, [engine.model]), Simulator(engine, behaviour)
    door, hero = engine.model.nodes("Door")[0], engine.model.nodes("Hero")[0]
    planes = dict(zip(view.channels, np.moveaxis(view.observe(simulator), -1, 0), strict=True))
    assert not planes["Door"].any() and not planes["door colour"].any()
    assert planes["Wall"].any() and planes["Key"].any()
    with engine.transaction():
        hero.at = door.west
    planes = dict(zip(view.channels, np.moveaxis(view.observe(simulator), -1, 0), strict=True))
    assert np.argwhere(planes["Door"]).tolist() == np.argwhere(planes["door colour"]).tolist() == [[door.y, door.x]]


def test_a_graph_has_what_the_agent_sees() -> None:
    engine, behaviour = keydoor(f"{AROUND} observe hero.at among Cell or none if find near(hero, _)")
    view, simulator = GraphView(behaviour, engine.model.metamodel), Simulator(engine, behaviour)
    graph: Any = view.observe(simulator)
    columns = dict(zip(view.features, graph.nodes.T, strict=True))
    kinds = [sum(columns[cls]) for cls in ("Wall", "Floor", "Door", "Exit", "Key", "Hero", "Maze")]
    assert kinds == [8, 4, 0, 0, 1, 1, 1], "the cells and objects in the window, and what is not drawn"
    assert not columns["Cell.x?"].any() and not columns["Cell.x"].any(), "cells do not say where they are"
    assert view.references.index("Hero.at") not in graph.edges, "which the second clause hides"
    assert view.references.index("Cell.east") in graph.edges


def test_attributes_are_blank_in_a_graph_while_they_are_out_of_sight() -> None:
    engine, behaviour = keydoor(
        "observe door.open for door : Door observe door.colour for door : Door if find near(hero, door)"
    )
    view, simulator = GraphView(behaviour, engine.model.metamodel), Simulator(engine, behaviour)
    door, hero = engine.model.nodes("Door")[0], engine.model.nodes("Hero")[0]
    graph: Any = view.observe(simulator)
    assert graph.nodes[:, view.features.index("Door")].sum() == 0
    with engine.transaction():
        hero.at = door.west
    graph = view.observe(simulator)
    columns = dict(zip(view.features, graph.nodes.T, strict=True))
    assert columns["Door.colour?"].sum() == columns["Door.colour=red"].sum() == 1.0


def test_patterns_for_each_object_hide_objects_that_are_out_of_sight() -> None:
    clauses = "observe find near(hero, door) for door : Door if find near(hero, door)"
    engine, behaviour = keydoor(f"{clauses} observe find near(hero, _) if find near(hero, _)")
    image, simulator = ImageView(behaviour, [engine.model]), Simulator(engine, behaviour)
    graph = PaddedGraphView(behaviour, [engine.model])
    door, hero = engine.model.nodes("Door")[0], engine.model.nodes("Hero")[0]
    for is_near in (False, True):
        planes = np.moveaxis(image.observe(simulator), -1, 0)
        seen = {name: plane.max() for name, plane in zip(image.channels, planes, strict=True)}
        assert seen["Door"] == 255 * is_near
        assert seen["near(hero, door)"] == (170 if is_near else 0), "the second of 3 values"
        assert seen["near(hero, _)"] == (127 if is_near else 0), "the second of 3 values, everywhere"
        nodes = graph.present(graph.observe(simulator))["nodes"]
        assert nodes[:, graph.features.index("Door")].sum() == is_near
        with engine.transaction():
            hero.at = door.west


@pytest.mark.parametrize("kind", ["multi", "flat", "dict", "image", "graph", "padded_graph"])
@pytest.mark.parametrize("clause", ["observe around hero 7 x 7", SEEN])
def test_windows_are_the_same_from_programs_and_the_live_engine(clause: str, kind: ObservationKind) -> None:
    program = program_of(*keydoor(clause), native=False)
    live = EnvgraphLiveEnv(Simulator(*keydoor(clause)), observation=kind)
    single, many = (
        CompiledEnv(program, observation=kind),
        CompiledVectorEnv(program, 2, observation=kind, streams="each"),
    )
    seen, both = [env.reset(seed=0)[0] for env in (live, single)], many.reset(seed=0)[0]
    for action in (3, 1, 8, 2, 2, 3, 5, 0, 1):
        if isinstance(seen[0], dict):
            rows = [*seen, {name: values[0] for name, values in both.items()}]
            first, *others = ({name: np.asarray(part).tolist() for name, part in row.items()} for row in rows)
            assert others == [first, first]
        else:
            assert repr(seen[0]) == repr(seen[1]) == repr(both[0])
        assert seen[0] in live.observation_space
        seen, both = [env.step(action)[0] for env in (live, single)], many.step(np.full(2, action))[0]


def test_images_need_windows_of_one_size_and_agents_that_take_turns() -> None:
    engine, behaviour = keydoor("observe around hero 3 x 3 observe around hero 5 x 5")
    with pytest.raises(InvalidArgument, match="windows of one size"):
        ImageView(behaviour, [engine.model])
    together, behaviour = CORNERS["windows of agents that act together"].opened()
    with pytest.raises(InvalidArgument, match="one agent at a time"):
        ImageView(behaviour, [together.model])
    graph: Any = GraphView(behaviour, together.model.metamodel).observe(Simulator(together, behaviour))
    assert len(graph.nodes) > 0


def test_a_window_without_its_centre_shows_nothing() -> None:
    yard = Yard(
        RULES, "action off = off(adam)\nobserve around adam 3 x 3\ndraw grid Spot at (x, n) with m : Man at m.at"
    )
    simulator = Simulator(*yard.opened())
    assert any(components(simulator))
    simulator.step_with(0, 0.0)
    assert not any(components(simulator)), "it is drawn nowhere"
