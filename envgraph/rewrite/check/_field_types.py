"""A type check of definitions that are built in Python: every field must have the type of its annotation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from envgraph.errors import quote_with_article


def type_error_message(definition: Any) -> str | None:
    """Return a message about the first field of a definition that has a wrong type; None if all types are right.

    >>> from envgraph.pattern import Rule
    >>> type_error_message(Rule("burn", left="tile : RoadTile"))
    "`left` of `burn` must be a `LeftSide`, not 'tile : RoadTile'"
    """
    try:
        found = _find_mistake(definition, type(definition), "")
    except RecursionError:  # expressions that are nested too deeply are reported by a later check
        found = None
    if found is None:
        return None
    path, wanted, value = found
    name = definition.name if isinstance(definition.name, str) else type(definition).__name__
    return f"`{path}` of `{name}` must be {wanted}, not {value!r}"


_Mistake = tuple[str, str, Any]
"""Path of a field, description of the expected type, and actual value."""


@cache
def _field_types(cls: type) -> Mapping[str, Any]:
    hints = get_type_hints(cls)
    return {field.name: hints[field.name] for field in fields(cls) if field.compare}


def _find_mistake(value: Any, wanted: Any, path: str) -> _Mistake | None:
    if not _is_instance(value, wanted):
        return path, _format_type(wanted), value
    if is_dataclass(value) and not isinstance(value, type):
        for name, hint in _field_types(type(value)).items():
            found = _find_mistake(getattr(value, name), hint, f"{path}.{name}" if path else name)
            if found is not None:
                return found
    elif isinstance(value, tuple):
        for number, (part, hint) in enumerate(zip(value, _element_types(value, wanted), strict=True)):
            found = _find_mistake(part, hint, f"{path}[{number}]")
            if found is not None:
                return found
    return None


def _element_types(value: tuple[Any, ...], wanted: Any) -> list[Any]:
    """Return the expected types of the elements of a tuple whose length is already checked."""
    (found,) = [one for one in _alternatives(wanted) if get_origin(one) is tuple and _is_instance(value, one)][:1]
    arguments = get_args(found)
    return [arguments[0]] * len(value) if arguments[-1] is ... else list(arguments)


def _alternatives(wanted: Any) -> tuple[Any, ...]:
    return get_args(wanted) if get_origin(wanted) in (Union, UnionType) else (wanted,)


def _is_instance(value: Any, wanted: Any) -> bool:
    """Return True if a value is of a type. The fields of a dataclass and the elements of a tuple are not checked."""
    return any(_is_instance_of(value, one) for one in _alternatives(wanted))


def _is_instance_of(value: Any, wanted: Any) -> bool:
    origin = get_origin(wanted)
    if origin is Literal:
        return isinstance(value, str) and value in get_args(wanted)
    if origin is tuple:
        arguments = get_args(wanted)
        return isinstance(value, tuple) and (arguments[-1] is ... or len(value) == len(arguments))
    if wanted is float:
        return isinstance(value, int | float)
    return isinstance(value, wanted)


def _format_type(wanted: Any) -> str:
    found = [_format_single_type(one) for one in _alternatives(wanted)]
    return found[0] if len(found) == 1 else ", ".join(found[:-1]) + f" or {found[-1]}"


def _format_single_type(wanted: Any) -> str:
    if wanted is NoneType:
        return "None"
    if get_origin(wanted) is Literal:
        return " or ".join(map(repr, get_args(wanted)))
    if get_origin(wanted) is tuple:
        return "a tuple"
    return quote_with_article(wanted.__name__)
