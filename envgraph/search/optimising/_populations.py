"""Strategies that follow several models at once."""

from __future__ import annotations

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument
from envgraph.lang import Options, key
from envgraph.search.optimising._archive import Found, ranked
from envgraph.search.optimising._walk import Walk


@dataclass(frozen=True, slots=True)
class Beam:
    """Beam search: the best states go on, each by several random moves.

    Of several goals the best are chosen as NSGA-II does, front after front, and within a front those that are far
    from others: then this is NSGA-II with moves as its only operators, and states that are different.

    Attributes:
        width: states that go on.
        branching: moves that are tried from each of them.
    """

    width: int = key(20, Options.integer, low=1, most=100_000)
    branching: int = key(5, Options.integer, low=1, most=100_000)

    def __post_init__(self) -> None:
        if self.width < 1 or self.branching < 1:
            raise InvalidArgument("`width` and `branching` are numbers from 1")

    def search(self, walk: Walk) -> None:
        """See `Strategy`."""
        beam: dict[int, Found] = {walk.state(): walk.start}
        while not walk.over():
            pool = dict(beam)
            for found in beam.values():
                for _ in range(self.branching):
                    if walk.over():
                        break
                    walk.go(found)
                    if walk.attempt() is not None:
                        walk.keep()
                        pool.setdefault(walk.state(), walk.found())
            states = list(pool)
            order = ranked([pool[state].standing for state in states])
            beam = {states[place]: pool[states[place]] for place in order[: self.width]}
