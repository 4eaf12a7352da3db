"""The result of an exploration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from functools import cached_property
from typing import TYPE_CHECKING, Literal, NamedTuple

from envgraph.code import dataclass, short_repr
from envgraph.errors import InvalidArgument, did_you_mean
from envgraph.graph import Model, Version
from envgraph.rewrite._match import Firing, Match, Row, Shape

if TYPE_CHECKING:
    import networkx as nx

Ending = Literal["exhausted", "goal", "limit", "depth"]
"""Why an exploration ended: every state was left in every way, a goal was found, there were too many states, or what is
left are states as deep as was asked for."""

Firings = tuple[Firing, ...]


@short_repr
class State(NamedTuple):
    """A state that was found.

    Attributes:
        number: from 0, in the order in which states were found; 0 is the one in which the exploration began.
        depth: how many moves the path has by which it was found; with strategy "breadth" none is shorter.
        holds: names of the predicates that hold.
        version: for `Engine.checkout`, if versions were to be kept.
    """

    number: int
    depth: int
    holds: tuple[str, ...]
    version: Version | None


@short_repr
class Transition(NamedTuple):
    """A move from one state to another, or to itself.

    Attributes:
        source, target: numbers of states.
        name: of the rule, or of the unit.
        firings: what was applied: the rule and its match, or all that the unit did.
    """

    source: int
    target: int
    name: str
    firings: Firings


@dataclass(frozen=True, slots=True)
class Statistics:
    """Figures of an exploration.

    Attributes:
        states, transitions: how many were found.
        expanded: states of which all moves were made.
        refused: moves that the model refused, for a dangling link or the like.
        depth: of the deepest state.
        merged: states by identity that were isomorphic to one found before; 0 unless `up_to` is "isomorphism".
    """

    states: int
    transitions: int
    expanded: int
    refused: int
    depth: int
    merged: int


@dataclass(slots=True)
class Record:
    """What a search writes down.

    Attributes:
        states: by number.
        found_by: for each state the place of the transition by which it was found, -1 for the first.
        sources, targets, names, done: columns of the transitions; `done` is a rule's match, or what a unit applied.
        expanded, refused, merged: as in `Statistics`.
        goal: number of the goal that was found.
    """

    states: list[State] = field(default_factory=list)
    found_by: list[int] = field(default_factory=list)
    sources: list[int] = field(default_factory=list)
    targets: list[int] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    done: list[Row | Firings] = field(default_factory=list)
    expanded: list[int] = field(default_factory=list)
    refused: int = 0
    merged: int = 0
    goal: int | None = None

    def note(self, source: int, target: int, name: str, done: Row | Firings) -> None:
        """One more transition."""
        self.sources.append(source)
        self.targets.append(target)
        self.names.append(name)
        self.done.append(done)


@short_repr
class Exploration:
    """The states that were found, and the transitions between them; made by `Engine.explore`.

    Attributes:
        states: in the order in which they were found.
        predicates: names of what was asked of every state.
        ending: why it ended.
        goal: number of the state that is a goal, None if there was none.
    """

    def __init__(
        self,
        record: Record,
        model: Model,
        shapes: Mapping[str, Shape],
        predicates: tuple[str, ...],
        ending: Ending,
    ) -> None:
        self._record = record
        self._model = model
        self._shapes = shapes
        self.states: tuple[State, ...] = tuple(record.states)
        self.predicates = predicates
        self.ending: Ending = ending
        self.goal = record.goal

    def __len__(self) -> int:
        return len(self.states)

    def __repr__(self) -> str:
        count = f"{len(self)} states, {len(self._record.sources)} transitions"
        return f"<Exploration: {count}, {self.ending}>"

    @property
    def complete(self) -> bool:
        """Whether all reachable states and transitions are there."""
        return self.ending == "exhausted"

    @property
    def statistics(self) -> Statistics:
        """Figures."""
        record = self._record
        return Statistics(
            states=len(self),
            transitions=len(record.sources),
            expanded=len(record.expanded),
            refused=record.refused,
            depth=max(state.depth for state in self.states),
            merged=record.merged,
        )

    @cached_property
    def transitions(self) -> tuple[Transition, ...]:
        """In the order in which they were made."""
        return tuple(map(self._transition, range(len(self._record.sources))))

    def _transition(self, place: int) -> Transition:
        record = self._record
        return Transition(
            record.sources[place], record.targets[place], record.names[place], self._firings(place)
        )

    def _firings(self, place: int) -> Firings:
        name, done = self._record.names[place], self._record.done[place]
        if name in self._shapes:
            return (Firing(name, done),)  # type: ignore[arg-type]
        return done  # type: ignore[return-value]

    def path(self, state: int | None = None) -> list[Firing]:
        """Return what leads from the first state to another one, by default to the goal; `Engine.replay` does it again.

        With strategy "breadth" there is no path of fewer moves.

        Raises:
            InvalidArgument: no such state, or no goal was found.
        """
        number = self.goal if state is None else state
        if number is None:
            raise InvalidArgument("no goal was found: give the number of a state")
        if not 0 <= number < len(self):
            raise InvalidArgument(f"there are states 0 to {len(self) - 1}, no {number}")
        legs: list[Firings] = []
        while number:
            place = self._record.found_by[number]
            legs.append(self._firings(place))
            number = self._record.sources[place]
        return [firing for leg in reversed(legs) for firing in leg]

    def holding(self, predicate: str) -> list[int]:
        """Numbers of the states in which a predicate holds.

        Raises:
            InvalidArgument: there is no such predicate.
        """
        if predicate not in self.predicates:
            hint = did_you_mean(predicate, self.predicates)
            raise InvalidArgument(f"`{predicate}` was not asked", hint)
        return [state.number for state in self.states if predicate in state.holds]

    @property
    def deadlocks(self) -> list[int]:
        """Numbers of the states that no move leaves."""
        left = set(self._record.sources)
        return sorted(state for state in self._record.expanded if state not in left)

    @cached_property
    def graph(self) -> nx.MultiDiGraph:
        """The states as nodes, by number, and the transitions as edges.

        Nodes have the attributes of `State` but the number; edges have `name` and `firings`, and `match`: that of the
        rule, or None for a unit.
        """
        import networkx as nx

        graph = nx.MultiDiGraph(ending=self.ending, goal=self.goal)
        for state in self.states:
            graph.add_node(state.number, depth=state.depth, holds=state.holds, version=state.version)
        for source, target, name, firings in self.transitions:
            shape = self._shapes.get(name)
            match = None if shape is None else Match(self._model, shape, firings[0].values)
            graph.add_edge(source, target, name=name, match=match, firings=firings)
        return graph
