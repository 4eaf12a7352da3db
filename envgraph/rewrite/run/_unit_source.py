"""Generation of functions for units: one for the unit, and one for each nested block that can fail by itself.

A function returns None when a step fails, and else True if anything was changed. Variables of the unit are local
variables. They are passed by value to the functions of inner blocks, so that blocks cannot change outer variables. The
source contains only generated names, operators and numbers; values from texts are in the namespace.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping as Named, Sequence
from typing import Any, Final

from envgraph import code
from envgraph.graph import Model
from envgraph.match import Matcher, ViewMatcher
from envgraph.pattern import (
    Alap,
    Atomic,
    Call,
    Choice,
    Expression as Term,
    If as If_,
    Repeat,
    Sequence as Steps,
    Step,
    Try,
    Variable,
    holds,
    value_of,
)
from envgraph.rewrite._names import Signature
from envgraph.rewrite.check._unit_check import CheckedUnit
from envgraph.rewrite.run._run import (
    UNSET,
    apply_every_of,
    apply_one_of,
    argument_value,
    at,
    best,
    call_first,
    call_rule,
    fire_every,
    is_applicable,
    read_feature,
    rounds,
    rows_bound_by,
    run_one_of,
    spent,
)
from envgraph.rewrite.run._runner import RuleRunner
from envgraph.rewrite.run._unit_calls import UnitCalls
from envgraph.rewrite.run._unit_functions import (
    CHANGED,
    FAILED,
    FAILURE,
    OUTCOME,
    REFUSAL,
    RUN,
    Scope,
    UnitFunctions,
)
from envgraph.rewrite.run._unit_values import UnitValues, is_open

_INLINE: Final = 8
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
        self._loops = isinstance(matcher, ViewMatcher)
        self._functions = functions = UnitFunctions(_namespace(model, matcher))

        def members(name: str) -> list[RuleRunner]:
            return [rules[each] for each in group(name)]

        self._values = UnitValues(checked, functions, matcher, members)
        self._calls = UnitCalls(functions, self._values, rules, run_unit, members)

    def compile(self, signature: Signature) -> Callable[..., bool | None]:
        """Generate and compile the function of the unit.

        The function takes a run and an environment with the parameters, and adds the `out` parameters to the
        environment.
        """
        scope, functions = Scope(), self._functions
        given = code.Local("e")
        with functions.begun() as function:
            for parameter in signature.parameters:
                local = scope.names[parameter.name] = functions.local("v")
                key = functions.constant(parameter.name)
                if parameter.output:
                    scope.maybe.add(parameter.name)
                function.add(code.Assign(local, code.method(given, "get", key, code.Name("UNSET"))))
            self._body(self._checked.unit.body, scope)
            for parameter in signature.parameters:
                if parameter.output:
                    entry = code.Index(given, functions.constant(parameter.name))
                    function.add(code.Assign(entry, scope.names[parameter.name]))
            function.add(code.Return(function.outcome))
        functions.end("unit", (RUN, given), function.body)
        return functions.compiled("unit")

    @property
    def source(self) -> str:
        """Return the generated source."""
        return self._functions.source

    def _body(self, step: Step, scope: Scope) -> None:
        """Emit the steps of the innermost function. It tracks changes, unless a success always means a change."""
        function = self._functions.now
        function.tracks = not surely_changes(step, self._checked.calls)
        if function.tracks:
            function.add(code.Assign(CHANGED, code.FALSE))
        self._step(step, scope)

    def _inner(self, step: Step, scope: Scope, gives: Sequence[str] = ()) -> code.Name:
        """Generate a function for a block and return its name. It returns its outcome and the values of `gives`."""
        name, within = self._functions.new("b"), scope.inner()
        with self._functions.begun() as function:
            self._body(step, within)
            given = [within.names[each] for each in gives]
            function.add(code.Return(code.tuple_of(function.outcome, *given) if given else function.outcome))
        return self._functions.end(name, (RUN, *scope.locals), function.body)

    def _step(self, step: Step, scope: Scope) -> None:
        match step:
            case Call():
                self._calls.write(step, self._checked.calls[id(step)], scope)
            case Steps(steps):
                for inner in steps:
                    self._step(inner, scope)
            case Choice():
                self._choice(step, scope)
            case Alap():
                self._alap(step, scope)
            case Repeat():
                self._repeat(step, scope)
            case Try():
                self._try(step, scope)
            case If_():
                self._if(step, scope)
            case Atomic():
                self._atomic(step, scope)

    def _whole(self, step: Step, scope: Scope) -> code.Expression:
        """Return a call that runs a block and undoes its changes if it fails."""
        name = self._inner(step, scope)
        return (
            self._entered(name, scope)
            if leaves_nothing(step, self._checked.calls)
            else self._guarded(name, scope)
        )

    def _entered(self, name: code.Name, scope: Scope) -> code.Expression:
        return code.call(name, RUN, *scope.locals)

    def _guarded(self, name: code.Name, scope: Scope) -> code.Expression:
        return code.method(RUN, "whole", name, *scope.locals)

    def _alap(self, step: Alap, scope: Scope) -> None:
        function, loop = self._functions.now, self._functions.constant(("the `alap`", step.span))
        whole, loops = self._whole(step.body, scope), code.Name("loops")
        if self._loops:
            function.add(code.Do(code.method(loops, "begin")))

        def once() -> None:
            function.add(*self._functions.takes_step(loop))
            if self._loops:
                function.add(code.If(code.Member(loops, "due"), (code.Do(code.method(loops, "turn")),)))
            function.add(code.Assign(OUTCOME, whole))
            function.add(code.If(code.inverse(OUTCOME), (code.Leave("break"),)))
            self._functions.changed(code.TRUE)

        function.add(code.While(code.TRUE, function.inside(once)))
        function.add(
            *([code.Do(code.method(loops, "end"))] if self._loops else []), code.Assign(REFUSAL, code.NONE)
        )

    def _repeat(self, step: Repeat, scope: Scope) -> None:
        function, loop = self._functions.now, self._functions.constant(("the `repeat`", step.span))
        lower, number = self._rounds(step, scope)
        once, done = self._whole(step.body, scope), self._functions.local("d")

        def stop() -> None:
            if lower != code.Constant(0):
                parts: list[code.Expression] = [
                    code.call("str", done),
                    self._functions.constant(" of at least "),
                    code.call("str", lower),
                    self._functions.constant(f" rounds succeeded{at(step.span)}: "),
                    code.Index(FAILURE, code.Constant(0)),
                ]
                told = code.tuple_of(code.chained("+", parts), code.Index(FAILURE, code.Constant(1)))
                function.add(
                    code.If(
                        code.Operation("<", (done, lower)),
                        (code.Assign(FAILURE, told), code.Return(code.NONE)),
                    )
                )
            function.add(code.Assign(REFUSAL, code.NONE), code.Leave("break"))

        def each() -> None:
            function.add(*self._functions.takes_step(loop), code.Assign(OUTCOME, once))
            function.add(code.If(code.is_none(OUTCOME), function.inside(stop)))
            self._functions.changed(OUTCOME)

        function.add(code.For(done, code.call("range", number), function.inside(each)))

    def _rounds(self, step: Repeat, scope: Scope) -> tuple[code.Expression, code.Expression]:
        """Return expressions for the least number of rounds and for the number that is drawn."""
        if isinstance(step.lower, int) and isinstance(step.upper, int):
            spread, least = step.upper - step.lower + 1, code.Constant(step.lower)
            drawn = code.method(RUN, "pick", code.Constant(spread))
            return least, code.Operation("+", (least, drawn)) if spread > 1 else least
        what = "a bound of the `repeat`"

        def bound_of(bound: int | Term) -> code.Expression:
            return (
                code.Constant(bound)
                if isinstance(bound, int)
                else self._values.value(bound, scope, what, step.span)
            )

        lower = bound_of(step.lower)
        upper = lower if step.upper == step.lower else bound_of(step.upper)
        return lower, code.call("rounds", RUN, lower, upper, self._functions.constant(step.span))

    def _try(self, step: Try, scope: Scope) -> None:
        function = self._functions.now
        function.add(code.Assign(OUTCOME, self._whole(step.body, scope)))

        def failed() -> None:
            function.add(code.Assign(REFUSAL, code.NONE))
            if step.otherwise is not None:
                self._branch(step.otherwise, scope)

        changed: code.Body = (code.Assign(CHANGED, OUTCOME, "|="),) if function.tracks else ()
        function.add(code.If(code.is_none(OUTCOME), function.inside(failed), changed))

    def _if(self, step: If_, scope: Scope) -> None:
        function, test, otherwise = self._functions.now, self._values.holds(step, scope), step.otherwise
        then = function.inside(lambda: self._branch(step.then, scope))
        other = function.inside(lambda: self._branch(otherwise, scope)) if otherwise is not None else ()
        function.add(code.If(test, then, other))

    def _branch(self, step: Step, scope: Scope) -> None:
        """Emit a block that fails together with the steps around it: in place, or as a function if it is too deep."""
        function = self._functions.now
        if function.branches == _INLINE:
            function.add(code.Assign(OUTCOME, self._entered(self._inner(step, scope), scope)), FAILED)
            self._functions.changed(OUTCOME)
            return
        function.branches += 1
        self._step(step, scope.inner())
        function.branches -= 1

    def _choice(self, step: Choice, scope: Scope) -> None:
        tiers: dict[int, list[tuple[code.Name, float]]] = {}
        for alternative in step.alternatives:
            priority, weight = _preference(alternative, self._checked.calls)
            name = self._inner(alternative, scope)
            if not leaves_nothing(alternative, self._checked.calls):
                whole = code.Return(self._guarded(name, scope))
                name = self._functions.end(self._functions.new("b"), (RUN, *scope.locals), (whole,))
            tiers.setdefault(priority, []).append((name, weight))
        # Built as expressions, because the functions are not compiled yet.
        ordered = [
            code.tuple_of(
                code.tuple_of(*(name for name, _ in tier)),
                self._functions.constant(tuple(weight for _, weight in tier)),
            )
            for tier in (tiers[priority] for priority in sorted(tiers, reverse=True))
        ]
        self._functions.now.add(
            code.Assign(OUTCOME, code.call("run_one_of", RUN, code.tuple_of(*ordered), *scope.locals))
        )
        self._functions.fails_if(code.is_none(OUTCOME), "no alternative could be applied", step.span)
        self._functions.changed(OUTCOME)

    def _atomic(self, step: Atomic, scope: Scope) -> None:
        gives = [name for name in _outputs(step.body, self._checked.calls) if not scope.known(name)]
        function = self._functions.now
        if not gives:
            function.add(code.Assign(OUTCOME, self._whole(step.body, scope)), FAILED)
        else:
            name = self._inner(step.body, scope, gives)
            function.add(code.Assign(OUTCOME, self._guarded(name, scope)), FAILED)
            new = [self._functions.give(scope, each) for each in gives]
            function.add(code.Assign(code.tuple_of(OUTCOME, *new), OUTCOME))
        self._functions.changed(OUTCOME)


def surely_changes(step: Step, calls: Named[int, Signature]) -> bool:
    """Return True if a step that succeeds has always changed something."""
    match step:
        case Call():
            return calls[id(step)].kind != "unit"
        case Steps(steps):
            return any(surely_changes(inner, calls) for inner in steps)
        case Choice(alternatives):
            return bool(alternatives) and all(surely_changes(inner, calls) for inner in alternatives)
        case Repeat(lower, _, body):
            return isinstance(lower, int) and lower > 0 and surely_changes(body, calls)
        case Try(body, otherwise) | If_(_, body, otherwise):
            return otherwise is not None and surely_changes(body, calls) and surely_changes(otherwise, calls)
        case Atomic(body):
            return surely_changes(body, calls)
        case Alap():
            return False


def leaves_nothing(step: Step | None, calls: Named[int, Signature]) -> bool:
    """Return True if a step makes no changes when it fails, or never fails."""
    match step:
        case Call():
            return calls[id(step)].kind != "unit"
        case Steps(steps):
            return not steps or (len(steps) == 1 and leaves_nothing(steps[0], calls))
        case If_(_, then, otherwise):
            return leaves_nothing(then, calls) and leaves_nothing(otherwise, calls)
        case Try(_, otherwise):
            return leaves_nothing(otherwise, calls)
        case Repeat(lower, _, _):
            return lower == 0  # a computed bound may have any value
        case _:
            return True


def _preference(step: Step, calls: Named[int, Signature]) -> tuple[int, float]:
    if isinstance(step, Call):
        callee = calls[id(step)]
        return callee.priority, callee.weight
    return 0, 1.0


def _outputs(step: Step, calls: Named[int, Signature]) -> list[str]:
    """Return the variables that a block passes to `out` parameters and that the steps after the block can use."""
    match step:
        case Steps(steps):
            return list(dict.fromkeys(name for inner in steps for name in _outputs(inner, calls)))
        case Atomic(body):
            return _outputs(body, calls)
        case Call():
            taken = zip(step.arguments, calls[id(step)].parameters, strict=False)
            return [a.name for a, p in taken if p.output and is_open(a) and isinstance(a, Variable)]
        case _:
            return []


def _namespace(model: Model, matcher: Matcher) -> dict[str, Any]:
    """Return the functions that generated units call, by name."""
    return {
        "UNSET": UNSET,
        "alive": model.graph.alive,
        "apply_every_of": apply_every_of,
        "apply_one_of": apply_one_of,
        "best": best,
        "call_first": call_first,
        "call_rule": call_rule,
        "argument": argument_value,
        "fire_every": fire_every,
        "holds": holds,
        "is_applicable": is_applicable,
        "loops": matcher.loops if isinstance(matcher, ViewMatcher) else None,
        "release": model.graph.history.release,
        "rollback": model.graph.history.rollback,
        "rounds": rounds,
        "rows_bound_by": rows_bound_by,
        "run_one_of": run_one_of,
        "savepoint": model.graph.history.savepoint,
        "spent": spent,
        "read": lambda node, feature: read_feature(model, node, feature),
        "value_of": value_of,
    }
