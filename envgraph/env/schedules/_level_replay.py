"""Prioritised level replay: play again the members with high scores."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Final

import numpy as np
from numpy.random import Generator

from envgraph.code import dataclass
from envgraph.env.schedules._fixed_order import Shuffled
from envgraph.env.schedules._protocol import Batch, Floats, Ints, Outcomes, Score

Edit = Callable[[Ints, Generator], Ints]
"""A function that creates a new member from each of the given members, and returns their numbers."""

MIN_FILLED: Final = 0.5
"""The share of a buffer that must be filled before it is replayed, as in JaxUED (Coward et al. 2024)."""


@dataclass(frozen=True, slots=True)
class Buffer:
    """The settings of prioritised level replay (Jiang et al. 2021a).

    Attributes:
        size: number of members in the buffer: those with the highest scores.
        replay: probability that a batch is sampled from the buffer.
        temperature: a member at rank r is replayed in proportion to r ** (-1 / temperature).
        staleness: share of the probability that depends on the time since a member was last replayed.
        fresh_learned: True if students learn on members that are played for the first time; False in robust replay
            (Jiang et al. 2021b).
    """

    size: int = 500
    replay: float = 0.5
    temperature: float = 0.3
    staleness: float = 0.3
    fresh_learned: bool = True


class BestReturnScore:
    """A score: the highest return ever seen on a member, minus its current mean return.

    It is MaxMC (Jiang et al. 2021b) with returns in place of a student's values.
    """

    def __init__(self) -> None:
        self._best: dict[int, float] = {}

    def __call__(self, outcomes: Outcomes) -> Floats:
        """Update the highest returns, and return for each outcome the member's highest return minus its mean return."""
        for member, one in zip(outcomes.members.tolist(), outcomes.returns.tolist(), strict=True):
            self._best[member] = max(self._best.get(member, -inf), one)
        return np.array([self._best[one] for one in outcomes.members.tolist()]) - outcomes.returns


class Replay:
    """A schedule that replays members with high scores from a buffer, and in between plays others in random order.

    If the buffer holds all members, only replays happen, as in Jiang et al. (2021a) with a fixed set of levels.

    Args:
        members: the numbers of all members.
        buffer: the settings of the buffer; None for the defaults.
        score: computes scores if the outcomes have none.
        edit: creates a new member from each replayed one, to be scored next: ACCEL (Parker-Holder et al. 2022).
    """

    def __init__(
        self,
        members: Ints,
        buffer: Buffer | None = None,
        score: Score | None = None,
        edit: Edit | None = None,
    ) -> None:
        self._buffer = buffer = buffer or Buffer()
        self._source = Shuffled(members)
        self._size = min(buffer.size, len(members))
        self._kept = ReplayBuffer(buffer, self._size)
        self._score = score or BestReturnScore()
        self._edit, self._parents = edit, members[:0]
        self._batches = 0

    def ask(self, count: int, rng: Generator) -> Batch:
        """Return members sampled from the buffer, or, before it is half full and otherwise by chance, the next members.

        With `edit`, the batch after a replay has edits of the replayed members, which are played only to score them.
        """
        self._batches += 1
        if self._edit and len(self._parents):
            parents, self._parents = np.resize(self._parents, count), self._parents[:0]
            return Batch(self._edit(parents, rng), learn=False)
        buffer, kept = self._buffer, self._kept
        ready = kept.size >= max(MIN_FILLED * self._size, min(count, self._size))
        if ready and (kept.size == len(self._source.members) or rng.random() < buffer.replay):
            self._parents = kept.sample(count, self._batches, rng)
            return Batch(self._parents)
        return Batch(self._source.next_members(count, rng), learn=buffer.fresh_learned)

    def tell(self, outcomes: Outcomes) -> None:
        """Score the members, and store those with high scores in the buffer."""
        scores = self._score(outcomes) if outcomes.score is None else outcomes.score
        self._kept.update(outcomes.members, scores, self._batches)


class ReplayBuffer:
    """The buffer of prioritised level replay.

    Invariant: no member is in it twice, and it holds at most `size` members.

    Attributes:
        size: number of members in the buffer.
    """

    def __init__(self, settings: Buffer, size: int) -> None:
        self._settings = settings
        self._members = np.full(size, -1, np.int64)
        self._scores = np.zeros(size)
        self._stamps = np.zeros(size, np.int64)
        self._place: dict[int, int] = {}

    @property
    def size(self) -> int:
        return len(self._place)

    def update(self, members: Ints, scores: Floats, now: int) -> None:
        """Update the scores of members in the buffer, and add new members at time `now`, counted in batches.

        If the buffer is full, a new member replaces the one with the lowest score if its own score is higher.
        """
        for member, score in zip(members.tolist(), scores.tolist(), strict=True):
            place = self._place.get(member)
            if place is None:
                place = self.size
                if place == len(self._members):
                    place = int(self._scores.argmin())
                    if score <= self._scores[place]:
                        continue
                    del self._place[int(self._members[place])]
                self._place[member] = place
                self._members[place], self._stamps[place] = member, now
            self._scores[place] = score

    def probabilities(self, now: int) -> Floats:
        """Return the replay probability of each member in the buffer, from its score's rank and its last replay."""
        settings, count = self._settings, self.size
        ranks = np.empty(count)
        ranks[np.argsort(-self._scores[:count], kind="stable")] = np.arange(1, count + 1)
        by_score = ranks ** (-1.0 / settings.temperature)
        stale = (now - self._stamps[:count]).astype(np.float64)
        by_age = stale / stale.sum() if stale.sum() > 0 else np.full(count, 1.0 / count)
        fresh = 1.0 - settings.staleness
        found: Floats = np.asarray(fresh * by_score / by_score.sum() + settings.staleness * by_age)
        return np.asarray(found / found.sum())

    def sample(self, count: int, now: int, rng: Generator) -> Ints:
        """Sample members, and record `now` as their last replay; repeat members only if the buffer has too few."""
        places = rng.choice(self.size, count, replace=count > self.size, p=self.probabilities(now))
        self._stamps[places] = now
        return self._members[places]
