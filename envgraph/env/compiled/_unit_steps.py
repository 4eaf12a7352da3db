"""Emit functions for units that need no rollback, because no rule is applied before a step that can fail.

If the model refuses a rule at a match, the state is restored and another match is tried.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from envgraph import code
from envgraph.behaviour import RuleCall
from envgraph.env.compiled._changes import checked_unit, plan_of
from envgraph.env.compiled._not_compiled import NotCompiled, add_missing_span
from envgraph.env.compiled._program_layout import ERROR, NOBODY, ONE, ZERO, D, emit_result, emit_state_entry
from envgraph.env.compiled._term_code import CodeTerm, emit_as_float, initial_constant, variable_term
from envgraph.match.plan import PatternQuery
from envgraph.metamodel import Scalar
from envgraph.pattern import (
    AtomicStep,
    Check,
    Expression,
    IfStep,
    ObjectType,
    StaticType,
    Step,
    StepSequence as Steps,
    TryStep,
    UnitCall,
    UnitChoice,
    Variable,
    required_paths,
    variables_in,
)
from envgraph.rewrite import Signature
from envgraph.rewrite.plans import CheckedUnit, may_be_refused

if TYPE_CHECKING:
    from envgraph.env.compiled._clause_code import FunctionEmitter

UnitScope = dict[str, CodeTerm]
"""The terms of the unit's variables that have a value at a point of its code."""


def emit_unit(
    outer: FunctionEmitter,
    call: RuleCall,
    bound: Sequence[str],
    outputs: Sequence[str],
    *,
    tests_only: bool = False,
) -> tuple[list[code.Local], code.Body]:
    """Emit the parameters and body of a function that runs a unit.

    The function returns 1 and the outputs, 0 if the unit fails, and -1 after an error.

    Args:
        outer: the emitter of the function that calls it.
        call: the call of the unit.
        bound, outputs: the parameters that get values, and the outputs.
        tests_only: only test if the unit can succeed, without changes; an error counts as success.
    """
    checked, fixed = checked_unit(outer.engine, call), outer.facts.changes.is_fixed_class
    parameters = [outer.facts.new_local_for(checked.types[name] or ObjectType("")) for name in bound]
    scope: UnitScope = {}
    for name, local in zip(bound, parameters, strict=True):
        type_ = checked.types[name]
        sure = type_.cls if isinstance(type_, ObjectType) and fixed(type_.cls) else None
        scope[name] = variable_term(local, type_, sure)
    nothing = [initial_constant(checked.types[name]) for name in outputs]
    writer = outer.new_emitter(code.Return(emit_result(ONE if tests_only else NOBODY, nothing)))
    done = writer.module.new_local("done")
    writer.append_assignment(done, ZERO)
    steps = _UnitStepEmitter(writer, checked, tests_only)
    steps.emit_step(checked.unit.body, scope, done)
    steps.check_bound(outputs, scope)
    writer.append_if(code.emit_equal(done, ONE), lambda: writer.append(CLEAR_REFUSED))
    writer.append(code.Return(emit_result(done, [scope[name].number_code for name in outputs])))
    return parameters, writer.all_statements()


CLEAR_REFUSED = code.If(
    code.emit_equal(emit_state_entry(ERROR), code.Name("REFUSED")),
    (code.Assign(emit_state_entry(ERROR), ZERO),),
)
"""Clears the error code if it is `REFUSED`, which a failed step leaves behind; other errors stay."""


