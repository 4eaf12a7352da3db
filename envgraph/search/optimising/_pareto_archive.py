"""The archive of a search: the non-dominated states found so far (the Pareto front)."""

from __future__ import annotations

from collections.abc import Iterator

from envgraph.code import dataclass
from envgraph.graph import Version
from envgraph.rewrite import Firing
from envgraph.search.optimising._goals import ConstrainedCosts

MovePath = tuple["MovePath", tuple[Firing, ...]] | None
"""Linked list of the moves from the initial model, the last move first, so that paths share their beginnings."""


def applications_of(path: MovePath) -> tuple[Firing, ...]:
    """Return the rule applications of a path in the order in which they were applied."""
    moves = []
    while path is not None:
        path, firings = path
        moves.append(firings)
    return tuple(firing for firings in reversed(moves) for firing in firings)


@dataclass(frozen=True, slots=True)
class FoundState:
    """A state found by a search: its evaluation, its version and the path to it."""

    costs: ConstrainedCosts
    version: Version
    path: MovePath


class ParetoArchive:
    """States that do not dominate each other, in the order in which they were found, without equal evaluations."""

    def __init__(self) -> None:
        self._found: list[FoundState] = []

    def accepts(self, costs: ConstrainedCosts) -> bool:
        """Return True if no state in the archive equals or dominates a state with this evaluation."""
        return not any(found.costs == costs or found.costs.dominates(costs) for found in self._found)

    def add_state(self, found: FoundState) -> None:
        """Add a state that `accepts` accepts, and remove the states that it dominates."""
        self._found = [other for other in self._found if not found.costs.dominates(other.costs)]
        self._found.append(found)

    def __iter__(self) -> Iterator[FoundState]:
        """Yield the states sorted by costs, the lowest cost of the first goal first."""
        return iter(sorted(self._found, key=lambda found: found.costs))

    def __len__(self) -> int:
        return len(self._found)

    def cost_bounds(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the minima and the maxima of the costs in the archive, one of each per goal."""
        costs = list(zip(*(found.costs.costs for found in self._found), strict=True))
        return tuple(map(min, costs)), tuple(map(max, costs))


def rank_states(standings: list[ConstrainedCosts]) -> list[int]:
    """Return the indices of the states in order, the best first.

    States are sorted by violation, then by non-dominated front. Within a front, states with the largest crowding
    distance come first. Both are those of NSGA-II (Deb, Pratap, Agarwal and Meyarivan 2002, III). With one goal this is
    the order of costs. Equal states keep their order.
    """
    everything = range(len(standings))
    if len(standings[0].costs) == 1:
        return sorted(everything, key=standings.__getitem__)
    worse = [[two for two in everything if standings[one].dominates(standings[two])] for one in everything]
    better, order = (
        [0] * len(standings),
        list[int](),
    )  # number of states that dominate each state and are not in the order yet
    for dominated in worse:
        for one in dominated:
            better[one] += 1
    front = [one for one in everything if not better[one]]
    while front:
        distance = dict(zip(front, _crowding_distances([standings[one].costs for one in front]), strict=True))
        order += sorted(front, key=lambda one: -distance[one])
        left = list[int]()
        for one in front:
            for two in worse[one]:
                better[two] -= 1
                if not better[two]:
                    left.append(two)
        front = sorted(left)
    return order


def _crowding_distances(costs: list[tuple[float, ...]]) -> list[float]:
    """Return the crowding distance of each point: the gap between its neighbours, summed over goals, or `inf`."""
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
