"""A behaviour as a program: `begin`, `step_one` and `observe` over the state of one environment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, zip_longest
from math import prod
from typing import Final, Literal

from envgraph import code
from envgraph.behaviour import (
    MOST_VALUES,
    Action,
    Agent,
    Behaviour,
    Effect,
    Observation,
    ObserveFind,
    domain_type,
    readings,
)
from envgraph.code import dataclass
from envgraph.env._keys import KeyIndex, expanded, indexed_classes, key_attributes
from envgraph.env._observing import component_names, size_of
from envgraph.env._prepared import Types, together
from envgraph.env._program import stands_before
from envgraph.env._together import in_order, joint_names, numbered_names
from envgraph.env.compiled._changes import Changes, StaticPatterns, blocks_of, plans_of
from envgraph.env.compiled._facts import Facts, Module
from envgraph.env.compiled._inlining import inlined
from envgraph.env.compiled._layout import (
    NOBODY,
    ONE,
    STATE,
    TURN,
    ZERO,
    Constants,
    L,
    Layout,
    call,
    cell,
    entry,
    plus,
    table,
)
from envgraph.env.compiled._matching import Matching
from envgraph.env.compiled._member import ranks
from envgraph.env.compiled._observations import SEEN, Observations
from envgraph.env.compiled._refused import NotCompiled
from envgraph.env.compiled._tables import Bound, Seats, indexable
from envgraph.env.compiled._terms import Term, named
from envgraph.env.compiled._tidying import tidied
from envgraph.env.compiled._turn import ACTED, END, NOTHING, TOTAL, Clause, Player, Turn
from envgraph.env.compiled._writer import Writer
from envgraph.errors import Span
from envgraph.match.plan import CallGraph, LiveSizes, Planner
from envgraph.metamodel import Attribute, EnumType, Scalar
from envgraph.pattern import ObjectType, StaticType
from envgraph.rewrite import Engine
from envgraph.rewrite.plans import Increase, RulePlan, SetValue

ENTRIES: Final = ("begin", "step_one", "may_one", "look", "places")
"""The functions of a program that `_kernels` calls."""
SELF, ACTION = code.Local("self", "object"), code.Local("a", "int")


@dataclass(frozen=True, slots=True)
class Text:
    """A program, and what it needs.

    Attributes:
        functions: in the order in which they call each other.
        layout: the tables and columns.
        levels, width: how many stretches of rows there are, and how many columns.
        action_names: of the actions.
        shape: sizes of the components of an observation.
        observation_names: of these.
    """

    functions: tuple[code.Function, ...]
    layout: Layout
    levels: int
    width: int
    action_names: tuple[str, ...]
    shape: tuple[int, ...]
    observation_names: tuple[str, ...]


def written(
    engine: Engine,
    behaviour: Behaviour,
    keys: KeyIndex,
    layout: Layout,
    seats: Sequence[tuple[str, int]] = (),
) -> Text:
    """The program of a behaviour.

    Args:
        engine: of the domain: has the patterns and rules; plans go by the sizes of its model.
        behaviour: resolved, without errors.
        keys: the indices of objects over the family.
        layout: gets the tables and columns.
        seats: of agents that act together the names, and the numbers of their blocks.

    Raises:
        NotCompiled: something in it is not compiled.
        EvaluationError: too many actions of agents that act together.
    """
    return _Program(engine, behaviour, keys, layout, seats).text()


@dataclass(frozen=True, slots=True)
class _Numbered:
    """An action of a block: its clause, and the values of its parameters."""

    name: str
    clause: int
    values: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class _Moves:
    """What the agents of a block can do.

    Attributes:
        block: its number.
        own: the actions of the block.
        names: of everybody's actions.
    """

    block: int
    own: Sequence[_Numbered]
    names: Sequence[str]

    def entries(self) -> tuple[tuple[int, ...], int]:
        """For each name the clause, -1 for none, and the values of the parameters; and how many numbers that are."""
        width = 1 + max((len(one.values) for one in self.own), default=0)
        rows = {one.name: (one.clause, *one.values) for one in self.own}
        padded = [(*(row := rows.get(name, (-1,))), *[0] * (width - len(row))) for name in self.names]
        return tuple(chain(*padded)), width


class _Program:
    def __init__(
        self,
        engine: Engine,
        behaviour: Behaviour,
        keys: KeyIndex,
        layout: Layout,
        seats: Sequence[tuple[str, int]],
    ) -> None:
        self._engine = engine
        self._seats = seats
        self._behaviour = behaviour
        self._keys = keys
        self._layout = layout
        self._metamodel = engine.model.metamodel
        library = engine.library
        plans = plans_of(engine, behaviour)
        self._changes = Changes.of(plans, self._metamodel)
        layout.created = self._changes.created
        layout.renumbered = self._changes.recurring
        self._check(plans)
        calls = CallGraph(library)
        static = StaticPatterns(self._changes, library, calls)
        sizes = LiveSizes(library, engine.model.store)
        self._module = Module()
        self._facts = Facts(self._module, layout, self._changes, library, sizes)
        self._matching = Matching(self._facts, Planner(library, calls, sizes, static), static, calls)

    def _check(self, plans: Sequence[RulePlan]) -> None:
        """See that indices of objects and agents stay what they are."""
        for cls in indexed_classes(self._behaviour, self._metamodel):
            key = key_attributes(self._metamodel, cls)
            if key and not self._changes.created.isdisjoint(indexable(self._metamodel, cls)):
                span = next(body.span for plan in plans for body in blocks_of(plan.body) if body.creates)
                raise NotCompiled(f"objects with a key that a rule creates (`{cls}`)", span)
            for attribute in key:
                if attribute.index in self._changes.written:
                    raise NotCompiled(f"keys that change (`{attribute}`)", _set_at(plans, attribute))

    # --- the program

    def text(self) -> Text:
        """The whole."""
        behaviour = self._behaviour
        blocks: Sequence[Agent | None] = behaviour.agents or (None,)
        numbered = [self._numbered(block) for block in blocks]
        names = _names(numbered)
        moves = [_Moves(number, own, names) for number, own in enumerate(numbered)]
        shape, seen = (self._all_seen if behaviour.together else self._one_sees)(blocks)
        if prod(shape) > MOST_VALUES:
            raise NotCompiled("too many observations")
        step, may, look = (self._joint if behaviour.together else self._turns)(blocks, moves, shape)
        if self._changes.growing is not None:
            self._define("tidy", (), tidied(self._facts, self._changes.growing))
        self._define("begin", (), self._begin())
        self._define("step_one", (ACTION,), step)
        self._define("may_one", (ACTION,), may)
        self._define("look", (SEEN,), look)
        self._module.functions.append(code.Function("places", (L,), self._layout.places()))
        levels = max(self._module.levels.values())
        functions = inlined(self._module.functions, ENTRIES, self._module.fresh)
        if behaviour.together:
            names = joint_names([name for name, _ in self._seats], names)
        return Text(functions, self._layout, levels, self._module.width, names, shape, seen)

    def _define(self, name: str, parameters: tuple[code.Local, ...], body: code.Body) -> None:
        self._module.functions.append(code.Function(name, (*STATE, *parameters), body))

    def _turns(
        self, blocks: Sequence[Agent | None], moves: Sequence[_Moves], shape: Sequence[int]
    ) -> tuple[code.Body, code.Body, code.Body]:
        """A step, whether an action would do something, and what is seen, where agents take turns."""
        turns = [self._turn(block, own) for block, own in zip(blocks, moves, strict=True)]
        may = [self._may(block, own) for block, own in zip(blocks, moves, strict=True)]
        looks = [self._look(number, block, len(blocks), shape) for number, block in enumerate(blocks)]
        return (
            self._dispatched(turns, (ACTION,), NOTHING),
            self._dispatched(may, (ACTION,), code.Return(ZERO)),
            self._dispatched(looks, (SEEN,), code.Return(ZERO)),
        )

    def _dispatched(
        self, functions: Sequence[str], arguments: tuple[code.Local, ...], nothing: code.Return
    ) -> code.Body:
        """The function of the block whose turn it is."""
        agents = self._behaviour.agents
        if not agents:
            return (code.Return(call(functions[0], NOBODY, *arguments)),)
        turn, block = code.Local("turn", "int"), code.Local("block", "int")
        body: list[code.Statement] = [code.Assign(turn, cell(TURN))]
        body.append(code.Assign(SELF, self._seat("object", turn)))
        if len(agents) == 1:
            return (*body, code.Return(call(functions[0], SELF, *arguments)))
        body.append(code.Assign(block, self._seat("block", turn)))
        for number, function in enumerate(functions):
            called = code.Return(call(function, SELF, *arguments))
            body.append(code.If(code.equal(block, code.Constant(number)), (called,)))
        return (*body, nothing)

    def _seat(self, of: Literal["object", "block", "count"], turn: code.Expression = ZERO) -> code.Expression:
        """Code for an entry of the table of agents."""
        return table(
            plus(self._layout.offset(Seats(tuple(one.cls for one in self._behaviour.agents), of)), turn)
        )

    def _scope(
        self, block: Agent | None, node: code.Local = SELF
    ) -> tuple[dict[str, Term], dict[str, str], dict[str, str]]:
        """The objects that names stand for, and the classes of names that shared clauses and those of a block know.

        Args:
            block: of an agent.
            node: its object.
        """
        scope, shared = {}, {}
        for parameter in self._behaviour.parameters:
            cls = shared[parameter.name] = parameter.type or ""
            bound = table(self._layout.offset(Bound(parameter)))
            scope[parameter.name] = self._object(bound, cls)
        own = dict(shared)
        if block is not None:
            own[block.variable] = block.cls
            scope[block.variable] = self._object(node, block.cls)
        return scope, shared, own

    def _object(self, node: code.Expression, cls: str) -> Term:
        return named(node, ObjectType(cls), cls if self._changes.fixed_class(cls) else None)

    def _clauses(self, block: Agent | None) -> list[Action]:
        _, shared, own = self._scope(block)
        actions = block.actions if block is not None else ()
        return [action for action, _ in together(actions, own, self._behaviour.actions, shared)]

    # --- actions

    def _numbered(self, block: Agent | None) -> list[_Numbered]:
        """Every action of a block, in order."""
        found = []
        for clause, action in enumerate(self._clauses(block)):
            types = [domain_type(domain, self._metamodel) for _, domain in action.parameters]
            for name, values in expanded(action, self._keys, self._metamodel):
                numbers = (
                    ranks(type_)[str(value)] if isinstance(type_, EnumType) else int(value)
                    for type_, value in zip(types, values, strict=True)
                )
                found.append(_Numbered(name, clause, tuple(numbers)))
        return found

    def _parameters(self, writer: Writer, action: Action, first: code.Expression) -> dict[str, Term]:
        """What the parameters of an action stand for."""
        scope = {}
        for place, (name, domain) in enumerate(action.parameters, 1):
            type_: StaticType = domain_type(domain, self._metamodel) or Scalar.INT
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

    # --- functions

    def _turn(self, block: Agent | None, moves: _Moves) -> str:
        with self._module.writing():
            writer = Writer(self._matching, self._engine, self._behaviour.name, NOTHING)
            scope, player = self._scope(block)[0], self._player(writer, block, moves, SELF, ACTION, TOTAL)
            turn = Turn(writer, [player], [Clause(*each, 0, False) for each in self._effects(block)])
            turn.write()
            self._check_needed(writer, scope, turn.did)
            if self._behaviour.agents:
                self._advance(writer, cell(TURN))
            self._tidy(writer)
            writer.add(code.Return(code.tuple_of(TOTAL, END, ACTED)))
            return self._module.add("turn", (SELF, ACTION), writer.written())

    def _effects(self, block: Agent | None) -> list[tuple[Effect, Types]]:
        _, shared, own = self._scope(block)
        return together(block.effects if block is not None else (), own, self._behaviour.effects, shared)

    def _player(
        self,
        writer: Writer,
        block: Agent | None,
        moves: _Moves,
        node: code.Local,
        action: code.Local,
        total: code.Local,
        there: code.Local | None = None,
    ) -> Player:
        actions, effects = self._clauses(block), [effect for effect, _ in self._effects(block)]
        return Player(
            self._scope(block, node)[0],
            actions,
            [sum(1 for effect in effects if stands_before(effect, one)) for one in actions],
            lambda: self._chosen(writer, actions, moves, action),
            there,
            total,
        )

    def _may(self, block: Agent | None, moves: _Moves) -> str:
        """The function that says whether an action would do something."""
        actions, scope = self._clauses(block), self._scope(block)[0]
        can = code.Local("can", "int")
        with self._module.writing():
            writer = Writer(self._matching, self._engine, self._behaviour.name, code.Return(ONE))
            clause, parameters = self._chosen(writer, actions, moves, ACTION)
            writer.assign(can, ZERO)
            for number, action in enumerate(actions):

                def write(action: Action = action, place: int = number) -> None:
                    writer.can_run(action.branches, {**scope, **parameters[place]}, can)

                writer.when(code.equal(clause, code.Constant(number)), write)
            writer.add(code.Return(can))
            return self._module.add("may", (SELF, ACTION), writer.written())

    def _chosen(
        self, writer: Writer, actions: Sequence[Action], moves: _Moves, chosen: code.Local
    ) -> tuple[code.Local, list[Mapping[str, Term]]]:
        """Writes which clause an action is of, -1 for none; that, and what the parameters of each clause stand for."""
        entries, width = moves.entries()
        place = self._layout.offset(Constants(("actions", moves.block), entries))
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

    # --- turns

    def _advance(self, writer: Writer, turn: code.Expression) -> None:
        """The next agent after a turn that is there acts next; the turn stays where nobody is."""
        count, agents = self._seat("count"), self._behaviour.agents
        if all(self._changes.fixed_class(agent.cls) for agent in agents):
            writer.add(code.Assign(cell(TURN), code.Operation("%", (plus(turn, 1), count))))
            return
        place, node = writer.module.fresh("turn"), writer.module.fresh("v", "object")
        there = [self._facts.is_instance(node, agent.cls) for agent in agents]
        blocks = [
            code.equal(self._seat("block", place), code.Constant(block)) for block in range(len(agents))
        ]
        tests = [code.Operation("and", pair) for pair in zip(blocks, there, strict=True)]
        each = (
            code.Assign(place, code.Operation("%", (plus(place, 1), count))),
            code.Assign(node, self._seat("object", place)),
            code.If(code.joined("or", tests, False), (code.Assign(cell(TURN), place), code.Leave("break"))),
        )
        writer.assign(place, turn)
        writer.add(code.For(writer.module.fresh("_"), code.call("range", count), each))

    # --- all at once

    def _joint(
        self, blocks: Sequence[Agent | None], moves: Sequence[_Moves], shape: Sequence[int]
    ) -> tuple[code.Body, code.Body, code.Body]:
        """A step of one action of each agent, whether each one could do its own, and what all of them see."""
        return (
            self._joint_step(blocks, moves),
            self._joint_may(blocks, moves),
            self._joint_look(blocks, shape),
        )

    def _digits(self, writer: Writer, names: int) -> Iterator[tuple[int, code.Local, code.Local]]:
        """Writes for each agent which object it is, and what it does; with the number of its block."""
        left, fresh = writer.module.fresh("left"), writer.module.fresh
        writer.assign(left, ACTION)
        for place, (_, number) in enumerate(self._seats):
            node, digit = fresh("self", "object"), fresh("a")
            writer.assign(node, self._seat("object", code.Constant(place)))
            writer.assign(digit, code.Operation("%", (left, code.Constant(names))))
            writer.assign(left, code.call("quotient", left, code.Constant(names)))
            yield number, node, digit

    def _joint_may(self, blocks: Sequence[Agent | None], moves: Sequence[_Moves]) -> code.Body:
        """Whether each agent that is there could do its action, or none at all."""
        may = [self._may(block, own) for block, own in zip(blocks, moves, strict=True)]
        names = len(moves[0].names)
        with self._module.writing():
            writer = Writer(self._matching, self._engine, self._behaviour.name, code.Return(ONE))
            for number, node, digit in self._digits(writer, names):
                block, other = blocks[number], writer.module.fresh("a")
                assert block is not None
                fixed = self._changes.fixed_class(block.cls)
                there = [] if fixed else [self._facts.is_instance(node, block.cls)]
                idle = [*there, code.equal(call(may[number], node, digit), ZERO)]
                could = code.If(call(may[number], node, other), (code.Return(ZERO),))
                others = code.For(other, code.call("range", code.Constant(names)), (could,))
                writer.add(code.If(code.joined("and", idle, True), (others,)))
            writer.add(code.Return(ONE))
            name = self._module.add("may", (ACTION,), writer.written())
        return (code.Return(call(name, ACTION)),)

    def _joint_step(self, blocks: Sequence[Agent | None], moves: Sequence[_Moves]) -> code.Body:
        with self._module.writing():
            writer, fresh = (
                Writer(self._matching, self._engine, self._behaviour.name, NOTHING),
                self._module.fresh,
            )
            players = []
            for number, node, digit in self._digits(writer, len(moves[0].names)):
                block = blocks[number]
                assert block is not None
                there = None if self._changes.fixed_class(block.cls) else fresh("there")
                if there is not None:
                    is_there = self._facts.is_instance(node, block.cls)
                    writer.assign(there, code.Choice(is_there, ONE, ZERO))
                total = fresh("total", "float")
                players.append(self._player(writer, block, moves[number], node, digit, total, there))
            turn = Turn(writer, players, list(self._joint_clauses(blocks)))
            turn.write()
            self._check_needed(writer, players[0].scope, turn.did)
            self._tidy(writer)
            writer.add(code.Return(code.tuple_of(TOTAL, END, ONE)))
            name = self._module.add("turn", (ACTION,), writer.written())
        return (code.Return(call(name, ACTION)),)

    def _joint_clauses(self, blocks: Sequence[Agent | None]) -> Iterator[Clause]:
        effects = [self._effects(blocks[number]) for _, number in self._seats]
        ours = {id(effect) for effect in self._behaviour.effects}
        written = [[(effect, id(effect) in ours) for effect, _ in own] for own in effects]
        for number, place in in_order(written):
            yield Clause(*effects[number][place], number, written[number][place][1])

    def _joint_look(self, blocks: Sequence[Agent | None], shape: Sequence[int]) -> code.Body:
        with self._module.writing():
            writer = Writer(self._matching, self._engine, self._behaviour.name, code.Return(ZERO))
            observations = Observations(writer, self._keys, shape)
            for place, (_, number) in enumerate(self._seats):
                node = self._module.fresh("self", "object")
                writer.assign(node, self._seat("object", code.Constant(place)))
                observations.write(
                    self._seen(blocks[number], shared=False), self._scope(blocks[number], node)[0]
                )
            observations.write(self._seen(blocks[0], shared=True), self._scope(None)[0])
            observations.end()
            name = self._module.add("look", (SEEN,), writer.written())
        return (code.Return(call(name, SEEN)),)

    def _seen(self, block: Agent | None, *, shared: bool) -> list[tuple[Observation, Types]]:
        """The clauses of a block, or the shared ones."""
        ours = {id(observation) for observation in self._behaviour.observations}
        return [each for each in self._observed(block) if (id(each[0]) in ours) is shared]

    def _all_seen(self, blocks: Sequence[Agent | None]) -> tuple[tuple[int, ...], tuple[str, ...]]:
        """Sizes and names of components where one observer sees what all agents do: theirs, then the shared ones."""
        own = [(name, self._sizes(self._seen(blocks[number], shared=False))) for name, number in self._seats]
        own.append(("shared", self._sizes(self._seen(blocks[0], shared=True))))
        names = numbered_names([(who, len(sizes)) for who, sizes in own])
        return tuple(chain(*(sizes for _, sizes in own))), names

    # --- the beginning

    def _tidy(self, writer: Writer) -> None:
        """Between steps new objects have the first numbers there are for them, in the order in which they came."""
        if self._changes.growing is not None:
            writer.add(code.Do(call("tidy")))

    def _check_needed(self, writer: Writer, scope: Mapping[str, Term], did: code.Expression | None) -> None:
        """The episode can go on only if objects are there that it will be asked for."""
        needed = [one for one in readings(self._behaviour) if one.always and one.callers]
        tests = [writer.gone(scope[one.name], one.cls) for one in needed if one.name in scope]
        gone = [test for test in dict.fromkeys(tests) if test is not None]
        if not gone:
            return
        before = [] if did is None else [code.equal(END, ZERO), code.equal(did, ONE)]
        test = code.joined("and", [*before, code.joined("or", gone, False)], True)
        writer.fail_if(test)

    def _begin(self) -> code.Body:
        with self._module.writing():
            writer = Writer(self._matching, self._engine, self._behaviour.name, code.Return(ZERO))
            scope, types, _ = self._scope(None)
            nobody = Player(scope, [], [], lambda: (ACTION, []), None, TOTAL)
            for reset in self._behaviour.resets:
                Turn(writer, [nobody], [Clause(reset.effect, types, 0, True)]).write()
            self._check_needed(writer, scope, None)
            if self._behaviour.agents and not self._behaviour.together:
                writer.add(code.Assign(cell(TURN), code.Operation("-", (self._seat("count"), ONE))))
                self._advance(writer, cell(TURN))
            self._tidy(writer)
            writer.add(code.Return(ZERO))
            name = self._module.add("start", (), writer.written())
        return (code.Return(call(name)),)

    # --- observations

    def _observed(self, block: Agent | None) -> list[tuple[Observation, Types]]:
        _, shared, own = self._scope(block)
        mine = block.observations if block is not None else ()
        return together(mine, own, self._behaviour.observations, shared)

    def _one_sees(self, blocks: Sequence[Agent | None]) -> tuple[tuple[int, ...], tuple[str, ...]]:
        """Sizes and names of components; with several blocks the first says whose turn it is."""
        sizes = [self._sizes(self._observed(block)) for block in blocks]
        lead = (len(blocks),) if len(blocks) > 1 else ()
        shape = (*lead, *(max(each) for each in zip_longest(*sizes, fillvalue=1)))
        return shape, component_names(self._behaviour, self._keys, len(shape))

    def _sizes(self, observations: Sequence[tuple[Observation, Types]]) -> list[int]:
        """How many values each component of some clauses has."""
        found: list[int] = []
        for observation, types in observations:
            size = size_of(observation, types, self._keys, self._metamodel)
            each = None if isinstance(observation, ObserveFind) else observation.each
            found += [size] * (1 if each is None else self._keys.size(each.type or ""))
        return found

    def _look(self, number: int, block: Agent | None, blocks: int, shape: Sequence[int]) -> str:
        with self._module.writing():
            writer = Writer(self._matching, self._engine, self._behaviour.name, code.Return(ZERO))
            observations = Observations(writer, self._keys, shape)
            if blocks > 1:
                observations.see(code.Constant(number))
            observations.write(self._observed(block), self._scope(block)[0])
            observations.end()
            return self._module.add("look", (SELF, SEEN), writer.written())


def _set_at(plans: Sequence[RulePlan], attribute: Attribute) -> Span | None:
    """Where a rule sets an attribute."""
    sets = (change for plan in plans for body in blocks_of(plan.body) for change in body.sets)
    kinds = (SetValue, Increase)
    return next((one.span for one in sets if isinstance(one, kinds) and one.attribute == attribute), None)


def _names(numbered: Sequence[Sequence[_Numbered]]) -> tuple[str, ...]:
    """The names of everybody's actions, in the order of the blocks."""
    return tuple(dict.fromkeys(one.name for each in numbered for one in each))
