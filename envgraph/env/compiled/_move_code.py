"""Emit the functions of an exploration, in which each application of a rule at a match is a move."""

from __future__ import annotations

from collections.abc import Callable

from envgraph import code
from envgraph.behaviour import Behaviour
from envgraph.code import dataclass
from envgraph.env.compiled._body_code import CAPACITY
from envgraph.env.compiled._clause_code import FunctionEmitter
from envgraph.env.compiled._clause_terms import ACTION, ClauseEmitter
from envgraph.env.compiled._effect_code import EffectEmitter
from envgraph.env.compiled._not_compiled import add_missing_span
from envgraph.env.compiled._observation_code import COMPONENTS
from envgraph.env.compiled._program_layout import NOBODY, ONE, ZERO, emit_call, emit_entry
from envgraph.match.plan import PatternQuery


@dataclass(frozen=True, slots=True)
class RuleSet(Behaviour):
    """A behaviour that stands for an exploration: its actions are calls of rules.

    Attributes:
        tests: the patterns to test in each state.
    """

    tests: tuple[str, ...] = ()


class MoveEmitter:
    """An emitter of the functions that make a move, find the matches of a rule, and test patterns.

    The number of a move is `CAPACITY` times the number of the rule plus the row of the match, which begins the row
    buffers. The function that makes it may use the rows behind.

    Attributes:
        action_names, shape, observation_names: see `TurnStepEmitter`. The first component of an observation is for the
            caller. Each other says if a pattern has a match.
    """

    def __init__(self, clauses: ClauseEmitter, rules: RuleSet) -> None:
        self._clauses, self._module, self._matching = clauses, clauses.module, clauses.matching
        self._calls = [action.branches[0].call for action in rules.actions]
        self.action_names = tuple(action.name for action in rules.actions)
        self.observation_names = ("depth", *rules.tests)
        self.shape = (2,) * len(self.observation_names)

    def emit_bodies(self) -> tuple[code.Body, code.Body, code.Body]:
        """Return the bodies of three functions: make a move, store the matches of a rule as rows, and test patterns."""
        return (
            self._emit_function(ACTION, self._emit_moves),
            self._emit_function(ACTION, self._emit_matches),
            self._emit_function(COMPONENTS, self._emit_tests),
        )

    def emit_begin(self, writer: FunctionEmitter) -> None:
        """Emit nothing, because nobody takes turns."""

    def _emit_function(self, parameter: code.Local, write: Callable[[FunctionEmitter], None]) -> code.Body:
        writer = self._clauses.new_writer(code.Return(ZERO))
        with self._module.emitting_function():
            write(writer)
            name = self._module.add_function("explore", (parameter,), (*writer.all_statements(), code.Return(ZERO)))
        self._module.levels[name] += 1  # the rows of the matches
        return (code.Return(emit_call(name, parameter)),)

    def _emit_moves(self, writer: FunctionEmitter) -> None:
        """Emit code that makes a move. It returns -1 after a refusal or an error."""
        rule, row = self._module.new_local("rule"), self._module.new_local("row")
        writer.append_assignment(rule, code.emit_call("quotient", ACTION, CAPACITY))
        writer.append_assignment(row, code.Operation("%", (ACTION, CAPACITY)))
        for number, call in enumerate(self._calls):
            plan, _, key = writer.plan_and_view(call, ())
            loads, values = self._matching.load_row(key, row)
            with add_missing_span(plan.body.span):
                effects = EffectEmitter(self._matching, plan, values, code.Return(NOBODY)).emit()
            writer.append(code.If(code.emit_equal(rule, code.Constant(number)), (*loads, *effects, code.Return(ONE))))

    def _emit_matches(self, writer: FunctionEmitter) -> None:
        for number, call in enumerate(self._calls):
            _, _, key = writer.plan_and_view(call, ())
            found: code.Expression
            if key.outputs:
                found = writer.emit_function_call(self._matching.emit_rows(key))
            else:
                found = self._emit_test(writer, key)
            writer.append(code.If(code.emit_equal(ACTION, code.Constant(number)), (code.Return(found),)))

    def _emit_tests(self, writer: FunctionEmitter) -> None:
        for number, pattern in enumerate(self.observation_names[1:], 1):
            found = self._emit_test(writer, PatternQuery(pattern, (), ()))
            writer.append(code.Assign(emit_entry(COMPONENTS, number), found))

    def _emit_test(self, writer: FunctionEmitter, key: PatternQuery) -> code.Expression:
        found = writer.emit_function_call(self._matching.emit_exists(key))
        return code.ConditionalExpression(found, ONE, ZERO)
