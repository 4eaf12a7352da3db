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
from envgraph.search._run_store import Trace
from envgraph.search.curricula._model_levels import LevelFactory
from envgraph.solve import softened_policy
from envgraph.solve.learning import renumber_occurring

EPISODES_TO_PLAY: Final = 6
"""Number of optimal episodes that are played on the target."""

FactColumns = list[list[object]]


@dataclass(frozen=True, slots=True, eq=False)
class OptimalEpisode:
    """An optimal episode on the target.

    Attributes:
        touched_objects: ids of the objects whose links or values change during the episode, and of the objects that
            they link to, in the order of the episode.
        state_traces: the rules that are applied from each state to the next, without the last step. Empty if the
            episode was not played, or does not end in success.
    """

    touched_objects: list[int]
    state_traces: tuple[Trace, ...]


def optimal_episodes(levels: LevelFactory, rng: Generator, *, needs_states: bool) -> list[OptimalEpisode]:
    """Return sampled optimal episodes of the target; only the shortest plan if a transition table would be too large.

    If the behaviour then cannot be compiled, the only episode is empty. The engine is left in an arbitrary state.

    Args:
        levels: provides the target and the engine.
        rng: samples the episodes.
        needs_states: True if `OptimalEpisode.states` are needed. Without a table the plan is played only for them.
    """
    try:
        table = levels.target.tabular
    except TooManyStates:
        return [_planned_episode(levels, rng, needs_states)]
    (small,) = renumber_occurring([table])
    policy = dict(zip(table.observation.tolist(), softened_policy(small, 0.0)[small.observation], strict=True))
    limit = levels.behaviour.limit or table.n_states

    def act(seen: int) -> int:
        return int(rng.choice(len(policy[seen]), p=policy[seen]))

    return [_play_episode(levels, act, limit, rng) for _ in range(EPISODES_TO_PLAY)]


def _planned_episode(levels: LevelFactory, rng: Generator, needs_states: bool) -> OptimalEpisode:
    """Return the episode of the target's shortest plan; an empty episode if the behaviour cannot be compiled.

    `touched` assumes that all stochastic outcomes are those of the plan. The plan is played only if `needs_states` is
    True.
    """
    levels.check_out(levels.target.version)
    plans = Plans(levels.behaviour)
    try:
        facts = [_fact_columns(levels) for _ in plans.episode(levels.engine)]
        touched = _touched_objects(levels, facts)
    except NotCompiled:
        return OptimalEpisode([], ())
    if not needs_states:
        return OptimalEpisode(touched, ())
    levels.check_out(levels.target.version)
    actions = plans.plan(levels.engine).actions
    numbers = Simulator(levels.engine, levels.behaviour, levels.keys).action_names
    left = iter([numbers.index(name) for name in actions])
    return OptimalEpisode(touched, _play_episode(levels, lambda seen: next(left), len(actions), rng).state_traces)


def _play_episode(
    levels: LevelFactory, choose_action: Callable[[int], int], limit: int, rng: Generator
) -> OptimalEpisode:
    """Play an episode of at most `limit` steps on the target and return it. `choose_action` maps an observation to an
    action.
    """
    levels.check_out(levels.target.version)
    engine, recorded, lengths, ended = levels.engine, Recorded(), list[int](), 0
    simulator = Simulator(engine, levels.behaviour, levels.keys)
    with engine.history.recording_to(recorded), closing(simulator):
        seen = simulator.reset(rng)
        facts = [_fact_columns(levels)]
        for _ in range(limit):
            outcome = simulator.step(choose_action(seen), rng)
            seen = outcome.observation
            facts.append(_fact_columns(levels))
            if outcome.terminated:
                ended = outcome.terminated
                break
            lengths.append(len(recorded))
        parts = [tuple(recorded[before:after]) for before, after in pairwise([0, *lengths])]
    return OptimalEpisode(_touched_objects(levels, facts), tuple(filter(None, parts)) if ended == 1 else ())


def _touched_objects(levels: LevelFactory, states: list[FactColumns]) -> list[int]:
    """Return the ids of the objects that change between the states, and of their linked objects, if they exist now."""
    found = dict[int, None]()
    for before, after in pairwise(states):
        for old, new in zip(before, after, strict=True):
            for node, (one, other) in enumerate(zip(old, new, strict=False)):
                if one != other:
                    found |= dict.fromkeys((node, *_objects_in(one), *_objects_in(other)))
    return [node for node in found if levels.engine.model.graph.alive(node)]


def _fact_columns(levels: LevelFactory) -> FactColumns:
    """Return the links and attribute values of all objects: a column per reference, then a column per attribute."""
    store = levels.engine.model.graph.store
    links: list[list[object]] = [[tuple(targets) for targets in column] for column in store.forward]
    values: list[list[object]] = [
        [(*value,) if isinstance(value, list) else (value,) for value in column] for column in store.values
    ]
    return links + values


def _objects_in(fact: object) -> Iterator[int]:
    return (one for one in fact if type(one) is int) if isinstance(fact, tuple) else iter(())
