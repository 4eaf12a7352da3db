"""All states that an environment can reach, as arrays."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import closing
from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from envgraph.behaviour import Behaviour
from envgraph.code import dataclass
from envgraph.env._keys import KeyIndex
from envgraph.env._simulator import GOES_ON, Simulator
from envgraph.env._tabular import Tabular, allowed_or_all
from envgraph.env._too_many import TooManyStates, check_entries, check_observations
from envgraph.env.scene._scene import Painter, Scene
from envgraph.rewrite import Engine

DEFAULT_LIMIT = 250_000
"""About half a minute, and half a gigabyte: nobody should wait longer to learn that there are too many."""

OUTCOMES = 10_000_000
"""Outcomes of actions that there may be in all states together: they take the time and the space, too."""

Progress = Callable[[int, int], None]
"""Called now and then with how many states were found so far, and how many outcomes of actions (0: not counted)."""


def enumerate_states(
    engine: Engine, behaviour: Behaviour, keys: KeyIndex | None = None, *, limit: int = DEFAULT_LIMIT
) -> Tabular:
    """The environment as a table of its reachable states.

    The engine is as before afterwards; this works inside a transaction, too.

    Args:
        engine: its model is the initial state.
        behaviour: what the environment does.
        keys: indices of objects over a family; those of the engine's model alone if None.
        limit: how many states there may be; of outcomes of actions in them, 10 million.

    Returns:
        The states numbered breadth first from the start states, by action and outcome; outcomes of one action that
        follow each other and are the same are put together.

    Raises:
        TooManyStates: more states than the limit, too many outcomes, of all actions together or of one in a state, or
            too many observations.
        EvaluationError: an observed object has no index.
        ResolutionError: the behaviour has errors.
        RuleError: a rule matches but cannot be applied.
    """
    return explore(engine, behaviour, keys, limit=limit).tabular


@dataclass(frozen=True, slots=True)
class Explored:
    """An enumerated environment.

    Attributes:
        pictures: the scene of every state, or () where none were asked for.
    """

    tabular: Tabular
    pictures: tuple[Scene, ...]


def explore(
    engine: Engine,
    behaviour: Behaviour,
    keys: KeyIndex | None = None,
    *,
    limit: int = DEFAULT_LIMIT,
    outcomes: int = OUTCOMES,
    pictures: bool = False,
    progress: Progress | None = None,
) -> Explored:
    """`enumerate_states`, with a picture of every state if the behaviour says how to draw it.

    There may be so many `outcomes` of actions in all states together.
    """
    simulator = Simulator(engine, behaviour, keys)
    check_observations(behaviour, simulator.observation_shape)
    painter = simulator.painter() if pictures and behaviour.draw is not None else None
    search = _Search(simulator, limit, outcomes, painter, progress)
    search.run()
    return search.result()


Row = list[list[tuple[float, int, float, int]]]
"""For each action its outcomes: probability, state, reward, terminated."""

Walk = Generator[tuple[float, int, float, int]]
"""Probability, action, reward and end of one move after the other; the model is in the state that the move leads to.

