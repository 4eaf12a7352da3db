"""A way to an end in a compiled environment: breadth-first up to a bound, then a beam."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import closing, suppress
from dataclasses import replace
from math import inf, isfinite
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from envgraph.behaviour import Behaviour, KeyIndex, ObserveFind, OnFind, indexed_classes
from envgraph.code import dataclass
from envgraph.env._explore import Progress
from envgraph.env._prepared import never_acts
from envgraph.env._sampling import MOST_OUTCOMES
from envgraph.env._simulator import Simulator
from envgraph.env._too_many import TooManyStates
from envgraph.env.compiled._batch import longer
from envgraph.env.compiled._enumeration import FEW, FEW_OUTCOMES, FIRST, TOLD, Visit
from envgraph.env.compiled._listing import DONE, FOUND, PAUSED, SPACE
from envgraph.env.compiled._program import Program, program_over
from envgraph.pattern import Negation, PatternCall, Variable
from envgraph.rewrite import Engine

BREADTH: Final = 20_000
WIDTH: Final = 500
"""States that are met breadth first; and how many a beam then keeps at each step."""
NARROW: Final = 1_000, 100
"""Limit and width of the first search where any plan will do: in `warehouse` 6 of 7 plans in a quarter of the time."""
MOST_STATES: Final = 200_000
"""States after which `Plans` gives up a search: 80 ms with numba, 20 s in Python."""
SEARCHES_OF_PYTHON: Final = 20
"""Small searches that take Python as long as that."""
MOST_MATCHES: Final = 255
"""Matches of a guide that are distinguished."""
HORIZON: Final = 1_000
"""Steps of a beam in an environment without a limit."""
ENDS: Final = {1: "success", 2: "failure"}


@dataclass(frozen=True, slots=True)
class Plan:
    """What a search for a way to an end has found.

    >>> str(Plan(inf, (), 124, 20_000, None)), str(Plan(2.0, ("go", "eat"), 25_040, 20_000, 500))
    ('none: 124 states are all there are', 'at most 2 steps, found by a beam of 500 states after the first 20,000')

    Attributes:
        steps: of the plan, infinite if none was found.
        actions: their names. What is drawn may have to come out right for them to lead to the end.
        states: how many were met.
        limit: how many were to be met before layers are cut.
        width: how many were kept of a layer; None if no layer was cut: then there is no shorter plan, or none at all.
    """

    steps: float
    actions: tuple[str, ...]
    states: int
    limit: int
    width: int | None

    @property
    def exact(self) -> bool:
        """Whether there is no shorter plan; without a plan, whether there is none at all."""
        return self.width is None

    def __str__(self) -> str:
        if isfinite(self.steps):
            if self.width is None:
                return f"{self.steps:.0f} steps, the fewest"
            return (
                f"at most {self.steps:.0f} steps, found by a beam of {self.width:,} states "
                f"after the first {self.limit:,}"
            )
        if self.width is None:
            return f"none: {self.states:,} states are all there are"
        return (
            f"none within {self.states:,} states, by a beam of {self.width:,} after the first {self.limit:,}"
        )


def guided(behaviour: Behaviour, outcome: int = 1, guide: PatternCall | None = None) -> tuple[Behaviour, int]:
    """A behaviour whose observations begin with numbers of matches, and how many of them do.

    Where agents act together they end with these: what all of them share comes last.

    Args:
        behaviour: free of errors.
        outcome: 1 for success, 2 for failure.
        guide: what is counted; None: the queries of `on neg find .. terminate`, shared by all agents, for that outcome.
    """
    calls = [
        effect.condition.relation
        for effect in behaviour.effects
        if isinstance(effect, OnFind)
        and effect.end == ENDS[outcome]
        and isinstance(effect.condition, Negation)
        and isinstance(effect.condition.relation, PatternCall)
    ]
    counts = tuple(ObserveFind(call, MOST_MATCHES) for call in ([guide] if guide is not None else calls))
    if behaviour.together:
        return replace(behaviour, observations=(*behaviour.observations, *counts)), len(counts)
    agents = tuple(replace(agent, observations=(*counts, *agent.observations)) for agent in behaviour.agents)
    own = () if agents else counts
    return replace(behaviour, agents=agents, observations=(*own, *behaviour.observations)), len(counts)


class Plans:
    """Plans in many models with one behaviour, which an engine comes to one after the other.

    Python searches a few states of the first models; then numba compiles the program, where it is installed.

    Args:
        behaviour: free of errors.
        outcome: 1 for success, 2 for failure.
        guide: a pattern: a beam keeps the states with the fewest matches; None: see `guided`.
        shortest: search for a shortest plan; False: try a narrow beam first, whose plan may be longer.
    """

    def __init__(
        self, behaviour: Behaviour, outcome: int = 1, guide: str | None = None, shortest: bool = True
    ) -> None:
        self._behaviour, self._outcome, self._guide, self._shortest = behaviour, outcome, guide, shortest
        self._searches = 0
        self._programs: dict[Any, Program] = {}

    def plan(self, engine: Engine, progress: Progress | None = None) -> Plan:
        """A plan in the present model of an engine, whose objects are numbered among themselves alone.

        Raises:
            NotCompiled: something in the behaviour only the live engine has.
            EvaluationError, RuleError, ResolutionError: as `explore`.
        """
        return self._searched(engine, progress)[1]

    def episode(self, engine: Engine) -> Iterator[Simulator]:
        """Meanwhile the engine is in one state of a plan after the other, first and last included; in none without one.

        Raises:
            NotCompiled, EvaluationError, RuleError, ResolutionError: as `plan`.
        """
        search, plan = self._searched(engine)
        if isfinite(plan.steps):
            yield from search.episode()

    def _searched(self, engine: Engine, progress: Progress | None = None) -> tuple[PlanSearch, Plan]:
        program, guides = self._guided(engine)
        searches = list[PlanSearch]()
        self._searches += 1
        if program.native and self._searches <= SEARCHES_OF_PYTHON:
            slow = PlanSearch(replace(program, native=False), self._outcome, BREADTH, WIDTH, FEW, progress)
            slow.outcomes = FEW_OUTCOMES
            searches.append(slow)
        if not self._shortest:
            searches.append(PlanSearch(program, self._outcome, *NARROW, MOST_STATES, progress))
        for search in searches:
            with suppress(TooManyStates):
                plan = search.plan(guides)
                if isfinite(plan.steps) or plan.exact:
                    return search, plan
            self._searches = SEARCHES_OF_PYTHON  # later searches are compiled
        search = PlanSearch(program, self._outcome, BREADTH, WIDTH, MOST_STATES, progress)
        return search, search.plan(guides)

    def _guided(self, engine: Engine) -> tuple[Program, int]:
        """The program over the present model, and how many of its observations are guides."""
        call = None
        if self._guide is not None:
            pattern = engine.library.resolve(self._guide) or engine.library.get(self._guide)
            call = PatternCall(pattern.qualified_name, (Variable("_"),) * len(pattern.parameters))
        behaviour, guides = guided(self._behaviour, self._outcome, call)
        keys = KeyIndex.of(engine.model, indexed_classes(behaviour, engine.model.metamodel))
        return program_over(self._programs, engine, behaviour, keys), guides


def different_actions(program: Program) -> NDArray[np.int64]:
    """The numbers of the actions that may lead to different states.

    Of the joint actions of agents that act together, each agent has those that may do something, and the first of those
    that never do: `nothing()`, and the actions of other blocks.
    """
    if not program.behaviour.together:
        return np.arange(len(program.action_names))
    with closing(program.twin(0).simulator) as simulator:
        base, found = len(simulator.agents.action_names), np.zeros(1, np.int64)
        for place, seat in enumerate(simulator.agents.seats):
            idle = [number for number, action in enumerate(seat.actions) if never_acts(action)]
            own = [number for number in range(base) if number not in idle[1:]]
            found = (np.array(own)[:, None] * base**place + found).ravel()
    return found


_Rows = tuple[np.ndarray[Any, np.dtype[Any]], ...]
"""Arrays with a row for each state."""


@dataclass(slots=True)
class _Layer:
    """What a beam left out of the layer that it cut last, the best ones first; and how many steps away they are."""

    depth: int
    rows: _Rows

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.rows[0]) if self.rows else 0

    def take(self, width: int) -> _Rows:
        """The first of them, which are left out no longer."""
        taken = tuple(array[:width] for array in self.rows)
        self.rows = tuple(array[width:] for array in self.rows)
        return taken


class PlanSearch(Visit):
    """A search for a way to an end: breadth-first, so that the first one found is a shortest one.

    Once more than `limit` states were met, each layer is cut to `width` states before it is left: those with the fewest
    matches of the guides, drawn by lot among equals, always the same. Where nothing comes after them, the next ones of
    the layer take their turn. Such a beam goes on up to the time limit of the behaviour, and has no shortest plan. What
    is found does not depend on whether numba is installed.

    Args:
        program: the compiled behaviour.
        outcome: 1 for success, 2 for failure.
        limit: how many states may be met before layers are cut.
        width: how many states are kept of a layer.
        most: how many states may be met in all; None: any number.
        progress: called now and then with the number of states.

    Attributes:
        before, by: of each state, the one that it was met from, and the action; -1 for those that an episode begins in.
        outcomes: how many it may make before it is given up; None: any number.
    """

    outcomes: int | None = None

    def __init__(
        self,
        program: Program,
        outcome: int = 1,
        limit: int = BREADTH,
        width: int = WIDTH,
        most: int | None = None,
        progress: Progress | None = None,
    ) -> None:
        super().__init__(program, 0, limit, progress)
        self._outcome, self._width, self._most = outcome, width, most
        self._tried = different_actions(program)
        self.before, self.by = np.zeros(FIRST, np.int64), np.zeros(FIRST, np.int64)

    def plan(self, guides: int) -> Plan:
        """Search layer by layer, with this many of the observations as guides: see `guided`.

        Raises:
            EvaluationError, RuleError, NotCompiled: as `enumerated`.
        """
        behaviour = self._program.behaviour
        start = len(self._program.observation_shape) - guides
        if not behaviour.together:
            start = int(len(behaviour.agents) > 1)  # behind the number of the block
        guide = slice(start, start + guides)
        lot = np.random.default_rng(0)
        first, (last, _, _) = 0, self.begin()
        self.before[:last] = -1
        met, depth, cut = last, 0, False
        left, self._made = _Layer(0, ()), 0
        horizon = self._program.behaviour.limit or HORIZON
        while first < last and (depth < horizon or not cut):
            if last > self._limit and last - first > self._width:
                score = self.components[first:last, guide].sum(axis=1)
                order = first + np.lexsort((lot.random(last - first), score))
                left, cut = _Layer(depth, tuple(array[order[self._width :]] for array in self._rows())), True
                last = self._cut(first, last, np.sort(order[: self._width]))
            found, count = self._expanded(first, last)
            met += count - last
            depth += 1
            if found is not None:
                names = self._program.action_names
                self._found = found
                actions = tuple(names[action] for action in self._actions_to(*found))
                return Plan(float(depth), actions, met, self._limit, self._width if cut else None)
            if self._most is not None and met > self._most:
                return Plan(inf, (), met, self._limit, self._width)
            first, last = last, count
            if first == last and left.count:
                depth, last = left.depth, self._put(first, left.take(self._width))
        return Plan(inf, (), met, self._limit, self._width if cut else None)

    def _expanded(self, first: int, last: int) -> tuple[tuple[int, int] | None, int]:
        """The state and the action that lead to the end, if any of a layer do, and how many states there are now."""
        head, states = first, last
        while True:
            how, head, states, self._made, action = self._kernels["expand"](
                *self._world(),
                self._member,
                self.floats.view(np.int64),
                self.hashed,
                self.components,
                self.observations,
                head,
                last,
                states,
                self._made,
                self._tried,
                MOST_OUTCOMES,
                self._made + TOLD if self.outcomes is None else self.outcomes,
                self._outcome,
                self.before,
                self.by,
            )
            if self._progress is not None:
                self._progress(states, 0)
            if how == PAUSED and self.outcomes is not None:
                raise TooManyStates(self._program.behaviour, self._limit, outcomes=self.outcomes)
            if how in {DONE, FOUND}:
                return ((head, action) if how == FOUND else None), states
            if how == SPACE:
                self._grow(states, 0)
            elif how != PAUSED:
                self._raise(head, action, states)

    def _cut(self, first: int, last: int, kept: np.ndarray[tuple[int], np.dtype[np.int64]]) -> int:
        """Keep some states of the last layer, and forget the others; how many there are then."""
        bits = self.floats.view(np.int64)
        self._kernels["forget_last"](self.states, bits, self.hashed, first, last)
        end = first + len(kept)
        for array in self._rows():
            array[first:end] = array[kept]
        self._kernels["hash_all"](self.states, bits, self.hashed, first, end)
        return end

    def _put(self, first: int, rows: _Rows) -> int:
        """Go on with states that were left out of a layer; how many there are then."""
        end = first + len(rows[0])
        if end >= len(self.states) - 1:
            self._grow(first, 0)
        for array, row in zip(self._rows(), rows, strict=True):
            array[first:end] = row
        self._kernels["hash_all"](self.states, self.floats.view(np.int64), self.hashed, first, end)
        return end

    def _rows(self) -> _Rows:
        return (self.states, self.floats, self.components, self.before, self.by)

    def _grow(self, states: int, used: int) -> None:
        super()._grow(states, used)
        self.before, self.by = longer(self.before, len(self.states)), longer(self.by, len(self.states))

    def episode(self) -> Iterator[Simulator]:
        """The states of the plan that was found, on the live engine of the member."""
        state, action = self._found
        way = [state]
        while self.before[way[-1]] >= 0:
            way.append(int(self.before[way[-1]]))
        twin = self._program.twin(self._member)
        for row in reversed(way):
            with twin.at(self.states[row], self.floats[row]) as simulator:
                yield simulator
        with (
            twin.at(self.states[state], self.floats[state]) as simulator,
            closing(simulator.outcomes(action)) as outcomes,
        ):
            if any(ended == self._outcome for _, _, ended in outcomes):  # it stops where that is so
                yield simulator

    def _actions_to(self, state: int, action: int) -> Iterable[int]:
        actions = [action]
        while self.before[state] >= 0:
            actions.append(int(self.by[state]))
            state = int(self.before[state])
        return reversed(actions)
