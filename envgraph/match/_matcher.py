"""The interface of every matcher, and the checks of the arguments that users pass to a matcher."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Sequence
from enum import Enum
from typing import Final

from envgraph.errors import InvalidArgument, TypeMismatch
from envgraph.graph import Model
from envgraph.metamodel import Scalar, Value, accepts, type_name
from envgraph.pattern import Library, ObjectType, StaticType


class Free(Enum):
    """The type of `FREE`, the marker for an unbound argument."""

    FREE = "FREE"

    def __repr__(self) -> str:
        return "FREE"


FREE: Final = Free.FREE
"""The marker for an unbound argument of a pattern."""

Row = tuple[Value, ...]
"""A match: a tuple with a value for each parameter. Objects are given by their ids."""


class Matcher(ABC):
    """A matcher: finds the matches of the patterns of a library in a model.

    A pattern is given by its qualified name. `arguments` has a value or `FREE` for each of its parameters.
    Every match is returned once, as a tuple with the values of all parameters. The order of the matches depends only on
    the version of the model and on the bound values.

    Raises:
        InvalidArgument: the pattern is unknown, the number of arguments is wrong, or an `in` parameter that cannot be
            enumerated is `FREE`.
        TypeMismatch: an argument has a type that its parameter cannot have. A deleted object, or an object of another
            class, is no error: it has no matches.
        EvaluationError: more than a hundred closures and recursive patterns are nested, or a recursive pattern has
            too many results.
    """

    @abstractmethod
    def rows(self, pattern: str, arguments: tuple[object, ...]) -> Sequence[Row]:
        """Return all matches that agree with the arguments. `FREE` agrees with every value."""

    def first(self, pattern: str, arguments: tuple[object, ...]) -> Row | None:
        """Return the first match of `rows`; None if there is no match. A matcher may stop its search there."""
        return next(iter(self.rows(pattern, arguments)), None)

    def exists(self, pattern: str, arguments: tuple[object, ...]) -> bool:
        """Return True if at least one match agrees with the arguments."""
        return self.first(pattern, arguments) is not None

    def count(self, pattern: str, arguments: tuple[object, ...]) -> int:
        """Return the number of matches that agree with the arguments."""
        return len(self.rows(pattern, arguments))

    @abstractmethod
    def prepare(self, pattern: str, bound: tuple[int, ...]) -> Callable[..., list[Row]]:
        """Return a function that takes a value for each bound position and returns all matches with these values.

        The values are given in ascending order of positions; the matches have the order of `rows`. For speed, arguments
        are not checked. They must have the right type, or be ids of existing objects.
        """

    def prepare_iterator(self, pattern: str, bound: tuple[int, ...]) -> Callable[..., Iterator[Row]]:
        """Return a function that takes values for the bound positions and returns an iterator of the matches.

        Values are given in ascending order of positions, unchecked. Do not use an iterator after a change of the model.
        """
        rows = self.prepare(pattern, bound)
        return lambda *values: iter(rows(*values))

    def prepare_listing(self, pattern: str) -> Callable[[], Sequence[Row]]:
        """Return a function that returns all matches as a sequence, not to be modified or used after a model change.

        For a watched pattern the function returns the list that the view itself keeps, so no match is copied.
        """
        return self.prepare(pattern, ())

    def prepare_test(self, pattern: str) -> Callable[[Row], bool]:
        """Return a function that returns True if its argument is a match. The types of the values must be right."""
        return lambda row: self.exists(pattern, row)

    @abstractmethod
    def discard_caches(self) -> None:
        """Discard all cached plans and functions, because pattern names may now refer to other definitions."""


def check_bound(library: Library, pattern: str, bound: Collection[int]) -> None:
    """Check that a pattern can be evaluated if the parameters at the `bound` positions, and no others, have values.

    Raises:
        InvalidArgument: a position is out of range, or an `in` parameter that cannot be enumerated is not bound.
    """
    size = len(library.parameter_types(pattern))
    if not all(0 <= position < size for position in bound):
        raise InvalidArgument(
            f"`bound` contains position {max(bound)}, but pattern `{pattern}` has {size} parameters: "
            "positions count from 0"
        )
    missing = [position for position in library.inputs(pattern) if position not in bound]
    if missing:
        parameters = library.get(pattern).parameters
        names = ", ".join(f"`{parameters[position].name}`" for position in missing)
        raise InvalidArgument(f"pattern `{pattern}` needs a value for {names}: bind the parameter in the call")


def check_arguments(
    model: Model, library: Library, pattern: str, types: tuple[StaticType, ...], arguments: tuple[object, ...]
) -> tuple[object, ...] | None:
    """Return the arguments as the model stores them: an int for a float parameter becomes a float, and `FREE` stays.

    Return None if an argument is the id of an object that does not exist. `types` has the types of the parameters.

    Raises:
        InvalidArgument: the number of arguments is not the number of parameters.
        TypeMismatch: an argument has the wrong type.
    """
    if len(arguments) != len(types):
        raise InvalidArgument(f"pattern `{pattern}` takes {len(types)} arguments, but {len(arguments)} were given")
    checked: list[object] = []
    for position, (type_, argument) in enumerate(zip(types, arguments, strict=True)):
        if argument is FREE:
            checked.append(argument)
        elif isinstance(type_, ObjectType):
            if type(argument) is not int:
                raise TypeMismatch(_mismatch(library, pattern, position, f"the id of a `{type_.cls}`", argument))
            if not model.graph.alive(argument):
                return None
            checked.append(argument)
        elif accepts(type_, argument):
            checked.append(float(argument) if type_ is Scalar.FLOAT else argument)  # type: ignore[arg-type]
        else:
            raise TypeMismatch(_mismatch(library, pattern, position, f"`{type_name(type_)}`", argument))
    return tuple(checked)


def _mismatch(library: Library, pattern: str, position: int, wanted: str, argument: object) -> str:
    """Return the message for an argument of a wrong type at a position. `wanted` describes the expected type."""
    name = library.get(pattern).parameters[position].name
    return f"parameter `{name}` of `{pattern}` takes {wanted}, not {argument!r}"
