"""Generation of functions for units: one for the unit, and one for each nested block that can fail by itself.

A function returns None when a step fails, and else True if anything was changed. Variables of the unit are local
variables. They are passed by value to the functions of inner blocks, so that blocks cannot change outer variables. The
source contains only generated names, operators and numbers; values from texts are in the namespace.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping as Named, Sequence
from functools import reduce
from typing import Any, Final

from envgraph import code
from envgraph.graph import Model
from envgraph.match import Matcher, ViewMatcher
from envgraph.pattern import (
    Alap,
    AtomicStep,
    Expression as Term,
    IfStep as If_,
    Repeat,
    StaticType,
    Step,
    StepSequence as Steps,
    TryStep,
    UnitCall,
    UnitChoice,
    Variable,
    check_holds,
    value_of,
)
from envgraph.rewrite._signatures import Signature
from envgraph.rewrite.check._unit_check import CheckedUnit
from envgraph.rewrite.run._rule_runner import RuleRunner
from envgraph.rewrite.run._unit_call_code import UnitCalls
from envgraph.rewrite.run._unit_function_code import (
    CHANGED,
    FAILED,
    FAILURE,
    OUTCOME,
    REFUSAL,
    RUN,
    UnitFunctions,
    VariableScope,
)
from envgraph.rewrite.run._unit_runtime import (
    UNSET,
    apply_every_of,
    apply_one_of,
    argument_value,
    call_first,
    call_rule,
    draw_rounds,
    fire_every,
    format_span,
    is_applicable,
    largest_first,
    raise_step_limit,
    read_feature,
    rows_bound_by,
    run_one_of,
)
from envgraph.rewrite.run._unit_value_code import UnitValues, is_variable_argument

_MOST_INLINE: Final = 8
"""Maximal number of nested `if` branches in one function, because Python limits the nesting of source code."""


class UnitSource:
    """A generator of the functions of one checked unit.

    Args:
        checked: a unit without errors.
        rules: all rules that can be called, by qualified name.
        run_unit: returns the function that runs a unit, by its qualified name.
        group: returns the members of a group.
        model: the model that is changed.
        matcher: evaluates conditions.
    """

    def __init__(
        self,
        checked: CheckedUnit,
        rules: Named[str, RuleRunner],
        run_unit: Callable[[str], Callable[..., Any]],
        group: Callable[[str], tuple[str, ...]],
        model: Model,
        matcher: Matcher,
    ) -> None:
        self._checked = checked
        self._has_loops = isinstance(matcher, ViewMatcher)
        self._functions = functions = UnitFunctions(_runtime_functions(model, matcher))

        def members(name: str) -> list[RuleRunner]:
            return [rules[each] for each in group(name)]

        self._values = UnitValues(checked, functions, matcher, members)
        self._calls = UnitCalls(functions, self._values, rules, run_unit, members)

    def compile(self, signature: Signature) -> Callable[..., bool | None]:
        """Generate and compile the function of the unit.

        The function takes a run and an environment with the parameters, and adds the `out` parameters to the
        environment.
        """
        scope, functions = VariableScope(), self._functions
        given = code.Local("e")
        with functions.open_function() as function:
            for parameter in signature.parameters:
                local = scope.names[parameter.name] = functions.new_local("v")
                key = functions.add_constant(parameter.name)
                if parameter.is_output:
                    scope.maybe_unset.add(parameter.name)
                function.add(code.Assign(local, code.emit_method_call(given, "get", key, code.Name("UNSET"))))
            self._emit_body(self._checked.unit.body, scope)
            for parameter in signature.parameters:
                if parameter.is_output:
                    entry = code.Subscript(given, functions.add_constant(parameter.name))
                    function.add(code.Assign(entry, scope.names[parameter.name]))
            function.add(code.Return(CHANGED))
        functions.finish_function("unit", (RUN, given), function.body)
        return functions.compile_all_and_return("unit")

    @property
    def source(self) -> str:
        """Return the generated source."""
        return self._functions.source

    def _emit_body(self, step: Step, scope: VariableScope) -> None:
        """Emit the steps of the innermost function."""
        self._functions.current.add(code.Assign(CHANGED, code.FALSE))
        self._emit_step(step, scope)

    def _emit_block_function(self, step: Step, scope: VariableScope, returned: Sequence[str] = ()) -> code.Name:
        """Generate a function for a block and return its name. It returns its outcome and the values of `returned`."""
        name, within = self._functions.unused_name("b"), scope.nested_scope()
        with self._functions.open_function() as function:
            self._emit_body(step, within)
            given = [within.names[each] for each in returned]
            function.add(code.Return(code.emit_tuple(CHANGED, *given) if given else CHANGED))
        return self._functions.finish_function(name, (RUN, *scope.local_variables), function.body)

    def _emit_step(self, step: Step, scope: VariableScope) -> None:
        match step:
            case UnitCall():
                self._calls.emit_call(step, self._checked.calls[id(step)], scope)
            case Steps(steps):
                for inner in steps:
                    self._emit_step(inner, scope)
            case UnitChoice():
                self._emit_choice(step, scope)
            case Alap():
                self._emit_alap(step, scope)
            case Repeat():
                self._emit_repeat(step, scope)
            case TryStep():
                self._emit_try(step, scope)
            case If_():
                self._emit_if(step, scope)
            case AtomicStep():
                self._emit_atomic(step, scope)

    def _emit_undoable_call(self, step: Step, scope: VariableScope, returned: Sequence[str] = ()) -> code.Expression:
        """Return a call that runs a block and undoes its changes if it fails. It returns as `_emit_block_function`."""
        name = self._emit_block_function(step, scope, returned)
        if fails_without_changes(step, self._checked.calls):
            return self._emit_block_call(name, scope)
        return self._emit_guarded_call(name, scope)

    def _emit_block_call(self, name: code.Name, scope: VariableScope) -> code.Expression:
        return code.emit_call(name, RUN, *scope.local_variables)

    def _emit_guarded_call(self, name: code.Name, scope: VariableScope) -> code.Expression:
        return code.emit_method_call(RUN, "whole", name, *scope.local_variables)

    def _emit_alap(self, step: Alap, scope: VariableScope) -> None:
        function, loop = self._functions.current, self._functions.add_constant(("the `alap`", step.span))
        whole, loops = self._emit_undoable_call(step.body, scope), code.Name("loops")
        if self._has_loops:
            function.add(code.ExpressionStatement(code.emit_method_call(loops, "begin")))

        def emit_round() -> None:
            function.add(*self._functions.emit_step_count(loop))
            if self._has_loops:
                function.add(
                    code.If(
                        code.AttributeAccess(loops, "due"),
                        (code.ExpressionStatement(code.emit_method_call(loops, "turn")),),
                    )
                )
            function.add(code.Assign(OUTCOME, whole))
            function.add(code.If(code.emit_not(OUTCOME), (code.BreakOrContinue("break"),)))
            self._functions.emit_changed(code.TRUE)

        function.add(code.While(code.TRUE, function.inside(emit_round)))
        function.add(
            *([code.ExpressionStatement(code.emit_method_call(loops, "end"))] if self._has_loops else []),
            code.Assign(REFUSAL, code.NONE),
        )

    def _emit_repeat(self, step: Repeat, scope: VariableScope) -> None:
        function, loop = self._functions.current, self._functions.add_constant(("the `repeat`", step.span))
        lower, number = self._emit_rounds(step, scope)
        once, done = self._emit_undoable_call(step.body, scope), self._functions.new_local("d")

        def emit_stop() -> None:
            if lower != code.Constant(0):
                parts: list[code.Expression] = [
                    code.emit_call("str", done),
                    self._functions.add_constant(" of at least "),
                    code.emit_call("str", lower),
                    self._functions.add_constant(f" rounds succeeded{format_span(step.span)}: "),
                    code.Subscript(FAILURE, code.Constant(0)),
                ]
                joined = reduce(lambda left, right: code.Operation("+", (left, right)), parts)
                reported = code.emit_tuple(joined, code.Subscript(FAILURE, code.Constant(1)))
                function.add(
                    code.If(
                        code.Operation("<", (done, lower)),
                        (code.Assign(FAILURE, reported), code.Return(code.NONE)),
                    )
                )
            function.add(code.Assign(REFUSAL, code.NONE), code.BreakOrContinue("break"))

        def emit_round() -> None:
            function.add(*self._functions.emit_step_count(loop), code.Assign(OUTCOME, once))
            function.add(code.If(code.emit_is_none(OUTCOME), function.inside(emit_stop)))
            self._functions.emit_changed(OUTCOME)

        function.add(code.For(done, code.emit_call("range", number), function.inside(emit_round)))

    def _emit_rounds(self, step: Repeat, scope: VariableScope) -> tuple[code.Expression, code.Expression]:
        """Return expressions for the least number of rounds and for the number that is drawn."""
        if isinstance(step.lower, int) and isinstance(step.upper, int):
            spread, least = step.upper - step.lower + 1, code.Constant(step.lower)
            drawn = code.emit_method_call(RUN, "pick", code.Constant(spread))
            return least, code.Operation("+", (least, drawn)) if spread > 1 else least
        what = "a bound of the `repeat`"

        def bound_of(bound: int | Term) -> code.Expression:
            return (
                code.Constant(bound)
                if isinstance(bound, int)
                else self._values.emit_value(bound, scope, what, step.span)
            )

        lower = bound_of(step.lower)
        upper = lower if step.upper == step.lower else bound_of(step.upper)
        return lower, code.emit_call("rounds", RUN, lower, upper, self._functions.add_constant(step.span))

    def _emit_try(self, step: TryStep, scope: VariableScope) -> None:
        function = self._functions.current
        function.add(code.Assign(OUTCOME, self._emit_undoable_call(step.body, scope)))

        def emit_otherwise() -> None:
            function.add(code.Assign(REFUSAL, code.NONE))
            if step.otherwise is not None:
                self._emit_branch(step.otherwise, scope)

        changed = code.Assign(CHANGED, OUTCOME, "|=")
        function.add(code.If(code.emit_is_none(OUTCOME), function.inside(emit_otherwise), (changed,)))

    def _emit_if(self, step: If_, scope: VariableScope) -> None:
        function, test, otherwise = (
            self._functions.current,
            self._values.emit_if_condition(step, scope),
            step.otherwise,
        )
        then = function.inside(lambda: self._emit_branch(step.then, scope))
        other = function.inside(lambda: self._emit_branch(otherwise, scope)) if otherwise is not None else ()
        function.add(code.If(test, then, other))

    def _emit_branch(self, step: Step, scope: VariableScope) -> None:
        """Emit a block that fails together with the steps around it: in place, or as a function if it is too deep."""
        function = self._functions.current
        if function.branches == _MOST_INLINE:
            function.add(
                code.Assign(OUTCOME, self._emit_block_call(self._emit_block_function(step, scope), scope)),
                FAILED,
            )
            self._functions.emit_changed(OUTCOME)
            return
        function.branches += 1
        self._emit_step(step, scope.nested_scope())
        function.branches -= 1

    def _emit_choice(self, step: UnitChoice, scope: VariableScope) -> None:
        names: dict[int, code.Name] = {}
        for alternative in step.alternatives:
            name = self._emit_block_function(alternative, scope)
            if not fails_without_changes(alternative, self._checked.calls):
                whole = code.Return(self._emit_guarded_call(name, scope))
                name = self._functions.finish_function(
                    self._functions.unused_name("b"), (RUN, *scope.local_variables), (whole,)
                )
            names[id(alternative)] = name
        # Built as expressions, because the functions are not compiled yet.
        ordered = [
            code.emit_tuple(
                code.emit_tuple(*(names[id(alternative)] for alternative, _ in tier)),
                self._functions.add_constant(tuple(weight for _, weight in tier)),
            )
            for tier in choice_tiers(step, self._checked.calls)
        ]
        self._functions.current.add(
            code.Assign(OUTCOME, code.emit_call("run_one_of", RUN, code.emit_tuple(*ordered), *scope.local_variables))
        )
        self._functions.emit_failure_if(code.emit_is_none(OUTCOME), "no alternative could be applied", step.span)
        self._functions.emit_changed(OUTCOME)

    def _emit_atomic(self, step: AtomicStep, scope: VariableScope) -> None:
        gives = [name for name in bound_outputs(step.body, self._checked.calls) if not scope.is_set(name)]
        function = self._functions.current
        function.add(code.Assign(OUTCOME, self._emit_undoable_call(step.body, scope, gives)), FAILED)
        if gives:
            new = [self._functions.new_local_for(scope, each) for each in gives]
            function.add(code.Assign(code.emit_tuple(OUTCOME, *new), OUTCOME))
        self._functions.emit_changed(OUTCOME)


def fails_without_changes(step: Step | None, calls: Named[int, Signature]) -> bool:
    """Return True if a step makes no changes when it fails, or never fails."""
    match step:
        case UnitCall():
            return calls[id(step)].kind != "unit"
        case Steps(steps):
            return not steps or (len(steps) == 1 and fails_without_changes(steps[0], calls))
        case If_(_, then, otherwise):
            return fails_without_changes(then, calls) and fails_without_changes(otherwise, calls)
        case TryStep(_, otherwise):
            return fails_without_changes(otherwise, calls)
        case Repeat(lower, _, _):
            return lower == 0  # a computed bound may have any value
        case _:
            return True


def choice_tiers(step: UnitChoice, calls: Named[int, Signature]) -> list[list[tuple[Step, float]]]:
    """Return the alternatives of a choice with their weights, in lists of equal priority, the highest first."""
    tiers: dict[int, list[tuple[Step, float]]] = {}
    for alternative in step.alternatives:
        callee = calls[id(alternative)] if isinstance(alternative, UnitCall) else None
        priority, weight = (0, 1.0) if callee is None else (callee.priority, callee.weight)
        tiers.setdefault(priority, []).append((alternative, weight))
    return [tiers[priority] for priority in sorted(tiers, reverse=True)]


def bound_outputs(step: Step, calls: Named[int, Signature]) -> dict[str, StaticType | None]:
    """Return the variables that a block passes to `out` parameters and that later steps can use, with their types."""
    match step:
        case Steps(steps):
            return {name: type_ for inner in steps for name, type_ in bound_outputs(inner, calls).items()}
        case AtomicStep(body):
            return bound_outputs(body, calls)
        case UnitCall():
            taken = zip(step.arguments, calls[id(step)].parameters, strict=False)
            return {
                a.name: p.type for a, p in taken if p.is_output and is_variable_argument(a) and isinstance(a, Variable)
            }
        case _:
            return {}


def _runtime_functions(model: Model, matcher: Matcher) -> dict[str, Any]:
    """Return the functions that generated units call, by name."""
    return {
        "UNSET": UNSET,
        "alive": model.graph.alive,
        "apply_every_of": apply_every_of,
        "apply_one_of": apply_one_of,
        "best": largest_first,
        "call_first": call_first,
        "call_rule": call_rule,
        "argument": argument_value,
        "fire_every": fire_every,
        "holds": check_holds,
        "is_applicable": is_applicable,
        "loops": matcher.loops if isinstance(matcher, ViewMatcher) else None,
        "release": model.graph.history.release,
        "rollback": model.graph.history.rollback,
        "rounds": draw_rounds,
        "rows_bound_by": rows_bound_by,
        "run_one_of": run_one_of,
        "savepoint": model.graph.history.savepoint,
        "spent": raise_step_limit,
        "read": lambda node, feature: read_feature(model, node, feature),
        "value_of": value_of,
    }
