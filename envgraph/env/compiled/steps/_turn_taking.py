"""Emit the step of behaviours whose agents take turns, or that have a single agent without an object."""

from __future__ import annotations

from collections.abc import Sequence

from envgraph import code
from envgraph.env._observation_components import component_names, component_sizes, merge_sizes
from envgraph.env.compiled.layout._program_layout import (
    NOBODY,
    ONE,
    TURN,
    ZERO,
    emit_call,
    emit_state_entry,
    emit_sum,
)
from envgraph.env.compiled.steps._clause_code import FunctionEmitter
from envgraph.env.compiled.steps._clause_terms import ACTION, SELF, ClauseEmitter
from envgraph.env.compiled.steps._observation_code import COMPONENTS, ObservationEmitter
from envgraph.env.compiled.steps._step_code import (
    END_OF_STEP,
    HAS_ACTED,
    RETURN_NO_STEP,
    TOTAL_REWARD,
    AgentEffect,
    StepEmitter,
)


class TurnStepEmitter:
    """An emitter of the functions of a step in which one agent acts.

    Args:
        clauses: the clauses of the behaviour.

    Attributes:
        action_names: the names of the actions.
        shape, observation_names: the sizes and names of the observation's components. With several `agent` blocks, the
            first component is the block number of the agent whose turn it is.
    """

    def __init__(self, clauses: ClauseEmitter) -> None:
        self._clauses = clauses
        self.action_names = tuple(clauses.block_actions[0].names)
        keys, metamodel, behaviour = clauses.keys, clauses.metamodel, clauses.behaviour
        sizes = [component_sizes(clauses.observed(block), keys, metamodel, behaviour) for block in clauses.blocks]
        lead = (len(clauses.blocks),) if len(clauses.blocks) > 1 else ()
        self.shape: tuple[int, ...] = (*lead, *merge_sizes(sizes))
        self.observation_names = component_names(clauses.behaviour, clauses.keys, len(self.shape))

    def emit_bodies(self) -> tuple[code.Body, code.Body, code.Body]:
        """Return the bodies of three functions: do a step, test if an action would have an effect, and observe."""
        blocks = range(len(self._clauses.blocks))
        return (
            self._emit_dispatch([*map(self._emit_turn, blocks)], (ACTION,), RETURN_NO_STEP),
            self._emit_dispatch([*map(self._clauses.emit_action_test, blocks)], (ACTION,), code.Return(ZERO)),
            self._emit_dispatch([*map(self._emit_observe, blocks)], (COMPONENTS,), code.Return(ZERO)),
        )

    def emit_begin(self, writer: FunctionEmitter) -> None:
        """Emit code that gives the turn to the first agent whose object exists, or no code if all always exist."""
        agents = self._clauses.behaviour.agents
        if not all(self._clauses.changes.is_fixed_class(agent.cls) for agent in agents):
            self._emit_next_turn(writer, code.Operation("-", (self._clauses.agent_entry("count"), ONE)))

    def _emit_dispatch(
        self, functions: Sequence[str], arguments: tuple[code.Local, ...], nothing: code.Return
    ) -> code.Body:
        """Return code that calls the function of the `agent` block of the agent whose turn it is."""
        agents = self._clauses.behaviour.agents
        if not agents:
            return (code.Return(emit_call(functions[0], NOBODY, *arguments)),)
        turn, block = code.Local("turn", "int"), code.Local("block", "int")
        body: list[code.Statement] = [code.Assign(turn, emit_state_entry(TURN))]
        body.append(code.Assign(SELF, self._clauses.agent_entry("object", turn)))
        if len(agents) == 1:
            return (*body, code.Return(emit_call(functions[0], SELF, *arguments)))
        body.append(code.Assign(block, self._clauses.agent_entry("block", turn)))
        for number, function in enumerate(functions):
            called = code.Return(emit_call(function, SELF, *arguments))
            body.append(code.If(code.emit_equal(block, code.Constant(number)), (called,)))
        return (*body, nothing)

    def _emit_turn(self, block: int) -> str:
        clauses = self._clauses
        with clauses.module.emitting_function():
            writer, own = clauses.new_writer(RETURN_NO_STEP), clauses.blocks[block]
            player = clauses.player(writer, block, SELF, ACTION, TOTAL_REWARD)
            shared = {id(effect) for effect in clauses.behaviour.effects}
            effects = [AgentEffect(*each, 0, id(each[0]) in shared) for each in clauses.effects(own)]
            turn = StepEmitter(writer, [player], effects)
            turn.emit_step()
            clauses.emit_check_needed(writer, player.scope, turn.changed)
            if clauses.behaviour.agents:
                self._emit_next_turn(writer, emit_state_entry(TURN))
            clauses.emit_tidy(writer)
            writer.append(code.Return(code.emit_tuple(TOTAL_REWARD, END_OF_STEP, HAS_ACTED)))
            return clauses.module.add_function("turn", (SELF, ACTION), writer.all_statements())

    def _emit_observe(self, block: int) -> str:
        clauses, own = self._clauses, self._clauses.blocks[block]
        with clauses.module.emitting_function():
            writer = clauses.new_writer(code.Return(ZERO))
            observations = ObservationEmitter(writer, clauses.keys, self.shape, clauses.behaviour)
            if len(clauses.blocks) > 1:
                observations.emit_component(code.Constant(block))
            observations.emit_components(clauses.observed(own), clauses.scope(own)[0])
            observations.emit_end()
            return clauses.module.add_function("look", (SELF, COMPONENTS), writer.all_statements())

    def _emit_next_turn(self, writer: FunctionEmitter, turn: code.Expression) -> None:
        """Emit code that gives the turn to the next agent whose object exists; without such an agent it stays."""
        count, agents = self._clauses.agent_entry("count"), self._clauses.behaviour.agents
        if all(self._clauses.changes.is_fixed_class(agent.cls) for agent in agents):
            writer.append(code.Assign(emit_state_entry(TURN), code.Operation("%", (emit_sum(turn, 1), count))))
            return
        place, node = writer.module.new_local("turn"), writer.module.new_local("v", "object")
        there = [self._clauses.facts.emit_is_instance(node, agent.cls) for agent in agents]
        blocks = [
            code.emit_equal(self._clauses.agent_entry("block", place), code.Constant(block))
            for block in range(len(agents))
        ]
        tests = [code.Operation("and", pair) for pair in zip(blocks, there, strict=True)]
        each = (
            code.Assign(place, code.Operation("%", (emit_sum(place, 1), count))),
            code.Assign(node, self._clauses.agent_entry("object", place)),
            code.If(
                code.emit_joined("or", tests, False),
                (code.Assign(emit_state_entry(TURN), place), code.BreakOrContinue("break")),
            ),
        )
        writer.append_assignment(place, turn)
        writer.append(code.For(writer.module.new_local("_"), code.emit_call("range", count), each))
