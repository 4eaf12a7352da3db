"""Emit the search plans of the engine as loops over arrays: a few statements for each step of a body."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from envgraph import code
from envgraph.env.compiled._aggregate_code import emit_aggregate
from envgraph.env.compiled._inlining import local_names
from envgraph.env.compiled._model_reading import SetWord
from envgraph.env.compiled._not_compiled import NotCompiled
from envgraph.env.compiled._program_layout import ONE, RI, TOP, emit_call, emit_entry, emit_sum
from envgraph.env.compiled._symbols import (
    ClosurePairs,
    FeatureRows,
    KeyColumns,
    PatternMatches,
    StaticRelation,
)
from envgraph.env.compiled._term_code import (
    CodeTerm,
    ExpressionEmitter,
    emit_as_float,
    emit_literal,
    variable_term,
)
from envgraph.match.plan import PatternQuery, PlanStep, SearchPlan, StepKind, query_of_call
from envgraph.metamodel import Attribute, Reference, Scalar
from envgraph.pattern import (
    AbsenceAtom,
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    Closure,
    ClosureAtom,
    ConditionAtom,
    Conjunction,
    Expression,
    Goal,
    InstanceAtom,
    LinkAtom,
    ObjectType,
    StaticType,
    UnequalAtom,
    ValuationAtom,
    relation_variables,
)

if TYPE_CHECKING:
    from envgraph.env.compiled._matching import MatchEmitter

CAPACITY = code.Name("CAPACITY")

OnSolution = Callable[["BodyEmitter"], None]
"""Emits the code that runs for a solution."""


class BodyEmitter:
    """An emitter of the steps of one search plan.

    Attributes:
        block: receives the statements.
        loop_variables: the variables bound by loops, from the outermost; -1 for a loop that binds no variable, and
            before the variables of a loop that does not yield ascending values.
        word: the bit set word that holds many solutions at once, or None. Its objects are values of the last variable.
    """

    def __init__(
        self,
        matching: MatchEmitter,
        conjunction: Conjunction,
        block: code.BodyBuilder,
        *,
        words: bool = False,
    ) -> None:
        self.matching = matching
        self.facts = matching.facts
        self.conjunction = conjunction
        self.block = block
        self._constants = dict(conjunction.constants)
        self._names: dict[int, code.Expression] = {}
        self._known_classes: dict[int, set[str]] = {}
        self.loop_variables: list[int] = []
        self.word: SetWord | None = None
        self._words = words
        self._depth: dict[int, int] = {}
        self._top: code.Expression = TOP
        self._levels = 0

    def emit_call(self, name: str, values: Sequence[code.Expression]) -> code.Call:
        """Return a call of an emitted function, and record the call. Its rows begin behind those of this body."""
        self.matching.module.record_call(name, self._levels)
        return emit_call(name, *values, top=self._top)

    def reserve_rows(self, top: code.Local) -> None:
        """Reserve the next region of the row buffers for this body, and emit code that sets `top` to its first row."""
        self.block.add(code.Assign(top, emit_sum(self._top, CAPACITY)))
        self._top, self._levels = top, self._levels + 1
        self.matching.module.record_levels(self._levels + 1)

    def output_values(self, key: PatternQuery) -> list[code.Expression]:
        """Return the expressions of the values at the output positions of a view key."""
        return [self.value_of(self.conjunction.parameters[position]) for position in key.outputs]

    def is_ascending(self, key: PatternQuery) -> bool:
        """Return True if the emitted loops find the rows of a view key's outputs in ascending order."""
        known = 0
        for position in key.outputs:
            variable = self.conjunction.parameters[position]
            if known < len(self.loop_variables) and self.loop_variables[known] == variable:
                known += 1
            elif self._depth.get(variable, 0) > known:
                return False
        return True

    def bind_inputs(self, key: PatternQuery, given: Sequence[code.Expression], classes_known: bool) -> None:
        """Bind the parameters of a pattern to `given` values at the bound positions of a view key.

        Two values of the same variable are compared. With `classes_known`, objects are known to be of the parameters'
        classes.
        """
        types = self.facts.library.parameter_types(key.pattern)
        for position, value in zip(key.bound, given, strict=True):
            variable = self.conjunction.parameters[position]
            if self.is_bound(variable):
                self.block.open_test(code.emit_equal(self.value_of(variable), value))
            else:
                self._names[variable] = value
            type_ = types[position]
            if classes_known and isinstance(type_, ObjectType) and self.facts.changes.is_fixed_class(type_.cls):
                self._record_class(variable, type_)

    def value_of(self, variable: int) -> code.Expression:
        """Return the expression for the number that represents the value of a bound or constant variable."""
        if variable not in self._names:
            value = self._constants[variable]
            self._names[variable] = emit_literal(self.facts, value, self.conjunction.types[variable]).number_code
        return self._names[variable]

    def is_bound(self, variable: int) -> bool:
        """Return True if a variable is bound or has a constant value."""
        return variable in self._names or variable in self._constants

    def _is_known_instance(self, variable: int, cls: str) -> bool:
        """Return True if a variable's object is known to be of a class, from earlier goals or from the caller."""
        is_a = self.facts.metamodel.is_a
        return any(is_a(known, cls) for known in self._known_classes.get(variable, ()))

    def _record_class(self, variable: int, type_: StaticType) -> None:
        if isinstance(type_, ObjectType):
            self._known_classes.setdefault(variable, set()).add(type_.cls)

    def emit_steps(self, steps: Sequence[PlanStep], on_solution: OnSolution) -> None:
        """Emit the steps of a plan. `on_solution` emits the code that runs for each solution.

        Raises:
            NotCompiled: the steps have too many nested loops.
        """
        todo = list(steps)
        while todo:
            if self.block.is_full:
                raise NotCompiled("a pattern or condition with too many nested loops")
            loops, known = self.block.loop_count, {*self._names}
            step = todo.pop(0)
            goal = step.goal
            within = _related_set(self, step, todo[0]) if todo else None
            if within is not None:
                self._record_classes(goal)
                goal = todo.pop(0).goal
            if within is not None or (self._words and not todo and _is_set_loop(self, step)):
                assert isinstance(goal, InstanceAtom)
                _emit_set_loop(self, goal, within, last=not todo)
            else:
                self._emit_step(step)
            new = [v for v in self._names if v not in known and v not in self._constants]
            if self.block.loop_count > loops:
                searched = isinstance(step.goal, ClosureAtom) and not self.is_static(step.goal)
                self.loop_variables += [-1, *new] if searched or not new else new
            self._depth.update((variable, len(self.loop_variables)) for variable in new)
        on_solution(self)

    def _emit_step(self, step: PlanStep) -> None:
        goal = step.goal
        match step.kind:
            case StepKind.ABSENT:
                for plan in step.inner:
                    self.block.open_test(code.emit_not(self._emit_existence(plan)))
            case StepKind.EXISTS:
                self.block.open_test(self._emit_existence(step.inner[0]))
            case _:
                if step.kind is StepKind.TEST and (free := self.unbound_variables(goal)):
                    whole = SearchPlan((replace(step, kind=StepKind.LOOP, binds=tuple(free)),), step.rows, step.cost)
                    if not self.is_static(goal):
                        self.block.open_test(self._emit_existence(whole))
                        return
                self._emit_goal(goal, step)

    def unbound_variables(self, goal: Goal) -> list[int]:
        """Return the variables of a goal that have no value yet; none for goals that only test or compute."""
        if isinstance(goal, ConditionAtom | ValuationAtom | UnequalAtom | AbsenceAtom | AggregateAtom):
            return []
        return [v for v in dict.fromkeys(relation_variables(goal)) if not self.is_bound(v)]

    def _emit_existence(self, plan: SearchPlan) -> code.Expression:
        """Emit a function that tests if a plan has a solution, and return the call of the function."""
        if not plan.steps:
            return code.TRUE
        *first, last = plan.steps
        if isinstance(last.goal, CallAtom) and len(set(last.goal.arguments)) == len(last.goal.arguments):
            last = replace(last, binds=())  # Existence does not depend on the values found.
        return self.emit_function(lambda body: body.emit_steps([*first, last], emit_return_true), code.FALSE)

    def emit_function(
        self, write: Callable[[BodyEmitter], None], last: code.Expression, head: code.Body = ()
    ) -> code.Call:
        """Emit a separate function for a part of this body, and return the call of the function.

        Args:
            write: emits the statements of the part.
            last: the expression that the function returns at its end.
            head: statements before the part.
        """
        body = BodyEmitter(self.matching, self.conjunction, code.BodyBuilder())
        body._known_classes = {variable: {*classes} for variable, classes in self._known_classes.items()}
        known = [v for v, value in self._names.items() if isinstance(value, code.Local)]
        parameters = {v: self.facts.new_local_for(self.conjunction.types[v]) for v in known}
        body._names = {**self._names, **parameters}
        with self.matching.module.emitting_function():
            write(body)
            whole = (*head, *body.block.finish_body(), code.Return(last))
            read = local_names(whole)
            used = [v for v in parameters if parameters[v].name in read]
            name = self.matching.module.add_function("some", [parameters[v] for v in used], whole)
        return self.emit_call(name, [self._names[v] for v in used])

    # --- goals

    def _emit_goal(self, goal: Goal, step: PlanStep) -> None:
        match goal:
            case UnequalAtom(left, right):
                self.block.open_test(code.Operation("!=", (self.value_of(left), self.value_of(right))))
            case ConditionAtom(expression, reads):
                term = self._emit_term(expression, reads, Scalar.BOOL)
                for test in (*term.tests, term.value):
                    self.block.open_test(test)
            case ValuationAtom(expression, reads, result):
                term = self._emit_term(expression, reads, self.conjunction.types[result])
                for test in term.tests:
                    self.block.open_test(test)
                is_float = self.conjunction.types[result] is Scalar.FLOAT
                number = emit_as_float(term) if is_float else term.number_code
                self.bind_or_test(result, number)
            case AggregateAtom():
                emit_aggregate(self, goal, step)
            case InstanceAtom():
                self._emit_instance(goal)
            case AttributeAtom(attribute, owner, value):
                self._emit_attribute(attribute, owner, value)
            case LinkAtom():
                self._emit_link(goal, step)
            case CallAtom() | ClosureAtom():
                self._emit_relation_call(goal, step)
            case _:
                raise AssertionError(goal)

    def _emit_term(self, expression: Expression, reads: Sequence[tuple[str, int]], expected: StaticType) -> CodeTerm:
        names = {name: variable_term(self.value_of(v), self.conjunction.types[v]) for name, v in reads}
        terms = ExpressionEmitter(self.facts, names)
        term = terms.emit(expression, expected)
        if terms.statements:
            self.block.add(*terms.statements)
        return term

    def bind_or_test(self, variable: int, value: code.Expression) -> None:
        """Emit code that binds a variable to a value, or a test for equality if the variable has a value already."""
        if self.is_bound(variable):
            self.block.open_test(code.emit_equal(self.value_of(variable), value))
        elif isinstance(value, code.Local):
            self._names[variable] = value
        else:
            local = self.facts.new_local_for(self.conjunction.types[variable])
            self.block.add(code.Assign(local, value))
            self._names[variable] = local

    def is_static(self, goal: Goal) -> bool:
        """Return True if rules cannot change the relation that a goal asks for. It is then stored as a table."""
        match goal:
            case CallAtom(pattern) | ClosureAtom(pattern):
                return pattern in self.matching.static
            case _:
                return self.matching.static.is_static_goal(goal)

    def _emit_table_rows(self, goal: Goal, step: PlanStep) -> None:
        """Emit code that finds the rows of a static table that agree with the bound variables, and binds the others."""
        relation, variables = _static_relation(goal), _goal_arguments(goal)
        bound = {p: self.value_of(v) for p, v in enumerate(variables) if self.is_bound(v)}
        wanted: dict[int, int] = {}
        for position, variable in enumerate(variables):
            twice = variables.count(variable) > 1
            if position not in bound and (variable in step.binds or twice):
                wanted[position] = variable
        found = self.facts.emit_row_loop(self.block, relation, bound, list(wanted))
        for position, variable in wanted.items():
            self.bind_or_test(variable, found[position])
        self._record_classes(goal)

    def _record_classes(self, goal: Goal) -> None:
        """Record that the objects of a static goal are of the classes that its relation implies."""
        for variable, type_ in zip(
            _goal_arguments(goal), _static_relation(goal).column_types(self.facts.library), strict=True
        ):
            self._record_class(variable, type_)

    def _emit_instance(self, goal: InstanceAtom) -> None:
        cls, variable = goal.cls, goal.variable
        if self.is_bound(variable):
            if not self._is_known_instance(variable, cls) or goal.exact:
                self.block.open_test(self.facts.emit_is_instance(self.value_of(variable), cls, goal.exact))
        else:
            self._names[variable] = self.facts.emit_instance_loop(self.block, cls, goal.exact)
        self._record_class(variable, ObjectType(cls))

    def _emit_attribute(self, attribute: Attribute, owner: int, value: int) -> None:
        sure = self._is_known_instance(owner, attribute.owner)
        found = self.facts.emit_attribute_value(attribute, self.value_of(owner), class_known=sure)
        if self.is_bound(value):
            self.block.open_test(code.emit_equal(found, self.value_of(value)))
        else:
            local = self.facts.new_local_for(attribute.type)
            self.block.add(code.Assign(local, found))
            self.block.open_test(self.facts.emit_is_present(local, attribute.type))
            self._names[value] = local
        self._record_class(owner, ObjectType(attribute.owner))

    # --- links

    def _emit_link(self, goal: LinkAtom, step: PlanStep) -> None:
        reference, source, target = goal.reference, goal.source, goal.target
        fixed, held = self.facts.changes.is_fixed_feature(reference), self._is_known_instance(source, reference.owner)
        if fixed or (isinstance(reference, Attribute) and reference.index not in self.facts.changes.domains):
            self._emit_table_rows(goal, step)
            if not (fixed or held):  # the values do not change, but objects that have them are deleted
                self.block.open_test(self.facts.emit_is_instance(self.value_of(source), reference.owner))
            return
        links, forward = self.facts.links, self.is_bound(source)
        if isinstance(reference, Attribute) and not forward and not self.is_bound(target):
            self._names[source] = self.facts.emit_instance_loop(self.block, reference.owner)
            forward = held = True
        sure = held, isinstance(reference, Reference) and self._is_known_instance(target, reference.target)
        if forward and self.is_bound(target):
            kept = links.link_cell(reference, self.value_of(source), self.value_of(target), classes_known=sure)
            for test in kept.tests_linked:
                self.block.open_test(test)
        else:
            near, far = (source, target) if forward else (target, source)
            own = sure[not forward]
            found = links.emit_follow(self.block, reference, self.value_of(near), forward=forward, class_known=own)
            self.bind_or_test(far, found)
        self._record_class(source, ObjectType(reference.owner))
        if isinstance(reference, Reference):
            self._record_class(target, ObjectType(reference.target))

    # --- calls

    def _emit_relation_call(self, goal: CallAtom | ClosureAtom, step: PlanStep) -> None:
        if self.is_static(goal):
            self._emit_table_rows(goal, step)
            return
        if isinstance(goal, ClosureAtom):
            self._emit_closure(goal)
            return
        bound = {v for v in goal.arguments if self.is_bound(v)}
        key = query_of_call(goal, bound, step.binds)
        values = [self.value_of(goal.arguments[position]) for position in key.bound]
        types = self.facts.library.parameter_types(goal.pattern)
        if not key.outputs:
            self.block.open_test(self.emit_call(self.matching.emit_exists(key, self.arguments_fit(goal, key)), values))
        else:
            self._emit_row_loop(goal, key, values)
        for variable, type_ in zip(goal.arguments, types, strict=True):
            if self.is_bound(variable):
                self._record_class(variable, type_)

    def _emit_closure(self, goal: ClosureAtom) -> None:
        """Emit a search along a closure's steps from its source (from its target if only this has a value).

        It binds or tests the other end. If neither end has a value, the code first loops over all possible sources.
        """
        types = self.facts.library.parameter_types(goal.step)
        assert isinstance(types[0], ObjectType)
        if not self.is_bound(goal.source) and not self.is_bound(goal.target):
            self._names[goal.source] = self.facts.emit_instance_loop(self.block, types[0].cls)
        forward = self.is_bound(goal.source)
        start, end = (goal.source, goal.target) if forward else (goal.target, goal.source)
        name = self.matching.emit_search(goal.step, goal.closure is Closure.STAR, forward)
        number, top = self.matching.module.new_local("n"), self.matching.module.new_local("t")
        self.reserve_rows(top)
        self.block.add(code.Assign(number, self.emit_call(name, [self.value_of(start)])))
        if self.is_bound(end):
            self.block.open_test(
                code.emit_equal(emit_entry(RI, emit_sum(top, self.value_of(end)), 1), ONE)
            )  # nonzero if the search reached the object
        else:
            place, found = self.matching.module.new_local("i"), self.facts.new_local_for(types[forward])
            self.block.open_loop(place, code.emit_call("range", number))
            self.block.add(code.Assign(found, emit_entry(RI, emit_sum(top, place), 0)))
            self.bind_or_test(end, found)
        for variable, type_ in zip((goal.source, goal.target), types, strict=True):
            self._record_class(variable, type_)

    def _emit_row_loop(self, goal: CallAtom, key: PatternQuery, values: Sequence[code.Expression]) -> None:
        """Emit a call that stores the rows of a called pattern, and a loop that binds the variables to each row."""
        fresh = self.matching.module.new_local
        number, row, top = fresh("n"), fresh("i"), fresh("t")
        self.reserve_rows(top)
        self.block.add(
            code.Assign(number, self.emit_call(self.matching.emit_rows(key, self.arguments_fit(goal, key)), values))
        )
        self.block.open_loop(row, code.emit_call("range", number))
        loads, values = self.matching.load_row(key, emit_sum(top, row))
        self.block.add(*loads)
        for position, value in zip(key.outputs, values, strict=True):
            self.bind_or_test(goal.arguments[position], value)

    def arguments_fit(self, goal: CallAtom, key: PatternQuery) -> bool:
        """Return True if the bound objects of a call are known to be of the classes of its parameters."""
        types = self.facts.library.parameter_types(goal.pattern)
        given = [(goal.arguments[position], types[position]) for position in key.bound]
        return all(self._is_known_instance(v, type_.cls) for v, type_ in given if isinstance(type_, ObjectType))


