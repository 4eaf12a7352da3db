"""Enumerate all reachable states of an environment as arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from envgraph.behaviour import Behaviour, KeyIndex
from envgraph.code import dataclass
from envgraph.draw import html_picture
from envgraph.env._simulator import CONTINUES, Simulator
from envgraph.env._size_errors import TooManyStates, check_observation_count, check_table_size
from envgraph.env._tabular import Tabular, nonempty_masks
from envgraph.env.scene._scene import Painter, Scene
from envgraph.env.scene._scene_svg import scene_svg
from envgraph.errors import LIMITS
from envgraph.graph import Savepoint
from envgraph.rewrite import Engine, SavepointWalk, walk_of_savepoints

Array = NDArray[Any]
Progress = Callable[[int, int], None]
"""A callback that gets the numbers of states and of outcomes so far; 0 outcomes if they are not counted."""


@dataclass(frozen=True, slots=True)
class ExploredEnvironment:
    """An environment whose reachable states are enumerated.

    Attributes:
        pictures: the scene of every state, or () if none were requested.
    """

    tabular: Tabular
    pictures: tuple[Scene, ...]

    def _repr_html_(self) -> str:
        counts, start = self.tabular._repr_html_(), int(self.tabular.start_states[0])
        return counts + html_picture(lambda: scene_svg(self.pictures[start])) if self.pictures else counts


def explore(
    engine: Engine,
    behaviour: Behaviour,
    keys: KeyIndex | None = None,
    *,
    limit: int = LIMITS["states"],
    outcomes: int = LIMITS["all outcomes"],
    pictures: bool = False,
    progress: Progress | None = None,
) -> ExploredEnvironment:
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
    check_observation_count(behaviour, simulator.observation_shape, simulator.observation_names)
    painter = simulator.painter() if pictures and behaviour.draw is not None else None
    search = _StateEnumeration(simulator, limit, outcomes, painter, progress)
    search.run()
    return search.build_result()


def fill_table(behaviour: Behaviour, counts: Array, outcomes: Sequence[Array], **others: Any) -> Tabular:
    """Return a table.

    Args:
        counts: [S, A], the number of outcomes of each action in each state.
        outcomes: next state, probability, reward and end of each outcome, in the order of states and actions.
        others: the other attributes.

    Raises:
        TooLargeTable: the table is too large.
    """
    shape = *counts.shape, max(1, int(counts.max(initial=1)))
    check_table_size(behaviour, shape)
    next_state = np.broadcast_to(np.arange(shape[0], dtype=np.int32)[:, None, None], shape).copy()
    probability, reward, terminated = np.zeros(shape), np.zeros(shape), np.zeros(shape, np.int8)
    probability[counts == 0, 0] = 1.0
    exists = np.arange(shape[2]) < counts[:, :, None]
    for array, column in zip((next_state, probability, reward, terminated), outcomes, strict=True):
        array[exists] = column
    return Tabular(next_state, probability, reward, terminated, **others)


ActionOutcomes = list[list[tuple[float, int, float, int]]]
"""For each action its outcomes: probability, next state, reward, end. Consecutive equal outcomes are merged."""


@dataclass(slots=True)
class _StateEnumeration:
    """A depth-first enumeration of states, which makes each move once and then undoes it.

    The key of a state is the hash of the model, whose turn it is, and whether the episode is over. A start state is not
    over, even if a step that leads to it ends the episode.

    Attributes:
        max_outcomes: the maximum number of outcomes of all actions in all states.
        state_numbers: the number of each state by key, in the order of discovery.
        outcomes: the outcomes of every state; None if the episode is over.
        has_effect: for every state and action, 1 if one of its outcomes changed something; for simultaneous agents,
            1 if the action is enabled.
        starts: the probability that an episode begins in a state.
        outcome_count: the number of outcomes so far.
    """

    simulator: Simulator
    limit: int
    max_outcomes: int
    painter: Painter | None
    progress: Progress | None = None
    state_numbers: dict[tuple[int, int, bool], int] = field(default_factory=dict)
    outcomes: list[ActionOutcomes | None] = field(default_factory=list)
    has_effect: list[bytearray] = field(default_factory=list)
    observations: list[int] = field(default_factory=list)
    turns: list[int] = field(default_factory=list)
    scenes: list[Scene] = field(default_factory=list)
    starts: dict[int, float] = field(default_factory=dict)
    outcome_count: int = 0
    _waiting: list[int] = field(default_factory=list)
    _known_scenes: dict[Scene, Scene] = field(default_factory=dict)

    def run(self) -> None:
        """Visit all states that can be reached from the start states, and record their outcomes."""
        simulator, first = self.simulator, self.simulator.turn
        try:
            with walk_of_savepoints(simulator.engine.model) as walk:
                for probability, _, _, savepoint in simulator.outcomes_with_savepoints(None):
                    found = self._number_of(walk, savepoint, CONTINUES)
                    self.starts[found] = self.starts.get(found, 0.0) + probability
                while self._waiting:
                    state = self._waiting.pop()
                    walk.restore_state(state + 1)
                    simulator.turn = self.turns[state]
                    self._expand_state(walk, state)
        finally:
            simulator.turn = first

    def _expand_state(self, walk: SavepointWalk, state: int) -> None:
        """Record the outcomes of every action in the state, which must be the current state of the model."""
        simulator, row = self.simulator, self.outcomes[state]
        assert row is not None
        for action, outcomes in enumerate(row):
            for chance, reward, ended, savepoint in simulator.outcomes_with_savepoints(action):
                self.has_effect[state][action] |= simulator.has_acted and simulator.joint_stepper is None
                found = self._number_of(walk, savepoint, ended)
                if outcomes and outcomes[-1][1:] == (found, reward, ended):
                    outcomes[-1] = outcomes[-1][0] + chance, found, reward, ended
                else:
                    outcomes.append((chance, found, reward, ended))
                self._count_outcome()
            simulator.turn = self.turns[state]

    def _number_of(self, walk: SavepointWalk, savepoint: Savepoint, ended: int) -> int:
        """Return the number of the current state, and undo the move since the savepoint; record the state if it is new.

        A new state waits for its expansion unless the episode is over. Raise TooManyStates at the limit.
        """
        over = ended != CONTINUES
        key = *self.simulator.state_key(), over
        found = self.state_numbers.setdefault(key, len(self.outcomes))
        if found == len(self.outcomes):
            if found >= self.limit:
                raise TooManyStates(self.simulator.behaviour, self.limit)
            self.outcomes.append(None if over else [[] for _ in self.simulator.action_names])
            # The mask of simultaneous agents is final; others are completed by the outcomes of the actions.
            is_masked = self.simulator.joint_stepper is not None and not over
            mask = self.simulator.action_mask() if is_masked else np.zeros(len(self.simulator.action_names), np.bool_)
            self.has_effect.append(bytearray(mask))
            self.observations.append(self.simulator.observe())
            self.turns.append(self.simulator.turn)
            if self.painter is not None:
                scene = self.painter.draw()
                self.scenes.append(self._known_scenes.setdefault(scene, scene))
            if not over:
                self._waiting.append(found)
                walk.store_state(found + 1, savepoint)
                return found
        self.simulator.engine.model.graph.history.rollback(savepoint)
        return found

    def _count_outcome(self) -> None:
        """Count an outcome, call `progress` after every 100; raise TooManyStates if there are too many outcomes."""
        self.outcome_count += 1
        if self.outcome_count > self.max_outcomes:
            raise TooManyStates(self.simulator.behaviour, self.limit, outcomes=self.max_outcomes)
        if self.progress is not None and not self.outcome_count % 100:
            self.progress(len(self.outcomes), self.outcome_count)

    # --- arrays

    def build_result(self) -> ExploredEnvironment:
        """Return the table and pictures, states renumbered breadth-first; raise TooManyStates if it is too large."""
        simulator, order = self.simulator, self._breadth_first()
        final: ActionOutcomes = [[] for _ in simulator.action_names]
        rows, place = [self.outcomes[state] or final for state in order], np.argsort(order)
        found = np.array([one for row in rows for each in row for one in each], dtype=float).reshape(-1, 4).T
        tabular = fill_table(
            simulator.behaviour,
            np.array([[len(each) for each in row] for row in rows]),
            [place[found[1].astype(int)], found[0], found[2], found[3]],
            observation=np.array(self.observations, dtype=np.int64)[order],
            start_states=place[list(self.starts)].astype(np.int32),
            start_probability=np.array(list(self.starts.values())),
            n_observations=simulator.n_observations,
            observation_shape=simulator.observation_shape,
            action_names=simulator.action_names,
            agent_names=simulator.agent_names,
            turn=np.array(self.turns, dtype=np.int32)[order] if simulator.agent_names else None,
            allowed=nonempty_masks(np.frombuffer(b"".join(self.has_effect), np.bool_).reshape(len(order), -1)[order]),
            observation_names=simulator.observation_names,
        )
        return ExploredEnvironment(tabular, tuple(self.scenes[state] for state in order) if self.scenes else ())

    def _breadth_first(self) -> list[int]:
        order = list(self.starts)
        seen = set(order)
        for state in order:
            for outcomes in self.outcomes[state] or ():
                for _, to, _, _ in outcomes:
                    if to not in seen:
                        seen.add(to)
                        order.append(to)
        return order
