"""What scores make of levels that a student has played."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from envgraph.learn.audit._levels import AuditLevels
from envgraph.learn.audit._methods import Score
from envgraph.solve.learning import Played

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


class Student(Protocol):
    """What exact scores ask of a student."""

    def evaluate(self, chosen: Ints) -> tuple[Floats, Floats]:
        """The exact success probability and return on levels."""


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
