"""The turn of an agent as one function: the action, what happens in each step, the judgement, what follows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from envgraph import code
from envgraph.behaviour import (
    Action,
    Branch,
    EachStep,
    Effect,
    OnFind,
    Question,
    RuleCall,
    condition_question,
    roots,
)
from envgraph.code import dataclass
from envgraph.env._prepared import Types
from envgraph.env._program import ENDS, added, stands_before
from envgraph.env._sampling import lacking
from envgraph.env.compiled._bodies import CAPACITY
from envgraph.env.compiled._changes import plan_of
from envgraph.env.compiled._effects import Effects
from envgraph.env.compiled._layout import NOBODY, ONE, TOP, ZERO, D, call, plus
from envgraph.env.compiled._matching import Matching
from envgraph.env.compiled._refused import standing
from envgraph.env.compiled._statements import Statements
from envgraph.env.compiled._terms import Term, Terms, as_float, named
from envgraph.match.plan import ViewKey
from envgraph.metamodel import Scalar
from envgraph.pattern import (
    Expression,
    Negation,
    ObjectType,
    StaticType,
    Variable,
    variables_in,
)
from envgraph.rewrite import Engine

TOTAL, END = code.Local("total", "float"), code.Local("end", "int")
ACTED = code.Local("acted", "int")
NOTHING = code.Return(code.tuple_of(code.Constant(0.0), ZERO, ZERO))


@dataclass(frozen=True, slots=True)
class Called:
    """A call of a rule that has been written.

    Attributes:
        done: the variable that is 1 if a rule was applied, or there was nothing to do.
        outputs: the values of the names that get outputs.
    """

    done: code.Local
    outputs: Mapping[str, Term]


class Writer(Statements):
    """Writes the statements of one function of a behaviour.

    Args:
        matching: finds matches.
        engine: has the rules.
        behaviour: name of the behaviour.
        leave: what is done where the live engine raises an error.
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
        """Code for a call of a function."""
        self.module.uses(name, self.levels)
        return call(name, *arguments, top=self.top)

    # --- values

    def value(
        self, expression: Expression, scope: Mapping[str, Term], expected: StaticType | None = None
    ) -> Term:
        """Code for an expression."""
        terms = Terms(self.facts, scope)
        term = terms.write(expression, expected)
        self.add(*terms.steps)
        return term

    def number(self, expression: Expression, scope: Mapping[str, Term]) -> code.Expression:
        """Code for a reward; where it has no value that is an error."""
        term = self.value(expression, scope)
        if term.tests:
            self.fail_if(code.inverse(code.joined("and", term.tests, True)))
        return as_float(term)

    def gone(self, term: Term, cls: str) -> code.Expression | None:
        """Code for whether an object is deleted, or no longer of a class; None if it cannot be."""
        if self.facts.changes.fixed_class(cls):
            return None
        return code.inverse(self.facts.is_instance(term.value, cls))

    def alive(self, term: Term) -> code.Expression | None:
        """Code for whether an object is not deleted; None if it cannot be."""
        assert isinstance(term.type, ObjectType)
        return self.facts.alive(term.value, term.type.cls)

    # --- calls

    def run(self, rule: RuleCall, scope: Mapping[str, Term]) -> Called:
        """Apply a rule at one of its matches."""
        done = self.module.fresh("done")
        self.assign(done, ZERO)
        if rule.rule is None:
            self.assign(done, ONE)
            return Called(done, {})
        given, tests = self._given(rule, scope)
        parameters = self.engine.signature(rule.rule).parameters
        wanted = {
            taken.name: argument.name
            for argument, taken in zip(rule.arguments, parameters, strict=True)
            if taken.output and isinstance(argument, Variable) and not argument.anonymous
        }
        applied = self._applying(rule, tuple(given), tuple(wanted))
        types = self._output_types(rule, tuple(wanted))
        outputs = [self.facts.local(type_) for type_ in types]
        for local, type_ in zip(outputs, types, strict=True):
            self.assign(local, _zero(type_))
        found = self.call(applied, *given.values())
        target = code.tuple_of(done, *outputs) if outputs else done
        self.add(code.If(code.joined("and", tests, True), (code.Assign(target, found),)))
        self.add(code.If(code.Operation("<", (done, ZERO)), (self.leave,)))
        terms = [named(local, type_) for local, type_ in zip(outputs, types, strict=True)]
        return Called(done, dict(zip(wanted.values(), terms, strict=True)))

    def can_run(self, branches: Sequence[Branch], scope: Mapping[str, Term], can: code.Local) -> None:
        """Make a variable 1 if one of the branches would do something."""
        for chance, branch in zip(self._chances(branches, scope)[0], branches, strict=True):
            possible = code.Operation(">", (chance, code.Constant(0.0)))
            self.when(possible, lambda call=branch.call: self._can_call(call, scope, can))  # type: ignore[misc]

    def _can_call(self, rule: RuleCall, scope: Mapping[str, Term], can: code.Local) -> None:
        if rule.rule is None:
            self.assign(can, ONE)
            return
        given, tests = self._given(rule, scope)
        plan = plan_of(self.engine, rule)
        places = {plan.variables.index(name): value for name, value in given.items()}
        exists = self.matching.exists(ViewKey(plan.body.pattern, tuple(sorted(places)), ()))
        found = self.call(exists, *(places[position] for position in sorted(places)))
        self.add(code.If(code.joined("and", [*tests, found], True), (code.Assign(can, ONE),)))

    def _given(
        self, rule: RuleCall, scope: Mapping[str, Term]
    ) -> tuple[dict[str, code.Expression], list[code.Expression]]:
        """The values of a rule's parameters that are no outputs, and tests that they are there."""
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
                    tests += self._of_class(term, taken.type)
                elif term.beyond is not None and taken.type is not Scalar.FLOAT:
                    wrong = code.joined("and", [*term.tests, term.beyond], True)
                    self.fail_if(wrong, "BEYOND")
                given[taken.name] = as_float(term) if taken.type is Scalar.FLOAT else term.number
        return given, tests

    def _of_class(self, term: Term, taken: StaticType | None) -> list[code.Expression]:
        """Tests that an object is of the class of a parameter, where that is not sure."""
        assert isinstance(term.type, ObjectType)
        assert isinstance(taken, ObjectType)
        if self.facts.metamodel.is_a(term.type.cls, taken.cls):
            return []
        return [self.facts.is_instance(term.value, taken.cls)]

    def _check_argument(self, argument: Expression, scope: Mapping[str, Term], term: Term) -> None:
        """An argument that fails is an error, unless it reads from an object that is gone."""
        wrong = code.inverse(code.joined("and", term.valid, True))
        self.fail_if(code.joined("and", [*self._there(argument, scope), wrong], True))

    def _there(self, expression: Expression, scope: Mapping[str, Term]) -> list[code.Expression]:
        """Tests that the objects from which an expression reads are not deleted."""
        there: list[code.Expression] = []
        for root in roots(expression):
            there += scope[root.name].present
            there += [alive] if (alive := self.alive(scope[root.name])) is not None else []
        return there

    def _applying(self, rule: RuleCall, bound: tuple[str, ...], wanted: tuple[str, ...]) -> str:
        """The function that applies a rule: 1 and the outputs, 0 without a match, -1 where that is refused."""
        key = "apply", rule.rule, bound, wanted
        return self.module.once(key, "apply", lambda: self._application(rule, bound, wanted))

    def _application(
        self, rule: RuleCall, bound: tuple[str, ...], wanted: tuple[str, ...]
    ) -> tuple[list[code.Local], code.Body]:
        plan = plan_of(self.engine, rule)
        positions = tuple(sorted(plan.variables.index(name) for name in bound))
        others = tuple(p for p in range(len(plan.variables)) if p not in positions)
        given = {p: self.facts.local(plan.types[p]) for p in positions}
        nothing = [_zero(type_) for type_ in self._output_types(rule, wanted)]
        refused = code.Return(_listed(NOBODY, nothing))
        places = dict(plan.outputs)

        def change(found: Sequence[code.Expression]) -> code.Body:
            slots: dict[int, code.Expression] = {**given, **dict(zip(others, found, strict=True))}
            effects = Effects(self.matching, plan, [slots[p] for p in range(len(plan.variables))], refused)
            with standing(plan.body.span or rule.span):
                changes = effects.write()
            return (*changes, code.Return(_listed(ONE, [effects.slot(places[name]) for name in wanted])))

        key = ViewKey(plan.body.pattern, positions, others)
        missing = code.Return(_listed(ZERO, nothing))
        body = self.matching.chosen(key, [given[p] for p in positions], change, missing)
        return [given[plan.variables.index(name)] for name in bound], body

    def _output_types(self, rule: RuleCall, wanted: Sequence[str]) -> list[StaticType]:
        assert rule.rule is not None
        types = {taken.name: taken.type for taken in self.engine.signature(rule.rule).parameters}
        return [types[name] or ObjectType("") for name in wanted]

    def alternatives(self, branches: Sequence[Branch], scope: Mapping[str, Term]) -> Called:
        """Draw a branch and run it."""
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
        """Code for the probabilities of branches, and for what they lack to 1."""
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
        """Code for a probability, which is 0 where it has no value because an object is gone."""
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
        """The helper pattern of a condition."""
        return added(
            self.engine,
            self.behaviour,
            lambda name: condition_question(name, condition, types),  # type: ignore[arg-type]
        )

    def key(self, question: Question, free: bool = True) -> ViewKey:
        """The view that asks for the free variables of a question, or whether there are any."""
        bound = len(question.bound)
        outputs = tuple(range(bound, bound + len(question.free))) if free else ()
        return ViewKey(question.pattern.qualified_name, tuple(range(bound)), outputs)

    def bound_alive(self, question: Question, scope: Mapping[str, Term]) -> list[code.Expression]:
        """Tests that the objects which a question names are not deleted."""
        return [test for name in question.bound if (test := self.alive(scope[name])) is not None]


