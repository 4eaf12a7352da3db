"""Units that a Python function describes: it is called once, and what it says becomes the data of a unit."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from inspect import Parameter as Argument, signature
from types import EllipsisType
from typing import Final

from envgraph.errors import InvalidArgument
from envgraph.metamodel import Value
from envgraph.pattern import (
    Alap,
    Applicable,
    Atomic,
    Binary,
    Call,
    Choice,
    Conditional,
    Constant,
    Constraint,
    EnumLiteral,
    Evaluation,
    Expression,
    FunctionCall,
    If,
    Navigation,
    Negation,
    Parameter,
    PatternCall,
    Repeat,
    Sequence,
    Step,
    Term,
    Try,
    Unary,
    Unit,
    Variable,
)
from envgraph.rewrite.engine._registered import named_type

STEPS: Final = "steps"
"""The parameter by which a function says that it describes a unit."""

_EXPRESSIONS: Final = (
    *(Variable, Constant, EnumLiteral, Navigation, FunctionCall),
    *(Unary, Binary, Conditional),
)

Condition = Constraint

Given = Expression | Value | EllipsisType
"""An argument of a call: a parameter of the unit, an expression, a plain value, or `...` for any."""


class Steps:
    """What the function of a described unit says the unit does; each method is a step.

    Arguments of calls are parameters of the unit, expressions, plain values, or `...` where the text has `_`.

    >>> steps = Steps()
    >>> steps.call("walk", Variable("hedgehog"))
    >>> with steps.repeat(1, 3):
    ...     steps.choose("water", "ground")
    >>> len(steps.body.steps)
    2
    """

    def __init__(self) -> None:
        self._open: list[list[Step]] = [[]]

    @property
    def body(self) -> Sequence:
        """What has been said so far; not inside of a block.

        Raises:
            InvalidArgument: a block is still open.
        """
        if len(self._open) > 1:
            raise InvalidArgument("a block of the unit is still open: use `with`")
        return Sequence(tuple(self._open[0]))

    def call(
        self, name: str, *arguments: Given, first: bool = False, where: Iterable[Condition] = ()
    ) -> None:
        """`name(arguments);`: a rule, group or unit; `first`: a rule at its first match, not one drawn at random.

        `where`: conditions that the match of a rule has to meet.
        """
        self._add(replace(_call(name, arguments), first=first, where=tuple(where)))

    def every(
        self,
        name: str,
        *arguments: Given,
        by: Given | None = None,
        top: int | None = None,
        where: Iterable[Condition] = (),
    ) -> None:
        """`all name(arguments);`: a rule at each of its matches of then; `by` orders them, `top` takes so many."""
        order = None if by is None else _expression(by)
        self._add(replace(_call(name, arguments), every=True, by=order, limit=top, where=tuple(where)))

    def choose(self, *alternatives: str | Call) -> None:
        """`a | b;`: names, or `Call`s where there are arguments."""
        if not alternatives:
            raise InvalidArgument("`choose` takes at least one rule or unit")
        self._add(Choice(tuple(one if isinstance(one, Call) else _call(one, ()) for one in alternatives)))

    def either(self) -> AbstractContextManager[None]:
        """`{ .. }`, the first alternative of a choice; `alternatively` follows."""
        return self._block(lambda body: self._add(Choice((body,))))

    def alternatively(self) -> AbstractContextManager[None]:
        """`| { .. }`: one more alternative of the `either`, `alternatively` or `choose` right before.

        Raises:
            InvalidArgument: there is none.
        """
        last = self._last
        if not isinstance(last, Choice):
            raise InvalidArgument("`alternatively` comes right after `either`, `alternatively` or `choose`")
        return self._block(lambda body: self._mend(replace(last, alternatives=(*last.alternatives, body))))

    def alap(self) -> AbstractContextManager[None]:
        """`alap { .. }`: as long as possible."""
        return self._block(lambda body: self._add(Alap(body)))

    def repeat(self, lower: Given, upper: Given | None = None) -> AbstractContextManager[None]:
        """`repeat lower..upper { .. }`; without an upper bound, exactly so often."""
        least = _bound(lower)
        most = least if upper is None else _bound(upper)
        return self._block(lambda body: self._add(Repeat(least, most, body)))

    def atomic(self) -> AbstractContextManager[None]:
        """`atomic { .. }`: all or nothing."""
        return self._block(lambda body: self._add(Atomic(body)))

    def attempt(self) -> AbstractContextManager[None]:
        """`try { .. }`; `otherwise` may follow."""
        return self._block(lambda body: self._add(Try(body)))

    def when(
        self, condition: str | Condition | Applicable, *arguments: Given
    ) -> AbstractContextManager[None]:
        """`if find condition(arguments) { .. }`, or another condition as data; `otherwise` may follow.

        `Applicable("rule", (x,))` as data asks whether a rule is applicable.
        """
        test = PatternCall(condition, _terms(arguments)) if isinstance(condition, str) else condition
        return self._block(lambda body: self._add(If(test, body)))

    def unless(self, pattern: str, *arguments: Given) -> AbstractContextManager[None]:
        """`if neg find pattern(arguments) { .. }`; `otherwise` may follow."""
        return self.when(Negation(PatternCall(pattern, _terms(arguments))))

    def otherwise(self) -> AbstractContextManager[None]:
        """`else { .. }` of the `attempt`, `when` or `unless` right before.

        Raises:
            InvalidArgument: there is none.
        """
        last = self._last
        if not isinstance(last, Try | If) or last.otherwise is not None:
            raise InvalidArgument("`otherwise` comes right after `attempt`, `when` or `unless`")
        return self._block(lambda body: self._mend(replace(last, otherwise=body)))

    @property
    def _last(self) -> Step | None:
        return self._open[-1][-1] if self._open[-1] else None

    def _add(self, step: Step) -> None:
        self._open[-1].append(step)

    def _mend(self, step: Step) -> None:
        self._open[-1][-1] = step

    @contextmanager
    def _block(self, close: Callable[[Sequence], None]) -> Iterator[None]:
        """Collect what is said inside; at the end it becomes a step, or a part of one."""
        self._open.append([])
        yield
        close(Sequence(tuple(self._open.pop())))


def _call(name: str, arguments: tuple[Given, ...]) -> Call:
    if not isinstance(name, str):
        raise InvalidArgument(f"a rule or unit is called by its name, not by {name!r}")
    return Call(name, _given(arguments))


def _bound(given: Given) -> int | Expression:
    return given if type(given) is int else _expression(given)


def _given(arguments: tuple[Given, ...]) -> tuple[Expression, ...]:
    return tuple(map(_expression, arguments))


def _terms(arguments: tuple[Given, ...]) -> tuple[Term, ...]:
    found = _given(arguments)
    return tuple(
        one if isinstance(one, Variable | Constant | EnumLiteral) else Evaluation(one) for one in found
    )


def _expression(given: Given) -> Expression:
    if isinstance(given, _EXPRESSIONS):
        return given
    if given is ...:
        return Variable("_")
    if isinstance(given, str | int | float):
        return Constant(given)
    raise InvalidArgument(f"an argument is a parameter, an expression, a plain value or `...`, not {given!r}")


# --- functions


def describes(function: Callable[..., object]) -> bool:
    """Return whether a function describes a unit."""
    return STEPS in signature(function).parameters


def described(function: Callable[..., object], name: str, weight: float, priority: int) -> Unit:
    """The unit that a function describes.

    Raises:
        InvalidArgument: a parameter without a type, or one that a unit cannot have.
    """
    parameters = unit_parameters(function, name, (STEPS,))
    steps = Steps()
    function(**{STEPS: steps}, **{one.name: Variable(one.name) for one in parameters})
    doc = function.__doc__.strip() if function.__doc__ else None
    return Unit(name, parameters, steps.body, weight=weight, priority=priority, doc=doc)


def unit_parameters(
    function: Callable[..., object], name: str, others: tuple[str, ...]
) -> tuple[Parameter, ...]:
    """The parameters of a unit, which are those of a function without some; annotations are the types.

    Raises:
        InvalidArgument: a parameter without a type, or one that a unit cannot have.
    """
    found: list[Parameter] = []
    for argument in signature(function).parameters.values():
        if argument.kind not in (Argument.POSITIONAL_OR_KEYWORD, Argument.KEYWORD_ONLY):
            raise InvalidArgument(f"unit `{name}` takes its arguments by name, not as `{argument}`")
        if argument.name in others:
            continue
        if argument.default is not Argument.empty:
            raise InvalidArgument(f"parameter `{argument.name}` of unit `{name}` cannot have a default")
        found.append(Parameter(argument.name, _type(argument, name)))
    return tuple(found)


def _type(argument: Argument, name: str) -> str:
    """The type by its name in the metamodel: `"Hedgehog"`, `int`, `str`."""
    found = named_type(argument.annotation)
    if found is None:
        raise InvalidArgument(
            f"parameter `{argument.name}` of unit `{name}` has no type: "
            f'write `{argument.name}: "Class"`, or a data type such as `int`'
        )
    return found
