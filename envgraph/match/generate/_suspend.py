"""Generate code that evaluates calls of recursive patterns, suspended at each call of the same component."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain
from typing import Final

from envgraph.code import Block, Do, Expression, Local, Name, Tuple, equal, method
from envgraph.match.generate._generate import Translation
from envgraph.match.generate._sinks import Names, Sink, row
from envgraph.match.generate._symbols import Recursive, Source
from envgraph.match.generate._write import Module, local
from envgraph.match.plan._plan import Kind, Step, ViewKey
from envgraph.match.plan._planner import Planner
from envgraph.match.plan._sharing import mentioned
from envgraph.pattern import CallAtom


def evaluation_source(planner: Planner, key: ViewKey) -> Source:
    """Return the source of a function that evaluates a call of a recursive pattern; all unbound positions are wanted.

    `evaluate(t, *values)` adds rows to the table `t` that need no rows of the component. If a call of the component is
    next, the rest of the plan becomes a continuation. It is registered, with the values that it needs, at the table of
    that call. (See `Calls` in `envgraph.match.demand._recursion`.)

    Raises:
        Unplannable: a parameter without a value cannot be enumerated.
    """
    view = planner.view(key)
    module, block = Module(), Block()
    given = {position: local("v", position) for position in key.bound}
    for body in view.bodies:
        outputs = tuple(body.conjunction.parameters[position] for position in key.outputs)
        translation = Suspending(planner, module, body.conjunction, block, given)
        translation.key = key
        translation.first = _flat(body.plan.steps, planner, key)[:1]
        add = lambda names, outputs=outputs: method(_TABLE, "add", row(outputs, names))  # noqa: E731
        translation.body(body.plan, _answers(outputs, add))
    return module.source(module.function("evaluate", [_TABLE, *given.values()], block.body()))


_TABLE: Final = Local("t")


def _answers(variables: tuple[int, ...], each: Callable[[Names], Expression]) -> Sink:
    """Return a sink that executes the expression `each` for every solution. The expression may use the table `t`."""
    return Sink(variables, (), lambda names: (Do(each(names)),), (), (_TABLE,), repeatable=True)


def _inside(step: Step, planner: Planner, key: ViewKey) -> bool:
    """Return True if a step calls a pattern of the recursive component."""
    goal = step.goal
    return isinstance(goal, CallAtom) and goal.pattern in planner.calls.component(key.pattern)


def _flat(steps: Sequence[Step], planner: Planner, key: ViewKey) -> list[Step]:
    """Return the steps. An existence test that calls the recursive component is replaced by its inner steps."""
    found: list[Step] = []
    for step in steps:
        if step.kind is Kind.EXISTS:
            inner = _flat(step.inner[0].steps, planner, key)
            if any(_inside(each, planner, key) for each in inner):
                found += inner
                continue
        found.append(step)
    return found


class Suspending(Translation):
    """A translation of a plan that turns the steps after a call of the recursive component into continuations.

    Attributes:
        key: the pattern query that is evaluated.
        first: the first step of the body, or an empty list.
    """

    key: ViewKey
    first: list[Step]

    def _fork(self, block: Block, continuation: bool) -> Translation:
        if not continuation:
            return super()._fork(block, continuation)
        inner = Suspending(self._planner, self._module, self._conjunction, block, {})
        inner.key, inner.first = self.key, self.first
        return inner

    def _steps(self, steps: Sequence[Step], sink: Sink) -> None:
        assert isinstance(self._planner, Planner)
        steps = _flat(steps, self._planner, self.key)
        number = next((n for n, s in enumerate(steps) if _inside(s, self._planner, self.key)), None)
        if number is None:
            super()._steps(steps, sink)
            return
        before, step, rest = steps[:number], steps[number], steps[number + 1 :]
        known = {
            *self._bindings.names,
            *chain.from_iterable(s.binds for s in before),
        } - self._bindings.constants.keys()
        super()._steps(before, self._suspension(step, rest, sink, known))

    def _suspension(self, step: Step, rest: Sequence[Step], sink: Sink, known: set[int]) -> Sink:
        """Return the sink that registers a continuation for the rows of a call.

        If these rows are the rows of the plan, the sink evaluates the call for the table of its caller instead.

        Args:
            step: the call.
            rest: the steps after the call.
            sink: the sink of the whole plan.
            known: the variables with values at the call, without constants.
        """
        goal = step.goal
        assert isinstance(goal, CallAtom)
        bound = tuple(p for p, v in enumerate(goal.arguments) if v in known or v in self._bindings.constants)
        given = tuple(goal.arguments[position] for position in bound)
        free = tuple(v for p, v in enumerate(goal.arguments) if p not in bound)
        calls = self._module.name(Recursive(goal.pattern, bound))
        if not rest and step.binds and free == sink.variables and len(set(free)) == len(free):
            return _answers(given, lambda names: method(calls, "enter", _TABLE, row(given, names)))
        read = {*sink.variables, *(v for each in rest for v in mentioned(each))}
        inputs = tuple(sorted(read & known))
        how = "read" if step.binds else "once"
        if self._is_own_call(step, bound, given) and step.binds and not inputs:
            how = "again"

        def each(names: Names) -> Expression:
            goes_on = self._rest(inputs, free if step.binds else (), len(free), rest, sink)
            known_there = Tuple((_TABLE, *map(names, inputs)))
            return method(calls, how, row(given, names), goes_on, known_there)

        return _answers((*given, *inputs), each)

    def _is_own_call(self, step: Step, bound: tuple[int, ...], given: tuple[int, ...]) -> bool:
        """Return True if a step is the first of its body and repeats the call that is evaluated, with its values."""
        assert isinstance(step.goal, CallAtom)
        heads = tuple(self._conjunction.parameters[position] for position in self.key.bound)
        plain = len(set(heads)) == len(heads) and self._bindings.constants.keys().isdisjoint(heads)
        same = step.goal.pattern == self.key.pattern and bound == self.key.bound and given == heads
        return plain and same and any(each is step for each in self.first)

    def _rest(
        self, inputs: Sequence[int], columns: Sequence[int], width: int, rest: Sequence[Step], sink: Sink
    ) -> Name:
        """Emit the continuation for a row of a call, and return its name.

        Args:
            inputs: the variables with values that the continuation reads.
            columns: the variables that the row's values are bound to; empty if they are not needed.
            width: the number of values in the row.
            rest: the steps after the call.
            sink: the sink of the whole plan.
        """
        block = Block()
        inner = self._fork(block, continuation=True)
        inner._bindings.names = {v: self._bindings.local(v) for v in inputs}
        inner._joins = self._joins
        parameters = [local("w", number) for number in range(width)]
        for number, variable in enumerate(columns):
            if variable in inner._bindings.names:
                block.test(equal(parameters[number], self._bindings.local(variable)))
            else:
                inner._bindings.names[variable] = parameters[number] = self._bindings.local(variable)
        inner._steps(rest, sink)
        known = [_TABLE, *(self._bindings.local(v) for v in inputs)]
        return self._module.function(self._module.fresh("h"), [*known, *parameters], block.body())
