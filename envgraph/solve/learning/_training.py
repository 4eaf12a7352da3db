"""Tabular learning over a sequence of environments, with a choice of loops that give equal results.

Watkins and Dayan 1992: Q(o, a) += learning_rate * (reward + discount * max Q(o', .) - Q(o, a)), where nothing follows
a terminated step; SARSA has another next value (`TrainingSettings.agent`). Details not in the formula are as published
with the paper: the greedy action is the lowest of equals; each environment begins a new episode; an episode that
reaches the time limit is over, but its last step bootstraps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from envgraph.code import dataclass
from envgraph.env import Tabular
from envgraph.env.compiled import has_numba
from envgraph.errors import LIMITS, InvalidArgument, check_known
from envgraph.solve.learning._stage import Stage, StageResult, TransitionTable, flatten_tabular
from envgraph.solve.learning._training_settings import TrainingSettings
from envgraph.solve.learning._training_turns import Curve, take_turns

Backend = Literal["auto", "python", "numba"]

COMPILING_PAYS = 4_000_000, 500_000
"""Steps from which the loop of numba is faster, for Q-learning without options and for other agents.

Each lies between the break-even points with and without a compiled loop in the cache: `python -m benchmarks learn`.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Training:
    """A trained agent.

    Attributes:
        q: float64 [observations, actions], its Q-values.
        curve: its learning curve.
        epsilon: exploration rate at the end.
    """

    q: NDArray[np.float64]
    curve: Curve
    epsilon: float


def available_backends() -> tuple[Backend, ...]:
    """Return the training loops that can run here, fastest first; numba comes with the extra `fast`."""
    return ("numba", "python") if has_numba() else ("python",)


def choose_backend(backend: Backend, steps: int, settings: TrainingSettings) -> Backend:
    """Return `backend`, or for "auto" the one that is fastest for `steps` steps; the choice never changes a result.

    Raises:
        InvalidArgument: the name is unknown, or numba is asked for and not installed.
    """
    check_known(backend, get_args(Backend), f"unknown backend {backend!r}")
    if backend == "auto":
        return available_backends()[0] if steps >= COMPILING_PAYS[not _is_basic_q_learning(settings)] else "python"
    if backend not in available_backends():
        raise InvalidArgument("backend 'numba' needs numba: pip install 'envgraph[fast]'")
    return backend


