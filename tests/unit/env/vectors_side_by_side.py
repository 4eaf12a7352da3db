"""Vectors of a program beside Gymnasium's vectors of single environments, live and compiled: all that is returned."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import FrameStackObservation, TimeLimit

from envgraph.env import MODEL_KINDS, EnvgraphLiveEnv, ObservationKind, Simulator, model_view
from envgraph.env.compiled import CompiledEnv, CompiledVectorEnv
from envgraph.env.compiled.batches._batch import CAPACITY_ERRORS, INT_ERROR
from envgraph.errors import EnvgraphError, EvaluationError, InvalidArgument, RuleError
from tests.unit.env.side_by_side import TOO_LARGE, Family

LIMIT = 7
"""Steps of an episode."""
ONLY_COMPILED = (*CAPACITY_ERRORS.values(), INT_ERROR)
"""Errors that the live engine does not have."""


def compare_vectors(
    family: Family, kind: ObservationKind | None, history: int | None, mode: AutoresetMode, rounds: int, seed: int = 0
) -> None:
    """Step two environments of each member in all ways, with random actions; what differs is an error of the test.

    Where an observation of this kind cannot be made, or an error ends a step, it does so in all ways.
    """
    made = [_result(make) for make in _makers(family, kind, history, mode)]
    if isinstance(made[0], InvalidArgument):
        assert {str(one) for one in made} == {str(made[0])}
        return
    many: list[Any] = made
    assert all(one.observation_space == many[0].observation_space for one in many), kind
    found = [_result(partial(one.reset, seed=seed)) for one in many]
    actions = np.random.default_rng(seed)
    for step in range(rounds):
        if not _agree(found, f"{kind}, history {history}, {mode}, before step {step}"):
            break
        over = found[0][2] | found[0][3] if len(found[0]) > 2 else np.zeros(many[0].num_envs, np.bool_)
        if mode is AutoresetMode.DISABLED and over.any():
            found = [_result(partial(one.reset, options={"reset_mask": over.copy()})) for one in many]
            continue
        chosen = actions.integers(many[0].single_action_space.n, size=many[0].num_envs)
        found = [_result(partial(one.step, chosen.copy())) for one in many]
        family.compared += many[0].num_envs


def _makers(
    family: Family, kind: ObservationKind | None, history: int | None, mode: AutoresetMode
) -> list[Callable[[], Any]]:
    """Functions that make the vectors: of a program, of live environments, and of compiled ones."""
    members = [*range(len(family.engines))] * 2

    def single(make: Callable[[int, Any], Any], view: Any, member: int) -> Any:
        env = make(member, view)
        return TimeLimit(env if history is None else FrameStackObservation(env, history), LIMIT)

    def live(member: int, view: Any) -> EnvgraphLiveEnv:
        return EnvgraphLiveEnv(
            Simulator(family.engines[member].copy(), family.behaviour, family.keys), observation=view
        )

    def compiled(member: int, view: Any) -> CompiledEnv:
        return CompiledEnv(family.program, member, observation=view)

    def theirs(make: Callable[[int, Any], Any]) -> SyncVectorEnv:
        view: Any = kind
        if kind in MODEL_KINDS and kind is not None:
            view = model_view(kind, family.behaviour, [engine.model for engine in family.engines])
        return SyncVectorEnv([partial(single, make, view, one) for one in members], autoreset_mode=mode)

    def ours() -> CompiledVectorEnv:
        env = CompiledVectorEnv(
            family.program, len(members), observation=kind, streams="each", max_episode_steps=LIMIT, autoreset_mode=mode
        )
        if history is not None:
            env.set_history(history)
        return env

    return [ours, partial(theirs, live), partial(theirs, compiled)]


def _result(function: Callable[[], Any]) -> Any:
    """What a function returns, or the error that it raises."""
    try:
        return function()
    except (InvalidArgument, EvaluationError, RuleError) as error:
        return error


def _agree(found: list[Any], said: str) -> bool:
    """See that all results are one, or that all are errors.

    Returns:
        Whether they are results.
    """
    errors = [one for one in found if isinstance(one, EnvgraphError)]
    if errors:
        only_compiled = errors[0].message in ONLY_COMPILED or errors[0].message.endswith(TOO_LARGE)
        assert len(errors) == len(found) or only_compiled, f"{said}: {found}"
        return False
    with np.printoptions(threshold=10**6, floatmode="unique"):
        wanted, *others = [repr(_sorted(one)) for one in found]
    for other in others:
        assert other == wanted, said
    return True


def _sorted(part: Any) -> Any:
    """The results, with the entries of dictionaries in one order."""
    if isinstance(part, dict):
        return {name: _sorted(part[name]) for name in sorted(part)}
    if isinstance(part, np.ndarray) and part.dtype == object:
        return _sorted(part.tolist())
    return [*map(_sorted, part)] if type(part) in (tuple, list) else part
