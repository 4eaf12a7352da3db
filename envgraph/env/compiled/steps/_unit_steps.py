"""Emit functions for units: their steps, the choices between them, and the values that they pass on.

A function leaves as soon as a step fails; each block that can fail by itself is a function, and if it fails after
changes, its caller restores the state. The error of the state is `REFUSED` if and only if the live engine remembers a
refusal as the reason of a failure.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from envgraph import code
from envgraph.behaviour import RuleCall
from envgraph.env.compiled.layout._model_changes import checked_unit, plan_of
from envgraph.env.compiled.layout._not_compiled import NotCompiled, add_missing_span
from envgraph.env.compiled.layout._program_layout import (
    ERROR,
    NOBODY,
    ONE,
    STEPS_LEFT,
    TWO,
    ZERO,
    D,
    emit_result,
    emit_state_entry,
    emit_sum,
)
from envgraph.env.compiled.matching._term_code import CodeTerm, ExpressionEmitter, initial_constant
from envgraph.env.compiled.steps._refused_rules import (
    CLEAR_REFUSED,
    Arguments,
    RuleAttempts,
    class_tests,
    emit_holds,
    may_rule_be_refused,
    object_or_value_term,
)
from envgraph.errors import Span
from envgraph.metamodel import LARGEST_INT, Attribute, Reference
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
    required_paths,
)
from envgraph.rewrite import Signature
from envgraph.rewrite.plans import CheckedUnit, all_steps, bound_outputs, choice_tiers, fails_without_changes

if TYPE_CHECKING:
    from envgraph.env.compiled.steps._clause_code import CallResult, FunctionEmitter

UnitScope = Mapping[str, CodeTerm]
"""The terms of the unit's variables that have a value at a point of its code."""

NO_OUTPUTS: Final[Mapping[str, StaticType]] = MappingProxyType({})


def emit_unit(
    outer: FunctionEmitter, call: RuleCall, types: Mapping[str, StaticType], outputs: Mapping[str, StaticType]
) -> tuple[list[code.Local], code.Body]:
    """Emit the parameters and body of a function that runs a unit; see `_UnitFunction`."""
    checked = checked_unit(outer.engine, call)
    function = _UnitFunction(outer, checked, types, outputs)
    function.emit_step_count()
    return function.emit_whole(checked.unit.body)


def emit_can_succeed(
    outer: FunctionEmitter, rule: RuleCall, types: Mapping[str, StaticType]
) -> tuple[list[code.Local], code.Body]:
    """Emit the parameters and body of a function that tests if a unit can succeed; an error counts as success.

    If matches do not answer this, it runs the unit with all choices, as a script decides, and restores the state.
    """
    checked = checked_unit(outer.engine, rule)
    function, asked = (_UnitFunction(outer, checked, types) for _ in range(2))
    writer = function.writer
    writer.error_return = asked.writer.error_return = code.Return(ONE)
    few_steps = len([*all_steps(checked.unit)]) < outer.engine.step_limit
    test = asked.emit_match_test(checked.unit.body) if few_steps else None
    if test is not None:
        answer = code.Return(code.ConditionalExpression(test, ONE, ZERO))
        return asked.parameters, (*asked.writer.all_statements(), answer)
    done, number = (outer.module.new_local(prefix) for prefix in "di")
    with writer.saved_state() as put_back:
        run = (
            code.emit_call_statement("begin_outcome", D),
            code.Assign(emit_state_entry(ERROR), ZERO),
            code.Assign(STEPS_LEFT, code.Constant(float(outer.engine.step_limit))),
            code.Assign(done, writer.emit_applied(rule, function.scope)),
            *put_back,
            code.If(code.Operation("!=", (done, ZERO)), (code.Return(ONE),)),
            code.If(code.Operation("!=", (emit_state_entry(ERROR), ZERO)), (code.Return(ONE),)),
            code.If(code.emit_not(code.emit_call("next_script", D)), (code.Return(ZERO),)),
        )
        most = code.emit_call("int", code.Subscript(D, code.Name("MOST")))
        writer.append(code.emit_call_statement("begin_script", D))
        writer.append(code.For(number, code.emit_call("range", most), run))
    return function.parameters, (*writer.all_statements(), code.Return(ZERO))


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
        return replace(owner, present=(*owner.present, *class_tests(self._facts, owner, cls)))


