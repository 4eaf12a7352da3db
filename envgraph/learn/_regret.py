"""Schedules that choose the members of a family for a tabular learner."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from envgraph.env import Tabular
from envgraph.env.schedules import SCHEDULES, Outcomes, Replay, Schedule, named_schedule
from envgraph.errors import InvalidArgument, check_known
from envgraph.solve import evaluate_policy, optimal_return
from envgraph.solve.learning import TrainingSettings

EXACT_SCHEDULES: Final = ("exact_regret", "exact_learnability")
"""Schedules that need tables: replay by an exact score that is computed from them."""

TEACHERS: Final = (*(name for name in SCHEDULES if name != "sfl"), *EXACT_SCHEDULES)
"""Schedules that can choose the environments of a family; SFL is for thousands of levels."""


class ExactScore:
    """A score of members: the exact regret or learnability of a learner's current epsilon-greedy policy.

    Args:
        of: the name of the score, one of `EXACT_SCHEDULES`.
        tabulars: the members.
        settings: the settings of the learner.
        q: returns the learner's current values [observations, actions].

    Attributes:
        epsilon: current exploration rate; an action other than the greedy one has probability `epsilon / A`.
    """

    def __init__(
        self,
        of: str,
        tabulars: Sequence[Tabular],
        settings: TrainingSettings,
        q: Callable[[], NDArray[np.float64]],
    ) -> None:
        self._of, self._tabulars, self._settings, self._q = of, tabulars, settings, q
        self.epsilon = settings.epsilon.start
        limit, discount = settings.limit, settings.discount
        self._optimum = [optimal_return(one, limit, discount=discount) for one in tabulars]

    def __call__(self, outcomes: Outcomes) -> NDArray[np.float64]:
        """Return the score of each member that was played."""
        return np.array([self.score_of(member) for member in outcomes.members.tolist()])

    def score_of(self, member: int) -> float:
        """Return the score of a member (regret or learnability, as chosen in the constructor), for the learner's
        current policy.
        """
        tabular, settings = self._tabulars[member], self._settings
        policy = np.full((tabular.n_states, tabular.n_actions), self.epsilon / tabular.n_actions)
        greedy = self._q().argmax(axis=1)[tabular.observation]
        policy[np.arange(tabular.n_states), greedy] += 1.0 - self.epsilon
        found = evaluate_policy(tabular, policy, settings.limit, discount=settings.discount)
        if self._of == "exact_regret":
            return self._optimum[member] - found.mean_return
        return found.success_rate * (1.0 - found.success_rate)


def new_schedule(name: str, count: int, exact: ExactScore | None = None) -> Schedule:
    """Return a new schedule for the members of a family.

    Args:
        name: one of `TEACHERS`.
        count: number of members.
        exact: the score for a schedule in `EXACT_SCHEDULES`; None if members have no tables.

    Raises:
        InvalidArgument: the name is unknown, or the schedule needs tables of the members.
    """
    check_known(name, TEACHERS, f"unknown schedule `{name}`")
    if name not in EXACT_SCHEDULES:
        return named_schedule(name, count)
    if exact is None:
        raise InvalidArgument(f"`{name}` needs tables, but the environments have too many states for tables")
    return Replay(np.arange(count), score=exact)
