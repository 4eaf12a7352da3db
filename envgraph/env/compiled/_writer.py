"""Emit statements for the clauses of a behaviour: values, calls of rules, and queries."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from envgraph import code
from envgraph.behaviour import Branch, Question, RuleCall, condition_question, roots
from envgraph.code import dataclass
from envgraph.env._prepared import Types
from envgraph.env._program import added
from envgraph.env._sampling import lacking
from envgraph.env._tabular import MOST_REWARD
from envgraph.env.compiled._attempts import attempts
from envgraph.env.compiled._changes import plan_of
from envgraph.env.compiled._effects import Effects
from envgraph.env.compiled._layout import ERROR, NOBODY, ONE, TOP, ZERO, D, call, cell, listed, plus, table
from envgraph.env.compiled._matching import Matching
from envgraph.env.compiled._refused import NotCompiled, standing
from envgraph.env.compiled._statements import Statements
from envgraph.env.compiled._tables import Keyed
from envgraph.env.compiled._terms import Term, Terms, as_float, named, zero_of
from envgraph.env.compiled._units import unit_function
from envgraph.match.plan import ViewKey
from envgraph.metamodel import Scalar
from envgraph.pattern import Constant, Expression, Negation, ObjectType, StaticType, Variable
from envgraph.rewrite import Engine
from envgraph.rewrite.plans import RulePlan


@dataclass(frozen=True, slots=True)
class Called:
    """The variables that hold the result of a rule call after its code has run.

    Attributes:
        done: the variable that is 1 if a rule was applied or the call is `nothing()`, otherwise 0.
        outputs: the terms of the output names.
    """

    done: code.Local
    outputs: Mapping[str, Term]


class Writer(Statements):
    """An emitter of the statements of one function of a behaviour.

    Args:
        matching: emits code that finds matches.
        engine: supplies the rules.
        behaviour: the name of the behaviour.
        leave: the return statement of the function after an error.
    """

    def __init__(self, matching: Matching, engine: Engine, behaviour: str, leave: code.Return) -> None:
        super().__init__(leave)
        self.matching = matching
        self.facts = matching.facts
        self.module = matching.module
        self.engine = engine
        self.behaviour = behaviour
        self.top: code.Expression = TOP
        self.levels = 0

    def call(self, name: str, *arguments: code.Expression) -> code.Call:
        """Return code that calls a function of the program, and record that the current function calls it."""
        self.module.uses(name, self.levels)
        return call(name, *arguments, top=self.top)

    # --- values

    def value(
        self, expression: Expression, scope: Mapping[str, Term], expected: StaticType | None = None
    ) -> Term:
        """Emit code for an expression, and return its term."""
        terms = Terms(self.facts, scope)
        term = terms.write(expression, expected)
        self.add(*terms.steps)
        return term

    def number(self, expression: Expression, scope: Mapping[str, Term]) -> code.Expression:
        """Emit code for a reward or weight as a float; a missing, failing or too large value is an error."""
        term = self.value(expression, scope)
        if term.tests:
            self.fail_if(code.inverse(code.joined("and", term.tests, True)))
        known = expression.value if isinstance(expression, Constant) else None
        if term.type is not Scalar.FLOAT or (isinstance(known, float) and abs(known) <= MOST_REWARD):
            return as_float(term)
        local = self.module.fresh("r", "float")
        self.assign(local, term.value)
        self.fail_if(code.Operation(">", (code.call("abs", local), code.Constant(MOST_REWARD))))
        return local

    def keyed(self, cls: str, index: code.Expression) -> code.Local:
        """Emit code that looks up the object with an index in a class, or -1 if there is none. Return its variable."""
        local, changes = self.facts.local(ObjectType(cls)), self.facts.changes
        objects = self.facts.layout.offset(Keyed(cls, changes.becoming(cls)))
        self.assign(local, table(plus(objects, index)))
        if not changes.fixed_class(cls):
            there = code.Operation(">=", (local, ZERO))
            gone = code.Operation("and", (there, code.inverse(self.facts.is_instance(local, cls))))
            self.add(code.If(gone, (code.Assign(local, NOBODY),)))
        return local

    def gone(self, term: Term, cls: str) -> code.Expression | None:
        """Return an expression that tests if an object is deleted or no longer of a class; None if it cannot be."""
        if self.facts.changes.fixed_class(cls):
            return None
        return code.inverse(self.facts.is_instance(term.value, cls))

    def alive(self, term: Term) -> code.Expression | None:
        """Return an expression that tests if an object is not deleted; None if it cannot be deleted."""
        assert isinstance(term.type, ObjectType)
        return self.facts.alive(term.value, term.type.cls)

    # --- calls

    def run(self, rule: RuleCall, scope: Mapping[str, Term]) -> Called:
        """Emit code that evaluates the arguments of a call, then applies its rule at one match or runs its unit.

        If the call is `nothing()`, the code only sets `done` to 1.
        """
        if rule.rule is None:
            done = self.module.fresh("done")
            self.assign(done, ONE)
            return Called(done, {})
        given, tests = self._given(rule, scope)
        parameters = self.engine.signature(rule.rule).parameters
        called = self.applied(
            rule,
            given,
            tests,
            {
                taken.name: argument.name
                for argument, taken in zip(rule.arguments, parameters, strict=True)
                if taken.output and isinstance(argument, Variable) and not argument.anonymous
            },
        )
        if self._is_unit(rule):
            self.add(code.If(code.Operation("!=", (cell(ERROR), ZERO)), (self.leave,)))
        return called

    def applied(
        self,
        rule: RuleCall,
        given: Mapping[str, code.Expression],
        tests: Sequence[code.Expression],
        wanted: Mapping[str, str],
        *,
        tried: bool = False,
    ) -> Called:
        """Emit code that applies a rule or runs a unit if all tests pass.

        Args:
            rule: the call.
            given: the values of parameters.
            tests: tests that have to pass.
            wanted: the name that gets each output parameter.
            tried: if the model refuses the rule at a match, apply it at another match.
        """
        done = self.module.fresh("done")
        self.assign(done, ZERO)
        function = self._trying if tried else self.applying
        applied = function(rule, tuple(given), tuple(wanted))
        types = self.output_types(rule, tuple(wanted))
        outputs = [self.facts.local(type_) for type_ in types]
        for local, type_ in zip(outputs, types, strict=True):
            self.assign(local, zero_of(type_))
        found = self.call(applied, *given.values())
        target = code.tuple_of(done, *outputs) if outputs else done
        self.add(code.If(code.joined("and", tests, True), (code.Assign(target, found),)))
        self.add(code.If(code.Operation("<", (done, ZERO)), (self.leave,)))
        terms = [named(local, type_) for local, type_ in zip(outputs, types, strict=True)]
        return Called(done, dict(zip(wanted.values(), terms, strict=True)))

    def can_run(self, branches: Sequence[Branch], scope: Mapping[str, Term], can: code.Local) -> None:
        """Emit code that sets the variable `can` to 1 if the call of a branch with positive probability can succeed."""
        for chance, branch in zip(self._chances(branches, scope)[0], branches, strict=True):
            possible = code.Operation(">", (chance, code.Constant(0.0)))
            self.when(possible, lambda call=branch.call: self._can_call(call, scope, can))  # type: ignore[misc]

    def _can_call(self, rule: RuleCall, scope: Mapping[str, Term], can: code.Local) -> None:
        if rule.rule is None:
            self.assign(can, ONE)
            return
        given, tests = self._given(rule, scope)
        found = code.joined("and", [*tests, self.possible(rule, given)], True)
        self.add(code.If(found, (code.Assign(can, ONE),)))
        if self._is_unit(rule):  # only running the unit reports the error
            wrong = code.Operation("!=", (cell(ERROR), ZERO))
            self.add(code.If(wrong, (code.Assign(can, ONE), code.Assign(cell(ERROR), ZERO))))

    def possible(
        self, rule: RuleCall, given: Mapping[str, code.Expression], *, tried: bool = False
    ) -> code.Expression:
        """Return code that tests if a rule has a match, or a unit can succeed, with values for parameters.

        With `tried`, only a match at which the model does not refuse the rule counts.
        """
        if tried:
            return code.equal(
                self.call(self._trying(rule, tuple(given), (), asks=True), *given.values()), ONE
            )
        if self._is_unit(rule):
            key = "may", rule.rule, tuple(given)
            name = self.module.once(
                key, "may", lambda: unit_function(self, rule, tuple(given), (), asks=True)
            )
            return code.equal(self.call(name, *given.values()), ONE)
        plan = plan_of(self.engine, rule)
        places = {plan.variables.index(name): value for name, value in given.items()}
        exists = self.matching.exists(ViewKey(plan.body.pattern, tuple(sorted(places)), ()))
        return self.call(exists, *(places[position] for position in sorted(places)))

    def another(self, leave: code.Return) -> Writer:
        """Return an emitter for another function, with its own return statement after an error."""
        return Writer(self.matching, self.engine, self.behaviour, leave)

    def _is_unit(self, rule: RuleCall) -> bool:
        assert rule.rule is not None
        return self.engine.signature(rule.rule).kind == "unit"

    def _given(
        self, rule: RuleCall, scope: Mapping[str, Term]
    ) -> tuple[dict[str, code.Expression], list[code.Expression]]:
        """Emit code for the arguments of a call; return input values by parameter, and tests of the values."""
        assert rule.rule is not None
        parameters = self.engine.signature(rule.rule).parameters
        given: dict[str, code.Expression] = {}
        tests: list[code.Expression] = []
        for argument, taken in zip(rule.arguments, parameters, strict=True):
            if not taken.output:
                term = self.value(argument, scope, taken.type)
                if term.valid:
                    self._check_argument(argument, scope, term)
                tests += term.tests
                if isinstance(term.type, ObjectType):
                    tests += [alive] if (alive := self.alive(term)) is not None else []
                    tests += self._of_class(rule, term, taken.type)
                elif term.beyond is not None and taken.type is not Scalar.FLOAT:
                    wrong = code.joined("and", [*term.tests, term.beyond], True)
                    self.fail_if(wrong, "BEYOND")
                given[taken.name] = as_float(term) if taken.type is Scalar.FLOAT else term.number
        return given, tests

    def _of_class(self, rule: RuleCall, term: Term, taken: StaticType | None) -> list[code.Expression]:
        """Return expressions that test if an object has the class of a rule's parameter; none if its class is certain.

        Raises:
            NotCompiled: the class of a unit's argument is not certain.
        """
        assert isinstance(term.type, ObjectType)
        assert isinstance(taken, ObjectType)
        if self.facts.metamodel.is_a(term.type.cls, taken.cls):
            return []
        if self._is_unit(rule):
            raise NotCompiled(f"an argument of a unit whose class is not certain (`{rule.rule}`)", rule.span)
        return [self.facts.is_instance(term.value, taken.cls)]

    def _check_argument(self, argument: Expression, scope: Mapping[str, Term], term: Term) -> None:
        """Emit code that fails if the evaluation of an argument fails, unless it reads from a deleted object."""
        wrong = code.inverse(code.joined("and", term.valid, True))
        self.fail_if(code.joined("and", [*self._there(argument, scope), wrong], True))

    def _there(self, expression: Expression, scope: Mapping[str, Term]) -> list[code.Expression]:
        """Return expressions that test if the objects from which an expression reads are not deleted."""
        there: list[code.Expression] = []
        for root in roots(expression):
            there += scope[root.name].present
            there += [alive] if (alive := self.alive(scope[root.name])) is not None else []
        return there

    def applying(self, rule: RuleCall, bound: tuple[str, ...], wanted: tuple[str, ...]) -> str:
        """Emit a function that applies a rule at a sampled match, or runs a unit. Return the function's name.

        It returns 1 and the outputs, 0 without a match or if the unit fails, and -1 after a refusal or an error.
        """
        key = "apply", rule.rule, bound, wanted
        write = unit_function if self._is_unit(rule) else Writer._application
        return self.module.once(key, "apply", lambda: write(self, rule, bound, wanted))

    def _application(
        self, rule: RuleCall, bound: tuple[str, ...], wanted: tuple[str, ...]
    ) -> tuple[list[code.Local], code.Body]:
        plan, given, key = self.asked(rule, bound)
        nothing = [zero_of(type_) for type_ in self.output_types(rule, wanted)]

        def change(found: Sequence[code.Expression]) -> code.Body:
            slots = {**given, **dict(zip(key.outputs, found, strict=True))}
            return self.fired(rule, slots, wanted)

        missing = code.Return(listed(ZERO, nothing))
        body = self.matching.chosen(key, [*given.values()], change, missing)
        return [given[plan.variables.index(name)] for name in bound], body

    def asked(
        self, rule: RuleCall, bound: tuple[str, ...]
    ) -> tuple[RulePlan, dict[int, code.Local], ViewKey]:
        """Return a rule's plan, variables for the bound positions of its match, and the view of the other positions."""
        plan = plan_of(self.engine, rule)
        positions = tuple(sorted(plan.variables.index(name) for name in bound))
        others = tuple(p for p in range(len(plan.variables)) if p not in positions)
        given = {p: self.facts.local(plan.types[p]) for p in positions}
        return plan, given, ViewKey(plan.body.pattern, positions, others)

    def fired(self, rule: RuleCall, slots: Mapping[int, code.Expression], wanted: Sequence[str]) -> code.Body:
        """Emit the statements that apply a rule at a match and return its outputs."""
        plan = plan_of(self.engine, rule)
        nothing = [zero_of(type_) for type_ in self.output_types(rule, wanted)]
        refused, places = code.Return(listed(NOBODY, nothing)), dict(plan.outputs)
        effects = Effects(self.matching, plan, [slots[p] for p in range(len(plan.variables))], refused)
        with standing(plan.body.span or rule.span):
            changes = effects.write()
        return (*changes, code.Return(listed(ONE, [effects.slot(places[name]) for name in wanted])))

    def _trying(
        self, rule: RuleCall, bound: tuple[str, ...], wanted: tuple[str, ...], *, asks: bool = False
    ) -> str:
        """Return the name of a function like that of `applying`, which tries another match if the rule is refused.

        After a refusal the state is restored. If every match is refused, the function leaves the error in the state.
        With `asks` the function only tests, and restores the state in any case.
        """
        key = "try", rule.rule, bound, wanted, asks
        return self.module.once(key, "attempt", lambda: attempts(self, rule, bound, wanted, asks=asks))

    def output_types(self, rule: RuleCall, wanted: Sequence[str]) -> list[StaticType]:
        """Return the types of the output parameters `wanted`."""
        assert rule.rule is not None
        types = {taken.name: taken.type for taken in self.engine.signature(rule.rule).parameters}
        return [types[name] or ObjectType("") for name in wanted]

    def alternatives(self, branches: Sequence[Branch], scope: Mapping[str, Term]) -> Called:
        """Emit code that samples a branch and runs it. If the probabilities sum to less than 1, it may run none."""
        if [branch.probability for branch in branches] == [1.0]:
            return self.run(branches[0].call, scope)
        done, drawn = self.module.fresh("done"), self.module.fresh("b")
        self.assign(done, ZERO)
        chances, left = self._chances(branches, scope)
        self.assign(drawn, code.call("choose", D, code.tuple_of(*chances), left))
        outputs: dict[str, Term] = {}
        for number, branch in enumerate(branches):

            def write(branch: Branch = branch) -> None:
                called = self.run(branch.call, scope)
                self.assign(done, called.done)
                for name, term in called.outputs.items():
                    if name not in outputs:
                        outputs[name] = replace(term, value=self.facts.local(term.type or ObjectType("")))
                    local = outputs[name].value
                    assert isinstance(local, code.Local)
                    self.assign(local, term.number)

            self.when(code.equal(drawn, code.Constant(number)), write)
        return Called(done, outputs)

    def _chances(
        self, branches: Sequence[Branch], scope: Mapping[str, Term]
    ) -> tuple[list[code.Expression], code.Expression]:
        """Return code for the probabilities of branches, and of no branch. The code fails if their sum exceeds 1."""
        given = [branch.probability for branch in branches]
        fixed = [float(one) for one in given if isinstance(one, int | float)]
        if len(fixed) == len(given):
            return [code.Constant(one) for one in fixed], code.Constant(lacking(fixed))
        chances = [self._chance(one, scope) for one in given]
        left = self.module.fresh("left", "float")
        self.assign(left, code.Constant(0.0))
        for chance in chances:
            self.add(code.Assign(left, chance, "+="))
        self.assign(left, code.Operation("-", (code.Constant(1.0), left)))
        self.fail_if(code.Operation("<", (left, code.Constant(-1e-9))))
        return chances, left

    def _chance(self, given: float | Expression, scope: Mapping[str, Term]) -> code.Expression:
        """Emit code for a probability, 0 if an object was deleted. It fails if the value is not from 0 to 1."""
        if isinstance(given, int | float):
            return code.Constant(float(given))
        term = self.value(given, scope)
        chance = self.facts.local(Scalar.FLOAT)
        self.assign(chance, code.Constant(0.0))
        within = [code.Operation("<=", pair) for pair in ((ZERO, chance), (chance, ONE))]
        valued = (
            code.Assign(chance, as_float(term)),
            code.If(code.inverse(code.joined("and", within, True)), self.fail()),
        )
        lacking_value = code.If(code.joined("and", self._there(given, scope), True), self.fail())
        self.add(
            *(
                (code.If(code.joined("and", term.tests, True), valued, (lacking_value,)),)
                if term.tests
                else valued
            )
        )
        return chance

    # --- questions

    def question(self, condition: Negation | object, types: Types) -> Question:
        """Add the helper pattern of a condition to the engine, and return it with its variables."""
        return added(
            self.engine,
            self.behaviour,
            lambda name: condition_question(name, condition, types),  # type: ignore[arg-type]
        )

    def key(self, question: Question, free: bool = True) -> ViewKey:
        """Return the view that finds a helper pattern's free variables, or only tests for a match (`free=False`)."""
        bound = len(question.bound)
        outputs = tuple(range(bound, bound + len(question.free))) if free else ()
        return ViewKey(question.pattern.qualified_name, tuple(range(bound)), outputs)

    def bound_alive(self, question: Question, scope: Mapping[str, Term]) -> list[code.Expression]:
        """Return expressions that test if the objects in the bound variables of a helper pattern are not deleted."""
        return [test for name in question.bound if (test := self.alive(scope[name])) is not None]
