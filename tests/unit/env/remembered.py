"""A live environment that makes each transition once: what the engine did for the same choices is looked up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from envgraph.env import Simulator
from envgraph.errors import EvaluationError, RuleError
from envgraph.graph import Version

LARGEST_BELOW_1 = np.nextafter(1.0, 0.0).item()
MOST_REMEMBERED = 50_000
"""Choices and transitions; after more, all are forgotten."""
Asked = tuple[float, ...] | int
"""What a choice was made of: probabilities, or a number of equal alternatives."""


@dataclass(eq=False)
class State:
    """One that the live engine was in.

    Attributes:
        number: of those before it; -1 for the one in which no episode has begun.
        row: the length and a digest of what a program says it is; None where that was not asked.
        allowed: the mask of actions, where that was asked.
    """

    version: Version
    turn: int
    number: int
    row: tuple[int, bytes] | None = None
    allowed: NDArray[np.bool_] | None = None


@dataclass(frozen=True)
class Transition:
    """What the live engine did: an error in place of an outcome leaves it where it was."""

    state: State
    reward: float = 0.0
    terminated: int = 0
    observation: int = 0
    did: bool = False
    error: Exception | None = None


class Draw:
    """The choices that a uniform number makes: each uses the place of the number within the stretch it lies in."""

    def __init__(self, uniform: float) -> None:
        self.rest = uniform

    def choose(self, probabilities: Sequence[float]) -> int | None:
        """Return the place of the stretch that the number lies in; None if it lies behind all of them."""
        start = 0.0
        for place, probability in enumerate(probabilities):
            if self.rest < start + probability:
                self._zoom(start, probability)
                return place
            start += probability
        if 1.0 - start <= 1e-12:  # the probabilities sum to 1, but for rounding
            self.rest = 0.0
            return len(probabilities) - 1
        self._zoom(start, 1.0 - start)
        return None

    def pick(self, count: int) -> int:
        """Return which of `count` stretches of equal length the number lies in."""
        place = min(int(self.rest * count), count - 1)
        self.rest = min(self.rest * count - place, LARGEST_BELOW_1)
        return place

    def _zoom(self, start: float, length: float) -> None:
        self.rest = min(max((self.rest - start) / length, 0.0), LARGEST_BELOW_1)


class RecordedChoices:
    """The choices that a number makes, written down."""

    def __init__(self, uniform: float) -> None:
        self._draw = Draw(uniform)
        self.made: list[tuple[Asked, int | None]] = []

    def choose(self, probabilities: Sequence[float]) -> int | None:
        """See `Choices`."""
        self.made.append((tuple(probabilities), self._draw.choose(probabilities)))
        return self.made[-1][1]

    def pick(self, count: int) -> int:
        """See `Choices`."""
        found = self._draw.pick(count)
        self.made.append((count, found))
        return found


class CachedSimulator:
    """A simulator whose steps are remembered, by state, action and the choices that were made.

    A number that makes other choices is a step of the live engine; so each step gives what that would give.

    Args:
        simulator: in its initial state.
    """

    def __init__(self, simulator: Simulator) -> None:
        self.simulator = simulator
        self._first = State(simulator.engine.commit(), simulator.turn, -1)
        self._states: dict[tuple[int, int], State] = {}
        self._known: dict[tuple[object, ...], Asked | Transition] = {}
        self.present = self._first

    def reset(self, uniform: float) -> Transition:
        """Begin an episode."""
        self.present = self._first
        return self._go(-1, uniform)

    def step(self, action: int, uniform: float) -> Transition:
        """Do an action."""
        return self._go(action, uniform)

    def _go(self, action: int, uniform: float) -> Transition:
        draw, path = Draw(uniform), (self.present, action)
        while (found := self._known.get(path)) is not None:
            if isinstance(found, Transition):
                self.present = found.state
                return found
            path = (*path, draw.pick(found) if isinstance(found, int) else draw.choose(found))
        told = RecordedChoices(uniform)
        done = self._do(action, told)
        path = (self.present, action)
        if len(self._known) > MOST_REMEMBERED:
            self._known.clear()
        for asked, answer in told.made:
            self._known[path] = asked
            path = (*path, answer)
        self._known[path] = done
        self.present = done.state
        return done

    def checkout_present_state(self) -> Simulator:
        """The live engine, in the present state."""
        self.simulator.engine.checkout(self.present.version, discard=True)
        self.simulator.turn = self.present.turn
        return self.simulator

    def _do(self, action: int, told: RecordedChoices) -> Transition:
        live = self.checkout_present_state()
        try:
            if action < 0:
                live._apply_reset(told)
                reward, terminated = 0.0, 0
            else:
                reward, terminated = live._step(action, told)
            seen = live.observe()
        except (RuleError, EvaluationError) as error:
            return Transition(self.present, error=error)
        key = live.state_key()
        state = self._states.get(key)
        if state is None:
            state = self._states[key] = State(live.engine.commit(), live.turn, len(self._states))
        return Transition(state, reward, terminated, seen, live.has_acted)
