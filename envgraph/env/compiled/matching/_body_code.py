"""Emit the search plans of the engine as loops over arrays: a few statements for each step of a body."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from envgraph import code
from envgraph.env.compiled.layout._program_layout import ONE, RI, TOP, ZERO, emit_call, emit_entry, emit_sum
from envgraph.env.compiled.layout._relations import (
    ClosurePairs,
    FeatureRows,
    KeyColumns,
    PatternMatches,
    StaticRelation,
    column_types,
)
from envgraph.env.compiled.matching._aggregate_code import COUNT, emit_aggregate
from envgraph.env.compiled.matching._inlining import inlined_test, local_names
from envgraph.env.compiled.matching._model_reading import SetWord
from envgraph.env.compiled.matching._term_code import (
    CodeTerm,
    ExpressionEmitter,
    emit_as_float,
    emit_literal,
    variable_term,
)
from envgraph.match.generate import EXISTENCE, PlanTranslator, SolutionSink, VariableBindings, VariableCode
from envgraph.match.plan import PatternQuery, PlanStep, SearchPlan, StepKind, query_of_call
from envgraph.metamodel import Attribute, Reference, Scalar
from envgraph.pattern import (
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
    RelationAtom,
    StaticType,
    ValuationAtom,
    relation_variables,
)

if TYPE_CHECKING:
    from envgraph.env.compiled.matching._match_emitter import MatchEmitter

CAPACITY = code.Name("CAPACITY")


class BodyEmitter(PlanTranslator):
    """An emitter of the steps of one search plan, which asks arrays.

    Attributes:
        loop_variables: the variables bound by loops, from the outermost; -1 for a loop that binds no variable, and
            before the variables of a loop that does not yield ascending values.
        words: emits loops over bit sets; if `words`, the last loop is only over words.
    """

    def __init__(
        self,
        matching: MatchEmitter,
        conjunction: Conjunction,
        block: code.BodyBuilder,
        *,
        words: bool = False,
    ) -> None:
        literals = partial(emit_literal, matching.facts)
        bindings = VariableBindings(conjunction, lambda held, type_: literals(held, type_).number_code)
        super().__init__(conjunction, block, bindings)
        self.matching = matching
        self.facts = matching.facts
        self._known_classes: dict[int, set[str]] = {}
        self.loop_variables: list[int] = []
        self.words = WordLoops(self, words)
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

        With `classes_known`, objects are known to be of the parameters' classes.
        """
        self.bind_parameters(dict(zip(key.bound, given, strict=True)))
        types = self.facts.library.parameter_types(key.pattern)
        for position in key.bound if classes_known else ():
            type_ = types[position]
            if isinstance(type_, ObjectType) and self.facts.changes.is_fixed_class(type_.cls):
                self.record_class(self.conjunction.parameters[position], type_)

    def _is_known_instance(self, variable: int, cls: str) -> bool:
        """Return True if a variable's object is known to be of a class, from earlier goals or from the caller."""
        is_a = self.facts.metamodel.is_a
        return any(is_a(known, cls) for known in self._known_classes.get(variable, ()))

    def record_class(self, variable: int, type_: StaticType) -> None:
        if isinstance(type_, ObjectType):
            self._known_classes.setdefault(variable, set()).add(type_.cls)

    def emit_first(self, steps: Sequence[PlanStep], sink: SolutionSink) -> Sequence[PlanStep] | None:
        loops, known, is_full = self.block.loop_count, {*self.bindings.expressions}, self.block.is_full
        left = self._emit_rest(steps, sink) if is_full else self.words.emit_loop(steps)
        if left is None:
            left = super().emit_first(steps, sink)
        new = [v for v in self.bindings.expressions if v not in known and v not in self.bindings.constants]
        if self.block.loop_count > loops:
            goal = steps[0].goal
            searched = isinstance(goal, ClosureAtom) and not self.is_static(goal)
            self.loop_variables += [-1, *new] if is_full or searched or not new else new
        self._depth.update((variable, len(self.loop_variables)) for variable in new)
        return left

    def _emit_rest(self, steps: Sequence[PlanStep], sink: SolutionSink) -> Sequence[PlanStep]:
        """Emit a function for all steps, which would be nested too deep, and a loop over the rows that it stores."""
        outputs = [v for v in dict.fromkeys(sink.variables) if not self.is_bound(v)]
        types = [self.conjunction.types[v] for v in outputs]

        def emit_append(names: VariableCode) -> code.Body:
            return self.matching.append_row(types, [names(v) for v in outputs], COUNT)

        rows = SolutionSink(tuple(outputs), (code.Assign(COUNT, ZERO),), emit_append, (code.Return(COUNT),))
        self._emit_row_loop(lambda: self.emit_function_call(steps, rows), types, outputs)
        return ()

    def solve(self, step: PlanStep) -> None:
        free = self.unbound_variables(step.goal) if step.kind is StepKind.TEST else []
        if free and (isinstance(step.goal, InstanceAtom) or not self.is_static(step.goal)):
            whole = replace(step, kind=StepKind.LOOP, binds=tuple(free))
            self.block.open_test(self.emit_existence(SearchPlan((whole,), step.rows, step.cost)))
        else:
            super().solve(step)

    def unbound_variables(self, goal: Goal) -> list[int]:
        """Return the variables of a goal that have no value yet; none for goals that only test or compute."""
        variables = relation_variables(goal) if isinstance(goal, RelationAtom) else ()
        return [v for v in dict.fromkeys(variables) if not self.is_bound(v)]

    def emit_existence(self, plan: SearchPlan) -> code.Expression:
        """Return code that tests if a plan has a solution: an expression, or a call of a new function if that loops."""
        if not plan.steps:
            return code.TRUE
        *first, last = plan.steps
        if isinstance(last.goal, CallAtom) and len(set(last.goal.arguments)) == len(last.goal.arguments):
            last = replace(last, binds=())  # Existence does not depend on the values found.
        call, functions = self.emit_function_call([*first, last], EXISTENCE), self.matching.module.functions
        test = inlined_test(functions[-1], call)
        if test is None:
            return call
        functions.pop()
        return test

    def emit_function_call(
        self, steps: Sequence[PlanStep], sink: SolutionSink, space: code.Local | None = None
    ) -> code.Call:
        """Emit an inner function, which reserves rows from `space` on if this is given, and return a call of it."""
        body = BodyEmitter(self.matching, self.conjunction, code.BodyBuilder())
        body._known_classes = {variable: {*classes} for variable, classes in self._known_classes.items()}
        known = [v for v, value in self.bindings.expressions.items() if isinstance(value, code.Local)]
        parameters = {v: self.facts.new_local_for(self.conjunction.types[v]) for v in known}
        body.bindings.expressions = {**self.bindings.expressions, **parameters}
        with self.matching.module.emitting_function():
            if space is not None:
                body.reserve_rows(space)
            body.emit_steps(steps, sink)
            whole = (*sink.head, *body.block.finish_body(), *sink.tail)
            read = local_names(whole)
            used = [v for v in parameters if parameters[v].name in read]
            name = self.matching.module.add_function("some", [parameters[v] for v in used], whole)
        return self.emit_call(name, [self.bindings.expressions[v] for v in used])

    # --- goals

    def solve_condition(self, goal: ConditionAtom) -> None:
        term = self._emit_term(goal.expression, goal.reads, Scalar.BOOL)
        for test in (*term.tests, term.value):
            self.block.open_test(test)

    def solve_valuation(self, goal: ValuationAtom, step: PlanStep) -> None:
        type_ = self.conjunction.types[goal.result]
        term = self._emit_term(goal.expression, goal.reads, type_)
        for test in term.tests:
            self.block.open_test(test)
        self.bind_or_test(goal.result, emit_as_float(term) if type_ is Scalar.FLOAT else term.number_code)

    def solve_aggregate(self, goal: AggregateAtom, step: PlanStep) -> None:
        emit_aggregate(self, goal, step)

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
            self.bindings.expressions[variable] = value
        else:
            local = self.facts.new_local_for(self.conjunction.types[variable])
            self.block.add(code.Assign(local, value))
            self.bindings.expressions[variable] = local

    def is_static(self, goal: Goal) -> bool:
        """Return True if rules cannot change the relation that a goal asks for. It is then stored as a table."""
        match goal:
            case CallAtom(pattern) | ClosureAtom(pattern):
                return pattern in self.matching.static
            case _:
                return self.matching.static.is_static_goal(goal)

    def _emit_table_rows(self, goal: RelationAtom, step: PlanStep) -> None:
        """Emit code that finds the rows of a static table that agree with the bound variables, and binds the others."""
        relation, variables = static_relation(goal), relation_variables(goal)
        bound = {p: self.value_of(v) for p, v in enumerate(variables) if self.is_bound(v)}
        wanted: dict[int, int] = {}
        for position, variable in enumerate(variables):
            twice = variables.count(variable) > 1
            if position not in bound and (variable in step.binds or twice):
                wanted[position] = variable
        found = self.facts.emit_row_loop(self.block, relation, bound, list(wanted))
        for position, variable in wanted.items():
            self.bind_or_test(variable, found[position])
        self.record_classes(goal)

    def record_classes(self, goal: RelationAtom) -> None:
        """Record that the objects of a static goal are of the classes that its relation implies."""
        types = column_types(static_relation(goal), self.facts.library)
        for variable, type_ in zip(relation_variables(goal), types, strict=True):
            self.record_class(variable, type_)

    def solve_instance(self, goal: InstanceAtom, step: PlanStep) -> None:
        cls, variable = goal.cls, goal.variable
        if self.is_bound(variable):
            if not self._is_known_instance(variable, cls) or goal.exact:
                self.block.open_test(self.facts.emit_is_instance(self.value_of(variable), cls, goal.exact))
        else:
            self.bindings.expressions[variable] = self.facts.emit_instance_loop(self.block, cls, goal.exact)
        self.record_class(variable, ObjectType(cls))

    def solve_attribute(self, goal: AttributeAtom, step: PlanStep) -> None:
        attribute, owner, value = goal.attribute, goal.object, goal.value
        sure = self._is_known_instance(owner, attribute.owner)
        found = self.facts.emit_attribute_value(attribute, self.value_of(owner), class_known=sure)
        if self.is_bound(value):
            self.block.open_test(code.emit_equal(found, self.value_of(value)))
        else:
            local = self.facts.new_local_for(attribute.type)
            self.block.add(code.Assign(local, found))
            self.block.open_test(self.facts.emit_is_present(local, attribute.type))
            self.bindings.expressions[value] = local
        self.record_class(owner, ObjectType(attribute.owner))

    # --- links

    def solve_link(self, goal: LinkAtom, step: PlanStep) -> None:
        reference, source, target = goal.reference, goal.source, goal.target
        fixed, held = self.facts.changes.is_fixed_feature(reference), self._is_known_instance(source, reference.owner)
        if fixed or (isinstance(reference, Attribute) and reference.index not in self.facts.changes.domains):
            self._emit_table_rows(goal, step)
            if not (fixed or held):  # the values do not change, but objects that have them are deleted
                self.block.open_test(self.facts.emit_is_instance(self.value_of(source), reference.owner))
            return
        links, forward = self.facts.links, self.is_bound(source)
        if isinstance(reference, Attribute) and not forward and not self.is_bound(target):
            self.bindings.expressions[source] = self.facts.emit_instance_loop(self.block, reference.owner)
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
        self.record_class(source, ObjectType(reference.owner))
        if isinstance(reference, Reference):
            self.record_class(target, ObjectType(reference.target))

    # --- calls

    def solve_call(self, goal: CallAtom, step: PlanStep) -> None:
        if self.is_static(goal):
            self._emit_table_rows(goal, step)
            return
        bound = {v for v in goal.arguments if self.is_bound(v)}
        key = query_of_call(goal, bound, step.binds)
        values = [self.value_of(goal.arguments[position]) for position in key.bound]
        types = self.facts.library.parameter_types(goal.pattern)
        if not key.outputs:
            self.block.open_test(self.emit_call(self.matching.emit_exists(key, self.arguments_fit(goal, key)), values))
        else:
            rows = partial(self.matching.emit_rows, key, self.arguments_fit(goal, key))
            found = [goal.arguments[position] for position in key.outputs]
            self._emit_row_loop(lambda: self.emit_call(rows(), values), self.matching.column_types(key), found)
        for variable, type_ in zip(goal.arguments, types, strict=True):
            if self.is_bound(variable):
                self.record_class(variable, type_)

    def solve_closure(self, goal: ClosureAtom, step: PlanStep) -> None:
        """Emit a search along a closure's steps from its source (from its target if only this has a value).

        It binds or tests the other end. If neither end has a value, the code first loops over all possible sources.
        """
        if self.is_static(goal):
            self._emit_table_rows(goal, step)
            return
        types = self.facts.library.parameter_types(goal.step)
        assert isinstance(types[0], ObjectType)
        if not self.is_bound(goal.source) and not self.is_bound(goal.target):
            self.bindings.expressions[goal.source] = self.facts.emit_instance_loop(self.block, types[0].cls)
        forward = self.is_bound(goal.source)
        start, end = (goal.source, goal.target) if forward else (goal.target, goal.source)
        name = self.matching.emit_search(goal.step, goal.closure is Closure.STAR, forward)
        if self.is_bound(end):
            _, top = self._emit_rows(lambda: self.emit_call(name, [self.value_of(start)]))
            reached = emit_entry(RI, emit_sum(top, self.value_of(end)), 1)
            self.block.open_test(code.emit_equal(reached, ONE))
        else:
            self._emit_row_loop(lambda: self.emit_call(name, [self.value_of(start)]), [types[forward]], [end])
        for variable, type_ in zip((goal.source, goal.target), types, strict=True):
            self.record_class(variable, type_)

    def _emit_rows(self, call: Callable[[], code.Expression]) -> tuple[code.Local, code.Local]:
        """Emit a call that stores rows. Return the variables for the number of rows and the first of them."""
        number, top = self.matching.module.new_local("n"), self.matching.module.new_local("t")
        self.reserve_rows(top)
        self.block.add(code.Assign(number, call()))
        return number, top

    def _emit_row_loop(
        self, call: Callable[[], code.Expression], types: Sequence[StaticType], variables: Sequence[int]
    ) -> None:
        """Emit a call that stores rows of values of some types, and a loop that binds variables to each row."""
        number, top = self._emit_rows(call)
        row = self.matching.module.new_local("i")
        self.block.open_loop(row, code.emit_call("range", number))
        loads, values = self.matching.load_values(types, emit_sum(top, row))
        self.block.add(*loads)
        for variable, value in zip(variables, values, strict=True):
            self.bind_or_test(variable, value)

    def arguments_fit(self, goal: CallAtom, key: PatternQuery) -> bool:
        """Return True if the bound objects of a call are known to be of the classes of its parameters."""
        types = self.facts.library.parameter_types(goal.pattern)
        given = [(goal.arguments[position], types[position]) for position in key.bound]
        return all(self._is_known_instance(v, type_.cls) for v, type_ in given if isinstance(type_, ObjectType))


