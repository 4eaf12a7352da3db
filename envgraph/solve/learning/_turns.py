"""Training on members that a schedule chooses, turn by turn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from envgraph.env.schedules import Outcomes, Schedule
from envgraph.solve.learning._settings import TrainingSettings
from envgraph.solve.learning._stage import Stage, StageOutcome
from envgraph.solve.learning._training import Curve, joined

Turn = Callable[[int, Stage], StageOutcome]
"""Trains on a member for a stage."""


def take_turns(
    turn: Turn,
    schedule: Schedule,
    settings: TrainingSettings,
    rng: np.random.Generator,
    stages: Sequence[tuple[int, Sequence[int]]],
    begins: Callable[[int], None] = lambda stage: None,
) -> tuple[Curve, float]:
    """Train for some stages, in turns: on a member that the schedule chooses for each.

    A turn has as many steps as an episode may have, so that at least one ends in it; the last turn of a stage is cut.
    The schedule is told what came of the episodes of a turn. A stage of one member is a single turn that it does not
    know of. Exploration begins anew as `settings.epsilon` says.

    Args:
        turn: trains on a member.
        schedule: chooses, as numbers of the places in a stage of several members, which are the same in all of these.
        settings: how to train.
        rng: what the schedule draws from; no training does.
        stages: steps of each, and its members.
        begins: called with the place of each stage before it.

    Returns:
        The curve, and exploration at the end.
    """
    epsilon, outcomes = settings.epsilon.start, list[tuple[Stage, StageOutcome]]()
    single = replace(settings, checkpoint=settings.limit)
    for place, (length, members) in enumerate(stages):
        begins(place)
        if settings.epsilon.reset == "stage":
            epsilon = settings.epsilon.start
        if len(members) == 1:
            stage = Stage(length, epsilon, settings)
            outcomes.append((stage, turn(members[0], stage)))
            epsilon = outcomes[-1][1].epsilon
            continue
        for done in range(0, length, settings.limit):
            batch = schedule.ask(1, rng)
            stage = Stage(min(settings.limit, length - done), epsilon, single, batch.learn)
            outcome = turn(members[int(batch.members[0])], stage)
            schedule.tell(_told(batch.members, stage.steps, outcome))
            epsilon = outcome.epsilon if batch.learn else epsilon
            outcomes.append((stage, outcome))
    return _thinned(joined(outcomes), settings.checkpoint), epsilon


def _told(members: np.ndarray[tuple[int], np.dtype[np.int64]], steps: int, outcome: StageOutcome) -> Outcomes:
    total, episodes, successes = outcome.curve[-1]
    count = max(1, episodes)
    return Outcomes(members, np.array([successes / count]), np.array([total / count]), np.array([steps]))


def _thinned(curve: Curve, checkpoint: int) -> Curve:
    """The first point after each so many steps, and the last."""
    steps = np.array(curve.steps)
    marks = np.append(np.arange(checkpoint, steps[-1], checkpoint), steps[-1])
    kept = np.unique(np.searchsorted(steps, marks)).tolist()
    columns = curve.steps, curve.reward, curve.episodes, curve.successes
    return Curve(*(tuple(column[place] for place in kept) for column in columns))
