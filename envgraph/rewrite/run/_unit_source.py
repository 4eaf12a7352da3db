"""Units as generated Python source: one function for a unit, and one for each block inside it that can fail alone.

A function returns None as soon as a step fails, and else whether anything was changed. Variables of the unit are local
variables, passed to the functions of inner blocks by value, so that a block cannot give a value to anything outside.
The source holds names of ours, operators and numbers; whatever comes from a text is in the namespace.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import field
from typing import Any, Final

from envgraph.code import dataclass, define
from envgraph.errors import EvaluationError, RuleError, Span
from envgraph.graph import Model
from envgraph.match import Matcher, ViewMatcher
from envgraph.metamodel import Attribute, Value
from envgraph.pattern import (
    Alap,
    Applicable,
    Atomic,
    Call,
    Check,
    Choice,
    Constant,
    Constraint,
    Expression,
    If,
    Repeat,
    Step,
    Try,
    Variable,
    evaluate,
    explained,
    holds,
    navigations,
    value_of,
    variables_in,
)
from envgraph.pattern import (
    Sequence as Steps,
)
from envgraph.rewrite._match import Row
from envgraph.rewrite._names import Signature
from envgraph.rewrite.check._unit_check import CheckedUnit
from envgraph.rewrite.run._run import (
    UNSET,
    Run,
    Site,
    apply_every_of,
    apply_one_of,
    at,
    call_first,
    call_rule,
    fire_another,
    fire_every,
    is_applicable,
    rows_bound_by,
    run_one_of,
    spent,
)
from envgraph.rewrite.run._runner import GraphRule, RuleRunner

_INLINE: Final = 8
"""So many branches of `if` stand inside each other in one function; Python limits how deep source may nest."""


_WRITTEN_OUT: Final = 200
"""So many calls of rules are written out in the source of a unit: Python takes long to compile a lot of it."""


@dataclass(slots=True)
class Scope:
    """The local variable of each variable of the unit; those in `maybe` may have no value yet."""

    names: dict[str, str] = field(default_factory=dict)
    maybe: set[str] = field(default_factory=set)

    def inner(self) -> Scope:
        """The scope of a block, which begins with the same variables."""
        return Scope(dict(self.names), set(self.maybe))

    def known(self, name: str) -> bool:
        """Whether a variable has a value for sure."""
        return name in self.names and name not in self.maybe

    @property
    def locals(self) -> str:
        """All of them as further arguments."""
        return "".join(f", {name}" for name in self.names.values())


@dataclass(slots=True)
class _Function:
    """A function that is being written; `tracks`: the local `c` holds whether anything was changed."""

    lines: list[str] = field(default_factory=list)
    level: int = 1
    branches: int = 0
    tracks: bool = False

    def add(self, *lines: str) -> None:
        self.lines.extend(" " * self.level + line for line in lines)

    @contextmanager
    def block(self, head: str) -> Iterator[None]:
        """Lines inside a compound statement."""
        self.add(head)
        self.level += 1
        yield
        self.level -= 1


class UnitSource:
    """Writes the source of one checked unit.

    Args:
        checked: a unit without errors.
        rules: everything that can be called, by qualified name.
        run_unit: runs a unit that is called, by qualified name.
        group: the members of a group.

    Attributes:
        namespace: what the source needs; after `compile` the functions, too.
    """

    def __init__(
        self,
        checked: CheckedUnit,
        rules: Mapping[str, RuleRunner],
        run_unit: Callable[[str], Callable[..., Any]],
        group: Callable[[str], tuple[str, ...]],
        model: Model,
        matcher: Matcher,
    ) -> None:
        self.checked = checked
        self._name = checked.unit.qualified_name
        self._rules = rules
        self._run_unit = run_unit
        self._group = group
        self._model = model
        self._matcher = matcher
        self._loops = matcher.loops if isinstance(matcher, ViewMatcher) else None
        self.namespace: dict[str, Any] = {
            "RuleError": RuleError,
            "UNSET": UNSET,
            "alive": model.alive,
            "apply_every_of": apply_every_of,
            "apply_one_of": apply_one_of,
            "best": best,
            "call_first": call_first,
            "call_rule": call_rule,
            "argument": argument_value,
            "fire_another": fire_another,
            "fire_every": fire_every,
            "holds": holds,
            "is_applicable": is_applicable,
            "loops": self._loops,
            "release": model.release,
            "rollback": model.rollback,
            "rounds": rounds,
            "rows_bound_by": rows_bound_by,
            "run_one_of": run_one_of,
            "savepoint": model.savepoint,
            "spent": spent,
            "read": self._read,
            "value_of": value_of,
        }
        self._done: list[str] = []
        self._open: list[_Function] = []
        self._numbers = 0
        self._calls = 0

    def compile(self, signature: Signature) -> Callable[..., bool | None]:
        """The function of the unit; it takes a run and the values of the parameters, and adds the `out` ones."""
        scope = Scope()
        body = self.checked.unit.body
        with self._function() as function:
            for parameter in signature.parameters:
                local = scope.names[parameter.name] = self._new("v")
                key = self._constant(parameter.name)
                if parameter.output:
                    scope.maybe.add(parameter.name)
                function.add(f"{local} = e.get({key}, UNSET)")
            self._body(body, scope)
            for parameter in signature.parameters:
                if parameter.output:
                    function.add(f"e[{self._constant(parameter.name)}] = {scope.names[parameter.name]}")
            function.add(f"return {_outcome(function)}")
        self._finish("def unit(run, e):", function)
        define("\n".join(self._done), f"<unit {len(self._done)}>", self.namespace)
        compiled: Callable[..., bool | None] = self.namespace["unit"]
        return compiled

    @property
    def source(self) -> str:
        """What was written."""
        return "\n".join(self._done)

    # --- functions

    @contextmanager
    def _function(self) -> Iterator[_Function]:
        function = _Function()
        self._open.append(function)
        yield function
        self._open.pop()

    def _finish(self, head: str, function: _Function) -> None:
        self._done += [head, *function.lines]

    def _body(self, step: Step, scope: Scope) -> None:
        """The steps of a function, which has just begun."""
        function = self._now
        function.tracks = not surely_changes(step, self.checked.calls)
        if function.tracks:
            function.add("c = False")
        self._step(step, scope)

    def _inner(self, step: Step, scope: Scope, gives: Sequence[str] = ()) -> str:
        """A function of its own for a block; it also returns the variables of the names that it gives."""
        name, within = self._new("b"), scope.inner()
        head = f"def {name}(run{scope.locals}):"
        with self._function() as function:
            self._body(step, within)
            given = "".join(f", {within.names[each]}" for each in gives)
            function.add(f"return {_outcome(function)}{given}")
        self._finish(head, function)
        return name

    @property
    def _now(self) -> _Function:
        return self._open[-1]

    def _new(self, letter: str) -> str:
        self._numbers += 1
        return f"{letter}{self._numbers}"

    def _constant(self, value: object) -> str:
        name = self._new("k")
        self.namespace[name] = value
        return name

    def _fails(self, text: str, span: Span | None) -> None:
        """The function ends here, and the step has failed."""
        self._now.add(f"run.failure = {self._constant((text, span))}", "return None")

    # --- steps

    def _step(self, step: Step, scope: Scope) -> None:
        match step:
            case Call():
                self._call(step, scope)
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
            case If():
                self._if(step, scope)
            case Atomic():
                self._atomic(step, scope)

    def _whole(self, step: Step, scope: Scope) -> str:
        """A call that runs a block which leaves nothing behind if it fails."""
        name = self._inner(step, scope)
        arguments = scope.locals
        return f"{name}(run{arguments})" if self._clean(step) else f"run.whole({name}{arguments})"

    def _clean(self, step: Step | None) -> bool:
        """Whether a step leaves nothing behind when it fails, or never fails."""
        match step:
            case Call():
                return self.checked.calls[id(step)].kind != "unit"
            case Steps(steps):
                return not steps or (len(steps) == 1 and self._clean(steps[0]))
            case If(_, then, otherwise):
                return self._clean(then) and self._clean(otherwise)
            case Try(_, otherwise):
                return self._clean(otherwise)
            case Repeat(lower, _, _):
                return lower == 0  # one that is worked out may be anything
            case _:
                return True

    def _changed(self, source: str) -> None:
        if self._now.tracks:
            self._now.add(f"c |= {source}" if source != "True" else "c = True")

    def _alap(self, step: Alap, scope: Scope) -> None:
        function, loop = self._now, self._constant(("the `alap`", step.span))
        name, arguments = self._inner(step.body, scope), scope.locals
        if self._loops:
            function.add("loops.begin()")
        with function.block("while True:"):
            function.add("run.steps -= 1", f"if run.steps < 0: spent(run, {loop})")
            if self._loops:
                function.add("if loops.due: loops.turn()")
            if self._clean(step.body):
                function.add(f"o = {name}(run{arguments})")
            else:
                # `run.whole`, written out.
                function.add("mark = savepoint()", "size = len(run.trace)", "gaps = len(run.gaps)")
                function.add("run.opened.append(mark)", f"o = {name}(run{arguments})", "run.opened.pop()")
                function.add(
                    "if o is None:", " rollback(mark)", " del run.trace[size:], run.gaps[gaps:]", " break"
                )
                function.add("release(mark)")
            function.add("if not o: break")
            self._changed("True")
        function.add(*(["loops.end()"] if self._loops else []), "run.refusal = None")

    def _repeat(self, step: Repeat, scope: Scope) -> None:
        function, loop = self._now, self._constant(("the `repeat`", step.span))
        lower, rounds = self._rounds(step, scope)
        call, done = self._whole(step.body, scope), self._new("d")
        with function.block(f"for {done} in range({rounds}):"):
            function.add("run.steps -= 1", f"if run.steps < 0: spent(run, {loop})", f"o = {call}")
            with function.block("if o is None:"):
                if lower != "0":
                    text = self._constant(f" rounds succeeded{at(step.span)}: ")
                    told = f"str({done}) + ' of at least ' + str({lower}) + {text} + run.failure[0]"
                    with function.block(f"if {done} < {lower}:"):
                        function.add(f"run.failure = {told}, run.failure[1]", "return None")
                function.add("run.refusal = None", "break")
            self._changed("o")

    def _rounds(self, step: Repeat, scope: Scope) -> tuple[str, str]:
        """Source of the least number of rounds, and of the number that is drawn."""
        if isinstance(step.lower, int) and isinstance(step.upper, int):
            spread = step.upper - step.lower + 1
            return str(step.lower), f"{step.lower} + run.pick({spread})" if spread > 1 else f"{step.lower}"
        what = "a bound of the `repeat`"

        def source(bound: int | Expression) -> str:
            return str(bound) if isinstance(bound, int) else self._value(bound, scope, what, step.span)

        lower = source(step.lower)
        upper = lower if step.upper == step.lower else source(step.upper)
        return lower, f"rounds(run, {lower}, {upper}, {self._constant(step.span)})"

    def _try(self, step: Try, scope: Scope) -> None:
        function = self._now
        function.add(f"o = {self._whole(step.body, scope)}")
        with function.block("if o is None:"):
            function.add("run.refusal = None")
            if step.otherwise is not None:
                self._branch(step.otherwise, scope)
        if function.tracks:
            function.add("else: c |= o")

    def _if(self, step: If, scope: Scope) -> None:
        function = self._now
        with function.block(f"if {self._holds(step, scope)}:"):
            self._branch(step.then, scope)
        if step.otherwise is not None:
            with function.block("else:"):
                self._branch(step.otherwise, scope)

    def _branch(self, step: Step, scope: Scope) -> None:
        """A block that fails with the steps around it: it is written in place, unless it nests too deep."""
        function = self._now
        if function.branches == _INLINE:
            function.add(f"o = {self._inner(step, scope)}(run{scope.locals})", "if o is None: return None")
            self._changed("o")
            return
        function.branches += 1
        function.add("pass")
        self._step(step, scope.inner())
        function.branches -= 1

    def _choice(self, step: Choice, scope: Scope) -> None:
        tiers: dict[int, list[tuple[str, float]]] = {}
        for alternative in step.alternatives:
            priority, weight = self._preference(alternative)
            name = self._inner(alternative, scope)
            if not self._clean(alternative):
                name, inner = self._new("b"), name
                arguments = scope.locals
                self._done += [f"def {name}(run{arguments}):", f" return run.whole({inner}{arguments})"]
            tiers.setdefault(priority, []).append((name, weight))
        ordered = [tiers[priority] for priority in sorted(tiers, reverse=True)]
        # The functions are not there yet.
        source = "".join(
            f"(({''.join(f'{name}, ' for name, _ in tier)}), {self._constant(tuple(w for _, w in tier))}), "
            for tier in ordered
        )
        function = self._now
        function.add(f"o = run_one_of(run, ({source}){scope.locals})")
        with function.block("if o is None:"):
            self._fails("no alternative could be applied", step.span)
        self._changed("o")

    def _preference(self, step: Step) -> tuple[int, float]:
        if isinstance(step, Call):
            callee = self.checked.calls[id(step)]
            return callee.priority, callee.weight
        return 0, 1.0

    def _atomic(self, step: Atomic, scope: Scope) -> None:
        gives = [name for name in self._outputs(step.body) if not scope.known(name)]
        function = self._now
        if not gives:
            function.add(f"o = {self._whole(step.body, scope)}", "if o is None: return None")
        else:
            name = self._inner(step.body, scope, gives)
            arguments = scope.locals
            function.add(f"o = run.whole({name}{arguments})", "if o is None: return None")
            new = [self._give(scope, each) for each in gives]
            function.add(f"o, {', '.join(new)} = o")
        self._changed("o")

    def _outputs(self, step: Step) -> list[str]:
        """The variables that a block may give values to, for those around it that share its scope."""
        match step:
            case Steps(steps):
                return list(dict.fromkeys(name for inner in steps for name in self._outputs(inner)))
            case Atomic(body):
                return self._outputs(body)
            case Call():
                taken = zip(step.arguments, self.checked.calls[id(step)].parameters, strict=False)
                return [a.name for a, p in taken if p.output and _is_open(a) and isinstance(a, Variable)]
            case _:
                return []

    def _give(self, scope: Scope, name: str) -> str:
        """A new local variable for a variable that has its value from now on."""
        scope.maybe.discard(name)
        local = scope.names[name] = self._new("v")
        return local

    # --- calls

    def _call(self, call: Call, scope: Scope) -> None:
        callee = self.checked.calls[id(call)]
        if callee.kind == "unit":
            self._call_unit(call, callee, scope)
        elif callee.kind == "group":
            self._call_group(call, callee)
        elif call.every:
            self._call_every(call, callee, scope)
        else:
            self._call_rule(call, callee, scope)

    def _call_group(self, call: Call, callee: Signature) -> None:
        members = self._constant([self._rules[name] for name in self._group(callee.name)])
        function = self._now
        site = self._constant((f"`{callee.simple}`", call.span))
        function.add(f"o = apply_{'every' if call.every else 'one'}_of(run, {members}, {site})")
        with function.block("if o is None:"):
            self._fails(f"no rule of `{callee.simple}` could be applied", call.span)
        self._changed("o")

    def _call_unit(self, call: Call, callee: Signature, scope: Scope) -> None:
        given, new = self._arguments(call, callee, scope)
        items = ", ".join(f"{self._constant(name)}: {local}" for name, local in given)
        function = self._now
        function.add(f"m = {{{items}}}")
        for name, local in given:
            if local in {scope.names[each] for each in scope.maybe}:
                function.add(f"if {local} is UNSET: del m[{self._constant(name)}]")
        site = self._constant((f"`{callee.simple}`", call.span))
        function.add(
            f"o = {self._constant(self._run_unit(callee.name))}(run, m, {site})", "if o is None: return None"
        )
        for theirs, own in new.items():
            function.add(f"{self._give(scope, own)} = m[{self._constant(theirs)}]")
        self._changed("o")

    def _arguments(
        self, call: Call, callee: Signature, scope: Scope
    ) -> tuple[list[tuple[str, str]], dict[str, str]]:
        """The parameters that get values, with the locals that hold them; the variables that get one from `out` ones.

        A variable that may have a value is among both.
        """
        given: list[tuple[str, str]] = []
        new: dict[str, str] = {}
        for argument, parameter in zip(call.arguments, callee.parameters, strict=False):
            if _is_open(argument) is None:
                continue
            if isinstance(argument, Variable):
                name = argument.name
                if name in scope.names:
                    given.append((parameter.name, scope.names[name]))
                if not scope.known(name):
                    new[parameter.name] = name
            else:
                what = f"an argument of `{call.name}`"
                given.append((parameter.name, self._value(argument, scope, what, call.span)))
        return given, new

    def _value(self, expression: Expression, scope: Scope, what: str, span: Span | None = None) -> str:
        """A local variable with the value of an expression; without a value the step fails."""
        function, local = self._now, self._new("a")
        if isinstance(expression, Constant):
            return self._constant(expression.value)
        used = {variable.name: scope.names[variable.name] for variable in variables_in(expression)}
        site = self._constant((f"{what} in `{self._name}`", expression.span or span))
        function.add(f"{local} = argument({self._constant(expression)}, {self._values(used)}, read, {site})")
        with function.block(f"if {local} is None:"):
            self._fails(f"{what} has no value", expression.span or span)
        return local

    def _values(self, names: Mapping[str, str]) -> str:
        return "{" + ", ".join(f"{self._constant(name)}: {local}" for name, local in names.items()) + "}"

    def _rows(self, call: Call, callee: Signature, scope: Scope) -> tuple[RuleRunner, str, dict[str, str]]:
        """The rule, the source of its matches, and the variables that get values from `out` parameters.

        For `first` the source is an iterator, which looks no further than it is asked.
        """
        rule = self._rules[callee.name]
        function, site = self._now, self._constant((f"`{callee.simple}`", call.span))
        function.add("run.steps -= 1", f"if run.steps < 0: spent(run, {site})", "run.refusal = None")
        given, new = self._arguments(call, callee, scope)
        maybe = {scope.names[name] for name in scope.maybe}
        for name, local in given:
            if name not in rule.shape.names:  # an object that the rule creates
                with function.block(f"if {local} is not UNSET:"):
                    self._fails(f"`{name}` of `{callee.simple}` is a new object", call.span)
        given = [pair for pair in given if pair[0] in rule.shape.names]
        self._check_alive(call, rule, [pair for pair in given if pair[1] not in maybe])
        if any(local in maybe for _, local in given):
            names = self._constant(tuple(name for name, _ in given))
            values = "".join(f"{local}, " for _, local in given)
            made = self._constant(rule.seek if call.first else rule.prepare)
            source = f"rows_bound_by({made}, {names}, ({values}))"
        elif given or call.first:
            find = (rule.seek if call.first else rule.prepare)(tuple(name for name, _ in given))
            source = f"{self._constant(find)}({', '.join(local for _, local in given)})"
        elif call.every:
            source = f"{self._constant(rule.all_rows)}()"
        else:
            source = f"{self._constant(rule.reader())}()"
        return rule, self._chosen(call, rule, source, scope), new

    def _check_alive(self, call: Call, rule: RuleRunner, given: Sequence[tuple[str, str]]) -> None:
        """An object that was deleted has no match."""
        shape = rule.shape
        objects = [local for name, local in given if shape.is_object(shape.position(name))]
        if objects:
            test = " and ".join(f"alive({local})" for local in objects)
            with self._now.block(f"if not ({test}):"):
                self._fails(f"an argument of `{call.name}` was deleted", call.span)

    def _call_rule(self, call: Call, callee: Signature, scope: Scope) -> None:
        rule, rows, new = self._rows(call, callee, scope)
        function, own = self._now, self._constant(rule)
        missing = f"`{callee.simple}` has no {'such ' if call.where else ''}match"
        refused = f"`{callee.simple}` was refused at each match"
        texts = f"{self._constant((missing, call.span))}, {self._constant((refused, call.span))}"
        self._calls += 1
        if call.first:
            function.add(f"s = call_first(run, {own}, next({rows}, None), lambda: {rows}, {texts})")
            function.add("if s is None: return None")
        elif self._calls > _WRITTEN_OUT:
            function.add(f"s = call_rule(run, {own}, {rows}, {texts})", "if s is None: return None")
        else:
            self._fire_one(call, rule, rows, missing, refused)
        slots = dict(rule.plan.outputs) if isinstance(rule, GraphRule) else {}
        for theirs, name in new.items():
            place = slots[theirs] if theirs in slots else rule.shape.position(theirs)
            function.add(f"{self._give(scope, name)} = s[{place}]")
        self._changed("True")

    def _fire_one(self, call: Call, rule: RuleRunner, rows: str, missing: str, refused: str) -> None:
        """`call_rule`, written out."""
        function, own = self._now, self._constant(rule)
        function.add(f"rows = {rows}", "n = len(rows)")
        with function.block("if n == 0:"):
            self._fails(missing, call.span)
        function.add("i = run.pick(n) if n > 1 else 0", "row = rows[i]")
        function.add("try:", f" s = {self._constant(rule.fire)}(row)", "except RuleError as error:")
        function.add(f" s = fire_another(run, {own}, rows, i, error)")
        with function.block(" if s is None:"):
            function.level += 1
            self._fails(refused, call.span)
            function.level -= 1
        function.add(" row, s = s", f"run.put({own})", "run.put(row)")

    def _call_every(self, call: Call, callee: Signature, scope: Scope) -> None:
        rule, rows, _ = self._rows(call, callee, scope)
        function, site = self._now, self._constant((f"`{callee.simple}`", call.span))
        function.add(f"o = fire_every(run, {self._constant(rule)}, list({rows}), {site})")
        with function.block("if o is None:"):
            with function.block("if run.refusal is not None:"):
                self._fails(f"`{callee.simple}` was refused at each match", call.span)
            self._fails(f"`{callee.simple}` has no {'such ' if call.where else ''}match", call.span)
        self._changed("o")

    # --- the choice of matches

    def _chosen(self, call: Call, rule: RuleRunner, rows: str, scope: Scope) -> str:
        """Those of the matches that a call is about, in its order."""
        inside = Scope(dict(scope.names), set(scope.maybe))
        for place, name in enumerate(rule.shape.names):
            inside.names[name] = f"row[{place}]"
            inside.maybe.discard(name)
        for number, condition in enumerate(call.where):
            test = self._condition(call, number, condition, inside)
            rows = (
                f"(row for row in {rows} if {test})" if call.first else f"[row for row in {rows} if {test}]"
            )
        if call.by is not None:
            used = {variable.name: inside.names[variable.name] for variable in variables_in(call.by)}
            value = f"value_of({self._constant(call.by)}, {self._values(used)}, read)"
            rows = f"best({rows}, lambda row: {value}, {call.limit})"
        return rows

    # --- conditions

    def _holds(self, step: If, scope: Scope) -> str:
        if id(step) in self.checked.asked:
            return self._applicable(step, scope)
        assert not isinstance(step.condition, Applicable)
        return self._condition(step, 0, step.condition, scope)

    def _applicable(self, step: If, scope: Scope) -> str:
        """Source that is true if a rule is applicable."""
        asked, callee = self.checked.asked[id(step)]
        rules = self._constant([self._rules[name] for name in self._group(callee.name)])
        given: dict[str, str] = {}
        for argument, parameter in zip(asked.arguments, callee.parameters, strict=False):
            if isinstance(argument, Variable):
                if argument.name in scope.names:
                    given[parameter.name] = scope.names[argument.name]
                continue
            used = {variable.name: scope.names[variable.name] for variable in variables_in(argument)}
            site = self._constant(
                (f"an argument of `{asked.name}` in `{self._name}`", argument.span or asked.span)
            )
            given[parameter.name] = (
                f"argument({self._constant(argument)}, {self._values(used)}, read, {site})"
            )
        test = f"any(is_applicable(rule, {self._values(given)}) for rule in {rules})"
        return f"not {test}" if asked.negated else test

    def _condition(self, step: Step, number: int, condition: Constraint, scope: Scope) -> str:
        """Source that is true if a condition holds."""
        if isinstance(condition, Check):
            asked = condition.expression
            used = {variable.name: scope.names[variable.name] for variable in variables_in(asked)}
            return f"holds({self._constant(asked)}, {self._values(used)}, read)"
        found = self.checked.conditions[id(step), number]
        test = self._constant(self._matcher.tester(found.pattern.qualified_name))
        values = "".join(f"{scope.names[name]}, " for name in found.arguments)
        return f"{'not ' if found.negated else ''}{test}(({values}))"

    def _read(self, node: int, feature: str) -> Value | None:
        return read_feature(self._model, node, feature)


def surely_changes(step: Step, calls: Mapping[int, Signature]) -> bool:
    """Whether a step that succeeds has always changed something."""
    match step:
        case Call():
            return calls[id(step)].kind != "unit"
        case Steps(steps):
            return any(surely_changes(inner, calls) for inner in steps)
        case Choice(alternatives):
            return bool(alternatives) and all(surely_changes(inner, calls) for inner in alternatives)
        case Repeat(lower, _, body):
            return isinstance(lower, int) and lower > 0 and surely_changes(body, calls)
        case Try(body, otherwise) | If(_, body, otherwise):
            return otherwise is not None and surely_changes(body, calls) and surely_changes(otherwise, calls)
        case Atomic(body):
            return surely_changes(body, calls)
        case Alap():
            return False


def best(rows: Sequence[Row], value: Callable[[Row], Any], limit: int | None) -> list[Row]:
    """The rows with the largest values, in that order, ties as they come; rows without a value are left out."""
    valued = [(found, row) for row in rows if (found := value(row)) is not None]
    valued.sort(key=lambda pair: pair[0], reverse=True)  # stable, reversed or not
    return [row for _, row in valued[:limit]]


def argument_value(
    expression: Expression, values: Mapping[str, Any], read: Callable[[int, str], Value | None], site: Site
) -> Value | None:
    """The value of an argument or a bound, or None if a path in it has none; `site` is what it is, and where.

    Raises:
        EvaluationError: division by zero, overflow, a function outside its domain.
    """
    if any(evaluate(path, values, read) is None for path in navigations(expression)):
        return None
    try:
        return evaluate(expression, values, read)
    except EvaluationError as error:
        name, span = site
        found = explained(error, expression, values, read, span, "write `if check {} {{ .. }}` around it")
        raise EvaluationError(f"{name} has no value: {found.message}", found.span, found.hint) from None


def rounds(run: Run, lower: int, upper: int, span: Span | None) -> int:
    """A number of rounds between two bounds that were worked out.

    Raises:
        EvaluationError: the upper one is below the lower one, or the lower one below 0.
    """
    if not 0 <= lower <= upper:
        hint = "the lower bound comes first, and is at least 0"
        raise EvaluationError(f"cannot repeat {lower}..{upper} times", span, hint)
    return lower + (run.pick(upper - lower + 1) if upper > lower else 0)


def read_feature(model: Model, node: int, feature: str) -> Value | None:
    """A single-valued feature of an object, for `evaluate`; one that was deleted has none."""
    if not model.alive(node):
        return None
    found = model.metamodel.feature(model.class_of(node), feature)
    if found is None:
        return None
    return model.value(node, found) if isinstance(found, Attribute) else model.target(node, found)


def _outcome(function: _Function) -> str:
    return "c" if function.tracks else "True"


def _is_open(argument: Expression) -> bool | None:
    """Whether an argument is a variable; None if it is `_`."""
    if not isinstance(argument, Variable):
        return False
    return None if argument.name.startswith("_") else True
