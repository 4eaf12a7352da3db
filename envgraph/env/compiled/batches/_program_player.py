"""Play episodes of a policy inside a compiled program, in one environment."""

from __future__ import annotations

from typing import Any

import numpy as np

from envgraph.env.compiled.layout._batch_arrays import generator_states, zero_row_buffers
from envgraph.env.compiled.programs._compiled_program import CompiledProgram, Purpose, set_generator_state
from envgraph.errors import EvaluationError


class ProgramPlayer:
    """A single environment of a compiled program, and calls of the program's functions that act in the environment.

    Args:
        program: the compiled behaviour.
        purpose: selects the functions that can be called.
    """

    def __init__(self, program: CompiledProgram, purpose: Purpose) -> None:
        arrays = program.arrays
        states, floats = (np.zeros_like(array[:1]) for array in (arrays.ints, arrays.floats))
        fixed = arrays.tables_for(program.native), arrays.reals, arrays.offsets
        space = *zero_row_buffers(program.row_buffer_shape), np.zeros(2)
        self.program, self._functions = program, program.functions_for(purpose)
        self._arguments = *fixed, states, floats, floats.view(np.int64), *space
        self._starts = arrays.ints, arrays.floats
        self._components = np.zeros((1, max(1, len(program.observation_shape))), dtype=np.int64)

    def call_function(self, name: str, member: int, rng: np.random.Generator, *arguments: Any) -> Any:
        """Call a function of the program on a member's environment. `rng` advances by the numbers that are drawn."""
        stream = generator_states([rng])
        found = self._functions[name](*self._arguments, member, *self._starts, stream, self._components, *arguments)
        set_generator_state(rng, stream[0])
        return found

    def play_episodes(
        self, member: int, policy: tuple[Any, ...], episodes: int, limit: int, rng: np.random.Generator
    ) -> tuple[float, float, float]:
        """Play episodes of a policy; return the share of successes (0 to 1), the mean return, and the mean steps.

        One random number is drawn for each reset and each step, after any numbers that the policy draws.

        Args:
            member: the member's number.
            policy: the argument `POLICY` of the function `decide` in the program's text.
            episodes: the number of episodes.
            limit: the maximum number of steps of an episode.
            rng: a generator over PCG64, which is advanced.

        Raises:
            EvaluationError: a value is missing in a state, or a rule cannot be applied.
        """
        well, successes, total, steps = self.call_function("follow", member, rng, policy, episodes, limit)
        self.check_success(well)
        return successes / episodes, total / episodes, steps / episodes

    def check_success(self, is_success: bool) -> None:
        """Raise an error unless `is_success` is True.

        Raises:
            EvaluationError: `is_success` is False: a step of the program failed.
        """
        if not is_success:
            behaviour = self.program.behaviour
            raise EvaluationError(
                f"in a step of `{behaviour.name}` a rule cannot be applied, or a value is missing or too large",
                behaviour.span,
                'make the environment with `engine="live"`: its steps report the value or rule',
            )
