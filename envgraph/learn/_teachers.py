"""Schedules of the members of a family that a tabular learner is trained on."""

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

EXACT: Final = ("exact_regret", "exact_learnability")
"""Those that need tables: replay by a score that is computed of them."""

TEACHERS: Final = (*(name for name in SCHEDULES if name != "sfl"), *EXACT)
"""What may choose the environments of a family; SFL is for thousands of levels."""


class ExactScore:
    """Exact regret or learnability of a learner as it explores: each action but its best one with `epsilon / A`.

    Args:
        of: one of `EXACT`.
        tabulars: the members.
        settings: how it learns.
        q: gives its values as they are now.

    Attributes:
        epsilon: how often it explores now.
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
        """The score of each member that was played."""
        return np.array([self.of(member) for member in outcomes.member.tolist()])

    def of(self, member: int) -> float:
        """The score of a member."""
        tabular, settings = self._tabulars[member], self._settings
        policy = np.full((tabular.n_states, tabular.n_actions), self.epsilon / tabular.n_actions)
        greedy = self._q().argmax(axis=1)[tabular.observation]
        policy[np.arange(tabular.n_states), greedy] += 1.0 - self.epsilon
        found = evaluate_policy(tabular, policy, settings.limit, discount=settings.discount)
        if self._of == "exact_regret":
            return self._optimum[member] - found.mean_return
        return found.success_rate * (1.0 - found.success_rate)


def teacher(name: str, count: int, exact: ExactScore | None = None) -> Schedule:
    """A schedule for the members of a family.

    Args:
        name: one of `TEACHERS`.
        count: how many members there are.
        exact: for one of `EXACT`.

    Raises:
        InvalidArgument: none has this name, or it needs tables of the members.
    """
    check_known(name, TEACHERS, f"unknown schedule `{name}`")
    if name not in EXACT:
        return named_schedule(name, count)
    if exact is None:
        raise InvalidArgument(f"`{name}` needs tables of all states, of which there are too many")
    return Replay(np.arange(count), score=exact)
