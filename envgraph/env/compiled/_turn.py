"""Emit the function of one step: actions, effects of `each step`, rewards and ends, then pending rule applications."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

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
from envgraph.env._program import ENDS
from envgraph.env.compiled._bodies import CAPACITY
from envgraph.env.compiled._layout import NOBODY, ONE, TOP, ZERO, D, call, plus
from envgraph.env.compiled._refused import standing
from envgraph.env.compiled._terms import Term, named, zero_of
from envgraph.env.compiled._writer import Called, Writer
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


@dataclass(frozen=True, slots=True)
class Player:
    """An agent that acts in a step.

    Attributes:
        scope: the terms of the behaviour's parameters and of the agent itself.
        actions: the `action` clauses.
        before: for each action, how many effects (shared ones and the agent's own) precede it in the file.
        choose: emits code that selects the action in the state before the step; returns the variable of its number (-1
            for none), and for each action the terms of its parameters.
        there: a variable that is 1 if the agent's object exists when the step begins; None if it always exists.
        total: the variable that sums up the agent's reward.
    """

    scope: Mapping[str, Term]
    actions: Sequence[Action]
    before: Sequence[int]
    choose: Callable[[], tuple[code.Local, Sequence[Mapping[str, Term]]]]
    there: code.Local | None
    total: code.Local


@dataclass(frozen=True, slots=True)
class Clause:
    """An effect of the behaviour, for one agent.

    Attributes:
        types: the classes of the names in scope.
        player: the number of the agent; 0 for shared effects.
        shared: True if the effect is declared outside of `agent` blocks.
    """

    effect: Effect
    types: Types
    player: int
    shared: bool


@dataclass(frozen=True, slots=True)
class Pending:
    """The matches of a clause whose rule is applied at the end of the step.

    Attributes:
        number: the variable of the number of matches.
        top: code for the position of the first match in the row buffers.
    """

    effect: OnFind
    clause: Clause
    question: Question
    number: code.Local
    top: code.Expression


class Turn:
    """An emitter of the code of a step, of one agent or of several agents that act together.

    Args:
        writer: the emitter of the function.
        players: the agents in the order in which they act.
        clauses: the effects in the order of the file.
    """

    def __init__(self, writer: Writer, players: Sequence[Player], clauses: Sequence[Clause]) -> None:
        self.writer = writer
        self.players = players
        self.clauses = clauses
        self.did = code.Local("did", "int")
        self._pending: list[Pending] = []

    def write(self) -> None:
        """Emit the code of a whole step, including pending applications of rules. The caller adds the return."""
        writer = self.writer
        waiting = sum(isinstance(one.effect, OnFind) and bool(one.effect.apply) for one in self.clauses)
        if waiting:
            writer.levels = waiting
            top = writer.module.fresh("t")
            writer.assign(top, plus(TOP, code.Operation("*", (CAPACITY, code.Constant(waiting)))))
            writer.top = top
        for local in dict.fromkeys((TOTAL, *(player.total for player in self.players))):
            writer.assign(local, code.Constant(0.0))
        for local in (END, ACTED, self.did):
            writer.assign(local, ZERO)
        rewards = [self._play(player) for player in self.players]
        for clause in self.clauses:
            if isinstance(clause.effect, EachStep) and clause.effect.apply:
                self._if_there(clause, lambda each=clause: self._happen(each, each.effect))  # type: ignore[misc]
        passed = [0] * len(self.players)
        for clause in self.clauses:
            for number, pays in enumerate(rewards):
                if clause.shared or clause.player == number:
                    pays(passed[number])
                    passed[number] += 1
            self._if_there(clause, lambda each=clause: self._judge(each))  # type: ignore[misc]
        for pays, number in zip(rewards, passed, strict=True):
            pays(number)
        for player in self.players:
            if player.total is not TOTAL:
                writer.add(code.Assign(TOTAL, player.total, "+="))
        self._apply_pending()

    def _if_there(self, clause: Clause, write: Callable[[], None]) -> None:
        """Emit the code that `write` adds for a clause. A clause of one agent runs only if its agent existed before."""
        there = None if clause.shared else self.players[clause.player].there
        with standing(clause.effect.span):
            if there is None:
                write()
                return
            waiting = len(self._pending)
            body = self.writer.collected(write)
            for pending in self._pending[waiting:]:
                self.writer.assign(pending.number, ZERO)
            self.writer.add(code.If(code.equal(there, ONE), body))

    def _happen(self, clause: Clause, effect: EachStep) -> None:
        self._remember(self.writer.alternatives(effect.apply, self.players[clause.player].scope).done)

    def _remember(self, done: code.Local) -> None:
        self.writer.add(code.If(code.Operation(">", (done, ZERO)), (code.Assign(self.did, ONE),)))

    # --- the action

    def _play(self, player: Player) -> Callable[[int], None]:
        """Emit code for an agent's action; return a callback that emits the rewards of actions at a place of the file.

        The callback's argument is the number of effects that precede these actions.
        """
        clause, parameters = player.choose()
        if player.there is not None:
            self.writer.add(code.If(code.equal(player.there, ZERO), (code.Assign(clause, NOBODY),)))
        chosen = [code.equal(clause, code.Constant(number)) for number in range(len(player.actions))]
        scopes = [{**player.scope, **names} for names in parameters]
        called = [
            self._act(action, test, scope)
            for action, test, scope in zip(player.actions, chosen, scopes, strict=True)
        ]

        def pay(before: int) -> None:
            each = zip(player.actions, player.before, chosen, called, scopes, strict=True)
            for action, place, test, done, scope in each:
                if place == before and (action.reward or action.else_reward):
                    self._reward_action(action, test, done, scope, player.total)

        return pay

    def _act(self, action: Action, chosen: code.Expression, scope: Mapping[str, Term]) -> Called:
        writer = self.writer
        done = writer.module.fresh("done")
        writer.assign(done, ZERO)
        outputs: dict[str, Term] = {}

        def write() -> None:
            called = writer.alternatives(action.branches, scope)
            writer.assign(done, called.done)
            writer.assign(ACTED, called.done)
            outputs.update(called.outputs)

        body = writer.collected(write)
        for term in outputs.values():
            assert isinstance(term.value, code.Local) or term.type is Scalar.BOOL
            if isinstance(term.value, code.Local):
                writer.assign(term.value, zero_of(term.type))
        writer.add(code.If(chosen, body))
        self._remember(done)
        return Called(done, outputs)

    def _reward_action(
        self,
        action: Action,
        chosen: code.Expression,
        called: Called,
        scope: Mapping[str, Term],
        total: code.Local,
    ) -> None:
        writer = self.writer

        def write() -> None:
            for reward, test, names in (
                (action.reward, ">", {**scope, **called.outputs}),
                (action.else_reward, "==", scope),
            ):
                if reward is not None:

                    def earn(reward: Expression = reward, names: Mapping[str, Term] = names) -> None:
                        writer.add(code.Assign(total, writer.number(reward, names), "+="))

                    writer.when(code.Operation(test, (called.done, ZERO)), earn)

        writer.when(chosen, write)

    def _earn(self, clause: Clause, reward: Expression, scope: Mapping[str, Term]) -> None:
        """Emit code that adds a clause's reward to its agent, or, if it is shared, to the first agent that exists."""
        number = self.writer.number(reward, scope)
        if not clause.shared:
            self.writer.add(code.Assign(self.players[clause.player].total, number, "+="))
            return
        first, *others = self.players
        if first.there is None:
            self.writer.add(code.Assign(first.total, number, "+="))
            return
        gain = self.writer.module.fresh("gain", "float")
        self.writer.assign(gain, number)
        given: code.Statement = code.Assign(first.total, gain, "+=")
        for player in (*reversed(others), first):
            paid = code.Assign(player.total, gain, "+=")
            given = (
                paid if player.there is None else code.If(code.equal(player.there, ONE), (paid,), (given,))
            )
        self.writer.add(given)

    # --- the judgement

    def _judge(self, clause: Clause) -> None:
        writer, effect, scope = self.writer, clause.effect, self.players[clause.player].scope
        if isinstance(effect, EachStep):
            if effect.reward is not None:
                self._earn(clause, effect.reward, scope)
            return
        question = writer.question(effect.condition, clause.types)
        number = writer.module.fresh("n")
        values = [scope[name].value for name in question.bound]
        writer.assign(number, ZERO)
        alive = writer.bound_alive(question, scope)
        top = writer.top
        if effect.apply:
            place = len(self._pending)
            top = plus(TOP, code.Operation("*", (CAPACITY, code.Constant(place)))) if place else TOP
            self._pending.append(Pending(effect, clause, question, number, top))
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
            gone = self._gone(clause, question)
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
            self._earn_rows(clause, effect.reward, question, number, top)
        end = ENDS[effect.end]
        if end:
            wins = code.equal(END, ZERO) if end < 0 else code.Operation("<", (END, code.Constant(end)))
            held = code.joined("and", [code.Operation(">", (number, ZERO)), wins], True)
            writer.add(code.If(held, (code.Assign(END, code.Constant(end)),)))

    def _gone(self, clause: Clause, question: Question) -> list[code.Expression]:
        scope = self.players[clause.player].scope
        found = [self.writer.gone(scope[name], clause.types[name]) for name in question.bound]
        return [test for test in found if test is not None]

    def _earn_rows(
        self,
        clause: Clause,
        reward: Expression,
        question: Question,
        number: code.Local,
        top: code.Expression,
    ) -> None:
        writer, row = self.writer, self.writer.module.fresh("i")

        def write() -> None:
            scope = dict(self.players[clause.player].scope)
            if _names(reward, question.free):
                scope.update(self._row(question, plus(top, row), sure=True))
            self._earn(clause, reward, scope)

        writer.add(code.For(row, code.call("range", number), writer.collected(write)))

    def _row(self, question: Question, place: code.Expression, *, sure: bool) -> dict[str, Term]:
        """Emit code that loads a match from the row buffers; return the terms of its variables.

        If `sure`, the objects in the match certainly have the classes of the variables.
        """
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
            rows = code.call("range", each.number)
            if each.effect.weight is not None:
                self._apply_one(each, each.effect.weight, row, first)
                continue
            body = writer.collected(lambda each=each, row=row: self._apply_row(each, row, first))  # type: ignore[misc]
            writer.add(code.For(row, rows, body))

    def _apply_row(self, each: Pending, row: code.Local, first: code.Local) -> None:
        scope, holds = self._held(each, row, first)

        def write() -> None:
            self._remember(self.writer.alternatives(each.effect.apply, scope).done)

        self.writer.when(code.equal(holds, ONE), write)

    def _apply_one(self, each: Pending, given: Expression, row: code.Local, first: code.Local) -> None:
        """Emit code that samples one of the pending matches that still hold, by weight, and applies the rule there."""
        writer, rows = self.writer, code.call("range", each.number)
        left, weight, share = (writer.module.fresh(name, "float") for name in ("left", "w", "p"))
        none = code.Constant(0.0)

        def weighed(then: Callable[[Mapping[str, Term]], None]) -> code.Body:
            def inside() -> None:
                scope, holds = self._held(each, row, first)

                def weigh() -> None:
                    writer.assign(weight, writer.number(given, scope))
                    writer.fail_if(code.Operation("<", (weight, none)))
                    then(scope)

                writer.when(code.equal(holds, ONE), weigh)

            return writer.collected(inside)

        def draw(scope: Mapping[str, Term]) -> None:
            writer.assign(share, code.call("min", code.Operation("/", (weight, left)), code.Constant(1.0)))
            lacking = code.Operation("-", (code.Constant(1.0), share))
            drawn = code.equal(code.call("choose", D, code.tuple_of(share), lacking), ZERO)

            def apply() -> None:
                self._remember(writer.alternatives(each.effect.apply, scope).done)
                writer.add(code.Leave("break"))

            writer.when(drawn, apply)

        def turn(scope: Mapping[str, Term]) -> None:
            writer.when(code.Operation(">", (weight, none)), lambda: draw(scope))
            writer.add(code.Assign(left, weight, "-="))

        writer.assign(left, none)
        writer.add(code.For(row, rows, weighed(lambda _: writer.add(code.Assign(left, weight, "+=")))))
        writer.add(code.For(row, rows, weighed(turn)))

    def _held(
        self, each: Pending, row: code.Local, first: code.Local
    ) -> tuple[Mapping[str, Term], code.Local]:
        """Emit code that loads a pending match and tests that it still is a match.

        Returns:
            The terms in scope, and a variable that is 1 if the rule may be applied. The first match needs no test.
        """
        writer, question = self.writer, each.question
        scope = {
            **self.players[each.clause.player].scope,
            **self._row(question, plus(each.top, row), sure=False),
        }
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
        if isinstance(each.effect.condition, Negation):
            held = code.joined("or", [held, *self._gone(each.clause, question)], False)
        writer.assign(holds, code.Choice(code.Operation("or", (code.equal(first, ONE), held)), ONE, ZERO))
        writer.assign(first, ZERO)
        return scope, holds


def _names(expression: Expression, names: Sequence[str]) -> bool:
    return any(variable.name in names for variable in variables_in(expression))
