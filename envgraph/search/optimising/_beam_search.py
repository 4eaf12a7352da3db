"""A strategy that follows several models at once: beam search."""

from __future__ import annotations

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument
from envgraph.lang import ComponentOptions, key
from envgraph.search.optimising._pareto_archive import FoundState, rank_states
from envgraph.search.optimising._search_walk import Walk


@dataclass(frozen=True, slots=True)
class Beam:
    """Beam search: each of the best states is continued by several random moves.

    With several goals the best states are selected as in NSGA-II, by fronts and then by crowding distance. Beam search
    is then NSGA-II with moves as the only operators and without duplicate states.

    Attributes:
        width: number of states that are continued.
        branching: number of moves that are tried from each state.
    """

    width: int = key(20, ComponentOptions.integer, low=1, most="width")
    branching: int = key(5, ComponentOptions.integer, low=1, most="width")

    def __post_init__(self) -> None:
        if self.width < 1 or self.branching < 1:
            raise InvalidArgument(
                f"`width` and `branching` are {self.width} and {self.branching}, but must be at least 1"
            )

    def search(self, walk: Walk) -> None:
        """Search by beam search until the walk is over."""
        beam: dict[int, FoundState] = {walk.current_state_hash(): walk.initial_state}
        while not walk.over():
            pool = dict(beam)
            for found in beam.values():
                for _ in range(self.branching):
                    if walk.over():
                        break
                    walk.check_out(found)
                    if walk.attempt() is not None:
                        walk.keep()
                        pool.setdefault(walk.current_state_hash(), walk.commit_state())
            states = list(pool)
            order = rank_states([pool[state].costs for state in states])
            beam = {states[place]: pool[states[place]] for place in order[: self.width]}