def _is_set_loop(body: BodyEmitter, step: PlanStep) -> bool:
    """Return True if a step loops over all objects of a class whose objects are stored as bit sets."""
    goal = step.goal
    return (
        step.kind is StepKind.LOOP
        and isinstance(goal, InstanceAtom)
        and not body.is_bound(goal.variable)
        and body.facts.class_sets(goal.cls, goal.exact) is not None
    )


def _related_set(
    body: BodyEmitter, step: PlanStep, following: PlanStep
) -> tuple[KeyColumns, int, code.Expression] | None:
    """Return the bit set of the objects that a table relates, if the next step tests them with bit sets of their class.

    The two steps then become one loop over the bits of both sets. Returns None if this is not possible.
    """
    goal, test = step.goal, following.goal
    if not (
        step.kind is StepKind.LOOP
        and following.kind is StepKind.TEST
        and isinstance(goal, LinkAtom | CallAtom | ClosureAtom)
        and isinstance(test, InstanceAtom)
        and step.binds == (test.variable,)
        and body.is_static(goal)
        and body.facts.class_sets(test.cls, test.exact) is not None
    ):
        return None
    variables = _goal_arguments(goal)
    if variables.count(test.variable) > 1:
        return None
    bound = {p: body.value_of(v) for p, v in enumerate(variables) if body.is_bound(v)}
    return body.facts.related_set(_static_relation(goal), bound, variables.index(test.variable))


