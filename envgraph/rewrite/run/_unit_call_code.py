"""Code generation for calls of rules, groups and units inside units."""

from __future__ import annotations

from collections.abc import Callable, Mapping as Named, Sequence
from typing import Any

from envgraph import code
from envgraph.pattern import UnitCall
from envgraph.rewrite._signatures import Signature
from envgraph.rewrite.run._rule_runner import GraphRule, RuleRunner
from envgraph.rewrite.run._unit_function_code import (
    FAILED,
    OUTCOME,
    REFUSAL,
    RESULT,
    ROW,
    RUN,
    UnitFunctions,
    VariableScope,
)
from envgraph.rewrite.run._unit_value_code import UnitValues


class UnitCalls:
    """A generator of the calls in the functions of one unit.

    Args:
        functions: the functions being generated.
        values: generates arguments and conditions.
        rules: all rules that can be called, by qualified name.
        run_unit: returns the function that runs a unit, by its qualified name.
        members: returns the rules of a group.
    """

    def __init__(
        self,
        functions: UnitFunctions,
        values: UnitValues,
        rules: Named[str, RuleRunner],
        run_unit: Callable[[str], Callable[..., Any]],
        members: Callable[[str], Sequence[RuleRunner]],
    ) -> None:
        self._functions = functions
        self._values = values
        self._rules = rules
        self._run_unit = run_unit
        self._members = members

    def emit_call(self, step: UnitCall, callee: Signature, scope: VariableScope) -> None:
        """Emit code that calls a rule, group or unit as a step of a unit."""
        if callee.kind == "unit":
            self._emit_unit_call(step, callee, scope)
        elif callee.kind == "group":
            self._emit_group_call(step, callee)
        elif step.every:
            self._emit_every_call(step, callee, scope)
        else:
            self._emit_rule_call(step, callee, scope)

    def _emit_group_call(self, step: UnitCall, callee: Signature) -> None:
        members = self._functions.add_constant(self._members(callee.name))
        call_site = self._functions.add_constant((f"`{callee.simple_name}`", step.span))
        apply = f"apply_{'every' if step.every else 'one'}_of"
        self._functions.current.add(code.Assign(OUTCOME, code.emit_call(apply, RUN, members, call_site)))
        self._functions.emit_failure_if(
            code.emit_is_none(OUTCOME), f"no rule of `{callee.simple_name}` could be applied", step.span
        )
        self._functions.emit_changed(OUTCOME)

    def _emit_unit_call(self, step: UnitCall, callee: Signature, scope: VariableScope) -> None:
        given, new = self._values.emit_arguments(step, callee, scope)
        items = code.DictExpression(tuple((self._functions.add_constant(name), value) for name, value in given))
        function, known = self._functions.current, code.Local("m")
        function.add(code.Assign(known, items))
        maybe = [scope.names[each] for each in scope.maybe_unset]
        for name, value in given:
            if value in maybe:
                entry = code.expression_text(code.Subscript(known, self._functions.add_constant(name)))
                unset = code.Operation("is", (value, code.Name("UNSET")))
                function.add(
                    code.If(unset, (code.ExpressionStatement(code.PythonText(f"del {entry}", reads=(known,))),))
                )
        call_site = self._functions.add_constant((f"`{callee.simple_name}`", step.span))
        function.add(
            code.Assign(
                OUTCOME,
                code.emit_call(self._functions.add_constant(self._run_unit(callee.name)), RUN, known, call_site),
            ),
            FAILED,
        )
        for theirs, own in new.items():
            function.add(
                code.Assign(
                    self._functions.new_local_for(scope, own),
                    code.Subscript(known, self._functions.add_constant(theirs)),
                )
            )
        self._functions.emit_changed(OUTCOME)

    def _emit_rows(
        self, step: UnitCall, callee: Signature, scope: VariableScope
    ) -> tuple[RuleRunner, code.Expression, dict[str, str]]:
        """Emit the preparation of a rule call. Return the rule, an expression for its matches, and its outputs.

        Outputs are the variables that get values, by `out` parameter. For `first` the expression is a lazy iterator.
        """
        rule = self._rules[callee.name]
        function, call_site = (
            self._functions.current,
            self._functions.add_constant((f"`{callee.simple_name}`", step.span)),
        )
        function.add(*self._functions.emit_step_count(call_site), code.Assign(REFUSAL, code.NONE))
        given, new = self._values.emit_arguments(step, callee, scope)
        maybe = [scope.names[name] for name in scope.maybe_unset]
        for name, value in given:
            if name not in rule.shape.names:  # the parameter is an object that the rule creates
                there = code.Operation("is not", (value, code.Name("UNSET")))
                self._functions.emit_failure_if(
                    there, f"`{name}` of `{callee.simple_name}` is a new object and takes no value", step.span
                )
        given = [pair for pair in given if pair[0] in rule.shape.names]
        self._emit_alive_check(step, rule, [pair for pair in given if pair[1] not in maybe])
        values = [value for _, value in given]
        rows: code.Expression
        if any(value in maybe for value in values):
            names = self._functions.add_constant(tuple(name for name, _ in given))
            made = self._functions.add_constant(rule.prepare_lazy if step.first else rule.prepare)
            rows = code.emit_call("rows_bound_by", made, names, code.emit_tuple(*values))
        elif given or step.first:
            find = (rule.prepare_lazy if step.first else rule.prepare)(tuple(name for name, _ in given))
            rows = code.emit_call(self._functions.add_constant(find), *values)
        elif step.every:
            rows = code.emit_call(self._functions.add_constant(rule.all_rows))
        else:
            rows = code.emit_call(self._functions.add_constant(rule.rows_reader()))
        in_order: code.Expression = code.emit_call("sorted", rows)
        if step.first:
            in_order = code.emit_call("iter", in_order)
        rows = code.ConditionalExpression(code.AttributeAccess(RUN, "ordered"), in_order, rows)
        return rule, self._selected_rows(step, rule, rows, scope), new

    def _emit_alive_check(self, step: UnitCall, rule: RuleRunner, given: Sequence[tuple[str, code.Expression]]) -> None:
        """Emit code that makes the step fail if an argument is a deleted object."""
        shape = rule.shape
        alive = [code.emit_call("alive", value) for name, value in given if shape.is_object(shape.position(name))]
        if alive:
            gone = code.emit_not(code.emit_joined("and", alive, True))
            self._functions.emit_failure_if(gone, f"an argument of `{step.name}` was deleted", step.span)

    def _emit_rule_call(self, step: UnitCall, callee: Signature, scope: VariableScope) -> None:
        rule, rows, new = self._emit_rows(step, callee, scope)
        function, own = self._functions.current, self._functions.add_constant(rule)
        missing = f"`{callee.simple_name}` has no {'such ' if step.where else ''}match"
        refused = f"`{callee.simple_name}` was refused at each match"
        texts = (
            self._functions.add_constant((missing, step.span)),
            self._functions.add_constant((refused, step.span)),
        )
        if step.first:
            first = code.emit_call("next", rows, code.NONE)
            call = code.emit_call("call_first", RUN, own, first, code.Lambda((), rows), *texts)
        else:
            call = code.emit_call("call_rule", RUN, own, rows, *texts)
        failed = code.If(code.emit_is_none(RESULT), (code.Return(code.NONE),))
        function.add(code.Assign(RESULT, call), failed)
        slots = dict(rule.plan.outputs) if isinstance(rule, GraphRule) else {}
        for theirs, name in new.items():
            place = slots[theirs] if theirs in slots else rule.shape.position(theirs)
            function.add(
                code.Assign(self._functions.new_local_for(scope, name), code.Subscript(RESULT, code.Constant(place)))
            )
        self._functions.emit_changed(code.TRUE)

    def _emit_every_call(self, step: UnitCall, callee: Signature, scope: VariableScope) -> None:
        rule, rows, _ = self._emit_rows(step, callee, scope)
        function, call_site = (
            self._functions.current,
            self._functions.add_constant((f"`{callee.simple_name}`", step.span)),
        )
        every = code.emit_call(
            "fire_every", RUN, self._functions.add_constant(rule), code.emit_call("list", rows), call_site
        )
        function.add(code.Assign(OUTCOME, every))

        def failed() -> None:
            refused = f"`{callee.simple_name}` was refused at each match"
            self._functions.emit_failure_if(code.emit_is_not_none(REFUSAL), refused, step.span)
            missing = f"`{callee.simple_name}` has no {'such ' if step.where else ''}match"
            function.add(*self._functions.emit_failure(missing, step.span))

        function.add(code.If(code.emit_is_none(OUTCOME), function.inside(failed)))
        self._functions.emit_changed(OUTCOME)

    def _selected_rows(
        self, step: UnitCall, rule: RuleRunner, rows: code.Expression, scope: VariableScope
    ) -> code.Expression:
        """Return an expression for the selected matches of a call, in the order of its `by`."""
        inside = scope.nested_scope()
        for place, name in enumerate(rule.shape.names):
            inside.names[name] = code.Subscript(ROW, code.Constant(place))
            inside.maybe_unset.discard(name)
        for number, condition in enumerate(step.where):
            test = self._values.emit_condition(step, number, condition, inside)
            rows = code.Comprehension(ROW, ROW, rows, test, is_lazy=step.first)
        if step.by is not None:
            value = code.emit_call(
                "value_of",
                self._functions.add_constant(step.by),
                self._values.emit_variable_values(step.by, inside),
                code.Name("read"),
            )
            rows = code.emit_call("best", rows, code.Lambda((ROW,), value), code.Constant(step.limit))
        return rows
