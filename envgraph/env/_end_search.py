"""Search for an episode with a given end, without visiting every state."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from heapq import heappop, heappush

from envgraph.behaviour import Behaviour
from envgraph.env._enumeration import Progress
from envgraph.env._simulator import Simulator
from envgraph.errors import LIMITS
from envgraph.graph import Savepoint
from envgraph.rewrite import Engine, walk_of_savepoints


def can_end(
    engine: Engine,
    behaviour: Behaviour,
    outcome: int,
    *,
    limit: int = LIMITS["searched states"],
    progress: Progress | None = None,
) -> bool:
    """Return True if an episode with the given end, success (1) or failure (2), is found within `limit` states.

    This is a best-first search. States with the fewest matches of `on neg find .. terminate` clauses come first; among
    them, states whose observation is new, without numbers in ranges (after best-first width search, Lipovetzky and
    Geffner 2017, with the observation as the only feature). Equal states are taken alternately latest first and
    earliest first. Every state is visited in the end, so the answer is exact up to the limit. The engine's model is
    restored afterwards; a transaction may be open.

    Args:
        engine: an engine whose model is the initial state.
        behaviour: the behaviour of the environment.
        outcome: 1 or 2.
        limit: the maximum number of states; if none of them has the end, the answer is False.
        progress: a callback that gets the number of states from time to time.

    Raises:
        ResolutionError: the behaviour has errors.
        RuleError: a rule matches but cannot be applied.
        EvaluationError: a reward has no value, or an observed object no index.
    """
    simulator = Simulator(engine, behaviour)
    return _EndSearch(simulator, outcome, limit, progress).run()


class _EndSearch:
    """A best-first search for an end, from one start state after the other."""

    def __init__(self, simulator: Simulator, outcome: int, limit: int, progress: Progress | None) -> None:
        self._simulator, self._outcome, self._limit = simulator, outcome, limit
        self._progress = progress
        self._model = simulator.engine.model
        self._count_obstacles = simulator.obstacle_counter(outcome)
        self._known: set[tuple[int, int]] = set()
        self._known_observations: set[tuple[int, ...]] = set()

    def run(self) -> bool:
        """Search from each start state; return True if the end is found, False if not within the limit."""
        with closing(self._simulator.reset_outcomes()) as starts:
            return any(self._search_from_start() for _ in starts)

    def _search_from_start(self) -> bool:
        rank = self._rank()
        if rank is None:
            return False
        turns, number = [self._simulator.turn], 0  # for each state, whose turn it is
        queues, waiting = ([(*rank, 0)], [(*rank, 0)]), {0}
        with walk_of_savepoints(self._model) as walk:
            while waiting and len(self._known) < self._limit:
                number += 1
                *_, state = heappop(queues[number % 2])
                state = abs(state)
                if state not in waiting:  # already expanded from the other queue
                    continue
                waiting.remove(state)
                walk.restore_state(state)
                self._simulator.turn = turns[state]
                for rank, savepoint in self._move_to_successors():
                    if rank is None:
                        return True
                    found = len(turns)
                    turns.append(self._simulator.turn)
                    walk.store_state(found, savepoint)
                    heappush(queues[0], (*rank, found))
                    heappush(queues[1], (*rank, -found))
                    waiting.add(found)
        return False

    def _move_to_successors(self) -> Iterator[tuple[tuple[int, bool] | None, Savepoint]]:
        """Move to each new state that an action leads to; yield its rank and the savepoint before the move.

        The rank is None if the end is reached. The caller must undo each yielded move.
        """
        simulator, turn = self._simulator, self._simulator.turn
        for action in range(len(simulator.action_names)):
            for _, _, ended, savepoint in simulator.outcomes_with_savepoints(action):
                rank = None if ended else self._rank()
                if rank is not None or ended == self._outcome:
                    yield rank, savepoint
                else:
                    self._model.graph.history.rollback(savepoint)
            simulator.turn = turn

    def _rank(self) -> tuple[int, bool] | None:
        """Record the current state as known and return its rank, lowest first; None if the state was known.

        A rank is the number of matches in the way, and True if the observation was seen before.
        """
        key = self._simulator.state_key()
        if key in self._known:
            return None
        self._known.add(key)
        if self._progress is not None and not len(self._known) % 100:
            self._progress(len(self._known), 0)
        look = self._simulator.non_range_components()
        seen = look in self._known_observations
        self._known_observations.add(look)
        return self._count_obstacles(), seen
