"""Levels are proposed as the methods say."""

import numpy as np

from envgraph.learn.audit import METHODS, AuditLevels, Batch, Method, Scheduler, Sifting, score_levels
from envgraph.learn.audit._methods import Buffer
from envgraph.learn.audit._scheduler import Kept
from envgraph.solve.learning import Played
from tests.unit.learn.audit.small_levels import corridors


class Oracle:
    """Succeeds with probability 1 / (1 + number of the level), and counts what it plays."""

    def __init__(self, levels: AuditLevels) -> None:
        self.levels = levels

    def play(self, chosen: np.ndarray, episodes: int | None = None) -> Played:
        success = 1.0 / (1.0 + chosen)
        return Played(len(chosen) * (episodes or 8), success, -success, success, success, success)

    def evaluate(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        success = 1.0 / (1.0 + chosen)
        return success, success * self.levels.optimum[chosen]


def test_each_level_of_the_generator_comes_once_before_one_comes_again() -> None:
    levels = corridors()
    scheduler = Scheduler(METHODS[0], levels, 4, np.random.default_rng(0))
    seen = [one for _ in range(5) for one in scheduler.propose(Oracle(levels)).levels.tolist()]
    assert sorted(seen) == levels.training.tolist()


def test_a_generator_of_solvable_levels_gives_no_other() -> None:
    levels = corridors()
    scheduler = Scheduler(Method("x", solvable=True), levels, 4, np.random.default_rng(0))
    for _ in range(9):
        assert levels.solvable[scheduler.propose(Oracle(levels)).levels].all()


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


def test_a_full_buffer_keeps_the_highest_scores() -> None:
    kept = Kept(Buffer(size=3))
    kept.put(np.array([1, 2, 3]), np.array([0.1, 0.2, 0.3]), 1)
    kept.put(np.array([4, 5]), np.array([0.05, 0.25]), 2)
    kept.put(np.array([3]), np.array([0.01]), 3)
    kept.put(np.array([6]), np.array([0.02]), 4)
    assert sorted(kept._place) == [2, 5, 6]


def test_replay_goes_by_rank_and_by_age() -> None:
    kept = Kept(Buffer(size=3, temperature=0.5, staleness=0.25))
    kept.put(np.array([1, 2, 3]), np.array([0.5, 0.9, 0.1]), 4)
    kept._stamps[:] = [1, 2, 3]
    by_rank = np.array([2.0**-2, 1.0, 3.0**-2])
    expected = 0.75 * by_rank / by_rank.sum() + 0.25 * np.array([4, 3, 2]) / 9
    assert np.allclose(kept.chances(5), expected)


def test_robust_replay_does_not_learn_on_fresh_levels() -> None:
    levels = corridors()
    student = Oracle(levels)
    method = Method("x", "PVL", Buffer(size=8, fresh_learned=False))
    scheduler = Scheduler(method, levels, 4, np.random.default_rng(0))
    kinds = set()
    for _ in range(20):
        batch = scheduler.propose(student)
        assert batch.learn == batch.replayed
        kinds.add(batch.replayed)
        scheduler.told(student, batch, student.play(batch.levels))
    assert kinds == {False, True}


def sifted(sifting: Sifting) -> tuple[Batch, AuditLevels]:
    levels = corridors()
    method = Method("x", "SFL" if sifting.episodes else "exact learnability", sifting=sifting)
    return Scheduler(method, levels, 4, np.random.default_rng(0)).propose(Oracle(levels)), levels


def test_sifting_takes_the_best_candidates_and_counts_its_steps_where_it_has_to() -> None:
    how = {"candidates": 20, "best": 2}
    batch, _ = sifted(Sifting(16, **how))
    assert batch.cost == 20 * 16
    assert set(batch.levels[:2].tolist()) <= {1, 2}, "p (1 - p) is highest where p is one half, then a third"
    assert sifted(Sifting(16, counted=False, **how))[0].cost == 0
    exact, _ = sifted(Sifting(None, **how))
    assert (exact.cost, set(exact.levels[:2].tolist()) <= {1, 2}) == (0, True)
