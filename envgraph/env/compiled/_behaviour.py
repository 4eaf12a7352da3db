"""A behaviour as a program: `begin`, `step_one` and `observe` over the state of one environment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import prod
from typing import Final

from envgraph import code
from envgraph.behaviour import (
    MOST_VALUES,
    Action,
    Agent,
    Behaviour,
    Observation,
    ObserveFind,
    domain_type,
    readings,
)
from envgraph.code import dataclass
from envgraph.env._keys import KeyIndex, expanded, indexed_classes, key_attributes
from envgraph.env._observing import size_of
from envgraph.env._prepared import Types, together
from envgraph.env.compiled._changes import Changes, StaticPatterns, blocks_of, calls_of, plan_of
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
from envgraph.env.compiled._turn import ACTED, END, NOTHING, TOTAL, Turn
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
    """

    functions: tuple[code.Function, ...]
    layout: Layout
    levels: int
    width: int
    action_names: tuple[str, ...]
    shape: tuple[int, ...]


def written(engine: Engine, behaviour: Behaviour, keys: KeyIndex, layout: Layout) -> Text:
    """The program of a behaviour.

    Args:
        engine: of the domain: has the patterns and rules; plans go by the sizes of its model.
        behaviour: resolved, without errors.
        keys: the indices of objects over the family.
        layout: gets the tables and columns.

    Raises:
        NotCompiled: something in it is not compiled.
    """
    return _Program(engine, behaviour, keys, layout).text()


@dataclass(frozen=True, slots=True)
class _Numbered:
    """An action of a block: its clause, and the values of its parameters."""

    name: str
    clause: int
    values: tuple[int, ...]


