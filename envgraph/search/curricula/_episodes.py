"""Optimal episodes on the target of a family: the objects that they touch, and the states that they visit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from itertools import pairwise
from typing import Final

from numpy.random import Generator

from envgraph.code import dataclass
from envgraph.env import Simulator, TooManyStates
from envgraph.env.compiled import NotCompiled, Plans
from envgraph.rewrite import Trace as Recorded
from envgraph.search._store import Trace
from envgraph.search.curricula._levels import Levels
from envgraph.solve import softened_policy
from envgraph.solve.learning import occurring

PLANS: Final = 6
"""Number of optimal episodes that are played on the target."""

Facts = list[list[object]]


@dataclass(frozen=True, slots=True, eq=False)
class Episode:
    """An optimal episode on the target.

    Attributes:
        touched: ids of the objects whose links or values change during the episode, and of the objects that they link
            to, in the order of the episode.
        states: the rules that are applied from each state to the next, without the last step. Empty if the episode was
            not played, or does not end in success.
    """

    touched: list[int]
    states: tuple[Trace, ...]


def optimal_episodes(levels: Levels, rng: Generator, *, states: bool) -> list[Episode]:
    """Return sampled optimal episodes of the target; only the shortest plan if a transition table would be too large.

    If the behaviour then cannot be compiled, the only episode is empty. The engine is left in an arbitrary state.

    Args:
        levels: provides the target and the engine.
        rng: samples the episodes.
        states: True if `Episode.states` are needed. Without a table the plan is played only for them.
    """
    try:
        table = levels.target.tabular
    except TooManyStates:
        return [_planned(levels, rng, states)]
    (small,) = occurring([table])
    policy = dict(
        zip(table.observation.tolist(), softened_policy(small, 0.0)[small.observation], strict=True)
    )
    limit = levels.behaviour.limit or table.n_states

    def act(seen: int) -> int:
        return int(rng.choice(len(policy[seen]), p=policy[seen]))

    return [_played(levels, act, limit, rng) for _ in range(PLANS)]


def _planned(levels: Levels, rng: Generator, states: bool) -> Episode:
    """Return the episode of the target's shortest plan; an empty episode if the behaviour cannot be compiled.

    `touched` assumes that all stochastic outcomes are those of the plan. The plan is played only if `states` is True.
    """
    levels.go_to(levels.target.version)
    plans = Plans(levels.behaviour)
    try:
        facts = [_facts(levels) for _ in plans.episode(levels.engine)]
        touched = _touched(levels, facts)
    except NotCompiled:
        return Episode([], ())
    if not states:
        return Episode(touched, ())
    levels.go_to(levels.target.version)
    actions = plans.plan(levels.engine).actions
    numbers = Simulator(levels.engine, levels.behaviour, levels.keys).action_names
    left = iter([numbers.index(name) for name in actions])
    return Episode(touched, _played(levels, lambda seen: next(left), len(actions), rng).states)


def _played(levels: Levels, act: Callable[[int], int], limit: int, rng: Generator) -> Episode:
    """Play an episode of at most `limit` steps on the target and return it. `act` maps an observation to an action."""
    levels.go_to(levels.target.version)
    engine, recorded, lengths, ended = levels.engine, Recorded(), list[int](), 0
    simulator = Simulator(engine, levels.behaviour, levels.keys)
    with engine.history.listing(recorded), closing(simulator):
        seen = simulator.reset(rng)
        facts = [_facts(levels)]
        for _ in range(limit):
            outcome = simulator.step(act(seen), rng)
            seen = outcome.observation
            facts.append(_facts(levels))
            if outcome.terminated:
                ended = outcome.terminated
                break
            lengths.append(len(recorded))
        parts = [tuple(recorded[before:after]) for before, after in pairwise([0, *lengths])]
    return Episode(_touched(levels, facts), tuple(filter(None, parts)) if ended == 1 else ())


def _touched(levels: Levels, states: list[Facts]) -> list[int]:
    """Return the ids of the objects that change between the states, and of their linked objects, if they exist now."""
    found = dict[int, None]()
    for before, after in pairwise(states):
        for old, new in zip(before, after, strict=True):
            for node, (one, other) in enumerate(zip(old, new, strict=False)):
                if one != other:
                    found |= dict.fromkeys((node, *_nodes(one), *_nodes(other)))
    return [node for node in found if levels.engine.model.graph.alive(node)]


def _facts(levels: Levels) -> Facts:
    """Return the links and attribute values of all objects: a column per reference, then a column per attribute."""
    store = levels.engine.model.graph.store
    links: list[list[object]] = [[tuple(targets) for targets in column] for column in store.forward]
    values: list[list[object]] = [
        [(*value,) if isinstance(value, list) else (value,) for value in column] for column in store.values
    ]
    return links + values


def _nodes(fact: object) -> Iterator[int]:
    return (one for one in fact if type(one) is int) if isinstance(fact, tuple) else iter(())