The action of a reset is -1.
"""


@dataclass(slots=True)
class _Search:
    """A depth-first walk: every move is made once, and undone, so that no state needs to be stored.

    A state is known by the hash of the model, by whose turn it is, and by whether the episode is over: a start state is
    not over even where a step to it would have ended the episode.

    Attributes:
        most: how many outcomes there may be.
        number: of each state, in the order of the walk.
        rows: outcomes of every state; None while it has not been left.
        did: of every state whether each action did something in one of its outcomes.
    """

    simulator: Simulator
    limit: int
    most: int
    painter: Painter | None
    progress: Progress | None = None
    number: dict[tuple[int, int, bool], int] = field(default_factory=dict)
    rows: list[Row | None] = field(default_factory=list)
    did: list[bytearray] = field(default_factory=list)
    observations: list[int] = field(default_factory=list)
    turns: list[int] = field(default_factory=list)
    scenes: list[Scene] = field(default_factory=list)
    starts: list[tuple[float, int]] = field(default_factory=list)
    made: int = 0
    _drawn: dict[Scene, Scene] = field(default_factory=dict)

    def run(self) -> None:
        """Walk from every start state."""
        stack: list[tuple[Walk, int]] = [(self._begin(), -1)]
        try:
            while stack:
                walk, state = stack[-1]
                move = next(walk, None)
                if move is None:
                    stack.pop()
                    continue
                probability, action, reward, terminated = move
                did = self.simulator.did
                found, fresh = self._enter(over=terminated != GOES_ON)
                if action < 0:
                    self.starts.append((probability, found))
                else:
                    row = self.rows[state]
                    assert row is not None
                    row[action].append((probability, found, reward, terminated))
                    self.did[state][action] |= did and self.simulator.together is None
                    self._count()
                if fresh and terminated == GOES_ON:
                    self.rows[found] = [[] for _ in self.simulator.action_names]
                    stack.append((self._leave(), found))
        finally:
            while stack:  # after an error: undo the moves, the last one first
                stack.pop()[0].close()

    def _begin(self) -> Walk:
        with closing(self.simulator.starts()) as starts:
            for probability in starts:
                yield probability, -1, 0.0, GOES_ON

    def _leave(self) -> Walk:
        for action in range(len(self.simulator.action_names)):
            with closing(self.simulator.outcomes(action)) as outcomes:
                for probability, reward, terminated in outcomes:
                    yield probability, action, reward, terminated

    def _enter(self, *, over: bool) -> tuple[int, bool]:
        """Number of the present state, and whether it is new."""
        key = *self.simulator.state_key(), over
        found = self.number.get(key)
        if found is not None:
            return found, False
        if len(self.rows) >= self.limit:
            raise TooManyStates(self.simulator.behaviour, self.limit)
        self.number[key] = len(self.rows)
        self.rows.append(None)
        self.did.append(self._masked(over))
        self.observations.append(self.simulator.observe())
        self.turns.append(self.simulator.turn)
        if self.painter is not None:
            scene = self.painter.scene()
            self.scenes.append(self._drawn.setdefault(scene, scene))
        return len(self.rows) - 1, True

    def _masked(self, over: bool) -> bytearray:
        """What each action does: seen when it is done, but of agents that act together asked before."""
        if self.simulator.together is not None and not over:
            return bytearray(self.simulator.allowed())
        return bytearray(len(self.simulator.action_names))

    def _count(self) -> None:
        """See that there are not too many outcomes, and say how many there are."""
        self.made += 1
        if self.made > self.most:
            raise TooManyStates(self.simulator.behaviour, self.limit, outcomes=self.most)
        if self.progress is not None and not self.made % 100:
            self.progress(len(self.rows), self.made)

    # --- arrays

    def result(self) -> Explored:
        """The table, with the states numbered anew, breadth first."""
        order = self._breadth_first()
        place = {state: position for position, state in enumerate(order)}
        rows = [self._merged(self.rows[state], place) for state in order]
        shape = len(order), len(self.simulator.action_names), max(len(o) for row in rows for o in row)
        check_entries(self.simulator.behaviour, shape)
        next_state = np.repeat(np.arange(len(order), dtype=np.int32), shape[1] * shape[2]).reshape(shape)
        probability, reward = np.zeros(shape), np.zeros(shape)
        terminated = np.zeros(shape, dtype=np.int8)
        for state, row in enumerate(rows):
            for action, outcomes in enumerate(row):
                for number, (chance, to, gain, end) in enumerate(outcomes or [(1.0, state, 0.0, 0)]):
                    here = state, action, number
                    probability[here], next_state[here] = chance, to
                    reward[here], terminated[here] = gain, end
        starts = self._start_distribution(place)
        simulator = self.simulator
        tabular = Tabular(
            next_state=next_state,
            probability=probability,
            reward=reward,
            terminated=terminated,
            observation=np.array([self.observations[state] for state in order], dtype=np.int64),
            start_states=np.array(list(starts), dtype=np.int32),
            start_probability=np.array(list(starts.values())),
            n_observations=simulator.n_observations,
            observation_shape=simulator.observation_shape,
            action_names=simulator.action_names,
            agent_names=simulator.agent_names,
            turn=self._turns(order) if simulator.agent_names else None,
            allowed=allowed_or_all(self._did(order)),
            observation_names=simulator.observation_names,
        )
        return Explored(tabular, tuple(self.scenes[state] for state in order) if self.scenes else ())

    def _did(self, order: list[int]) -> NDArray[np.bool_]:
        did = np.frombuffer(b"".join(self.did[state] for state in order), dtype=np.bool_)
        return did.reshape(len(order), -1)

    def _turns(self, order: list[int]) -> NDArray[np.int32]:
        return np.array([self.turns[state] for state in order], dtype=np.int32)

    def _breadth_first(self) -> list[int]:
        order = list(dict.fromkeys(state for _, state in self.starts))
        seen = set(order)
        for state in order:
            for outcomes in self.rows[state] or ():
                for _, to, _, _ in outcomes:
                    if to not in seen:
                        seen.add(to)
                        order.append(to)
        return order

    def _merged(self, row: Row | None, place: dict[int, int]) -> Row:
        """The outcomes with the new numbers; equal neighbours are one outcome."""
        if row is None:
            return [[] for _ in self.simulator.action_names]
        result: Row = []
        for outcomes in row:
            merged: list[tuple[float, int, float, int]] = []
            for chance, to, gain, end in outcomes:
                if merged and merged[-1][1:] == (place[to], gain, end):
                    merged[-1] = (merged[-1][0] + chance, *merged[-1][1:])
                else:
                    merged.append((chance, place[to], gain, end))
            result.append(merged)
        return result

    def _start_distribution(self, place: dict[int, int]) -> dict[int, float]:
        found: dict[int, float] = {}
        for chance, state in self.starts:
            found[place[state]] = found.get(place[state], 0.0) + chance
        return found
