"""Plans of the engine as loops over arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from enum import Enum, auto

from envgraph import code
from envgraph.code import dataclass
from envgraph.env.compiled._changes import StaticPatterns
from envgraph.env.compiled._facts import Facts, WordOf, call
from envgraph.env.compiled._layout import BEYOND, RF, RI, TOP, D, entry, failed, plus
from envgraph.env.compiled._refused import NotCompiled, standing
from envgraph.env.compiled._tables import Keys, Links, Matches, Reached, Relation
from envgraph.env.compiled._terms import Term, Terms, as_float, literal, named
from envgraph.match.plan import CallGraph, Kind, Plan, Planner, Step, Unplannable, ViewKey, ViewPlan, call_key
from envgraph.metamodel import Attribute, Scalar
from envgraph.pattern import (
    Absence,
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    Closure,
    ClosureAtom,
    Condition,
    Conjunction,
    Expression,
    Goal,
    InstanceAtom,
    LinkAtom,
    ObjectType,
    StaticType,
    UnequalAtom,
    Valuation,
    arguments,
)

CAPACITY = code.Name("CAPACITY")
COUNT = code.Local("n", "int")
OVERFLOW = code.Name("OVERFLOW")

Found = Callable[["_Body"], None]
"""Writes what is done with a solution."""


@dataclass(frozen=True, slots=True)
class RowsOf:
    """Asks for the different values at some positions, of the matches with values at others.

    Attributes:
        sure: whether the objects given are certainly of the classes of the parameters.
    """

    key: ViewKey
    sure: bool


@dataclass(frozen=True, slots=True)
class Exists:
    """Asks whether there is a match with values at some positions."""

    key: ViewKey
    sure: bool


@dataclass(frozen=True, slots=True)
class CountOf:
    """Asks for the number of different values at some positions."""

    key: ViewKey
    sure: bool


class Shape(Enum):
    """How rows are found: without a loop, so that there is one at most; as the bits of words, in order; otherwise."""

    ONE = auto()
    WORDS = auto()
    ROWS = auto()


class Matching:
    """Writes functions that find matches.

    Args:
        facts: reads the model.
        planner: plans of the views.
        static: patterns that are tables.
        calls: which patterns call which.
    """

    def __init__(self, facts: Facts, planner: Planner, static: StaticPatterns, calls: CallGraph) -> None:
        self.facts = facts
        self.module = facts.module
        self.planner = planner
        self.static = static
        self.calls = calls
        self._shapes: dict[RowsOf, Shape] = {}

    def rows(self, key: ViewKey, sure: bool = True) -> str:
        """The function that writes rows from `top` on, sorted, each once, and returns their number."""
        return self._function(RowsOf(key, sure), "rows", self._rows)

    def exists(self, key: ViewKey, sure: bool = True) -> str:
        """The function that says whether there is a match."""
        return self._function(Exists(key, sure), "exists", self._exists)

    def count(self, key: ViewKey, sure: bool = True) -> str:
        """The function that counts rows."""
        return self._function(CountOf(key, sure), "count", self._count)

    def chosen(
        self,
        key: ViewKey,
        given: Sequence[code.Local],
        then: Callable[[Sequence[code.Expression]], code.Body],
        nothing: code.Return,
    ) -> code.Body:
        """The body of a function that picks a row, and does something with its values.

        Args:
            key: says which rows.
            given: the values at the bound positions.
            then: what is done; it ends with a return.
            nothing: what is returned where there is no row.
        """
        shape = self._shape(key, True)
        number, row = self.module.fresh("n"), self.module.fresh("k")
        if shape is Shape.ONE:
            found = self._bodies(key, given, True, lambda body: body.block.add(*then(body.values(key))))
            return (*found, nothing)
        if shape is Shape.WORDS:
            return (
                *self._counted(key, given, True, number),
                code.If(code.equal(number, code.Constant(0)), (nothing,)),
                code.Assign(row, code.call("pick", D, number)),
                *self._bodies(
                    key,
                    given,
                    True,
                    lambda body: _do_with_nth(body, row, lambda: then(body.values(key))),
                    words=True,
                ),
                nothing,
            )
        loads, values = self.loaded(key, row)
        return (
            *self._collected(key, given, True, number),
            code.If(code.equal(number, code.Constant(0)), (nothing,)),
            code.Assign(row, plus(TOP, code.call("pick", D, number))),
            *loads,
            *then(values),
        )

    def loaded(self, key: ViewKey, row: code.Expression) -> tuple[code.Body, list[code.Local]]:
        """Statements that read a row into variables, and these."""
        found = [self.facts.local(type_) for type_ in self.types(key)]
        places = self._places(key, row)
        return tuple(code.Assign(local, place) for local, place in zip(found, places, strict=True)), found

    def _places(self, key: ViewKey, row: code.Expression) -> list[code.Index]:
        """Where the values of a row are."""
        types = self.types(key)
        self.module.width = max(self.module.width, len(types))
        spaces = [RF if type_ is Scalar.FLOAT else RI for type_ in types]
        return [entry(space, row, column) for column, space in enumerate(spaces)]

    def types(self, key: ViewKey) -> list[StaticType]:
        """Types of the columns of rows."""
        types = self.facts.library.parameter_types(key.pattern)
        return [types[position] for position in key.outputs]

    def _function(
        self,
        question: RowsOf | Exists | CountOf,
        prefix: str,
        write: Callable[[ViewKey, Sequence[code.Local], bool], code.Body],
    ) -> str:
        name = self.module.named(question)
        if name is None:
            key = question.key
            given = [self.facts.local(type_) for type_ in self._given(key)]
            with standing(self.facts.library.get(key.pattern).span), self.module.writing():
                self._check_recursion(key.pattern)
                name = self.module.keep(
                    question, self.module.add(prefix, given, write(key, given, question.sure))
                )
        return name

    def _bodies(
        self, key: ViewKey, given: Sequence[code.Local], sure: bool, found: Found, *, words: bool = False
    ) -> code.Body:
        block = code.Block()
        for each in self._view(key).bodies:
            body = _Body(self, each.conjunction, block, words=words)
            place = block.place
            body.begin(key, given, sure)
            body.steps(each.plan.steps, found)
            block.back_to(place)
        return block.body()

    def _check_recursion(self, pattern: str) -> None:
        if self.calls.recursive(pattern):
            raise NotCompiled(f"recursion over what changes (`{pattern}`)")

    def _view(self, key: ViewKey) -> ViewPlan:
        try:
            return self.planner.view(key)
        except Unplannable:
            raise NotCompiled(f"`{key.pattern}`, asked without its inputs") from None

    def _shape(self, key: ViewKey, sure: bool) -> Shape:
        """How rows are found."""
        question = RowsOf(key, sure)
        if question not in self._shapes:
            bodies: list[_Body] = []
            with self.module.trial():
                given = [self.facts.local(type_) for type_ in self._given(key)]
                self._bodies(key, given, sure, bodies.append, words=True)
            shape, (first, *others) = Shape.ROWS, bodies
            if not others and not first.looped:
                shape = Shape.ONE
            elif not others and first.word is not None and first.in_order(key) and self._view(key).distinct:
                shape = Shape.WORDS
            self._shapes[question] = shape
        return self._shapes[question]

    def _counted(
        self, key: ViewKey, given: Sequence[code.Local], sure: bool, number: code.Local
    ) -> code.Body:
        """Statements that count rows of which none is repeated."""
        counted = self._bodies(key, given, sure, lambda body: _count_solutions(body, number), words=True)
        return (code.Assign(number, code.Constant(0)), *counted)

    def _given(self, key: ViewKey) -> list[StaticType]:
        types = self.facts.library.parameter_types(key.pattern)
        return [types[position] for position in key.bound]

    def _stored(self, body: _Body, key: ViewKey, row: code.Expression) -> code.Body:
        """Statements that write a row."""
        places = zip(self._places(key, row), body.values(key), strict=True)
        return tuple(code.Assign(place, value) for place, value in places)

    def _collected(
        self, key: ViewKey, given: Sequence[code.Local], sure: bool, number: code.Local
    ) -> code.Body:
        """Statements that write rows, sorted, and their number."""
        view, types = self._view(key), self.types(key)
        ordered = view.distinct and len(view.bodies) == 1

        def write(body: _Body) -> None:
            nonlocal ordered
            ordered = ordered and body.in_order(key)
            room = code.Operation("<", (number, CAPACITY))
            stores = self._stored(body, key, plus(TOP, number))
            more = (*stores, code.Assign(number, code.Constant(1), "+="))
            body.block.add(code.If(room, more, (failed(OVERFLOW),)))

        whole = (code.Assign(number, code.Constant(0)), *self._bodies(key, given, sure, write))
        if not types:
            return (*whole, code.Assign(number, code.call("min", number, code.Constant(1))))
        if ordered:
            return whole
        kinds = sum(1 << column for column, type_ in enumerate(types) if type_ is Scalar.FLOAT)
        numbers = (len(types), kinds, 0 if view.distinct else 1)
        in_order = code.call("sort_rows", RI, RF, TOP, number, *map(code.Constant, numbers))
        return (*whole, code.Assign(number, in_order))

    def _rows(self, key: ViewKey, given: Sequence[code.Local], sure: bool) -> code.Body:
        if self._shape(key, sure) is not Shape.ONE:
            return (*self._collected(key, given, sure, COUNT), code.Return(COUNT))

        def write(body: _Body) -> None:
            body.block.add(*self._stored(body, key, TOP), code.Return(code.Constant(1)))

        return (*self._bodies(key, given, sure, write), code.Return(code.Constant(0)))

    def search(self, step: str, star: bool, forward: bool) -> str:
        """The function that searches breadth first along a binary pattern, and returns how many objects it has found.

        From `top` on they stand in column 0, in the order in which they were found; column 1 marks them by number.
        """
        key = step, star, forward
        name = self.module.named(key)
        if name is None:
            self._check_recursion(step)
            with self.module.writing():
                start = self.module.fresh("v", "object")
                body = self._search(step, star, forward, start)
                name = self.module.keep(key, self.module.add("search", [start], body))
        return name

    def _search(self, step: str, star: bool, forward: bool, start: code.Local) -> code.Body:
        near, far = (0, 1) if forward else (1, 0)
        rows = self.rows(ViewKey(step, (near,), (far,)), sure=False)
        self.module.uses(rows, 1)
        self.module.width = max(self.module.width, 2)
        zero, one = code.Constant(0), code.Constant(1)
        fresh = self.module.fresh
        above, node, head, going = (fresh(prefix) for prefix in "tvhg")
        number, row, other, stride = (fresh(prefix) for prefix in "nivs")

        def column(place: code.Expression, which: code.Expression) -> code.Index:
            return entry(RI, plus(TOP, place), which)

        def mark(found: code.Expression) -> code.Body:
            stored = code.Assign(column(found, one), one), code.Assign(column(COUNT, zero), found)
            return (*stored, code.Assign(COUNT, one, "+="))

        new = code.equal(column(other, one), zero)
        read = code.Assign(other, entry(RI, plus(above, row), zero))
        each = code.For(row, code.call("range", number), (read, code.If(new, mark(other))))
        follow = code.Assign(node, column(head, zero)), code.Assign(head, one, "+=")
        more = code.If(code.Operation("<", (head, COUNT)), follow, (code.Assign(going, zero),))
        found = code.Assign(number, call(rows, node, top=above))
        whole: list[code.Statement] = [
            code.Assign(COUNT, zero),
            code.Assign(stride, self.facts.layout.stride()),
            code.If(code.Operation(">", (stride, CAPACITY)), (failed(OVERFLOW), code.Return(zero))),
            code.For(row, code.call("range", stride), (code.Assign(column(row, one), zero),)),
            code.Assign(above, plus(TOP, CAPACITY)),
            code.Assign(node, start),
            code.Assign(head, zero),
            code.Assign(going, one),
            code.While(code.equal(going, one), (found, each, more)),
        ]
        if star:
            type_ = self.facts.library.parameter_types(step)[0]
            assert isinstance(type_, ObjectType)
            itself = code.equal(column(start, one), zero), self.facts.is_instance(start, type_.cls)
            whole.append(code.If(code.Operation("and", itself), mark(start)))
        return (*whole, code.Return(COUNT))

    def _exists(self, key: ViewKey, given: Sequence[code.Local], sure: bool) -> code.Body:
        found = self._bodies(key, given, sure, _found_one)
        return (*found, code.Return(code.FALSE))

    def _count(self, key: ViewKey, given: Sequence[code.Local], sure: bool) -> code.Body:
        if not (self._view(key).distinct or self._shape(key, sure) is Shape.ONE):
            name = self.rows(key, sure)
            self.module.uses(name, 1)
            return (code.Return(call(name, *given, top=plus(TOP, CAPACITY))),)
        return (*self._counted(key, given, sure, COUNT), code.Return(COUNT))


def _marked(top: code.Expression, node: code.Expression) -> code.Expression:
    """Code for whether a search has found an object."""
    return code.equal(entry(RI, plus(top, node), 1), code.Constant(1))


class _Body:
    """Writes the steps of one plan.

    Attributes:
        block: where they go.
        looped: the variables that get their values from loops, from the outermost on; -1 for a loop without one, and
            before those that come in another order than the ascending one.
        word: if solutions are found a word at a time, that word; its objects are the values of the last variable.
    """

    def __init__(
        self, matching: Matching, conjunction: Conjunction, block: code.Block, *, words: bool = False
    ) -> None:
        self._matching = matching
        self._facts = matching.facts
        self.conjunction = conjunction
        self.block = block
        self._constants = dict(conjunction.constants)
        self._names: dict[int, code.Expression] = {}
        self._sure: dict[int, set[str]] = {}
        self.looped: list[int] = []
        self.word: WordOf | None = None
        self._words = words
        self._depth: dict[int, int] = {}
        self._top: code.Expression = TOP
        self._levels = 0

    def _called(self, name: str, values: Sequence[code.Expression]) -> code.Call:
        """Code for a call of a function, which may use the space behind the rows that are read here."""
        self._matching.module.uses(name, self._levels)
        return call(name, *values, top=self._top)

    def values(self, key: ViewKey) -> list[code.Expression]:
        """The values at the positions that are asked for."""
        return [self.source(self.conjunction.parameters[position]) for position in key.outputs]

    def in_order(self, key: ViewKey) -> bool:
        """Whether rows are found in ascending order: every loop is ascending."""
        known = 0
        for position in key.outputs:
            variable = self.conjunction.parameters[position]
            if known < len(self.looped) and self.looped[known] == variable:
                known += 1
            elif self._depth.get(variable, 0) > known:
                return False
        return True

    def begin(self, key: ViewKey, given: Sequence[code.Expression], sure: bool) -> None:
        """Give variables the values at the bound positions; `sure` if objects are of the classes of the parameters."""
        types = self._facts.library.parameter_types(key.pattern)
        for position, value in zip(key.bound, given, strict=True):
            variable = self.conjunction.parameters[position]
            if self._known(variable):
                self.block.test(code.equal(self.source(variable), value))
            else:
                self._names[variable] = value
            type_ = types[position]
            if sure and isinstance(type_, ObjectType) and self._facts.changes.fixed_class(type_.cls):
                self._learn(variable, type_)

    def source(self, variable: int) -> code.Expression:
        """Code for the number of a variable's value."""
        if variable not in self._names:
            value = self._constants[variable]
            self._names[variable] = literal(self._facts, value, self.conjunction.types[variable]).number
        return self._names[variable]

    def _known(self, variable: int) -> bool:
        return variable in self._names or variable in self._constants

    def _is_sure(self, variable: int, cls: str) -> bool:
        """Whether an object is certainly of a class, by what has been asked so far."""
        is_a = self._facts.metamodel.is_a
        return any(is_a(known, cls) for known in self._sure.get(variable, ()))

    def _learn(self, variable: int, type_: StaticType) -> None:
        if isinstance(type_, ObjectType):
            self._sure.setdefault(variable, set()).add(type_.cls)

    def steps(self, steps: Sequence[Step], found: Found) -> None:
        """Write steps, and what is done with each solution."""
        todo = list(steps)
        while todo:
            if self.block.full:
                raise NotCompiled("too many loops inside each other")
            loops, known = self.block.loops, {*self._names}
            step = todo.pop(0)
            goal = step.goal
            within = _among(self, step, todo[0]) if todo else None
            if within is not None:
                self._learn_all(goal)
                goal = todo.pop(0).goal
            if within is not None or (self._words and not todo and _loops_over_sets(self, step)):
                assert isinstance(goal, InstanceAtom)
                _in_sets(self, goal, within, last=not todo)
            else:
                self._step(step)
            new = [v for v in self._names if v not in known and v not in self._constants]
            if self.block.loops > loops:
                searched = isinstance(step.goal, ClosureAtom) and not self._static(step.goal)
                self.looped += [-1, *new] if searched or not new else new
            self._depth.update((variable, len(self.looped)) for variable in new)
        found(self)

    def _step(self, step: Step) -> None:
        goal = step.goal
        match step.kind:
            case Kind.ABSENT:
                for plan in step.inner:
                    self.block.test(code.inverse(self._existence(plan)))
            case Kind.EXISTS:
                self.block.test(self._existence(step.inner[0]))
            case _:
                if step.kind is Kind.TEST and (free := self._free(goal)):
                    whole = Plan((replace(step, kind=Kind.LOOP, binds=tuple(free)),), step.rows, step.cost)
                    if not self._static(goal):
                        self.block.test(self._existence(whole))
                        return
                self._solve(goal, step)

    def _free(self, goal: Goal) -> list[int]:
        if isinstance(goal, Condition | Valuation | UnequalAtom | Absence | AggregateAtom):
            return []
        return [v for v in dict.fromkeys(arguments(goal)) if not self._known(v)]

    def _existence(self, plan: Plan) -> code.Expression:
        """Whether a plan has a solution: the call of a function."""
        if not plan.steps:
            return code.TRUE
        *first, last = plan.steps
        if isinstance(last.goal, CallAtom) and len(set(last.goal.arguments)) == len(last.goal.arguments):
            last = replace(last, binds=())  # which values it has makes no difference
        return self._inside(lambda body: body.steps([*first, last], _found_one), code.FALSE)

    def _inside(
        self, write: Callable[[_Body], None], last: code.Expression, head: code.Body = ()
    ) -> code.Call:
        """A function for a part of this body; the call of it."""
        body = _Body(self._matching, self.conjunction, code.Block())
        body._sure = {variable: {*classes} for variable, classes in self._sure.items()}
        known = [v for v, value in self._names.items() if isinstance(value, code.Local)]
        parameters = {v: self._facts.local(self.conjunction.types[v]) for v in known}
        body._names = {**self._names, **parameters}
        with self._matching.module.writing():
            return self._written(body, write, parameters, last, head)

    def _written(
        self,
        body: _Body,
        write: Callable[[_Body], None],
        parameters: dict[int, code.Local],
        last: code.Expression,
        head: code.Body,
    ) -> code.Call:
        write(body)
        whole = (*head, *body.block.body(), code.Return(last))
        read = _names_in(whole)
        used = [v for v in parameters if parameters[v].name in read]
        name = self._matching.module.add("some", [parameters[v] for v in used], whole)
        return self._called(name, [self._names[v] for v in used])

    # --- goals

    def _solve(self, goal: Goal, step: Step) -> None:
        match goal:
            case UnequalAtom(left, right):
                self.block.test(code.Operation("!=", (self.source(left), self.source(right))))
            case Condition(expression, reads):
                term = self._term(expression, reads, Scalar.BOOL)
                for test in (*term.tests, term.value):
                    self.block.test(test)
            case Valuation(expression, reads, result):
                term = self._term(expression, reads, self.conjunction.types[result])
                for test in term.tests:
                    self.block.test(test)
                is_float = self.conjunction.types[result] is Scalar.FLOAT
                if term.beyond is not None and not is_float:
                    self.block.add(code.If(term.beyond, (failed(BEYOND),)))
                number = as_float(term) if is_float else term.number
                self._give(result, number)
            case AggregateAtom():
                self._aggregate(goal, step)
            case InstanceAtom():
                self._instance(goal)
            case AttributeAtom(attribute, owner, value):
                self._attribute(attribute, owner, value)
            case LinkAtom():
                self._link(goal, step)
            case CallAtom() | ClosureAtom():
                self._call(goal, step)
            case _:
                raise AssertionError(goal)

    def _term(self, expression: Expression, reads: Sequence[tuple[str, int]], expected: StaticType) -> Term:
        names = {name: named(self.source(v), self.conjunction.types[v]) for name, v in reads}
        terms = Terms(self._facts, names)
        term = terms.write(expression, expected)
        if terms.steps:
            self.block.add(*terms.steps)
        return term

    def _give(self, variable: int, value: code.Expression) -> None:
        """A variable has a value: it gets it, or it had it before and they are equal."""
        if self._known(variable):
            self.block.test(code.equal(self.source(variable), value))
        elif isinstance(value, code.Local):
            self._names[variable] = value
        else:
            local = self._facts.local(self.conjunction.types[variable])
            self.block.add(code.Assign(local, value))
            self._names[variable] = local

    def _static(self, goal: Goal) -> bool:
        """Whether a relation is a table."""
        match goal:
            case CallAtom(pattern) | ClosureAtom(pattern):
                return pattern in self._matching.static
            case _:
                return self._matching.static.goal(goal)

    def _look_up(self, goal: Goal, step: Step) -> None:
        """Rows of a table: values of the variables that the step binds."""
        relation, variables = _relation(goal), _arguments(goal)
        bound = {p: self.source(v) for p, v in enumerate(variables) if self._known(v)}
        wanted: dict[int, int] = {}
        for position, variable in enumerate(variables):
            twice = variables.count(variable) > 1
            if position not in bound and (variable in step.binds or twice):
                wanted[position] = variable
        found = self._facts.look_up(self.block, relation, bound, list(wanted))
        for position, variable in wanted.items():
            self._give(variable, found[position])
        self._learn_all(goal)

    def _learn_all(self, goal: Goal) -> None:
        """The classes of the objects in a row of a table."""
        for variable, type_ in zip(_arguments(goal), _relation(goal).types(self._facts.library), strict=True):
            self._learn(variable, type_)

    def _instance(self, goal: InstanceAtom) -> None:
        cls, variable = goal.cls, goal.variable
        if self._known(variable):
            if not self._is_sure(variable, cls) or goal.exact:
                self.block.test(self._facts.is_instance(self.source(variable), cls, goal.exact))
        else:
            self._names[variable] = self._facts.instances(self.block, cls, goal.exact)
        self._learn(variable, ObjectType(cls))

    def _attribute(self, attribute: Attribute, owner: int, value: int) -> None:
        sure = self._is_sure(owner, attribute.owner)
        found = self._facts.value(attribute, self.source(owner), sure=sure)
        if self._known(value):
            self.block.test(code.equal(found, self.source(value)))
        else:
            local = self._facts.local(attribute.type)
            self.block.add(code.Assign(local, found))
            self.block.test(self._facts.present(local, attribute.type))
            self._names[value] = local
        self._learn(owner, ObjectType(attribute.owner))

    # --- links

    def _link(self, goal: LinkAtom, step: Step) -> None:
        reference, source, target = goal.reference, goal.source, goal.target
        if isinstance(reference, Attribute) or self._facts.changes.fixed_feature(reference):
            if isinstance(reference, Attribute) and not self._facts.changes.fixed_feature(reference):
                raise NotCompiled(f"many values that change (`{reference}`)")
            self._look_up(goal, step)
            return
        forward = self._known(source)
        near, far = (source, target) if forward else (target, source)
        sure = self._is_sure(near, reference.owner if forward else reference.target)
        self._follow(goal, near, far, forward, sure)
        self._learn(source, ObjectType(reference.owner))
        self._learn(target, ObjectType(reference.target))

    def _follow(self, goal: LinkAtom, near: int, far: int, forward: bool, sure: bool) -> None:
        """From one end of a link that changes to the other."""
        assert not isinstance(goal.reference, Attribute)
        facts, reference = self._facts, goal.reference
        stored, same = facts.stored(reference)
        at_near = stored.at_source is (forward is same)
        if self._known(near) and self._known(far):
            holder, other = (near, far) if at_near else (far, near)
            end = reference.owner if (stored.at_source is same) else reference.target
            held, guard = facts.link_cell(stored, self.source(holder), sure=self._is_sure(holder, end))
            for test in guard:
                self.block.test(test)
            self.block.test(code.equal(held, self.source(other)))
        elif self._known(near):
            found = facts.other_end(reference, self.source(near), forward=forward, sure=sure)
            if found is None:
                self._give(far, facts.holding(self.block, stored, self.source(near)))
            else:
                local = facts.local(self.conjunction.types[far])
                self.block.add(code.Assign(local, found))
                self.block.test(facts.present(local, ObjectType("")))
                self._give(far, local)
        else:
            raise AssertionError(goal)

    # --- calls

    def _call(self, goal: CallAtom | ClosureAtom, step: Step) -> None:
        if self._static(goal):
            self._look_up(goal, step)
            return
        if isinstance(goal, ClosureAtom):
            self._closure(goal)
            return
        bound = {v for v in goal.arguments if self._known(v)}
        key = call_key(goal, bound, step.binds)
        values = [self.source(goal.arguments[position]) for position in key.bound]
        types = self._facts.library.parameter_types(goal.pattern)
        if not key.outputs:
            self.block.test(self._called(self._matching.exists(key, _suits(self, goal, key)), values))
        else:
            self._loop_rows(goal, key, values)
        for variable, type_ in zip(goal.arguments, types, strict=True):
            if self._known(variable):
                self._learn(variable, type_)

    def _closure(self, goal: ClosureAtom) -> None:
        """Search along the steps from an end that has a value; if neither has, from every source."""
        types = self._facts.library.parameter_types(goal.step)
        assert isinstance(types[0], ObjectType)
        if not self._known(goal.source) and not self._known(goal.target):
            self._names[goal.source] = self._facts.instances(self.block, types[0].cls)
        forward = self._known(goal.source)
        start, end = (goal.source, goal.target) if forward else (goal.target, goal.source)
        name = self._matching.search(goal.step, goal.closure is Closure.STAR, forward)
        number, top = self._matching.module.fresh("n"), self._matching.module.fresh("t")
        self.block.add(code.Assign(top, plus(self._top, CAPACITY)))
        self._top, self._levels = top, self._levels + 1
        self.block.add(code.Assign(number, self._called(name, [self.source(start)])))
        if self._known(end):
            self.block.test(_marked(top, self.source(end)))
        else:
            place, found = self._matching.module.fresh("i"), self._facts.local(types[forward])
            self.block.loop(place, code.call("range", number))
            self.block.add(code.Assign(found, entry(RI, plus(top, place), 0)))
            self._give(end, found)
        for variable, type_ in zip((goal.source, goal.target), types, strict=True):
            self._learn(variable, type_)

    def _loop_rows(self, goal: CallAtom, key: ViewKey, values: Sequence[code.Expression]) -> None:
        """Loop over the rows of a call, which are written behind those of this function."""
        fresh = self._matching.module.fresh
        number, row, top = fresh("n"), fresh("i"), fresh("t")
        self.block.add(code.Assign(top, plus(self._top, CAPACITY)))
        self._top, self._levels = top, self._levels + 1
        self.block.add(
            code.Assign(number, self._called(self._matching.rows(key, _suits(self, goal, key)), values))
        )
        self.block.loop(row, code.call("range", number))
        loads, values = self._matching.loaded(key, plus(top, row))
        self.block.add(*loads)
        for position, value in zip(key.outputs, values, strict=True):
            self._give(goal.arguments[position], value)

    # --- aggregates

    def _aggregate(self, goal: AggregateAtom, step: Step) -> None:
        relation = goal.relation
        if goal.function == "count" and isinstance(relation, CallAtom) and not self._static(relation):
            free = [v for v in relation.arguments if not self._known(v)]
            key = call_key(relation, {v for v in relation.arguments if self._known(v)}, free)
            values = [self.source(relation.arguments[position]) for position in key.bound]
            self._give(
                goal.result, self._called(self._matching.count(key, _suits(self, relation, key)), values)
            )
            return
        head = (code.Assign(COUNT, code.Constant(0)),)
        plan = step.inner[0]
        steps = plan.steps
        if len(steps) == 1 and steps[0].kind is Kind.TEST:
            steps = (replace(steps[0], kind=Kind.LOOP, binds=tuple(self._free(relation))),)
        if goal.column is None:
            counted = self._inside(
                lambda body: body.steps(steps, lambda body: _count_solutions(body, COUNT)), COUNT, head
            )
            self._give(goal.result, counted)
        else:
            self._fold(goal, goal.column, steps)

    def _fold(self, goal: AggregateAtom, column: int, steps: Sequence[Step]) -> None:
        """The sum, mean, least or greatest of a column of different tuples; without one there is only a sum."""
        type_ = self.conjunction.types[column]
        if type_ is Scalar.FLOAT and goal.function in ("sum", "avg"):
            raise NotCompiled(f"the aggregate `{goal.function}` of floats that change")
        folded = code.Local("folded", "float" if type_ is Scalar.FLOAT else "int")

        def found(body: _Body) -> None:
            value = body.source(column)
            if goal.function in ("sum", "avg"):
                body.block.add(code.Assign(folded, value, "+="))
            else:
                operator = "<" if goal.function == "min" else ">"
                first = code.equal(COUNT, code.Constant(0))
                better = code.Operation("or", (first, code.Operation(operator, (value, folded))))
                body.block.add(code.If(better, (code.Assign(folded, value),)))
            _count_solutions(body, COUNT)

        nothing: code.Expression = code.Constant(0.0 if type_ is Scalar.FLOAT else 0)
        head = (code.Assign(COUNT, code.Constant(0)), code.Assign(folded, nothing))
        whole = self._inside(lambda body: body.steps(steps, found), code.tuple_of(COUNT, folded), head)
        number, result = self._matching.module.fresh("n"), self._facts.local(type_)
        self.block.add(code.Assign(code.Tuple((number, result)), whole))
        if goal.function != "sum":
            self.block.test(code.Operation(">", (number, code.Constant(0))))
        value = code.Operation("/", (result, number)) if goal.function == "avg" else result
        self._give(goal.result, value)


