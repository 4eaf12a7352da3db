"""Emit the function of one step: actions, effects of `each step`, rewards and ends, then pending rule applications."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from envgraph import code
from envgraph.behaviour import (
    Action,
    EachStep,
    Effect,
    End,
    HelperPattern,
    OnFind,
    OnRefused,
)
from envgraph.code import dataclass
from envgraph.env._prepared_behaviour import END_NUMBERS
from envgraph.env._prepared_clauses import NameClasses
from envgraph.env.compiled.layout._not_compiled import add_missing_span
from envgraph.env.compiled.layout._program_layout import NOBODY, ONE, TOP, ZERO, D, emit_call, emit_sum
from envgraph.env.compiled.matching._body_code import CAPACITY
from envgraph.env.compiled.matching._term_code import CodeTerm, initial_constant, variable_term
from envgraph.env.compiled.steps._clause_code import CallResult, FunctionEmitter
from envgraph.match.plan import PatternQuery
from envgraph.metamodel import Scalar
from envgraph.pattern import (
    Expression,
    Negation,
    ObjectType,
    variables_in,
)

TOTAL_REWARD, END_OF_STEP = code.Local("total", "float"), code.Local("end", "int")
HAS_ACTED = code.Local("acted", "int")
RETURN_NO_STEP = code.Return(code.emit_tuple(code.Constant(0.0), ZERO, ZERO))


@dataclass(frozen=True, slots=True)
class ActingAgent:
    """An agent that acts in a step.

    Attributes:
        scope: the terms of the behaviour's parameters and of the agent itself.
        actions: the `action` clauses.
        effects_before: for each action, how many effects (shared ones and the agent's own) precede it in the file.
        emit_choice: emits code that selects the action in the state before the step; returns the variable of its
            number (-1 for none), and for each action the terms of its parameters.
        exists: a variable that is 1 if the agent's object exists when the step begins; None if it always exists.
        reward: the variable that sums up the agent's reward.
    """

    scope: Mapping[str, CodeTerm]
    actions: Sequence[Action]
    effects_before: Sequence[int]
    emit_choice: Callable[[], tuple[code.Local, Sequence[Mapping[str, CodeTerm]]]]
    exists: code.Local | None
    reward: code.Local


@dataclass(frozen=True, slots=True)
class AgentEffect:
    """An effect of the behaviour, for one agent.

    Attributes:
        types: the classes of the names in scope.
        agent: the number of the agent; 0 for shared effects.
        is_shared: True if the effect is declared outside of `agent` blocks.
    """

    effect: Effect
    types: NameClasses
    agent: int
    is_shared: bool


@dataclass(frozen=True, slots=True)
class PendingMatches:
    """The matches of a clause whose rule is applied at the end of the step.

    Attributes:
        match_count: the variable of the number of matches.
        first_row: code for the position of the first match in the row buffers.
    """

    effect: OnFind
    clause: AgentEffect
    question: HelperPattern
    match_count: code.Local
    first_row: code.Expression


class StepEmitter:
    """An emitter of the code of a step, of one agent or of several agents that act together.

    Args:
        writer: the emitter of the function.
        players: the agents in the order in which they act.
        clauses: the effects in the order of the file.
    """

    def __init__(self, writer: FunctionEmitter, players: Sequence[ActingAgent], clauses: Sequence[AgentEffect]) -> None:
        self.writer = writer
        self.agents = players
        self.effects = clauses
        self.changed = code.Local("did", "int")
        self._on_refused = [clause for clause in clauses if isinstance(clause.effect, OnRefused)]
        owners = [None if clause.is_shared else clause.agent for clause in self._on_refused]
        owners = [None, *range(len(players))] if None in owners else owners
        self._refused = {owner: writer.module.new_local("refused") for owner in owners}
        """By agent, or None for shared clauses: the variable that is 1 after a refusal, if this is no error."""
        self._pending: list[PendingMatches] = []

    def _record_refusals_of(self, clause: AgentEffect) -> None:
        """Let the writer's next calls of rules record refusals as those of a clause."""
        self.writer.refused = self._refused.get(None if clause.is_shared else clause.agent)

    def emit_step(self) -> None:
        """Emit the code of a whole step, including pending applications of rules. The caller adds the return."""
        writer = self.writer
        waiting = sum(isinstance(one.effect, OnFind) and bool(one.effect.apply) for one in self.effects)
        if waiting:
            writer.row_regions_above = waiting
            top = writer.module.new_local("t")
            writer.append_assignment(top, emit_sum(TOP, code.Operation("*", (CAPACITY, code.Constant(waiting)))))
            writer.first_row = top
        for local in dict.fromkeys((TOTAL_REWARD, *(player.reward for player in self.agents))):
            writer.append_assignment(local, code.Constant(0.0))
        for local in (END_OF_STEP, HAS_ACTED, self.changed, *self._refused.values()):
            writer.append_assignment(local, ZERO)
        rewards = []
        for number, player in enumerate(self.agents):
            writer.refused = self._refused.get(number)
            rewards.append(self._emit_action(player))
        for clause in self.effects:
            if isinstance(clause.effect, EachStep) and clause.effect.apply:
                self._emit_if_exists(clause, lambda each=clause: self._emit_each_step(each, each.effect))  # type: ignore[misc]
        passed = [0] * len(self.agents)
        for clause in self.effects:
            for number, pays in enumerate(rewards):
                if clause.is_shared or clause.agent == number:
                    pays(passed[number])
                    passed[number] += 1
            self._emit_if_exists(clause, lambda each=clause: self._emit_clause(each))  # type: ignore[misc]
        for pays, number in zip(rewards, passed, strict=True):
            pays(number)
        self._emit_pending()
        for clause in self._on_refused:
            self._emit_if_exists(clause, lambda each=clause: self._emit_on_refused(each, each.effect))  # type: ignore[misc]
        for player in self.agents:
            if player.reward is not TOTAL_REWARD:
                writer.append(code.Assign(TOTAL_REWARD, player.reward, "+="))

    def _emit_if_exists(self, clause: AgentEffect, write: Callable[[], None]) -> None:
        """Emit the code that `write` adds for a clause. A clause of one agent runs only if its agent existed before."""
        there = None if clause.is_shared else self.agents[clause.agent].exists
        with add_missing_span(clause.effect.span):
            if there is None:
                write()
                return
            waiting = len(self._pending)
            body = self.writer.collect(write)
            for pending in self._pending[waiting:]:
                self.writer.append_assignment(pending.match_count, ZERO)
            self.writer.append(code.If(code.emit_equal(there, ONE), body))

    def _emit_each_step(self, clause: AgentEffect, effect: EachStep) -> None:
        self._record_refusals_of(clause)
        self._emit_mark_changed(self.writer.emit_branches(effect.apply, self.agents[clause.agent].scope).done)

    def _emit_mark_changed(self, done: code.Local) -> None:
        self.writer.append(code.If(code.Operation(">", (done, ZERO)), (code.Assign(self.changed, ONE),)))

    # --- the action

    def _emit_action(self, player: ActingAgent) -> Callable[[int], None]:
        """Emit code for an agent's action; return a callback that emits the rewards of actions at a place of the file.

        The callback's argument is the number of effects that precede these actions.
        """
        clause, parameters = player.emit_choice()
        if player.exists is not None:
            self.writer.append(code.If(code.emit_equal(player.exists, ZERO), (code.Assign(clause, NOBODY),)))
        chosen = [code.emit_equal(clause, code.Constant(number)) for number in range(len(player.actions))]
        scopes = [{**player.scope, **names} for names in parameters]
        called = [
            self._emit_apply_action(action, test, scope)
            for action, test, scope in zip(player.actions, chosen, scopes, strict=True)
        ]

        def emit_rewards_at(before: int) -> None:
            each = zip(player.actions, player.effects_before, chosen, called, scopes, strict=True)
            for action, place, test, done, scope in each:
                if place == before and (action.reward or action.else_reward):
                    self._emit_action_reward(action, test, done, scope, player.reward)

        return emit_rewards_at

    def _emit_apply_action(self, action: Action, chosen: code.Expression, scope: Mapping[str, CodeTerm]) -> CallResult:
        writer = self.writer
        done = writer.module.new_local("done")
        writer.append_assignment(done, ZERO)
        outputs: dict[str, CodeTerm] = {}

        def write() -> None:
            called = writer.emit_branches(action.branches, scope)
            writer.append_assignment(done, called.done)
            acted = called.done if writer.refused is None else code.emit_call("max", called.done, writer.refused)
            writer.append_assignment(HAS_ACTED, acted)
            outputs.update(called.outputs)

        body = writer.collect(write)
        for term in outputs.values():
            assert isinstance(term.value, code.Local) or term.type is Scalar.BOOL
            if isinstance(term.value, code.Local):
                writer.append_assignment(term.value, initial_constant(term.type))
        writer.append(code.If(chosen, body))
        self._emit_mark_changed(done)
        return CallResult(done, outputs)

    def _emit_action_reward(
        self,
        action: Action,
        chosen: code.Expression,
        called: CallResult,
        scope: Mapping[str, CodeTerm],
        total: code.Local,
    ) -> None:
        writer = self.writer

        def write() -> None:
            for reward, test, names in (
                (action.reward, ">", {**scope, **called.outputs}),
                (action.else_reward, "==", scope),
            ):
                if reward is not None:

                    def earn(reward: Expression = reward, names: Mapping[str, CodeTerm] = names) -> None:
                        writer.append(code.Assign(total, writer.emit_number(reward, names), "+="))

                    writer.append_if(code.Operation(test, (called.done, ZERO)), earn)

        writer.append_if(chosen, write)

    def _emit_reward(self, clause: AgentEffect, reward: Expression, scope: Mapping[str, CodeTerm]) -> None:
        """Emit code that adds a clause's reward to its agent, or, if it is shared, to the first agent that exists."""
        number = self.writer.emit_number(reward, scope)
        if not clause.is_shared:
            self.writer.append(code.Assign(self.agents[clause.agent].reward, number, "+="))
            return
        first, *others = self.agents
        if first.exists is None:
            self.writer.append(code.Assign(first.reward, number, "+="))
            return
        gain = self.writer.module.new_local("gain", "float")
        self.writer.append_assignment(gain, number)
        given: code.Statement = code.Assign(first.reward, gain, "+=")
        for player in (*reversed(others), first):
            paid = code.Assign(player.reward, gain, "+=")
            given = paid if player.exists is None else code.If(code.emit_equal(player.exists, ONE), (paid,), (given,))
        self.writer.append(given)

    # --- the judgement

    def _emit_clause(self, clause: AgentEffect) -> None:
        writer, effect, scope = self.writer, clause.effect, self.agents[clause.agent].scope
        if isinstance(effect, EachStep) and effect.reward is not None:
            self._emit_reward(clause, effect.reward, scope)
        if not isinstance(effect, OnFind):
            return
        question = writer.condition_pattern(effect.condition, clause.types)
        number = writer.module.new_local("n")
        values = [scope[name].value for name in question.bound]
        writer.append_assignment(number, ZERO)
        alive = writer.bound_alive_tests(question, scope)
        top = writer.first_row
        if effect.apply:
            place = len(self._pending)
            top = emit_sum(TOP, code.Operation("*", (CAPACITY, code.Constant(place)))) if place else TOP
            self._pending.append(PendingMatches(effect, clause, question, number, top))
        rewarded = effect.reward is not None and _uses_names(effect.reward, question.free)
        if effect.apply or rewarded:
            function = writer.matching.emit_rows(writer.pattern_view(question))
        elif effect.reward is not None:
            function = writer.matching.emit_count(writer.pattern_view(question))
        else:
            function = writer.matching.emit_exists(writer.pattern_view(question, free=False))
        writer.module.record_call(function, writer.row_regions_above)
        found: code.Expression = emit_call(function, *values, top=top)
        if not effect.apply and effect.reward is None:
            found = code.ConditionalExpression(found, ONE, ZERO)
        if isinstance(effect.condition, Negation):
            gone = self._deleted_tests(clause, question)
            negated: code.Expression = (
                code.ConditionalExpression(code.emit_joined("or", gone, False), ONE, ZERO) if gone else ZERO
            )
            found = code.ConditionalExpression(code.emit_joined("and", alive, True), found, negated) if alive else found
            found = code.emit_call("max", found, negated) if gone else found
            writer.append_assignment(number, found)
        elif alive:
            writer.append(code.If(code.emit_joined("and", alive, True), (code.Assign(number, found),)))
        else:
            writer.append_assignment(number, found)
        if effect.reward is not None:
            self._emit_match_rewards(clause, effect.reward, question, number, top)
        self._emit_end(effect.end, code.Operation(">", (number, ZERO)))

    def _emit_end(self, name: End | None, test: code.Expression) -> None:
        """Emit code that ends the episode if a test passes, unless an end that wins is known already."""
        end = END_NUMBERS[name]
        if end:
            wins = (
                code.emit_equal(END_OF_STEP, ZERO)
                if end < 0
                else code.Operation("<", (END_OF_STEP, code.Constant(end)))
            )
            held = code.emit_joined("and", [test, wins], True)
            self.writer.append(code.If(held, (code.Assign(END_OF_STEP, code.Constant(end)),)))

    def _emit_on_refused(self, clause: AgentEffect, effect: OnRefused) -> None:
        flags = [flag for owner, flag in self._refused.items() if clause.is_shared or owner == clause.agent]
        test = code.emit_joined("or", [code.emit_equal(flag, ONE) for flag in flags], False)
        reward, scope = effect.reward, self.agents[clause.agent].scope
        if reward is not None:
            self.writer.append_if(test, lambda: self._emit_reward(clause, reward, scope))
        self._emit_end(effect.end, test)

    def _deleted_tests(self, clause: AgentEffect, question: HelperPattern) -> list[code.Expression]:
        scope = self.agents[clause.agent].scope
        found = [self.writer.deleted_test(scope[name], clause.types[name]) for name in question.bound]
        return [test for test in found if test is not None]

    def _emit_match_rewards(
        self,
        clause: AgentEffect,
        reward: Expression,
        question: HelperPattern,
        number: code.Local,
        top: code.Expression,
    ) -> None:
        writer, row = self.writer, self.writer.module.new_local("i")

        def write() -> None:
            scope = dict(self.agents[clause.agent].scope)
            if _uses_names(reward, question.free):
                scope.update(self._emit_load_match(question, emit_sum(top, row), sure=True))
            self._emit_reward(clause, reward, scope)

        writer.append(code.For(row, code.emit_call("range", number), writer.collect(write)))

    def _emit_load_match(self, question: HelperPattern, place: code.Expression, *, sure: bool) -> dict[str, CodeTerm]:
        """Emit code that loads a match from the row buffers; return the terms of its variables.

        If `sure`, the objects in the match certainly have the classes of the variables.
        """
        writer, scope = self.writer, {}
        key = writer.pattern_view(question)
        loads, values = writer.matching.load_row(key, place)
        writer.append(*loads)
        for name, local, type_ in zip(question.free, values, writer.matching.column_types(key), strict=True):
            cls = type_.cls if sure and isinstance(type_, ObjectType) else None
            scope[name] = variable_term(local, type_, cls)
        return scope

    # --- what follows

    def _emit_pending(self) -> None:
        writer = self.writer
        if not self._pending:
            return
        first = writer.module.new_local("first")
        writer.append_assignment(first, ONE)
        for each in self._pending:
            self._record_refusals_of(each.clause)
            row = writer.module.new_local("i")
            rows = code.emit_call("range", each.match_count)
            if each.effect.weight is not None:
                self._emit_apply_sampled(each, each.effect.weight, row, first)
                continue
            body = writer.collect(lambda each=each, row=row: self._emit_apply_match(each, row, first))  # type: ignore[misc]
            writer.append(code.For(row, rows, body))

    def _emit_apply_match(self, each: PendingMatches, row: code.Local, first: code.Local) -> None:
        scope, holds = self._emit_recheck(each, row, first)

        def write() -> None:
            self._emit_mark_changed(self.writer.emit_branches(each.effect.apply, scope).done)

        self.writer.append_if(code.emit_equal(holds, ONE), write)

    def _emit_apply_sampled(self, each: PendingMatches, given: Expression, row: code.Local, first: code.Local) -> None:
        """Emit code that samples one of the pending matches that still hold, by weight, and applies the rule there."""
        writer, rows = self.writer, code.emit_call("range", each.match_count)
        left, weight, share = (writer.module.new_local(name, "float") for name in ("left", "w", "p"))
        none = code.Constant(0.0)

        def emit_with_weight(then: Callable[[Mapping[str, CodeTerm]], None]) -> code.Body:
            def inside() -> None:
                scope, holds = self._emit_recheck(each, row, first)

                def weigh() -> None:
                    writer.append_assignment(weight, writer.emit_number(given, scope))
                    writer.append_fail_if(code.Operation("<", (weight, none)))
                    then(scope)

                writer.append_if(code.emit_equal(holds, ONE), weigh)

            return writer.collect(inside)

        def emit_draw(scope: Mapping[str, CodeTerm]) -> None:
            writer.append_assignment(
                share, code.emit_call("min", code.Operation("/", (weight, left)), code.Constant(1.0))
            )
            lacking = code.Operation("-", (code.Constant(1.0), share))
            drawn = code.emit_equal(code.emit_call("choose", D, code.emit_tuple(share), lacking), ZERO)

            def apply() -> None:
                self._emit_mark_changed(writer.emit_branches(each.effect.apply, scope).done)
                writer.append(code.BreakOrContinue("break"))

            writer.append_if(drawn, apply)

        def emit_candidate(scope: Mapping[str, CodeTerm]) -> None:
            writer.append_if(code.Operation(">", (weight, none)), lambda: emit_draw(scope))
            writer.append(code.Assign(left, weight, "-="))

        writer.append_assignment(left, none)
        writer.append(code.For(row, rows, emit_with_weight(lambda _: writer.append(code.Assign(left, weight, "+=")))))
        writer.append(code.For(row, rows, emit_with_weight(emit_candidate)))

    def _emit_recheck(
        self, each: PendingMatches, row: code.Local, first: code.Local
    ) -> tuple[Mapping[str, CodeTerm], code.Local]:
        """Emit code that loads a pending match and tests that it still is a match.

        Returns:
            The terms in scope, and a variable that is 1 if the rule may be applied. The first match needs no test.
        """
        writer, question = self.writer, each.question
        scope = {
            **self.agents[each.clause.agent].scope,
            **self._emit_load_match(question, emit_sum(each.first_row, row), sure=False),
        }
        holds = writer.module.new_local("holds")
        bound = len(question.bound) + len(question.free)
        key = PatternQuery(question.pattern.qualified_name, tuple(range(bound)), ())
        values = [scope[name].number_code for name in (*question.bound, *question.free)]
        tests = writer.bound_alive_tests(question, scope)
        for name in question.free:
            term = scope[name]
            if isinstance(term.type, ObjectType) and (alive := writer.alive_test(term)) is not None:
                tests.append(alive)
        tests.append(writer.emit_function_call(writer.matching.emit_exists(key), *values))
        held = code.emit_joined("and", tests, True)
        if isinstance(each.effect.condition, Negation):
            held = code.emit_joined("or", [held, *self._deleted_tests(each.clause, question)], False)
        writer.append_assignment(
            holds,
            code.ConditionalExpression(code.Operation("or", (code.emit_equal(first, ONE), held)), ONE, ZERO),
        )
        writer.append_assignment(first, ZERO)
        return scope, holds


def _uses_names(expression: Expression, names: Sequence[str]) -> bool:
    return any(variable.name in names for variable in variables_in(expression))
