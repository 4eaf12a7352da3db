"""Emit functions for units: their steps, the choices between them, and the values that they pass on.

A variable is 1 if a step succeeds. If a step fails after changes, the state that was saved before is restored. The
error of the state is `REFUSED` if and only if the live engine remembers a refusal as the reason of a failure.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Final

from envgraph import code
from envgraph.behaviour import RuleCall
from envgraph.env.compiled._changes import checked_unit, plan_of
from envgraph.env.compiled._not_compiled import NotCompiled, add_missing_span
from envgraph.env.compiled._program_layout import (
    ERROR,
    NOBODY,
    ONE,
    STEPS_LEFT,
    ZERO,
    D,
    emit_result,
    emit_state_entry,
    emit_sum,
)
from envgraph.env.compiled._refused_rules import (
    CLEAR_REFUSED,
    RuleAttempts,
    emit_holds,
    has_class,
    may_rule_be_refused,
    object_or_value_term,
)
from envgraph.env.compiled._term_code import CodeTerm, ExpressionEmitter, emit_as_float, initial_constant
from envgraph.metamodel import Attribute, Reference, Scalar
from envgraph.pattern import (
    Alap,
    Applicable,
    AtomicStep,
    Check,
    Constraint,
    Expression,
    IfStep,
    ObjectType,
    Repeat,
    StaticType,
    Step,
    StepSequence as Steps,
    TryStep,
    UnitCall,
    UnitChoice,
    Variable,
    required_paths,
)
from envgraph.rewrite import Signature
from envgraph.rewrite.plans import CheckedUnit, always_changes, choice_tiers, fails_without_changes

if TYPE_CHECKING:
    from envgraph.env.compiled._clause_code import FunctionEmitter, RuleCallResult

UnitScope = dict[str, CodeTerm]
"""The terms of the unit's variables that have a value at a point of its code."""

MOST_INLINE: Final = 6
"""Maximal number of blocks inside each other in one function, because Python limits the nesting of source code."""


def emit_unit(
    outer: FunctionEmitter, call: RuleCall, bound: Sequence[str], outputs: Sequence[str], wider: Mapping[str, str]
) -> tuple[list[code.Local], code.Body]:
    """Emit the parameters and body of a function that runs a unit.

    The function returns 1 and the outputs, 0 if the unit fails, and -1 after an error. If the unit may succeed without
    a change, the function returns 2 after a change.

    Args:
        outer: the emitter of the function that calls it.
        call: the call of the unit.
        bound, outputs: the parameters that get values, and the outputs.
        wider: the classes of arguments that may lack the class of their parameter.
    """
    checked = checked_unit(outer.engine, call)
    types = {name: ObjectType(wider[name]) if name in wider else checked.types[name] for name in bound}
    scope = {
        name: object_or_value_term(outer, outer.facts.new_local_for(type_ or ObjectType("")), type_)
        for name, type_ in types.items()
    }
    return emit_block(outer, checked, checked.unit.body, scope, outputs, is_unit=True)


def emit_block(
    outer: FunctionEmitter,
    checked: CheckedUnit,
    step: Step,
    outer_scope: UnitScope,
    outputs: Sequence[str] = (),
    *,
    is_unit: bool = False,
) -> tuple[list[code.Local], code.Body]:
    """Emit the parameters and body of a function for a step of a unit, or the whole unit; it returns as `emit_unit`."""
    writer = outer.new_emitter(code.Return(ZERO))
    given = {name: outer.facts.new_local_for(term.type or ObjectType("")) for name, term in outer_scope.items()}
    scope = {name: object_or_value_term(outer, local, outer_scope[name].type) for name, local in given.items()}
    nothing = [initial_constant(checked.types[name]) for name in outputs]
    writer.error_return = code.Return(emit_result(NOBODY, nothing))
    done, changed = (writer.module.new_local(prefix) for prefix in ("done", "c"))
    steps = _UnitStepEmitter(writer, checked, None if always_changes(step, checked.calls) else changed)
    writer.append_assignment(done, ZERO)
    if steps.changed is not None:
        writer.append_assignment(changed, ZERO)
    if is_unit:
        steps.emit_step_count()
    steps.emit_step(step, scope, done)
    if outputs:
        writer.append(code.If(code.emit_equal(done, ZERO), (code.Return(emit_result(ZERO, nothing)),)))
    if steps.changed is not None:
        writer.append(code.If(code.emit_equal(done, ONE), (code.Assign(done, changed, "+="),)))
    writer.append(code.Return(emit_result(done, [scope[name].number_code for name in outputs])))
    return [*given.values()], writer.all_statements()


