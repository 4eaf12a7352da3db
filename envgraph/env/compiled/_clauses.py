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
    ObserveFind,
    domain_type,
    expanded,
    readings,
)
from envgraph.code import dataclass
from envgraph.env._observing import size_of
from envgraph.env._prepared import Types, together
from envgraph.env._program import stands_before
from envgraph.env.compiled._layout import ONE, ZERO, Constants, L, call, entry, plus, table
from envgraph.env.compiled._matching import Matching
from envgraph.env.compiled._member import ranks
from envgraph.env.compiled._tables import Bound, Seats
from envgraph.env.compiled._terms import Term, named
from envgraph.env.compiled._turn import END, Player
from envgraph.env.compiled._writer import Writer
from envgraph.metamodel import EnumType, Scalar
from envgraph.pattern import ObjectType, StaticType
from envgraph.rewrite import Engine

SELF, ACTION = code.Local("self", "object"), code.Local("a", "int")


@dataclass(frozen=True, slots=True)
class Numbered:
    """An action of an agent block: its name, the number of its clause, and the values of its parameters."""

    name: str
    clause: int
    values: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Moves:
    """The actions of the agents of one block.

    Attributes:
        block: number of the block.
        own: the actions of the block.
        names: names of the actions of all blocks.
    """

    block: int
    own: Sequence[Numbered]
    names: Sequence[str]

    def entries(self) -> tuple[tuple[int, ...], int]:
        """Return a flat table with a row for each action name, and the width of a row.

        A row holds the number of the action's clause (-1 if the block has no such action) and the parameters' values.
        """
        width = 1 + max((len(one.values) for one in self.own), default=0)
        rows = {one.name: (one.clause, *one.values) for one in self.own}
        padded = [(*(row := rows.get(name, (-1,))), *[0] * (width - len(row))) for name in self.names]
        return tuple(chain(*padded)), width


