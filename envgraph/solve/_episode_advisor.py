"""Find the best actions in the states of an episode that is played on a live engine."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from envgraph.env import PlayedEpisode, Tabular
from envgraph.solve._evaluation import cumulative_probabilities
from envgraph.solve._value_iteration import value_iteration


class EpisodeAdvisor:
    """An optimal policy for episodes of an environment whose table is known.

    The table leads to the state of an episode, since the random numbers of the episode choose the same outcomes there.

    Args:
        tabular: the table of the environment.
        discount: see `value_iteration`; also an attribute.

    Raises:
        EvaluationError: as for `value_iteration`.
    """

    def __init__(self, tabular: Tabular, discount: float = 0.99) -> None:
        self.discount = discount
        self._tabular, self._optimal = tabular, value_iteration(tabular, discount)

    def state(self, episode: PlayedEpisode) -> int:
        """Return the number of the current state of an episode, which must not have ended."""
        table, (first, *uniforms) = self._tabular, episode.uniforms
        state = table.start_states[_chosen(table.start_probability, first)]
        for step, uniform in zip(episode.steps, uniforms, strict=True):
            outcome = _chosen(table.probability[state, step.action], uniform)
            state = table.next_state[state, step.action, outcome]
        return int(state)

    def action(self, episode: PlayedEpisode) -> int:
        """Return the number of a best action in the current state, for `PlayedEpisode.step`."""
        return int(self._optimal.policy[self.state(episode)])

    def action_values(self, episode: PlayedEpisode) -> NDArray[np.float64]:
        """Return the expected discounted return after each action in the current state: float64 [actions]."""
        found: NDArray[np.float64] = self._optimal.action_values[self.state(episode)]
        return found


def _chosen(probability: NDArray[np.float64], uniform: float) -> int:
    return int((cumulative_probabilities(probability) <= uniform).sum())