class _UnitStepEmitter:
    """An emitter of the steps of a unit.

    Args:
        writer: the emitter of the unit's function.
        checked: the unit.
        asks: only test if steps can be done.
    """

    def __init__(self, writer: FunctionEmitter, checked: CheckedUnit, asks: bool) -> None:
        self._writer = writer
        self._checked = checked
        self._name = checked.unit.name
        self._facts = writer.facts
        self._tests_only = asks

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
                case TryStep(body, otherwise):
                    self.emit_step(body, {**scope}, done)
                    self._emit_unless_done(done, lambda: self._emit_branch(otherwise, scope, done))
                case IfStep(_, then, otherwise):
                    test = self._emit_condition(step, scope)
                    chosen = [
                        self._writer.collect(lambda one=one: self._emit_branch(one, scope, done))  # type: ignore[misc]
                        for one in (then, otherwise)
                    ]
                    self._writer.append(code.If(test, *chosen))
                case AtomicStep(body):
                    self.emit_step(body, scope, done)
                case _:
                    raise NotCompiled(f"`{type(step).__name__.lower()}` in a unit (`{self._name}`)")

    def _emit_branch(self, step: Step | None, scope: UnitScope, done: code.Local) -> None:
        """Emit code for a step in a copy of the scope. If the step is None, the code sets `done` to 1."""
        if step is None:
            self._writer.append_assignment(done, ONE)
        else:
            self.emit_step(step, {**scope}, done)

    def _emit_unless_done(self, done: code.Local, write: Callable[[], None]) -> None:
        self._writer.append_if(code.emit_equal(done, ZERO), write)

    def _emit_sequence(self, steps: Sequence[Step], scope: UnitScope, done: code.Local) -> None:
        """Emit code for a sequence of steps.

        Raises:
            NotCompiled: a step other than the first may fail.
        """
        if not steps:
            self._writer.append_assignment(done, ONE)
            return
        for step in steps[1:]:
            if not _never_fails(step):
                raise NotCompiled(f"a step of a unit that may fail after other steps (`{self._name}`)", step.span)
        self.emit_step(steps[0], scope, done)
        if self._tests_only or len(steps) == 1:
            return

        def others() -> None:
            for step in steps[1:]:
                succeeds = self._writer.module.new_local("done")
                self._writer.append_assignment(succeeds, ZERO)
                self.emit_step(step, scope, succeeds)

        self._writer.append_if(code.emit_equal(done, ONE), others)

    # --- choices

    def _emit_choice(self, step: UnitChoice, scope: UnitScope, done: code.Local) -> None:
        """Emit code that tries alternatives by priority, those of equal priority in random order by weight."""
        tiers: dict[int, list[tuple[float, Step]]] = {}
        for alternative in step.alternatives:
            callee = self._checked.calls[id(alternative)] if isinstance(alternative, UnitCall) else None
            priority, weight = (0, 1.0) if callee is None else (callee.priority, callee.weight)
            tiers.setdefault(priority, []).append((weight, alternative))
        refused = self._writer.module.new_local("refused")
        self._writer.append_assignment(refused, ZERO)

        def attempt(alternative: Step) -> None:
            """Emit code that tries an alternative, and records if a rule was refused."""
            self._emit_branch(alternative, scope, done)
            self._emit_unless_done(
                done,
                lambda: self._writer.append_assignment(
                    refused, code.emit_call("max", refused, emit_state_entry(ERROR))
                ),
            )

        for priority in sorted(tiers, reverse=True):
            self._emit_unless_done(done, lambda tier=tiers[priority]: self._emit_tier(tier, attempt, done))  # type: ignore[misc]
        self._emit_unless_done(done, lambda: self._writer.append(code.Assign(emit_state_entry(ERROR), refused)))

    def _emit_tier(self, tier: Sequence[tuple[float, Step]], attempt: Callable[[Step], None], done: code.Local) -> None:
        if self._tests_only or len(tier) == 1:
            for _, step in tier:
                self._emit_unless_done(done, lambda step=step: attempt(step))  # type: ignore[misc]
            return
        writer = self._writer
        left = [writer.module.new_local("w", "float") for _ in tier]
        for local, (weight, _) in zip(left, tier, strict=True):
            writer.append_assignment(local, code.Constant(float(weight)))
        total = code.emit_joined("+", left, 0)
        going = code.Operation("and", (code.emit_equal(done, ZERO), code.Operation(">", (total, code.Constant(0.0)))))
        steps = [step for _, step in tier]
        writer.append(
            code.While(going, writer.collect(lambda: self._emit_sampled_alternative(steps, left, total, attempt)))
        )

    def _emit_sampled_alternative(
        self,
        steps: Sequence[Step],
        left: Sequence[code.Local],
        total: code.Expression,
        attempt: Callable[[Step], None],
    ) -> None:
        """Emit code that samples one of the untried alternatives by weight and tries it; its weight becomes 0."""
        writer = self._writer
        whole, drawn = writer.module.new_local("total", "float"), writer.module.new_local("b")
        writer.append_assignment(whole, total)
        chances = [writer.module.new_local("p", "float") for _ in left]
        for chance, weight in zip(chances, left, strict=True):
            writer.append_assignment(chance, code.Operation("/", (weight, whole)))
        missing = code.Operation("-", (code.Constant(1.0), code.emit_joined("+", chances, 0)))
        writer.append_assignment(drawn, code.emit_call("choose", D, code.emit_tuple(*chances), missing))
        for number, (step, weight) in enumerate(zip(steps, left, strict=True)):

            def take(step: Step = step, weight: code.Local = weight) -> None:
                writer.append_assignment(weight, code.Constant(0.0))
                attempt(step)

            writer.append_if(code.emit_equal(drawn, code.Constant(number)), take)

    # --- calls

    def _emit_call(self, step: UnitCall, scope: UnitScope, done: code.Local) -> None:
        """Emit code for a call in a unit: it applies the rule or runs the unit, or only tests this, and sets `done`."""
        callee, writer = self._checked.calls[id(step)], self._writer
        words = {"all": step.every, "first": step.first, "top": step.limit is not None, "where": step.where}
        for word, used in words.items():
            if used:
                raise NotCompiled(f"`{word}` in a unit (`{self._name}`)")
        given, tests, wanted = self._emit_arguments(step, callee, scope)
        call = RuleCall(callee.name, span=step.span)
        writer.append(CLEAR_REFUSED)
        tried = callee.kind == "rule" and self._may_be_refused(call)
        if self._tests_only:
            found = writer.emit_can_apply(call, given, retries_refused=tried)
            writer.append(code.If(code.emit_joined("and", [*tests, found], True), (code.Assign(done, ONE),)))
            return
        called = writer.emit_application(call, given, tests, wanted, retries_refused=tried)
        writer.append_assignment(done, called.done_variable)
        scope.update(called.outputs)

    def _emit_arguments(
        self, step: UnitCall, callee: Signature, scope: UnitScope
    ) -> tuple[dict[str, code.Expression], list[code.Expression], dict[str, str]]:
        """Emit code for the arguments of a call.

        Returns:
            The values by parameter, tests that they exist, and the unit's variable for each output parameter.
        """
        given: dict[str, code.Expression] = {}
        tests: list[code.Expression] = []
        wanted: dict[str, str] = {}
        for argument, taken in zip(step.arguments, callee.parameters, strict=False):
            if isinstance(argument, Variable) and argument.is_anonymous:
                continue
            if isinstance(argument, Variable) and argument.name not in scope and taken.is_output:
                wanted[taken.name] = argument.name
                continue
            term = self._emit_value(argument, scope, taken.type, tests)
            if isinstance(taken.type, ObjectType):
                tests += self._class_tests(term, taken.type.cls, callee)
            given[taken.name] = emit_as_float(term) if taken.type is Scalar.FLOAT else term.number_code
        return given, tests, wanted

    def _emit_value(
        self,
        argument: Expression,
        scope: UnitScope,
        expected: StaticType | None,
        tests: list[code.Expression],
    ) -> CodeTerm:
        """Emit code for an argument, and add its tests to `tests`.

        The step fails if a path in the argument has no value. The unit ends with an error if the evaluation fails.
        """
        self.check_bound([variable.name for variable in variables_in(argument)], scope)
        writer = self._writer
        tests += self._path_tests(argument, scope)
        term = writer.emit_value(argument, scope, expected)
        if term.valid:
            writer.append_fail_if(
                code.emit_joined("and", [*tests, code.emit_not(code.emit_joined("and", term.valid, True))], True)
            )
        tests += term.tests
        return term

    def _path_tests(self, expression: Expression, scope: UnitScope) -> list[code.Expression]:
        """Return expressions that test if all paths in an expression have values."""
        terms = [self._writer.emit_value(path, scope) for path in required_paths(expression)]
        return [test for term in terms for test in term.tests]

    def _class_tests(self, term: CodeTerm, cls: str, callee: Signature) -> list[code.Expression]:
        """Return expressions that test if an object exists and has a rule parameter's class; none for units.

        Raises:
            NotCompiled: the class of a unit's argument is not certain.
        """
        assert isinstance(term.type, ObjectType)
        sure = self._facts.metamodel.is_a(term.type.cls, cls)
        if callee.kind == "unit":
            if not sure:
                raise NotCompiled(f"an argument of a unit whose class is not certain (`{callee.simple_name}`)")
            return []
        alive = self._writer.alive_test(term)
        tests = [] if alive is None else [alive]
        if not (sure and self._facts.changes.is_fixed_class(cls)):
            tests.append(self._facts.emit_is_instance(term.value, cls))
        return tests

    def _may_be_refused(self, call: RuleCall) -> bool:
        """Return True if the model may refuse a change of the rule, so that the unit has to try another match.

        Raise `NotCompiled` if it depends on the order of a block's matches if one is refused or contradicts another.
        """
        plan = plan_of(self._writer.engine, call)
        if any(block.identification_pairs or block.identification_link_pairs for block in plan.blocks[1:]):
            raise NotCompiled(
                f"a rule in a unit whose blocks may delete an object that they keep (`{call.rule}`)", call.span
            )
        return may_be_refused(plan, self._facts.metamodel)

    # --- conditions

    def _emit_condition(self, step: IfStep, scope: UnitScope) -> code.Expression:
        """Return code that tests the condition of an `if`. Raise `NotCompiled` if it asks if a rule can be applied."""
        if id(step) in self._checked.applicability_tests:
            raise NotCompiled(f"an `if` in a unit that asks whether a rule can be applied (`{self._name}`)")
        if isinstance(step.condition, Check):
            asked = step.condition.expression
            self.check_bound([variable.name for variable in variables_in(asked)], scope)
            term = self._writer.emit_value(asked, scope)
            return code.emit_joined("and", [*self._path_tests(asked, scope), *term.tests, term.value], True)
        found = self._checked.conditions[id(step), 0]
        self.check_bound(found.arguments, scope)
        types = self._facts.library.parameter_types(found.pattern.qualified_name)
        tests = [
            self._facts.emit_is_instance(scope[name].value, type_.cls)
            for name, type_ in zip(found.arguments, types, strict=True)
            if isinstance(type_, ObjectType) and not self._facts.changes.is_fixed_class(type_.cls)
        ]
        key = PatternQuery(found.pattern.qualified_name, tuple(range(len(types))), ())
        exists = self._writer.matching.emit_exists(key)
        held = self._writer.emit_function_call(exists, *(scope[name].number_code for name in found.arguments))
        test = code.emit_joined("and", [*tests, held], True)
        return code.emit_not(test) if found.negated else test

    def check_bound(self, names: Sequence[str], scope: UnitScope) -> None:
        """Check that all variables have a value at this point of the unit.

        Raises:
            NotCompiled: a variable may have no value.
        """
        for name in names:
            if name not in scope:
                raise NotCompiled(f"a variable of a unit that may have no value (`{name}`)")


def _never_fails(step: Step | None) -> bool:
    match step:
        case Steps(steps):
            return all(map(_never_fails, steps))
        case UnitChoice(alternatives):
            return any(map(_never_fails, alternatives))
        case TryStep(_, otherwise):
            return _never_fails(otherwise)
        case IfStep(_, then, otherwise):
            return _never_fails(then) and _never_fails(otherwise)
        case AtomicStep(body):
            return _never_fails(body)
        case _:
            return step is None
