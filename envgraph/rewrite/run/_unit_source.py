"""Units as generated functions: one for a unit, and one for each block inside it that can fail alone.

A function returns None as soon as a step fails, and else whether anything was changed. Variables of the unit are local
variables, passed to the functions of inner blocks by value, so that a block cannot give a value to anything outside.
They hold names of ours, operators and numbers; whatever comes from a text is in the namespace.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from collections.abc import Mapping as Named
from contextlib import contextmanager
from dataclasses import field
from typing import Any, Final

from envgraph.code import (
    FALSE,
    NONE,
    TRUE,
    Assign,
    Body,
    Constant,
    Do,
    Each,
    Expression,
    For,
    Function,
    Handler,
    If,
    Index,
    Lambda,
    Leave,
    Local,
    Mapping,
    Member,
    Name,
    Operation,
    Return,
    Statement,
    Text,
    While,
    call,
    chained,
    dataclass,
    define,
    equal,
    expression_text,
    inverse,
    is_none,
    joined,
    method,
    printed,
    some,
    tuple_of,
)
from envgraph.code import Choice as Either
from envgraph.code import Try as Attempt
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
    Constraint,
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
from envgraph.pattern import Constant as Literal
from envgraph.pattern import Expression as Term
from envgraph.pattern import If as If_
from envgraph.pattern import Sequence as Steps
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


_RUN, _C, _O, _S, _ROW = map(Local, ("run", "c", "o", "s", "row"))
_FAILURE, _REFUSAL = Member(_RUN, "failure"), Member(_RUN, "refusal")
_FAILED: Final = If(is_none(_O), (Return(NONE),))


@dataclass(slots=True)
class Scope:
    """What stands for each variable of the unit; those in `maybe` may have no value yet."""

    names: dict[str, Local | Index] = field(default_factory=dict)
    maybe: set[str] = field(default_factory=set)

    def inner(self) -> Scope:
        """The scope of a block, which begins with the same variables."""
        return Scope(dict(self.names), set(self.maybe))

    def known(self, name: str) -> bool:
        """Whether a variable has a value for sure."""
        return name in self.names and name not in self.maybe

    @property
    def locals(self) -> list[Local]:
        """All of them as further arguments."""
        return [local for local in self.names.values() if isinstance(local, Local)]


@dataclass(slots=True)
class _Function:
    """A function that is being written; `tracks`: the local `c` holds whether anything was changed."""

    bodies: list[list[Statement]] = field(default_factory=lambda: [[]])
    branches: int = 0
    tracks: bool = False

    def add(self, *statements: Statement) -> None:
        self.bodies[-1] += statements

    def inside(self, write: Callable[[], None]) -> Body:
        """What is written inside a compound statement."""
        self.bodies.append([])
        write()
        return tuple(self.bodies.pop())

    @property
    def body(self) -> Body:
        """All of it."""
        (body,) = self.bodies
        return tuple(body)


class UnitSource:
    """Writes the functions of one checked unit.

    Args:
        checked: a unit without errors.
        rules: everything that can be called, by qualified name.
        run_unit: runs a unit that is called, by qualified name.
        group: the members of a group.

    Attributes:
        namespace: what they need; after `compile` the functions, too.
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
        self._done: list[Function] = []
        self._open: list[_Function] = []
        self._numbers = 0
        self._calls = 0

    def compile(self, signature: Signature) -> Callable[..., bool | None]:
        """The function of the unit; it takes a run and the values of the parameters, and adds the `out` ones."""
        scope = Scope()
        body = self.checked.unit.body
        given = Local("e")
        with self._function() as function:
            for parameter in signature.parameters:
                local = scope.names[parameter.name] = self._local("v")
                key = self._constant(parameter.name)
                if parameter.output:
                    scope.maybe.add(parameter.name)
                function.add(Assign(local, method(given, "get", key, Name("UNSET"))))
            self._body(body, scope)
            for parameter in signature.parameters:
                if parameter.output:
                    entry = Index(given, self._constant(parameter.name))
                    function.add(Assign(entry, scope.names[parameter.name]))
            function.add(Return(_outcome(function)))
        self._done.append(Function("unit", (_RUN, given), function.body))
        define(tuple(self._done), "<unit of envgraph>", self.namespace)
        compiled: Callable[..., bool | None] = self.namespace["unit"]
        return compiled

    @property
    def source(self) -> str:
        """What was written."""
        return printed(tuple(self._done)).text

    # --- functions

    @contextmanager
    def _function(self) -> Iterator[_Function]:
        function = _Function()
        self._open.append(function)
        yield function
        self._open.pop()

    def _body(self, step: Step, scope: Scope) -> None:
        """The steps of a function, which has just begun."""
        function = self._now
        function.tracks = not surely_changes(step, self.checked.calls)
        if function.tracks:
            function.add(Assign(_C, FALSE))
        self._step(step, scope)

    def _inner(self, step: Step, scope: Scope, gives: Sequence[str] = ()) -> Name:
        """A function of its own for a block; it also returns the variables of the names that it gives."""
        name, within = self._new("b"), scope.inner()
        with self._function() as function:
            self._body(step, within)
            outcome = _outcome(function)
            given = [within.names[each] for each in gives]
            function.add(Return(tuple_of(outcome, *given) if given else outcome))
        self._done.append(Function(name, (_RUN, *scope.locals), function.body))
        return Name(name)

    @property
    def _now(self) -> _Function:
        return self._open[-1]

    def _new(self, letter: str) -> str:
        self._numbers += 1
        return f"{letter}{self._numbers}"

    def _local(self, letter: str) -> Local:
        return Local(self._new(letter))

    def _constant(self, value: object) -> Name:
        name = self._new("k")
        self.namespace[name] = value
        return Name(name)

    def _fails(self, text: str, span: Span | None) -> Body:
        """The function ends here, and the step has failed."""
        return Assign(_FAILURE, self._constant((text, span))), Return(NONE)

    def _fails_if(self, test: Expression, text: str, span: Span | None) -> None:
        self._now.add(If(test, self._fails(text, span)))

    def _takes_step(self, site: Name) -> Body:
        """A step of those that a run may take."""
        left = Member(_RUN, "steps")
        over = Operation("<", (left, Constant(0)))
        return Assign(left, Constant(1), "-="), If(over, (Do(call("spent", _RUN, site)),))

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
            case If_():
                self._if(step, scope)
            case Atomic():
                self._atomic(step, scope)

    def _whole(self, step: Step, scope: Scope) -> Expression:
        """A call that runs a block which leaves nothing behind if it fails."""
        name = self._inner(step, scope)
        return self._entered(name, scope) if self._clean(step) else self._guarded(name, scope)

    def _entered(self, name: Name, scope: Scope) -> Expression:
        return call(name, _RUN, *scope.locals)

    def _guarded(self, name: Name, scope: Scope) -> Expression:
        return method(_RUN, "whole", name, *scope.locals)

    def _clean(self, step: Step | None) -> bool:
        """Whether a step leaves nothing behind when it fails, or never fails."""
        match step:
            case Call():
                return self.checked.calls[id(step)].kind != "unit"
            case Steps(steps):
                return not steps or (len(steps) == 1 and self._clean(steps[0]))
            case If_(_, then, otherwise):
                return self._clean(then) and self._clean(otherwise)
            case Try(_, otherwise):
                return self._clean(otherwise)
            case Repeat(lower, _, _):
                return lower == 0  # one that is worked out may be anything
            case _:
                return True

    def _changed(self, changed: Expression) -> None:
        if self._now.tracks:
            self._now.add(Assign(_C, changed, "=" if changed == TRUE else "|="))

    def _alap(self, step: Alap, scope: Scope) -> None:
        function, loop = self._now, self._constant(("the `alap`", step.span))
        name = self._inner(step.body, scope)
        loops = Name("loops")
        if self._loops:
            function.add(Do(method(loops, "begin")))

        def once() -> None:
            function.add(*self._takes_step(loop))
            if self._loops:
                function.add(If(Member(loops, "due"), (Do(method(loops, "turn")),)))
            if self._clean(step.body):
                function.add(Assign(_O, self._entered(name, scope)))
            else:
                # `run.whole`, written out.
                mark, size, gaps = map(Local, ("mark", "size", "gaps"))
                opened = Member(_RUN, "opened")
                function.add(
                    Assign(mark, call("savepoint")),
                    Assign(size, call("len", Member(_RUN, "trace"))),
                    Assign(gaps, call("len", Member(_RUN, "gaps"))),
                    Do(method(opened, "append", mark)),
                    Assign(_O, self._entered(name, scope)),
                    Do(method(opened, "pop")),
                    If(
                        is_none(_O),
                        (
                            Do(call("rollback", mark)),
                            Do(Text("del run.trace[size:], run.gaps[gaps:]", reads=(_RUN, size, gaps))),
                            Leave("break"),
                        ),
                    ),
                    Do(call("release", mark)),
                )
            function.add(If(inverse(_O), (Leave("break"),)))
            self._changed(TRUE)

        function.add(While(TRUE, function.inside(once)))
        function.add(*([Do(method(loops, "end"))] if self._loops else []), Assign(_REFUSAL, NONE))

    def _repeat(self, step: Repeat, scope: Scope) -> None:
        function, loop = self._now, self._constant(("the `repeat`", step.span))
        lower, number = self._rounds(step, scope)
        once, done = self._whole(step.body, scope), self._local("d")

        def stop() -> None:
            if lower != Constant(0):
                parts: list[Expression] = [
                    call("str", done),
                    self._constant(" of at least "),
                    call("str", lower),
                    self._constant(f" rounds succeeded{at(step.span)}: "),
                    Index(_FAILURE, Constant(0)),
                ]
                told = tuple_of(chained("+", parts), Index(_FAILURE, Constant(1)))
                function.add(If(Operation("<", (done, lower)), (Assign(_FAILURE, told), Return(NONE))))
            function.add(Assign(_REFUSAL, NONE), Leave("break"))

        def each() -> None:
            function.add(*self._takes_step(loop), Assign(_O, once))
            function.add(If(is_none(_O), function.inside(stop)))
            self._changed(_O)

        function.add(For(done, call("range", number), function.inside(each)))

    def _rounds(self, step: Repeat, scope: Scope) -> tuple[Expression, Expression]:
        """The least number of rounds, and the number that is drawn."""
        if isinstance(step.lower, int) and isinstance(step.upper, int):
            spread, least = step.upper - step.lower + 1, Constant(step.lower)
            drawn = method(_RUN, "pick", Constant(spread))
            return least, Operation("+", (least, drawn)) if spread > 1 else least
        what = "a bound of the `repeat`"

        def bound_of(bound: int | Term) -> Expression:
            return Constant(bound) if isinstance(bound, int) else self._value(bound, scope, what, step.span)

        lower = bound_of(step.lower)
        upper = lower if step.upper == step.lower else bound_of(step.upper)
        return lower, call("rounds", _RUN, lower, upper, self._constant(step.span))

    def _try(self, step: Try, scope: Scope) -> None:
        function = self._now
        function.add(Assign(_O, self._whole(step.body, scope)))

        def failed() -> None:
            function.add(Assign(_REFUSAL, NONE))
            if step.otherwise is not None:
                self._branch(step.otherwise, scope)

        changed: Body = (Assign(_C, _O, "|="),) if function.tracks else ()
        function.add(If(is_none(_O), function.inside(failed), changed))

    def _if(self, step: If_, scope: Scope) -> None:
        function, test, otherwise = self._now, self._holds(step, scope), step.otherwise
        then = function.inside(lambda: self._branch(step.then, scope))
        other = function.inside(lambda: self._branch(otherwise, scope)) if otherwise is not None else ()
        function.add(If(test, then, other))

    def _branch(self, step: Step, scope: Scope) -> None:
        """A block that fails with the steps around it: it is written in place, unless it nests too deep."""
        function = self._now
        if function.branches == _INLINE:
            function.add(Assign(_O, self._entered(self._inner(step, scope), scope)), _FAILED)
            self._changed(_O)
            return
        function.branches += 1
        self._step(step, scope.inner())
        function.branches -= 1

    def _choice(self, step: Choice, scope: Scope) -> None:
        tiers: dict[int, list[tuple[Name, float]]] = {}
        for alternative in step.alternatives:
            priority, weight = self._preference(alternative)
            name = self._inner(alternative, scope)
            if not self._clean(alternative):
                whole = Return(self._guarded(name, scope))
                name = Name(self._new("b"))
                self._done.append(Function(name.name, (_RUN, *scope.locals), (whole,)))
            tiers.setdefault(priority, []).append((name, weight))
        # The functions are not there yet.
        ordered = [
            tuple_of(
                tuple_of(*(name for name, _ in tier)), self._constant(tuple(weight for _, weight in tier))
            )
            for tier in (tiers[priority] for priority in sorted(tiers, reverse=True))
        ]
        self._now.add(Assign(_O, call("run_one_of", _RUN, tuple_of(*ordered), *scope.locals)))
        self._fails_if(is_none(_O), "no alternative could be applied", step.span)
        self._changed(_O)

    def _preference(self, step: Step) -> tuple[int, float]:
        if isinstance(step, Call):
            callee = self.checked.calls[id(step)]
            return callee.priority, callee.weight
        return 0, 1.0

    def _atomic(self, step: Atomic, scope: Scope) -> None:
        gives = [name for name in self._outputs(step.body) if not scope.known(name)]
        function = self._now
        if not gives:
            function.add(Assign(_O, self._whole(step.body, scope)), _FAILED)
        else:
            name = self._inner(step.body, scope, gives)
            function.add(Assign(_O, self._guarded(name, scope)), _FAILED)
            new = [self._give(scope, each) for each in gives]
            function.add(Assign(tuple_of(_O, *new), _O))
        self._changed(_O)

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

    def _give(self, scope: Scope, name: str) -> Local:
        """A new local variable for a variable that has its value from now on."""
        scope.maybe.discard(name)
        local = scope.names[name] = self._local("v")
        return local

    # --- calls

    def _call(self, step: Call, scope: Scope) -> None:
        callee = self.checked.calls[id(step)]
        if callee.kind == "unit":
            self._call_unit(step, callee, scope)
        elif callee.kind == "group":
            self._call_group(step, callee)
        elif step.every:
            self._call_every(step, callee, scope)
        else:
            self._call_rule(step, callee, scope)

    def _call_group(self, step: Call, callee: Signature) -> None:
        members = self._constant([self._rules[name] for name in self._group(callee.name)])
        site = self._constant((f"`{callee.simple}`", step.span))
        apply = f"apply_{'every' if step.every else 'one'}_of"
        self._now.add(Assign(_O, call(apply, _RUN, members, site)))
        self._fails_if(is_none(_O), f"no rule of `{callee.simple}` could be applied", step.span)
        self._changed(_O)

    def _call_unit(self, step: Call, callee: Signature, scope: Scope) -> None:
        given, new = self._arguments(step, callee, scope)
        items = Mapping(tuple((self._constant(name), value) for name, value in given))
        function, known = self._now, Local("m")
        function.add(Assign(known, items))
        maybe = [scope.names[each] for each in scope.maybe]
        for name, value in given:
            if value in maybe:
                entry = expression_text(Index(known, self._constant(name)))
                unset = Operation("is", (value, Name("UNSET")))
                function.add(If(unset, (Do(Text(f"del {entry}", reads=(known,))),)))
        site = self._constant((f"`{callee.simple}`", step.span))
        function.add(
            Assign(_O, call(self._constant(self._run_unit(callee.name)), _RUN, known, site)), _FAILED
        )
        for theirs, own in new.items():
            function.add(Assign(self._give(scope, own), Index(known, self._constant(theirs))))
        self._changed(_O)

    def _arguments(
        self, step: Call, callee: Signature, scope: Scope
    ) -> tuple[list[tuple[str, Expression]], dict[str, str]]:
        """The parameters that get values, with the locals that hold them; the variables that get one from `out` ones.

        A variable that may have a value is among both.
        """
        given: list[tuple[str, Expression]] = []
        new: dict[str, str] = {}
        for argument, parameter in zip(step.arguments, callee.parameters, strict=False):
            if _is_open(argument) is None:
                continue
            if isinstance(argument, Variable):
                name = argument.name
                if name in scope.names:
                    given.append((parameter.name, scope.names[name]))
                if not scope.known(name):
                    new[parameter.name] = name
            else:
                what = f"an argument of `{step.name}`"
                given.append((parameter.name, self._value(argument, scope, what, step.span)))
        return given, new

    def _value(self, term: Term, scope: Scope, what: str, span: Span | None = None) -> Expression:
        """A local variable with the value of an expression; without a value the step fails."""
        local = self._local("a")
        if isinstance(term, Literal):
            return self._constant(term.value)
        site = self._constant((f"{what} in `{self._name}`", term.span or span))
        asked = call("argument", self._constant(term), self._values(term, scope), Name("read"), site)
        self._now.add(Assign(local, asked))
        self._fails_if(is_none(local), f"{what} has no value", term.span or span)
        return local

    def _values(self, term: Term, scope: Scope) -> Mapping:
        """The values of the variables of an expression."""
        used = {variable.name: scope.names[variable.name] for variable in variables_in(term)}
        return self._mapping(used)

    def _mapping(self, names: Named[str, Expression]) -> Mapping:
        return Mapping(tuple((self._constant(name), value) for name, value in names.items()))

    def _rows(
        self, step: Call, callee: Signature, scope: Scope
    ) -> tuple[RuleRunner, Expression, dict[str, str]]:
        """The rule, its matches, and the variables that get values from `out` parameters.

        For `first` the matches are an iterator, which looks no further than it is asked.
        """
        rule = self._rules[callee.name]
        function, site = self._now, self._constant((f"`{callee.simple}`", step.span))
        function.add(*self._takes_step(site), Assign(_REFUSAL, NONE))
        given, new = self._arguments(step, callee, scope)
        maybe = [scope.names[name] for name in scope.maybe]
        for name, value in given:
            if name not in rule.shape.names:  # an object that the rule creates
                there = Operation("is not", (value, Name("UNSET")))
                self._fails_if(there, f"`{name}` of `{callee.simple}` is a new object", step.span)
        given = [pair for pair in given if pair[0] in rule.shape.names]
        self._check_alive(step, rule, [pair for pair in given if pair[1] not in maybe])
        values = [value for _, value in given]
        rows: Expression
        if any(value in maybe for value in values):
            names = self._constant(tuple(name for name, _ in given))
            made = self._constant(rule.seek if step.first else rule.prepare)
            rows = call("rows_bound_by", made, names, tuple_of(*values))
        elif given or step.first:
            find = (rule.seek if step.first else rule.prepare)(tuple(name for name, _ in given))
            rows = call(self._constant(find), *values)
        elif step.every:
            rows = call(self._constant(rule.all_rows))
        else:
            rows = call(self._constant(rule.reader()))
        return rule, self._chosen(step, rule, rows, scope), new

    def _check_alive(self, step: Call, rule: RuleRunner, given: Sequence[tuple[str, Expression]]) -> None:
        """An object that was deleted has no match."""
        shape = rule.shape
        alive = [call("alive", value) for name, value in given if shape.is_object(shape.position(name))]
        if alive:
            gone = inverse(joined("and", alive, True))
            self._fails_if(gone, f"an argument of `{step.name}` was deleted", step.span)

    def _call_rule(self, step: Call, callee: Signature, scope: Scope) -> None:
        rule, rows, new = self._rows(step, callee, scope)
        function, own = self._now, self._constant(rule)
        missing = f"`{callee.simple}` has no {'such ' if step.where else ''}match"
        refused = f"`{callee.simple}` was refused at each match"
        texts = self._constant((missing, step.span)), self._constant((refused, step.span))
        failed = If(is_none(_S), (Return(NONE),))
        self._calls += 1
        if step.first:
            first = call("next", rows, NONE)
            function.add(Assign(_S, call("call_first", _RUN, own, first, Lambda((), rows), *texts)), failed)
        elif self._calls > _WRITTEN_OUT:
            function.add(Assign(_S, call("call_rule", _RUN, own, rows, *texts)), failed)
        else:
            self._fire_one(step, rule, rows, missing, refused)
        slots = dict(rule.plan.outputs) if isinstance(rule, GraphRule) else {}
        for theirs, name in new.items():
            place = slots[theirs] if theirs in slots else rule.shape.position(theirs)
            function.add(Assign(self._give(scope, name), Index(_S, Constant(place))))
        self._changed(TRUE)

    def _fire_one(self, step: Call, rule: RuleRunner, rows: Expression, missing: str, refused: str) -> None:
        """`call_rule`, written out."""
        function, own = self._now, self._constant(rule)
        all_, n, i, error = map(Local, ("rows", "n", "i", "error"))
        function.add(Assign(all_, rows), Assign(n, call("len", all_)))
        self._fails_if(equal(n, Constant(0)), missing, step.span)
        several = Operation(">", (n, Constant(1)))
        function.add(
            Assign(i, Either(several, method(_RUN, "pick", n), Constant(0))), Assign(_ROW, Index(all_, i))
        )
        fired = Assign(_S, call(self._constant(rule.fire), _ROW))
        another = (
            Assign(_S, call("fire_another", _RUN, own, all_, i, error)),
            If(is_none(_S), self._fails(refused, step.span)),
            Assign(tuple_of(_ROW, _S), _S),
        )
        put = [Do(method(_RUN, "put", each)) for each in (own, _ROW)]
        function.add(Attempt((fired,), (Handler(Name("RuleError"), error, another),)), *put)

    def _call_every(self, step: Call, callee: Signature, scope: Scope) -> None:
        rule, rows, _ = self._rows(step, callee, scope)
        function, site = self._now, self._constant((f"`{callee.simple}`", step.span))
        every = call("fire_every", _RUN, self._constant(rule), call("list", rows), site)
        function.add(Assign(_O, every))

        def failed() -> None:
            refused = f"`{callee.simple}` was refused at each match"
            self._fails_if(some(_REFUSAL), refused, step.span)
            missing = f"`{callee.simple}` has no {'such ' if step.where else ''}match"
            function.add(*self._fails(missing, step.span))

        function.add(If(is_none(_O), function.inside(failed)))
        self._changed(_O)

    # --- the choice of matches

    def _chosen(self, step: Call, rule: RuleRunner, rows: Expression, scope: Scope) -> Expression:
        """Those of the matches that a call is about, in its order."""
        inside = scope.inner()
        for place, name in enumerate(rule.shape.names):
            inside.names[name] = Index(_ROW, Constant(place))
            inside.maybe.discard(name)
        for number, condition in enumerate(step.where):
            test = self._condition(step, number, condition, inside)
            rows = Each(_ROW, _ROW, rows, test, late=step.first)
        if step.by is not None:
            value = call("value_of", self._constant(step.by), self._values(step.by, inside), Name("read"))
            rows = call("best", rows, Lambda((_ROW,), value), Constant(step.limit))
        return rows

    # --- conditions

    def _holds(self, step: If_, scope: Scope) -> Expression:
        if id(step) in self.checked.asked:
            return self._applicable(step, scope)
        assert not isinstance(step.condition, Applicable)
        return self._condition(step, 0, step.condition, scope)

    def _applicable(self, step: If_, scope: Scope) -> Expression:
        """Whether a rule is applicable."""
        asked, callee = self.checked.asked[id(step)]
        rules = self._constant([self._rules[name] for name in self._group(callee.name)])
        given: dict[str, Expression] = {}
        for argument, parameter in zip(asked.arguments, callee.parameters, strict=False):
            if isinstance(argument, Variable):
                if argument.name in scope.names:
                    given[parameter.name] = scope.names[argument.name]
                continue
            what = f"an argument of `{asked.name}` in `{self._name}`"
            site = self._constant((what, argument.span or asked.span))
            term, values = self._constant(argument), self._values(argument, scope)
            given[parameter.name] = call("argument", term, values, Name("read"), site)
        rule = Local("rule")
        applicable = call("is_applicable", rule, self._mapping(given))
        test = call("any", Each(applicable, rule, rules, late=True))
        return inverse(test) if asked.negated else test

    def _condition(self, step: Step, number: int, condition: Constraint, scope: Scope) -> Expression:
        """Whether a condition holds."""
        if isinstance(condition, Check):
            asked = condition.expression
            return call("holds", self._constant(asked), self._values(asked, scope), Name("read"))
        found = self.checked.conditions[id(step), number]
        tester = self._constant(self._matcher.tester(found.pattern.qualified_name))
        test = call(tester, tuple_of(*(scope.names[name] for name in found.arguments)))
        return inverse(test) if found.negated else test

    def _read(self, node: int, feature: str) -> Value | None:
        return read_feature(self._model, node, feature)


def surely_changes(step: Step, calls: Named[int, Signature]) -> bool:
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
        case Try(body, otherwise) | If_(_, body, otherwise):
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
    expression: Term, values: Named[str, Any], read: Callable[[int, str], Value | None], site: Site
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


def _outcome(function: _Function) -> Expression:
    return _C if function.tracks else TRUE


def _is_open(argument: Term) -> bool | None:
    """Whether an argument is a variable; None if it is `_`."""
    if not isinstance(argument, Variable):
        return False
    return None if argument.name.startswith("_") else True
