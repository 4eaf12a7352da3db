"""`envgraph adopt`: the domain that it writes steps as the environment does."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from envgraph.env import explore
from envgraph.lang import bundled_domain
from envgraph.search import Domain
from tests.profile import NIGHTLY
from tests.unit.cli.test_commands import Envgraph, envgraph, ok

__all__ = ["envgraph"]


class Odd(gymnasium.Env[Any, Any]):
    """Chances that are no multiples of 1/n."""

    def __init__(self, start: float = 1.0) -> None:
        self.action_space = gymnasium.spaces.Discrete(2)
        self.observation_space = gymnasium.spaces.Discrete(3)
        self.initial_state_distrib = np.array([start, 1 - start, 0.0])
        self.P = [
            [[(0.12345, 1, -1.0, False), (0.87655, 0, 0.5, False)], [(1.0, 0, 0.0, False)]],
            [
                [(2**-0.5, 2, 2.0, True), (1 - 2**-0.5, 0, 0.0, False)],
                [(0.25, 0, 0.1, False), (0.75, 0, 0.1, False)],
            ],
            [[(1.0, 2, 0.0, True)]] * 2,
        ]

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self.state = int(self.np_random.choice(3, p=self.initial_state_distrib))
        return self.state, {}

    def step(self, action: Any) -> Any:
        told = self.P[self.state][action]
        _, self.state, reward, over = told[self.np_random.choice(len(told), p=[one[0] for one in told])]
        return self.state, reward, over, False, {}


gymnasium.register("Odd-v0", Odd)

Chances = Counter[tuple[int, float, bool]]

LAKE = {"desc": ["SFFHS", "FHFFF", "FFFHG"], "success_rate": 0.8, "reward_schedule": (10, -1, -0.25)}
CASES: list[tuple[str, dict[str, Any], str]] = [
    ("FrozenLake-v1", {}, "grid"),
    ("FrozenLake8x8-v1", {"is_slippery": False, "max_episode_steps": -1}, "grid"),
    ("FrozenLake-v1", LAKE, "grid"),
    ("CliffWalking-v1", {"is_slippery": True}, "states"),
    ("Odd-v0", {}, "states"),
]
LONG: list[tuple[str, dict[str, Any], str]] = [
    ("Taxi-v4", {}, "states"),
    ("Taxi-v4", {"is_rainy": True}, "states"),
]


def have_equal_probabilities(one: Chances, other: Chances) -> bool:
    return all(abs(one[key] - other[key]) < 1e-12 for key in {*one, *other})


def assert_same_transitions(directory: Path, id: str, options: dict[str, Any]) -> None:
    """Compare each reachable state of a domain with the table `P` of an environment, and the limits."""
    made = gymnasium.make(id, **options)
    inner: Any = made.unwrapped
    domain = Domain.load(str(directory))
    assert domain.behaviour is not None and made.spec is not None
    assert domain.behaviour.limit == made.spec.max_episode_steps
    table = explore(domain.engine(), domain.behaviour).tabular
    seen = table.observation.tolist()
    assert len(set(seen)) == len(seen) and table.n_actions == inner.action_space.n
    began = {seen[s]: p for s, p in zip(table.start_states, table.start_probability, strict=True)}
    assert began == pytest.approx({s: p for s, p in enumerate(inner.initial_state_distrib) if p})
    ended = {seen[after] for after in table.next_state[table.terminated > 0]}
    for number, state in enumerate(seen):
        for action in range(table.n_actions if state not in ended else 0):
            told, found = Chances(), Chances()
            for chance, *rest in inner.P[state][action]:
                told[tuple(rest)] += chance  # type: ignore[index]
            for k, chance in enumerate(table.probability[number, action]):
                at = number, action, k
                found[seen[table.next_state[at]], table.reward[at], bool(table.terminated[at])] += chance
            assert have_equal_probabilities(told, found), (state, action)


@pytest.mark.parametrize(("id", "options", "kind"), CASES + LONG if NIGHTLY else CASES)
def test_the_adopted_domain_has_the_transitions_of_the_environment(
    envgraph: Envgraph, id: str, options: dict[str, Any], kind: str
) -> None:
    given = [part for key, value in options.items() for part in ("--set", f"{key}={json.dumps(value)}")]
    done = ok(envgraph("adopt", id, "-o", "mine", *given, "--format", "json"))
    assert done.json["kind"] == kind  # type: ignore[index, call-overload]
    assert "no problems" in ok(envgraph("check", "mine")).out
    texts = [str(path) for path in Path("mine").iterdir() if path.suffix != ".toml"]
    assert "would" not in envgraph("format", "--check", *texts).out
    assert_same_transitions(Path("mine"), id, options)


def test_the_bundled_taxi_has_the_transitions_of_gymnasium() -> None:
    assert_same_transitions(bundled_domain("taxi"), "Taxi-v4", {})


def test_a_family_can_be_generated_from_an_adopted_frozen_lake(envgraph: Envgraph) -> None:
    said = ok(envgraph("adopt", "FrozenLake-v1")).out
    assert said.endswith(
        "same transitions as `FrozenLake-v1`: 16 states, 4 actions, each outcome with its probability and reward\n"
        "next: envgraph generate frozen_lake\n"
    )
    made = ok(envgraph("generate", "frozen_lake", "--generations", 30, "--name", "lakes", "--format", "json")).json
    assert made["diversity"] > 0.9 * made["maximum"]  # type: ignore[index, call-overload]
    again = envgraph("adopt", "FrozenLake-v1")
    assert again.code == 1 and "exists already; nothing was written" in again.err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["CartPole-v1"], "`CartPoleEnv` has no `P`, a table of its transitions"),
        (["Nothing-v1"], "Gymnasium cannot make `Nothing-v1`"),
        (["FrozenLake-v1", "--set", "icy=true"], "unexpected keyword argument 'icy'"),
        (["FrozenLake-v1", "--set", "icy"], "`icy` is not of the form NAME=VALUE"),
        (["FrozenLake-v1", "--set", "map_name=9x9"], "Gymnasium cannot make"),
        (
            ["Odd-v0", "--set", "start=0.12345678"],
            "the start probabilities (0.123457, 0.876543) are not multiples",
        ),
        (["MiniGrid-Nothing-v0"], "Gymnasium cannot make `MiniGrid-Nothing-v0`"),
        (
            ["Taxi-v4", "--set", "fickle_passenger=true"],
            "`TaxiEnv` made a transition that its `P` does not contain: in state",
        ),
    ],
)
def test_environments_that_cannot_be_adopted_are_refused_with_a_reason(
    envgraph: Envgraph, arguments: list[str], said: str
) -> None:
    done = envgraph("adopt", *arguments)
    assert done.code == 1 and said in done.err


NAN, INF = float("nan"), float("inf")


class Told(gymnasium.Env[Any, Any]):
    """Does what `P` tells, as far as that can be done."""

    def __init__(self, case: str) -> None:
        if case == "cannot be made":
            raise RuntimeError("no display")
        self.P, self.case = ODD.get(case, (CHAIN,))[0], case
        self.__dict__ |= ODD.get(case, (CHAIN, {}))[1]
        self.action_space, self.observation_space = gymnasium.spaces.Discrete(1), gymnasium.spaces.Discrete(3)

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self.state = 0
        return 0, {}

    def step(self, action: Any) -> Any:
        if self.case == "cannot be stepped":
            raise KeyError("engine")
        _, self.state, reward, over = self.P[self.state][action][0]
        return self.state, reward, over, False, {}


def chain(*outcomes: Any) -> dict[Any, Any]:
    """Three states in a row, of which the first has these outcomes."""
    return {**CHAIN, 0: {0: [*outcomes]}}


CHAIN: dict[Any, Any] = {
    0: {0: [(1.0, 1, 0.0, False)]},
    1: {0: [(1.0, 2, 1.0, True)]},
    2: {0: [(1.0, 2, 0.0, True)]},
}
AT = "`P` of `Told`: action 0 in state 0"
ODD: dict[str, tuple[Any, dict[str, Any], str]] = {
    "sum below 1": (
        chain((0.5, 1, 0.0, False), (0.4, 0, 0.0, False)),
        {},
        f"{AT} has probabilities that sum to 0.9",
    ),
    "sum above 1": (
        chain((0.6, 1, 0.0, False), (0.6, 0, 0.0, False)),
        {},
        f"{AT} has probabilities that sum to 1.2",
    ),
    "negative": (
        chain((-0.5, 1, 0.0, False), (1.5, 0, 0.0, False)),
        {},
        f"{AT} has the probability -0.5, but must",
    ),
    "no number": (
        chain((NAN, 1, 0.0, False)),
        {},
        f"{AT} has the probability nan, but must have one from 0 to 1",
    ),
    "reward of nan": (
        chain((1.0, 1, NAN, False)),
        {},
        f"{AT} has the reward nan, but must have one from -1e+100",
    ),
    "reward of inf": (
        chain((1.0, 1, -INF, False)),
        {},
        f"{AT} has the reward -inf, but must have one from -1e+100",
    ),
    "reward too large": (
        chain((1.0, 1, 1e308, False)),
        {},
        f"{AT} has the reward 1e+308, but must have one from",
    ),
    "huge state": (
        chain((1.0, 10**30, 0.0, False)),
        {},
        f"leads to state {10**30}, but must lead to one of 0..2",
    ),
    "negative state": (
        chain((1.0, -1, 0.0, False)),
        {},
        f"{AT} leads to state -1, but must lead to one of 0..2",
    ),
    "short outcome": (
        chain((1.0, 1)),
        {},
        "`P` of `Told`: the outcomes of action 0 in state 0 cannot be read",
    ),
    "state of text": (
        chain((1.0, "b", 0.0, False)),
        {},
        "the outcomes of action 0 in state 0 cannot be read",
    ),
    "endless state": (
        chain((1.0, INF, 0.0, False)),
        {},
        "the outcomes of action 0 in state 0 cannot be read",
    ),
    "no outcomes": (chain(), {}, "`P` of `Told` has 0 actions in state 0, but must have 1"),
    "no actions": ({0: {}, 1: {}}, {}, "`P` of `Told` has 0 actions in state 0, but must have 1"),
    "uneven": (
        {**CHAIN, 1: {0: CHAIN[1][0], 1: CHAIN[1][0]}},
        {},
        "has 2 actions in state 1, but must have 1",
    ),
    "holes": ({0: CHAIN[0], 1: CHAIN[1], 7: CHAIN[2]}, {}, "the outcomes of state 2 cannot be read"),
    "actions from 1": (
        {**CHAIN, 1: {1: CHAIN[1][0]}},
        {},
        "the outcomes of action 0 in state 1 cannot be read",
    ),
    "texts": (
        {"a": {0: [(1.0, "b", 0.0, False)]}, "b": {}},
        {},
        "the outcomes of state 0 cannot be read",
    ),
    "no states": ({}, {}, "a table of its transitions"),
    "too many": ([CHAIN[2]] * 250_001, {}, "has 250,001 states, but at most 250,000 can be adopted"),
    **{
        f"starts {given}": (
            CHAIN,
            {"initial_state_distrib": given},
            "`initial_state_distrib` of `Told` must have a",
        )
        for given in (
            [NAN, 1.0, 0.0],
            [-1.0, 2.0, 0.0],
            [0.0] * 3,
            [0.5, 0.5],
            ["x", "y", "z"],
            [[1.0], [0.0, 0.0]],
        )
    },
    "cannot be made": (CHAIN, {}, "Gymnasium cannot make `Told-v0`: no display"),
    "cannot be stepped": (CHAIN, {}, "a trial episode of `Told-v0` failed: KeyError: 'engine'"),
    "a list": ([CHAIN[0], CHAIN[1], CHAIN[2]], {}, ""),
    "an end without outcomes": ({**CHAIN, 2: {0: []}}, {}, ""),
    "an end without actions": ({**CHAIN, 2: {}}, {}, ""),
    "tiny and large": (chain((1.0, 1, 5e-324, False)) | {1: {0: [(1.0, 2, -1e100, True)]}}, {}, ""),
    "map of quotes": (CHAIN, {"desc": np.array([['"', "\n", "{{"]])}, ""),
    "map of bytes": (CHAIN, {"desc": np.array([[b"\xff", b"S", b"G"]])}, ""),
    "map of rows": (CHAIN, {"desc": [["S"], ["S", "G"]]}, ""),
}
gymnasium.register("Told-v0", Told)


@pytest.mark.parametrize("case", ODD)
def test_invalid_transition_tables_are_errors_with_state_and_action(case: str, envgraph: Envgraph) -> None:
    said = ODD[case][2]
    done = envgraph("adopt", "Told-v0", "--set", f"case={case}", "-o", "told")
    assert (done.code, Path("told").exists()) == ((1, False) if said else (0, True)), done.err
    assert said in done.err