def _loops_over_sets(body: _Body, step: Step) -> bool:
    """Whether a step loops over the objects of a class that are a union of sets."""
    goal = step.goal
    return (
        step.kind is Kind.LOOP
        and isinstance(goal, InstanceAtom)
        and not body._known(goal.variable)
        and body._facts.sets(goal.cls, goal.exact) is not None
    )


def _among(body: _Body, step: Step, following: Step) -> tuple[Keys, int, code.Expression] | None:
    """Where a loop over what a table relates is followed by a test for a class that is a set: what is related."""
    goal, test = step.goal, following.goal
    if not (
        step.kind is Kind.LOOP
        and following.kind is Kind.TEST
        and isinstance(goal, LinkAtom | CallAtom | ClosureAtom)
        and isinstance(test, InstanceAtom)
        and step.binds == (test.variable,)
        and body._static(goal)
        and body._facts.sets(test.cls, test.exact) is not None
    ):
        return None
    variables = _arguments(goal)
    if variables.count(test.variable) > 1:
        return None
    bound = {p: body.source(v) for p, v in enumerate(variables) if body._known(v)}
    return body._facts.related(_relation(goal), bound, variables.index(test.variable))


def _in_sets(
    body: _Body, goal: InstanceAtom, within: tuple[Keys, int, code.Expression] | None, *, last: bool
) -> None:
    """Loop over objects of a class that are a union of sets."""
    sets = body._facts.sets(goal.cls, goal.exact)
    assert sets is not None
    word = body._facts.words(body.block, sets, within)
    body._learn(goal.variable, ObjectType(goal.cls))
    if last and body._words:
        body.word = word
        body._names[goal.variable] = body._facts.local(ObjectType(goal.cls))
    else:
        body._names[goal.variable] = body._facts.each_in(body.block, word)


