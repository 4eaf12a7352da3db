"""Compute what is known exactly of a level: if it can be solved, in how many steps, and how random walks do."""

from __future__ import annotations

from math import isfinite, isinf
from threading import Event
from typing import TYPE_CHECKING, Any, Final

from envgraph.behaviour import Behaviour, KeyIndex
from envgraph.code import dataclass
from envgraph.errors import EnvgraphError
from envgraph.page._work import JsonObject, StoppedError
from envgraph.rewrite import Engine

if TYPE_CHECKING:
    from envgraph.env import Simulator, Tabular
    from envgraph.solve import EpisodeAdvisor

MAX_OUTCOMES: Final = 100_000
"""Outcomes of actions that are visited for a certificate; the live engine takes about 5 seconds for them."""

_EPISODES: Final = 100
"""Random walks that are sampled if there are too many states; the live engine takes a second for 20,000 steps."""

DEFAULT_LIMIT: Final = 200
"""Steps of an episode, if the environment has no limit."""


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

    within = limit or DEFAULT_LIMIT

    def check_stopped(states: int, outcomes: int) -> None:
        if stopped.is_set():
            raise StoppedError("stopped")

    try:
        table = explore(engine, behaviour, keys, outcomes=MAX_OUTCOMES, progress=check_stopped).tabular
    except TooManyStates as error:
        return Certificate(_sample(Simulator(engine, behaviour, keys), within, f"Not exact: {error.message}.", stopped))
    found = certify(table, limit=within)
    plan = found.shortest_plan if isfinite(found.shortest_plan) else None
    data: JsonObject = {
        "solvable": found.solvable,
        "shortest": plan,
        "optimal": found.optimal_return,
        "randomWalk": found.random_success,
        "states": table.n_states,
        "limit": within,
    }
    return Certificate({**data, "text": describe(data)}, _best_policy(table))


def _best_policy(table: Tabular) -> EpisodeAdvisor | None:
    from envgraph.solve import EpisodeAdvisor

    try:
        return EpisodeAdvisor(table)
    except EnvgraphError:  # The values do not converge.
        return None


def _sample(simulator: Simulator, limit: int, reason: str, stopped: Event) -> JsonObject:
    """Return what sampled random walks tell about a level with too many states for a table."""
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


def describe(data: JsonObject) -> str:
    """Return the results in one sentence.

    >>> describe({"shortest": 14, "limit": 120, "randomWalk": 5e-6, "optimal": 0.87, "states": 1200})
    'Solvable in 14 steps. A random walk succeeds with probability 5e-06 in 120 steps. Best return 0.87; 1,200 states.'
    """
    plan, limit = data["shortest"], data["limit"]
    if plan is None:
        solved = "It cannot be solved"
    else:
        solved = f"Solvable in {plan:.0f} step{'s' * (plan != 1)}"
        if plan > limit:
            solved += f", but an episode has only {limit} steps"
    walk = f"A random walk succeeds with probability {data['randomWalk']:.2g} in {limit} steps"
    best = data["optimal"]
    value = "not finite" if isinf(best) else f"{best:.4g}"
    return f"{solved}. {walk}. Best return {value}; {data['states']:,} states."


def certificate_of_member(values: Any) -> JsonObject | None:
    """Return the certificate that `envgraph verify` stored for a member of a run; None if there is none."""
    if not values:
        return None
    plan, walk = values.get("shortest_plan"), values.get("random_success")
    exact = "sampled_episodes" not in values
    data: JsonObject = {
        "solvable": plan is not None if exact else None,
        "shortest": plan if exact else values.get("plan_found"),
        "optimal": values.get("optimal_return"),
        "randomWalk": walk if exact else values.get("sampled_success"),
        "states": None,
        "limit": values.get("limit"),
    }
    parts = ["not solvable" if exact and plan is None else f"solvable in {data['shortest']:.0f} steps"]
    if data["shortest"] is None and not exact:
        parts = ["no plan was found"]
    if data["randomWalk"] is not None:
        parts.append(f"a random walk succeeds with probability {data['randomWalk']:.2g}" + " (sampled)" * (not exact))
    text = ", ".join(parts)
    return {**data, "text": f"{text[0].upper()}{text[1:]}."}
