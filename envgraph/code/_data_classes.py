"""Replace `dataclasses.dataclass` by a variant that compiles one function per class, not six, to import faster."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import MISSING, Field, FrozenInstanceError
from operator import attrgetter
from reprlib import recursive_repr
from typing import TYPE_CHECKING, Any

from envgraph.code._compile_text import execute_text
from envgraph.code._reprs import shorten_repr

if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass  # noqa: TID251
else:

    def dataclass(*, frozen: bool = False, eq: bool = True, slots: bool = False) -> Callable[[type], type]:
        """Return a decorator that makes data classes as `dataclasses.dataclass` does, but compiles fewer functions."""
        return lambda cls: _make_data_class(cls, frozen, eq, slots)


class _UnsetArgument:
    """A default argument that stands for "call the field's `default_factory`"."""

    def __repr__(self) -> str:
        return "<factory>"


def _make_data_class(cls: type, frozen: bool, eq: bool, slots: bool) -> type:
    """Return a data class made from a class. Methods that the class itself defines are not replaced."""
    # If a class defines `__eq__` alone, Python sets its `__hash__` to None: that is no method of its own.
    own = {name for name, method in cls.__dict__.items() if method is not None}
    cls = dataclasses.dataclass(init=False, repr=False, eq=False, slots=slots)(cls)  # noqa: TID251
    fields = dataclasses.fields(cls)
    made = {"__init__": _compile_init(cls, fields, frozen), "__repr__": _make_repr(fields)}
    if eq:
        made |= _make_comparisons(fields, frozen)
    if frozen:
        made |= _make_frozen_methods([field.name for field in fields])
    for name, method in made.items():
        if name not in own:
            setattr(cls, name, method)
    return shorten_repr(cls)


def _compile_init(cls: type, fields: tuple[Field[Any], ...], frozen: bool) -> Callable[..., None]:
    """Return a compiled `__init__`. Only this method is compiled: it is called often and needs real parameters."""
    names: dict[str, Any] = {"unset": _UnsetArgument(), "put": object.__setattr__}
    parameters, body = ["self"], []
    for field in fields:
        name, value = field.name, field.name
        if field.default_factory is not MISSING:
            names[f"new_{name}"] = field.default_factory
            value = f"new_{name}() if {name} is unset else {name}" if field.init else f"new_{name}()"
            parameters += [f"{name}=unset"] if field.init else []
        elif field.default is not MISSING:
            names[f"usual_{name}"] = field.default
            value = name if field.init else f"usual_{name}"
            parameters += [f"{name}=usual_{name}"] if field.init else []
        elif field.init:
            parameters.append(name)
        else:
            continue  # `__post_init__` or the user of the class will set it
        body.append(f"put(self, {name!r}, {value})" if frozen else f"self.{name} = {value}")
    if hasattr(cls, "__post_init__"):
        body.append("self.__post_init__()")
    lines = "\n    ".join(body or ["pass"])
    init: Callable[..., None]
    init = execute_text(f"def __init__({', '.join(parameters)}):\n    {lines}\n", "<data class>", names)["__init__"]
    init.__qualname__ = f"{cls.__qualname__}.__init__"
    init.__annotations__ = {field.name: field.type for field in fields if field.init} | {"return": None}
    return init


def _make_repr(fields: tuple[Field[Any], ...]) -> Callable[[Any], str]:
    names = [field.name for field in fields if field.repr]

    @recursive_repr()
    def __repr__(self: Any) -> str:
        return f"{type(self).__qualname__}({', '.join(f'{name}={getattr(self, name)!r}' for name in names)})"

    return __repr__


def _make_comparisons(fields: tuple[Field[Any], ...], frozen: bool) -> dict[str, Any]:
    """Return `__eq__` and `__hash__`, which use the class and all fields that take part in comparison.

    `__hash__` is None for classes that are not frozen.
    """
    names = [field.name for field in fields if field.compare]

    values: Callable[[Any], Any] = attrgetter(*names) if names else lambda self: ()

    def __eq__(self: Any, other: object) -> bool:
        return values(self) == values(other) if other.__class__ is self.__class__ else NotImplemented

    def __hash__(self: Any) -> int:
        return hash(values(self))

    return {"__eq__": __eq__, "__hash__": __hash__ if frozen else None}


def _make_frozen_methods(names: list[str]) -> dict[str, Any]:
    """Return methods of a frozen class: two refuse to set and delete fields, two make copying and pickling possible."""

    def __setattr__(self: Any, name: str, value: object) -> None:
        raise FrozenInstanceError(f"cannot assign to field {name!r}")

    def __delattr__(self: Any, name: str) -> None:
        raise FrozenInstanceError(f"cannot delete field {name!r}")

    def __getstate__(self: Any) -> list[object]:
        return [getattr(self, name) for name in names]

    def __setstate__(self: Any, state: list[object]) -> None:
        for name, value in zip(names, state, strict=True):
            object.__setattr__(self, name, value)

    return {one.__name__: one for one in (__setattr__, __delattr__, __getstate__, __setstate__)}
