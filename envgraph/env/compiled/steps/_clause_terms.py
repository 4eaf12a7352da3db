"""Emit code for the clauses of a behaviour, and bind the names in them to values of the program."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import Literal

from envgraph import code
from envgraph.behaviour import (
    Action,
    Agent,
    Behaviour,
    Effect,
    KeyIndex,
    Observation,
    domain_type,
    expand_action,
    object_reads,
)
from envgraph.code import dataclass
from envgraph.env._prepared_behaviour import precedes_action
from envgraph.env._prepared_clauses import NameClasses, merge_clauses
from envgraph.env.compiled.layout._member_data import literal_ranks
from envgraph.env.compiled.layout._program_layout import (
    ONE,
    ZERO,
    Constants,
    L,
    emit_call,
    emit_entry,
    emit_sum,
    emit_table_entry,
)
from envgraph.env.compiled.layout._symbols import AgentTable, BoundParameter
from envgraph.env.compiled.matching._match_emitter import MatchEmitter
from envgraph.env.compiled.matching._term_code import CodeTerm, variable_term
from envgraph.env.compiled.steps._clause_code import FunctionEmitter
from envgraph.env.compiled.steps._step_code import END_OF_STEP, ActingAgent
from envgraph.metamodel import EnumType, Scalar
from envgraph.pattern import ObjectType, StaticType
from envgraph.rewrite import Engine

SELF, ACTION = code.Local("self", "object"), code.Local("a", "int")


@dataclass(frozen=True, slots=True)
class BlockAction:
    """An action of an agent block: its name, the number of its clause, and the values of its parameters."""

    name: str
    clause: int
    values: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class BlockActions:
    """The actions of the agents of one block.

    Attributes:
        block: number of the block.
        actions: the actions of the block.
        names: names of the actions of all blocks.
    """

    block: int
    actions: Sequence[BlockAction]
    names: Sequence[str]

    def action_table(self) -> tuple[tuple[int, ...], int]:
        """Return a flat table with a row for each action name, and the width of a row.

        A row holds the number of the action's clause (-1 if the block has no such action) and the parameters' values.
        """
        width = 1 + max((len(one.values) for one in self.actions), default=0)
        rows = {one.name: (one.clause, *one.values) for one in self.actions}
        padded = [(*(row := rows.get(name, (-1,))), *[0] * (width - len(row))) for name in self.names]
        return tuple(chain(*padded)), width


class ClauseEmitter:
    """An emitter of the code that clauses share, whether agents take turns or act together.

    Args:
        engine: has the patterns and rules.
        behaviour: resolved, without errors.
        keys: the indices of objects over the family.
        matching: emits functions that find matches.

    Attributes:
        blocks: the `agent` blocks; a single None for a behaviour without `agent` blocks.
        block_actions: the actions of the agents of each block.
    """

    def __init__(self, engine: Engine, behaviour: Behaviour, keys: KeyIndex, matching: MatchEmitter) -> None:
        self.engine = engine
        self.behaviour = behaviour
        self.keys = keys
        self.matching = matching
        self.facts, self.module = matching.facts, matching.module
        self.layout, self.changes = matching.facts.layout, matching.facts.changes
        self.metamodel = engine.model.metamodel
        self.blocks: Sequence[Agent | None] = behaviour.agents or (None,)
        numbered = [self._actions_of(block) for block in self.blocks]
        names = tuple(dict.fromkeys(one.name for each in numbered for one in each))
        self.block_actions = [BlockActions(number, own, names) for number, own in enumerate(numbered)]

    def new_writer(self, error_return: code.Return) -> FunctionEmitter:
        """Return a new emitter of the statements of a function, which ends with `error_return` after an error."""
        return FunctionEmitter(self.matching, self.engine, self.behaviour.name, error_return)

    def agent_entry(self, table: Literal["object", "block", "count"], turn: code.Expression = ZERO) -> code.Expression:
        """Return code for the object or block number of the agent with number `turn`, or for the number of agents."""
        return emit_table_entry(
            emit_sum(self.layout.offset(AgentTable(tuple(one.cls for one in self.behaviour.agents), table)), turn)
        )

    def scope(
        self, block: Agent | None, node: code.Local = SELF
    ) -> tuple[dict[str, CodeTerm], dict[str, str], dict[str, str]]:
        """Return the term of each name, and its class by name: in shared clauses, and in clauses of the block.

        Args:
            block: the agent's block; None for shared clauses only.
            node: variable for the agent's object.
        """
        scope, shared = {}, {}
        for parameter in self.behaviour.parameters:
            cls = shared[parameter.name] = parameter.type or ""
            bound = emit_table_entry(self.layout.offset(BoundParameter(parameter)))
            scope[parameter.name] = self._object_term(bound, cls)
        own = dict(shared)
        if block is not None:
            own[block.variable] = block.cls
            scope[block.variable] = self._object_term(node, block.cls)
        return scope, shared, own

    def _object_term(self, node: code.Expression, cls: str) -> CodeTerm:
        return variable_term(node, ObjectType(cls), cls if self.changes.is_fixed_class(cls) else None)

    def actions(self, block: Agent | None) -> list[Action]:
        _, shared, own = self.scope(block)
        actions = block.actions if block is not None else ()
        return [action for action, _ in merge_clauses(actions, own, self.behaviour.actions, shared)]

    # --- actions

    def _actions_of(self, block: Agent | None) -> list[BlockAction]:
        """Return every action of a block with each combination of its parameters' values, in order."""
        found = []
        for clause, action in enumerate(self.actions(block)):
            types = [domain_type(domain, self.metamodel) for _, domain in action.parameters]
            for name, values in expand_action(action, self.keys, self.metamodel):
                numbers = (
                    literal_ranks(type_)[str(value)] if isinstance(type_, EnumType) else int(value)
                    for type_, value in zip(types, values, strict=True)
                )
                found.append(BlockAction(name, clause, tuple(numbers)))
        return found

    def _load_parameters(self, writer: FunctionEmitter, action: Action, first: code.Expression) -> dict[str, CodeTerm]:
        """Emit code that reads an action's parameters from its table row, at index `first`. Return their terms."""
        scope = {}
        for place, (name, domain) in enumerate(action.parameters, 1):
            type_: StaticType = domain_type(domain, self.metamodel) or Scalar.INT
            number: code.Expression = emit_entry(L, emit_sum(first, place))
            if isinstance(type_, ObjectType):
                local = writer.emit_object_at_index(self.keys, type_.cls, number)
                present = (code.Operation(">=", (local, ZERO)),)
                scope[name] = replace(variable_term(local, type_), present=present)
            else:
                local = writer.facts.new_local_for(type_)
                writer.append_assignment(local, number)
                scope[name] = variable_term(local, type_)
        return scope

    def effects(self, block: Agent | None) -> list[tuple[Effect, NameClasses]]:
        _, shared, own = self.scope(block)
        return merge_clauses(block.effects if block is not None else (), own, self.behaviour.effects, shared)

    def player(
        self,
        writer: FunctionEmitter,
        block: int,
        node: code.Local,
        action: code.Local,
        total: code.Local,
        there: code.Local | None = None,
    ) -> ActingAgent:
        """Return the `ActingAgent` for an agent of a block.

        Args:
            writer: receives the statements.
            block: number of the block.
            node, action, total: variables for the agent's object, its action, and its reward.
            there: variable that is true if the agent's object exists; None if it always exists.
        """
        own, moves = self.blocks[block], self.block_actions[block]
        actions, effects = self.actions(own), [effect for effect, _ in self.effects(own)]
        return ActingAgent(
            self.scope(own, node)[0],
            actions,
            [sum(1 for effect in effects if precedes_action(effect, one)) for one in actions],
            lambda: self.emit_clause_lookup(writer, actions, moves, action),
            there,
            total,
        )

    def emit_clause_lookup(
        self, writer: FunctionEmitter, actions: Sequence[Action], moves: BlockActions, chosen: code.Local
    ) -> tuple[code.Local, list[Mapping[str, CodeTerm]]]:
        """Emit code that finds the clause of the action with the number `chosen`, and reads the action's parameters.

        Returns:
            The variable for the number of the clause, -1 for none; and the terms of the parameters of each clause.
        """
        entries, width = moves.action_table()
        place = self.layout.offset(Constants(("actions", moves.block), entries))
        first, clause = writer.module.new_local("first"), writer.module.new_local("clause")
        writer.append_assignment(first, emit_sum(place, code.Operation("*", (chosen, code.Constant(width)))))
        writer.append_assignment(clause, emit_entry(L, first))
        parameters: list[Mapping[str, CodeTerm]] = []
        for number, action in enumerate(actions):
            inside = writer.collect(
                lambda action=action: parameters.append(self._load_parameters(writer, action, first))  # type: ignore[misc]
            )
            for statement in inside:
                if isinstance(statement, code.Assign) and isinstance(statement.target, code.Local):
                    writer.append_assignment(statement.target, ZERO)
            if inside:
                writer.append(code.If(code.emit_equal(clause, code.Constant(number)), inside))
        return clause, parameters

    def emit_action_test(self, block: int) -> str:
        """Emit a function that returns 1 if an agent's action can be applied, or on errors; else 0. Return its name."""
        own, can = self.blocks[block], code.Local("can", "int")
        actions, scope = self.actions(own), self.scope(own)[0]
        with self.module.emitting_function():
            writer = self.new_writer(code.Return(ONE))
            clause, parameters = self.emit_clause_lookup(writer, actions, self.block_actions[block], ACTION)
            writer.append_assignment(can, ZERO)
            for number, action in enumerate(actions):

                def write(action: Action = action, place: int = number) -> None:
                    writer.emit_can_run(action.branches, {**scope, **parameters[place]}, can)

                writer.append_if(code.emit_equal(clause, code.Constant(number)), write)
            writer.append(code.Return(can))
            return self.module.add_function("may", (SELF, ACTION), writer.all_statements())

    # --- after a step

    def emit_tidy(self, writer: FunctionEmitter) -> None:
        """Emit a call that renumbers created objects after a step, oldest first. Emit nothing if rules create none."""
        if self.changes.created_group is not None:
            writer.append(code.ExpressionStatement(emit_call("tidy")))

    def emit_check_needed(
        self, writer: FunctionEmitter, scope: Mapping[str, CodeTerm], did: code.Expression | None
    ) -> None:
        """Emit code that fails if an object that the next steps will need is deleted.

        Args:
            writer: receives the statements.
            scope: the terms of the names.
            did: is 1 if an action was done. Then fail only if so, and if the episode goes on. None to test always.
        """
        needed = [one for one in object_reads(self.behaviour) if one.is_always_evaluated and one.callers]
        tests = [writer.deleted_test(scope[one.name], one.cls) for one in needed if one.name in scope]
        gone = [test for test in dict.fromkeys(tests) if test is not None]
        if not gone:
            return
        before = [] if did is None else [code.emit_equal(END_OF_STEP, ZERO), code.emit_equal(did, ONE)]
        test = code.emit_joined("and", [*before, code.emit_joined("or", gone, False)], True)
        writer.append_fail_if(test)

    # --- observations

    def observed(self, block: Agent | None) -> list[tuple[Observation, NameClasses]]:
        _, shared, own = self.scope(block)
        mine = block.observations if block is not None else ()
        return merge_clauses(mine, own, self.behaviour.observations, shared)
