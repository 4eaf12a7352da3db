"""Enumerate all reachable states of an environment as arrays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field

import numpy as np

from envgraph.behaviour import Behaviour, KeyIndex
from envgraph.code import dataclass
from envgraph.env._simulator import GOES_ON, Simulator
from envgraph.env._tabular import Tabular, allowed_or_all
from envgraph.env._too_many import TooManyStates, check_entries, check_observations
from envgraph.env.scene._scene import Painter, Scene
from envgraph.errors import LIMITS
from envgraph.graph import Savepoint
from envgraph.rewrite import Engine, SavepointWalk, walk_of_savepoints

Progress = Callable[[int, int], None]
"""A callback that gets the numbers of states and of outcomes so far; 0 outcomes if they are not counted."""


@dataclass(frozen=True, slots=True)
class Explored:
    """An environment whose reachable states are enumerated.

    Attributes:
        pictures: the scene of every state, or () if none were requested.
    """

    tabular: Tabular
    pictures: tuple[Scene, ...]


def explore(
    engine: Engine,
    behaviour: Behaviour,
    keys: KeyIndex | None = None,
    *,
    limit: int = LIMITS["states"],
    outcomes: int = LIMITS["all outcomes"],
    pictures: bool = False,
    progress: Progress | None = None,
) -> Explored:
    """Enumerate the reachable states of an environment.

    The engine's model is restored afterwards; a transaction may be open.

    Args:
        engine: an engine whose model is the initial state.
        behaviour: the behaviour of the environment.
        keys: indices of objects over a family; None: those of the engine's model.
        limit: the maximum number of states.
        outcomes: the maximum number of outcomes of actions, in all states together.
        pictures: draw every state, if the behaviour has a `draw` clause.
        progress: a callback that gets the numbers of states and outcomes so far.

    Returns:
        The states numbered breadth-first from the start states, by action and outcome. Consecutive equal outcomes of
        one action are merged.

    Raises:
        TooManyStates: more states than the limit, too many outcomes, of all actions together or of one in a state, or
            too many observations.
        EvaluationError: an observed object has no index.
        ResolutionError: the behaviour has errors.
        RuleError: a rule matches but cannot be applied.
    """
    simulator = Simulator(engine, behaviour, keys)
    check_observations(behaviour, simulator.observation_shape)
    painter = simulator.painter() if pictures and behaviour.draw is not None else None
    search = _Search(simulator, limit, outcomes, painter, progress)
    search.run()
    return search.result()


Row = list[list[tuple[float, int, float, int]]]
"""For each action its outcomes: probability, next state, reward, end. Consecutive equal outcomes are merged."""


@dataclass(slots=True)
class _Search:
    """A depth-first enumeration of states, which makes each move once and then undoes it.

    The key of a state is the hash of the model, whose turn it is, and whether the episode is over. A start state is not
    over, even if a step that leads to it ends the episode.

    Attributes:
        most: the maximum number of outcomes of all actions in all states.
        number: the number of each state by key, in the order of discovery.
        rows: the outcomes of every state; None if the episode is over.
        did: for every state and action, 1 if one of its outcomes changed something; for simultaneous agents, 1 if the
            action is enabled.
        starts: the probability that an episode begins in a state.
        made: the number of outcomes so far.
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
    starts: dict[int, float] = field(default_factory=dict)
    made: int = 0
    _waiting: list[int] = field(default_factory=list)
    _drawn: dict[Scene, Scene] = field(default_factory=dict)

    def run(self) -> None:
        """Visit all states that can be reached from the start states, and record their outcomes."""
        simulator, first = self.simulator, self.simulator.turn
        try:
            with walk_of_savepoints(simulator.engine.model) as walk:
                for probability, _, _, savepoint in simulator.attempts(None):
                    found = self._number_of(walk, savepoint, GOES_ON)
                    self.starts[found] = self.starts.get(found, 0.0) + probability
                while self._waiting:
                    state = self._waiting.pop()
                    walk.go(state + 1)
                    simulator.turn = self.turns[state]
                    self._expand(walk, state)
        finally:
            simulator.turn = first

    def _expand(self, walk: SavepointWalk, state: int) -> None:
        """Record the outcomes of every action in the state, which must be the current state of the model."""
        simulator, row = self.simulator, self.rows[state]
        assert row is not None
        for action, outcomes in enumerate(row):
            for chance, reward, ended, savepoint in simulator.attempts(action):
                self.did[state][action] |= simulator.did and simulator.together is None
                found = self._number_of(walk, savepoint, ended)
                if outcomes and outcomes[-1][1:] == (found, reward, ended):
                    outcomes[-1] = outcomes[-1][0] + chance, found, reward, ended
                else:
                    outcomes.append((chance, found, reward, ended))
                self._count()
            simulator.turn = self.turns[state]

    def _number_of(self, walk: SavepointWalk, savepoint: Savepoint, ended: int) -> int:
        """Return the number of the current state, and undo the move since the savepoint; record the state if it is new.

        A new state waits for its expansion unless the episode is over. Raise TooManyStates at the limit.
        """
        over = ended != GOES_ON
        key = *self.simulator.state_key(), over
        found = self.number.setdefault(key, len(self.rows))
        if found == len(self.rows):
            if found >= self.limit:
                raise TooManyStates(self.simulator.behaviour, self.limit)
            self.rows.append(None if over else [[] for _ in self.simulator.action_names])
            self.did.append(self._masked(over))
            self.observations.append(self.simulator.observe())
            self.turns.append(self.simulator.turn)
            if self.painter is not None:
                scene = self.painter.scene()
                self.scenes.append(self._drawn.setdefault(scene, scene))
            if not over:
                self._waiting.append(found)
                walk.park(found + 1, savepoint)
                return found
        self.simulator.engine.model.graph.history.rollback(savepoint)
        return found

    def _masked(self, over: bool) -> bytearray:
        """Return the initial action mask of a state: all 0; for simultaneous agents, if not `over`, the final mask."""
        if self.simulator.together is not None and not over:
            return bytearray(self.simulator.allowed())
        return bytearray(len(self.simulator.action_names))

    def _count(self) -> None:
        """Count an outcome, call `progress` after every 100; raise TooManyStates if there are too many outcomes."""
        self.made += 1
        if self.made > self.most:
            raise TooManyStates(self.simulator.behaviour, self.limit, outcomes=self.most)
        if self.progress is not None and not self.made % 100:
            self.progress(len(self.rows), self.made)

    # --- arrays

    def result(self) -> Explored:
        """Return the table and pictures, states renumbered breadth-first; raise TooManyStates if it is too large."""
        simulator, order = self.simulator, self._breadth_first()
        rows, states, place = [self.rows[state] or () for state in order], len(order), np.argsort(order)
        outcomes = max((len(found) for row in rows for found in row), default=0)
        shape = states, len(simulator.action_names), max(1, outcomes)
        check_entries(simulator.behaviour, shape)
        next_state = np.repeat(np.arange(states, dtype=np.int32), shape[1] * shape[2]).reshape(shape)
        probability, reward = np.zeros(shape), np.zeros(shape)
        probability[:, :, 0] = 1.0
        terminated = np.zeros(shape, dtype=np.int8)
        for state, row in enumerate(rows):
            for action, found in enumerate(row):
                for number, (chance, to, gain, end) in enumerate(found):
                    here = state, action, number
                    probability[here], next_state[here] = chance, place[to]
                    reward[here], terminated[here] = gain, end
        tabular = Tabular(
            next_state=next_state,
            probability=probability,
            reward=reward,
            terminated=terminated,
            observation=np.array(self.observations, dtype=np.int64)[order],
            start_states=place[list(self.starts)].astype(np.int32),
            start_probability=np.array(list(self.starts.values())),
            n_observations=simulator.n_observations,
            observation_shape=simulator.observation_shape,
            action_names=simulator.action_names,
            agent_names=simulator.agent_names,
            turn=np.array(self.turns, dtype=np.int32)[order] if simulator.agent_names else None,
            allowed=allowed_or_all(np.frombuffer(b"".join(self.did), np.bool_).reshape(states, -1)[order]),
            observation_names=simulator.observation_names,
        )
        return Explored(tabular, tuple(self.scenes[state] for state in order) if self.scenes else ())

    def _breadth_first(self) -> list[int]:
        order = list(self.starts)
        seen = set(order)
        for state in order:
            for outcomes in self.rows[state] or ():
                for _, to, _, _ in outcomes:
                    if to not in seen:
                        seen.add(to)
                        order.append(to)
        return order
