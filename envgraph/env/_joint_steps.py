"""The step of one agent or of agents that act together, and the observation of a policy that controls all of them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import product
from math import prod

from envgraph.behaviour import Behaviour, Effect, KeyIndex, RuleCall
from envgraph.env._agent_order import AgentOrder, PreparedAgent
from envgraph.env._observation_components import combined_component_names
from envgraph.env._prepared_behaviour import PreparedBehaviour
from envgraph.env._prepared_clauses import (
    ChoiceSource,
    NameValues,
    ObservationComponent,
    PendingMatch,
    PreparedEachStep,
    PreparedOnFind,
    PreparedOnRefused,
    Reward,
    run_pending,
)
from envgraph.errors import LIMITS, Diagnostic, EvaluationError, InvalidArgument, ResolutionError
from envgraph.graph import Model

_Clause = tuple[PreparedOnFind | None, Reward | None, NameValues, list[int]]
"""A clause of a step: its condition, or None, its reward, the values of names, and the sums that it is added to."""


class AgentStepper:
    """A stepper for the agents that act in the same step: all of them together, or the one whose turn it is.

    An action is a number whose digits are the actions of the agents; the first agent's action varies fastest.

    Args:
        agents: all agents of the model.
        acting: the agents that act in the step, in this order.
        model: the state.

    Attributes:
        acting: see above.
        n_actions: the number of actions.
        has_acted: see `Simulator`.
        ended_by: the clauses with a match in the last step that end the episode, once for each match.
        paid: the functions that computed the rewards of the last step, each with its reward, once for each match.
    """

    def __init__(self, agents: AgentOrder, acting: Sequence[PreparedAgent], model: Model) -> None:
        self._agents, self.acting, self._model = agents, acting, model
        self._weights = [len(agents.action_names) ** place for place in range(len(acting) + 1)]
        self.n_actions = self._weights[-1]
        self.has_acted = False
        self.paid: list[tuple[Reward, float]] = []
        self.ended_by: list[PreparedOnFind | PreparedOnRefused] = []
        self._sums = [0.0] * len(acting)
        written, programs = [], [agent.behaviour for agent in acting]
        for each in programs:
            written.append([*zip((one for one, _ in each.effect_clauses), each.is_shared_effect, strict=True)])
        self._effects = [
            (number, programs[number].is_shared_effect[place], programs[number].effects[place])
            for number, place in order_effects(written)
        ]
        self._arrange([*range(len(acting))])

    def _arrange(self, present: Sequence[int]) -> None:
        """Prepare the steps in which these agents are present: their effects, and the sums to which rewards are added.

        The sums of a step are the rewards of all agents, and then those of all but the first without shared rewards.
        """
        agents = len(self.acting)
        effects = [(number, shared, one) for number, shared, one in self._effects if shared or number in present]
        self._present = present
        self._accounts = [[place, agents + place][: 1 + (place not in present[:1])] for place in range(agents)]
        self._counted = [self._accounts[place][-1] for place in present] or [agents]
        self._clauses: list[_Clause] = []
        self._applied = []
        self._on_refused: list[tuple[PreparedOnRefused, NameValues, list[int], list[list[RuleCall]]]] = []
        for number, shared, effect in effects:
            bound = self.acting[number].behaviour.bound_values
            if isinstance(effect, PreparedEachStep) and effect.apply is not None:
                self._applied.append((effect.apply, bound))
            condition = effect if isinstance(effect, PreparedOnFind) else None
            paid = [*present] or [agents] if shared else self._accounts[number]
            if isinstance(effect, PreparedOnRefused):
                calls = [agent.behaviour.refusals for agent in (self.acting if shared else [self.acting[number]])]
                about = [one for each in calls for is_shared, one in each.items() if shared or not is_shared]
                self._on_refused.append((effect, bound, paid, about))
            reward = None if isinstance(effect, PreparedOnRefused) else effect.reward
            self._clauses.append((condition, reward, bound, paid))
        self._places = [
            [place for place, (owner, shared, _) in enumerate(effects) if shared or owner == number] + [len(effects)]
            for number in range(agents)
        ]

    @property
    def rewards(self) -> tuple[float, ...]:
        """Return the reward of each agent in the last step; 0.0 for agents that did not exist."""
        return tuple(self._sums[: len(self.acting)])

    def joint_action(self, actions: Sequence[int]) -> int:
        """Return the number of the joint action that consists of these actions, one for each agent."""
        return sum(action * weight for action, weight in zip(actions, self._weights, strict=False))

    def step(self, number: int, choices: ChoiceSource) -> tuple[float, int]:
        """Do an action, except for missing agents; return total reward and end, and set `rewards`.

        The total counts each shared reward once, also if no agent exists.
        """
        if not 0 <= number < self.n_actions:
            raise InvalidArgument(f"action {number} is not in 0..{self.n_actions - 1}")
        if self._agents.together:
            present = [place for place, agent in enumerate(self.acting) if self._agents.can_act(agent)]
            if present != self._present:
                self._arrange(present)
        clauses = self._act(number, choices)
        for apply, bound in self._applied:
            apply.run(bound, choices, self._model)
        self._sums = sums = [0.0] * 2 * len(self.acting)
        ends, total = [0], 0.0
        self.ended_by, self.paid = [], []
        pending: list[PendingMatch] = []
        for effect, reward, scope, accounts in clauses:
            for row in ((),) if effect is None else effect.matches():
                if reward is not None:
                    gain = reward(effect.match_scope(scope, row) if effect and row else scope)
                    self.paid.append((reward, gain))
                    for account in accounts:
                        sums[account] += gain
                if effect is not None:
                    if effect.end:
                        ends.append(effect.end)
                        self.ended_by.append(effect)
                    if effect.apply is not None:
                        pending.append((scope, effect, row))
        if pending:
            run_pending(pending, choices, self._model)
        for refused, scope, accounts, refusals in self._on_refused:
            if any(refusals):
                if refused.end:
                    ends.append(refused.end)
                    self.ended_by.append(refused)
                if refused.reward is not None:
                    gain = refused.reward(scope)
                    self.paid.append((refused.reward, gain))
                    for account in accounts:
                        sums[account] += gain
        for account in self._counted:
            total += sums[account]
        # Failure takes precedence over success, success over truncation, and truncation over no end.
        return total, max(ends) or min(ends)

    def _act(self, number: int, choices: ChoiceSource) -> list[_Clause]:
        """Do the actions of all agents; return the clauses of the step, among them the rewards of these actions."""
        self.has_acted = self._agents.together
        moves: list[tuple[int, int, Reward, NameValues]] = []
        for agent in self.acting:
            for calls in (agent.behaviour.calls_done, *agent.behaviour.refusals.values()):
                calls.clear()
        for place in self._present:
            agent = self.acting[place]
            action = agent.actions[number // self._weights[place] % self._weights[1]]
            scope = action.current_scope(agent.behaviour.bound_values)
            done = action.branches.run(scope, choices, self._model)
            if done is not None or agent.behaviour.refusals.get(False):
                self.has_acted = True
            reward = action.else_reward if done is None else action.reward
            if reward is not None:
                moves.append((self._places[place][action.effects_before], place, reward, done or scope))
        if not moves:
            return self._clauses
        moves.sort(reverse=True)
        clauses = self._clauses.copy()
        for position, place, reward, scope in moves:
            clauses.insert(position, (None, reward, scope, self._accounts[place]))
        return clauses


class JointStepper(AgentStepper):
    """A stepper of joint actions; the docstring of `Simulator` defines the step.

    Args:
        behaviour: a behaviour whose agents act together.
        agents: all agents of the family, which must exist in the model.
        model: the state.
        keys: the indices of objects over the family.

    Raises:
        ResolutionError: the model lacks an agent that another member of the family has.

    Attributes:
        shape: the sizes of the components that all agents observe: each agent's own ones, then the shared ones.
        observation_names: the names of these components: "left at", "right at", .. "parcel at".
    """

    def __init__(self, behaviour: Behaviour, agents: AgentOrder, model: Model, keys: KeyIndex) -> None:
        check_all_agents_exist(behaviour, model, keys)
        super().__init__(agents, agents.prepared_agents, model)
        parts = [part for agent in self.acting for part in _own_or_shared_components(agent.behaviour, shared=False)]
        parts += _own_or_shared_components(self.acting[0].behaviour, shared=True)
        self.observation_names = combined_component_names(
            behaviour, keys, [(agent.name, agent.block) for agent in self.acting]
        )
        self.shape = tuple(part.size for part in parts)
        self._component_readers = [(part.read, prod(self.shape[:place])) for place, part in enumerate(parts)]

    @cached_property
    def action_names(self) -> tuple[str, ...]:
        """Return the names of the joint actions: "left: lift, right: wait".

        Raises:
            EvaluationError: the number of joint actions is too large.
        """
        return joint_action_names([agent.name for agent in self.acting], self._agents.action_names)

    def observation_index(self) -> int:
        """Return the index of the combined observation of all agents in the current state."""
        return sum(read() * weight for read, weight in self._component_readers)


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
            f"agents that act together must exist in every member of a family; this one has no `{agent.cls}` "
            + ", ".join(map(str, key)),
            agent.cls_span or agent.span,
            "remove `together`, so that agents take turns, or remove rules that create or delete agents",
        )
        for agent in behaviour.agents
        for key, node in zip(keys.keys_of(agent.cls), keys.objects(model, agent.cls), strict=True)
        if node is None
    ]
    if problems:
        raise ResolutionError(problems)