class WordLoops:
    """An emitter of loops over the objects of a class that is stored as bit sets.

    Args:
        body: receives the loops.
        keeps_words: True if the loop of the last step is only over words.

    Attributes:
        word: the word that holds many solutions at once, or None. Its objects are values of the last variable.
    """

    def __init__(self, body: BodyEmitter, keeps_words: bool) -> None:
        self._body = body
        self._facts = body.facts
        self._keeps_words = keeps_words
        self.word: SetWord | None = None

    def emit_loop(self, steps: Sequence[PlanStep]) -> Sequence[PlanStep] | None:
        """Emit a loop over bit sets for the first step, and for the next if this tests the class of a related object.

        Returns the steps left; None if the first step needs another loop.
        """
        step, *following = steps
        within = self._related_set(step, following[0]) if following else None
        if within is not None:
            assert isinstance(step.goal, RelationAtom)
            self._body.record_classes(step.goal)
            step, *following = following
        elif following or not (self._keeps_words and self._is_set_loop(step)):
            return None
        goal = step.goal
        assert isinstance(goal, InstanceAtom)
        sets = self._facts.class_sets(goal.cls, goal.exact)
        assert sets is not None
        self.word = self._facts.emit_word_loop(self._body.block, sets, within)
        self._variable = goal.variable
        self._body.record_class(goal.variable, ObjectType(goal.cls))
        if following or not self._keeps_words:
            self.emit_bits()
        else:
            self._body.bindings.expressions[goal.variable] = self._facts.new_local_for(ObjectType(goal.cls))
        return following

    def emit_bits(self) -> None:
        """Emit a loop over the objects of the word, if there is one."""
        if self.word is not None:
            self._body.bindings.expressions[self._variable] = self._facts.emit_bit_loop(self._body.block, self.word)
            self.word = None

    def emit_count(self, number: code.Local) -> code.Statement:
        """Return a statement that adds 1 to `number`; if the body finds solutions as bits of a word, their number."""
        one = ONE if self.word is None else code.emit_call("count_bits", self.word.word)
        return code.Assign(number, one, "+=")

    def emit_for_nth(self, number: code.Local, then: Callable[[], code.Body]) -> code.Body:
        """Return code that runs statements for the solution with an index; the statements must end with a return.

        Args:
            number: variable with the index, from 0. The code subtracts the number of solutions of each word that it
                passes.
            then: returns the statements.
        """
        assert self.word is not None
        here = self._facts.module.new_local("n")
        node = self._body.bindings.expressions[self._variable]
        assert isinstance(node, code.Local)
        place = code.emit_call("nth_bit", self.word.word, number)
        chosen = code.Assign(node, self._facts.emit_object_at(self.word, place))
        return (
            code.Assign(here, code.emit_call("count_bits", self.word.word)),
            code.If(code.Operation("<", (number, here)), (chosen, *then())),
            code.Assign(number, here, "-="),
        )

    def _is_set_loop(self, step: PlanStep) -> bool:
        """Return True if a step loops over all objects of a class whose objects are stored as bit sets."""
        goal = step.goal
        return (
            step.kind is StepKind.LOOP
            and isinstance(goal, InstanceAtom)
            and not self._body.is_bound(goal.variable)
            and self._facts.class_sets(goal.cls, goal.exact) is not None
        )

    def _related_set(self, step: PlanStep, following: PlanStep) -> tuple[KeyColumns, int, code.Expression] | None:
        """Return the bit set of the objects that a table relates, if the next step tests them with sets of their class.

        The two steps then become one loop over the bits of both sets. Returns None if this is not possible.
        """
        goal, test = step.goal, following.goal
        if not (
            step.kind is StepKind.LOOP
            and following.kind is StepKind.TEST
            and isinstance(goal, LinkAtom | CallAtom | ClosureAtom)
            and isinstance(test, InstanceAtom)
            and step.binds == (test.variable,)
            and self._body.is_static(goal)
            and self._facts.class_sets(test.cls, test.exact) is not None
        ):
            return None
        variables, body = relation_variables(goal), self._body
        if variables.count(test.variable) > 1:
            return None
        bound = {p: body.value_of(v) for p, v in enumerate(variables) if body.is_bound(v)}
        return self._facts.related_set(static_relation(goal), bound, variables.index(test.variable))


def static_relation(goal: Goal) -> StaticRelation:
    """Return the table to read for a link, call or closure that never changes."""
    match goal:
        case LinkAtom(reference):
            return FeatureRows(reference)
        case CallAtom(pattern):
            return PatternMatches(pattern)
        case ClosureAtom():
            return ClosurePairs(goal.step, goal.closure is Closure.STAR)
    raise AssertionError(goal)
