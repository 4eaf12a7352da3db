"""The loop of learners, compiled with numba. Imported only when it is used, because that takes its time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from envgraph.env.compiled import functions, kernels, set_stream, streams
from envgraph.errors import InvalidArgument
from envgraph.solve.learning import _loop
from envgraph.solve.learning._stage import Stage, StageOutcome, Table


def run(name: str, *arguments: Any) -> None:
    """Call `learn` or `play` of `_loop`. Releases the interpreter lock."""
    functions("", (kernels, _loop), ("learn", "play"), native=True)[name](*arguments)


def run_stage(table: Table, stage: Stage, q: NDArray[np.float64], rng: np.random.Generator) -> StageOutcome:
    """Train on a table; `q` [observations, actions] is changed in place."""
    if not isinstance(rng.bit_generator, np.random.PCG64):
        message = (
            "backend 'numba' draws from NumPy's PCG64: make the generator with `numpy.random.default_rng`"
        )
        raise InvalidArgument(message)
    points = np.array(stage.points, np.int64)
    rows, epsilons = streams([rng]), np.array([stage.epsilon])
    curve = np.zeros((1, len(points))), *(np.zeros((1, len(points)), np.int64) for _ in range(2))
    run("learn", table.arrays, q[None], rows, epsilons, stage.factors, stage.settings.limit, points, curve)
    set_stream(rng, rows[0])
    return StageOutcome(float(epsilons[0]), list(zip(*(column[0].tolist() for column in curve), strict=True)))
