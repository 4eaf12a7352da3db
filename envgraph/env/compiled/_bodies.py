"""Emit the search plans of the engine as loops over arrays: a few statements for each step of a body."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from envgraph import code
from envgraph.env.compiled._aggregates import aggregated
from envgraph.env.compiled._facts import WordOf
from envgraph.env.compiled._inlining import names_in
from envgraph.env.compiled._layout import ONE, RI, TOP, call, entry, failed, plus
from envgraph.env.compiled._refused import NotCompiled
from envgraph.env.compiled._tables import Keys, Links, Matches, Reached, Relation
from envgraph.env.compiled._terms import Term, Terms, as_float, literal, named
from envgraph.match.plan import Kind, Plan, Step, ViewKey, call_key
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

if TYPE_CHECKING:
    from envgraph.env.compiled._matching import Matching

CAPACITY = code.Name("CAPACITY")

Found = Callable[["Body"], None]
"""Emits the code that runs for a solution."""


class Body:
    """An emitter of the steps of one search plan.

    Attributes:
        block: receives the statements.
        looped: the variables bound by loops, from the outermost; -1 for a loop that binds no variable, and before the
            variables of a loop that does not yield ascending values.
        word: the bit set word that holds many solutions at once, or None. Its objects are values of the last variable.
    """

    def __init__(
        self, matching: Matching, conjunction: Conjunction, block: code.Block, *, words: bool = False
    ) -> None:
        self.matching = matching
        self.facts = matching.facts
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

    def called(self, name: str, values: Sequence[code.Expression]) -> code.Call:
        """Return a call of an emitted function, and record the call. Its rows begin behind those of this body."""
        self.matching.module.uses(name, self._levels)
        return call(name, *values, top=self._top)

    def take_space(self, top: code.Local) -> None:
        """Reserve the next region of the row buffers for this body, and emit code that sets `top` to its first row."""
        self.block.add(code.Assign(top, plus(self._top, CAPACITY)))
        self._top, self._levels = top, self._levels + 1
        self.matching.module.needs(self._levels + 1)

    def values(self, key: ViewKey) -> list[code.Expression]:
        """Return the expressions of the values at the output positions of a view key."""
        return [self.source(self.conjunction.parameters[position]) for position in key.outputs]

    def in_order(self, key: ViewKey) -> bool:
        """Return True if the emitted loops find the rows of a view key's outputs in ascending order."""
        known = 0
        for position in key.outputs:
            variable = self.conjunction.parameters[position]
            if known < len(self.looped) and self.looped[known] == variable:
                known += 1
            elif self._depth.get(variable, 0) > known:
                return False
        return True

    def begin(self, key: ViewKey, given: Sequence[code.Expression], sure: bool) -> None:
        """Bind the parameters of a pattern to `given` values at the bound positions of a view key.

        Two values of the same variable are compared. With `sure`, objects are known to be of the parameters' classes.
        """
        types = self.facts.library.parameter_types(key.pattern)
        for position, value in zip(key.bound, given, strict=True):
            variable = self.conjunction.parameters[position]
            if self.known(variable):
                self.block.test(code.equal(self.source(variable), value))
            else:
                self._names[variable] = value
            type_ = types[position]
            if sure and isinstance(type_, ObjectType) and self.facts.changes.fixed_class(type_.cls):
                self._learn(variable, type_)

    def source(self, variable: int) -> code.Expression:
        """Return the expression for the number that represents the value of a bound or constant variable."""
        if variable not in self._names:
            value = self._constants[variable]
            self._names[variable] = literal(self.facts, value, self.conjunction.types[variable]).number
        return self._names[variable]

    def known(self, variable: int) -> bool:
        """Return True if a variable is bound or has a constant value."""
        return variable in self._names or variable in self._constants

    def _is_sure(self, variable: int, cls: str) -> bool:
        """Return True if a variable's object is known to be of a class, from earlier goals or from the caller."""
        is_a = self.facts.metamodel.is_a
        return any(is_a(known, cls) for known in self._sure.get(variable, ()))

    def _learn(self, variable: int, type_: StaticType) -> None:
        if isinstance(type_, ObjectType):
            self._sure.setdefault(variable, set()).add(type_.cls)

    def steps(self, steps: Sequence[Step], found: Found) -> None:
        """Emit the steps of a plan. `found` emits the code that runs for each solution.

        Raises:
            NotCompiled: the steps have too many nested loops.
        """
        todo = list(steps)
        while todo:
            if self.block.full:
                raise NotCompiled("a pattern or condition with too many nested loops")
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
                searched = isinstance(step.goal, ClosureAtom) and not self.static(step.goal)
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
                if step.kind is Kind.TEST and (free := self.free(goal)):
                    whole = Plan((replace(step, kind=Kind.LOOP, binds=tuple(free)),), step.rows, step.cost)
                    if not self.static(goal):
                        self.block.test(self._existence(whole))
                        return
                self._solve(goal, step)

    def free(self, goal: Goal) -> list[int]:
        """Return the variables of a goal that have no value yet; none for goals that only test or compute."""
        if isinstance(goal, Condition | Valuation | UnequalAtom | Absence | AggregateAtom):
            return []
        return [v for v in dict.fromkeys(arguments(goal)) if not self.known(v)]

    def _existence(self, plan: Plan) -> code.Expression:
        """Emit a function that tests if a plan has a solution, and return the call of the function."""
        if not plan.steps:
            return code.TRUE
        *first, last = plan.steps
        if isinstance(last.goal, CallAtom) and len(set(last.goal.arguments)) == len(last.goal.arguments):
            last = replace(last, binds=())  # Existence does not depend on the values found.
        return self.inside(lambda body: body.steps([*first, last], found_one), code.FALSE)

    def inside(self, write: Callable[[Body], None], last: code.Expression, head: code.Body = ()) -> code.Call:
        """Emit a separate function for a part of this body, and return the call of the function.

        Args:
            write: emits the statements of the part.
            last: the expression that the function returns at its end.
            head: statements before the part.
        """
        body = Body(self.matching, self.conjunction, code.Block())
        body._sure = {variable: {*classes} for variable, classes in self._sure.items()}
        known = [v for v, value in self._names.items() if isinstance(value, code.Local)]
        parameters = {v: self.facts.local(self.conjunction.types[v]) for v in known}
        body._names = {**self._names, **parameters}
        with self.matching.module.writing():
            write(body)
            whole = (*head, *body.block.body(), code.Return(last))
            read = names_in(whole)
            used = [v for v in parameters if parameters[v].name in read]
            name = self.matching.module.add("some", [parameters[v] for v in used], whole)
        return self.called(name, [self._names[v] for v in used])

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
                    self.block.add(code.If(term.beyond, (failed("BEYOND"),)))
                number = as_float(term) if is_float else term.number
                self.give(result, number)
            case AggregateAtom():
                aggregated(self, goal, step)
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
        terms = Terms(self.facts, names)
        term = terms.write(expression, expected)
        if terms.steps:
            self.block.add(*terms.steps)
        return term

    def give(self, variable: int, value: code.Expression) -> None:
        """Emit code that binds a variable to a value, or a test for equality if the variable has a value already."""
        if self.known(variable):
            self.block.test(code.equal(self.source(variable), value))
        elif isinstance(value, code.Local):
            self._names[variable] = value
        else:
            local = self.facts.local(self.conjunction.types[variable])
            self.block.add(code.Assign(local, value))
            self._names[variable] = local

    def static(self, goal: Goal) -> bool:
        """Return True if rules cannot change the relation that a goal asks for. It is then stored as a table."""
        match goal:
            case CallAtom(pattern) | ClosureAtom(pattern):
                return pattern in self.matching.static
            case _:
                return self.matching.static.goal(goal)

    def _look_up(self, goal: Goal, step: Step) -> None:
        """Emit code that finds the rows of a static table that agree with the bound variables, and binds the others."""
        relation, variables = _relation(goal), _arguments(goal)
        bound = {p: self.source(v) for p, v in enumerate(variables) if self.known(v)}
        wanted: dict[int, int] = {}
        for position, variable in enumerate(variables):
            twice = variables.count(variable) > 1
            if position not in bound and (variable in step.binds or twice):
                wanted[position] = variable
        found = self.facts.look_up(self.block, relation, bound, list(wanted))
        for position, variable in wanted.items():
            self.give(variable, found[position])
        self._learn_all(goal)

    def _learn_all(self, goal: Goal) -> None:
        """Record that the objects of a static goal are of the classes that its relation implies."""
        for variable, type_ in zip(_arguments(goal), _relation(goal).types(self.facts.library), strict=True):
            self._learn(variable, type_)

    def _instance(self, goal: InstanceAtom) -> None:
        cls, variable = goal.cls, goal.variable
        if self.known(variable):
            if not self._is_sure(variable, cls) or goal.exact:
                self.block.test(self.facts.is_instance(self.source(variable), cls, goal.exact))
        else:
            self._names[variable] = self.facts.instances(self.block, cls, goal.exact)
        self._learn(variable, ObjectType(cls))

    def _attribute(self, attribute: Attribute, owner: int, value: int) -> None:
        sure = self._is_sure(owner, attribute.owner)
        found = self.facts.value(attribute, self.source(owner), sure=sure)
        if self.known(value):
            self.block.test(code.equal(found, self.source(value)))
        else:
            local = self.facts.local(attribute.type)
            self.block.add(code.Assign(local, found))
            self.block.test(self.facts.present(local, attribute.type))
            self._names[value] = local
        self._learn(owner, ObjectType(attribute.owner))

    # --- links

    def _link(self, goal: LinkAtom, step: Step) -> None:
        reference, source, target = goal.reference, goal.source, goal.target
        if isinstance(reference, Attribute) or self.facts.changes.fixed_feature(reference):
            if isinstance(reference, Attribute) and not self.facts.changes.fixed_feature(reference):
                raise NotCompiled(f"a rule that changes a multi-valued attribute (`{reference}`)")
            self._look_up(goal, step)
            return
        links, forward = self.facts.links, self.known(source)
        sure = self._is_sure(source, reference.owner), self._is_sure(target, reference.target)
        if forward and self.known(target):
            kept = links.cell(reference, self.source(source), self.source(target), sure=sure)
            for test in kept.tests:
                self.block.test(test)
        else:
            near, far = (source, target) if forward else (target, source)
            own = sure[not forward]
            found = links.follow(self.block, reference, self.source(near), forward=forward, sure=own)
            self.give(far, found)
        self._learn(source, ObjectType(reference.owner))
        self._learn(target, ObjectType(reference.target))

    # --- calls

    def _call(self, goal: CallAtom | ClosureAtom, step: Step) -> None:
        if self.static(goal):
            self._look_up(goal, step)
            return
        if isinstance(goal, ClosureAtom):
            self._closure(goal)
            return
        bound = {v for v in goal.arguments if self.known(v)}
        key = call_key(goal, bound, step.binds)
        values = [self.source(goal.arguments[position]) for position in key.bound]
        types = self.facts.library.parameter_types(goal.pattern)
        if not key.outputs:
            self.block.test(self.called(self.matching.exists(key, self.suits(goal, key)), values))
        else:
            self._loop_rows(goal, key, values)
        for variable, type_ in zip(goal.arguments, types, strict=True):
            if self.known(variable):
                self._learn(variable, type_)

    def _closure(self, goal: ClosureAtom) -> None:
        """Emit a search along a closure's steps from its source (from its target if only this has a value).

        It binds or tests the other end. If neither end has a value, the code first loops over all possible sources.
        """
        types = self.facts.library.parameter_types(goal.step)
        assert isinstance(types[0], ObjectType)
        if not self.known(goal.source) and not self.known(goal.target):
            self._names[goal.source] = self.facts.instances(self.block, types[0].cls)
        forward = self.known(goal.source)
        start, end = (goal.source, goal.target) if forward else (goal.target, goal.source)
        name = self.matching.search(goal.step, goal.closure is Closure.STAR, forward)
        number, top = self.matching.module.fresh("n"), self.matching.module.fresh("t")
        self.take_space(top)
        self.block.add(code.Assign(number, self.called(name, [self.source(start)])))
        if self.known(end):
            self.block.test(
                code.equal(entry(RI, plus(top, self.source(end)), 1), ONE)
            )  # nonzero if the search reached the object
        else:
            place, found = self.matching.module.fresh("i"), self.facts.local(types[forward])
            self.block.loop(place, code.call("range", number))
            self.block.add(code.Assign(found, entry(RI, plus(top, place), 0)))
            self.give(end, found)
        for variable, type_ in zip((goal.source, goal.target), types, strict=True):
            self._learn(variable, type_)

    def _loop_rows(self, goal: CallAtom, key: ViewKey, values: Sequence[code.Expression]) -> None:
        """Emit a call that stores the rows of a called pattern, and a loop that binds the variables to each row."""
        fresh = self.matching.module.fresh
        number, row, top = fresh("n"), fresh("i"), fresh("t")
        self.take_space(top)
        self.block.add(
            code.Assign(number, self.called(self.matching.rows(key, self.suits(goal, key)), values))
        )
        self.block.loop(row, code.call("range", number))
        loads, values = self.matching.loaded(key, plus(top, row))
        self.block.add(*loads)
        for position, value in zip(key.outputs, values, strict=True):
            self.give(goal.arguments[position], value)

    def suits(self, goal: CallAtom, key: ViewKey) -> bool:
        """Return True if the bound objects of a call are known to be of the classes of its parameters."""
        types = self.facts.library.parameter_types(goal.pattern)
        given = [(goal.arguments[position], types[position]) for position in key.bound]
        return all(self._is_sure(v, type_.cls) for v, type_ in given if isinstance(type_, ObjectType))


