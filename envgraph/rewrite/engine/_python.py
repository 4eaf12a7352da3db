"""Python functions as rules, as units, and as what expressions call: the decorators of an engine."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, TypeVar, cast, overload

from envgraph.pattern import Pattern
from envgraph.rewrite._match import Shape
from envgraph.rewrite._names import Signature, Taken
from envgraph.rewrite.engine._described import described, describes
from envgraph.rewrite.engine._functions import PythonUnit, unit_signature_of
from envgraph.rewrite.engine._registered import register_function
from envgraph.rewrite.run._runner import PythonRule

if TYPE_CHECKING:
    from envgraph.rewrite.engine._engine import Engine

Function = TypeVar("Function", bound=Callable[..., object])


def rule(
    engine: Engine, when: str | Pattern, *, name: str | None = None, weight: float = 1.0, priority: int = 0
) -> Callable[[Function], Function]:
    """Register a Python function as a rule that applies at the matches of a pattern.

    The function takes variables of the match by name, as `Node`s or values, and the engine if it has a parameter
    `engine`; it edits the model through the nodes. If it raises, what it did is undone.

    Args:
        when: name of a registered pattern, or a pattern, which is registered too.
        name: name of the rule; else that of the function.
        weight, priority: as `@weight` and `@priority`.

    Raises:
        InvalidArgument: an unknown pattern, a name that is taken, a parameter that is no variable of the pattern.
        ResolutionError: the pattern has errors.
    """
    if isinstance(when, Pattern) and when not in engine.library.patterns:
        engine.add(when)
    pattern = engine.catalog.pattern(when.qualified_name if isinstance(when, Pattern) else when)

    def register(function: Function) -> Function:
        own = engine.catalog.free_name(function, name, weight)
        shape = Shape(own, engine.catalog.shape_of(pattern).names, engine.catalog.shape_of(pattern).types)
        runner = PythonRule(
            function,
            shape,
            pattern.qualified_name,
            engine.model,
            engine.library,
            engine.matcher,
            engine=engine,
            aside=engine.history.unrecorded,
            weight=float(weight),
            priority=priority,
        )
        parameters = tuple(
            Taken(variable, type_, required=variable in runner.inputs)
            for variable, type_ in zip(shape.names, shape.types, strict=True)
        )
        engine.catalog.directory.add(Signature(own, "rule", "", parameters, weight, priority, parameters))
        engine.catalog.runners[own] = runner
        engine.catalog.forget()
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
    """Register a Python function as a unit: a decorator, with or without brackets.

    The annotations of its parameters are their types: names of classes and enums, or `int`, `float`, `bool`, `str`.

    A function with a parameter `steps` *describes* a unit. It is called now, once, with `Steps` and a variable for
    each parameter; what it says becomes a `Unit`, which is added like any other: see `definition` and `to_text`.

    Any other function *is* the unit. It is called whenever the unit runs, with `Node`s and values, and with the
    engine if it has a parameter `engine`. What it applies by name is part of the run and of recordings; a recording
    refuses what it edits by itself. It fails by returning False. It also fails by an application that is
    refused; then what it did is undone, as after any exception.

    Args:
        function: the function.
        name: name of the unit; else that of the function.
        weight, priority: as `@weight` and `@priority`.

    Raises:
        InvalidArgument: a name that is taken, a parameter without a type, or one that a unit cannot have.
        ResolutionError: what a function describes has errors.
    """

    def register(given: Function) -> Function:
        own = engine.catalog.free_name(given, name, weight)
        if describes(given):
            engine.add(described(given, own, float(weight), priority))
            return given
        signature = unit_signature_of(given, own, engine, float(weight), priority)
        engine.catalog.directory.add(signature)
        engine.catalog.programs[own] = PythonUnit(given, signature, engine)
        engine.catalog.forget()
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
    """Register a Python function that expressions can call by its name: a decorator, or a call.

    It has to be pure: what it returns depends on its arguments alone, and it changes nothing. It is called once for
    each candidate that comes as far as the call, whenever that is searched for or a view is brought up to date;
    nothing is remembered. If it raises, or returns something that is no value of its type, that is a
    `FunctionError` at the place of the call.

    Args:
        name: what expressions call it; else the name of the function.
        function: takes the arguments in their order, and returns the result.
        parameters: names and types, `{"x": int, "way": "Way"}`: data types and enums.
        result: type of the result. Where types are left out, they are those of a `function` declaration of that
            name that the engine has, else the annotations.

    Raises:
        InvalidArgument: a function that has its code already; types that are missing.
        ResolutionError: an unknown type, a class, other types than those of the declaration, or the name of a
            function of the language.

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
        engine.catalog.forget()
        return given

    own = name if isinstance(name, str) else None
    if isinstance(name, str) and function is None:
        return register
    return register(cast("Function", name if function is None else function))
