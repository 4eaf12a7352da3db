"""Play episodes of a policy that is a network, in a compiled program."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from envgraph.env.compiled import CompiledProgram, ProgramPlayer
from envgraph.errors import InvalidArgument
from envgraph.solve._evaluation import Evaluation

Layer = tuple[ArrayLike, ArrayLike]
"""The weights of a layer [inputs, outputs], and the bias of each output."""


def play_program(
    program: CompiledProgram,
    layers: Sequence[Layer],
    rng: np.random.Generator,
    *,
    members: Sequence[int] | None = None,
    episodes: int = 100,
    limit: int = 100,
    sampled: bool = False,
) -> list[Evaluation]:
    """Play episodes of a policy that is a network, all in compiled code.

    Its inputs are those of `observation="flat"`, with the indices of the program's family. Hidden units are rectified.
    There is an output for each action. The action is the first one with the greatest output, or is sampled from the
    softmax of the outputs. The network is computed in float64: the bias first, then the inputs in order.

    A random number is drawn for each beginning of an episode and for each step, and the environment uses them as
    `envgraph.make(.., engine="compiled")` uses its own. If actions are sampled, a number for the action is drawn
    before. If no result depends on random numbers, one episode is played and counts for all.

    Args:
        program: the compiled behaviour with its family.
        layers: the first has an input for each entry of an observation, the last an output for each action.
        rng: over PCG64, as `numpy.random.default_rng` makes it; is advanced, from member to member.
        members: numbers of the members; all of them by default.
        episodes: number of episodes of each member.
        limit: steps after which an episode is truncated.
        sampled: True to sample actions from the softmax of the outputs.

    Returns:
        The results on each of the members, in order.

    Raises:
        InvalidArgument: an argument does not fit the program.
        EvaluationError: an expression has no value in a state, or a rule cannot be applied.
    """
    chosen = range(len(program.members)) if members is None else members
    if not all(0 <= one < len(program.members) for one in chosen):
        raise InvalidArgument(f"`members` must be numbers from 0 to {len(program.members) - 1}")
    if episodes < 1 or limit < 1:
        raise InvalidArgument(f"`episodes` is {episodes} and `limit` is {limit}, but both must be at least 1")
    weights, sizes = _pack_layers(program, layers)
    shape = program.observation_shape or (1,)
    firsts = np.cumsum([0, *shape[:-1]])
    policy = firsts, weights, sizes, np.zeros(sizes[1:].sum()), sampled
    player = ProgramPlayer(program, "play")
    played = (player.play_episodes(one, policy, episodes, limit, rng) for one in chosen)
    return [Evaluation(*found, episodes, exact=False) for found in played]


def _pack_layers(program: CompiledProgram, layers: Sequence[Layer]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return all biases and weights in one row [1, ..], and the numbers of units of the layers, from inputs to outputs.

    Raises:
        InvalidArgument: the layers do not fit each other, or the program.
    """
    pairs = [(np.asarray(one, np.float64), np.asarray(bias, np.float64)) for one, bias in layers]
    ends = sum(program.observation_shape or (1,)), len(program.action_names)
    sizes = [ends[0], *(bias.size for _, bias in pairs)]
    given = [(weights.shape, bias.shape) for weights, bias in pairs]
    if given != [((before, after), (after,)) for before, after in pairwise(sizes)] or sizes[-1] != ends[1]:
        raise InvalidArgument(
            f"layers with the shapes {given} do not form a network from {ends[0]} inputs to {ends[1]} actions",
            "pass weights as [inputs, outputs]: for torch's `Linear` use `weight.T`",
        )
    numbers = np.concatenate([part.ravel() for weights, bias in pairs for part in (bias, weights)])
    if not np.isfinite(numbers).all():
        raise InvalidArgument("weights and biases must be finite numbers")
    return numbers[None], np.array(sizes)