def train_curriculum(
    tabulars: Sequence[Tabular],
    settings: TrainingSettings,
    rng: np.random.Generator,
    *,
    steps: Sequence[int] | None = None,
    q: NDArray[np.float64] | None = None,
    backend: Backend = "auto",
) -> Training:
    """Train one agent on one environment after the other; direct training is a sequence of one.

    Args:
        tabulars: the environments, in the order of training; they must agree in observations and actions.
        settings: the settings of the training.
        rng: source of all randomness; is advanced.
        steps: length of each stage; by default `settings.steps_per_environment`.
        q: initial Q-values, not changed; by default `settings.initial_value` everywhere.
        backend: the training loop; all give the same result.

    Raises:
        InvalidArgument: the environments do not agree or are not well formed, or an argument does not fit them.
    """
    tables = prepare(tabulars)
    lengths = [settings.steps_per_environment] * len(tables) if steps is None else list(steps)
    if len(lengths) != len(tables) or min(lengths) < 1:
        raise InvalidArgument(f"`steps` is {lengths}, but must have a positive length for each of {len(tables)} stages")
    values = initial_values(tables[0], settings)
    if q is not None:
        values[:] = np.tile(_checked_values(q, tables[0]), values.shape[1] // q.shape[1])
    run_stage = training_loop(choose_backend(backend, sum(lengths), settings), settings)
    curve, epsilon = take_turns(
        lambda places, stage: run_stage(tables[places[0]], stage, values, rng),
        settings,
        [(length, (place,)) for place, length in enumerate(lengths)],
        rng,
    )
    return Training(action_values(values, tables[0].n_actions), curve, epsilon)


def renumber_occurring(tabulars: Sequence[Tabular]) -> Sequence[Tabular]:
    """Return the environments; unchanged if they have few enough observations for a table of values.

    Otherwise the observations that occur in one of the environments are renumbered in order. Learning is the same.

    Raises:
        InvalidArgument: the environments do not agree in observations or actions.
    """
    _check_agreement(tabulars)
    first = tabulars[0]
    if first.n_observations * first.n_actions <= LIMITS["action values"]:
        return tabulars
    for one in tabulars:
        one.check()
    seen, rows = np.unique(np.concatenate([one.observation for one in tabulars]), return_inverse=True)
    ends = np.cumsum([one.n_states for one in tabulars])[:-1]
    size = len(seen)
    return [
        replace(
            one,
            observation=found.astype(np.int64),
            n_observations=size,
            observation_shape=(size,),
            observation_names=(),
        )
        for one, found in zip(tabulars, np.split(rows, ends), strict=True)
    ]


def prepare(tabulars: Sequence[Tabular]) -> tuple[TransitionTable, ...]:
    """Check environments, and return the tables that `train` works on. They can be used for any number of runs.

    Raises:
        InvalidArgument: the environments do not agree, are not well formed, or have too many observations for a table.
    """
    _check_agreement(tabulars)
    first = tabulars[0]
    if first.n_observations * first.n_actions > LIMITS["action values"]:
        raise InvalidArgument(
            f"a table of values for {first.n_observations:,} observations and {first.n_actions} actions is too large, "
            f"at most {LIMITS['action values']:,} are possible",
            "observe less or smaller ranges, or use `run_experiment`: its tables have only observations that occur",
        )
    for tabular in tabulars:
        tabular.check()
    return tuple(flatten_tabular(tabular) for tabular in tabulars)


def _check_agreement(tabulars: Sequence[Tabular]) -> None:
    if not tabulars:
        raise InvalidArgument("`tabulars` is empty, but a curriculum needs at least one environment")
    first = tabulars[0]
    for tabular in tabulars:
        if (tabular.n_observations, tabular.action_names) != (first.n_observations, first.action_names):
            raise InvalidArgument("the environments of a curriculum must have the same observations and actions")


def training_loop(
    backend: Backend, settings: TrainingSettings
) -> Callable[[TransitionTable, Stage, NDArray[np.float64], np.random.Generator], StageResult]:
    """Return the loop that trains on a table; the backend must not be "auto"."""
    if backend == "numba":
        from envgraph.solve.learning._compiled_loop import run_stage
    elif _is_basic_q_learning(settings):
        from envgraph.solve.learning._q_learning import run_stage
    else:
        from envgraph.solve.learning._on_lists import run_stage
    return run_stage


def _is_basic_q_learning(settings: TrainingSettings) -> bool:
    return (settings.agent, settings.ties) == ("q_learning", "lowest")


def initial_values(table: TransitionTable, settings: TrainingSettings) -> NDArray[np.float64]:
    """Return the initial values [observations, actions], with twice as many actions for double Q-learning.

    Adding 0.0 turns -0.0, which sorts badly, into 0.0.
    """
    width = table.n_actions * (2 if settings.agent == "double_q_learning" else 1)
    return np.full((table.n_observations, width), settings.initial_value + 0.0)


def action_values(learned: NDArray[np.float64], n_actions: int) -> NDArray[np.float64]:
    """Return the Q-values [.., actions]: the learned values, or the mean of the two values of double Q-learning."""
    if learned.shape[-1] == n_actions:
        return learned
    return 0.5 * (learned[..., :n_actions] + learned[..., n_actions:])


def _checked_values(q: NDArray[np.float64], table: TransitionTable) -> NDArray[np.float64]:
    shape = (table.n_observations, table.n_actions)
    if q.shape != shape or not np.isfinite(q).all():
        raise InvalidArgument(f"`q` has the shape {q.shape}, but must have {shape} and finite values")
    return q + 0.0
