"""The turn of an agent as one function: the action, what happens in each step, the judgement, what follows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from envgraph import code
from envgraph.behaviour import (
    Action,
    EachStep,
    Effect,
    OnFind,
    Question,
)
from envgraph.code import dataclass
from envgraph.env._prepared import Types
from envgraph.env._program import ENDS, stands_before
from envgraph.env.compiled._bodies import CAPACITY
from envgraph.env.compiled._layout import ONE, TOP, ZERO, call, plus
from envgraph.env.compiled._refused import standing
from envgraph.env.compiled._terms import Term, named
from envgraph.env.compiled._writer import Called, Writer, zero_of
from envgraph.match.plan import ViewKey
from envgraph.metamodel import Scalar
from envgraph.pattern import (
    Expression,
    Negation,
    ObjectType,
    variables_in,
)

TOTAL, END = code.Local("total", "float"), code.Local("end", "int")
ACTED = code.Local("acted", "int")
NOTHING = code.Return(code.tuple_of(code.Constant(0.0), ZERO, ZERO))


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
                writer.assign(term.value, zero_of(term.type))
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
