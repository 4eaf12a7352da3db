"""Code generation for calls of rules, groups and units inside units."""

from __future__ import annotations

from collections.abc import Callable, Mapping as Named, Sequence
from typing import Any

from envgraph import code
from envgraph.pattern import Call
from envgraph.rewrite._names import Signature
from envgraph.rewrite.run._runner import GraphRule, RuleRunner
from envgraph.rewrite.run._unit_functions import (
    FAILED,
    OUTCOME,
    REFUSAL,
    RESULT,
    ROW,
    RUN,
    Scope,
    UnitFunctions,
)
from envgraph.rewrite.run._unit_values import UnitValues


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

    def write(self, step: Call, callee: Signature, scope: Scope) -> None:
        """Emit code that calls a rule, group or unit as a step of a unit."""
        if callee.kind == "unit":
            self._unit(step, callee, scope)
        elif callee.kind == "group":
            self._group(step, callee)
        elif step.every:
            self._every(step, callee, scope)
        else:
            self._rule(step, callee, scope)

    def _group(self, step: Call, callee: Signature) -> None:
        members = self._functions.constant(self._members(callee.name))
        site = self._functions.constant((f"`{callee.simple}`", step.span))
        apply = f"apply_{'every' if step.every else 'one'}_of"
        self._functions.now.add(code.Assign(OUTCOME, code.call(apply, RUN, members, site)))
        self._functions.fails_if(
            code.is_none(OUTCOME), f"no rule of `{callee.simple}` could be applied", step.span
        )
        self._functions.changed(OUTCOME)

    def _unit(self, step: Call, callee: Signature, scope: Scope) -> None:
        given, new = self._values.arguments(step, callee, scope)
        items = code.Mapping(tuple((self._functions.constant(name), value) for name, value in given))
        function, known = self._functions.now, code.Local("m")
        function.add(code.Assign(known, items))
        maybe = [scope.names[each] for each in scope.maybe]
        for name, value in given:
            if value in maybe:
                entry = code.expression_text(code.Index(known, self._functions.constant(name)))
                unset = code.Operation("is", (value, code.Name("UNSET")))
                function.add(code.If(unset, (code.Do(code.Text(f"del {entry}", reads=(known,))),)))
        site = self._functions.constant((f"`{callee.simple}`", step.span))
        function.add(
            code.Assign(
                OUTCOME, code.call(self._functions.constant(self._run_unit(callee.name)), RUN, known, site)
            ),
            FAILED,
        )
        for theirs, own in new.items():
            function.add(
                code.Assign(
                    self._functions.give(scope, own), code.Index(known, self._functions.constant(theirs))
                )
            )
        self._functions.changed(OUTCOME)

    def _rows(
        self, step: Call, callee: Signature, scope: Scope
    ) -> tuple[RuleRunner, code.Expression, dict[str, str]]:
        """Emit the preparation of a rule call. Return the rule, an expression for its matches, and its outputs.

        Outputs are the variables that get values, by `out` parameter. For `first` the expression is a lazy iterator.
        """
        rule = self._rules[callee.name]
        function, site = self._functions.now, self._functions.constant((f"`{callee.simple}`", step.span))
        function.add(*self._functions.takes_step(site), code.Assign(REFUSAL, code.NONE))
        given, new = self._values.arguments(step, callee, scope)
        maybe = [scope.names[name] for name in scope.maybe]
        for name, value in given:
            if name not in rule.shape.names:  # the parameter is an object that the rule creates
                there = code.Operation("is not", (value, code.Name("UNSET")))
                self._functions.fails_if(
                    there, f"`{name}` of `{callee.simple}` is a new object and takes no value", step.span
                )
        given = [pair for pair in given if pair[0] in rule.shape.names]
        self._check_alive(step, rule, [pair for pair in given if pair[1] not in maybe])
        values = [value for _, value in given]
        rows: code.Expression
        if any(value in maybe for value in values):
            names = self._functions.constant(tuple(name for name, _ in given))
            made = self._functions.constant(rule.seek if step.first else rule.prepare)
            rows = code.call("rows_bound_by", made, names, code.tuple_of(*values))
        elif given or step.first:
            find = (rule.seek if step.first else rule.prepare)(tuple(name for name, _ in given))
            rows = code.call(self._functions.constant(find), *values)
        elif step.every:
            rows = code.call(self._functions.constant(rule.all_rows))
        else:
            rows = code.call(self._functions.constant(rule.reader()))
        if not step.first:
            rows = code.Choice(code.Member(RUN, "ordered"), code.call("sorted", rows), rows)
        return rule, self._chosen(step, rule, rows, scope), new

    def _check_alive(
        self, step: Call, rule: RuleRunner, given: Sequence[tuple[str, code.Expression]]
    ) -> None:
        """Emit code that makes the step fail if an argument is a deleted object."""
        shape = rule.shape
        alive = [code.call("alive", value) for name, value in given if shape.is_object(shape.position(name))]
        if alive:
            gone = code.inverse(code.joined("and", alive, True))
            self._functions.fails_if(gone, f"an argument of `{step.name}` was deleted", step.span)

    def _rule(self, step: Call, callee: Signature, scope: Scope) -> None:
        rule, rows, new = self._rows(step, callee, scope)
        function, own = self._functions.now, self._functions.constant(rule)
        missing = f"`{callee.simple}` has no {'such ' if step.where else ''}match"
        refused = f"`{callee.simple}` was refused at each match"
        texts = self._functions.constant((missing, step.span)), self._functions.constant((refused, step.span))
        if step.first:
            first = code.call("next", rows, code.NONE)
            call = code.call("call_first", RUN, own, first, code.Lambda((), rows), *texts)
        else:
            call = code.call("call_rule", RUN, own, rows, *texts)
        failed = code.If(code.is_none(RESULT), (code.Return(code.NONE),))
        function.add(code.Assign(RESULT, call), failed)
        slots = dict(rule.plan.outputs) if isinstance(rule, GraphRule) else {}
        for theirs, name in new.items():
            place = slots[theirs] if theirs in slots else rule.shape.position(theirs)
            function.add(
                code.Assign(self._functions.give(scope, name), code.Index(RESULT, code.Constant(place)))
            )
        self._functions.changed(code.TRUE)

    def _every(self, step: Call, callee: Signature, scope: Scope) -> None:
        rule, rows, _ = self._rows(step, callee, scope)
        function, site = self._functions.now, self._functions.constant((f"`{callee.simple}`", step.span))
        every = code.call("fire_every", RUN, self._functions.constant(rule), code.call("list", rows), site)
        function.add(code.Assign(OUTCOME, every))

        def failed() -> None:
            refused = f"`{callee.simple}` was refused at each match"
            self._functions.fails_if(code.some(REFUSAL), refused, step.span)
            missing = f"`{callee.simple}` has no {'such ' if step.where else ''}match"
            function.add(*self._functions.fails(missing, step.span))

        function.add(code.If(code.is_none(OUTCOME), function.inside(failed)))
        self._functions.changed(OUTCOME)

    def _chosen(self, step: Call, rule: RuleRunner, rows: code.Expression, scope: Scope) -> code.Expression:
        """Return an expression for the selected matches of a call, in the order of its `by`."""
        inside = scope.inner()
        for place, name in enumerate(rule.shape.names):
            inside.names[name] = code.Index(ROW, code.Constant(place))
            inside.maybe.discard(name)
        for number, condition in enumerate(step.where):
            test = self._values.condition(step, number, condition, inside)
            rows = code.Each(ROW, ROW, rows, test, late=step.first)
        if step.by is not None:
            value = code.call(
                "value_of",
                self._functions.constant(step.by),
                self._values.values(step.by, inside),
                code.Name("read"),
            )
            rows = code.call("best", rows, code.Lambda((ROW,), value), code.Constant(step.limit))
        return rows
