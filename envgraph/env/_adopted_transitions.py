"""Read transitions that Gymnasium environments publish as tables, so that `envgraph adopt` can write a domain."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from math import fsum, lcm
from numbers import Real
from typing import Any, Final, NamedTuple

import gymnasium
import numpy as np

from envgraph.code import dataclass, shorten_repr
from envgraph.env._frozen_lake import action_outcomes
from envgraph.env._minigrid import MiniGridLevel, minigrid_class
from envgraph.env._prepared_clauses import MAX_REWARD
from envgraph.env._tabular import Tabular
from envgraph.errors import LIMITS, TOLERANCE, EnvgraphError, InvalidArgument

_MINIGRID: Final = ("MiniGrid-", "BabyAI-")
_TRIAL_STEPS: Final = 2_000
"""Number of trial steps; Taxi's fickle passenger is noticed in less than a hundred."""


@shorten_repr
class TransitionOutcome(NamedTuple):
    """A possible outcome of an action in a state; `state` is the number of the next state."""

    probability: float
    state: int
    reward: float
    terminated: bool


@dataclass(frozen=True, slots=True)
class AdoptedTransitions:
    """The published transitions of an environment.

    Attributes:
        outcomes: the possible outcomes by state and action, both numbered from 0.
        start_probabilities: the probability of each initial state; states without an entry are never initial.
        map_rows: the letters of the environment's map, row by row, if it has one letter for each state; otherwise ().
        final_states: the states in which episodes can end, each with True for success. A state is a success if
            entering it pays the greatest reward of all these states.
    """

    outcomes: Sequence[Sequence[Sequence[TransitionOutcome]]]
    start_probabilities: Mapping[int, float]
    map_rows: tuple[str, ...]
    final_states: Mapping[int, bool]

    @property
    def n_actions(self) -> int:
        """Return the number of actions."""
        return len(self.outcomes[min(self.start_probabilities)])

    def merged_outcomes(self, state: int, action: int) -> list[TransitionOutcome]:
        """Return the outcomes with positive probability; outcomes that differ only in probability are merged."""
        found: dict[tuple[int, float, bool], float] = defaultdict(float)
        for outcome in self.outcomes[state][action]:
            found[outcome[1:]] += outcome.probability
        return [TransitionOutcome(chance, *key) for key, chance in found.items() if chance]

    def equally_likely_starts(self) -> list[int]:
        """Return a list of initial states, in which each state occurs in proportion to its probability.

        Raises:
            InvalidArgument: the probabilities are not multiples of 1/n for any n up to 10,000.
        """
        chances = [*self.start_probabilities.values()]
        most = LIMITS["start states"]
        fractions = [Fraction(chance).limit_denominator(most) for chance in chances]
        whole = lcm(*(one.denominator for one in fractions))
        exact = all(abs(float(one) - chance) < TOLERANCE for one, chance in zip(fractions, chances, strict=True))
        if not exact or whole > most or sum(fractions) != 1:
            shown = ", ".join(f"{chance:g}" for chance in chances[:5]) + (", .." if len(chances) > 5 else "")
            message = f"the start probabilities ({shown}) are not multiples of 1/n for any n up to {most:,}"
            raise InvalidArgument(message, "round `initial_state_distrib` to multiples of 1/n, such as 0.25 and 0.75")
        return [
            state
            for one, state in zip(fractions, self.start_probabilities, strict=True)
            for _ in range(int(one * whole))
        ]

    def differences(self, table: Tabular) -> Iterator[str]:
        """Yield a text for each difference to a table whose observations are the numbers of states; nothing if none.

        States in which an episode ends are not compared, because the table makes them absorbing. If the numbers of
        actions differ, no outcome is compared.
        """
        starts = dict(
            zip(table.observation[table.start_states].tolist(), table.start_probability.tolist(), strict=True)
        )
        if not _nearly_equal(starts, self.start_probabilities):
            yield f"its start probabilities by state are {starts}, not {dict(self.start_probabilities)}"
        seen = table.observation.tolist()
        if table.n_actions != self.n_actions:
            yield f"it has {table.n_actions} actions, not {self.n_actions}"
            return
        for number, state in enumerate(seen):
            for action in range(self.n_actions if state not in self.final_states else 0):
                wanted = {one[1:]: one.probability for one in self.merged_outcomes(state, action)}
                found = action_outcomes(table, seen, number, action)
                if not _nearly_equal(found, wanted):
                    yield f"in state {state} action {action} gives {found}, not {wanted}"


