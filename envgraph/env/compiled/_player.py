"""Episodes of a policy in a compiled program, in one environment."""

from __future__ import annotations

from typing import Any

import numpy as np

from envgraph.env.compiled._program import Program, Purpose, set_stream
from envgraph.env.compiled._world import space_of, streams
from envgraph.errors import EvaluationError


class Player:
    """One environment of a program, that a function of it acts in.

    Args:
        program: the compiled behaviour.
        purpose: what the function is for.
    """

    def __init__(self, program: Program, purpose: Purpose) -> None:
        arrays = program.arrays
        states, floats = (np.zeros_like(array[:1]) for array in (arrays.ints, arrays.floats))
        fixed = program.tables, arrays.reals, arrays.offsets
        space = *space_of(program.space), np.zeros(1)
        self.program, self._functions = program, program.functions(purpose)
        self._before = *fixed, states, floats, floats.view(np.int64), *space
        self._starts = arrays.ints, arrays.floats
        self._seen = np.zeros((1, max(1, len(program.observation_shape))), dtype=np.int64)

    def call(self, name: str, member: int, rng: np.random.Generator, *arguments: Any) -> Any:
        """Call a function with the environment of a member, and advance the generator by what it draws."""
        stream = streams([rng])
        found = self._functions[name](*self._before, member, *self._starts, stream, self._seen, *arguments)
        set_stream(rng, stream[0])
        return found

    def play(
        self, member: int, policy: tuple[Any, ...], episodes: int, limit: int, rng: np.random.Generator
    ) -> tuple[float, float, float]:
        """Episodes of a policy: how many succeed, from 0 to 1, mean sum of rewards, and mean steps.

        For each beginning a number is drawn, and for each step, behind what the policy draws.

        Args:
            member: its number.
            policy: what `decide` of the purpose's text takes.
            episodes: how many.
            limit: steps after which an episode is over.
            rng: over PCG64; it is advanced.

        Raises:
            EvaluationError: something has no value in a state, or a rule cannot be applied.
        """
        well, successes, total, steps = self.call("follow", member, rng, policy, episodes, limit)
        self.check(well)
        return successes / episodes, total / episodes, steps / episodes

    def check(self, well: bool) -> None:
        """See that nothing went wrong.

        Raises:
            EvaluationError: something did.
        """
        if not well:
            behaviour = self.program.behaviour
            raise EvaluationError(
                f"in a step of `{behaviour.name}` a rule cannot be applied, or a value is missing or too large",
                behaviour.span,
                'steps of `envgraph.make(.., engine="live")` say what and where',
            )
