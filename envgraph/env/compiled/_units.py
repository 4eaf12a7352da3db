"""Emit functions for units that need no rollback, because no rule is applied before a step that can fail.

If the model refuses a rule at a match, the state is restored and another match is tried.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from envgraph import code
from envgraph.behaviour import RuleCall
from envgraph.env.compiled._changes import checked_unit, plan_of
from envgraph.env.compiled._layout import ERROR, NOBODY, ONE, ZERO, D, cell, listed
from envgraph.env.compiled._refused import NotCompiled, standing
from envgraph.env.compiled._terms import Term, as_float, named, zero_of
from envgraph.match.plan import ViewKey
from envgraph.metamodel import Scalar
from envgraph.pattern import (
    Atomic,
    Call,
    Check,
    Choice,
    Expression,
    If,
    ObjectType,
    Sequence as Steps,
    StaticType,
    Step,
    Try,
    Variable,
    navigations,
    variables_in,
)
from envgraph.rewrite import Signature
from envgraph.rewrite.plans import CheckedUnit

if TYPE_CHECKING:
    from envgraph.env.compiled._writer import Writer

Scope = dict[str, Term]
"""The terms of the unit's variables that have a value at a point of its code."""


def unit_function(
    outer: Writer, call: RuleCall, bound: Sequence[str], wanted: Sequence[str], *, asks: bool = False
) -> tuple[list[code.Local], code.Body]:
    """Emit the parameters and body of a function that runs a unit.

    The function returns 1 and the outputs, 0 if the unit fails, and -1 after an error.

    Args:
        outer: the emitter of the function that calls it.
        call: the call of the unit.
        bound, wanted: the parameters that get values, and the outputs.
        asks: only test if the unit can succeed, without changes; an error counts as success.
    """
    checked, fixed = checked_unit(outer.engine, call), outer.facts.changes.fixed_class
    parameters = [outer.facts.local(checked.types[name] or ObjectType("")) for name in bound]
    scope: Scope = {}
    for name, local in zip(bound, parameters, strict=True):
        type_ = checked.types[name]
        sure = type_.cls if isinstance(type_, ObjectType) and fixed(type_.cls) else None
        scope[name] = named(local, type_, sure)
    nothing = [zero_of(checked.types[name]) for name in wanted]
    writer = outer.another(code.Return(listed(ONE if asks else NOBODY, nothing)))
    done = writer.module.fresh("done")
    writer.assign(done, ZERO)
    steps = _Steps(writer, checked, asks)
    steps.write(checked.unit.body, scope, done)
    steps.check_known(wanted, scope)
    writer.when(code.equal(done, ONE), lambda: writer.add(NOT_REFUSED))
    writer.add(code.Return(listed(done, [scope[name].number for name in wanted])))
    return parameters, writer.written()


NOT_REFUSED = code.If(code.equal(cell(ERROR), code.Name("REFUSED")), (code.Assign(cell(ERROR), ZERO),))
"""Clears the error code if it is `REFUSED`, which a failed step leaves behind; other errors stay."""


