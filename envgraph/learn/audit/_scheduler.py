"""Choosing levels for a student, batch by batch: what a method says, carried out."""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument
from envgraph.learn.audit._levels import AuditLevels
from envgraph.learn.audit._methods import Buffer, Method, Score, Sifting
from envgraph.solve.learning import Played

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

FILLED: Final = 0.5
"""A buffer is replayed when so much of it is filled, as in JaxUED (Coward et al. 2024)."""


class Student(Protocol):
    """What schedulers ask of a student."""

    def play(self, chosen: Ints, episodes: int | None = None) -> Played:
        """Play levels."""

    def evaluate(self, chosen: Ints) -> tuple[Floats, Floats]:
        """The exact success probability and return on levels."""


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Levels to play next.

    Attributes:
        levels: int64, one may stand twice.
        learn: whether to learn on them.
        replayed: whether they come from a buffer.
        cost: steps that finding them took.
    """

    levels: Ints
    learn: bool = True
    replayed: bool = False
    cost: int = 0


def score_levels(
    score: Score, levels: AuditLevels, chosen: Ints, student: Student, played: Played, rng: Generator
) -> Floats:
    """What a score makes of levels that a student has played; higher is more worth learning on.

    Args:
        score: which.
        levels: of the audit.
        chosen: the levels that were played.
        student: is asked where a score is exact.
        played: what was found while they were played.
        rng: draws random scores.
    """
    match score:
        case "random":
            return rng.random(len(chosen))
        case "PVL":
            return played.positive
        case "L1":
            return played.absolute
        case "MaxMC":
            return played.best_return
        case "MNA":
            return played.negative
        case "SFL":
            return played.success * (1.0 - played.success)
        case _:
            return exact_scores(score, levels, chosen, student)


def exact_scores(score: Score, levels: AuditLevels, chosen: Ints, student: Student) -> Floats:
    """Exact regret (0 where nothing can be won) or exact learnability of levels."""
    success, value = student.evaluate(chosen)
    if score == "exact learnability":
        return success * (1.0 - success)
    return np.where(levels.solvable[chosen], np.maximum(0.0, levels.optimum[chosen] - value), 0.0)


class Scheduler:
    """Proposes batches of levels as a method says, and is told what came of them.

    Args:
        method: what to do.
        levels: of the audit; those for training are the generator, which gives them in random order, each once before
            one comes again.
        size: levels of a batch.
        rng: draws.
    """

    def __init__(self, method: Method, levels: AuditLevels, size: int, rng: Generator) -> None:
        self._method, self._levels, self._size, self._rng = method, levels, size, rng
        training = levels.training
        self._source = training[levels.solvable[training]] if method.solvable else training
        if len(self._source) < size:
            raise InvalidArgument(f"there are {len(self._source)} levels to train on, and a batch has {size}")
        self._order: Ints = np.zeros(0, np.int64)
        self._kept = Kept(method.buffer) if method.buffer else None
        self._sifted: Ints = np.zeros(0, np.int64)
        self._batches = 0

    def propose(self, student: Student) -> Batch:
        """The next batch."""
        method, cost = self._method, 0
        self._batches += 1
        if method.sifting is not None:
            if (self._batches - 1) % method.sifting.every == 0:
                cost = self._sift(student, method.sifting)
            chosen = int(self._size * method.sifting.share)
            sifted = self._rng.choice(self._sifted, chosen)
            return Batch(np.concatenate([sifted, self.fresh(self._size - chosen)]), cost=cost)
        if self._kept is None or method.buffer is None:
            return Batch(self.fresh(self._size))
        ready = self._kept.filled >= max(FILLED * method.buffer.size, self._size)
        if ready and self._rng.random() < method.buffer.replay:
            return Batch(self._kept.draw(self._size, self._batches, self._rng), replayed=True)
        return Batch(self.fresh(self._size), learn=method.buffer.fresh_learned)

    def told(self, student: Student, batch: Batch, played: Played) -> None:
        """What a student found on a batch, after it has learned."""
        if self._kept is not None and self._method.score is not None:
            scores = score_levels(self._method.score, self._levels, batch.levels, student, played, self._rng)
            self._kept.put(batch.levels, scores, self._batches)

    def fresh(self, count: int) -> Ints:
        """Levels of the generator."""
        while len(self._order) < count:
            self._order = np.concatenate([self._order, self._rng.permutation(self._source)])
        found, self._order = self._order[:count], self._order[count:]
        return found

    def _sift(self, student: Student, how: Sifting) -> int:
        """Look for levels that are worth most; how many steps that takes."""
        candidates, cost = self.fresh(how.candidates), 0
        score = self._method.score
        assert score is not None, "what is sifted has a score"
        if how.episodes is None:
            scores = exact_scores(score, self._levels, candidates, student)
        else:
            played = student.play(candidates, how.episodes)
            cost = played.steps if how.counted else 0
            scores = score_levels(score, self._levels, candidates, student, played, self._rng)
        order = np.argsort(-scores, kind="stable")
        self._sifted = candidates[order[: how.best]]
        return cost


class Kept:
    """The buffer of prioritised level replay.

    Invariant: no level stands twice, and there are at most `size`.

    Attributes:
        filled: how many levels there are.
    """

    def __init__(self, settings: Buffer) -> None:
        self._settings = settings
        self._levels = np.full(settings.size, -1, np.int64)
        self._scores = np.zeros(settings.size)
        self._stamps = np.zeros(settings.size, np.int64)
        self._place: dict[int, int] = {}

    @property
    def filled(self) -> int:
        return len(self._place)

    def put(self, levels: Ints, scores: Floats, now: int) -> None:
        """Levels with their scores: known ones get these, others stand in for the lowest if theirs is higher."""
        for level, score in zip(levels.tolist(), scores.tolist(), strict=True):
            place = self._place.get(level)
            if place is None:
                place = self.filled
                if place == self._settings.size:
                    place = int(self._scores.argmin())
                    if score <= self._scores[place]:
                        continue
                    del self._place[int(self._levels[place])]
                self._place[level] = place
                self._levels[place], self._stamps[place] = level, now
            self._scores[place] = score

    def chances(self, now: int) -> Floats:
        """The probability that each level is replayed: by the rank of its score, and by how long ago it was."""
        settings, count = self._settings, self.filled
        ranks = np.empty(count)
        ranks[np.argsort(-self._scores[:count], kind="stable")] = np.arange(1, count + 1)
        by_score = ranks ** (-1.0 / settings.temperature)
        stale = (now - self._stamps[:count]).astype(np.float64)
        by_age = stale / stale.sum() if stale.sum() > 0 else np.full(count, 1.0 / count)
        fresh = 1.0 - settings.staleness
        found: Floats = np.asarray(fresh * by_score / by_score.sum() + settings.staleness * by_age)
        return np.asarray(found / found.sum())

    def draw(self, count: int, now: int, rng: Generator) -> Ints:
        """Different levels, to be replayed now."""
        places = rng.choice(self.filled, count, replace=False, p=self.chances(now))
        self._stamps[places] = now
        return self._levels[places]
