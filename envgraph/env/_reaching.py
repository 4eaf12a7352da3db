"""Whether an episode can end in some way, without visiting every state."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from heapq import heappop, heappush

from envgraph.behaviour import Behaviour
from envgraph.env._explore import Progress
from envgraph.env._simulator import Simulator
from envgraph.graph import Savepoint
from envgraph.rewrite import Engine, walk_of_savepoints

REACH_LIMIT = 50_000
"""A search for a family asks again and again: a model without a way to the end must not hold it up for minutes."""


def can_end(
    engine: Engine,
    behaviour: Behaviour,
    outcome: int,
    *,
    limit: int = REACH_LIMIT,
    progress: Progress | None = None,
) -> bool:
    """Whether some episode ends in success (1) or in failure (2).

    A best-first search: from the states where the fewest matches stand in the way of an `on neg find .. terminate`, and
    among them first from those that look like no state before, where numbers in ranges are not looked at. (After the
    best-first width search of Lipovetzky and Geffner 2017, with what is observed as the one feature.) Of equals the
    latest and the earliest go first by turns: the one is soon at an end, the other is never far from the start. Every
    state gets its turn, so the answer is exact up to the limit. The engine is as before afterwards; this works inside a
    transaction, too.

    Args:
        engine: its model is the initial state.
        behaviour: what the environment does.
        outcome: 1 or 2.
        limit: how many states are looked at; when none of them is the end, the answer is False.
        progress: called with the number of states that were met, now and then.

    Raises:
        ResolutionError: the behaviour has errors.
        RuleError: a rule matches but cannot be applied.
        EvaluationError: a reward has no value, or an observed object no index.
    """
    simulator = Simulator(engine, behaviour)
    return _Search(simulator, outcome, limit, progress).run()


class _Search:
    """Searches for an outcome, from one start after the other."""

    def __init__(self, simulator: Simulator, outcome: int, limit: int, progress: Progress | None) -> None:
        self._simulator, self._outcome, self._limit = simulator, outcome, limit
        self._progress = progress
        self._model = simulator.engine.model
        self._in_the_way = simulator.in_the_way(outcome)
        self._known: set[tuple[int, int]] = set()
        self._looks: set[tuple[int, ...]] = set()

    def run(self) -> bool:
        """Return whether the outcome was found."""
        with closing(self._simulator.starts()) as starts:
            return any(self._from_here() for _ in starts)

    def _from_here(self) -> bool:
        rank = self._rank()
        if rank is None:
            return False
        turns, number = [self._simulator.turn], 0  # whose turn it is, by state
        queues, waiting = ([(*rank, 0)], [(*rank, 0)]), {0}
        with walk_of_savepoints(self._model) as walk:
            while waiting and len(self._known) < self._limit:
                number += 1
                *_, state = heappop(queues[number % 2])
                state = abs(state)
                if state not in waiting:  # already expanded from the other queue
                    continue
                waiting.remove(state)
                walk.go(state)
                self._simulator.turn = turns[state]
                for rank, savepoint in self._successors():
                    if rank is None:
                        return True
                    found = len(turns)
                    turns.append(self._simulator.turn)
                    walk.park(found, savepoint)
                    heappush(queues[0], (*rank, found))
                    heappush(queues[1], (*rank, -found))
                    waiting.add(found)
        return False

    def _successors(self) -> Iterator[tuple[tuple[int, bool] | None, Savepoint]]:
        """Move to each new state that an action leads to, and yield its rank, or None if the outcome is reached."""
        simulator, turn = self._simulator, self._simulator.turn
        for action in range(len(simulator.action_names)):
            for _, _, ended, savepoint in simulator.attempts(action):
                rank = None if ended else self._rank()
                if rank is not None or ended == self._outcome:
                    yield rank, savepoint
                else:
                    self._model.graph.history.rollback(savepoint)
            simulator.turn = turn

    def _rank(self) -> tuple[int, bool] | None:
        """Return the priority of the current state in the queue; None if it is known already."""
        key = self._simulator.state_key()
        if key in self._known:
            return None
        self._known.add(key)
        if self._progress is not None and not len(self._known) % 100:
            self._progress(len(self._known), 0)
        look = self._simulator.look()
        seen = look in self._looks
        self._looks.add(look)
        return self._in_the_way(), seen
