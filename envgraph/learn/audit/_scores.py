"""Compute scores of levels that a student has played."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from envgraph.learn.audit._audit_levels import AuditLevels
from envgraph.learn.audit._methods import Score
from envgraph.solve.learning import PlayStatistics

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


class Student(Protocol):
    """A student whose success and return can be computed exactly."""

    def evaluate(self, chosen: Ints) -> tuple[Floats, Floats]:
        """Return the exact success probability and the exact return on each of the levels with these numbers."""


def score_levels(
    score: Score, levels: AuditLevels, chosen: Ints, student: Student, played: PlayStatistics, rng: Generator
) -> Floats:
    """Return a score of each level that a student has played. Higher means more useful to learn on.

    Args:
        score: the name of the score.
        levels: the levels of the audit.
        chosen: the numbers of the levels that were played.
        student: the student, evaluated if the score is exact.
        played: statistics of the episodes.
        rng: the generator of random scores.
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
    """Return the exact regret (0 for unsolvable levels) or the exact learnability of levels."""
    success, value = student.evaluate(chosen)
    if score == "exact learnability":
        return success * (1.0 - success)
    return np.where(levels.solvable[chosen], np.maximum(0.0, levels.optimum[chosen] - value), 0.0)
