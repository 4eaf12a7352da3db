"""The step of agents that act simultaneously, and the observation of a policy that controls all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property, reduce
from itertools import chain, product
from math import prod
from operator import add

from envgraph.behaviour import Behaviour, Effect, KeyIndex
from envgraph.code import dataclass
from envgraph.env._agent_order import AgentOrder, PreparedAgent
from envgraph.env._observation_components import combined_component_names
from envgraph.env._prepared_behaviour import PreparedBehaviour, dominant_end
from envgraph.env._prepared_clauses import (
    ChoiceSource,
    ObservationComponent,
    PendingMatch,
    PreparedEachStep,
    PreparedOnFind,
    run_pending,
)
from envgraph.errors import LIMITS, Diagnostic, EvaluationError, ResolutionError
from envgraph.graph import Model


@dataclass(frozen=True, slots=True)
class PreparedEffect:
    """A prepared effect for one agent.

    Attributes:
        agent: the number of the agent; 0 for shared effects.
        is_shared: True if the effect stands outside of `agent` blocks.
    """

    agent: int
    is_shared: bool
    behaviour: PreparedBehaviour
    effect: PreparedEachStep | PreparedOnFind


@dataclass(frozen=True, slots=True)
class ActionReward:
    """The reward of one agent's action, and how many of the agent's clauses precede the action in the file."""

    agent: int
    reward: float
    effects_before: int


class JointStepper:
    """A stepper of joint actions; the docstring of `Simulator` defines the step.

    A joint action is a number whose digits are the agents' actions; the first agent's action varies fastest.

    Args:
        behaviour: a behaviour whose agents act together.
        agents: all agents of the family, which must exist in the model.
        model: the state.
        keys: the indices of objects over the family.

    Raises:
        ResolutionError: the model lacks an agent that another member of the family has.

    Attributes:
        rewards: the reward of each agent in the last step; 0.0 for agents that did not exist.
        shape: the sizes of the components that all agents observe: each agent's own ones, then the shared ones.
        observation_names: the names of these components: "left at", "right at", .. "parcel at".
    """

    def __init__(self, behaviour: Behaviour, agents: AgentOrder, model: Model, keys: KeyIndex) -> None:
        check_all_agents_exist(behaviour, model, keys)
        self._agents, self._model = agents, model
        self._prepared_agents: Sequence[PreparedAgent] = agents.prepared_agents
        self._clauses = _ordered_effects(agents.prepared_agents)
        self.rewards = (0.0,) * len(agents.prepared_agents)
        parts = [
            part for seat in agents.prepared_agents for part in _own_or_shared_components(seat.behaviour, shared=False)
        ]
        parts += _own_or_shared_components(agents.prepared_agents[0].behaviour, shared=True)
        self.observation_names = combined_component_names(
            behaviour, keys, [(seat.name, seat.block) for seat in agents.prepared_agents]
        )
        self.shape = tuple(part.size for part in parts)
        self._component_readers = [(part.read, prod(self.shape[:place])) for place, part in enumerate(parts)]

    @property
    def n_actions(self) -> int:
        """Return the number of joint actions."""
        return int(len(self._agents.action_names) ** len(self._prepared_agents))

    @cached_property
    def action_names(self) -> tuple[str, ...]:
        """Return the names of the joint actions: "left: lift, right: wait".

        Raises:
            EvaluationError: the number of joint actions is too large.
        """
        return joint_action_names([seat.name for seat in self._prepared_agents], self._agents.action_names)

    def split_joint_action(self, number: int) -> list[int]:
        """Return the number of each agent's action in the joint action with this number."""
        found, base = [], len(self._agents.action_names)
        for _ in self._prepared_agents:
            number, digit = divmod(number, base)
            found.append(digit)
        return found

    def joint_action(self, actions: Sequence[int]) -> int:
        """Return the number of the joint action that consists of these actions, one for each agent."""
        base = len(self._agents.action_names)
        return sum(action * base**place for place, action in enumerate(actions))

    def observation_index(self) -> int:
        """Return the index of the combined observation of all agents in the current state."""
        return sum(read() * weight for read, weight in self._component_readers)

    def step(self, number: int, choices: ChoiceSource) -> tuple[float, int]:
        """Do a joint action except for missing agents; return total reward and end, and set `rewards` by agent."""
        there = [self._agents.can_act(seat) for seat in self._prepared_agents]
        clauses = [clause for clause in self._clauses if clause.is_shared or there[clause.agent]]
        for seat in self._prepared_agents:
            seat.behaviour.calls_done.clear()
        done = [
            self._do_action(place, action, choices)
            for place, action in enumerate(self.split_joint_action(number))
            if there[place]
        ]
        for clause in clauses:
            if isinstance(clause.effect, PreparedEachStep) and clause.effect.apply is not None:
                clause.effect.apply.run(clause.behaviour.bound_values, choices, self._model)
        pending: list[PendingMatch] = []
        judged = [(clause, *_evaluate_effect(clause, pending)) for clause in clauses]
        moves = [move() for move in done]
        gained = [(clause, gains) for clause, gains, _ in judged]
        paid = {move.agent: _agent_reward(move, gained, common=True) for move in moves}
        self.rewards = tuple(paid.get(place, 0.0) for place in range(len(self._prepared_agents)))
        run_pending(pending, choices, self._model)
        return _joint_reward(moves, paid, gained), reduce(dominant_end, (ends for *_, ends in judged), 0)

    def _do_action(self, place: int, number: int, choices: ChoiceSource) -> Callable[[], ActionReward]:
        """Do one agent's action; return a callback that evaluates its reward later, after all agents have acted."""
        program, action = self._prepared_agents[place].behaviour, self._prepared_agents[place].actions[number]
        scope = action.current_scope(program.bound_values)
        done = action.branches.run(scope, choices, self._model)
        reward = action.else_reward if done is None else action.reward
        return lambda: ActionReward(
            place, reward(scope if done is None else done) if reward else 0.0, action.effects_before
        )


