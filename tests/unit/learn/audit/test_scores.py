"""What scores make of levels, and what schedules the methods are."""

import numpy as np

from envgraph.env.schedules import Replay, Shuffled, Sifter, Sifting
from envgraph.learn.audit import (
    METHODS,
    AuditMethod,
)
from envgraph.learn.audit._audit_levels import (
    AuditLevels,
)
from envgraph.learn.audit._scores import (
    score_levels,
)
from envgraph.learn.audit._student_run import (
    make_schedule,
)
from envgraph.solve.learning import PlayStatistics
from tests.unit.learn.audit.small_levels import corridors


class Oracle:
    """Succeeds with probability 1 / (1 + number of the level)."""

    def __init__(self, levels: AuditLevels) -> None:
        self.levels = levels

    def play(self, chosen: np.ndarray) -> PlayStatistics:
        success = 1.0 / (1.0 + chosen)
        return PlayStatistics(np.full(len(chosen), 8), success, success, -success, success, success, success)

    def evaluate(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        success = 1.0 / (1.0 + chosen)
        return success, success * self.levels.optimum[chosen]


def test_each_method_has_its_schedule() -> None:
    levels = corridors()
    found = {method.name: type(make_schedule(method, levels, Oracle(levels))) for method in METHODS}
    assert (found["DR"], found["PLR, PVL"], found["SFL, 16 rollouts"]) == (Shuffled, Replay, Sifter)


def test_a_method_with_solvable_levels_asks_only_for_solvable_levels() -> None:
    levels, rng = corridors(), np.random.default_rng(0)
    schedule = make_schedule(AuditMethod("x", only_solvable=True), levels, Oracle(levels))
    for _ in range(9):
        assert levels.solvable[schedule.ask(4, rng).members].all()


def test_exact_scores_are_those_of_their_definitions() -> None:
    levels = corridors()
    student, chosen = Oracle(levels), np.arange(20)
    success, value = student.evaluate(chosen)
    rng = np.random.default_rng(0)
    regret = score_levels("exact regret", levels, chosen, student, student.play(chosen), rng)
    assert regret.tolist() == [
        optimum - got if plan else 0.0
        for optimum, got, plan in zip(levels.optimum[:20], value, levels.plan[:20], strict=True)
    ]
    found = score_levels("exact learnability", levels, chosen, student, student.play(chosen), rng)
    assert found.tolist() == (success * (1 - success)).tolist()


def test_exact_scores_select_levels_without_playing_episodes() -> None:
    levels, rng = corridors(), np.random.default_rng(0)
    method = AuditMethod("x", "exact learnability", Sifting(None, candidates=20, best=2))
    batch = make_schedule(method, levels, Oracle(levels)).ask(4, rng)
    assert batch.learn
    assert set(batch.members[:2].tolist()) <= {1, 2}, "p (1 - p) is highest where p is one half, then a third"
