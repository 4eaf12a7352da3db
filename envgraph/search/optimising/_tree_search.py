"""A strategy that builds a search tree: Monte Carlo tree search over sequences of moves."""

from __future__ import annotations

from math import inf, log, sqrt

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument
from envgraph.lang import ComponentOptions, key
from envgraph.search.optimising._goals import ConstrainedCosts
from envgraph.search.optimising._pareto_archive import FoundState
from envgraph.search.optimising._search_walk import Walk


class _SearchNode:
    """A state in the search tree, with its number of visits and the sum of the rewards in its subtree."""

    __slots__ = ("children", "found", "reward", "visits")

    def __init__(self, found: FoundState) -> None:
        self.found, self.children = found, list[_SearchNode]()
        self.visits, self.reward = 0, 0.0

    def best_child(self, exploration: float) -> _SearchNode:
        """Return the child with the highest upper confidence bound (UCB1; Kocsis and Szepesvári 2006)."""
        spread = exploration * sqrt(log(self.visits))
        return max(self.children, key=lambda child: child.reward / child.visits + spread / sqrt(child.visits))


@dataclass(frozen=True, slots=True)
class TreeSearch:
    """Monte Carlo tree search (UCT): sequences of moves are continued where earlier results were good.

    A new child is the best state on a sequence of random moves. Its reward, from 0 to 1, relates its costs to the best
    and worst costs found so far; with several goals it is the mean. A state has at most as many children as the square
    root of its visits (progressive widening; Coulom 2007), so that the tree grows where rewards are high.

    Attributes:
        exploration: weight of the exploration term, which favours children with few visits.
        length: number of random moves from a state to its child.
    """

    exploration: float = key(0.1, ComponentOptions.number, low=0, high=1e9)
    length: int = key(10, ComponentOptions.integer, low=1, most="width")

    def __post_init__(self) -> None:
        if self.exploration < 0 or self.length < 1:
            raise InvalidArgument(
                f"`exploration` and `length` are {self.exploration} and {self.length}, but must be at least 0 and 1"
            )

    def search(self, walk: Walk) -> None:
        """Search by Monte Carlo tree search until the walk is over."""
        scale, root = _RewardScale(walk.current_costs), _SearchNode(walk.initial_state)
        while not walk.over():
            node, line = root, [root]
            while node.children and len(node.children) > sqrt(node.visits):
                node = node.best_child(self.exploration)
                line.append(node)
            walk.check_out(node.found)
            best = self._play_random_moves(walk, scale)
            if best is not None:
                node.children.append(_SearchNode(best))
                line.append(node.children[-1])
            reward = scale.reward_of(line[-1].found.costs)
            for visited in line:
                visited.visits += 1
                visited.reward += reward

    def _play_random_moves(self, walk: Walk, scale: _RewardScale) -> FoundState | None:
        """Make random moves from the current state. Return the best state on the way; None if no move succeeded."""
        best: FoundState | None = None
        for _ in range(self.length):
            if walk.over():
                break
            standing = walk.attempt()
            if standing is None:
                continue
            walk.keep()
            scale.update_range(standing)
            if best is None or scale.reward_of(standing) >= scale.reward_of(best.costs):
                best = walk.commit_state()
        return best


class _RewardScale:
    """A scale of rewards from 0 to 1, relative to the best and worst evaluations so far; below 0.5 for violations."""

    def __init__(self, standing: ConstrainedCosts) -> None:
        self._violation = standing.violation
        self._low, self._high = [inf] * len(standing.costs), [-inf] * len(standing.costs)
        self.update_range(standing)

    def update_range(self, standing: ConstrainedCosts) -> None:
        self._violation = max(self._violation, standing.violation)
        for place, cost in enumerate(standing.costs):
            if cost < inf:
                self._low[place] = min(self._low[place], cost)
                self._high[place] = max(self._high[place], cost)

    def reward_of(self, standing: ConstrainedCosts) -> float:
        if standing.violation:
            return 0.5 * (1 - standing.violation / self._violation)
        parts = [
            0.0 if cost == inf else (high - cost) / (high - low) if low < high else 1.0
            for cost, low, high in zip(standing.costs, self._low, self._high, strict=True)
        ]
        return 0.5 + 0.5 * sum(parts) / len(parts)
