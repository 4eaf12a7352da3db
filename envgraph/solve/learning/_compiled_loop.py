"""The training loop, compiled with numba. Imported only when it is used, because importing numba is slow."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from envgraph.env.compiled import generator_states, load_functions, set_generator_state
from envgraph.env.compiled.kernels import step_kernels, values
from envgraph.errors import InvalidArgument
from envgraph.solve.learning import _loop
from envgraph.solve.learning._stage import Stage, StageResult, TransitionTable
from envgraph.solve.learning._training_settings import AGENTS, TrainingSettings


def run_compiled(name: str, settings: TrainingSettings, *arguments: Any) -> None:
    """Call `learn_stage` or `play` of `_loop`, compiled for these settings, without holding the interpreter lock."""
    agent, ties = AGENTS.index(settings.agent), settings.ties == "random"
    constants = f"AGENT, TIES, N_STEP = {agent}, {ties}, {settings.n_step}\n"
    load_functions(constants, (step_kernels, values, _loop), (name,), native=True)[name](*arguments)


def learn_stage(
    table: TransitionTable,
    stage: Stage,
    values: NDArray[np.float64],
    rows: NDArray[np.uint64],
    epsilons: NDArray[np.float64],
) -> tuple[NDArray[Any], ...]:
    """Train all learners for a stage, and return their curves; the last three arguments are changed in place."""
    points, settings, n_step = np.array(stage.curve_points, np.int64), stage.settings, stage.settings.n_step
    shape = len(values), len(points)
    curve = np.zeros(shape), *(np.zeros(shape, np.int64) for _ in range(2))
    waiting = *(np.zeros(n_step, np.int64) for _ in range(2)), np.zeros(n_step)
    learners = values, rows, epsilons
    run_compiled("learn", settings, table.arrays, *learners, stage.factors, settings.limit, points, waiting, curve)
    return curve


def run_stage(table: TransitionTable, stage: Stage, q: NDArray[np.float64], rng: np.random.Generator) -> StageResult:
    """Train one learner on a table for a stage; `q` [observations, actions] and `rng` are changed in place."""
    if not isinstance(rng.bit_generator, np.random.PCG64):
        message = "backend 'numba' needs a generator over PCG64: create it with `numpy.random.default_rng`"
        raise InvalidArgument(message)
    rows, epsilons = generator_states([rng]), np.array([stage.epsilon])
    curve = learn_stage(table, stage, q[None], rows, epsilons)
    set_generator_state(rng, rows[0])
    return StageResult(float(epsilons[0]), list(zip(*(column[0].tolist() for column in curve), strict=True)))
