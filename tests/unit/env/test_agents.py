"""Agents that take turns: the warehouse against a direct implementation of its rules, and what coins can show."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from envgraph.env import (
    Action,
    Agent,
    Behaviour,
    Branch,
    EachStep,
    EnvgraphEnv,
    EnvgraphLiveEnv,
    EnvgraphVectorEnv,
    ObserveRange,
    RuleCall,
    Simulator,
    Tabular,
    explore,
)
from envgraph.errors import ResolutionError
from envgraph.lang import TextFiles, bundled_domain, load_workspace
from envgraph.pattern import Constant, Navigation, Variable
from envgraph.rewrite import Engine
from tests.unit.env.coins import loaded, sides, simulator, table

WAREHOUSE = bundled_domain("warehouse")
WAYS = {"west": (-1, 0), "south": (0, 1), "east": (1, 0), "north": (0, -1)}

Place = tuple[int, int]


@dataclass(frozen=True)
class State:
    """Of the warehouse: places and batteries of the robots, what they carry, where parcels are, whose turn it is."""

    at: tuple[Place, ...]
    battery: tuple[int, ...]
    load: tuple[int | None, ...]
    parcels: tuple[Place | None, ...]
    shipped: tuple[bool, ...]
    turn: int = 0


class Hall:
    """Cells: `.` aisle, `s` shelf, `d` dock."""

    def __init__(self, rows: list[str], robots: list[Place], battery: int, parcels: list[Place]) -> None:
        self.rows = rows
        self.cells = [(x, y) for y, row in enumerate(rows) for x in range(len(row))]
        self.count = len(robots)
        none = (None,) * self.count
        shipped = (False,) * len(parcels)
        self.start = State(tuple(robots), (battery,) * self.count, none, tuple(parcels), shipped)

    def text(self) -> str:
        rows = "\n".join(f"                {row}" for row in self.rows)
        robots = ",\n".join(
            f'Robot {{ name = "{name}", at = cell[{x}, {y}], battery = {battery} }}'
            for name, (x, y), battery in zip("ab", self.start.at, self.start.battery, strict=False)
        )
        parcels = ", ".join(
            f'Parcel {{ label = "p{n}", at = cell[{x}, {y}] }}'
            for n, (x, y) in enumerate(p for p in self.start.parcels if p)
        )
        return f'''
            import "warehouse.metamodel"
            model hall : warehouse {{
                hall : Hall {{
                    cells = grid cell {{
                        column x next east
                        row y next south
                        rows """
{rows}
                """
                    }}
                    robots = [{robots}]
                    parcels = [{parcels}]
                }}
            }}
        '''

    def kind(self, place: Place) -> str:
        x, y = place
        inside = 0 <= y < len(self.rows) and 0 <= x < len(self.rows[0])
        return self.rows[y][x] if inside else "s"

    def step(self, state: State, action: int) -> list[tuple[State, float, int]]:
        """The equally likely outcomes: state, reward, end."""
        return [self.judged(after, reward, state.turn) for after, reward in self.moves(state, state.turn, action)]

    def moves(self, state: State, robot: int, action: int) -> list[tuple[State, float]]:
        """The equally likely outcomes of what a robot does, before they are judged."""
        here, load = state.at[robot], state.load[robot]
        found: list[tuple[State, float]] = []
        if action < 4:
            dx, dy = list(WAYS.values())[action]
            there = here[0] + dx, here[1] + dy
            others = [at for number, at in enumerate(state.at) if number != robot]
            if self.kind(there) == "s" or there in others or state.battery[robot] == 0:
                found = [(state, -0.1)]
            else:
                left = state.battery[robot] - 1
                found = [
                    (
                        replace(state, at=put(state.at, robot, there), battery=put(state.battery, robot, left)),
                        0.0,
                    )
                ]
        elif action == 4:
            for parcel, at in enumerate(state.parcels):
                if at == here and load is None:
                    after = put(state.parcels, parcel, None)
                    found.append((replace(state, load=put(state.load, robot, parcel), parcels=after), 1.0))
        elif action == 5 and load is not None and self.kind(here) == "d":
            shipped = put(state.shipped, load, True)
            found = [(replace(state, load=put(state.load, robot, None), shipped=shipped), 5.0)]
        return found or [(state, 0.0)]

    def judged(self, state: State, reward: float, robot: int) -> tuple[State, float, int]:
        empty, done = state.battery[robot] == 0, all(state.shipped)
        total = reward + (-2.0 if empty else 0.0) - 0.01 + (10.0 if done else 0.0)
        return replace(state, turn=(robot + 1) % self.count), total, 2 if empty else int(done)

    def observation(self, state: State) -> int:
        """Own place, load and battery of the robot whose turn it is, then all places."""
        robot, cells, parcels = state.turn, len(self.cells), len(state.parcels)
        load = state.load[robot]
        parts = [
            (self.cells.index(state.at[robot]), cells),
            (parcels if load is None else load, parcels + 1),
            (state.battery[robot], 51),
            *((self.cells.index(at), cells) for at in state.at),
            *((cells if at is None else self.cells.index(at), cells + 1) for at in state.parcels),
        ]
        index, weight = 0, 1
        for value, size in parts:
            index += value * weight
            weight *= size
        return index


def put(values: tuple, place: int, value: object) -> tuple:
    return (*values[:place], value, *values[place + 1 :])


def opened(model: str, together: bool = False) -> tuple[Engine, Behaviour]:
    names = [f"warehouse.{kind}" for kind in ("metamodel", "query", "rules", "environment")]
    texts = {name: (WAREHOUSE / name).read_text(encoding="utf-8") for name in names}
    if together:
        file = "warehouse.environment"
        texts[file] = texts[file].replace("    agent robot", "    agents together\n    agent robot")
    files = TextFiles({**texts, "hall.model": model})
    workspace = load_workspace(["hall.model", "warehouse.environment"], files=files)
    workspace.raise_errors()
    return workspace.engine(), workspace.behaviour()


def assert_same(tabular: Tabular, hall: Hall) -> None:
    (start,) = tabular.start_states.tolist()
    assert tabular.turn is not None
    seen: dict[int, tuple[State, bool]] = {start: (hall.start, False)}
    queue = [start]
    for number in queue:
        state, over = seen[number]
        assert tabular.observation[number] == hall.observation(state)
        assert tabular.turn[number] == state.turn
        for action in range(tabular.n_actions if not over else 0):
            expected = hall.step(state, action)
            for outcome, (after, reward, ended) in enumerate(expected):
                place = number, action, outcome
                assert tabular.probability[place] == pytest.approx(1 / len(expected))
                assert tabular.reward[place] == pytest.approx(reward, abs=1e-12)
                assert tabular.terminated[place] == ended
                found = int(tabular.next_state[place])
                if found not in seen:
                    seen[found] = after, ended > 0
                    queue.append(found)
                assert seen[found] == (after, ended > 0)
    assert len(seen) == tabular.n_states


HALLS = [
    Hall(["...", ".sd"], [(0, 0), (2, 0)], 4, [(0, 1)]),
    Hall(["..d."], [(0, 0), (3, 0)], 3, [(0, 0), (3, 0)]),
    Hall(["..d"], [(0, 0)], 5, [(1, 0), (1, 0)]),
]


@pytest.mark.parametrize("hall", HALLS, ids=lambda hall: "/".join(hall.rows))
def test_every_transition_equals_that_of_a_warehouse_in_python(hall: Hall) -> None:
    tabular = explore(*opened(hall.text())).tabular
    tabular.check()
    assert tabular.action_names == (*(f"go({way})" for way in WAYS), "lift", "ship", "wait")
    assert tabular.agent_names == tuple("ab"[: hall.count])
    assert_same(tabular, hall)


def test_robots_act_in_key_order_and_observe_their_own_values() -> None:
    engine = Engine(load_workspace([str(WAREHOUSE)]).models[0].model)  # type: ignore[arg-type]
    workspace = load_workspace([str(WAREHOUSE)])
    engine.add(*workspace.definitions)
    live = Simulator(engine, workspace.behaviour())
    assert live.agent_names == ("left", "right")
    assert live.observation_shape == (24, 3, 51, 24, 24, 25, 25)
    live.reset(np.random.default_rng(0))
    seen = []
    for action in (2, 0, 6, 1):  # left goes east, right west, left waits, right goes south
        seen.append((live.turn, live.observe() % 24))
        live.step(action, np.random.default_rng(0))
    places = {node.name: (node.at.x, node.at.y) for node in engine.model.nodes("Robot")}
    assert (seen, places) == ([(0, 0), (1, 5), (0, 1), (1, 4)], {"left": (1, 0), "right": (4, 0)})
    live.close()
    assert live.turn == 0


@pytest.mark.parametrize("hall", HALLS, ids=lambda hall: "/".join(hall.rows))
def test_table_and_live_environment_step_alike(hall: Hall) -> None:
    rows = EnvgraphEnv(explore(*opened(hall.text())).tabular, observation="multi")
    live = EnvgraphLiveEnv(Simulator(*opened(hall.text())), observation="multi")
    rng = np.random.default_rng(3)
    for seed in range(20):
        (one, info), (other, told) = rows.reset(seed=seed), live.reset(seed=seed)
        assert (one == other).all() and info["agent"] == told["agent"] == "a"
        ended = False
        for turn in range(1, 30):
            if ended:
                break
            action = int(rng.integers(7))
            (one, reward, ended, _, info), (other, gain, over, _, told) = rows.step(action), live.step(action)
            assert (one == other).all() and (reward, ended) == (gain, over)
            assert info["agent"] == told["agent"] == "ab"[turn % hall.count]


def test_vector_environment_reports_the_agent_whose_turn_is_next() -> None:
    tabular = explore(*opened(HALLS[1].text())).tabular
    many = EnvgraphVectorEnv([tabular, tabular])
    _, info = many.reset(seed=0)
    turns = [info["agent"].tolist()]
    for _ in range(2):
        *_, info = many.step(np.array([6, 6]))
        turns.append(info["agent"].tolist())
    assert turns == [["a", "a"], ["b", "b"], ["a", "a"]]


# --- coins: every coin is an agent


def start_state_transitions(tabular: Tabular) -> list[tuple[int, ...]]:
    """Reward, end and who is next, from the start state, by action."""
    (start,) = tabular.start_states.tolist()
    assert tabular.turn is not None
    return [
        (float(tabular.reward[start, a, 0]), int(tabular.terminated[start, a, 0]),
         int(tabular.turn[tabular.next_state[start, a, 0]]))
        for a in range(tabular.n_actions)
    ]  # fmt: skip


def test_clauses_outside_agent_blocks_apply_to_all_agents() -> None:
    found = table(
        """
        action wait = nothing() reward 1.0
        agent coin : Coin {
            action flip = turnOver(coin) reward 2.0 else reward -2.0
            each step reward coin.value * 10.0
            observe coin.side
        }
        each step reward 100.0
        on find down(_) terminate success
        """
    )
    assert found.agent_names == ("a", "b", "c")
    assert found.action_names == ("wait", "flip")
    # Coin a is worth 1, and acts first; tails is success, and c shows tails from the start.
    assert start_state_transitions(found) == [(111.0, 1, 1), (112.0, 1, 1)]


def test_agent_name_used_outside_its_block_matches_any_object() -> None:
    text = """
        agent coin : Coin { action flip = turnOver(coin) on find up(coin) reward 1.0 }
        on find up(coin) reward 10.0
        observe find down(coin)
    """
    live = simulator(text)
    (reward,) = [reward for _, reward, _ in live.outcomes(0)]
    assert reward == 10.0  # a is turned over; b still shows heads, c does not
    live.turn = 2  # c shows tails
    (reward,) = [reward for _, reward, _ in live.outcomes(0)]
    assert reward == 20.0


def test_clauses_of_an_agent_block_apply_rules_only_at_the_turn_of_its_agent() -> None:
    text = """
        agent coin : Coin {
            action wait = nothing()
            each step apply 1.0: grab(hand, coin, value)
            on find up(coin) apply turnOver(coin)
            observe coin.side
        }
    """
    live = simulator(text)
    rng = np.random.default_rng(0)
    live.reset(rng)
    shown, held = [], []
    for _ in range(3):
        live.step(0, rng)
        shown.append(sides(live.engine))
        held.append(live.engine.model["hand"].holds.name)
    assert (shown, held) == (["b", "", ""], ["a", "b", "c"])
    live.close()
    assert sides(live.engine) == "ab" and live.engine.model["hand"].holds is None


def test_turn_order_skips_deleted_agents() -> None:
    text = "agent coin : Coin { action lose = lose(coin) action wait = nothing() observe coin.side }"
    live = simulator(text)
    live.reset(np.random.default_rng(0))
    order = []
    for action in (1, 0, 1, 1, 1, 0, 1, 0, 0):
        order.append(live.agent_names[live.turn])
        live.step(action, np.random.default_rng(0))
    assert order == ["a", "b", "c", "a", "c", "a", "c", "c", "c"]
    assert live.observe() == 0  # nobody is left


def test_shared_clauses_continue_when_all_agents_are_deleted() -> None:
    text = """
        agent coin : Coin {
            action lose = lose(coin)
            observe coin.side
            observe coin.over among Coin or none
            observe find up(coin)
        }
        action count = count(hand, 1)
        each step reward -0.5
        on neg find any(_) terminate failure
        observe hand.moves in 0..3
        observe other.value in -1..4 for other : Coin
    """
    live = EnvgraphLiveEnv(simulator(text), observation="multi")
    rows = EnvgraphEnv(table(text), observation="multi")
    for env in (live, rows):
        seen, _ = env.reset(seed=0)
        assert seen.tolist() == [0, 3, 1, 0, 2, 3, 5]
        for action in (0, 0, 0, 0, 1, 1):
            seen, reward, over, _, info = env.step(action)
            assert (reward, over) == (-0.5, False)
        assert seen.tolist() == [0, 3, 0, 2, 0, 0, 0]
        assert info["agent"] == "c"


def test_a_member_may_lack_an_agent() -> None:
    engine, behaviour = loaded("agent coin : Coin { action flip = turnOver(coin) observe coin.side }")
    live = Simulator(engine, behaviour)
    engine.model.graph.delete(next(coin.id for coin in engine.model.nodes("Coin") if coin.name == "b"))
    assert Simulator(engine, behaviour, live.keys).agent_names == ("a", "c")


def test_a_model_without_any_agent_is_refused() -> None:
    engine, behaviour = loaded("agent mark : Mark { action wait = nothing() }")
    with pytest.raises(ResolutionError, match="there is no agent: the model has no `Mark`"):
        Simulator(engine, behaviour)


def test_agents_of_several_blocks_take_turns_block_by_block() -> None:
    found = table(
        """
        agent coin : Coin {
            action wait = nothing()
            action flip = turnOver(coin)
            observe coin.side
            observe coin.value in 0..4
        }
        agent player : Hand {
            action count = count(player, 1)
            action wait  = nothing() reward 7.0
            observe player.moves in 0..3
        }
        on find held(hand, _) terminate success
        """
    )
    assert found.agent_names == ("a", "b", "c", "player 0")
    assert found.action_names == ("wait", "flip", "count")
    assert found.observation_shape == (2, 4, 5)  # whose block it is; side or moves; value or nothing
    assert found.turn is not None
    players = found.turn == 3
    assert set((found.observation[players] % 2).tolist()) == {1}
    assert set((found.observation[~players] % 2).tolist()) == {0}
    assert set(found.reward[players, 0, 0].tolist()) == {7.0}
    # `flip` is not the player's: nothing happens, and the next one acts.
    assert (found.reward[players, 1] == 0.0).all()
    assert (found.turn[found.next_state[players, 1, 0]] == 0).all()


def test_behaviour_with_agents_can_be_built_in_python() -> None:
    coin = Variable("coin")
    agent = Agent(
        "coin",
        "Coin",
        (Action("flip", (Branch(1.0, RuleCall("turnOver", (coin,))),)),),
        (EachStep(Constant(1.0)),),
        (ObserveRange(Navigation(coin, "value"), 0, 4),),
    )
    engine, _ = loaded("action wait = nothing()")
    tabular = explore(engine, Behaviour("Plain", agents=(agent,))).tabular
    assert tabular.agent_names == ("a", "b", "c") and tabular.n_states == 5
