"""The result of an exploration: states, transitions and statistics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, field
from functools import cached_property
from typing import TYPE_CHECKING, Literal, NamedTuple

from envgraph.code import dataclass, shorten_repr
from envgraph.draw import html_table
from envgraph.errors import InvalidArgument, did_you_mean
from envgraph.graph import Model, Version
from envgraph.rewrite._matches import Firing, Match, Row, Shape

if TYPE_CHECKING:
    import networkx as nx

Ending = Literal["exhausted", "goal", "limit", "depth"]
"""The reason why an exploration ended: all moves were made ("exhausted"), a goal was found, there are more states than
the limit, or only states at the maximal depth are left."""

Firings = tuple[Firing, ...]


@shorten_repr
class State(NamedTuple):
    """A state found by an exploration.

    Attributes:
        number: from 0, in the order of discovery; 0 is the state in which the exploration began.
        depth: number of moves on the path by which it was found; with strategy "breadth" this is the minimum.
        holds: names of the predicates that hold in this state.
        version: the version for `Engine.checkout` if the exploration was called with `keep`, else None.
    """

    number: int
    depth: int
    holds: tuple[str, ...]
    version: Version | None


@shorten_repr
class Transition(NamedTuple):
    """A move from a state to another state, or to the same state.

    Attributes:
        source, target: numbers of states.
        name: name of the rule or unit.
        firings: the applications of the move: the rule with its match, or all applications of the unit.
    """

    source: int
    target: int
    name: str
    firings: Firings


@dataclass(frozen=True, slots=True)
class Statistics:
    """Statistics of an exploration.

    Attributes:
        states, transitions: numbers of states and transitions found.
        expanded: number of states from which all moves were made.
        refused: number of moves that the model refused, for example because of a dangling edge.
        depth: depth of the deepest state.
        merged: number of states that were isomorphic to an earlier state; 0 unless `up_to` is "isomorphism".
    """

    states: int
    transitions: int
    expanded: int
    refused: int
    depth: int
    merged: int


@dataclass(slots=True)
class ExplorationRecord:
    """The states and transitions that a search has recorded so far.

    Attributes:
        states: the states, by number.
        found_by: for each state, the index of the transition that found it; -1 for the first state.
        sources, targets, names, applied: columns of the transitions; `applied` is the row of a rule's match, or the
            firings of a unit.
        expanded, refused, merged: as in `Statistics`; `expanded` lists the states.
        goal: number of the goal state that was found, or None.
    """

    states: list[State] = field(default_factory=list)
    found_by: list[int] = field(default_factory=list)
    sources: list[int] = field(default_factory=list)
    targets: list[int] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    applied: list[Row | Firings] = field(default_factory=list)
    expanded: list[int] = field(default_factory=list)
    refused: int = 0
    merged: int = 0
    goal: int | None = None

    def add_transition(self, source: int, target: int, name: str, done: Row | Firings) -> None:
        """Add a transition by a rule or unit. `done` is the row of the rule's match, or the firings of the unit."""
        self.sources.append(source)
        self.targets.append(target)
        self.names.append(name)
        self.applied.append(done)


@shorten_repr
class Exploration:
    """The states that `Engine.explore` found, and the transitions between them.

    Attributes:
        predicates: names of the predicates that were evaluated in every state.
        ending: the reason why the exploration ended.
        not_compiled: None if a compiled program explored the states, else the reason why the engine did.
    """

    def __init__(
        self,
        record: ExplorationRecord | Callable[[], ExplorationRecord],
        model: Model,
        shapes: Mapping[str, Shape],
        predicates: tuple[str, ...],
        ending: Ending,
        not_compiled: str | None,
    ) -> None:
        self._given = record
        self._model = model
        self._shapes = shapes
        self.not_compiled = not_compiled
        self.predicates = predicates
        self.ending: Ending = ending

    @cached_property
    def _record(self) -> ExplorationRecord:
        return self._given if isinstance(self._given, ExplorationRecord) else self._given()

    @property
    def goal(self) -> int | None:
        """Return the number of the goal state, or None if no goal was found."""
        return self._record.goal

    def __len__(self) -> int:
        return len(self._record.found_by)

    def __repr__(self) -> str:
        count = f"{len(self)} states, {len(self._record.sources)} transitions"
        return f"<Exploration: {count}, {self.ending}>"

    def _repr_html_(self) -> str:
        return html_table([*asdict(self.statistics).items(), ("ending", self.ending)])

    @property
    def complete(self) -> bool:
        """Return True if all reachable states and transitions were found."""
        return self.ending == "exhausted"

    @property
    def statistics(self) -> Statistics:
        """Return the statistics of the exploration."""
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
    def states(self) -> tuple[State, ...]:
        """Return all states, in the order of discovery."""
        return tuple(self._record.states)

    @cached_property
    def transitions(self) -> tuple[Transition, ...]:
        """Return all transitions, in the order in which the moves were made."""
        record = self._record
        moves = enumerate(zip(record.sources, record.targets, record.names, strict=True))
        return tuple(Transition(*ends_and_name, self._firings(place)) for place, ends_and_name in moves)

    def _firings(self, place: int) -> Firings:
        name, done = self._record.names[place], self._record.applied[place]
        if name in self._shapes:
            return (Firing(name, done),)  # type: ignore[arg-type]
        return done  # type: ignore[return-value]

    def path(self, state: int | None = None) -> list[Firing]:
        """Return the firings that lead from the first state to a state, by default the goal; see `Engine.replay`.

        With strategy "breadth" no path has fewer moves.

        Raises:
            InvalidArgument: the state does not exist, or no goal was found.
        """
        number = self.goal if state is None else state
        if number is None:
            raise InvalidArgument("no goal was found: pass the number of a state")
        if not 0 <= number < len(self):
            raise InvalidArgument(f"state {number} does not exist; states are numbered from 0 to {len(self) - 1}")
        legs: list[Firings] = []
        while number:
            place = self._record.found_by[number]
            legs.append(self._firings(place))
            number = self._record.sources[place]
        return [firing for leg in reversed(legs) for firing in leg]

    def holding(self, predicate: str) -> list[int]:
        """Return the numbers of the states in which a predicate holds.

        Raises:
            InvalidArgument: the exploration has no such predicate.
        """
        if predicate not in self.predicates:
            hint = did_you_mean(predicate, self.predicates)
            raise InvalidArgument(f"`{predicate}` is not a predicate of this exploration", hint)
        return [state.number for state in self.states if predicate in state.holds]

    @property
    def deadlocks(self) -> list[int]:
        """Return the numbers of the states from which all moves were made without any transition."""
        left = set(self._record.sources)
        return sorted(state for state in self._record.expanded if state not in left)

    @cached_property
    def graph(self) -> nx.MultiDiGraph:
        """Return a networkx graph with the states (by number) as nodes and the transitions as edges.

        Nodes have the attributes of `State` except the number. Edges have the attributes `name`, `firings` and `match`,
        which is the match of the rule, or None for a unit.
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