class _Steps:
    """An emitter of the steps of a unit.

    Args:
        writer: the emitter of the unit's function.
        checked: the unit.
        asks: only test if steps can be done.
    """

    def __init__(self, writer: Writer, checked: CheckedUnit, asks: bool) -> None:
        self._writer = writer
        self._checked = checked
        self._name = checked.unit.name
        self._facts = writer.facts
        self._asks = asks

    def write(self, step: Step, scope: Scope, done: code.Local) -> None:
        """Emit code that sets `done` from 0 to 1 if the step succeeds; add the step's outputs to the scope."""
        with standing(step.span or self._checked.unit.span):
            match step:
                case Call():
                    self._call(step, scope, done)
                case Steps(steps):
                    self._sequence(steps, scope, done)
                case Choice():
                    self._choice(step, scope, done)
                case Try(body, otherwise):
                    self.write(body, {**scope}, done)
                    self._unless_done(done, lambda: self._branch(otherwise, scope, done))
                case If(_, then, otherwise):
                    test = self._holds(step, scope)
                    chosen = [
                        self._writer.collected(lambda one=one: self._branch(one, scope, done))  # type: ignore[misc]
                        for one in (then, otherwise)
                    ]
                    self._writer.add(code.If(test, *chosen))
                case Atomic(body):
                    self.write(body, scope, done)
                case _:
                    raise NotCompiled(f"`{type(step).__name__.lower()}` in a unit (`{self._name}`)")

    def _branch(self, step: Step | None, scope: Scope, done: code.Local) -> None:
        """Emit code for a step in a copy of the scope. If the step is None, the code sets `done` to 1."""
        if step is None:
            self._writer.assign(done, ONE)
        else:
            self.write(step, {**scope}, done)

    def _unless_done(self, done: code.Local, write: Callable[[], None]) -> None:
        self._writer.when(code.equal(done, ZERO), write)

    def _sequence(self, steps: Sequence[Step], scope: Scope, done: code.Local) -> None:
        """Emit code for a sequence of steps.

        Raises:
            NotCompiled: a step other than the first may fail.
        """
        if not steps:
            self._writer.assign(done, ONE)
            return
        for step in steps[1:]:
            if not _never_fails(step):
                raise NotCompiled(
                    f"a step of a unit that may fail after other steps (`{self._name}`)", step.span
                )
        self.write(steps[0], scope, done)
        if self._asks or len(steps) == 1:
            return

        def others() -> None:
            for step in steps[1:]:
                succeeds = self._writer.module.fresh("done")
                self._writer.assign(succeeds, ZERO)
                self.write(step, scope, succeeds)

        self._writer.when(code.equal(done, ONE), others)

    # --- choices

    def _choice(self, step: Choice, scope: Scope, done: code.Local) -> None:
        """Emit code that tries alternatives by priority, those of equal priority in random order by weight."""
        tiers: dict[int, list[tuple[float, Step]]] = {}
        for alternative in step.alternatives:
            callee = self._checked.calls[id(alternative)] if isinstance(alternative, Call) else None
            priority, weight = (0, 1.0) if callee is None else (callee.priority, callee.weight)
            tiers.setdefault(priority, []).append((weight, alternative))
        refused = self._writer.module.fresh("refused")
        self._writer.assign(refused, ZERO)

        def attempt(alternative: Step) -> None:
            """Emit code that tries an alternative, and records if a rule was refused."""
            self._branch(alternative, scope, done)
            self._unless_done(
                done, lambda: self._writer.assign(refused, code.call("max", refused, cell(ERROR)))
            )

        for priority in sorted(tiers, reverse=True):
            self._unless_done(done, lambda tier=tiers[priority]: self._tier(tier, attempt, done))  # type: ignore[misc]
        self._unless_done(done, lambda: self._writer.add(code.Assign(cell(ERROR), refused)))

    def _tier(
        self, tier: Sequence[tuple[float, Step]], attempt: Callable[[Step], None], done: code.Local
    ) -> None:
        if self._asks or len(tier) == 1:
            for _, step in tier:
                self._unless_done(done, lambda step=step: attempt(step))  # type: ignore[misc]
            return
        writer = self._writer
        left = [writer.module.fresh("w", "float") for _ in tier]
        for local, (weight, _) in zip(left, tier, strict=True):
            writer.assign(local, code.Constant(float(weight)))
        total = code.joined("+", left, 0)
        going = code.Operation(
            "and", (code.equal(done, ZERO), code.Operation(">", (total, code.Constant(0.0))))
        )
        steps = [step for _, step in tier]
        writer.add(code.While(going, writer.collected(lambda: self._turn(steps, left, total, attempt))))

    def _turn(
        self,
        steps: Sequence[Step],
        left: Sequence[code.Local],
        total: code.Expression,
        attempt: Callable[[Step], None],
    ) -> None:
        """Emit code that samples one of the untried alternatives by weight and tries it; its weight becomes 0."""
        writer = self._writer
        whole, drawn = writer.module.fresh("total", "float"), writer.module.fresh("b")
        writer.assign(whole, total)
        chances = [writer.module.fresh("p", "float") for _ in left]
        for chance, weight in zip(chances, left, strict=True):
            writer.assign(chance, code.Operation("/", (weight, whole)))
        missing = code.Operation("-", (code.Constant(1.0), code.joined("+", chances, 0)))
        writer.assign(drawn, code.call("choose", D, code.tuple_of(*chances), missing))
        for number, (step, weight) in enumerate(zip(steps, left, strict=True)):

            def take(step: Step = step, weight: code.Local = weight) -> None:
                writer.assign(weight, code.Constant(0.0))
                attempt(step)

            writer.when(code.equal(drawn, code.Constant(number)), take)

    # --- calls

    def _call(self, step: Call, scope: Scope, done: code.Local) -> None:
        """Emit code for a call in a unit: it applies the rule or runs the unit, or only tests this, and sets `done`."""
        callee, writer = self._checked.calls[id(step)], self._writer
        words = {"all": step.every, "first": step.first, "top": step.limit is not None, "where": step.where}
        for word, used in words.items():
            if used:
                raise NotCompiled(f"`{word}` in a unit (`{self._name}`)")
        given, tests, wanted = self._arguments(step, callee, scope)
        call = RuleCall(callee.name, span=step.span)
        writer.add(NOT_REFUSED)
        tried = callee.kind == "rule" and self._may_be_refused(call, given)
        if self._asks:
            found = writer.possible(call, given, tried=tried)
            writer.add(code.If(code.joined("and", [*tests, found], True), (code.Assign(done, ONE),)))
            return
        called = writer.applied(call, given, tests, wanted, tried=tried)
        writer.assign(done, called.done)
        scope.update(called.outputs)

    def _arguments(
        self, step: Call, callee: Signature, scope: Scope
    ) -> tuple[dict[str, code.Expression], list[code.Expression], dict[str, str]]:
        """Emit code for the arguments of a call.

        Returns:
            The values by parameter, tests that they exist, and the unit's variable for each output parameter.
        """
        given: dict[str, code.Expression] = {}
        tests: list[code.Expression] = []
        wanted: dict[str, str] = {}
        for argument, taken in zip(step.arguments, callee.parameters, strict=False):
            if isinstance(argument, Variable) and argument.anonymous:
                continue
            if isinstance(argument, Variable) and argument.name not in scope and taken.output:
                wanted[taken.name] = argument.name
                continue
            term = self._value(argument, scope, taken.type, tests)
            if isinstance(taken.type, ObjectType):
                tests += self._fitting(term, taken.type.cls, callee)
            given[taken.name] = as_float(term) if taken.type is Scalar.FLOAT else term.number
        return given, tests, wanted

    def _value(
        self, argument: Expression, scope: Scope, expected: StaticType | None, tests: list[code.Expression]
    ) -> Term:
        """Emit code for an argument, and add its tests to `tests`.

        The step fails if a path in the argument has no value. The unit ends with an error if the evaluation fails.
        """
        self.check_known([variable.name for variable in variables_in(argument)], scope)
        writer = self._writer
        tests += self._paths(argument, scope)
        term = writer.value(argument, scope, expected)
        if term.valid:
            writer.fail_if(
                code.joined("and", [*tests, code.inverse(code.joined("and", term.valid, True))], True)
            )
        tests += term.tests
        if term.beyond is not None and expected is not Scalar.FLOAT:
            writer.fail_if(code.joined("and", [*tests, term.beyond], True), "BEYOND")
        return term

    def _paths(self, expression: Expression, scope: Scope) -> list[code.Expression]:
        """Return expressions that test if all paths in an expression have values."""
        terms = [self._writer.value(path, scope) for path in navigations(expression)]
        return [test for term in terms for test in term.tests]

    def _fitting(self, term: Term, cls: str, callee: Signature) -> list[code.Expression]:
        """Return expressions that test if an object exists and has a rule parameter's class; none for units.

        Raises:
            NotCompiled: the class of a unit's argument is not certain.
        """
        assert isinstance(term.type, ObjectType)
        sure = self._facts.metamodel.is_a(term.type.cls, cls)
        if callee.kind == "unit":
            if not sure:
                raise NotCompiled(f"an argument of a unit whose class is not certain (`{callee.simple}`)")
            return []
        alive = self._writer.alive(term)
        tests = [] if alive is None else [alive]
        if not (sure and self._facts.changes.fixed_class(cls)):
            tests.append(self._facts.is_instance(term.value, cls))
        return tests

    def _may_be_refused(self, call: RuleCall, given: Mapping[str, code.Expression]) -> bool:
        """Return True if the model may refuse a change of the rule, so that the unit has to try another match.

        Raise `NotCompiled` if it may, and the rule's matches may contradict each other.
        """
        module, found = self._writer.module, False
        with module.trial():
            name = self._writer.applying(call, tuple(given), ())
            bodies = {function.name: function.body for function in module.functions}
            reached = [name]
            for each in reached:  # the loop appends to `reached`
                names = {node.name for node in code.walk(bodies[each]) if isinstance(node, code.Name)}
                found = found or "REFUSED" in names
                reached += sorted(names & bodies.keys() - {*reached})
        body = plan_of(self._writer.engine, call).body
        if found and (body.nested or body.coinciding):
            raise NotCompiled(
                f"a rule in a unit whose matches may contradict each other (`{call.rule}`)", call.span
            )
        return found

    # --- conditions

    def _holds(self, step: If, scope: Scope) -> code.Expression:
        """Return code that tests the condition of an `if`. Raise `NotCompiled` if it asks if a rule can be applied."""
        if id(step) in self._checked.asked:
            raise NotCompiled(f"an `if` in a unit that asks whether a rule can be applied (`{self._name}`)")
        if isinstance(step.condition, Check):
            asked = step.condition.expression
            self.check_known([variable.name for variable in variables_in(asked)], scope)
            term = self._writer.value(asked, scope)
            return code.joined("and", [*self._paths(asked, scope), *term.tests, term.value], True)
        found = self._checked.conditions[id(step), 0]
        self.check_known(found.arguments, scope)
        types = self._facts.library.parameter_types(found.pattern.qualified_name)
        tests = [
            self._facts.is_instance(scope[name].value, type_.cls)
            for name, type_ in zip(found.arguments, types, strict=True)
            if isinstance(type_, ObjectType) and not self._facts.changes.fixed_class(type_.cls)
        ]
        key = ViewKey(found.pattern.qualified_name, tuple(range(len(types))), ())
        exists = self._writer.matching.exists(key)
        held = self._writer.call(exists, *(scope[name].number for name in found.arguments))
        test = code.joined("and", [*tests, held], True)
        return code.inverse(test) if found.negated else test

    def check_known(self, names: Sequence[str], scope: Scope) -> None:
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
        case Choice(alternatives):
            return any(map(_never_fails, alternatives))
        case Try(_, otherwise):
            return _never_fails(otherwise)
        case If(_, then, otherwise):
            return _never_fails(then) and _never_fails(otherwise)
        case Atomic(body):
            return _never_fails(body)
        case _:
            return step is None