def _emit_set_loop(
    body: BodyEmitter,
    goal: InstanceAtom,
    within: tuple[KeyColumns, int, code.Expression] | None,
    *,
    last: bool,
) -> None:
    """Emit a loop over the objects of a class that is stored as bit sets, restricted to the bit set `within` if given.

    If this is the last step and `body` finds solutions a word at a time, the loop is only over words.
    """
    sets = body.facts.class_sets(goal.cls, goal.exact)
    assert sets is not None
    word = body.facts.emit_word_loop(body.block, sets, within)
    body._record_class(goal.variable, ObjectType(goal.cls))
    if last and body._words:
        body.word = word
        body._names[goal.variable] = body.facts.new_local_for(ObjectType(goal.cls))
    else:
        body._names[goal.variable] = body.facts.emit_bit_loop(body.block, word)


def emit_for_nth(body: BodyEmitter, number: code.Local, then: Callable[[], code.Body]) -> None:
    """Emit code that runs statements for the solution with an index; the statements must end with a return.

    Args:
        body: finds solutions a word at a time.
        number: variable with the index, from 0. The code subtracts the number of solutions of each word that it passes.
        then: returns the statements.
    """
    assert body.word is not None
    here = body.matching.module.new_local("n")
    body.block.add(code.Assign(here, code.emit_call("count_bits", body.word.word)))
    node = body._names[body.loop_variables[-1]]
    assert isinstance(node, code.Local)
    chosen = code.Assign(node, body.facts.emit_nth_object(body.word, number))
    body.block.add(code.If(code.Operation("<", (number, here)), (chosen, *then())))
    body.block.add(code.Assign(number, here, "-="))


def _static_relation(goal: Goal) -> StaticRelation:
    """Return the table to read for a link, call or closure that never changes."""
    match goal:
        case LinkAtom(reference):
            return FeatureRows(reference)
        case CallAtom(pattern):
            return PatternMatches(pattern)
        case ClosureAtom():
            return ClosurePairs(goal.step, goal.closure is Closure.STAR)
    raise AssertionError(goal)


def _goal_arguments(goal: Goal) -> tuple[int, ...]:
    match goal:
        case InstanceAtom() | LinkAtom() | CallAtom() | ClosureAtom():
            return relation_variables(goal)
    raise AssertionError(goal)


def emit_return_true(body: BodyEmitter) -> None:
    body.block.add(code.Return(code.TRUE))
