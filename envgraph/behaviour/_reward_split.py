"""Split the rewards of a behaviour by the clauses that pay them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from envgraph.behaviour._behaviour import Action, Behaviour, EachStep, Effect, OnFind
from envgraph.errors import check_known
from envgraph.pattern import Negation, PatternCall


def reward_names(behaviour: Behaviour) -> tuple[str, ...]:
    """Return the names of the clauses that pay rewards, in the order of the file; clauses of the same name count once.

    An action has its own name, an `each step` clause is named "each step", an `on refused` clause "refused", and
    `on find p(..)` has the name of the pattern, after "neg" if it is negated.
    """
    own = [one for agent in behaviour.agents for one in (*agent.actions, *agent.effects)]
    return tuple(
        dict.fromkeys(clause_name(one) for one in (*behaviour.actions, *behaviour.effects, *own) if _has_reward(one))
    )


def with_only_reward(behaviour: Behaviour, name: str) -> Behaviour:
    """Return a copy of the behaviour with only the rewards of one name; transitions and episode ends are unchanged.

    Raises:
        InvalidArgument: no clause of this name pays a reward.
    """
    check_known(name, reward_names(behaviour), f"environment `{behaviour.name}` has no reward `{name}`")
    agents = tuple(
        replace(
            one,
            actions=_keep_action_rewards(one.actions, name),
            effects=_keep_effect_rewards(one.effects, name),
        )
        for one in behaviour.agents
    )
    return replace(
        behaviour,
        name=f"{behaviour.name} {name}",
        actions=_keep_action_rewards(behaviour.actions, name),
        effects=_keep_effect_rewards(behaviour.effects, name),
        agents=agents,
    )


def _keep_action_rewards(actions: Sequence[Action], name: str) -> tuple[Action, ...]:
    return tuple(one if one.name == name else replace(one, reward=None, else_reward=None) for one in actions)


def _keep_effect_rewards(effects: Sequence[Effect], name: str) -> tuple[Effect, ...]:
    return tuple(one if clause_name(one) == name else replace(one, reward=None) for one in effects)


def _has_reward(one: Action | Effect) -> bool:
    return one.reward is not None or (isinstance(one, Action) and one.else_reward is not None)


def clause_name(one: Action | Effect) -> str:
    """Return the name of a clause in infos; see `reward_names`."""
    if isinstance(one, Action):
        return one.name
    if not isinstance(one, OnFind):
        return "each step" if isinstance(one, EachStep) else "refused"
    condition = one.condition
    call = condition.relation if isinstance(condition, Negation) else condition
    assert isinstance(call, PatternCall)
    short = call.pattern.rpartition(".")[2]
    return f"neg {short}" if isinstance(condition, Negation) else short
