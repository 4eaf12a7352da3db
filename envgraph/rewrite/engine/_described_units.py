"""Units described by a Python function, which is called once and whose steps become the data of the unit."""

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
    AtomicStep,
    Binary,
    Conditional,
    Constant,
    Constraint,
    EnumLiteral,
    Evaluation,
    Expression,
    FunctionCall,
    IfStep,
    Navigation,
    Negation,
    Parameter,
    PatternCall,
    Repeat,
    Step,
    StepSequence,
    Term,
    TryStep,
    Unary,
    Unit,
    UnitCall,
    UnitChoice,
    Variable,
)
from envgraph.rewrite.engine._python_functions import annotation_type_name

STEPS_PARAMETER: Final = "steps"
"""The name of the parameter that marks a function as the description of a unit."""

_EXPRESSIONS: Final = (
    *(Variable, Constant, EnumLiteral, Navigation, FunctionCall),
    *(Unary, Binary, Conditional),
)

Condition = Constraint

CallArgument = Expression | Value | EllipsisType
"""An argument of a call: a parameter of the unit, an expression, a Python value, or `...` for any value."""


class Steps:
    """A recorder of the steps of a unit, passed to the function that describes it; each method adds a step.

    Arguments of calls are parameters of the unit, expressions, Python values, or `...`, which means `_` (any value).

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
    def body(self) -> StepSequence:
        """Return the steps that were added so far, outside of blocks.

        Raises:
            InvalidArgument: a block is still open.
        """
        if len(self._open) > 1:
            raise InvalidArgument("a block of the unit is still open: open each block as in `with steps.alap(): ..`")
        return StepSequence(tuple(self._open[0]))

    def call(self, name: str, *arguments: CallArgument, first: bool = False, where: Iterable[Condition] = ()) -> None:
        """Add the step `name(arguments);`, a call of a rule, group or unit.

        If `first`, a rule is applied at its first match, not at a random one. Its match must satisfy all `where`
        conditions.
        """
        self._add(replace(_call(name, arguments), first=first, where=tuple(where)))

    def every(
        self,
        name: str,
        *arguments: CallArgument,
        by: CallArgument | None = None,
        top: int | None = None,
        where: Iterable[Condition] = (),
    ) -> None:
        """Add the step `all name(arguments);`: apply a rule at each match that it has when the step begins.

        `by` orders the matches, and `top` limits their number.
        """
        order = None if by is None else _argument_expression(by)
        self._add(replace(_call(name, arguments), every=True, by=order, limit=top, where=tuple(where)))

    def choose(self, *alternatives: str | UnitCall) -> None:
        """Add the step `a | b;`, a choice between one or more names, or `UnitCall`s if they have arguments."""
        if not alternatives:
            raise InvalidArgument("`choose` takes at least one rule or unit")
        self._add(UnitChoice(tuple(one if isinstance(one, UnitCall) else _call(one, ()) for one in alternatives)))

    def either(self) -> AbstractContextManager[None]:
        """Open the block `{ .. }` of the first alternative of a choice. `alternatively` opens the next ones."""
        return self._block(lambda body: self._add(UnitChoice((body,))))

    def alternatively(self) -> AbstractContextManager[None]:
        """Open the block `| { .. }` of another alternative, directly after `either`, `alternatively` or `choose`.

        Raises:
            InvalidArgument: the last step is no choice.
        """
        last = self._last_step
        if not isinstance(last, UnitChoice):
            raise InvalidArgument("`alternatively` must directly follow `either`, `alternatively` or `choose`")
        return self._block(lambda body: self._replace_last(replace(last, alternatives=(*last.alternatives, body))))

    def alap(self) -> AbstractContextManager[None]:
        """Open the block `alap { .. }`, which is repeated as long as possible."""
        return self._block(lambda body: self._add(Alap(body)))

    def repeat(self, lower: CallArgument, upper: CallArgument | None = None) -> AbstractContextManager[None]:
        """Open the block `repeat lower..upper { .. }`. Without an upper bound, it is repeated exactly `lower` times."""
        least = _bound_expression(lower)
        most = least if upper is None else _bound_expression(upper)
        return self._block(lambda body: self._add(Repeat(least, most, body)))

    def atomic(self) -> AbstractContextManager[None]:
        """Open the block `atomic { .. }`, whose changes are undone if it fails."""
        return self._block(lambda body: self._add(AtomicStep(body)))

    def attempt(self) -> AbstractContextManager[None]:
        """Open the block `try { .. }`; `otherwise` may follow."""
        return self._block(lambda body: self._add(TryStep(body)))

    def when(self, condition: str | Condition | Applicable, *arguments: CallArgument) -> AbstractContextManager[None]:
        """Open the block `if find condition(arguments) { .. }`, or with a condition as data; `otherwise` may follow.

        The condition `Applicable("rule", (x,))` tests if a rule is applicable.
        """
        test = PatternCall(condition, _argument_terms(arguments)) if isinstance(condition, str) else condition
        return self._block(lambda body: self._add(IfStep(test, body)))

    def unless(self, pattern: str, *arguments: CallArgument) -> AbstractContextManager[None]:
        """Open the block `if neg find pattern(arguments) { .. }`; `otherwise` may follow."""
        return self.when(Negation(PatternCall(pattern, _argument_terms(arguments))))

    def otherwise(self) -> AbstractContextManager[None]:
        """Open the block `else { .. }`, directly after `attempt`, `when` or `unless`.

        Raises:
            InvalidArgument: the last step is none of these, or has an `else` already.
        """
        last = self._last_step
        if not isinstance(last, TryStep | IfStep) or last.otherwise is not None:
            raise InvalidArgument("`otherwise` must directly follow `attempt`, `when` or `unless`")
        return self._block(lambda body: self._replace_last(replace(last, otherwise=body)))

    @property
    def _last_step(self) -> Step | None:
        return self._open[-1][-1] if self._open[-1] else None

    def _add(self, step: Step) -> None:
        self._open[-1].append(step)

    def _replace_last(self, step: Step) -> None:
        self._open[-1][-1] = step

    @contextmanager
    def _block(self, close: Callable[[StepSequence], None]) -> Iterator[None]:
        """Collect the steps that are added inside the `with` block and pass them to `close` at its end."""
        self._open.append([])
        yield
        close(StepSequence(tuple(self._open.pop())))


def _call(name: str, arguments: tuple[CallArgument, ...]) -> UnitCall:
    if not isinstance(name, str):
        raise InvalidArgument(f"expected the name of a rule or unit, not {name!r}")
    return UnitCall(name, _argument_expressions(arguments))


def _bound_expression(given: CallArgument) -> int | Expression:
    return given if type(given) is int else _argument_expression(given)


def _argument_expressions(arguments: tuple[CallArgument, ...]) -> tuple[Expression, ...]:
    return tuple(map(_argument_expression, arguments))


def _argument_terms(arguments: tuple[CallArgument, ...]) -> tuple[Term, ...]:
    found = _argument_expressions(arguments)
    return tuple(one if isinstance(one, Variable | Constant | EnumLiteral) else Evaluation(one) for one in found)


def _argument_expression(given: CallArgument) -> Expression:
    if isinstance(given, _EXPRESSIONS):
        return given
    if given is ...:
        return Variable("_")
    if isinstance(given, str | int | float):
        return Constant(given)
    raise InvalidArgument(f"an argument must be a parameter, an expression, a number, a string or `...`, not {given!r}")


# --- functions


def describe_unit(function: Callable[..., object], name: str, weight: float, priority: int) -> Unit:
    """Call the function and return the unit that it describes.

    Raises:
        InvalidArgument: a parameter has no type, or is of a kind that units cannot have.
    """
    parameters = unit_parameters(function, name, (STEPS_PARAMETER,))
    steps = Steps()
    function(**{STEPS_PARAMETER: steps}, **{one.name: Variable(one.name) for one in parameters})
    doc = function.__doc__.strip() if function.__doc__ else None
    return Unit(name, parameters, steps.body, weight=weight, priority=priority, doc=doc)


def unit_parameters(function: Callable[..., object], name: str, others: tuple[str, ...]) -> tuple[Parameter, ...]:
    """Return the parameters of a function, except `others`, as parameters of the unit `name`, with their types.

    Raises:
        InvalidArgument: a parameter has no type, or is of a kind that units cannot have.
    """
    found: list[Parameter] = []
    for argument in signature(function).parameters.values():
        if argument.kind not in (Argument.POSITIONAL_OR_KEYWORD, Argument.KEYWORD_ONLY):
            raise InvalidArgument(
                f"parameter `{argument}` of unit `{name}` cannot be passed by name: use an ordinary parameter"
            )
        if argument.name in others:
            continue
        if argument.default is not Argument.empty:
            raise InvalidArgument(f"parameter `{argument.name}` of unit `{name}` cannot have a default")
        found.append(Parameter(argument.name, _argument_type(argument, name)))
    return tuple(found)


def _argument_type(argument: Argument, name: str) -> str:
    """Return the type name in an annotation such as `"Hedgehog"` or `int`; raise `InvalidArgument` without a type."""
    found = annotation_type_name(argument.annotation)
    if found is None:
        raise InvalidArgument(
            f"parameter `{argument.name}` of unit `{name}` has no type: "
            f'write `{argument.name}: "Class"`, or a data type such as `int`'
        )
    return found
