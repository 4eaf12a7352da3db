"""Python functions that expressions call: their declarations, and the registration of their code."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from inspect import Parameter as Argument, Signature, signature
from typing import Final

from envgraph.errors import InvalidArgument, ResolutionError
from envgraph.pattern import FunctionDeclaration, Library, Parameter

_TYPE_NAMES: Final = {int: "int", float: "float", bool: "bool", str: "string"}
_ANNOTATION_NAMES: Final = {"str": "string"}
_POSITIONAL: Final = (Argument.POSITIONAL_ONLY, Argument.POSITIONAL_OR_KEYWORD)


def register_function(
    library: Library,
    function: Callable[..., object],
    given: str | None,
    parameters: Mapping[str, str | type] | None,
    result: str | type | None,
) -> None:
    """Declare a function, unless a file has declared it, and register its code.

    Raises:
        InvalidArgument: the function has code already, has no name or type, or takes another number of arguments.
        ResolutionError: a type is unknown, a class, or differs from the declaration, or the name is that of a function
            of the language.
    """
    if not callable(function):
        raise InvalidArgument(f"expected a function to register, not {function!r}")
    name = given or str(getattr(function, "__name__", ""))
    if not name.isidentifier():
        raise InvalidArgument(f'a function needs a name: `engine.function("name", ..)`, not {name!r}')
    known = library.functions.get(name)
    if known is not None and known.code is not None:
        message = f"function `{name}` is already registered, and its earlier results are kept"
        raise InvalidArgument(f"{message}: choose another name, or use another engine")
    if known is None or parameters is not None or result is not None:
        declaration = _declare(function, name, parameters, result)
        problems = copy(library).declare(declaration)
        if problems:
            raise ResolutionError(problems)
        library.declare(declaration)
        known = library.functions[name]
    _check_parameter_count(function, name, len(known.parameters))
    known.code = function


def _declare(
    function: Callable[..., object],
    name: str,
    parameters: Mapping[str, str | type] | None,
    result: str | type | None,
) -> FunctionDeclaration:
    if parameters is None:
        parameters = {}
        for one in _signature(function, name).parameters.values():
            if one.kind not in _POSITIONAL or one.default is not Argument.empty:
                message = f"a parameter of function `{name}` must be positional and have no default"
                raise InvalidArgument(f"{message}: `{one}` is not allowed")
            parameters[one.name] = one.annotation
    written: object = parameters
    if not isinstance(written, Mapping):
        message = f'the parameters of `{name}` must be a mapping from names to types, such as `{{"x": int}}`'
        raise InvalidArgument(f"{message}, not {written!r}")
    given = _signature(function, name).return_annotation if result is None else result
    return FunctionDeclaration(
        name,
        tuple(Parameter(one, _type_name(type_, f"parameter `{one}`", name)) for one, type_ in parameters.items()),
        _type_name(given, "the result", name),
    )


def _signature(function: Callable[..., object], name: str) -> Signature:
    try:
        return signature(function)
    except ValueError:  # some functions written in C have no signature
        message = f"`{name}` has no signature: "
        raise InvalidArgument(message + "pass `parameters` and `result`") from None


def _type_name(given: object, what: str, name: str) -> str:
    """Return the name of a type; `what` is the parameter or result, for messages.

    Raises:
        InvalidArgument: `given` names no type.
    """
    found = annotation_type_name(given)
    if found is None:
        message = f"{what} of function `{name}` has no type"
        raise InvalidArgument(f'{message}: write `int`, `float`, `bool`, `str` or the name of an enum, such as `"Way"`')
    return found


def annotation_type_name(given: object) -> str | None:
    """Return the name of the type that an annotation such as `int` or `"Way"` means; None if it names no type."""
    if isinstance(given, type):
        return _TYPE_NAMES.get(given)
    if not isinstance(given, str):
        return None
    unquoted = given.strip("'\"")  # quotes occur in modules with postponed annotations
    return _ANNOTATION_NAMES.get(unquoted, unquoted)


def _check_parameter_count(function: Callable[..., object], name: str, count: int) -> None:
    """Check that a function can be called with this number of arguments.

    Raises:
        InvalidArgument: the function takes another number.
    """
    try:
        taken = signature(function)
    except ValueError:
        return
    try:
        taken.bind(*range(count))
    except TypeError:
        raise InvalidArgument(
            f"function `{name}` must take {count} arguments, but its signature is `{taken}`"
        ) from None
