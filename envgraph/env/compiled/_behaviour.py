"""A behaviour as a program: `begin`, `step_one` and `observe` over the state of one environment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from math import prod
from typing import Final

from envgraph import code
from envgraph.behaviour import (
    MOST_VALUES,
    Action,
    Agent,
    Behaviour,
    Domain,
    Observation,
    ObserveAttribute,
    ObserveFind,
    ObserveObject,
    ObserveRange,
    condition_question,
    count_question,
    domain_type,
    readings,
    root_of,
)
from envgraph.code import dataclass
from envgraph.env._keys import KeyIndex, indexed_classes, key_attributes
from envgraph.env._prepared import Types, together
from envgraph.env._program import added
from envgraph.env.compiled._changes import Changes, StaticPatterns, blocks_of, calls_of, plan_of
from envgraph.env.compiled._facts import Facts, Module
from envgraph.env.compiled._inlining import inlined
from envgraph.env.compiled._layout import (
    NOBODY,
    ONE,
    RI,
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
from envgraph.env.compiled._refused import NotCompiled, standing
from envgraph.env.compiled._tables import Bound, IndexOf, Keyed, Seats
from envgraph.env.compiled._terms import Term, named
from envgraph.env.compiled._tidying import tidied
from envgraph.env.compiled._turn import ACTED, END, NOTHING, TOTAL, Turn, Writer
from envgraph.errors import Span
from envgraph.match.plan import CallGraph, LiveSizes, Planner
from envgraph.metamodel import Attribute, EnumType, Scalar
from envgraph.pattern import ObjectType, StaticType, check_expression
from envgraph.rewrite import Engine
from envgraph.rewrite.plans import Increase, RulePlan, SetValue

ENTRIES: Final = ("begin", "step_one", "may_one", "look", "places")
"""The functions of a program that `_kernels` calls."""
SELF, ACTION = code.Local("self", "object"), code.Local("a", "int")
SEEN, NEXT, INDEX = code.Local("C"), code.Local("j", "int"), code.Local("index", "int")
"""What is seen, by component; the number of the next one; and the index that they make."""


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
            if key and not self._changes.created.isdisjoint(self._indexable(cls)):
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
        weights = [prod(shape[:place]) for place in range(len(shape))]
        self._facts_of_observations = self._layout.offset(Constants("components", (len(shape), *weights)))
        turns = [self._turn(number, block, numbered[number], names) for number, block in enumerate(blocks)]
        may = [self._may(number, block, numbered[number], names) for number, block in enumerate(blocks)]
        looks = [self._look(number, block, len(blocks)) for number, block in enumerate(blocks)]
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
            domains = [self._domain(domain) for _, domain in action.parameters]
            for values in product(*domains):
                shown = ", ".join(text for text, _ in values)
                name = f"{action.name}({shown})" if values else action.name
                found.append(_Numbered(name, clause, tuple(number for _, number in values)))
        return found

    def _domain(self, domain: Domain) -> list[tuple[str, int]]:
        """How each value of a domain reads, and the number for it: of objects the index."""
        match domain_type(domain, self._metamodel):
            case ObjectType(cls):
                keys = self._keys.of_class(cls)
                return [(", ".join(map(str, key)), index) for index, key in enumerate(keys)]
            case EnumType() as enum:
                rank = ranks(enum)
                return [(literal, rank[literal]) for literal in enum.literals]
            case _:
                return [(str(number), number) for number in range(domain.low, domain.high + 1)]

    def _parameters(self, writer: Writer, action: Action, first: code.Expression) -> dict[str, Term]:
        """What the parameters of an action stand for."""
        scope = {}
        for place, (name, domain) in enumerate(action.parameters, 1):
            type_: StaticType = domain_type(domain, self._metamodel) or Scalar.INT
            number: code.Expression = entry(L, plus(first, place))
            local = writer.facts.local(type_)
            if isinstance(type_, ObjectType):
                keyed = self._layout.offset(Keyed(type_.cls, self._candidates(type_.cls)))
                writer.assign(local, table(plus(keyed, number)))
                self._unless_instance(writer, local, type_.cls)
            else:
                writer.assign(local, number)
            present = (code.Operation(">=", (local, ZERO)),) if isinstance(type_, ObjectType) else ()
            scope[name] = replace(named(local, type_), present=present)
        return scope

    def _unless_instance(self, writer: Writer, local: code.Local, cls: str) -> None:
        """An object that is not of a class is none."""
        if not self._changes.fixed_class(cls):
            there = code.Operation(">=", (local, ZERO))
            is_instance = self._facts.is_instance(local, cls)
            gone = code.Operation("and", (there, code.inverse(is_instance)))
            writer.add(code.If(gone, (code.Assign(local, NOBODY),)))

    def _candidates(self, cls: str) -> tuple[str, ...]:
        """The classes of the objects that are of a class, or may become so."""
        found: dict[str, None] = {}
        for one in self._metamodel.concrete(cls):
            found.update(dict.fromkeys(self._changes.group_of(one) or (one,)))
        return tuple(found)

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

    def _observations(self, block: Agent | None) -> list[tuple[Observation, Types]]:
        _, shared, own = self._scope(block)
        mine = block.observations if block is not None else ()
        return together(mine, own, self._behaviour.observations, shared)

    def _shape(self, block: Agent | None) -> list[int]:
        """How many values each component of a block has."""
        found: list[int] = []
        for observation, types in self._observations(block):
            if isinstance(observation, ObserveFind):
                found.append(2 if observation.up_to is None else observation.up_to + 1)
                continue
            each = observation.each
            times = 1 if each is None else self._keys.size(each.type or "")
            found += [self._size(observation, types)] * times
        return found

    def _size(self, observation: ObserveObject | ObserveRange | ObserveAttribute, types: Types) -> int:
        match observation:
            case ObserveObject(among=among, or_none=or_none):
                return self._keys.size(among) + or_none
            case ObserveRange(low=low, high=high):
                return high - low + 1
            case _:
                type_ = self._path_type(observation, types)
                return len(type_.literals) if isinstance(type_, EnumType) else 2

    def _path_type(self, observation: ObserveAttribute, types: Types) -> StaticType | None:
        scope: dict[str, StaticType | None] = {name: ObjectType(cls) for name, cls in types.items()}
        if observation.each is not None:
            scope[observation.each.name] = ObjectType(observation.each.type or "")
        return check_expression(observation.path, scope, self._metamodel)[0]

    def _look(self, number: int, block: Agent | None, blocks: int) -> str:
        scope, _, _ = self._scope(block)
        with self._module.writing():
            writer = Writer(self._matching, self._engine, self._behaviour.name, code.Return(ZERO))
            writer.assign(NEXT, ZERO)
            writer.assign(INDEX, ZERO)
            if blocks > 1:
                self._see(writer, code.Constant(number))
            for observation, types in self._observations(block):
                with standing(observation.span):
                    if isinstance(observation, ObserveFind):
                        self._see_matches(writer, observation, types, scope)
                    else:
                        self._see_path(writer, observation, types, scope)
            padding = writer.module.fresh("i")
            rest = code.Assign(entry(SEEN, padding), ZERO)
            last = entry(L, self._facts_of_observations)
            writer.add(code.For(padding, code.call("range", NEXT, last), (rest,)))
            writer.add(code.Return(INDEX))
            return self._module.add("look", (SELF, SEEN), writer.written())

    def _see(self, writer: Writer, value: code.Expression) -> None:
        weight = entry(L, plus(self._facts_of_observations, 1, NEXT))
        writer.add(code.Assign(entry(SEEN, NEXT), value))
        writer.add(code.Assign(INDEX, code.Operation("*", (value, weight)), "+="))
        writer.add(code.Assign(NEXT, ONE, "+="))

    def _see_matches(
        self, writer: Writer, observation: ObserveFind, types: Types, scope: Mapping[str, Term]
    ) -> None:
        local, name = writer.module.fresh("seen"), self._behaviour.name
        writer.assign(local, ZERO)
        if observation.up_to is None:
            question = added(self._engine, name, lambda n: condition_question(n, observation.call, types))
            values = [scope[bound].value for bound in question.bound]
            exists = writer.call(self._matching.exists(writer.key(question, free=False)), *values)
            found: code.Body = (code.Assign(local, code.Choice(exists, ONE, ZERO)),)
        else:
            question = added(self._engine, name, lambda n: count_question(n, observation.call, types))
            values = [scope[bound].value for bound in question.bound]
            rows = writer.call(self._matching.rows(writer.key(question)), *values)
            counted = entry(RI, writer.top, 0)
            most = code.call("min", counted, code.Constant(observation.up_to))
            some = code.Operation(">", (rows, ZERO))
            found = (code.If(some, (code.Assign(local, most),)),)
        alive = writer.bound_alive(question, scope)
        writer.add(*([code.If(code.joined("and", alive, True), found)] if alive else found))
        self._see(writer, local)

    def _see_path(
        self,
        writer: Writer,
        observation: ObserveObject | ObserveRange | ObserveAttribute,
        types: Types,
        scope: Mapping[str, Term],
    ) -> None:
        each = observation.each
        if each is None:
            root = root_of(observation.path).name
            gone = writer.gone(scope[root], types[root])
            self._see_value(writer, observation, scope, gone)
            return
        cls = each.type or ""
        index, node = writer.module.fresh("i"), writer.facts.local(ObjectType(cls))
        keyed = self._layout.offset(Keyed(cls, self._candidates(cls)))

        def write() -> None:
            writer.assign(node, table(plus(keyed, index)))
            self._unless_instance(writer, node, cls)
            gone = code.Operation("<", (node, ZERO))
            self._see_value(
                writer, observation, {**scope, each.name: named(node, ObjectType(cls), cls)}, gone
            )

        count = Constants(("keys", cls), (self._keys.size(cls),))
        size = entry(L, self._layout.offset(count))
        writer.add(code.For(index, code.call("range", size), writer.collected(write)))

    def _see_value(
        self,
        writer: Writer,
        observation: ObserveObject | ObserveRange | ObserveAttribute,
        scope: Mapping[str, Term],
        gone: code.Expression | None,
    ) -> None:
        """The index of what a path leads to, or the padding where it begins nowhere."""
        local = writer.module.fresh("seen")
        padding: code.Expression = ZERO
        missing: code.Body = writer.fail()
        if isinstance(observation, ObserveObject) and observation.or_none:
            count = Constants(("keys", observation.among), (self._keys.size(observation.among),))
            padding = entry(L, self._layout.offset(count))
            missing = (code.Assign(local, padding),)

        def read() -> None:
            term = writer.value(observation.path, scope)
            found = writer.collected(lambda: self._index(writer, observation, term, local, missing))
            if term.tests:
                found = (code.If(code.joined("and", term.tests, True), found, missing),)
            writer.add(*found)

        if gone is None:
            read()
        else:
            writer.add(code.If(gone, (code.Assign(local, padding),), writer.collected(read)))
        self._see(writer, local)

    def _index(
        self,
        writer: Writer,
        observation: ObserveObject | ObserveRange | ObserveAttribute,
        term: Term,
        local: code.Local,
        missing: code.Body,
    ) -> None:
        match observation:
            case ObserveObject(among=among):
                assert isinstance(term.type, ObjectType), "the behaviour was checked"
                node = writer.facts.local(term.type)
                writer.assign(node, term.value)
                indices = self._layout.offset(IndexOf(among, self._indexable(among)))
                found: code.Body = (
                    code.Assign(local, table(plus(indices, node))),
                    code.If(code.Operation("<", (local, ZERO)), writer.fail()),
                )
                if not self._metamodel.covers(among, term.type.cls):
                    found = (code.If(self._facts.is_instance(node, among), found, missing),)
                writer.add(*found)
            case ObserveRange(low=low, high=high):
                clipped = code.call(
                    "min", code.call("max", term.value, code.Constant(low)), code.Constant(high)
                )
                writer.assign(local, code.Operation("-", (clipped, code.Constant(low))))
            case _:
                writer.assign(local, _literal_index(term, self._layout))

    def _indexable(self, cls: str) -> tuple[str, ...]:
        """The classes of the objects that have the key of a class."""
        key = key_attributes(self._metamodel, cls)
        concrete = [one.name for one in self._metamodel.class_list if not one.abstract]
        return tuple(
            one
            for one in concrete
            if self._metamodel.is_a(one, cls)
            or (key and all(self._metamodel.is_a(one, attribute.owner) for attribute in key))
        )


def _literal_index(term: Term, layout: Layout) -> code.Expression:
    """Code for the place of a literal in its enum; those of other types are what they are."""
    if not isinstance(term.type, EnumType):
        return term.number
    literals = term.type.literals
    if list(literals) == sorted(literals):
        return term.value
    places = tuple(literals.index(literal) for literal in sorted(literals))
    offset = layout.offset(Constants(("places", term.type.name), places))
    return entry(L, plus(offset, term.value))


def _set_at(plans: Sequence[RulePlan], attribute: Attribute) -> Span | None:
    """Where a rule sets an attribute."""
    sets = (change for plan in plans for body in blocks_of(plan.body) for change in body.sets)
    kinds = (SetValue, Increase)
    return next((one.span for one in sets if isinstance(one, kinds) and one.attribute == attribute), None)


def _names(numbered: Sequence[Sequence[_Numbered]]) -> tuple[str, ...]:
    """The names of everybody's actions, in the order of the blocks."""
    return tuple(dict.fromkeys(one.name for each in numbered for one in each))
