"""Compute the certificate of a level: if it can be solved, in how many steps, and how often random walks succeed."""

from __future__ import annotations

from collections.abc import Mapping
from threading import Event
from typing import TYPE_CHECKING, Final

from envgraph.behaviour import Behaviour, KeyIndex
from envgraph.code import dataclass
from envgraph.editor import StoppedError
from envgraph.errors import EnvgraphError
from envgraph.page._work import JsonObject
from envgraph.rewrite import Engine

if TYPE_CHECKING:
    from envgraph.env import Simulator, Tabular
    from envgraph.solve import EpisodeAdvisor

MAX_OUTCOMES: Final = 100_000
"""Outcomes of actions that are visited for a certificate; the live engine takes about 5 seconds for them."""

_EPISODES: Final = 100
"""Random walks that are sampled if there are too many states; the live engine takes a second for 20,000 steps."""

DEFAULT_LIMIT: Final = 200
"""The most steps of an episode, if the environment has no limit."""


@dataclass(frozen=True, slots=True)
class Certificate:
    """The exact results about a level, or the reason why there are none.

    Attributes:
        data: the results for the page.
        advisor: the best policy; None if there are too many states, or its values do not converge.
    """

    data: JsonObject
    advisor: EpisodeAdvisor | None = None


def certify_level(
    engine: Engine, behaviour: Behaviour, keys: KeyIndex | None, limit: int | None, stopped: Event
) -> Certificate:
    """Compute the certificate and the best policy of the engine's model.

    Args:
        engine: an engine that nothing else uses meanwhile.
        behaviour: the environment.
        keys: the numbers of objects over the family; None for those of the model.
        limit: steps after which an episode is truncated.
        stopped: raise `StoppedError` after this is set.
    """
    try:
        from envgraph.env import Simulator, TooManyStates, explore
        from envgraph.solve import certify
    except ImportError:
        return Certificate(_unknown("Exact results need NumPy, which is not available here."))

    steps = limit or DEFAULT_LIMIT

    def check_stopped(states: int, outcomes: int) -> None:
        if stopped.is_set():
            raise StoppedError("stopped")

    try:
        table = explore(engine, behaviour, keys, outcomes=MAX_OUTCOMES, progress=check_stopped).tabular
    except TooManyStates as error:
        return Certificate(_sample(Simulator(engine, behaviour, keys), steps, f"Not exact: {error.message}.", stopped))
    data = certificate_of(certify(table, limit=steps).values(), states=table.n_states)
    return Certificate(data, _best_policy(table))


def _best_policy(table: Tabular) -> EpisodeAdvisor | None:
    from envgraph.solve import EpisodeAdvisor

    try:
        return EpisodeAdvisor(table)
    except EnvgraphError:  # The values do not converge.
        return None


def _sample(simulator: Simulator, limit: int, reason: str, stopped: Event) -> JsonObject:
    """Return the success of sampled random walks, for a level with too many states for a table."""
    from envgraph.solve import sample_walks

    def check_stopped(episodes: int, _: int) -> None:
        if stopped.is_set():
            raise StoppedError("stopped")

    walks = sample_walks(simulator, limit, _EPISODES, progress=check_stopped)
    success = float(walks[:, 0].mean())
    text = f"{reason} Of {len(walks)} sampled random walks, {success:.2%} succeed in {limit} steps."
    return {**_unknown(text), "randomWalk": success, "limit": limit}


def _unknown(text: str) -> JsonObject:
    names = ("solvable", "shortest", "optimal", "randomWalk", "states", "limit")
    return {**dict.fromkeys(names), "text": text}


def certificate_of(values: Mapping[str, float | None], states: int | None = None) -> JsonObject:
    """Return the certificate of a level for the page.

    Args:
        values: the values of `Certificates.values`, or those that `envgraph verify` stores with a member.
        states: the number of states, if it is known.

    >>> exact = {"shortest_plan": 14, "limit": 120, "random_success": 5e-6, "optimal_return": 0.87}
    >>> certificate_of(exact, 1200)["text"]
    'Solvable in 14 steps. A random walk succeeds with probability 5e-06 in 120 steps. Best return 0.87; 1,200 states.'
    """
    is_exact, limit = "sampled_episodes" not in values, values["limit"]
    plan = values["shortest_plan" if is_exact else "plan_found"]
    walk, best = values["random_success" if is_exact else "sampled_success"], values["optimal_return"]
    if plan is None:
        solved = "It cannot be solved" if is_exact else "No plan was found"
    else:
        solved = f"Solvable in {plan:.0f} step{'s' * (plan != 1)}"
        if limit is not None and plan > limit:
            solved += f", but an episode has only {limit:.0f} steps"
    sentences = [solved, f"A random walk succeeds with probability {walk:.2g} in {limit:.0f} steps"]
    if is_exact:
        value = "not finite" if best is None else f"{best:.4g}"
        sentences.append(f"Best return {value}" + (f"; {states:,} states" if states is not None else ""))
    else:
        sentences[-1] += " (sampled)"
    return {
        "solvable": plan is not None and limit is not None and plan <= limit if is_exact else None,
        "shortest": plan,
        "optimal": best,
        "randomWalk": walk,
        "states": states,
        "limit": limit,
        "text": f"{'. '.join(sentences)}.",
    }
