"""The agents of a behaviour in one model, and the order of their turns."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from math import prod

from envgraph.behaviour import Agent, Behaviour, KeyIndex, expand_action, key_attributes, unbound_names
from envgraph.code import dataclass
from envgraph.env._observation_components import component_sizes, merge_sizes
from envgraph.env._prepared_behaviour import PreparedBehaviour
from envgraph.env._prepared_clauses import PreparedAction, PreparedBranches, merge_clauses
from envgraph.errors import ResolutionError
from envgraph.graph import Model
from envgraph.rewrite import Engine


@dataclass(frozen=True, slots=True)
class PreparedAgent:
    """An agent of a model, with the behaviour prepared for this agent.

    Attributes:
        name: the agent's unique name, made of the key of its object; "" for a behaviour without `agent` blocks.
        node: the agent's object; None for a behaviour without `agent` blocks.
        block: the number of the agent's `agent` block.
        actions: one entry for each action of the environment; actions that the agent lacks do nothing.
        components: for each component of the agent's observation, a function that returns its value, and the factor of
            the value in the index of the observation.
    """

    name: str
    node: int | None
    block: int
    behaviour: PreparedBehaviour
    actions: tuple[PreparedAction, ...]
    components: tuple[tuple[Callable[[], int], int], ...]


class AgentOrder:
    """The agents of one model in the order of their turns: block by block, within a block by object index.

    An agent whose object is deleted, or no longer of the class, is skipped.

    Args:
        behaviour: a behaviour without errors.
        engine: an engine whose model is the initial state.
        keys: the indices of objects over the family.

    Raises:
        ResolutionError: a parameter cannot be bound to an object, or no `agent` block has an object.

    Attributes:
        prepared_agents: the agents.
        together: True if they act in the same step.
        action_names: the names of all actions; an action number means the same name for every agent of the family.
        shape: for each component of an observation, the maximum number of values over all blocks. With several `agent`
            blocks, the first component is the block number of the agent whose turn it is.
        block_sizes: the numbers of values of each block; see `merge_sizes`.
    """

    def __init__(self, behaviour: Behaviour, engine: Engine, keys: KeyIndex) -> None:
        self._model: Model = engine.model
        programs = list(_prepare_agents(behaviour, engine, keys))
        if not programs:
            raise ResolutionError(unbound_names(behaviour, engine.model))
        self._classes = tuple(agent.cls for agent in behaviour.agents)
        self.together = behaviour.together
        shared = {parameter.name: parameter.type or "" for parameter in behaviour.parameters}
        names: dict[str, None] = {}
        self.block_sizes: list[list[int]] = []
        for block in behaviour.agents or (Agent("", ""),):
            own = {**shared, block.variable: block.cls}
            for action, _ in merge_clauses(block.actions, own, behaviour.actions, shared):
                names.update((name, None) for name, _ in expand_action(action, keys, engine.model.metamodel))
            seen = merge_clauses(block.observations, own, behaviour.observations, shared)
            self.block_sizes.append(component_sizes(seen, keys, engine.model.metamodel, behaviour))
        self.action_names = tuple(names)
        lead = (len(behaviour.agents),) if len(behaviour.agents) > 1 else ()
        self.shape = (*lead, *merge_sizes(self.block_sizes, mixed=self.together))
        weights = [prod(self.shape[:place]) for place in range(len(lead), len(self.shape))]
        self.prepared_agents = tuple(
            PreparedAgent(
                name,
                node,
                block,
                program,
                _fill_actions(program.actions, self.action_names),
                tuple((part.read, weight) for part, weight in zip(program.components, weights, strict=False)),
            )
            for name, node, block, program in programs
        )

    def can_act(self, seat: PreparedAgent) -> bool:
        """Return True if the agent has no object, or if its object exists and still has the agent's class."""
        if seat.node is None:
            return True
        model = self._model
        return model.graph.alive(seat.node) and model.metamodel.is_a(
            model.graph.class_of(seat.node), self._classes[seat.block]
        )

    def is_deleted(self, number: int) -> bool:
        """Return True if the object of an agent was deleted, so that the agent cannot act again."""
        node = self.prepared_agents[number].node
        return node is not None and not self._model.graph.alive(node)

    def next_turn(self, turn: int) -> int:
        """Return the number of the next agent after `turn` that can act; if no other agent can, `turn` (0 for -1).

        `after(-1)` is the first agent. Return 0 if agents act simultaneously, or if the behaviour has no `agent` block.
        """
        if self.together or len(self.prepared_agents) == 1:
            return 0
        count = len(self.prepared_agents)
        for step in range(1, count + 1):
            number = (turn + step) % count
            if self.can_act(self.prepared_agents[number]):
                return number
        return max(turn, 0)

    def observation_index(self, turn: int) -> int:
        """Return the index of an agent's current observation; components that start at a deleted object are padded."""
        seat = self.prepared_agents[turn]
        index = seat.block if len(self._classes) > 1 else 0
        for read, weight in seat.components:
            index += read() * weight
        return index


def _prepare_agents(
    behaviour: Behaviour, engine: Engine, keys: KeyIndex
) -> Iterator[tuple[str, int | None, int, PreparedBehaviour]]:
    if not behaviour.agents:
        yield "", None, 0, PreparedBehaviour(behaviour, engine, keys)
    for name, (node, block) in named_agents(behaviour, engine.model, keys):
        yield name, node, block, PreparedBehaviour(behaviour, engine, keys, (behaviour.agents[block], node))


def named_agents(behaviour: Behaviour, model: Model, keys: KeyIndex) -> list[tuple[str, tuple[int, int]]]:
    """Return the name, object and block number of each agent of a model, in the order of turns.

    Names that several agents share get the variable of their `agent` block as a prefix.
    """
    found = [
        (name, agent.variable, node, block)
        for block, agent in enumerate(behaviour.agents)
        for name, node in _agents_of_block(model, agent, keys)
    ]
    often = Counter(name for name, _, _, _ in found)
    return [
        (name if often[name] == 1 else f"{variable} {name}", (node, block)) for name, variable, node, block in found
    ]


def _agents_of_block(model: Model, agent: Agent, keys: KeyIndex) -> list[tuple[str, int]]:
    """Return the name (key, or variable and index) and object of each existing agent of a block, ordered by index."""
    has_key = bool(key_attributes(model.metamodel, agent.cls))
    objects = zip(keys.keys_of(agent.cls), keys.objects(model, agent.cls), strict=True)
    return [
        (", ".join(map(str, key)) if has_key else f"{agent.variable} {position}", node)
        for position, (key, node) in enumerate(objects)
        if node is not None
    ]


def _fill_actions(actions: Sequence[PreparedAction], names: Sequence[str]) -> tuple[PreparedAction, ...]:
    found = {action.name: action for action in actions}
    does_nothing = PreparedBranches(lambda _: (), ())
    return tuple(found.get(name) or PreparedAction(name, (), does_nothing, None, None, 0) for name in names)