def _listed(first: code.Expression, others: Sequence[code.Expression]) -> code.Expression:
    return code.tuple_of(first, *others) if others else first


def _zero(type_: StaticType | None) -> code.Expression:
    return code.Constant(0.0) if type_ is Scalar.FLOAT else ZERO


@dataclass(slots=True)
class Pending:
    """Rows of a clause that wait for their `apply`.

    Attributes:
        number: how many there are.
        top: where they begin.
    """

    clause: OnFind
    types: Types
    question: Question
    number: code.Local
    top: code.Expression


class Turn:
    """Writes the turn of the agents of one block.

    Args:
        writer: of the function.
        scope: the objects of parameters, and of the agent.
        effects: the clauses in the order of the file, with the classes of the names that they know.
    """

    def __init__(
        self, writer: Writer, scope: Mapping[str, Term], effects: Sequence[tuple[Effect, Types]]
    ) -> None:
        self.writer = writer
        self.scope = scope
        self.effects = effects
        self.did = code.Local("did", "int")
        self._pending: list[Pending] = []

    def write(
        self,
        actions: Sequence[tuple[Action, Types]],
        clause: code.Expression,
        parameters: Sequence[Mapping[str, Term]],
    ) -> None:
        """All of the turn but what comes after the last `apply`.

        Args:
            actions: the `action` clauses.
            clause: code for the number of the one that is done.
            parameters: what the parameters of each stand for.
        """
        writer = self.writer
        waiting = sum(isinstance(one, OnFind) and bool(one.apply) for one, _ in self.effects)
        writer.levels = waiting
        if waiting:
            top = writer.module.fresh("t")
            writer.assign(top, plus(TOP, code.Operation("*", (CAPACITY, code.Constant(waiting)))))
            writer.top = top
        for local, value in ((TOTAL, code.Constant(0.0)), (END, ZERO), (ACTED, ZERO), (self.did, ZERO)):
            writer.assign(local, value)
        called = [
            self._act(number, action, clause, parameters[number])
            for number, (action, _) in enumerate(actions)
        ]
        for effect, _ in self.effects:
            if isinstance(effect, EachStep) and effect.apply:
                with standing(effect.span):
                    self._remember(writer.alternatives(effect.apply, self.scope).done)
        for position in range(len(self.effects) + 1):
            for number, (action, _) in enumerate(actions):
                before = sum(1 for effect, _ in self.effects if stands_before(effect, action))
                if before == position and (action.reward or action.else_reward):
                    scope = {**self.scope, **parameters[number]}
                    self._reward_action(
                        action, code.equal(clause, code.Constant(number)), called[number], scope
                    )
            if position < len(self.effects):
                self._judge(*self.effects[position])
        self._apply_pending()

    def _remember(self, done: code.Local) -> None:
        self.writer.add(code.If(code.Operation(">", (done, ZERO)), (code.Assign(self.did, ONE),)))

    # --- the action

    def _act(
        self, number: int, action: Action, clause: code.Expression, parameters: Mapping[str, Term]
    ) -> Called:
        writer = self.writer
        done = writer.module.fresh("done")
        writer.assign(done, ZERO)
        outputs: dict[str, Term] = {}

        def write() -> None:
            called = writer.alternatives(action.branches, {**self.scope, **parameters})
            writer.assign(done, called.done)
            writer.assign(ACTED, called.done)
            outputs.update(called.outputs)

        body = writer.collected(write)
        for term in outputs.values():
            assert isinstance(term.value, code.Local) or term.type is Scalar.BOOL
            if isinstance(term.value, code.Local):
                writer.assign(term.value, _zero(term.type))
        writer.add(code.If(code.equal(clause, code.Constant(number)), body))
        self._remember(done)
        return Called(done, outputs)

    def _reward_action(
        self, action: Action, chosen: code.Expression, called: Called, scope: Mapping[str, Term]
    ) -> None:
        writer = self.writer

        def write() -> None:
            for reward, test, names in (
                (action.reward, ">", {**scope, **called.outputs}),
                (action.else_reward, "==", scope),
            ):
                if reward is not None:
                    done = code.Operation(test, (called.done, ZERO))
                    writer.when(done, lambda reward=reward, names=names: self._earn(reward, names))  # type: ignore[misc]

        writer.when(chosen, write)

    def _earn(self, reward: Expression, scope: Mapping[str, Term]) -> None:
        number = self.writer.number(reward, scope)
        self.writer.add(code.Assign(TOTAL, number, "+="))

    # --- the judgement

    def _judge(self, effect: Effect, types: Types) -> None:
        with standing(effect.span):
            self._write_judgement(effect, types)

    def _write_judgement(self, effect: Effect, types: Types) -> None:
        writer = self.writer
        if isinstance(effect, EachStep):
            if effect.reward is not None:
                self._earn(effect.reward, self.scope)
            return
        question = writer.question(effect.condition, types)
        number = writer.module.fresh("n")
        values = [self.scope[name].value for name in question.bound]
        writer.assign(number, ZERO)
        alive = writer.bound_alive(question, self.scope)
        top = writer.top
        if effect.apply:
            place = len(self._pending)
            top = plus(TOP, code.Operation("*", (CAPACITY, code.Constant(place)))) if place else TOP
            self._pending.append(Pending(effect, types, question, number, top))
        rewarded = effect.reward is not None and _names(effect.reward, question.free)
        if effect.apply or rewarded:
            function = writer.matching.rows(writer.key(question))
            writer.module.uses(function, writer.levels)
        elif effect.reward is not None:
            function = writer.matching.count(writer.key(question))
        else:
            function = writer.matching.exists(writer.key(question, free=False))
        writer.module.uses(function, writer.levels)
        found: code.Expression = call(function, *values, top=top)
        if not effect.apply and effect.reward is None:
            found = code.Choice(found, ONE, ZERO)
        if isinstance(effect.condition, Negation):
            gone = self._gone(question, types)
            negated: code.Expression = (
                code.Choice(code.joined("or", gone, False), ONE, ZERO) if gone else ZERO
            )
            found = code.Choice(code.joined("and", alive, True), found, negated) if alive else found
            found = code.call("max", found, negated) if gone else found
            writer.assign(number, found)
        elif alive:
            writer.add(code.If(code.joined("and", alive, True), (code.Assign(number, found),)))
        else:
            writer.assign(number, found)
        if effect.reward is not None:
            self._earn_rows(effect.reward, question, number, top)
        end = ENDS[effect.terminate]
        if end:
            larger = code.Assign(END, code.call("max", END, code.Constant(end)))
            writer.add(code.If(code.Operation(">", (number, ZERO)), (larger,)))

    def _gone(self, question: Question, types: Types) -> list[code.Expression]:
        writer = self.writer
        found = [writer.gone(self.scope[name], types[name]) for name in question.bound]
        return [test for test in found if test is not None]

    def _earn_rows(
        self, reward: Expression, question: Question, number: code.Local, top: code.Expression
    ) -> None:
        writer, row = self.writer, self.writer.module.fresh("i")

        def write() -> None:
            scope = dict(self.scope)
            if _names(reward, question.free):
                scope.update(self._row(question, plus(top, row), sure=True))
            self._earn(reward, scope)

        writer.add(code.For(row, code.call("range", number), writer.collected(write)))

    def _row(self, question: Question, place: code.Expression, *, sure: bool) -> dict[str, Term]:
        """The variables of a row."""
        writer, scope = self.writer, {}
        key = writer.key(question)
        loads, values = writer.matching.loaded(key, place)
        writer.add(*loads)
        for name, local, type_ in zip(question.free, values, writer.matching.types(key), strict=True):
            cls = type_.cls if sure and isinstance(type_, ObjectType) else None
            scope[name] = named(local, type_, cls)
        return scope

    # --- what follows

    def _apply_pending(self) -> None:
        writer = self.writer
        if not self._pending:
            return
        first = writer.module.fresh("first")
        writer.assign(first, ONE)
        for each in self._pending:
            row = writer.module.fresh("i")
            body = writer.collected(lambda each=each, row=row: self._apply_row(each, row, first))  # type: ignore[misc]
            writer.add(code.For(row, code.call("range", each.number), body))

    def _apply_row(self, each: Pending, row: code.Local, first: code.Local) -> None:
        writer, question = self.writer, each.question
        scope = {**self.scope, **self._row(question, plus(each.top, row), sure=False)}
        holds = writer.module.fresh("holds")
        bound = len(question.bound) + len(question.free)
        key = ViewKey(question.pattern.qualified_name, tuple(range(bound)), ())
        values = [scope[name].number for name in (*question.bound, *question.free)]
        tests = writer.bound_alive(question, scope)
        for name in question.free:
            term = scope[name]
            if isinstance(term.type, ObjectType) and (alive := writer.alive(term)) is not None:
                tests.append(alive)
        tests.append(writer.call(writer.matching.exists(key), *values))
        held = code.joined("and", tests, True)
        if isinstance(each.clause.condition, Negation):
            held = code.joined("or", [held, *self._gone(question, each.types)], False)
        writer.assign(holds, code.Choice(code.Operation("or", (code.equal(first, ONE), held)), ONE, ZERO))
        writer.assign(first, ZERO)

        def write() -> None:
            self._remember(writer.alternatives(each.clause.apply, scope).done)

        writer.when(code.equal(holds, ONE), write)


def _names(expression: Expression, names: Sequence[str]) -> bool:
    return any(variable.name in names for variable in variables_in(expression))
