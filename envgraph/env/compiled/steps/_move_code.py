"""Emit the functions of an exploration, in which each application of a rule at a match is a move."""

from __future__ import annotations

from collections.abc import Callable

from envgraph import code
from envgraph.behaviour import Behaviour
from envgraph.code import dataclass
from envgraph.env.compiled.effects._effect_code import EffectEmitter
from envgraph.env.compiled.layout._not_compiled import add_missing_span
from envgraph.env.compiled.layout._program_layout import NOBODY, ONE, TOP, ZERO, D, emit_call, emit_entry, emit_sum
from envgraph.env.compiled.matching._body_code import CAPACITY
from envgraph.env.compiled.steps._clause_code import FunctionEmitter
from envgraph.env.compiled.steps._clause_terms import ACTION, ClauseEmitter
from envgraph.env.compiled.steps._observation_code import COMPONENTS
from envgraph.env.compiled.steps._refused_rules import CLEAR_REFUSED
from envgraph.match.plan import PatternQuery

NO_MOVE = code.Name("NO_MOVE")


@dataclass(frozen=True, slots=True)
class RuleSet(Behaviour):
    """A behaviour that stands for an exploration: its actions are calls of rules.

    Attributes:
        tests: the patterns to test in each state.
    """

    tests: tuple[str, ...] = ()


class MoveEmitter:
    """An emitter of the functions that make a move and test patterns.

    The step of an action applies its rule at a match that the script chooses; its reward is the match's row. The rows
    begin the row buffers, and stay there until all matches are tried.

    Attributes:
        action_names, shape, observation_names: see `TurnStepEmitter`. An observation says which patterns have a match.
    """

    def __init__(self, clauses: ClauseEmitter, rules: RuleSet) -> None:
        self._clauses, self._module, self._matching = clauses, clauses.module, clauses.matching
        self._calls = [action.branches[0].call for action in rules.actions]
        self.action_names = tuple(action.name for action in rules.actions)
        self.observation_names = rules.tests
        self.shape = (2,) * len(rules.tests)

    def emit_bodies(self) -> tuple[code.Body, code.Body, code.Body]:
        """Return the bodies of three functions: make a move, do nothing, and test patterns."""
        count, row, did = (self._module.new_local(name) for name in ("count", "row", "did"))
        matches = self._emit_function(self._emit_matches, ACTION)
        moves = self._emit_function(lambda writer: self._emit_moves(writer, row), ACTION, row)
        step = (
            code.Assign(count, code.emit_call("first_count", D)),
            code.If(code.Operation("<", (count, ZERO)), (code.Assign(count, emit_call(matches, ACTION)),)),
            code.If(code.Operation("<=", (count, ZERO)), (_return_step(ZERO, NO_MOVE, ZERO),)),
            code.Assign(row, code.emit_call("next_choice", D, count)),
            code.Assign(did, emit_call(moves, ACTION, row, top=emit_sum(TOP, CAPACITY))),
            CLEAR_REFUSED,
            code.If(code.Operation("<=", (did, ZERO)), (_return_step(ZERO, NO_MOVE, ONE),)),
            _return_step(row, ZERO, ONE),
        )
        look = emit_call(self._emit_function(self._emit_tests, COMPONENTS), COMPONENTS)
        return step, (code.Return(ZERO),), (code.Return(look),)

    def emit_begin(self, writer: FunctionEmitter) -> None:
        """Emit nothing, because nobody takes turns."""

    def _emit_function(self, write: Callable[[FunctionEmitter], None], *parameters: code.Local) -> str:
        writer = self._clauses.new_writer(code.Return(ZERO))
        with self._module.emitting_function():
            write(writer)
            name = self._module.add_function("explore", parameters, (*writer.all_statements(), code.Return(ZERO)))
        self._module.levels[name] += 1  # the rows of the matches
        return name

    def _emit_moves(self, writer: FunctionEmitter, row: code.Local) -> None:
        """Emit code that applies a rule at the match in a row. It returns -1 after a refusal or an error."""
        for number, call in enumerate(self._calls):
            plan, _, key = writer.plan_and_view(call, ())
            loads, values = self._matching.load_row(key, row)
            with add_missing_span(plan.body.span):
                effects = EffectEmitter(self._matching, plan, values, code.Return(NOBODY)).emit()
            writer.append(code.If(code.emit_equal(ACTION, code.Constant(number)), (*loads, *effects, code.Return(ONE))))

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
        for number, pattern in enumerate(self.observation_names):
            found = self._emit_test(writer, PatternQuery(pattern, (), ()))
            writer.append(code.Assign(emit_entry(COMPONENTS, number), found))

    def _emit_test(self, writer: FunctionEmitter, key: PatternQuery) -> code.Expression:
        found = writer.emit_function_call(self._matching.emit_exists(key))
        return code.ConditionalExpression(found, ONE, ZERO)


def _return_step(row: code.Expression, end: code.Expression, did: code.Expression) -> code.Return:
    return code.Return(code.emit_tuple(code.emit_call("float", row), end, did))