class Clauses:
    """An emitter of the code that clauses share, whether agents take turns or act together.

    Args:
        engine: has the patterns and rules.
        behaviour: resolved, without errors.
        keys: the indices of objects over the family.
        matching: emits functions that find matches.

    Attributes:
        blocks: the `agent` blocks; a single None for a behaviour without `agent` blocks.
        moves: the actions of the agents of each block.
    """

    def __init__(self, engine: Engine, behaviour: Behaviour, keys: KeyIndex, matching: Matching) -> None:
        self.engine = engine
        self.behaviour = behaviour
        self.keys = keys
        self.matching = matching
        self.facts, self.module = matching.facts, matching.module
        self.layout, self.changes = matching.facts.layout, matching.facts.changes
        self.metamodel = engine.model.metamodel
        self.blocks: Sequence[Agent | None] = behaviour.agents or (None,)
        numbered = [self._numbered(block) for block in self.blocks]
        names = tuple(dict.fromkeys(one.name for each in numbered for one in each))
        self.moves = [Moves(number, own, names) for number, own in enumerate(numbered)]

    def writer(self, leave: code.Return) -> Writer:
        """Return a new emitter of the statements of a function, which ends with `leave` after an error."""
        return Writer(self.matching, self.engine, self.behaviour.name, leave)

    def seat(self, of: Literal["object", "block", "count"], turn: code.Expression = ZERO) -> code.Expression:
        """Return code for the object or block number of the agent with number `turn`, or for the number of agents."""
        return table(
            plus(self.layout.offset(Seats(tuple(one.cls for one in self.behaviour.agents), of)), turn)
        )

    def scope(
        self, block: Agent | None, node: code.Local = SELF
    ) -> tuple[dict[str, Term], dict[str, str], dict[str, str]]:
        """Return the terms of all names, the classes of names in shared clauses, and those in clauses of a block.

        Args:
            block: the agent's block; None for shared clauses only.
            node: variable for the agent's object.
        """
        scope, shared = {}, {}
        for parameter in self.behaviour.parameters:
            cls = shared[parameter.name] = parameter.type or ""
            bound = table(self.layout.offset(Bound(parameter)))
            scope[parameter.name] = self._object(bound, cls)
        own = dict(shared)
        if block is not None:
            own[block.variable] = block.cls
            scope[block.variable] = self._object(node, block.cls)
        return scope, shared, own

    def _object(self, node: code.Expression, cls: str) -> Term:
        return named(node, ObjectType(cls), cls if self.changes.fixed_class(cls) else None)

    def actions(self, block: Agent | None) -> list[Action]:
        _, shared, own = self.scope(block)
        actions = block.actions if block is not None else ()
        return [action for action, _ in together(actions, own, self.behaviour.actions, shared)]

    # --- actions

    def _numbered(self, block: Agent | None) -> list[Numbered]:
        """Return every action of a block with each combination of its parameters' values, in order."""
        found = []
        for clause, action in enumerate(self.actions(block)):
            types = [domain_type(domain, self.metamodel) for _, domain in action.parameters]
            for name, values in expanded(action, self.keys, self.metamodel):
                numbers = (
                    ranks(type_)[str(value)] if isinstance(type_, EnumType) else int(value)
                    for type_, value in zip(types, values, strict=True)
                )
                found.append(Numbered(name, clause, tuple(numbers)))
        return found

    def _parameters(self, writer: Writer, action: Action, first: code.Expression) -> dict[str, Term]:
        """Emit code that reads an action's parameters from its table row, at index `first`. Return their terms."""
        scope = {}
        for place, (name, domain) in enumerate(action.parameters, 1):
            type_: StaticType = domain_type(domain, self.metamodel) or Scalar.INT
            number: code.Expression = entry(L, plus(first, place))
            if isinstance(type_, ObjectType):
                local = writer.keyed(type_.cls, number)
                present = (code.Operation(">=", (local, ZERO)),)
                scope[name] = replace(named(local, type_), present=present)
            else:
                local = writer.facts.local(type_)
                writer.assign(local, number)
                scope[name] = named(local, type_)
        return scope

    def effects(self, block: Agent | None) -> list[tuple[Effect, Types]]:
        _, shared, own = self.scope(block)
        return together(block.effects if block is not None else (), own, self.behaviour.effects, shared)

    def player(
        self,
        writer: Writer,
        block: int,
        node: code.Local,
        action: code.Local,
        total: code.Local,
        there: code.Local | None = None,
    ) -> Player:
        """Return the `Player` for an agent of a block.

        Args:
            writer: receives the statements.
            block: number of the block.
            node, action, total: variables for the agent's object, its action, and its reward.
            there: variable that is true if the agent's object exists; None if it always exists.
        """
        own, moves = self.blocks[block], self.moves[block]
        actions, effects = self.actions(own), [effect for effect, _ in self.effects(own)]
        return Player(
            self.scope(own, node)[0],
            actions,
            [sum(1 for effect in effects if stands_before(effect, one)) for one in actions],
            lambda: self.chosen(writer, actions, moves, action),
            there,
            total,
        )

    def chosen(
        self, writer: Writer, actions: Sequence[Action], moves: Moves, chosen: code.Local
    ) -> tuple[code.Local, list[Mapping[str, Term]]]:
        """Emit code that finds the clause of the action with the number `chosen`, and reads the action's parameters.

        Returns:
            The variable for the number of the clause, -1 for none; and the terms of the parameters of each clause.
        """
        entries, width = moves.entries()
        place = self.layout.offset(Constants(("actions", moves.block), entries))
        first, clause = writer.module.fresh("first"), writer.module.fresh("clause")
        writer.assign(first, plus(place, code.Operation("*", (chosen, code.Constant(width)))))
        writer.assign(clause, entry(L, first))
        parameters: list[Mapping[str, Term]] = []
        for number, action in enumerate(actions):
            inside = writer.collected(
                lambda action=action: parameters.append(self._parameters(writer, action, first))  # type: ignore[misc]
            )
            for statement in inside:
                if isinstance(statement, code.Assign) and isinstance(statement.target, code.Local):
                    writer.assign(statement.target, ZERO)
            if inside:
                writer.add(code.If(code.equal(clause, code.Constant(number)), inside))
        return clause, parameters

    def may(self, block: int) -> str:
        """Emit a function that returns 1 if an agent's action can be applied, or on errors; else 0. Return its name."""
        own, can = self.blocks[block], code.Local("can", "int")
        actions, scope = self.actions(own), self.scope(own)[0]
        with self.module.writing():
            writer = self.writer(code.Return(ONE))
            clause, parameters = self.chosen(writer, actions, self.moves[block], ACTION)
            writer.assign(can, ZERO)
            for number, action in enumerate(actions):

                def write(action: Action = action, place: int = number) -> None:
                    writer.can_run(action.branches, {**scope, **parameters[place]}, can)

                writer.when(code.equal(clause, code.Constant(number)), write)
            writer.add(code.Return(can))
            return self.module.add("may", (SELF, ACTION), writer.written())

    # --- after a step

    def tidy(self, writer: Writer) -> None:
        """Emit a call that renumbers created objects after a step, oldest first. Emit nothing if rules create none."""
        if self.changes.growing is not None:
            writer.add(code.Do(call("tidy")))

    def check_needed(self, writer: Writer, scope: Mapping[str, Term], did: code.Expression | None) -> None:
        """Emit code that fails if an object that the next steps will need is deleted.

        Args:
            writer: receives the statements.
            scope: the terms of the names.
            did: is 1 if an action was done. Then fail only if so, and if the episode goes on. None to test always.
        """
        needed = [one for one in readings(self.behaviour) if one.always and one.callers]
        tests = [writer.gone(scope[one.name], one.cls) for one in needed if one.name in scope]
        gone = [test for test in dict.fromkeys(tests) if test is not None]
        if not gone:
            return
        before = [] if did is None else [code.equal(END, ZERO), code.equal(did, ONE)]
        test = code.joined("and", [*before, code.joined("or", gone, False)], True)
        writer.fail_if(test)

    # --- observations

    def observed(self, block: Agent | None) -> list[tuple[Observation, Types]]:
        _, shared, own = self.scope(block)
        mine = block.observations if block is not None else ()
        return together(mine, own, self.behaviour.observations, shared)

    def sizes(self, observations: Sequence[tuple[Observation, Types]]) -> list[int]:
        """Return the number of values of each component of some observation clauses."""
        found: list[int] = []
        for observation, types in observations:
            size = size_of(observation, types, self.keys, self.metamodel)
            each = None if isinstance(observation, ObserveFind) else observation.each
            found += [size] * (1 if each is None else self.keys.size(each.type or ""))
        return found
