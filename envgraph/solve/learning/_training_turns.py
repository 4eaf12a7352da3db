"""Train stage by stage, and in turns on members that a schedule chooses."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from envgraph.code import dataclass
from envgraph.env.schedules import Outcomes, Schedule
from envgraph.solve.learning._stage import Stage, StageResult
from envgraph.solve.learning._training_settings import TrainingSettings

StageMembers = tuple[int, ...]
"""Numbers of the members of a stage: one, or several among which episodes or turns are distributed."""

TrainStage = Callable[[StageMembers, Stage], StageResult]
"""Trains an agent on members for a stage."""


@dataclass(frozen=True, slots=True)
class Curve:
    """A learning curve, recorded every `checkpoint` steps of a stage and at its end; totals since the beginning.

    Attributes:
        steps: steps so far.
        reward: cumulative reward, running episodes included.
        episodes: finished episodes, truncated ones included.
        successes: episodes among them that ended in success.
    """

    steps: tuple[int, ...]
    reward: tuple[float, ...]
    episodes: tuple[int, ...]
    successes: tuple[int, ...]


def take_turns(
    turn: TrainStage,
    settings: TrainingSettings,
    stages: Sequence[tuple[int, StageMembers]],
    rng: np.random.Generator,
    begins: Callable[[int], None] = lambda stage: None,
    schedule: Schedule | None = None,
) -> tuple[Curve, float]:
    """Train for some stages; in a stage with several members, a schedule chooses a member for each turn.

    A turn has as many steps as an episode may have, so at least one episode ends in it. The last turn of a stage is
    cut. The schedule receives the outcomes of each turn. A stage with one member, or without a schedule, is a single
    turn that the schedule does not learn of. Exploration is reset as `settings.epsilon` says.

    Args:
        turn: trains for a stage on members.
        settings: the settings of the training.
        stages: steps and members of each stage.
        rng: for the schedule only; training does not use it.
        begins: called with the number of each stage before it.
        schedule: chooses members in stages with several ones, which must be the same in all such stages.

    Returns:
        The learning curve, and the exploration rate at the end.
    """
    epsilon, outcomes = settings.epsilon.start, list[tuple[Stage, StageResult]]()
    for number, (length, place) in enumerate(stages):
        begins(number)
        if settings.epsilon.reset == "stage":
            epsilon = settings.epsilon.start
        if schedule is None or len(place) == 1:
            stage = Stage(length, epsilon, settings)
            outcomes.append((stage, turn(place, stage)))
        else:
            outcomes += _train_in_turns(turn, Stage(length, epsilon, settings), place, schedule, rng)
        epsilon = outcomes[-1][1].epsilon
    curve = _join_curves(outcomes)
    return curve if schedule is None else _thin_curve(curve, settings.checkpoint), epsilon


def _train_in_turns(
    turn: TrainStage, whole: Stage, place: StageMembers, schedule: Schedule, rng: np.random.Generator
) -> Iterator[tuple[Stage, StageResult]]:
    """Train a stage in turns; yield each turn with its outcome, after reporting the outcome to the schedule."""
    limit, epsilon = whole.settings.limit, whole.epsilon
    settings = replace(whole.settings, checkpoint=limit)
    for done in range(0, whole.steps, limit):
        batch = schedule.ask(1, rng)
        stage = Stage(min(limit, whole.steps - done), epsilon, settings, batch.learn)
        outcome = turn((place[int(batch.members[0])],), stage)
        schedule.tell(_outcomes_of(batch.members, stage.steps, outcome))
        if batch.learn:
            epsilon = outcome.epsilon
        yield stage, replace(outcome, epsilon=epsilon)


def _outcomes_of(members: np.ndarray[tuple[int], np.dtype[np.int64]], steps: int, outcome: StageResult) -> Outcomes:
    total, episodes, successes = outcome.curve[-1]
    count = max(1, episodes)
    return Outcomes(members, np.array([successes / count]), np.array([total / count]), np.array([steps]))


def _thin_curve(curve: Curve, checkpoint: int) -> Curve:
    """Return a curve with the first point after every `checkpoint` steps, and the last point."""
    steps = np.array(curve.steps)
    marks = np.append(np.arange(checkpoint, steps[-1], checkpoint), steps[-1])
    kept = np.unique(np.searchsorted(steps, marks)).tolist()
    columns = curve.steps, curve.reward, curve.episodes, curve.successes
    return Curve(*(tuple(column[place] for place in kept) for column in columns))


def _join_curves(outcomes: Sequence[tuple[Stage, StageResult]]) -> Curve:
    """Return one curve for all stages: each begins where the one before it ends."""
    points: list[tuple[int, float, int, int]] = []
    for stage, outcome in outcomes:
        steps, reward, episodes, successes = points[-1] if points else (0, 0.0, 0, 0)
        points.extend(
            (steps + at, reward + total, episodes + finished, successes + reached)
            for at, (total, finished, reached) in zip(stage.curve_points, outcome.curve, strict=True)
        )
    return Curve(*zip(*points, strict=True))