def emit_can_succeed(
    outer: FunctionEmitter, rule: RuleCall, bound: tuple[str, ...], wider: Mapping[str, str]
) -> tuple[list[code.Local], code.Body]:
    """Emit the parameters and body of a function that tests if a unit can succeed; an error counts as success.

    It runs the unit with all choices, as a script decides, and restores the state after each run.
    """
    types = checked_unit(outer.engine, rule).types
    writer, parameters = (
        outer.new_emitter(code.Return(ONE)),
        [outer.facts.new_local_for(types[name] or ObjectType("")) for name in bound],
    )
    done, number = (outer.module.new_local(prefix) for prefix in "di")
    with writer.saved_state() as put_back:
        applied = writer.application_function(rule, bound, (), wider)
        run = (
            code.ExpressionStatement(code.emit_call("begin_outcome", D)),
            code.Assign(emit_state_entry(ERROR), ZERO),
            code.Assign(STEPS_LEFT, code.Constant(float(outer.engine.step_limit))),
            code.Assign(done, writer.emit_function_call(applied, *parameters)),
            put_back,
            code.If(code.Operation("!=", (done, ZERO)), (code.Return(ONE),)),
            code.If(code.Operation("!=", (emit_state_entry(ERROR), ZERO)), (code.Return(ONE),)),
            code.If(code.emit_not(code.emit_call("next_script", D)), (code.Return(ZERO),)),
        )
        most = code.emit_call("int", code.Subscript(D, code.Name("MOST")))
        writer.append(code.ExpressionStatement(code.emit_call("begin_script", D)))
        writer.append(code.For(number, code.emit_call("range", most), run))
    return parameters, (*writer.all_statements(), code.Return(ZERO))


class _UnitExpressions(ExpressionEmitter):
    """An emitter of expressions in a unit, in which an object that lacks a feature has no value of it."""

    def _feature_of(self, cls: str, name: str) -> Attribute | Reference:
        """Return the feature that objects of a class, or those that were of it, may have by a name.

        Raises:
            NotCompiled: there are several.
        """
        classes = [cls, *self._facts.changes.possible_classes(cls)]
        found = {feature for one in classes if (feature := self._facts.metamodel.feature(one, name)) is not None}
        if len(found) > 1:
            raise NotCompiled(f"an expression of a unit that reads one of several features `{name}` (`{cls}`)")
        return found.pop()

    def _with_class_test(self, owner: CodeTerm, cls: str) -> CodeTerm:
        assert isinstance(owner.type, ObjectType)
        sure = owner.certain_class or owner.type.cls
        if self._facts.metamodel.is_a(sure, cls) and (owner.certain_class or self._facts.changes.is_fixed_class(cls)):
            return owner
        return replace(owner, present=(*owner.present, self._facts.emit_is_instance(owner.value, cls)))


