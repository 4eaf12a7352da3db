"""Whether an episode can end in some way, without visiting every state."""

from __future__ import annotations

from contextlib import closing
from heapq import heappop, heappush

from envgraph.behaviour import Behaviour
from envgraph.code import dataclass
from envgraph.env._explore import Progress
from envgraph.env._keys import KeyIndex
from envgraph.env._simulator import Simulator
from envgraph.graph import Savepoint, Shelf
from envgraph.rewrite import Engine

REACH_LIMIT = 50_000
"""A search for a family asks again and again: a model without a way to the end must not hold it up for minutes."""


def can_end(
    engine: Engine,
    behaviour: Behaviour,
    outcome: int,
    keys: KeyIndex | None = None,
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
        keys: indices of objects over a family; those of the engine's model alone if None.
        limit: how many states are looked at; when none of them is the end, the answer is False.
        progress: called with the number of states that were met, now and then.

    Raises:
        ResolutionError: the behaviour has errors.
        RuleError: a rule matches but cannot be applied.
        EvaluationError: a reward has no value, or an observed object no index.
    """
    simulator = Simulator(engine, behaviour, keys)
    return _Search(simulator, outcome, limit, progress).run()


@dataclass(frozen=True, slots=True)
class _State:
    """A state that was found: number of the one before it, steps from the start, whose turn it is, how to get there."""

    before: int
    depth: int
    turn: int
    shelf: Shelf | None


class _Search:
    """One start after the other. The model is at the last state of the path; each but the first has a savepoint."""

    def __init__(self, simulator: Simulator, outcome: int, limit: int, progress: Progress | None) -> None:
        self._simulator, self._outcome, self._limit = simulator, outcome, limit
        self._progress = progress
        self._model = simulator.engine.model
        self._in_the_way = simulator.in_the_way(outcome)
        self._known: set[tuple[int, int]] = set()
        self._looks: set[tuple[int, ...]] = set()

    def run(self) -> bool:
        """Whether the outcome was found."""
        with closing(self._simulator.starts()) as starts:
            return any(self._from_here() for _ in starts)

    def _from_here(self) -> bool:
        rank = self._rank()
        if rank is None:
            return False
        self._states = [_State(0, 0, self._simulator.turn, None)]
        self._path, self._marks = [0], list[Savepoint]()
        self._queues, self._waiting, number = ([(*rank, 0)], [(*rank, 0)]), {0}, 0
        try:
            while self._waiting and len(self._known) < self._limit:
                number += 1
                *_, state = heappop(self._queues[number % 2])
                if abs(state) in self._waiting:  # else it had its turn in the other queue
                    self._waiting.remove(abs(state))
                    self._go(abs(state))
                    if self._expand():
                        return True
            return False
        finally:
            self._climb(0)

    def _expand(self) -> bool:
        """Try every action of the present state; whether one of them is the end."""
        simulator, here = self._simulator, self._path[-1]
        for action in range(len(simulator.action_names)):
            for _, _, terminated, savepoint in simulator.attempts(action):
                rank = None if terminated else self._rank()
                if rank is None:
                    self._model.rollback(savepoint)
                else:
                    number = len(self._states)
                    heappush(self._queues[0], (*rank, number))
                    heappush(self._queues[1], (*rank, -number))
                    self._waiting.add(number)
                    depth, shelf = self._states[here].depth + 1, self._model.shelve(savepoint)
                    self._states.append(_State(here, depth, simulator.turn, shelf))
                if terminated == self._outcome:
                    return True
            simulator.turn = self._states[here].turn
        return False

    def _rank(self) -> tuple[int, bool] | None:
        """How far behind the present state stands in the queue; None if it was met before."""
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

    def _go(self, state: int) -> None:
        """Go to a state: up to where its way branches off, then down."""
        ways = []
        at = self._states[state]
        number = state
        while at.depth >= len(self._path) or self._path[at.depth] != number:
            ways.append(number)
            number = at.before
            at = self._states[number]
        self._climb(at.depth)
        for number in reversed(ways):
            shelf = self._states[number].shelf
            assert shelf is not None
            self._marks.append(self._model.resume(shelf))
            self._path.append(number)
        self._simulator.turn = self._states[state].turn

    def _climb(self, depth: int) -> None:
        while len(self._path) > depth + 1:
            self._path.pop()
            self._model.rollback(self._marks.pop())
