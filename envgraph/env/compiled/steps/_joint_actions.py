"""Emit the step of agents that act together: one joint action holds an action of each agent."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain

from envgraph import code
from envgraph.behaviour import Agent, Observation
from envgraph.env._joint_steps import joint_action_names, order_effects
from envgraph.env._observation_components import combined_component_names, component_sizes
from envgraph.env._prepared_clauses import NameClasses
from envgraph.env.compiled.layout._program_layout import ONE, ZERO, emit_call
from envgraph.env.compiled.steps._clause_code import FunctionEmitter
from envgraph.env.compiled.steps._clause_terms import ACTION, ClauseEmitter
from envgraph.env.compiled.steps._observation_code import COMPONENTS, ObservationEmitter
from envgraph.env.compiled.steps._step_code import (
    END_OF_STEP,
    RETURN_NO_STEP,
    TOTAL_REWARD,
    AgentEffect,
    StepEmitter,
)


class JointStepEmitter:
    """An emitter of a step in which all agents act; see the docstring of `Simulator`.

    Args:
        clauses: the clauses of the behaviour.
        seats: names of the agents, and the numbers of their blocks.

    Raises:
        EvaluationError: there are too many joint actions.

    Attributes:
        action_names: the names of the joint actions.
        shape, observation_names: sizes and names of the components of an observation: those of each agent, then the
            shared ones.
    """

    def __init__(self, clauses: ClauseEmitter, seats: Sequence[tuple[str, int]]) -> None:
        self._clauses, self._seats = clauses, seats
        self.action_names = joint_action_names([name for name, _ in seats], clauses.block_actions[0].names)
        own = [self._observations_of(clauses.blocks[number], shared=False) for _, number in seats]
        parts = [*chain(*own), *self._observations_of(clauses.blocks[0], shared=True)]
        self.shape = tuple(component_sizes(parts, clauses.keys, clauses.metamodel, clauses.behaviour))
        self.observation_names = combined_component_names(clauses.behaviour, clauses.keys, seats)

    def emit_bodies(self) -> tuple[code.Body, code.Body, code.Body]:
        """Return the bodies of three functions: a step, the test of an agent's action, and the observations."""
        return self._emit_step(), self._emit_agent_action_test(), self._emit_look()

    def emit_begin(self, writer: FunctionEmitter) -> None:
        """Do nothing: agents that act together have no first agent."""

    def _emit_step(self) -> code.Body:
        clauses, fresh = self._clauses, self._clauses.module.new_local
        with clauses.module.emitting_function():
            writer, players = clauses.new_writer(RETURN_NO_STEP), []
            for block, node, digit in self._emit_agent_actions(writer):
                there = self._emit_agent_exists(writer, node, block)
                players.append(clauses.player(writer, block, node, digit, fresh("total", "float"), there))
            turn = StepEmitter(writer, players, list(self._ordered_effects()))
            turn.emit_step()
            clauses.emit_check_needed(writer, players[0].scope, turn.changed)
            clauses.emit_tidy(writer)
            writer.append(code.Return(code.emit_tuple(TOTAL_REWARD, END_OF_STEP, ONE)))
            name = clauses.module.add_function("turn", (ACTION,), writer.all_statements())
        return (code.Return(emit_call(name, ACTION)),)

    def _emit_agent_action_test(self) -> code.Body:
        """Return the body of a test if an agent can do an action; an agent whose object is missing can do all.

        The number of the tested action is that of the agent times the number of actions, plus the agent's action.
        """
        clauses = self._clauses
        may = [*map(clauses.emit_action_test, range(len(clauses.blocks)))]
        names = code.Constant(len(clauses.block_actions[0].names))
        with clauses.module.emitting_function():
            writer = clauses.new_writer(code.Return(ONE))
            agent, own = (clauses.module.new_local(name) for name in ("agent", "a"))
            writer.append_assignment(agent, code.emit_call("quotient", ACTION, names))
            writer.append_assignment(own, code.Operation("%", (ACTION, names)))
            for place, (_, block) in enumerate(self._seats):
                node = self._emit_agent_object(writer, place)
                there = self._emit_agent_exists(writer, node, block)
                tests = [code.emit_equal(agent, code.Constant(place))]
                tests += [] if there is None else [code.emit_equal(there, ONE)]
                tested = code.Return(emit_call(may[block], node, own))
                writer.append(code.If(code.emit_joined("and", tests, True), (tested,)))
            writer.append(code.Return(ONE))
            name = clauses.module.add_function("may", (ACTION,), writer.all_statements())
        return (code.Return(emit_call(name, ACTION)),)

    def _emit_agent_actions(self, writer: FunctionEmitter) -> Iterator[tuple[int, code.Local, code.Local]]:
        """Emit assignments of each agent's object and of its own action, decoded from the number of the joint action.

        Yields the number of the agent's block, and the two variables.
        """
        left = self._clauses.module.new_local("left")
        names = code.Constant(len(self._clauses.block_actions[0].names))
        writer.append_assignment(left, ACTION)
        for place, (_, block) in enumerate(self._seats):
            node, digit = self._emit_agent_object(writer, place), self._clauses.module.new_local("a")
            writer.append_assignment(digit, code.Operation("%", (left, names)))
            writer.append_assignment(left, code.emit_call("quotient", left, names))
            yield block, node, digit

    def _emit_agent_object(self, writer: FunctionEmitter, place: int) -> code.Local:
        """Emit an assignment of the object of the agent at `place` among all agents, and return its variable."""
        node = self._clauses.module.new_local("self", "object")
        writer.append_assignment(node, self._clauses.agent_entry("object", code.Constant(place)))
        return node

    def _emit_agent_exists(self, writer: FunctionEmitter, node: code.Local, block: int) -> code.Local | None:
        """Emit a variable that is 1 if an agent's object exists; return None if it always exists."""
        cls = self._clauses.behaviour.agents[block].cls
        if self._clauses.changes.is_fixed_class(cls):
            return None
        there = self._clauses.module.new_local("there")
        writer.append_assignment(
            there, code.ConditionalExpression(self._clauses.facts.emit_is_instance(node, cls), ONE, ZERO)
        )
        return there

    def _ordered_effects(self) -> Iterator[AgentEffect]:
        effects = [self._clauses.effects(self._clauses.blocks[block]) for _, block in self._seats]
        ours = {id(effect) for effect in self._clauses.behaviour.effects}
        written = [[(effect, id(effect) in ours) for effect, _ in own] for own in effects]
        for number, place in order_effects(written):
            effect, types = effects[number][place]
            yield AgentEffect(effect, types, number, written[number][place][1])

    def _emit_look(self) -> code.Body:
        clauses = self._clauses
        with clauses.module.emitting_function():
            writer = clauses.new_writer(code.Return(ZERO))
            observations = ObservationEmitter(writer, clauses.keys, self.shape, clauses.behaviour)
            for place, (_, number) in enumerate(self._seats):
                block, node = clauses.blocks[number], self._emit_agent_object(writer, place)
                observations.emit_components(self._observations_of(block, shared=False), clauses.scope(block, node)[0])
            observations.emit_components(self._observations_of(clauses.blocks[0], shared=True), clauses.scope(None)[0])
            observations.emit_end()
            name = clauses.module.add_function("look", (COMPONENTS,), writer.all_statements())
        return (code.Return(emit_call(name, COMPONENTS)),)

    def _observations_of(self, block: Agent | None, *, shared: bool) -> list[tuple[Observation, NameClasses]]:
        """Return a block's own observation clauses, or if `shared`, the clauses that all blocks share."""
        ours = {id(observation) for observation in self._clauses.behaviour.observations}
        return [each for each in self._clauses.observed(block) if (id(each[0]) in ours) is shared]