class _Program:
    def __init__(self, engine: Engine, behaviour: Behaviour, keys: KeyIndex, layout: Layout) -> None:
        self._engine = engine
        self._behaviour = behaviour
        self._keys = keys
        self._layout = layout
        self._metamodel = engine.model.metamodel
        library = engine.library
        plans = [plan_of(engine, one) for one in calls_of(behaviour) if one.rule is not None]
        self._changes = Changes.of(plans, self._metamodel)
        layout.created = self._changes.created
        layout.renumbered = not self._changes.created.isdisjoint(self._changes.deleted)
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
        for agent in self._behaviour.agents:
            if not self._changes.fixed_class(agent.cls):
                raise NotCompiled(f"agents that may come or go (`{agent.variable}`)", agent.span)

    # --- the program

    def text(self) -> Text:
        """The whole."""
        behaviour = self._behaviour
        blocks: Sequence[Agent | None] = behaviour.agents or (None,)
        numbered = [self._numbered(block) for block in blocks]
        names = _names(numbered)
        shapes = [self._shape(block) for block in blocks]
        lead = (len(blocks),) if len(blocks) > 1 else ()
        length = max(map(len, shapes))
        padded = [[*shape, *[1] * (length - len(shape))] for shape in shapes]
        shape = (*lead, *(max(sizes) for sizes in zip(*padded, strict=True)))
        if prod(shape) > MOST_VALUES:
            raise NotCompiled("too many observations")
        turns = [self._turn(number, block, numbered[number], names) for number, block in enumerate(blocks)]
        may = [self._may(number, block, numbered[number], names) for number, block in enumerate(blocks)]
        looks = [self._look(number, block, len(blocks), shape) for number, block in enumerate(blocks)]
        if self._changes.growing is not None:
            self._define("tidy", (), tidied(self._facts, self._changes.growing))
        self._define("begin", (), self._begin())
        self._define("step_one", (ACTION,), self._dispatched(turns, (ACTION,), NOTHING))
        self._define("may_one", (ACTION,), self._dispatched(may, (ACTION,), code.Return(ZERO)))
        self._define("look", (SEEN,), self._dispatched(looks, (SEEN,), code.Return(ZERO)))
        self._module.functions.append(code.Function("places", (L,), self._layout.places()))
        levels = max(self._module.levels.values())
        functions = inlined(self._module.functions, ENTRIES, self._module.fresh)
        return Text(functions, self._layout, levels, self._module.width, names, shape)

    def _define(self, name: str, parameters: tuple[code.Local, ...], body: code.Body) -> None:
        self._module.functions.append(code.Function(name, (*STATE, *parameters), body))

    def _dispatched(
        self, functions: Sequence[str], arguments: tuple[code.Local, ...], nothing: code.Return
    ) -> code.Body:
        """The function of the block whose turn it is."""
        agents = self._behaviour.agents
        if not agents:
            return (code.Return(call(functions[0], NOBODY, *arguments)),)
        classes = tuple(agent.cls for agent in agents)
        turn, block = code.Local("turn", "int"), code.Local("block", "int")
        body: list[code.Statement] = [code.Assign(turn, cell(TURN))]
        seat = table(plus(self._layout.offset(Seats(classes, "object")), turn))
        body.append(code.Assign(SELF, seat))
        if len(agents) == 1:
            return (*body, code.Return(call(functions[0], SELF, *arguments)))
        body.append(code.Assign(block, table(plus(self._layout.offset(Seats(classes, "block")), turn))))
        for number, function in enumerate(functions):
            called = code.Return(call(function, SELF, *arguments))
            body.append(code.If(code.equal(block, code.Constant(number)), (called,)))
        return (*body, nothing)

    def _scope(self, block: Agent | None) -> tuple[dict[str, Term], dict[str, str], dict[str, str]]:
        """The objects that names stand for, and the classes of names that shared clauses and those of a block know."""
        scope, shared = {}, {}
        for parameter in self._behaviour.parameters:
            cls = shared[parameter.name] = parameter.type or ""
            node = table(self._layout.offset(Bound(parameter)))
            sure = cls if self._changes.fixed_class(cls) else None
            scope[parameter.name] = named(node, ObjectType(cls), sure)
        own = dict(shared)
        if block is not None:
            own[block.variable] = block.cls
            scope[block.variable] = named(SELF, ObjectType(block.cls), block.cls)
        return scope, shared, own

    def _clauses(self, block: Agent | None) -> tuple[list[tuple[Action, Types]], dict[str, Term]]:
        scope, shared, own = self._scope(block)
        actions = block.actions if block is not None else ()
        return together(actions, own, self._behaviour.actions, shared), scope

    # --- actions

    def _numbered(self, block: Agent | None) -> list[_Numbered]:
        """Every action of a block, in order."""
        found = []
        for clause, (action, _) in enumerate(self._clauses(block)[0]):
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

    def _turn(
        self, number: int, block: Agent | None, numbered: Sequence[_Numbered], names: Sequence[str]
    ) -> str:
        actions, scope = self._clauses(block)
        _, shared, own = self._scope(block)
        own_effects = block.effects if block is not None else ()
        effects = together(own_effects, own, self._behaviour.effects, shared)
        with self._module.writing():
            writer = Writer(self._matching, self._engine, self._behaviour.name, NOTHING)
            clause, parameters = self._chosen(writer, number, actions, numbered, names)
            turn = Turn(writer, scope, effects)
            turn.write(actions, clause, parameters)
            self._check_needed(writer, scope, turn.did)
            self._advance(writer)
            self._tidy(writer)
            writer.add(code.Return(code.tuple_of(TOTAL, END, ACTED)))
            return self._module.add("turn", (SELF, ACTION), writer.written())

    def _may(
        self, number: int, block: Agent | None, numbered: Sequence[_Numbered], names: Sequence[str]
    ) -> str:
        """The function that says whether an action would do something."""
        actions, scope = self._clauses(block)
        can = code.Local("can", "int")
        with self._module.writing():
            writer = Writer(self._matching, self._engine, self._behaviour.name, code.Return(ONE))
            clause, parameters = self._chosen(writer, number, actions, numbered, names)
            writer.assign(can, ZERO)
            for clause_number, (action, _) in enumerate(actions):

                def write(action: Action = action, place: int = clause_number) -> None:
                    writer.can_run(action.branches, {**scope, **parameters[place]}, can)

                writer.when(code.equal(clause, code.Constant(clause_number)), write)
            writer.add(code.Return(can))
            return self._module.add("may", (SELF, ACTION), writer.written())

    def _chosen(
        self,
        writer: Writer,
        number: int,
        actions: Sequence[tuple[Action, Types]],
        numbered: Sequence[_Numbered],
        names: Sequence[str],
    ) -> tuple[code.Local, list[Mapping[str, Term]]]:
        """Writes which clause an action is of, -1 for none; that, and what the parameters of each clause stand for."""
        width = 1 + max((len(one.values) for one in numbered), default=0)
        by_name = {one.name: one for one in numbered}
        entries: list[int] = []
        for name in names:
            one = by_name.get(name)
            row = [-1] if one is None else [one.clause, *one.values]
            entries += [*row, *[0] * (width - len(row))]
        place = self._layout.offset(Constants(("actions", number), tuple(entries)))
        first, clause = writer.module.fresh("first"), writer.module.fresh("clause")
        writer.assign(first, plus(place, code.Operation("*", (ACTION, code.Constant(width)))))
        writer.assign(clause, entry(L, first))
        parameters: list[Mapping[str, Term]] = []
        for clause_number, (action, _) in enumerate(actions):
            inside = writer.collected(
                lambda action=action: parameters.append(self._parameters(writer, action, first))  # type: ignore[misc]
            )
            for statement in inside:
                if isinstance(statement, code.Assign) and isinstance(statement.target, code.Local):
                    writer.assign(statement.target, ZERO)
            if inside:
                writer.add(code.If(code.equal(clause, code.Constant(clause_number)), inside))
        return clause, parameters

    def _advance(self, writer: Writer) -> None:
        agents = self._behaviour.agents
        if agents:
            count = table(self._layout.offset(Seats(tuple(agent.cls for agent in agents), "count")))
            after = code.Operation("%", (plus(cell(TURN), 1), count))
            writer.add(code.Assign(cell(TURN), after))

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
            scope, _, _ = self._scope(None)
            for reset in self._behaviour.resets:
                writer.alternatives(reset.apply, scope)
            self._check_needed(writer, scope, None)
            self._tidy(writer)
            writer.add(code.Return(ZERO))
            name = self._module.add("start", (), writer.written())
        return (code.Return(call(name)),)

    # --- observations

    def _observed(self, block: Agent | None) -> list[tuple[Observation, Types]]:
        _, shared, own = self._scope(block)
        mine = block.observations if block is not None else ()
        return together(mine, own, self._behaviour.observations, shared)

    def _shape(self, block: Agent | None) -> list[int]:
        """How many values each component of a block has."""
        found: list[int] = []
        for observation, types in self._observed(block):
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