def _nearly_equal(first: Mapping[Any, float], second: Mapping[Any, float]) -> bool:
    return all(abs(first.get(key, 0.0) - second.get(key, 0.0)) < TOLERANCE for key in {**first, **second})


def adopt(id: str, seed: int = 0, **options: Any) -> tuple[AdoptedTransitions | MiniGridLevel, int | None]:
    """Return the transitions or the MiniGrid level of a registered environment, and its time limit in steps or None.

    The unwrapped environment is one of MiniGrid, or has `P`, for each state and action a list of (probability, next
    state, reward, terminated). It may also have `initial_state_distrib` (by default, episodes begin in state 0), and
    `desc`, a map of letters.

    Args:
        id: the id of a registered environment.
        seed: the seed that generates a MiniGrid level; unused for other environments.
        options: options of `gymnasium.make`.

    Raises:
        InvalidArgument: the environment cannot be made, publishes no valid transitions, makes other steps than the
            published ones, has a state that ends the episode only sometimes, or is an unsupported MiniGrid level.

    >>> adopted, limit = adopt("FrozenLake-v1")
    >>> adopted.map_rows, adopted.final_states, limit
    (('SFFF', 'FHFH', 'FFFH', 'HFFG'), {5: False, 7: False, 11: False, 12: False, 15: True}, 100)
    """
    known = f"minigrid:{id}" if id.startswith(_MINIGRID) else id
    try:
        made = gymnasium.make(known, **options)
    except Exception as error:  # any error of foreign code
        hint = "pip install minigrid" if known != id else None
        raise InvalidArgument(f"Gymnasium cannot make `{id}`: {error}", hint) from None
    try:
        if minigrid_class(made.unwrapped):
            level = MiniGridLevel.from_reset(made.unwrapped, seed)
            return level, level.limit
        adopted = _read_transitions(made.unwrapped)
        _check_random_steps(made.unwrapped, adopted)
    except EnvgraphError:
        raise
    except Exception as error:  # any error of foreign code
        raise InvalidArgument(f"a trial episode of `{id}` failed: {type(error).__name__}: {error}") from None
    finally:
        made.close()
    return adopted, made.spec.max_episode_steps if made.spec else None


def _check_random_steps(inner: Any, adopted: AdoptedTransitions) -> None:
    """Take 2,000 random steps in an environment, and check that each is one of its published transitions.

    Taxi with `fickle_passenger`, for example, makes transitions that its `P` does not contain.

    Raises:
        InvalidArgument: a step is not among the transitions, or an observation is not a state number.
    """
    rng = np.random.default_rng(0)
    state, _ = inner.reset(seed=0)
    for _ in range(_TRIAL_STEPS):
        if not isinstance(state, int | np.integer) or not 0 <= state < len(adopted.outcomes):
            raise InvalidArgument(f"`{type(inner).__name__}` observes {state}, which is not the number of a state")
        action = int(rng.integers(adopted.n_actions))
        after, reward, terminated, *_ = inner.step(action)
        known = {outcome[1:] for outcome in adopted.outcomes[int(state)][action]}
        if (after, reward, terminated) not in known:
            did = f"in state {state} action {action} led to {after}"
            hint = "make the environment without the option that causes this transition"
            raise InvalidArgument(
                f"`{type(inner).__name__}` made a transition that its `P` does not contain: {did}", hint
            )
        state = inner.reset()[0] if terminated else after


def _read_transitions(inner: Any) -> AdoptedTransitions:
    table = getattr(inner, "P", None)
    if not isinstance(table, Mapping | list) or not len(table):
        message = f"`{type(inner).__name__}` has no `P`, a table of its transitions"
        raise InvalidArgument(message, "write the domain by hand; `envgraph new` creates a template")
    states, where = len(table), f"`P` of `{type(inner).__name__}`"
    if states > LIMITS["states"]:
        raise InvalidArgument(f"{where} has {states:,} states, but at most {LIMITS['states']:,} can be adopted")
    outcomes = [_read_actions(table, state, where) for state in range(states)]
    starts = _read_starts(inner, states)
    endings, actions = _find_final_states(outcomes, starts), max(1, len(outcomes[min(starts)]))
    for state, row in enumerate(outcomes):
        known = sum(map(bool, row))
        if state not in endings and not known == actions == len(row):
            raise InvalidArgument(f"{where} has {known} actions in state {state}, but must have {actions}")
    return AdoptedTransitions(outcomes, starts, _read_map(inner, states), endings)


