"""Run one student by one method, and evaluate it exactly on other levels."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any, Final

import numpy as np
from numpy.random import SeedSequence, default_rng

from envgraph.code import dataclass
from envgraph.env.schedules import Buffer, Edit, Outcomes, Replay, Schedule, Shuffled, Sifter
from envgraph.learn.audit._accel import LevelEditor
from envgraph.learn.audit._audit_levels import AuditLevels
from envgraph.learn.audit._audit_settings import PROTOCOL, AuditSettings
from envgraph.learn.audit._methods import METHODS, PROBED, AuditMethod
from envgraph.learn.audit._ranks import Floats, jackknife_values, rank_levels
from envgraph.learn.audit._scores import Student, exact_scores, score_levels
from envgraph.search import Domain
from envgraph.solve.learning import PolicyLearner

PROBES: Final = (1, 2, 4, 8)
ROLLOUTS: Final = (1, 4, 16, 64, 256)
"""The numbers of episodes from which scores are estimated."""

_SCHEDULER, _PROBE = 3, 4


@dataclass(frozen=True, slots=True)
class AuditRun:
    """The result of a run. All values are exact for the student's stochastic policy, unless said otherwise.

    Attributes:
        method, seed: identify the run.
        steps, updates: at each point of the curve: environment steps so far, including those for scoring, and number
            of batches that were learned on.
        curve: mean success on the held-out levels at these points.
        success: success on each held-out level, at the end.
        hard: success on each hard level, at the end.
        regret: mean regret over the held-out levels.
        greedy: mean success of the greedy policy on the held-out levels.
        learned_solvable: share of the levels learned on that are solvable.
        rankings: a `Ranking` for each point, number of rollouts and score; empty for students that are not probed.
        shown: for the first probed student, at the middle of training: exact regret and success of the probed levels,
            and their scores from 16 rollouts.
        ranked_levels: for each score from 16 rollouts, the `jackknife_values` of its rank correlation with regret over
            solvable levels, averaged over the points of the curve; None for a student that is not probed.
    """

    method: str
    seed: int
    steps: tuple[int, ...]
    updates: tuple[int, ...]
    curve: tuple[float, ...]
    success: tuple[float, ...]
    hard: tuple[float, ...]
    regret: float
    greedy: float
    learned_solvable: float
    rankings: tuple[dict[str, Any], ...] = ()
    shown: dict[str, list[float]] | None = None
    ranked_levels: dict[str, list[float]] | None = None

    @property
    def final_success(self) -> float:
        """Return the mean success on the held-out levels at the end."""
        return float(np.mean(self.success))


def run_method(
    levels: AuditLevels,
    settings: AuditSettings,
    method: AuditMethod,
    seed: int,
    *,
    domain: Domain | None = None,
    native: bool | None = None,
) -> AuditRun:
    """Train a student by a method, evaluate it, and return the result.

    The initial weights and the student's random numbers depend only on the seed, so runs of different methods are
    paired.

    Args:
        levels: the levels to train and test on.
        settings: the settings of the audit.
        method: the method by which levels are chosen.
        seed: the seed of all randomness.
        domain: the domain of the levels, for methods that edit them.
        native: the `native` of `PolicyLearner`.
    """
    student = PolicyLearner(levels.tables, settings.policy, seed, native=native)
    rng = default_rng(SeedSequence(seed, spawn_key=(_SCHEDULER,)))
    editor = LevelEditor(domain, settings, levels, student) if method.edits_levels and domain else None
    schedule = make_schedule(method, levels, student, editor)
    steps = updates = solvable = learned = 0
    curve: list[tuple[int, int, float]] = []
    rankings: list[dict[str, Any]] = []
    shown: dict[str, list[float]] | None = None
    parts: list[list[Floats]] = []
    while len(curve) < PROTOCOL.points:
        batch = schedule.ask(settings.policy.levels, rng)
        levels = editor.levels if editor else levels
        chosen = batch.members
        played = student.play(chosen, batch.episodes)
        steps += played.steps if method.counts_scoring or batch.learn else 0
        if batch.learn:
            student.improve(rng)
            updates += 1
            learned += len(chosen)
            solvable += int(levels.solvable[chosen].sum())
        score = None
        if method.score and isinstance(method.choice, Buffer):
            score = score_levels(method.score, levels, chosen, student, played, rng)
        schedule.tell(Outcomes(chosen, played.success, played.returns, played.length, score))
        if batch.episodes is not None:
            continue  # the episodes of a search belong to the next batch
        while len(curve) < PROTOCOL.points and steps >= settings.steps * (len(curve) + 1) / PROTOCOL.points:
            curve.append((steps, updates, float(student.evaluate(levels.held_out)[0].mean())))
            if method == METHODS[0] and seed < PROTOCOL.probing_seeds and len(curve) in PROBES:
                found, values = probe_scores(levels, student, seed, len(curve) / PROTOCOL.points)
                rankings += found
                solved = np.array(values["solvable"], bool)
                every = [np.array(values[name])[solved] for name in ("regret", *PROBED)]
                parts.append([jackknife_values(scores, every[0]) for scores in every[1:]])
                if seed == 0 and len(curve) == PROBES[2]:
                    shown = values
    success, value = student.evaluate(levels.held_out)
    return AuditRun(
        method=method.name,
        seed=seed,
        steps=tuple(point[0] for point in curve),
        updates=tuple(point[1] for point in curve),
        curve=tuple(point[2] for point in curve),
        success=tuple(success.tolist()),
        hard=tuple(student.evaluate(levels.hard)[0].tolist()),
        regret=float((levels.optimum[levels.held_out] - value).mean()),
        greedy=float(student.evaluate(levels.held_out, greedy=True)[0].mean()),
        learned_solvable=solvable / max(1, learned),
        rankings=tuple(rankings),
        shown=shown,
        ranked_levels=dict(zip(PROBED, np.mean(parts, axis=0).tolist(), strict=True)) if parts else None,
    )


def make_schedule(method: AuditMethod, levels: AuditLevels, student: Student, edit: Edit | None = None) -> Schedule:
    """Return the schedule of a method, which chooses among the levels for training; `edit` makes new ones of them."""
    training = levels.training
    members = training[levels.solvable[training]] if method.only_solvable else training
    choice, score = method.choice, method.score
    if choice is None:
        return Shuffled(members)
    if isinstance(choice, Buffer):
        return Replay(members, choice, edit=edit)
    if choice.episodes is not None or score is None:
        return Sifter(members, choice)
    return Sifter(members, choice, lambda chosen: exact_scores(score, levels, chosen, student))


def probe_scores(
    levels: AuditLevels, student: PolicyLearner, seed: int, training_share: float
) -> tuple[list[dict[str, Any]], dict[str, list[float]]]:
    """Compare scores with exact values on the probed levels, which are not learned on.

    Each score is estimated twice from each number of rollouts.

    Args:
        levels: the levels of the audit.
        student: a student during training; it is not changed.
        seed: the seed of the rollouts.
        training_share: progress of the training, from 0 to 1.

    Returns:
        A mapping for each number of rollouts and score; and the exact values and scores from 16 rollouts of each level.
    """
    chosen = levels.probed
    success, _ = student.evaluate(chosen)
    regret = exact_scores("exact regret", levels, chosen, student)
    solvable = levels.solvable[chosen]
    shown = {"regret": regret.tolist(), "success": success.tolist(), "solvable": solvable.tolist()}
    rankings: list[dict[str, Any]] = []
    for rollouts in ROLLOUTS:
        estimates = [_estimate_scores(levels, student, rollouts, seed, training_share, again) for again in (0, 1)]
        for score in PROBED:
            first, second = (one[score] for one in estimates)
            found = rank_levels(first, second, regret, success, solvable)
            rankings.append({"at": training_share, "rollouts": rollouts, "score": score, **asdict(found)})
            if rollouts == PROTOCOL.shown_rollouts:
                shown[score] = first.tolist()
    return rankings, shown


def _estimate_scores(
    levels: AuditLevels,
    student: PolicyLearner,
    rollouts: int,
    seed: int,
    training_share: float,
    repetition: int,
) -> dict[str, Any]:
    """Return every score of the probed levels, all from the same new episodes of a copy of the student."""
    key = (_PROBE, seed, rollouts, round(training_share * PROTOCOL.points), repetition)
    rng = default_rng(SeedSequence(seed, spawn_key=key))
    copied = student.copy_with_seed(int(rng.integers(2**31)))
    found: dict[str, list[Any]] = {score: [] for score in PROBED}
    for begin in range(0, len(levels.probed), PROTOCOL.together):
        chosen = levels.probed[begin : begin + PROTOCOL.together]
        played = copied.play(chosen, rollouts)
        for score in PROBED:
            found[score].append(score_levels(score, levels, chosen, copied, played, rng))
    return {score: np.concatenate(parts) for score, parts in found.items()}