def _suits(body: _Body, goal: CallAtom, key: ViewKey) -> bool:
    """Whether the objects that a call is given are certainly of the classes of the parameters."""
    types = body._facts.library.parameter_types(goal.pattern)
    given = [(goal.arguments[position], types[position]) for position in key.bound]
    return all(body._is_sure(v, type_.cls) for v, type_ in given if isinstance(type_, ObjectType))


def _count_solutions(body: _Body, number: code.Local) -> None:
    """Count the solution, or those of the word."""
    one = code.Constant(1) if body.word is None else code.call("count_bits", body.word.word)
    body.block.add(code.Assign(number, one, "+="))


def _do_with_nth(body: _Body, number: code.Local, then: Callable[[], code.Body]) -> None:
    """Do something with the solution that has a number; what stands there ends with a return."""
    assert body.word is not None
    here = body._matching.module.fresh("n")
    body.block.add(code.Assign(here, code.call("count_bits", body.word.word)))
    node = body._names[body.looped[-1]]
    assert isinstance(node, code.Local)
    chosen = code.Assign(node, body._facts.nth_of(body.word, number))
    body.block.add(code.If(code.Operation("<", (number, here)), (chosen, *then())))
    body.block.add(code.Assign(number, here, "-="))


def _relation(goal: Goal) -> Relation:
    """What a goal that asks nothing that changes asks for."""
    match goal:
        case LinkAtom(reference):
            return Links(reference)
        case CallAtom(pattern):
            return Matches(pattern)
        case ClosureAtom():
            return Reached(goal.step, goal.closure is Closure.STAR)
    raise AssertionError(goal)


def _arguments(goal: Goal) -> tuple[int, ...]:
    match goal:
        case InstanceAtom() | LinkAtom() | CallAtom() | ClosureAtom():
            return arguments(goal)
    raise AssertionError(goal)


def _found_one(body: _Body) -> None:
    body.block.add(code.Return(code.TRUE))


def _names_in(node: object) -> set[str]:
    """Names of the local variables in some code."""
    found: set[str] = set()
    todo = [node]
    while todo:
        one = todo.pop()
        if isinstance(one, code.Local):
            found.add(one.name)
        elif isinstance(one, tuple):
            todo += one
        elif hasattr(one, "__slots__"):
            todo += [getattr(one, name) for name in one.__slots__ if name != "origin"]
    return found