class _UnitFunction:
    """A function that runs a unit, or a block of it that can fail by itself.

    The function returns 2 after a change, 1 if the unit succeeds without, 0 if it fails, and -1 after an error; then
    the outputs.

    Args:
        outer: the emitter of the function that calls it.
        checked: the unit.
        types: the types of the variables of the unit that have a value, which are the parameters.
        outputs: the types of the variables whose values are returned.
    """

    def __init__(
        self,
        outer: FunctionEmitter,
        checked: CheckedUnit,
        types: Mapping[str, StaticType],
        outputs: Mapping[str, StaticType] = NO_OUTPUTS,
    ) -> None:
        nothing = [initial_constant(type_) for type_ in outputs.values()]
        self.writer = outer.new_emitter(code.Return(emit_result(NOBODY, nothing)))
        self.parameters = [outer.facts.new_local_for(type_) for type_ in types.values()]
        self._failure = code.Return(emit_result(ZERO, nothing))
        self._checked, self._outputs = checked, outputs
        self.scope = {
            name: object_or_value_term(outer, local, types[name])
            for name, local in zip(types, self.parameters, strict=True)
        }
        self._changed = outer.module.new_local("c")
        """Is 2 after a change, else 1."""

    def emit_whole(self, step: Step) -> tuple[list[code.Local], code.Body]:
        """Emit the step, and return the parameters and body of the function."""
        self.writer.append_assignment(self._changed, ONE)
        self._emit_step(step)
        result = emit_result(self._changed, [self.scope[name].number_code for name in self._outputs])
        return self.parameters, (*self.writer.all_statements(), code.Return(result))

    def emit_step_count(self) -> None:
        """Emit code that counts a step of the run, and fails beyond the limit."""
        self.writer.append(code.Assign(STEPS_LEFT, code.Constant(1.0), "-="))
        self.writer.append_fail_if(code.Operation("<", (STEPS_LEFT, code.Constant(0.0))))

    def emit_match_test(self, step: Step) -> code.Expression | None:
        """Return code that tests by matches if a step can succeed; None if this is not known before it is run."""
        match step:
            case Steps((only,)):
                return self.emit_match_test(only)
            case UnitChoice(alternatives):
                tests = [test for one in alternatives if (test := self.emit_match_test(one)) is not None]
                return code.emit_joined("or", tests, False) if len(tests) == len(alternatives) else None
            case UnitCall(where=(), by=None):
                callee = self._checked.calls[id(step)]
                members = self._members(callee, step.span)
                if callee.kind != "unit" and not any(may_rule_be_refused(self.writer, one) for one in members):
                    arguments = self._emit_arguments(step, callee, self.scope)
                    found = [self.writer.emit_exists(one, arguments.given) for one in members]
                    return code.emit_joined("and", [*arguments.tests, code.emit_joined("or", found, False)], True)
        return None

    # --- steps

    def _emit_step(self, step: Step) -> None:
        """Emit code for a step, which leaves the function if it fails; add the step's outputs to the scope."""
        done, scope = self.writer.module.new_local("done"), self.scope
        with add_missing_span(step.span or self._checked.unit.span):
            match step:
                case Steps(steps):
                    for one in steps:
                        self._emit_step(one)
                    return
                case Alap(body):
                    self._emit_alap(body, done)
                    return
                case Repeat():
                    self._emit_repeat(step, done)
                    return
                case UnitCall():
                    self._emit_call(step, scope, done)
                case UnitChoice():
                    self._emit_choice(step, done)
                case TryStep(body, otherwise):
                    self._emit_block(body, done)
                    instead = self.writer.collect(lambda: self._emit_block(otherwise, done, undo=False))
                    self.writer.append(code.If(code.emit_equal(done, ZERO), (CLEAR_REFUSED, *instead)))
                case IfStep(condition, then, otherwise):
                    asked = id(step) in self._checked.applicability_tests
                    test = self._emit_applicable(step) if asked else self._emit_condition(step, 0, condition, scope)
                    branches = [
                        self.writer.collect(lambda one=one: self._emit_block(one, done, undo=False))  # type: ignore[misc]
                        for one in (then, otherwise)
                    ]
                    self.writer.append(code.If(test, *branches))
                case AtomicStep(body):
                    bound = bound_outputs(body, self._checked.calls)
                    new = {name: type_ or ObjectType("") for name, type_ in bound.items() if name not in scope}
                    self._emit_block(body, done, new)
        self._leave_if(code.emit_equal(done, ZERO))
        self._note_change(done)

    def _leave_if(self, test: code.Expression) -> None:
        self.writer.append(code.If(test, (self._failure,)))

    def _note_change(self, done: code.Local) -> None:
        self.writer.append_assignment(self._changed, code.emit_call("max", self._changed, done))

    def _emit_block(
        self, step: Step | None, done: code.Local, new: Mapping[str, StaticType] = NO_OUTPUTS, *, undo: bool = True
    ) -> None:
        """Emit code that runs a block, and undoes its changes if it fails; the variables `new` get values.

        It sets `done` to 2 after a change, to 1 if the block succeeds without, and to 0 if it fails.
        """
        writer, scope = self.writer, self.scope
        if step is None:
            writer.append_assignment(done, ONE)
            return
        with writer.saved_state(undo and not fails_without_changes(step, self._checked.calls)) as put_back:
            if isinstance(step, UnitCall) and not new:
                self._emit_call(step, {**scope}, done)
            else:
                types = {name: term.type or ObjectType("") for name, term in scope.items()}
                name = writer.module.function_for(
                    object(), "block", lambda: _UnitFunction(writer, self._checked, types, new).emit_whole(step)
                )
                call = writer.emit_function_call(name, *(term.number_code for term in scope.values()))
                result = writer.emit_results(new)
                writer.append(result.assign(call), code.Assign(done, result.done))
                writer.append(code.If(code.Operation("<", (done, ZERO)), (writer.error_return,)))
                scope.update(result.outputs)
        if put_back:
            writer.append(code.If(code.emit_equal(done, ZERO), put_back))

    # --- loops

    def _emit_alap(self, body: Step, done: code.Local) -> None:
        """Emit code that repeats a step as long as it succeeds with a change."""

        def emit_round() -> None:
            self.emit_step_count()
            self._emit_block(body, done)
            self._note_change(done)

        self.writer.append_assignment(done, TWO)
        self.writer.append(code.While(code.emit_equal(done, TWO), self.writer.collect(emit_round)), CLEAR_REFUSED)

    def _emit_repeat(self, step: Repeat, done: code.Local) -> None:
        """Emit code that repeats a step a random number of times, and fails if fewer rounds than the least succeed."""
        writer = self.writer
        least = self._emit_bound(step.lower)
        most = least if step.upper == step.lower else self._emit_bound(step.upper)
        number, place = (writer.module.new_local(prefix) for prefix in "ni")
        spread = code.Operation("-", (most, least))
        if not (isinstance(step.lower, int) and isinstance(step.upper, int)):
            ordered = [code.Operation("<=", pair) for pair in ((ZERO, least), (least, most))]
            fits = code.Operation("<", (spread, code.Constant(LARGEST_INT)))  # the number of alternatives is an int
            writer.append_fail_if(code.emit_not(code.emit_joined("and", [*ordered, fits], True)))
        writer.append_assignment(number, least)
        if least is not most:
            writer.append(code.Assign(number, code.emit_call("pick", D, emit_sum(spread, 1)), "+="))

        def emit_round() -> None:
            self.emit_step_count()
            self._emit_block(step.body, done)
            too_few = code.If(code.Operation("<", (place, least)), (self._failure,), (CLEAR_REFUSED,))
            writer.append(code.If(code.emit_equal(done, ZERO), (too_few, code.BreakOrContinue("break"))))
            self._note_change(done)

        writer.append(code.For(place, code.emit_call("range", number), writer.collect(emit_round)))

    def _emit_bound(self, bound: int | Expression) -> code.Expression:
        if isinstance(bound, int):
            return code.Constant(bound)
        tests, local = list[code.Expression](), self.writer.module.new_local("n")
        term = self._emit_value(bound, self.scope, None, tests)
        if tests:
            self._leave_if(code.emit_not(code.emit_joined("and", tests, True)))
        self.writer.append_assignment(local, term.value)
        return local

    # --- choices

    def _emit_choice(self, step: UnitChoice, done: code.Local) -> None:
        """Emit code that tries alternatives by priority, those of equal priority in random order by weight."""
        writer, error = self.writer, emit_state_entry(ERROR)
        refused, failed = writer.module.new_local("refused"), code.emit_equal(done, ZERO)
        writer.append(code.Assign(refused, ZERO), code.Assign(done, ZERO))

        def attempt(alternative: Step) -> None:
            """Emit code that tries an alternative, and records if a rule was refused."""
            self._emit_block(alternative, done)
            writer.append(code.If(failed, (code.Assign(refused, code.emit_call("max", refused, error)),)))

        for tier in choice_tiers(step, self._checked.calls):
            tries = [(code.Constant(float(weight)), partial(attempt, each)) for each, weight in tier]
            writer.append_if(failed, lambda tries=tries: self._emit_draws(tries, done))  # type: ignore[misc]
        writer.append(code.If(failed, (code.Assign(error, refused),)))

    def _emit_draws(self, tries: Sequence[tuple[code.Expression, Callable[[], None]]], done: code.Local) -> None:
        """Emit code that makes attempts, given by their weights and code, in random order until one succeeds."""
        if len(tries) == 1 and isinstance(tries[0][0], code.Constant):
            tries[0][1]()
            return
        writer = self.writer
        left = [writer.module.new_local("w", "float") for _ in tries]
        for local, (weight, _) in zip(left, tries, strict=True):
            writer.append_assignment(local, weight)
        total, drawn = writer.module.new_local("total", "float"), writer.module.new_local("b")

        def emit_draw() -> None:
            chances = [code.Operation("/", (weight, total)) for weight in left]
            missing = code.Operation("-", (code.Constant(1.0), code.emit_joined("+", chances, 0)))
            writer.append_assignment(total, code.emit_joined("+", left, 0))
            writer.append_assignment(drawn, code.emit_call("choose", D, code.emit_tuple(*chances), missing))
            for number, (weight, (_, attempt)) in enumerate(zip(left, tries, strict=True)):
                attempted = writer.collect(attempt)
                made = code.Assign(weight, code.Constant(0.0)), *attempted
                writer.append(code.If(code.emit_equal(drawn, code.Constant(number)), made))

        some = code.Operation(">", (code.emit_joined("+", left, 0), code.Constant(0.0)))
        going = code.Operation("and", (code.emit_equal(done, ZERO), some))
        writer.append(code.While(going, writer.collect(emit_draw)))

    # --- calls

    def _emit_call(self, step: UnitCall, scope: dict[str, CodeTerm], done: code.Local) -> None:
        """Emit code that applies a rule or group, or runs a unit; it sets `done`, and adds outputs to the scope."""
        callee, writer = self._checked.calls[id(step)], self.writer
        calls = self._members(callee, step.span)
        if callee.kind != "unit":
            self.emit_step_count()
            writer.append(CLEAR_REFUSED)
        arguments = self._emit_arguments(step, callee, scope)
        if callee.kind == "unit":
            result = writer.emit_application(calls[0], arguments)
        elif callee.kind == "group" and not step.every:
            result = self._emit_group(calls)
        else:
            result = self._emit_rules(calls, arguments, step, scope)
        # A rule has changed something.
        writer.append_assignment(done, result.done if callee.kind == "unit" else emit_sum(result.done, result.done))
        scope.update(result.outputs)

    def _members(self, callee: Signature, span: Span | None) -> list[RuleCall]:
        """Return calls of the rules of a group, or of the rule or unit itself."""
        names = [callee.name] if callee.kind == "unit" else self.writer.engine.catalog.group(callee.name)
        return [RuleCall(name, span=span) for name in names]

    def _narrow(
        self, step: UnitCall, scope: UnitScope, names: Mapping[str, CodeTerm]
    ) -> tuple[list[code.Expression], CodeTerm | None]:
        """Return code for the conditions on a match, and the value that orders the matches, if any."""
        inside = {**scope, **names}
        passed = [self._emit_condition(step, *each, inside) for each in enumerate(step.where)]
        if step.by is None:
            return passed, None
        value = self._emit_expression(step.by, inside)
        return [*passed, *self._path_tests(step.by, inside), *value.tests], value

    def _emit_rules(
        self, calls: Sequence[RuleCall], arguments: Arguments, step: UnitCall, scope: UnitScope
    ) -> CallResult:
        """Emit code that applies a rule once, or rules at each match that they had first, if all tests pass."""
        writer, chosen = self.writer, step.where or step.by is not None
        if not (step.every or step.first or chosen or may_rule_be_refused(writer, calls[0])):
            return writer.emit_application(calls[0], arguments)
        result = writer.emit_results(writer.output_types(calls[0], arguments.wanted))
        narrow = partial(self._narrow, step, {**scope}) if chosen else None

        def attempt() -> None:
            with ExitStack() as reserved:
                members = [RuleAttempts(writer, call, arguments) for call in calls]
                for member in members:
                    reserved.enter_context(member.rows(narrow, step.limit))
                for member in members:
                    if step.every:
                        member.emit_every(self.emit_step_count, result.done)
                    else:
                        member.emit_one(result, in_order=step.first)
            writer.append(code.If(code.emit_equal(result.done, ONE), (CLEAR_REFUSED,)))

        writer.append_if(code.emit_joined("and", arguments.tests, True), attempt)
        return result

    def _emit_group(self, calls: Sequence[RuleCall]) -> CallResult:
        """Emit code that applies one rule of a group, drawn by weight among those with a match."""
        writer, result = self.writer, self.writer.emit_results({})

        def attempt(call: RuleCall) -> None:
            writer.append(CLEAR_REFUSED)
            writer.append_assignment(result.done, self._emit_rules([call], Arguments(), UnitCall(""), {}).done)

        tries: list[tuple[code.Expression, Callable[[], None]]] = []
        for call in calls:
            weight = code.Constant(float(writer.engine.signature(call.rule or "").weight))
            chance = code.ConditionalExpression(writer.emit_exists(call, {}), weight, code.Constant(0.0))
            tries.append((chance, partial(attempt, call)))
        self._emit_draws(tries, result.done)
        return result

    def _emit_arguments(self, step: UnitCall | Applicable, callee: Signature, scope: UnitScope) -> Arguments:
        """Emit code for the arguments of a call; a call that gives a value to an object that its rule creates fails."""
        arguments = self.writer.emit_arguments(step.arguments, callee, scope, self._emit_value)
        if callee.kind == "rule":
            known = plan_of(self.writer.engine, RuleCall(callee.name, span=step.span)).variables
            if not {*arguments.given} <= {*known}:
                return replace(arguments, given={}, tests=[code.FALSE])
        return arguments

    # --- values and conditions

    def _emit_expression(
        self, expression: Expression, scope: UnitScope, expected: StaticType | None = None
    ) -> CodeTerm:
        terms = _UnitExpressions(self.writer.facts, scope)
        term = terms.emit(expression, expected)
        self.writer.append(*terms.statements)
        return term

    def _emit_value(
        self,
        argument: Expression,
        scope: UnitScope,
        expected: StaticType | None,
        tests: list[code.Expression],
    ) -> CodeTerm:
        """Emit code for an argument or bound, and add its tests to `tests`.

        The step fails if a path in the argument has no value. The unit ends with an error if the evaluation fails.
        """
        tests += self._path_tests(argument, scope)
        term = self._emit_expression(argument, scope, expected)
        if term.valid:
            wrong = code.emit_not(code.emit_joined("and", term.valid, True))
            self.writer.append_fail_if(code.emit_joined("and", [*tests, wrong], True))
        tests += term.tests
        return term

    def _path_tests(self, expression: Expression, scope: UnitScope) -> list[code.Expression]:
        """Return expressions that test if all paths in an expression have values."""
        terms = [self._emit_expression(path, scope) for path in required_paths(expression)]
        return [test for term in terms for test in term.tests]

    def _emit_condition(
        self, step: Step, number: int, condition: Constraint | Applicable, scope: UnitScope
    ) -> code.Expression:
        """Return code that tests a condition, given its index `number` in the step."""
        if isinstance(condition, Check):
            asked = condition.expression
            term = self._emit_expression(asked, scope)
            return code.emit_joined("and", [*self._path_tests(asked, scope), *term.tests, term.value], True)
        found = self._checked.conditions[id(step), number]
        terms = [scope[name] for name in found.arguments]
        test = emit_holds(self.writer, found.pattern.qualified_name, terms)
        return code.emit_not(test) if found.negated else test

    def _emit_applicable(self, step: IfStep) -> code.Expression:
        """Emit code that tests if a rule, or one of a group, can be applied, and return the test."""
        asked, callee = self._checked.applicability_tests[id(step)]
        writer, error = self.writer, emit_state_entry(ERROR)
        result, before = writer.emit_results({}), writer.module.new_local("e")
        can = result.done
        writer.append(code.Assign(before, error), CLEAR_REFUSED)
        arguments = self._emit_arguments(asked, callee, self.scope)

        def ask(call: RuleCall) -> None:
            plan = plan_of(writer.engine, call)
            fails = any(one.computed or one.creates or one.may_contradict for one in plan.blocks)
            if not (fails or may_rule_be_refused(writer, call)):
                found = writer.emit_exists(call, arguments.given)
                writer.append_assignment(can, code.ConditionalExpression(found, ONE, ZERO))
                return
            attempts = RuleAttempts(writer, call, arguments)
            with attempts.rows():
                with writer.saved_state() as put_back:
                    attempts.emit_one(result, in_order=True)
                writer.append(*put_back)

        for call in self._members(callee, asked.span):
            free = code.emit_joined("and", [*arguments.tests, code.emit_equal(can, ZERO)], True)
            writer.append_if(free, partial(ask, call))
        writer.append(CLEAR_REFUSED, code.If(code.emit_equal(error, ZERO), (code.Assign(error, before),)))
        return code.emit_equal(can, ZERO if asked.negated else ONE)
