"""Controls: other ways to train with the same steps on the same environments, to compare a curriculum with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from math import factorial
from typing import Any, Final, Literal, get_args

import numpy as np

from envgraph.env import Tabular
from envgraph.errors import check_known
from envgraph.learn._curricula import Curriculum, sequences
from envgraph.learn._regret import TEACHERS
from envgraph.learn._results import OPTIMISTIC
from envgraph.solve import optimal_episode, optimal_return, reachable_states
from envgraph.solve.learning import Epsilon, TrainingSettings

Control = Literal["direct", "optimistic", "reversed", "shuffled", "randomised", "backplay", "exploring"]
CONTROLS: Final[tuple[Control, ...]] = get_args(Control)

ORDERS: Final = 100
"""Maximum number of different orders of the control "shuffled"."""

LOW_EPSILON: Final = Epsilon(start=0.05, decay=1.0, minimum=0.05)
"""The exploration of "optimistic" agents that explore mostly by their high values."""


def controls(
    names: Sequence[str],
    kinds: Sequence[str] = CONTROLS,
    *,
    optimism: Sequence[float] = (),
    starts: Sequence[str] = (),
    seed: int = 0,
) -> tuple[Curriculum, ...]:
    """Return the controls of a whole family as a curriculum. Each control has exactly as many steps.

    "direct": the target alone. "optimistic": the target alone with higher initial values: two controls for each value,
    the second with `LOW_EPSILON`; `Experiment.best_optimistic` chooses. "reversed" and "shuffled": other orders, with
    the target last, since success is measured on it; the shuffled order depends on the seed. "randomised": each episode
    in an environment sampled at random (Tobin et al. 2017), once in one stage, and once with as many renewals of
    epsilon as in the curriculum. "backplay" (Resnick et al. 2018; Florensa et al. 2017): the target, begun in each
    state of an optimal episode, the last state first; also with a stage for each member of the family. "exploring":
    the target, begun in any state. A schedule (`TEACHERS`) chooses the environment of each turn among those before
    the target, from the outcomes of earlier turns; the target is last. The schedule "uniform" chooses at random.
    Controls for which the family is too small are left out: with fewer than three environments there is no other order.

    Args:
        names: the environments from the easiest to the target.
        kinds: some of the controls above; schedules are used only if named.
        optimism: initial Q-values of "optimistic", see `optimistic_values`; if empty, "optimistic" is left out.
        starts: names of `other_starts`, in its order; if empty, "backplay" and "exploring" are left out.
        seed: the seed of the shuffled orders.

    Raises:
        InvalidArgument: `names` is empty or has a name twice, or a kind is unknown.

    >>> [one.label for one in controls(["E1", "E2", "E3", "E4"], optimism=[5.0])]
    ['E4', 'optimistic 5', 'optimistic 5, epsilon 0.05', 'reversed', 'shuffled', 'randomised', 'randomised, renewed']
    >>> [stage for stage in controls(["E1", "E2", "E3"], ["reversed"])[0].stages]
    ['E2', 'E1', 'E3']
    >>> [one.stages for one in controls(["E1", "E2"], ["backplay"], starts=["any", "last", "middle"])]
    [('last', 'middle', 'E2'), ('last', 'E2')]
    """
    known = (*CONTROLS, *TEACHERS)
    for kind in kinds:
        check_known(kind, known, f"unknown control {kind!r}")
    direct, count = sequences(names, "direct"), len(names)
    found: list[Curriculum] = [*direct] if "direct" in kinds else []

    def add(label: str, *stages: str | tuple[str, ...], **options: Any) -> None:
        """Add a control with stages of equal lengths."""
        shares = (Fraction(count, len(stages)),) * len(stages)
        found.append(Curriculum("control", label, stages, shares, **options))

    *earlier, target = names
    if "optimistic" in kinds:
        for value in optimism:
            add(f"{OPTIMISTIC} {value:.4g}", target, initial_value=value)
            add(f"{OPTIMISTIC} {value:.4g}, epsilon 0.05", target, initial_value=value, epsilon=LOW_EPSILON)
    if "reversed" in kinds and count > 2:
        add("reversed", *reversed(earlier), target)
    if "shuffled" in kinds and (orders := tuple((*one, target) for one in _shuffled_orders(tuple(earlier), seed))):
        add("shuffled", *orders[0], orders=orders)
    if "randomised" in kinds and count > 1:
        add("randomised", tuple(names))
        add("randomised, renewed", *[tuple(names)] * count)
    if "backplay" in kinds and len(starts) > 1:
        states = (*starts[1:], target)
        add("backplay", *states)
        if len(states) > count > 1:
            some = (states[len(states) * place // count - 1] for place in range(1, count + 1))
            add(f"backplay, {count} stages", *some)
    if "exploring" in kinds and starts:
        add("exploring", starts[0])
    if count > 2:
        for kind in (kind for kind in kinds if kind in TEACHERS):
            add(kind, *[tuple(earlier)] * (count - 1), target, schedule=kind)
    return tuple(found)


def optimistic_values(target: Tabular, settings: TrainingSettings) -> tuple[float, ...]:
    """Return half the greatest discounted return within the step limit, that return, and twice that return.

    An agent moves to where its values have not yet fallen, so it visits everything systematically (Sutton and Barto
    2018, section 2.6). With high values it continues after it has found the best return; low values may fall before it
    finds this return. The best value depends on the target and on the number of steps.

    Returns:
        The values above `settings.initial_value`; () if no return is positive, since 0 is then optimistic already.
    """
    most = optimal_return(target, settings.limit, discount=settings.discount)
    return tuple(value for value in (most / 2, most, 2 * most) if value > settings.initial_value)


def other_starts(name: str, target: Tabular, limit: int = 200) -> dict[str, Tabular]:
    """Return copies of the target `name` with other start states, by their own names, for "exploring" and "backplay".

    The first copy begins in any state that does not end the episode, all equally likely. The others begin in each state
    of an optimal episode but its start, the last state first; there are none if no such episode ends in success.
    """
    every = np.arange(target.n_states, dtype=np.int32)
    stays = (target.next_state == every[:, None, None]) & (target.terminated == 0) & (target.reward == 0)
    ended = (stays | (target.probability == 0)).all(axis=(1, 2))
    found = {f"{name} from any state": every[reachable_states(target) & ~ended]}
    along = list(dict.fromkeys(reversed(optimal_episode(target, limit))))[:-1]
    found |= {f"{name} from state {state}": every[[state]] for state in along}
    return {
        text: replace(target, start_states=states, start_probability=np.full(len(states), 1 / len(states)))
        for text, states in found.items()
    }


def _shuffled_orders(names: tuple[str, ...], seed: int) -> Iterator[tuple[str, ...]]:
    """Yield all orders except the given one and its reverse, in random sequence, at most `ORDERS` of them."""
    seen = {names, names[::-1]}
    wanted = min(len(seen) + ORDERS, factorial(len(names)))
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(len(names),)))
    while len(seen) < wanted:
        one = tuple(names[place] for place in rng.permutation(len(names)))
        if one not in seen:
            seen.add(one)
            yield one
