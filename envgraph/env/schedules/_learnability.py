"""Sampling for learnability: search for members that the student solves sometimes, and play these more often."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.random import Generator

from envgraph.code import dataclass
from envgraph.env.schedules._fixed_order import Shuffled
from envgraph.env.schedules._protocol import Batch, Floats, Ints, Outcomes


@dataclass(frozen=True, slots=True)
class Sifting:
    """The settings of sampling for learnability (Rutherford et al. 2024).

    Attributes:
        episodes: number of episodes that score each candidate; None if exact scores are known.
        every: number of members played between two searches.
        candidates: number of members scored in a search.
        best: number of candidates that are used until the next search.
        share: the share of the played members that is sampled from the best candidates.
    """

    episodes: int | None = 4
    every: int = 800
    candidates: int = 256
    best: int = 32
    share: float = 0.5


class Sifter:
    """A schedule that samples a share of members from the best of the last search, and plays others in random order.

    The score of a candidate is p (1 - p), where p is the share of its episodes that succeed. A search returns each
    candidate once for each of these episodes, with `learn` False.

    Args:
        members: the numbers of all members.
        sifting: the settings; None for the defaults.
        exact: returns exact scores of members, so that candidates need not be played.
    """

    def __init__(
        self, members: Ints, sifting: Sifting | None = None, exact: Callable[[Ints], Floats] | None = None
    ) -> None:
        self._how = sifting or Sifting()
        assert (exact is None) == (self._how.episodes is not None), "scores come from episodes, or are exact"
        self._source, self._exact = Shuffled(members), exact
        self._best: Ints = np.zeros(0, np.int64)
        self._owed = 0.0  # number of `_best` members still to be played for their share
        self._since = self._how.every
        self._queue: Ints = np.zeros(0, np.int64)
        self._found: dict[int, list[float]] = {}

    def ask(self, count: int, rng: Generator) -> Batch:
        """Return candidates of the current search, which begins now if it is due, or else members to learn on."""
        if self._since >= self._how.every:
            self._begin_search(rng)
        if len(self._queue):
            asked, self._queue = np.resize(self._queue, count), self._queue[count:]
            return Batch(asked, learn=False, episodes=1)
        self._since += count
        self._owed += count * self._how.share if len(self._best) else 0.0
        chosen = int(self._owed)
        self._owed -= chosen
        sifted = rng.choice(self._best, chosen) if chosen else self._best[:0]
        return Batch(np.concatenate([sifted, self._source.next_members(count - chosen, rng)]))

    def tell(self, outcomes: Outcomes) -> None:
        """Record the episodes of candidates; when each has enough, end the search and select the best candidates."""
        if not self._found:
            return
        for member, success in zip(outcomes.members.tolist(), outcomes.success.tolist(), strict=True):
            if member in self._found:
                self._found[member].append(success)
        least = self._how.episodes or 0
        if all(len(one) >= least for one in self._found.values()):
            success = np.array([sum(one) / len(one) for one in self._found.values()])
            self._select_best(np.array([*self._found], np.int64), success * (1.0 - success))
            self._found = {}

    def _begin_search(self, rng: Generator) -> None:
        self._since = 0
        candidates = self._source.next_members(min(self._how.candidates, len(self._source.members)), rng)
        if self._exact is not None:
            self._select_best(candidates, self._exact(candidates))
            return
        self._queue = np.repeat(candidates, self._how.episodes or 0)
        self._found = {one: [] for one in candidates.tolist()}

    def _select_best(self, candidates: Ints, scores: Floats) -> None:
        self._best = candidates[np.argsort(-scores, kind="stable")[: self._how.best]]
