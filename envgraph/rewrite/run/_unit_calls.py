"""What calls of rules, groups and units become in generated functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from collections.abc import Mapping as Named
from typing import Any, Final

from envgraph.code import (
    NONE,
    TRUE,
    Assign,
    Constant,
    Do,
    Each,
    Expression,
    Handler,
    If,
    Index,
    Lambda,
    Local,
    Mapping,
    Name,
    Operation,
    Return,
    Text,
    call,
    equal,
    expression_text,
    inverse,
    is_none,
    joined,
    method,
    some,
    tuple_of,
)
from envgraph.code import Choice as Either
from envgraph.code import Try as Attempt
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

_WRITTEN_OUT: Final = 200
"""So many calls of rules are written out in the source of a unit: Python takes long to compile a lot of it."""


class UnitCalls:
    """Writes calls into the functions of one unit.

    Args:
        functions: what is being written.
        values: writes the arguments and conditions.
        rules: all that can be called, by qualified name.
        run_unit: runs a unit that is called, by qualified name.
        members: the rules of a group.
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
        self._calls = 0

    def write(self, step: Call, callee: Signature, scope: Scope) -> None:
        """Write the call of something."""
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
        self._functions.now.add(Assign(OUTCOME, call(apply, RUN, members, site)))
        self._functions.fails_if(
            is_none(OUTCOME), f"no rule of `{callee.simple}` could be applied", step.span
        )
        self._functions.changed(OUTCOME)

    def _unit(self, step: Call, callee: Signature, scope: Scope) -> None:
        given, new = self._values.arguments(step, callee, scope)
        items = Mapping(tuple((self._functions.constant(name), value) for name, value in given))
        function, known = self._functions.now, Local("m")
        function.add(Assign(known, items))
        maybe = [scope.names[each] for each in scope.maybe]
        for name, value in given:
            if value in maybe:
                entry = expression_text(Index(known, self._functions.constant(name)))
                unset = Operation("is", (value, Name("UNSET")))
                function.add(If(unset, (Do(Text(f"del {entry}", reads=(known,))),)))
        site = self._functions.constant((f"`{callee.simple}`", step.span))
        function.add(
            Assign(OUTCOME, call(self._functions.constant(self._run_unit(callee.name)), RUN, known, site)),
            FAILED,
        )
        for theirs, own in new.items():
            function.add(
                Assign(self._functions.give(scope, own), Index(known, self._functions.constant(theirs)))
            )
        self._functions.changed(OUTCOME)

    def _rows(
        self, step: Call, callee: Signature, scope: Scope
    ) -> tuple[RuleRunner, Expression, dict[str, str]]:
        """The rule, its matches, and the variables that get values from `out` parameters.

        For `first` the matches are an iterator, which looks no further than it is asked.
        """
        rule = self._rules[callee.name]
        function, site = self._functions.now, self._functions.constant((f"`{callee.simple}`", step.span))
        function.add(*self._functions.takes_step(site), Assign(REFUSAL, NONE))
        given, new = self._values.arguments(step, callee, scope)
        maybe = [scope.names[name] for name in scope.maybe]
        for name, value in given:
            if name not in rule.shape.names:  # an object that the rule creates
                there = Operation("is not", (value, Name("UNSET")))
                self._functions.fails_if(there, f"`{name}` of `{callee.simple}` is a new object", step.span)
        given = [pair for pair in given if pair[0] in rule.shape.names]
        self._check_alive(step, rule, [pair for pair in given if pair[1] not in maybe])
        values = [value for _, value in given]
        rows: Expression
        if any(value in maybe for value in values):
            names = self._functions.constant(tuple(name for name, _ in given))
            made = self._functions.constant(rule.seek if step.first else rule.prepare)
            rows = call("rows_bound_by", made, names, tuple_of(*values))
        elif given or step.first:
            find = (rule.seek if step.first else rule.prepare)(tuple(name for name, _ in given))
            rows = call(self._functions.constant(find), *values)
        elif step.every:
            rows = call(self._functions.constant(rule.all_rows))
        else:
            rows = call(self._functions.constant(rule.reader()))
        return rule, self._chosen(step, rule, rows, scope), new

    def _check_alive(self, step: Call, rule: RuleRunner, given: Sequence[tuple[str, Expression]]) -> None:
        """An object that was deleted has no match."""
        shape = rule.shape
        alive = [call("alive", value) for name, value in given if shape.is_object(shape.position(name))]
        if alive:
            gone = inverse(joined("and", alive, True))
            self._functions.fails_if(gone, f"an argument of `{step.name}` was deleted", step.span)

    def _rule(self, step: Call, callee: Signature, scope: Scope) -> None:
        rule, rows, new = self._rows(step, callee, scope)
        function, own = self._functions.now, self._functions.constant(rule)
        missing = f"`{callee.simple}` has no {'such ' if step.where else ''}match"
        refused = f"`{callee.simple}` was refused at each match"
        texts = self._functions.constant((missing, step.span)), self._functions.constant((refused, step.span))
        failed = If(is_none(RESULT), (Return(NONE),))
        self._calls += 1
        if step.first:
            first = call("next", rows, NONE)
            function.add(
                Assign(RESULT, call("call_first", RUN, own, first, Lambda((), rows), *texts)), failed
            )
        elif self._calls > _WRITTEN_OUT:
            function.add(Assign(RESULT, call("call_rule", RUN, own, rows, *texts)), failed)
        else:
            self._fire_one(step, rule, rows, missing, refused)
        slots = dict(rule.plan.outputs) if isinstance(rule, GraphRule) else {}
        for theirs, name in new.items():
            place = slots[theirs] if theirs in slots else rule.shape.position(theirs)
            function.add(Assign(self._functions.give(scope, name), Index(RESULT, Constant(place))))
        self._functions.changed(TRUE)

    def _fire_one(self, step: Call, rule: RuleRunner, rows: Expression, missing: str, refused: str) -> None:
        """`call_rule`, written out."""
        function, own = self._functions.now, self._functions.constant(rule)
        all_, n, i, error = map(Local, ("rows", "n", "i", "error"))
        function.add(Assign(all_, rows), Assign(n, call("len", all_)))
        self._functions.fails_if(equal(n, Constant(0)), missing, step.span)
        several = Operation(">", (n, Constant(1)))
        function.add(
            Assign(i, Either(several, method(RUN, "pick", n), Constant(0))), Assign(ROW, Index(all_, i))
        )
        fired = Assign(RESULT, call(self._functions.constant(rule.fire), ROW))
        another = (
            Assign(RESULT, call("fire_another", RUN, own, all_, i, error)),
            If(is_none(RESULT), self._functions.fails(refused, step.span)),
            Assign(tuple_of(ROW, RESULT), RESULT),
        )
        put = [Do(method(RUN, "put", each)) for each in (own, ROW)]
        function.add(Attempt((fired,), (Handler(Name("RuleError"), error, another),)), *put)

    def _every(self, step: Call, callee: Signature, scope: Scope) -> None:
        rule, rows, _ = self._rows(step, callee, scope)
        function, site = self._functions.now, self._functions.constant((f"`{callee.simple}`", step.span))
        every = call("fire_every", RUN, self._functions.constant(rule), call("list", rows), site)
        function.add(Assign(OUTCOME, every))

        def failed() -> None:
            refused = f"`{callee.simple}` was refused at each match"
            self._functions.fails_if(some(REFUSAL), refused, step.span)
            missing = f"`{callee.simple}` has no {'such ' if step.where else ''}match"
            function.add(*self._functions.fails(missing, step.span))

        function.add(If(is_none(OUTCOME), function.inside(failed)))
        self._functions.changed(OUTCOME)

    def _chosen(self, step: Call, rule: RuleRunner, rows: Expression, scope: Scope) -> Expression:
        """Those of the matches that a call is about, in its order."""
        inside = scope.inner()
        for place, name in enumerate(rule.shape.names):
            inside.names[name] = Index(ROW, Constant(place))
            inside.maybe.discard(name)
        for number, condition in enumerate(step.where):
            test = self._values.condition(step, number, condition, inside)
            rows = Each(ROW, ROW, rows, test, late=step.first)
        if step.by is not None:
            value = call(
                "value_of",
                self._functions.constant(step.by),
                self._values.values(step.by, inside),
                Name("read"),
            )
            rows = call("best", rows, Lambda((ROW,), value), Constant(step.limit))
        return rows