def _read_actions(table: Any, state: int, table_name: str) -> list[list[TransitionOutcome]]:
    """Return the outcomes of each action in a state of `P`, which error messages call `table_name`.

    Raise InvalidArgument if they are malformed.
    """
    found, place = list[list[TransitionOutcome]](), f"state {state}"
    try:
        for action in range(len(table[state])):
            place = f"action {action} in state {state}"
            given = table[state][action]
            found.append([TransitionOutcome(float(p), int(s), float(r), bool(over)) for p, s, r, over in given])
    except (LookupError, TypeError, ValueError, OverflowError):
        hint = "`P[state][action]`, numbered from 0, must be a list of (probability, next state, reward, terminated)"
        raise InvalidArgument(f"{table_name}: the outcomes of {place} cannot be read", hint) from None
    for action, row in enumerate(found):
        for problem in _distribution_problems(row, len(table)):
            raise InvalidArgument(f"{table_name}: action {action} in state {state} {problem}")
    return found


def _distribution_problems(outcomes: Sequence[TransitionOutcome], states: int) -> Iterator[str]:
    """Yield a phrase for each probability, state or reward out of range, and for probabilities that do not sum to 1."""
    for probability, state, reward, _ in outcomes:
        if not 0.0 <= probability <= 1.0 + TOLERANCE:
            yield f"has the probability {probability:g}, but must have one from 0 to 1"
        if not 0 <= state < states:
            yield f"leads to state {state}, but must lead to one of 0..{states - 1}"
        if not abs(reward) <= MAX_REWARD:
            yield f"has the reward {reward:g}, but must have one from {-MAX_REWARD:g} to {MAX_REWARD:g}"
    total = fsum(outcome.probability for outcome in outcomes)
    if outcomes and not abs(total - 1.0) <= TOLERANCE:
        yield f"has probabilities that sum to {total:g}, but must sum to 1"


def _read_starts(inner: Any, states: int) -> dict[int, float]:
    """Return the probability of each initial state, 1 for state 0 by default; raise InvalidArgument if malformed."""
    given = getattr(inner, "initial_state_distrib", None)
    if given is None:
        return {0: 1.0}
    chances = np.asarray(given, dtype=object)
    if chances.shape == (states,) and all(isinstance(chance, Real) for chance in chances):
        found = [TransitionOutcome(float(chance), state, 0.0, False) for state, chance in enumerate(chances)]
        if next(_distribution_problems(found, states), None) is None:
            return {one.state: one.probability for one in found if one.probability}
    wanted = f"a probability from 0 to 1 for each of {states} states, which sum to 1"
    raise InvalidArgument(f"`initial_state_distrib` of `{type(inner).__name__}` must have {wanted}")


def _read_map(inner: Any, states: int) -> tuple[str, ...]:
    desc = np.asarray(getattr(inner, "desc", ()), dtype=object)
    if desc.ndim != 2 or desc.size != states:
        return ()
    return tuple(
        "".join(one.decode("utf-8", "replace") if isinstance(one, bytes) else str(one) for one in row) for row in desc
    )


def _find_final_states(
    outcomes: Sequence[Sequence[Sequence[TransitionOutcome]]], starts: Mapping[int, float]
) -> dict[int, bool]:
    """Return the states in which episodes can end, each with True if entering it pays the greatest of their rewards.

    Raise InvalidArgument if some transitions into a state end the episode, and others do not.
    """
    reward: dict[int, float] = {}
    going, todo = {*starts}, [*starts]
    while todo:
        for outcome in (one for action in outcomes[todo.pop()] for one in action if one.probability):
            if outcome.terminated:
                reward[outcome.state] = max(outcome.reward, reward.get(outcome.state, outcome.reward))
            elif outcome.state not in going:
                going.add(outcome.state)
                todo.append(outcome.state)
    both = sorted(going & {*reward})
    if both:
        message = f"some transitions into state {both[0]} end the episode, and others do not"
        raise InvalidArgument(message, "adopt an environment in which the next state alone decides if the episode ends")
    best = max(reward.values(), default=0.0)
    return {state: reward[state] == best for state in sorted(reward)}