class _UnitStepEmitter:
    """An emitter of the steps of a unit.

    Args:
        writer: the emitter of the unit's function.
        checked: the unit.
        changed: the variable that gets 1 when a step changes something; None if nobody asks.
    """

    def __init__(self, writer: FunctionEmitter, checked: CheckedUnit, changed: code.Local | None) -> None:
        self._writer = writer
        self._checked = checked
        self.changed = changed
        self._depth = 0

    def emit_step_count(self) -> None:
        """Emit code that counts a step of the run, and fails beyond the limit."""
        self._writer.append(code.Assign(STEPS_LEFT, code.Constant(1.0), "-="))
        self._writer.append_fail_if(code.Operation("<", (STEPS_LEFT, code.Constant(0.0))))

    def emit_step(self, step: Step, scope: UnitScope, done: code.Local) -> None:
        """Emit code that sets `done` from 0 to 1 if the step succeeds; add the step's outputs to the scope."""
        with add_missing_span(step.span or self._checked.unit.span):
            match step:
                case UnitCall():
                    self._emit_call(step, scope, done)
                case Steps(steps):
                    self._emit_sequence(steps, scope, done)
                case UnitChoice():
                    self._emit_choice(step, scope, done)
                case Alap(body):
                    self._emit_alap(body, scope, done)
                case Repeat():
                    self._emit_repeat(step, scope, done)
                case TryStep(body, otherwise):
                    self._emit_undoable(body, {**scope}, done)

                    def emit_otherwise() -> None:
                        self._writer.append(CLEAR_REFUSED)
                        self._emit_branch(otherwise, scope, done)

                    self._emit_unless_done(done, emit_otherwise)
                case IfStep(_, then, otherwise):
                    test = self._emit_if_condition(step, scope)
                    chosen = [
                        self._writer.collect(lambda one=one: self._emit_branch(one, scope, done))  # type: ignore[misc]
                        for one in (then, otherwise)
                    ]
                    self._writer.append(code.If(test, *chosen))
                case AtomicStep(body):
                    self._emit_undoable(body, scope, done, shares_scope=True)

    def _emit_branch(self, step: Step | None, scope: UnitScope, done: code.Local) -> None:
        """Emit code for a block with its own scope. If the step is None, the code sets `done` to 1."""
        if step is None:
            self._writer.append_assignment(done, ONE)
        elif self._depth < MOST_INLINE or isinstance(step, UnitCall):
            self._depth += 1
            self.emit_step(step, {**scope}, done)
            self._depth -= 1
        else:
            module = self._writer.module
            name = module.function_for(object(), "block", lambda: emit_block(self._writer, self._checked, step, scope))
            call = self._writer.emit_function_call(name, *(term.number_code for term in scope.values()))
            self._writer.append_assignment(done, call)
            self._writer.append(code.If(code.Operation("<", (done, ZERO)), (self._writer.error_return,)))
            self._emit_noted(done, always_changes(step, self._checked.calls))

    def _emit_noted(self, done: code.Local, sure: bool) -> None:
        """Emit code that notes a change after a call, and sets `done` to at most 1.

        If not `sure`, a call that succeeds has changed something only if `done` is 2.
        """
        if self.changed is not None:
            changed = code.Operation(">", (done, ZERO if sure else ONE))
            self._writer.append(code.If(changed, (code.Assign(self.changed, ONE),)))
        if not sure:
            self._writer.append_assignment(done, code.emit_call("min", done, ONE))

    def _emit_undoable(self, step: Step, scope: UnitScope, done: code.Local, *, shares_scope: bool = False) -> None:
        """Emit code for a block whose changes are undone if it fails."""
        emit, writer = self.emit_step if shares_scope else self._emit_branch, self._writer
        if fails_without_changes(step, self._checked.calls):
            emit(step, scope, done)
            return
        undone: list[code.Statement] = []
        if self.changed is not None:
            before = writer.module.new_local("c")
            writer.append_assignment(before, self.changed)
            undone.append(code.Assign(self.changed, before))
        with writer.saved_state() as put_back:
            emit(step, scope, done)
        writer.append(code.If(code.emit_equal(done, ZERO), (put_back, *undone)))

    def _emit_unless_done(self, done: code.Local, write: Callable[[], None]) -> None:
        self._writer.append_if(code.emit_equal(done, ZERO), write)

    def _emit_sequence(self, steps: Sequence[Step], scope: UnitScope, done: code.Local) -> None:
        """Emit code for steps that all have to succeed, in order."""
        if not steps:
            self._writer.append_assignment(done, ONE)
            return
        self.emit_step(steps[0], scope, done)
        for step in steps[1:]:

            def emit_next(step: Step = step) -> None:
                self._writer.append_assignment(done, ZERO)
                self.emit_step(step, scope, done)

            self._writer.append_if(code.emit_equal(done, ONE), emit_next)

    # --- loops

    def _emit_alap(self, body: Step, scope: UnitScope, done: code.Local) -> None:
        """Emit code that repeats a step as long as it succeeds with a change."""
        writer, going, outer = self._writer, self._writer.module.new_local("g"), self.changed
        sure = always_changes(body, self._checked.calls)
        changed = outer if sure else writer.module.new_local("c")

        def emit_round() -> None:
            self.emit_step_count()
            writer.append_assignment(going, ZERO)
            if not sure and changed is not None:
                writer.append_assignment(changed, ZERO)
            self.changed = changed
            self._emit_undoable(body, scope, going)
            self.changed = outer
            if not sure and changed is not None:
                writer.append_assignment(going, changed)
                if outer is not None:
                    writer.append_assignment(outer, code.emit_call("max", outer, changed))

        writer.append_assignment(going, ONE)
        writer.append(code.While(code.emit_equal(going, ONE), writer.collect(emit_round)), CLEAR_REFUSED)
        writer.append_assignment(done, ONE)

    def _emit_repeat(self, step: Repeat, scope: UnitScope, done: code.Local) -> None:
        """Emit code that repeats a step a random number of times, and fails if fewer rounds than the least succeed."""
        writer, tests = self._writer, list[code.Expression]()
        least = self._emit_bound(step.lower, scope, tests)
        most = least if step.upper == step.lower else self._emit_bound(step.upper, scope, tests)

        def emit_rounds() -> None:
            number, place, going = (writer.module.new_local(prefix) for prefix in "nig")
            if not (isinstance(step.lower, int) and isinstance(step.upper, int)):
                ordered = [code.Operation("<=", pair) for pair in ((ZERO, least), (least, most))]
                writer.append_fail_if(code.emit_not(code.emit_joined("and", ordered, True)))
            writer.append_assignment(number, least)
            if least is not most:
                spread = emit_sum(code.Operation("-", (most, least)), 1)
                writer.append(code.Assign(number, code.emit_call("pick", D, spread), "+="))
            writer.append_assignment(done, ONE)

            def emit_round() -> None:
                self.emit_step_count()
                writer.append_assignment(going, ZERO)
                self._emit_undoable(step.body, scope, going)
                enough = code.If(code.Operation("<", (place, least)), (code.Assign(done, ZERO),), (CLEAR_REFUSED,))
                writer.append(code.If(code.emit_equal(going, ZERO), (enough, code.BreakOrContinue("break"))))

            writer.append(code.For(place, code.emit_call("range", number), writer.collect(emit_round)))

        writer.append_if(code.emit_joined("and", tests, True), emit_rounds)

    def _emit_bound(self, bound: int | Expression, scope: UnitScope, tests: list[code.Expression]) -> code.Expression:
        if isinstance(bound, int):
            return code.Constant(bound)
        term, local = self._emit_value(bound, scope, None, tests), self._writer.module.new_local("n")
        found = code.ConditionalExpression(code.emit_joined("and", tests, True), term.value, ZERO)
        self._writer.append_assignment(local, found if tests else term.value)
        return local

    # --- choices

    def _emit_choice(self, step: UnitChoice, scope: UnitScope, done: code.Local) -> None:
        """Emit code that tries alternatives by priority, those of equal priority in random order by weight."""
        refused = self._writer.module.new_local("refused")
        self._writer.append_assignment(refused, ZERO)

        def attempt(alternative: Step) -> None:
            """Emit code that tries an alternative, and records if a rule was refused."""
            self._emit_undoable(alternative, scope, done)
            self._emit_unless_done(
                done,
                lambda: self._writer.append_assignment(
                    refused, code.emit_call("max", refused, emit_state_entry(ERROR))
                ),
            )

        for tier in choice_tiers(step, self._checked.calls):
            tries = [(code.Constant(float(weight)), partial(attempt, each)) for each, weight in tier]
            self._emit_unless_done(done, lambda tries=tries: self._emit_draws(tries, done))  # type: ignore[misc]
        self._emit_unless_done(done, lambda: self._writer.append(code.Assign(emit_state_entry(ERROR), refused)))

    def _emit_draws(self, tries: Sequence[tuple[code.Expression, Callable[[], None]]], done: code.Local) -> None:
        """Emit code that makes attempts, given by their weights and code, in random order until one succeeds."""
        if len(tries) == 1 and isinstance(tries[0][0], code.Constant):
            tries[0][1]()
            return
        writer = self._writer
        left = [writer.module.new_local("w", "float") for _ in tries]
        for local, (weight, _) in zip(left, tries, strict=True):
            writer.append_assignment(local, weight)
        total = code.emit_joined("+", left, 0)
        going = code.Operation("and", (code.emit_equal(done, ZERO), code.Operation(">", (total, code.Constant(0.0)))))
        emitters = [emit for _, emit in tries]
        writer.append(code.While(going, writer.collect(lambda: self._emit_draw(emitters, left, total))))

    def _emit_draw(
        self, attempts: Sequence[Callable[[], None]], left: Sequence[code.Local], total: code.Expression
    ) -> None:
        """Emit code that samples one of the attempts not yet made by weight and makes it; its weight becomes 0."""
        writer = self._writer
        whole, drawn = writer.module.new_local("total", "float"), writer.module.new_local("b")
        writer.append_assignment(whole, total)
        chances = [writer.module.new_local("p", "float") for _ in left]
        for chance, weight in zip(chances, left, strict=True):
            writer.append_assignment(chance, code.Operation("/", (weight, whole)))
        missing = code.Operation("-", (code.Constant(1.0), code.emit_joined("+", chances, 0)))
        writer.append_assignment(drawn, code.emit_call("choose", D, code.emit_tuple(*chances), missing))
        for number, (attempt, weight) in enumerate(zip(attempts, left, strict=True)):

            def take(attempt: Callable[[], None] = attempt, weight: code.Local = weight) -> None:
                writer.append_assignment(weight, code.Constant(0.0))
                attempt()

            writer.append_if(code.emit_equal(drawn, code.Constant(number)), take)

    # --- calls

    def _emit_call(self, step: UnitCall, scope: UnitScope, done: code.Local) -> None:
        """Emit code for a call in a unit: it applies a rule or group, or runs a unit, and sets `done`."""
        callee, writer = self._checked.calls[id(step)], self._writer
        call = RuleCall(callee.name, span=step.span)
        sure = callee.kind != "unit"
        if sure:
            self.emit_step_count()
            writer.append(CLEAR_REFUSED)
        if callee.kind == "group":
            self._emit_group(step, callee, done)
        else:
            given, tests, wanted, wider = self._emit_arguments(step.arguments, callee, scope)
            if sure:
                called = self._emit_rule(step, call, given, tests, wanted, scope)
            else:
                body = checked_unit(writer.engine, call)
                sure = always_changes(body.unit.body, body.calls)
                called = writer.emit_application(call, given, tests, wanted, wider)
            writer.append_assignment(done, called.done_variable)
            scope.update(called.outputs)
        self._emit_noted(done, sure)

    def _emit_rule(
        self,
        step: UnitCall,
        call: RuleCall,
        given: Mapping[str, code.Expression],
        tests: Sequence[code.Expression],
        wanted: Mapping[str, str],
        scope: UnitScope,
    ) -> RuleCallResult:
        """Emit code that applies a rule once, or at each match, if all tests pass."""
        writer = self._writer
        plan = plan_of(writer.engine, call)
        if not {*given} <= {*plan.variables}:  # an object that the rule creates has no given value
            return writer.call_result(call, *writer.emit_results(call, ()), {})
        chosen = step.every or step.first or step.where
        if not (chosen or may_rule_be_refused(writer, call)):
            return writer.emit_application(call, given, tests, wanted)
        done, outputs = writer.emit_results(call, tuple(wanted))

        def narrow(names: Mapping[str, CodeTerm]) -> tuple[list[code.Expression], CodeTerm | None]:
            inside = {**scope, **names}
            passed = [self._emit_condition(step, *each, inside) for each in enumerate(step.where)]
            if step.by is None:
                return passed, None
            value = self._emit_expression(step.by, inside)
            return [*passed, *self._path_tests(step.by, inside), *value.tests], value

        def attempt() -> None:
            attempts = RuleAttempts(writer, call, given, tuple(wanted))
            with attempts.rows(narrow if step.where or step.by is not None else None, step.limit):
                if step.every:
                    writer.append_assignment(done, attempts.emit_every(self.emit_step_count))
                else:
                    attempts.emit_one(done, outputs, in_order=step.first)

        writer.append_if(code.emit_joined("and", tests, True), attempt)
        return writer.call_result(call, done, outputs, wanted)

    def _emit_group(self, step: UnitCall, callee: Signature, done: code.Local) -> None:
        """Emit code that applies one rule of a group, drawn by weight among those with a match, or all of them."""
        writer, engine = self._writer, self._writer.engine
        calls = [RuleCall(name, span=step.span) for name in engine.catalog.group(callee.name)]
        if step.every:
            with ExitStack() as reserved:
                members = [RuleAttempts(writer, call, {}) for call in calls]
                for member in members:
                    reserved.enter_context(member.rows())
                for member in members:
                    found = member.emit_every(self.emit_step_count)
                    writer.append_assignment(done, code.emit_call("max", done, found))
            writer.append(code.If(code.emit_equal(done, ONE), (CLEAR_REFUSED,)))
            return

        def attempt(call: RuleCall) -> None:
            writer.append(CLEAR_REFUSED)
            writer.append_assignment(done, self._emit_rule(UnitCall(""), call, {}, [], {}, {}).done_variable)

        tries = [
            (
                code.ConditionalExpression(
                    writer.emit_exists(call),
                    code.Constant(float(engine.signature(call.rule or "").weight)),
                    code.Constant(0.0),
                ),
                partial(attempt, call),
            )
            for call in calls
        ]
        self._emit_draws(tries, done)

    def _emit_arguments(
        self, arguments: Sequence[Expression], callee: Signature, scope: UnitScope
    ) -> tuple[dict[str, code.Expression], list[code.Expression], dict[str, str], dict[str, str]]:
        """Emit code for the arguments of a call.

        Returns:
            The values by parameter, tests that they exist, the unit's variable for each output parameter, and the
            classes of objects that are given to a unit and may lack the class of their parameter.
        """
        given: dict[str, code.Expression] = {}
        tests: list[code.Expression] = []
        wanted: dict[str, str] = {}
        wider: dict[str, str] = {}
        for argument, taken in zip(arguments, callee.parameters, strict=False):
            if isinstance(argument, Variable) and argument.is_anonymous:
                continue
            if isinstance(argument, Variable) and argument.name not in scope and taken.is_output:
                wanted[taken.name] = argument.name
                continue
            term = self._emit_value(argument, scope, taken.type, tests)
            if isinstance(taken.type, ObjectType) and isinstance(term.type, ObjectType):
                if callee.kind != "unit" and not has_class(self._writer, term, taken.type.cls):
                    tests.append(self._writer.facts.emit_is_instance(term.value, taken.type.cls))
                elif not self._writer.facts.metamodel.is_a(term.type.cls, taken.type.cls):
                    wider[taken.name] = term.type.cls
            given[taken.name] = emit_as_float(term) if taken.type is Scalar.FLOAT else term.number_code
        return given, tests, wanted, wider

    # --- values and conditions

    def _emit_expression(
        self, expression: Expression, scope: UnitScope, expected: StaticType | None = None
    ) -> CodeTerm:
        terms = _UnitExpressions(self._writer.facts, scope)
        term = terms.emit(expression, expected)
        self._writer.append(*terms.statements)
        return term

    def _emit_value(
        self, argument: Expression, scope: UnitScope, expected: StaticType | None, tests: list[code.Expression]
    ) -> CodeTerm:
        """Emit code for an argument or bound, and add its tests to `tests`.

        The step fails if a path in the argument has no value. The unit ends with an error if the evaluation fails.
        """
        tests += self._path_tests(argument, scope)
        term = self._emit_expression(argument, scope, expected)
        if term.valid:
            wrong = code.emit_not(code.emit_joined("and", term.valid, True))
            self._writer.append_fail_if(code.emit_joined("and", [*tests, wrong], True))
        tests += term.tests
        return term

    def _path_tests(self, expression: Expression, scope: UnitScope) -> list[code.Expression]:
        """Return expressions that test if all paths in an expression have values."""
        terms = [self._emit_expression(path, scope) for path in required_paths(expression)]
        return [test for term in terms for test in term.tests]

    def _emit_if_condition(self, step: IfStep, scope: UnitScope) -> code.Expression:
        """Return code that tests the condition of an `if`."""
        if id(step) in self._checked.applicability_tests:
            return self._emit_applicable(step, scope)
        assert not isinstance(step.condition, Applicable)
        return self._emit_condition(step, 0, step.condition, scope)

    def _emit_condition(self, step: Step, number: int, condition: Constraint, scope: UnitScope) -> code.Expression:
        """Return code that tests a condition, given its index `number` in the step."""
        if isinstance(condition, Check):
            asked = condition.expression
            term = self._emit_expression(asked, scope)
            return code.emit_joined("and", [*self._path_tests(asked, scope), *term.tests, term.value], True)
        found = self._checked.conditions[id(step), number]
        terms = [scope[name] for name in found.arguments]
        test = emit_holds(self._writer, found.pattern.qualified_name, terms)
        return code.emit_not(test) if found.negated else test

    def _emit_applicable(self, step: IfStep, scope: UnitScope) -> code.Expression:
        """Emit code that tests if a rule, or one of a group, can be applied, and return the test."""
        asked, callee = self._checked.applicability_tests[id(step)]
        writer, error = self._writer, emit_state_entry(ERROR)
        can, before = (writer.module.new_local(prefix) for prefix in ("can", "e"))
        writer.append(code.Assign(can, ZERO), code.Assign(before, error), CLEAR_REFUSED)
        given, tests, _, _ = self._emit_arguments(asked.arguments, callee, scope)

        def ask(call: RuleCall) -> None:
            plan = plan_of(writer.engine, call)
            fails = any(one.computed or one.creates or one.may_contradict for one in plan.blocks)
            if not (fails or may_rule_be_refused(writer, call)):
                writer.append_assignment(can, code.ConditionalExpression(writer.emit_exists(call, given), ONE, ZERO))
                return
            attempts = RuleAttempts(writer, call, given)
            with attempts.rows():
                attempts.emit_one(can, [], tests_only=True)

        for name in writer.engine.catalog.group(callee.name):
            free = code.emit_joined("and", [*tests, code.emit_equal(can, ZERO)], True)
            writer.append_if(free, lambda each=name: ask(RuleCall(each, span=asked.span)))  # type: ignore[misc]
        writer.append(CLEAR_REFUSED, code.If(code.emit_equal(error, ZERO), (code.Assign(error, before),)))
        return code.emit_equal(can, ZERO if asked.negated else ONE)
