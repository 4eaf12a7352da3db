"""The best that a search has met: of several objectives, everything that nothing else dominates."""

from __future__ import annotations

from collections.abc import Iterator

from envgraph.code import dataclass
from envgraph.graph import Version
from envgraph.rewrite import Firing
from envgraph.search.optimising._goals import Standing

Path = tuple["Path", tuple[Firing, ...]] | None
"""What was applied from the start of a search, the last move first: paths share what they begin with."""


def steps_of(path: Path) -> tuple[Firing, ...]:
    """The applications of a path in their order."""
    moves = []
    while path is not None:
        path, firings = path
        moves.append(firings)
    return tuple(firing for firings in reversed(moves) for firing in firings)


@dataclass(frozen=True, slots=True)
class Found:
    """A state that a search has met: what it is worth, and how to come back to it."""

    standing: Standing
    version: Version
    path: Path


class Archive:
    """States none of which dominates another one, as they were met; of equal ones the first.

    Attributes:
        changes: how often it has improved.
    """

    def __init__(self) -> None:
        self._found: list[Found] = []
        self.changes = 0

    def wants(self, standing: Standing) -> bool:
        """Whether a state of this worth would be kept."""
        return not any(
            found.standing == standing or found.standing.dominates(standing) for found in self._found
        )

    def put(self, found: Found) -> None:
        """Keep a state that is wanted, and let go of those that it dominates."""
        self._found = [other for other in self._found if not found.standing.dominates(other.standing)]
        self._found.append(found)
        self.changes += 1

    def __iter__(self) -> Iterator[Found]:
        """By costs, the least of the first goal first."""
        return iter(sorted(self._found, key=lambda found: found.standing))

    def __len__(self) -> int:
        return len(self._found)

    def bounds(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """The least and the greatest of each cost in it."""
        costs = list(zip(*(found.standing.costs for found in self._found), strict=True))
        return tuple(map(min, costs)), tuple(map(max, costs))


def ranked(standings: list[Standing]) -> list[int]:
    """Indices from the best: by violation, front after front of what nothing dominates, in each the loneliest first.

    Non-dominated sorting and crowding distance are those of NSGA-II (Deb, Pratap, Agarwal and Meyarivan 2002, III);
    with one goal this is the order of costs. Equals keep their order.
    """
    everything = range(len(standings))
    if len(standings[0].costs) == 1:
        return sorted(everything, key=standings.__getitem__)
    worse = [[two for two in everything if standings[one].dominates(standings[two])] for one in everything]
    better, order = [0] * len(standings), list[int]()  # how many are better and not in the order yet
    for dominated in worse:
        for one in dominated:
            better[one] += 1
    front = [one for one in everything if not better[one]]
    while front:
        distance = dict(zip(front, _crowding([standings[one].costs for one in front]), strict=True))
        order += sorted(front, key=lambda one: -distance[one])
        left = list[int]()
        for one in front:
            for two in worse[one]:
                better[two] -= 1
                if not better[two]:
                    left.append(two)
        front = sorted(left)
    return order


def _crowding(costs: list[tuple[float, ...]]) -> list[float]:
    """How far apart the neighbours of each point are, summed over the goals; infinite at the ends."""
    infinity = float("inf")
    distance = [0.0] * len(costs)
    for goal in range(len(costs[0])):
        order = sorted(range(len(costs)), key=lambda one: costs[one][goal])
        low, high = costs[order[0]][goal], costs[order[-1]][goal]
        distance[order[0]] = distance[order[-1]] = infinity
        if low < high < infinity:
            for before, one, after in zip(order, order[1:], order[2:], strict=False):
                distance[one] += (costs[after][goal] - costs[before][goal]) / (high - low)
    return distance