def _evaluate_effect(clause: PreparedEffect, pending: list[PendingMatch]) -> tuple[list[float], int]:
    """Return the rewards and the end of a clause in the current state; append matches to apply to `pending`."""
    effect, bound = clause.effect, clause.behaviour.bound_values
    if isinstance(effect, PreparedEachStep):
        return [effect.reward(bound)] if effect.reward else [], 0
    rows = effect.matches()
    if effect.apply is not None:
        pending += [(bound, effect, row) for row in rows]
    gains = [effect.reward(effect.match_scope(bound, row)) for row in rows] if effect.reward else []
    return gains, effect.end if rows else 0


def _agent_reward(
    move: ActionReward, rewards_of_effects: Sequence[tuple[PreparedEffect, list[float]]], *, common: bool
) -> float:
    """Return the reward of one agent, summed in the order of the text, with shared rewards if `common`."""
    parts = [
        gains if common or not clause.is_shared else []
        for clause, gains in rewards_of_effects
        if clause.is_shared or clause.agent == move.agent
    ]
    parts.insert(move.effects_before, [move.reward])
    return reduce(add, chain.from_iterable(parts), 0.0)  # `sum` rounds differently from Python 3.12 on


def _joint_reward(
    moves: Sequence[ActionReward],
    paid: dict[int, float],
    rewards_of_effects: Sequence[tuple[PreparedEffect, list[float]]],
) -> float:
    """Return the reward of all agents, in which each shared reward is counted once, also if no agent exists."""
    if not moves:
        return reduce(add, chain.from_iterable(gains for _, gains in rewards_of_effects), 0.0)
    return reduce(
        add,
        (_agent_reward(move, rewards_of_effects, common=False) for move in moves[1:]),
        paid[moves[0].agent],
    )


def _ordered_effects(seats: Sequence[PreparedAgent]) -> tuple[PreparedEffect, ...]:
    """Return the prepared effects of all agents, in the order of the text."""
    found = []
    written = [
        [
            *zip(
                (effect for effect, _ in seat.behaviour.effect_clauses),
                seat.behaviour.is_shared_effect,
                strict=True,
            )
        ]
        for seat in seats
    ]
    for number, place in order_effects(written):
        program = seats[number].behaviour
        found.append(PreparedEffect(number, program.is_shared_effect[place], program, program.effects[place]))
    return tuple(found)


def order_effects(effects_of_agents: Sequence[Sequence[tuple[Effect, bool]]]) -> list[tuple[int, int]]:
    """Order the effects of all agents by the text: a block's effect once for each of its agents, a shared one once.

    Args:
        effects_of_agents: for each agent its effects, each with True if it is shared.

    Returns:
        Pairs of the agent's number and the position of the effect among the agent's effects.
    """
    found = [
        (effect.span.start if effect.span is not None else int(shared), number, place)
        for number, own in enumerate(effects_of_agents)
        for place, (effect, shared) in enumerate(own)
        if not (shared and number)
    ]
    return [(number, place) for _, number, place in sorted(found)]


def joint_action_names(agents: Sequence[str], actions: Sequence[str]) -> tuple[str, ...]:
    """Return the names of all joint actions; the action of the first agent varies fastest.

    Raises:
        EvaluationError: the number of joint actions is too large.
    """
    count = len(actions) ** len(agents)
    if count > LIMITS["actions"]:
        message = f"{count:,} joint actions of all agents, but at most {LIMITS['actions']:,} are possible"
        raise EvaluationError(message, None, "use `envgraph.make_parallel`, which takes one action for each agent")
    each = [[f"{agent}: {action}" for action in actions] for agent in reversed(agents)]
    return tuple(", ".join(reversed(chosen)) for chosen in product(*each))


def _own_or_shared_components(program: PreparedBehaviour, shared: bool) -> list[ObservationComponent]:
    flags = zip(program.components, program.is_shared_component, strict=True)
    return [part for part, is_shared in flags if is_shared == shared]


def check_all_agents_exist(behaviour: Behaviour, model: Model, keys: KeyIndex) -> None:
    """Raise ResolutionError if a member lacks an agent of its family; joint actions must mean the same in all."""
    problems = [
        Diagnostic(
            "missing-agent",
            f"agents that act together must exist in every member of a family; this one has no `{agent.cls}` {shown}",
            agent.cls_span or agent.span,
            "remove `together`, so that agents take turns, or remove rules that create or delete agents",
        )
        for agent in behaviour.agents
        for shown in _missing_agent_keys(agent.cls, model, keys)
    ]
    if problems:
        raise ResolutionError(problems)


def _missing_agent_keys(cls: str, model: Model, keys: KeyIndex) -> Iterator[str]:
    for key, node in zip(keys.keys_of(cls), keys.objects(model, cls), strict=True):
        if node is None:
            yield ", ".join(map(str, key))
