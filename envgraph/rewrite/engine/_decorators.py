"""The decorators of an engine that register Python functions as rules, as units, and for expressions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from inspect import signature as inspect_signature
from typing import TYPE_CHECKING, TypeVar, cast, overload

from envgraph.pattern import Pattern
from envgraph.rewrite._matches import Shape
from envgraph.rewrite._signatures import CallParameter, Signature
from envgraph.rewrite.engine._described_units import STEPS_PARAMETER, describe_unit
from envgraph.rewrite.engine._python_functions import register_function
from envgraph.rewrite.engine._python_units import PythonUnit, python_unit_signature
from envgraph.rewrite.run._rule_runner import PythonRule

if TYPE_CHECKING:
    from envgraph.rewrite.engine._engine import Engine

Function = TypeVar("Function", bound=Callable[..., object])


def rule(
    engine: Engine, when: str | Pattern, *, name: str | None = None, weight: float = 1.0, priority: int = 0
) -> Callable[[Function], Function]:
    """Register a Python function as a rule that is applied at the matches of a pattern.

    The function takes variables of the match by name, as `Node`s or values, and the engine if it has a parameter
    `engine`. It changes the model through the nodes. If it raises an exception, its changes are undone.

    Args:
        when: name of a registered pattern, or a pattern, which is also registered.
        name: name of the rule; by default the name of the function.
        weight, priority: as in `@weight` and `@priority`.

    Raises:
        InvalidArgument: the pattern is unknown, the name is in use, or a parameter is no variable of the pattern.
        ResolutionError: the pattern has errors.
    """
    if isinstance(when, Pattern) and when not in engine.library.patterns:
        engine.add(when)
    pattern = engine.catalog.pattern(when.qualified_name if isinstance(when, Pattern) else when)

    def register(function: Function) -> Function:
        own = engine.catalog.check_free_name(function, name, weight)
        shape = Shape(own, engine.catalog.shape_of(pattern).names, engine.catalog.shape_of(pattern).types)
        runner = PythonRule(
            function,
            shape,
            pattern.qualified_name,
            engine.model,
            engine.library,
            engine.matcher,
            engine=engine,
            aside=engine.history.recording_paused,
            weight=float(weight),
            priority=priority,
        )
        parameters = tuple(
            CallParameter(variable, type_, is_required=variable in runner.inputs)
            for variable, type_ in zip(shape.names, shape.types, strict=True)
        )
        engine.catalog.directory.add_or_replace(Signature(own, "rule", "", parameters, weight, priority, parameters))
        engine.catalog.runners[own] = runner
        engine.catalog.clear_caches()
        return function

    return register


@overload
def unit(engine: Engine, function: Function, /) -> Function: ...


@overload
def unit(
    engine: Engine, /, *, name: str | None = None, weight: float = 1.0, priority: int = 0
) -> Callable[[Function], Function]: ...


def unit(
    engine: Engine,
    function: Function | None = None,
    /,
    *,
    name: str | None = None,
    weight: float = 1.0,
    priority: int = 0,
) -> Function | Callable[[Function], Function]:
    """Register a Python function as a unit. This is a decorator, with or without brackets.

    The annotations of parameters are their types: names of classes and enums, or `int`, `float`, `bool`, `str`.

    A function with a parameter `steps` *describes* a unit. It is called once, now, with a `Steps` and a variable for
    each parameter. The steps that it adds become a `Unit`, which is added like any other unit: see `definition` and
    `to_text`.

    Any other function *implements* the unit. It is called whenever the unit runs, with `Node`s and values, and with the
    engine if it has a parameter `engine`. Its applications by name are part of the run and of recordings; a recording
    refuses its direct edits. The unit fails if the function returns False. It also fails if an application is
    refused; the changes are then undone, as after any exception.

    Args:
        function: the function.
        name: name of the unit; by default the name of the function.
        weight, priority: as in `@weight` and `@priority`.

    Raises:
        InvalidArgument: the name is in use, a parameter has no type, or is of a kind that units cannot have.
        ResolutionError: the described unit has errors.
    """

    def register(given: Function) -> Function:
        own = engine.catalog.check_free_name(given, name, weight)
        if STEPS_PARAMETER in inspect_signature(given).parameters:
            engine.add(describe_unit(given, own, float(weight), priority))
            return given
        signature = python_unit_signature(given, own, engine, float(weight), priority)
        engine.catalog.directory.add_or_replace(signature)
        engine.catalog.programs[own] = PythonUnit(given, signature, engine)
        engine.catalog.clear_caches()
        return given

    return register if function is None else register(function)


@overload
def function(engine: Engine, function: Function, /) -> Function: ...


@overload
def function(
    engine: Engine,
    name: str,
    /,
    *,
    parameters: Mapping[str, str | type] | None = None,
    result: str | type | None = None,
) -> Callable[[Function], Function]: ...


@overload
def function(
    engine: Engine,
    name: str,
    function: Function,
    /,
    parameters: Mapping[str, str | type] | None = None,
    result: str | type | None = None,
) -> Function: ...


def function(
    engine: Engine,
    name: str | Function,
    function: Function | None = None,
    /,
    parameters: Mapping[str, str | type] | None = None,
    result: str | type | None = None,
) -> Function | Callable[[Function], Function]:
    """Register a Python function that expressions can call by its name. This is a decorator or an ordinary call.

    The function must be pure: its result depends only on its arguments, and it changes nothing. It is called for each
    candidate that reaches the call in a search or in an update of a view; results are not cached. If it raises an
    exception, or returns a value of another type, a `FunctionError` with the span of the call is raised.

    Args:
        name: name in expressions; by default the name of the function.
        function: takes the arguments in their order, and returns the result.
        parameters: names and types, such as `{"x": int, "way": "Way"}`: data types and enums.
        result: type of the result. By default, types are those of a registered `function` declaration with this name,
            or else those of the annotations.

    Raises:
        InvalidArgument: the function is already registered, or a type is missing.
        ResolutionError: a type is unknown, a class, or differs from the declaration, or the name is that of a function
            of the language.

    >>> from envgraph.metamodel import Attribute, Class, Metamodel, Scalar
    >>> from envgraph.graph import Model
    >>> from envgraph.rewrite import Engine
    >>> engine = Engine(Model(Metamodel("m", [Class("P", features=(Attribute("x", Scalar.INT),))])))
    >>> @engine.function
    ... def is_prime(n: int) -> bool:
    ...     return n > 1 and all(n % d for d in range(2, n))
    >>> engine.functions
    ('is_prime',)
    """

    def register(given: Function) -> Function:
        register_function(engine.library, given, own, parameters, result)
        engine.catalog.clear_caches()
        return given

    own = name if isinstance(name, str) else None
    if isinstance(name, str) and function is None:
        return register
    return register(cast("Function", name if function is None else function))