def _loops_over_sets(body: Body, step: Step) -> bool:
    """Return True if a step loops over all objects of a class whose objects are stored as bit sets."""
    goal = step.goal
    return (
        step.kind is Kind.LOOP
        and isinstance(goal, InstanceAtom)
        and not body.known(goal.variable)
        and body.facts.sets(goal.cls, goal.exact) is not None
    )


def _among(body: Body, step: Step, following: Step) -> tuple[Keys, int, code.Expression] | None:
    """Return the bit set of the objects that a table relates, if the next step tests them with bit sets of their class.

    The two steps then become one loop over the bits of both sets. Returns None if this is not possible.
    """
    goal, test = step.goal, following.goal
    if not (
        step.kind is Kind.LOOP
        and following.kind is Kind.TEST
        and isinstance(goal, LinkAtom | CallAtom | ClosureAtom)
        and isinstance(test, InstanceAtom)
        and step.binds == (test.variable,)
        and body.static(goal)
        and body.facts.sets(test.cls, test.exact) is not None
    ):
        return None
    variables = _arguments(goal)
    if variables.count(test.variable) > 1:
        return None
    bound = {p: body.source(v) for p, v in enumerate(variables) if body.known(v)}
    return body.facts.related(_relation(goal), bound, variables.index(test.variable))


