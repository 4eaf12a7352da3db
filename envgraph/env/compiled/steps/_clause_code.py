"""Emit statements for the clauses of a behaviour: values, calls of rules, and queries."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

from envgraph import code
from envgraph.behaviour import (
    Branch,
    HelperPattern,
    KeyIndex,
    RuleCall,
    condition_helper,
    key_attributes,
    key_helper,
    read_variables,
)
from envgraph.code import dataclass
from envgraph.env._prepared_behaviour import add_helper_pattern
from envgraph.env._prepared_clauses import MAX_REWARD, NameClasses
from envgraph.env._random_choices import missing_probability
from envgraph.env.compiled.effects._effect_code import EffectEmitter
from envgraph.env.compiled.layout._model_changes import checked_unit, plan_of
from envgraph.env.compiled.layout._not_compiled import add_missing_span
from envgraph.env.compiled.layout._program_layout import (
    ERROR,
    NOBODY,
    ONE,
    RI,
    STEPS_LEFT,
    ZERO,
    D,
    emit_entry,
    emit_result,
    emit_state_entry,
    emit_sum,
    emit_table_entry,
    emit_value_entry,
)
from envgraph.env.compiled.layout._symbols import KeyValues, ObjectByIndex, OneObjectPerIndex
from envgraph.env.compiled.matching._match_emitter import MatchEmitter
from envgraph.env.compiled.matching._term_code import (
    CodeTerm,
    ExpressionEmitter,
    emit_as_float,
    initial_constant,
    variable_term,
)
from envgraph.env.compiled.steps._function_statements import FunctionStatements
from envgraph.env.compiled.steps._refused_rules import (
    CLEAR_REFUSED,
    Arguments,
    class_tests,
    may_rule_be_refused,
    object_or_value_term,
)
from envgraph.env.compiled.steps._unit_steps import emit_can_succeed, emit_unit
from envgraph.match.plan import PatternQuery
from envgraph.metamodel import Scalar
from envgraph.pattern import Constant, Expression, Negation, ObjectType, StaticType, Variable
from envgraph.rewrite import Engine, Signature
from envgraph.rewrite.plans import RulePlan, fails_without_changes


@dataclass(frozen=True, slots=True)
class CallResult:
    """The variables that hold the result of a call after its code has run.

    Attributes:
        done: the variable that is 1 if a rule was applied or the call is `nothing()`, else 0; of units see `emit_unit`.
        outputs: the terms of the output names.
        variables: the variables of the outputs.
    """

    done: code.Local
    outputs: Mapping[str, CodeTerm]
    variables: Sequence[code.Local] = ()

    def assign(self, call: code.Expression) -> code.Assign:
        """Return a statement that assigns the result of a call to the variables."""
        return code.Assign(code.emit_tuple(self.done, *self.variables) if self.variables else self.done, call)


class FunctionEmitter(FunctionStatements):
    """An emitter of the statements of one function of a behaviour.

    Args:
        matching: emits code that finds matches.
        engine: supplies the rules.
        behaviour: the name of the behaviour.
        error_return: the return statement of the function after an error.
    """

    def __init__(self, matching: MatchEmitter, engine: Engine, behaviour: str, error_return: code.Return) -> None:
        super().__init__(error_return, matching.module, matching.facts.layout)
        self.matching = matching
        self.facts = matching.facts
        self.engine = engine
        self.behaviour = behaviour
        self.refused: code.Local | None = None
        """The variable that calls of clauses set to 1 if their rule is refused; None if this is an error."""

    # --- values

    def emit_value(
        self, expression: Expression, scope: Mapping[str, CodeTerm], expected: StaticType | None = None
    ) -> CodeTerm:
        """Emit code for an expression, and return its term."""
        terms = ExpressionEmitter(self.facts, scope)
        term = terms.emit(expression, expected)
        self.append(*terms.statements)
        return term

    def emit_number(self, expression: Expression, scope: Mapping[str, CodeTerm]) -> code.Expression:
        """Emit code for a reward or weight as a float; a missing, failing or too large value is an error."""
        term = self.emit_value(expression, scope)
        if term.tests:
            self.append_fail_if(code.emit_not(code.emit_joined("and", term.tests, True)))
        known = expression.value if isinstance(expression, Constant) else None
        if term.type is not Scalar.FLOAT or (isinstance(known, float) and abs(known) <= MAX_REWARD):
            return emit_as_float(term)
        local = self.module.new_local("r", "float")
        self.append_assignment(local, term.value)
        self.append_fail_if(code.Operation(">", (code.emit_call("abs", local), code.Constant(MAX_REWARD))))
        return local

    def emit_object_at_index(self, keys: KeyIndex, cls: str, index: code.Expression) -> code.Local:
        """Emit code that looks up the object with an index in a class, or -1 if there is none. Return its variable."""
        local, changes = self.facts.new_local_for(ObjectType(cls)), self.facts.changes
        key = key_pattern(self, keys, cls, index)
        if key is not None:
            rows = self.emit_function_call(self.matching.emit_rows(self.pattern_view(key[0])), *key[1])
            self.append_assignment(local, NOBODY)
            first = code.Assign(local, emit_entry(RI, self.first_row, 0))
            self.append(code.If(code.Operation(">", (rows, ZERO)), (first,)))
            return local
        objects = self.facts.layout.offset(ObjectByIndex(cls, changes.possible_classes(cls)))
        self.append_assignment(local, emit_table_entry(emit_sum(objects, index)))
        if not changes.is_fixed_class(cls):
            there = code.Operation(">=", (local, ZERO))
            gone = code.Operation("and", (there, code.emit_not(self.facts.emit_is_instance(local, cls))))
            self.append(code.If(gone, (code.Assign(local, NOBODY),)))
        return local

    def deleted_test(self, term: CodeTerm, cls: str) -> code.Expression | None:
        """Return an expression that tests if an object is deleted or no longer of a class; None if it cannot be."""
        if self.facts.changes.is_fixed_class(cls):
            return None
        return code.emit_not(self.facts.emit_is_instance(term.value, cls))

    def alive_test(self, term: CodeTerm) -> code.Expression | None:
        """Return an expression that tests if an object is not deleted; None if it cannot be deleted."""
        assert isinstance(term.type, ObjectType)
        return self.facts.emit_is_alive(term.value, term.type.cls)

    # --- calls

    def emit_rule_call(self, rule: RuleCall, scope: Mapping[str, CodeTerm]) -> CallResult:
        """Emit code that evaluates the arguments of a call, then applies its rule at one match or runs its unit.

        If the call is `nothing()`, the code only sets `done` to 1.
        """
        if rule.rule is None:
            done = self.module.new_local("done")
            self.append_assignment(done, ONE)
            return CallResult(done, {})
        signature = self.engine.signature(rule.rule)
        arguments = self.emit_arguments(rule.arguments, signature, scope, self._emit_argument)
        if signature.kind != "unit":
            return self.emit_application(rule, arguments, self.refused)
        checked = checked_unit(self.engine, rule)
        self.append(code.Assign(STEPS_LEFT, code.Constant(float(self.engine.step_limit))))
        with self.saved_state(not fails_without_changes(checked.unit.body, checked.calls)) as put_back:
            called = self.emit_application(rule, arguments)
        succeeded = CLEAR_REFUSED, code.Assign(called.done, ONE)
        self.append(code.If(code.emit_equal(called.done, ZERO), put_back, succeeded))
        if self.refused is not None:
            refused = code.emit_equal(emit_state_entry(ERROR), code.Name("REFUSED"))
            self.append(code.If(refused, (code.Assign(self.refused, ONE),)), CLEAR_REFUSED)
        self.append(code.If(code.Operation("!=", (emit_state_entry(ERROR), ZERO)), (self.error_return,)))
        return called

    def emit_application(self, rule: RuleCall, arguments: Arguments, refused: code.Local | None = None) -> CallResult:
        """Emit code that applies a rule or runs a unit if all tests pass. A refused rule fails, or sets `refused`."""
        result = self.emit_results(self.output_types(rule, arguments.wanted))
        failed: code.Body = (self.error_return,)
        with self.saved_state(refused is not None and may_rule_be_refused(self, rule)) as put_back:
            assigned = result.assign(self.emit_applied(rule, arguments.given, tuple(arguments.wanted)))
            self.append(code.If(code.emit_joined("and", arguments.tests, True), (assigned,)))
        if refused is not None:
            fatal = code.If(code.Operation("!=", (emit_state_entry(ERROR), code.Name("REFUSED"))), failed)
            failed = (fatal, *put_back, CLEAR_REFUSED, code.Assign(refused, ONE), code.Assign(result.done, ZERO))
        self.append(code.If(code.Operation("<", (result.done, ZERO)), failed))
        return result

    def emit_results(self, types: Mapping[str, StaticType]) -> CallResult:
        """Emit code that sets new variables to 0: one for whether a call succeeds, and one for each output name."""
        done, *variables = (self.facts.new_local_for(type_) for type_ in (Scalar.INT, *types.values()))
        self.append_assignment(done, ZERO)
        outputs: dict[str, CodeTerm] = {}
        for (name, type_), local in zip(types.items(), variables, strict=True):
            self.append_assignment(local, initial_constant(type_))
            outputs[name] = object_or_value_term(self, local, type_)
        return CallResult(done, outputs, variables)

    def emit_can_run(self, branches: Sequence[Branch], scope: Mapping[str, CodeTerm], can: code.Local) -> None:
        """Emit code that sets the variable `can` to 1 if the call of a branch with positive probability can succeed."""
        for chance, branch in zip(self._emit_probabilities(branches, scope)[0], branches, strict=True):
            possible = code.Operation(">", (chance, code.Constant(0.0)))
            self.append_if(possible, lambda call=branch.call: self._emit_can_call(call, scope, can))  # type: ignore[misc]

    def _emit_can_call(self, rule: RuleCall, scope: Mapping[str, CodeTerm], can: code.Local) -> None:
        if rule.rule is None:
            self.append_assignment(can, ONE)
            return
        signature = self.engine.signature(rule.rule)
        arguments = self.emit_arguments(rule.arguments, signature, scope, self._emit_argument)
        given = arguments.given
        if signature.kind == "unit":
            types = {name: term.type or ObjectType("") for name, term in given.items()}
            values = [term.number_code for term in given.values()]
            key = "may", rule.rule, tuple(types.items())
            name = self.module.function_for(key, "may", lambda: emit_can_succeed(self, rule, types))
            test: code.Expression = code.emit_equal(self.emit_function_call(name, *values), ONE)
        else:
            test = self.emit_exists(rule, given)
        self.append(code.If(code.emit_joined("and", [*arguments.tests, test], True), (code.Assign(can, ONE),)))
        if signature.kind == "unit":  # only running the unit reports the error
            wrong = code.Operation("!=", (emit_state_entry(ERROR), ZERO))
            self.append(code.If(wrong, (code.Assign(can, ONE), code.Assign(emit_state_entry(ERROR), ZERO))))

    def emit_exists(self, rule: RuleCall, given: Mapping[str, CodeTerm]) -> code.Expression:
        """Return code that tests if a rule has a match with values for parameters."""
        plan = plan_of(self.engine, rule)
        places = {plan.variables.index(name): term.number_code for name, term in given.items()}
        exists = self.matching.emit_exists(PatternQuery(plan.body.pattern, tuple(sorted(places)), ()))
        return self.emit_function_call(exists, *(places[position] for position in sorted(places)))

    def new_emitter(self, error_return: code.Return) -> FunctionEmitter:
        """Return an emitter for another function, with its own return statement after an error."""
        return FunctionEmitter(self.matching, self.engine, self.behaviour, error_return)

    def emit_arguments(
        self,
        arguments: Sequence[Expression],
        callee: Signature,
        scope: Mapping[str, CodeTerm],
        emit: Callable[[Expression, Mapping[str, CodeTerm], StaticType | None, list[code.Expression]], CodeTerm],
    ) -> Arguments:
        """Emit code for the arguments of a call. `emit` emits the code of one, and adds its tests to a list."""
        given: dict[str, CodeTerm] = {}
        tests: list[code.Expression] = []
        wanted: dict[str, str] = {}
        for argument, taken in zip(arguments, callee.parameters, strict=False):
            if isinstance(argument, Variable) and (argument.is_anonymous or argument.name not in scope):
                if not argument.is_anonymous:
                    wanted[taken.name] = argument.name
                continue
            term = emit(argument, scope, taken.type, tests)
            if isinstance(taken.type, ObjectType) and isinstance(term.type, ObjectType):
                if callee.kind != "unit":
                    tests += class_tests(self.facts, term, taken.type.cls)
                elif self.facts.metamodel.is_a(term.type.cls, taken.type.cls):
                    term = replace(term, type=taken.type)
            is_float = taken.type is Scalar.FLOAT
            given[taken.name] = variable_term(emit_as_float(term), Scalar.FLOAT) if is_float else term
        return Arguments(given, tests, wanted)

    def _emit_argument(
        self,
        argument: Expression,
        scope: Mapping[str, CodeTerm],
        expected: StaticType | None,
        tests: list[code.Expression],
    ) -> CodeTerm:
        """Emit code for an argument; it fails if the evaluation fails, unless this reads from a deleted object."""
        term = self.emit_value(argument, scope, expected)
        if term.valid:
            wrong = code.emit_not(code.emit_joined("and", term.valid, True))
            self.append_fail_if(code.emit_joined("and", [*self._existence_tests(argument, scope), wrong], True))
        tests += term.tests
        if isinstance(term.type, ObjectType):
            tests += [alive] if (alive := self.alive_test(term)) is not None else []
        return term

    def _existence_tests(self, expression: Expression, scope: Mapping[str, CodeTerm]) -> list[code.Expression]:
        """Return expressions that test if the objects from which an expression reads are not deleted."""
        there: list[code.Expression] = []
        for root in read_variables(expression):
            there += scope[root.name].present
            there += [alive] if (alive := self.alive_test(scope[root.name])) is not None else []
        return there

    def emit_applied(
        self, rule: RuleCall, given: Mapping[str, CodeTerm], wanted: tuple[str, ...] = ()
    ) -> code.Expression:
        """Return a call of a function that applies a rule at a sampled match, or runs a unit.

        It returns 1 and the outputs, 0 without a match or if the unit fails, and -1 after a refusal or an error. A
        unit returns 2 after a change.
        """
        types: dict[str, StaticType] = {}
        assert rule.rule is not None
        if self.engine.signature(rule.rule).kind == "unit":
            types = {name: term.type or ObjectType("") for name, term in given.items()}
            results = dict(zip(wanted, self.parameter_types(rule, wanted), strict=True))
            key = "run", rule.rule, tuple(types.items()), wanted
            name = self.module.function_for(key, "apply", lambda: emit_unit(self, rule, types, results))
        else:
            bound = tuple(given)
            name = self.module.function_for(
                ("apply", rule.rule, bound, wanted), "apply", lambda: self._emit_rule_function(rule, bound, wanted)
            )
        return self.emit_function_call(name, *(term.number_code for term in given.values()))

    def _emit_rule_function(
        self, rule: RuleCall, bound: tuple[str, ...], wanted: tuple[str, ...]
    ) -> tuple[list[code.Local], code.Body]:
        plan, given, key = self.plan_and_view(rule, bound)
        nothing = [initial_constant(type_) for type_ in self.parameter_types(rule, wanted)]

        def emit_change(found: Sequence[code.Expression]) -> code.Body:
            slots = {**given, **dict(zip(key.outputs, found, strict=True))}
            return self.emit_rule_effects(rule, slots, wanted)

        missing = code.Return(emit_result(ZERO, nothing))
        body = self.matching.emit_sample(key, [*given.values()], emit_change, missing)
        return [given[plan.variables.index(name)] for name in bound], body

    def plan_and_view(
        self, rule: RuleCall, bound: tuple[str, ...]
    ) -> tuple[RulePlan, dict[int, code.Local], PatternQuery]:
        """Return a rule's plan, variables for the bound positions of its match, and the view of the other positions."""
        plan = plan_of(self.engine, rule)
        positions = tuple(sorted(plan.variables.index(name) for name in bound))
        others = tuple(p for p in range(len(plan.variables)) if p not in positions)
        given = {p: self.facts.new_local_for(plan.types[p]) for p in positions}
        return plan, given, PatternQuery(plan.body.pattern, positions, others)

    def emit_rule_effects(
        self, rule: RuleCall, slots: Mapping[int, code.Expression], wanted: Sequence[str]
    ) -> code.Body:
        """Emit the statements that apply a rule at a match and return its outputs."""
        plan = plan_of(self.engine, rule)
        nothing = [initial_constant(type_) for type_ in self.parameter_types(rule, wanted)]
        refused, places = code.Return(emit_result(NOBODY, nothing)), dict(plan.outputs)
        effects = EffectEmitter(self.matching, plan, [slots[p] for p in range(len(plan.variables))], refused)
        with add_missing_span(plan.body.span or rule.span):
            changes = effects.emit()
        return (
            *changes,
            code.Return(emit_result(ONE, [effects.slot_value(places[name]) for name in wanted])),
        )

    def parameter_types(self, rule: RuleCall, names: Iterable[str]) -> list[StaticType]:
        """Return the types of parameters."""
        assert rule.rule is not None
        types = {taken.name: taken.type for taken in self.engine.signature(rule.rule).parameters}
        return [types[name] or ObjectType("") for name in names]

    def output_types(self, rule: RuleCall, output_names: Mapping[str, str]) -> dict[str, StaticType]:
        """Return the types of the names that get the output parameters."""
        return dict(zip(output_names.values(), self.parameter_types(rule, output_names), strict=True))

    def emit_branches(self, branches: Sequence[Branch], scope: Mapping[str, CodeTerm]) -> CallResult:
        """Emit code that samples a branch and runs it. If the probabilities sum to less than 1, it may run none."""
        if [branch.probability for branch in branches] == [1.0]:
            return self.emit_rule_call(branches[0].call, scope)
        done, drawn = self.module.new_local("done"), self.module.new_local("b")
        self.append_assignment(done, ZERO)
        chances, left = self._emit_probabilities(branches, scope)
        self.append_assignment(drawn, code.emit_call("choose", D, code.emit_tuple(*chances), left))
        outputs: dict[str, CodeTerm] = {}
        for number, branch in enumerate(branches):

            def write(branch: Branch = branch) -> None:
                called = self.emit_rule_call(branch.call, scope)
                self.append_assignment(done, called.done)
                for name, term in called.outputs.items():
                    if name not in outputs:
                        outputs[name] = replace(term, value=self.facts.new_local_for(term.type or ObjectType("")))
                    local = outputs[name].value
                    assert isinstance(local, code.Local)
                    self.append_assignment(local, term.number_code)

            self.append_if(code.emit_equal(drawn, code.Constant(number)), write)
        return CallResult(done, outputs)

    def _emit_probabilities(
        self, branches: Sequence[Branch], scope: Mapping[str, CodeTerm]
    ) -> tuple[list[code.Expression], code.Expression]:
        """Return code for the probabilities of branches, and of no branch. The code fails if their sum exceeds 1."""
        given = [branch.probability for branch in branches]
        fixed = [float(one) for one in given if isinstance(one, int | float)]
        if len(fixed) == len(given):
            return [code.Constant(one) for one in fixed], code.Constant(missing_probability(fixed))
        chances = [self._emit_probability(one, scope) for one in given]
        left = self.module.new_local("left", "float")
        self.append_assignment(left, code.Constant(0.0))
        for chance in chances:
            self.append(code.Assign(left, chance, "+="))
        self.append_assignment(left, code.Operation("-", (code.Constant(1.0), left)))
        self.append_fail_if(code.Operation("<", (left, code.Constant(-1e-9))))
        return chances, left

    def _emit_probability(self, given: float | Expression, scope: Mapping[str, CodeTerm]) -> code.Expression:
        """Emit code for a probability, 0 if an object was deleted. It fails if the value is not from 0 to 1."""
        if isinstance(given, int | float):
            return code.Constant(float(given))
        term = self.emit_value(given, scope)
        chance = self.facts.new_local_for(Scalar.FLOAT)
        self.append_assignment(chance, code.Constant(0.0))
        within = [code.Operation("<=", pair) for pair in ((ZERO, chance), (chance, ONE))]
        valued = (
            code.Assign(chance, emit_as_float(term)),
            code.If(code.emit_not(code.emit_joined("and", within, True)), self.failure_statements()),
        )
        lacking_value = code.If(
            code.emit_joined("and", self._existence_tests(given, scope), True), self.failure_statements()
        )
        self.append(
            *((code.If(code.emit_joined("and", term.tests, True), valued, (lacking_value,)),) if term.tests else valued)
        )
        return chance

    # --- questions

    def condition_pattern(self, condition: Negation | object, types: NameClasses) -> HelperPattern:
        """Add the helper pattern of a condition to the engine, and return it with its variables."""
        return add_helper_pattern(
            self.engine,
            self.behaviour,
            lambda name: condition_helper(name, condition, types),  # type: ignore[arg-type]
        )

    def pattern_view(self, question: HelperPattern, free: bool = True) -> PatternQuery:
        """Return the view that finds a helper pattern's free variables, or only tests for a match (`free=False`)."""
        bound = len(question.bound)
        outputs = tuple(range(bound, bound + len(question.free))) if free else ()
        return PatternQuery(question.pattern.qualified_name, tuple(range(bound)), outputs)

    def bound_alive_tests(self, question: HelperPattern, scope: Mapping[str, CodeTerm]) -> list[code.Expression]:
        """Return expressions that test if the objects in the bound variables of a helper pattern are not deleted."""
        return [test for name in question.bound if (test := self.alive_test(scope[name])) is not None]


def key_pattern(
    writer: FunctionEmitter, keys: KeyIndex, cls: str, index: code.Expression
) -> tuple[HelperPattern, list[code.Expression]] | None:
    """Return a helper pattern for objects of a class with a key, and code for the key at an index.

    Return None if the object at each index can be found without, in a table.
    """
    changes, layout = writer.facts.changes, writer.facts.layout
    attributes = key_attributes(changes.metamodel, cls)
    grows = attributes and not changes.created.isdisjoint(changes.possible_classes(cls))
    if not grows and OneObjectPerIndex(cls) not in layout.broken_assumptions:
        return None
    values = [
        KeyValues(attribute.type, tuple(key[place] for key in keys.keys_of(cls)))
        for place, attribute in enumerate(attributes)
    ]
    entries = [emit_value_entry(layout, one, index) for one in values]
    return add_helper_pattern(writer.engine, writer.behaviour, lambda name: key_helper(name, cls, attributes)), entries
