"""The key-and-door maze against a direct implementation of its rules."""

from __future__ import annotations

import numpy as np
import pytest

from envgraph.env import Action, Behaviour, Branch, Domain, RuleCall, Simulator, Tabular, explore
from envgraph.lang import TextFiles, bundled_domain, load_workspace
from envgraph.match import Matcher, ViewMatcher
from envgraph.pattern import Constant, LeftSide, Modification, Parameter, Rule, RuleNode, SetAction, Variable
from envgraph.rewrite import Engine
from tests.oracle.naive._naive import NaiveMatcher

FILES = bundled_domain("keydoor")
WAYS = {"west": (-1, 0), "south": (0, 1), "east": (1, 0), "north": (0, -1)}

State = tuple[tuple[int, int], frozenset[tuple[int, int]], tuple[str, ...], frozenset[tuple[int, int]]]
"""Where the hero is, where keys lie, colours of the keys in hand, open doors."""


def loaded(rows: list[str]) -> tuple[Engine, Behaviour]:
    names = ("keydoor.metamodel", "keydoor.query", "keydoor.rules", "keydoor.environment")
    texts = {name: (FILES / name).read_text() for name in names}
    before, rest = (FILES / "two_rooms.model").read_text().split('rows """', 1)
    _, after = rest.split('"""', 1)
    block = "\n".join(f"                {row}" for row in rows)
    texts["two_rooms.model"] = f'{before}rows """\n{block}\n                """{after}'
    workspace = load_workspace(["two_rooms.model", "keydoor.environment"], files=TextFiles(texts))
    return workspace.engine(), workspace.behaviour()


class Maze:
    """Cells: `#` wall, `.` floor, `X` exit, `r` a floor with a red key, `R` a red door."""

    def __init__(self, rows: list[str]) -> None:
        self.rows = rows
        self.cells = [(x, y) for y, row in enumerate(rows) for x, _ in enumerate(row)]
        self.doors = [cell for cell in self.cells if self.kind(cell) == "R"]
        keys = frozenset(cell for cell in self.cells if self.kind(cell) == "r")
        self.start: State = ((1, 1), keys, (), frozenset())

    def kind(self, cell: tuple[int, int]) -> str:
        x, y = cell
        inside = 0 <= y < len(self.rows) and 0 <= x < len(self.rows[0])
        return self.rows[y][x] if inside else "#"

    def step(self, state: State, action: int) -> tuple[State, float, int]:
        at, lying, hand, opened = state
        reward = 0.0
        if action < 8:
            dx, dy = list(WAYS.values())[action % 4]
            to = at[0] + dx, at[1] + dy
        if action < 4:
            if self.kind(to) != "#" and (self.kind(to) != "R" or to in opened):
                at = to
        elif action < 8:
            if self.kind(to) == "R" and to not in opened and "red" in hand:
                opened, hand, reward = opened | {to}, hand[:-1], 0.1
            else:
                reward = -0.05
        elif at in lying:
            lying, hand = lying - {at}, (*hand, "red")
        reward += -0.01
        ended = self.kind(at) == "X"
        return (at, lying, hand, opened), reward + ended, int(ended)

    def observation(self, state: State) -> int:
        at, _, hand, opened = state
        index = self.cells.index(at) + len(self.cells) * bool(hand)
        index += len(self.cells) * 2 * min(len(hand), 2)
        for place, door in enumerate(sorted(self.doors, key=lambda cell: (cell[1], cell[0]))):
            index += len(self.cells) * 6 * 2**place * (door in opened)
        return index


def assert_same(table: Tabular, maze: Maze) -> None:
    (start,) = table.start_states.tolist()
    seen: dict[int, tuple[State, bool]] = {start: (maze.start, False)}
    queue = [start]
    for number in queue:
        state, over = seen[number]
        assert table.observation[number] == maze.observation(state)
        for action in range(9):
            if over:
                assert table.next_state[number, action, 0] == number
                continue
            to, reward, ended = maze.step(state, action)
            assert table.reward[number, action, 0] == pytest.approx(reward, abs=1e-12)
            assert table.terminated[number, action, 0] == ended
            found = int(table.next_state[number, action, 0])
            if found not in seen:
                seen[found] = to, ended > 0
                queue.append(found)
            assert seen[found] == (to, ended > 0)
    assert len(seen) == table.n_states


MAZES = [
    ["#######", "#..#..#", "#.r#.X#", "#..R..#", "#######"],
    ["#####", "#.rR.", "#R#.X", "#...#"],
    ["#####", "#...#", "#.X.#", "#####"],
    ["####", "#..X"],
]
TWO_KEYS = ["#####", "#rrR#", "##RX#", "#####"]


@pytest.mark.parametrize("rows", MAZES)
def test_every_transition_equals_that_of_a_maze_in_python(rows: list[str]) -> None:
    table = explore(*loaded(rows)).tabular
    table.check()
    assert table.deterministic
    assert table.action_names[:5] == ("go(west)", "go(south)", "go(east)", "go(north)", "open(west)")
    assert table.action_names[8] == "take"
    assert_same(table, Maze(rows))


def test_two_door_keys_with_equal_attributes_are_distinct_objects() -> None:
    # With two keys in hand, opening a door draws one of them: two outcomes, which differ by identity.
    table = explore(*loaded(TWO_KEYS)).tabular
    assert table.next_state.shape[2] == 2
    halves = table.probability[(table.probability > 0.0) & (table.probability < 1.0)]
    assert set(halves.tolist()) == {0.5}


@pytest.mark.parametrize("matcher", [ViewMatcher, NaiveMatcher])
def test_superclass_argument_matches_only_an_object_of_the_parameter_class(
    matcher: type[Matcher],
) -> None:
    engine, _ = loaded(MAZES[0])
    other = Engine(engine.model, matcher=matcher)
    swing = Rule(
        "swing",
        (Parameter("door", "Door"),),
        LeftSide((RuleNode("door", "Door"),)),
        right=Modification((SetAction(Variable("door"), "open", "=", Constant(True)),)),
    )
    other.add(swing)
    push = Action(
        "push",
        (Branch(1.0, RuleCall("swing", (Variable("cell"),))),),
        (("cell", Domain("Cell")),),
        Constant(1.0),
    )
    simulator = Simulator(other, Behaviour("Pushing", actions=(push,)))
    rewarded = [
        name
        for number, name in enumerate(simulator.action_names)
        for _, reward, _ in simulator.outcomes(number)
        if reward
    ]
    assert rewarded == ["push(3, 3)"]


@pytest.mark.parametrize("unit", [False, True])
def test_trace_records_the_applications_of_an_episode(unit: bool) -> None:
    texts = {file.name: file.read_text() for file in FILES.glob("*.*")}
    if unit:
        texts["keydoor.environment"] = texts["keydoor.environment"].replace("= walk(", "= go(")
        texts["keydoor.rules"] += "unit go(hero : Hero, way : Way) { walk(hero, way); }\n"
    workspace = load_workspace(["two_rooms.model", "keydoor.environment"], files=TextFiles(texts))
    engine, rng = workspace.engine(), np.random.default_rng(3)
    simulator, start = Simulator(engine, workspace.behaviour()), engine.commit()
    with engine.recording() as trace:
        for _ in range(60):
            simulator.step_with(int(rng.integers(len(simulator.action_names))), rng.random())
    after = engine.model.state_hash()
    engine.checkout(start, discard=True)
    engine.replay(trace)
    assert len(trace) > 10 and engine.model.state_hash() == after