def _in_sets(
    body: Body, goal: InstanceAtom, within: tuple[Keys, int, code.Expression] | None, *, last: bool
) -> None:
    """Emit a loop over the objects of a class that is stored as bit sets, restricted to the bit set `within` if given.

    If this is the last step and `body` finds solutions a word at a time, the loop is only over words.
    """
    sets = body.facts.sets(goal.cls, goal.exact)
    assert sets is not None
    word = body.facts.words(body.block, sets, within)
    body._learn(goal.variable, ObjectType(goal.cls))
    if last and body._words:
        body.word = word
        body._names[goal.variable] = body.facts.local(ObjectType(goal.cls))
    else:
        body._names[goal.variable] = body.facts.each_in(body.block, word)


def do_with_nth(body: Body, number: code.Local, then: Callable[[], code.Body]) -> None:
    """Emit code that runs statements for the solution with an index; the statements must end with a return.

    Args:
        body: finds solutions a word at a time.
        number: variable with the index, from 0. The code subtracts the number of solutions of each word that it passes.
        then: returns the statements.
    """
    assert body.word is not None
    here = body.matching.module.fresh("n")
    body.block.add(code.Assign(here, code.call("count_bits", body.word.word)))
    node = body._names[body.looped[-1]]
    assert isinstance(node, code.Local)
    chosen = code.Assign(node, body.facts.nth_of(body.word, number))
    body.block.add(code.If(code.Operation("<", (number, here)), (chosen, *then())))
    body.block.add(code.Assign(number, here, "-="))


def _relation(goal: Goal) -> Relation:
    """Return the table to read for a link, call or closure that never changes."""
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


def found_one(body: Body) -> None:
    body.block.add(code.Return(code.TRUE))
