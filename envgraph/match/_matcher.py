"""The interface of every matcher, and the check of the arguments that people hand to one."""

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
    """The type of `FREE`."""

    FREE = "FREE"

    def __repr__(self) -> str:
        return "FREE"


FREE: Final = Free.FREE
"""Stands at a position of a pattern that a call leaves open."""

Row = tuple[Value, ...]
"""One match: a value for each parameter, objects as ids."""


class Matcher(ABC):
    """Finds the matches of the patterns of a library in a model.

    A pattern is given by its qualified name, and `arguments` has a value or `FREE` for each of its parameters.
    Every match is reported once, as a full tuple of parameters. The order of the rows is a function of the model's
    version and the bound values alone.

    Raises:
        InvalidArgument: an unknown pattern, a wrong number of arguments, or a parameter (`in`) that cannot be
            enumerated is free.
        TypeMismatch: an argument that no model could hold at that place. An object that is dead or of another
            class is no error: it has no matches.
        EvaluationError: more than a hundred closures and recursive patterns stand inside each other, or a recursive
            pattern has results without end.
    """

    @abstractmethod
    def rows(self, pattern: str, arguments: tuple[object, ...]) -> Sequence[Row]:
        """All matches that agree with the arguments."""

    def first(self, pattern: str, arguments: tuple[object, ...]) -> Row | None:
        """The first of `rows`, or None; may stop early."""
        return next(iter(self.rows(pattern, arguments)), None)

    def exists(self, pattern: str, arguments: tuple[object, ...]) -> bool:
        """Return whether there is a match that agrees with the arguments."""
        return self.first(pattern, arguments) is not None

    def count(self, pattern: str, arguments: tuple[object, ...]) -> int:
        """The number of `rows`."""
        return len(self.rows(pattern, arguments))

    @abstractmethod
    def prepare(self, pattern: str, bound: tuple[int, ...]) -> Callable[..., list[Row]]:
        """`rows` for one set of bound positions (ascending), called with the values at those positions.

        For loops that call it often: arguments are not checked, so they must be values of the right type and
        ids of objects that are alive.
        """

    def seeker(self, pattern: str, bound: tuple[int, ...]) -> Callable[..., Iterator[Row]]:
        """The rows of `prepare` one by one, each looked for when it is asked for; not after the model has changed."""
        rows = self.prepare(pattern, bound)
        return lambda *values: iter(rows(*values))

    def lister(self, pattern: str) -> Callable[[], Sequence[Row]]:
        """All rows, to look at before the model changes, and not to be kept: of a watched pattern its own list.

        So a choice among the matches of a watched pattern takes constant time.
        """
        return self.prepare(pattern, ())

    def tester(self, pattern: str) -> Callable[[Row], bool]:
        """Return whether a row is a match; unchecked, its values must have the right type. Objects may be gone."""
        return lambda row: self.exists(pattern, row)

    @abstractmethod
    def forget(self) -> None:
        """Names of patterns may mean something else from now on."""


def check_bound(library: Library, pattern: str, bound: Collection[int]) -> None:
    """Check that a pattern can be asked with values at these positions alone.

    Raises:
        InvalidArgument: a position that there is not, or an `in` parameter without a value that nothing enumerates.
    """
    size = len(library.parameter_types(pattern))
    if not all(0 <= position < size for position in bound):
        raise InvalidArgument(f"pattern `{pattern}` has {size} parameters; there is no position {max(bound)}")
    missing = [position for position in library.inputs(pattern) if position not in bound]
    if missing:
        parameters = library.get(pattern).parameters
        names = ", ".join(f"`{parameters[position].name}`" for position in missing)
        raise InvalidArgument(f"pattern `{pattern}` can only be asked with a value for {names}")


def check_arguments(
    model: Model, library: Library, pattern: str, types: tuple[StaticType, ...], arguments: tuple[object, ...]
) -> tuple[object, ...] | None:
    """The arguments as the model would store them; None if one is an object that is gone.

    Raises:
        InvalidArgument: their number is not that of the parameters.
        TypeMismatch: one has the wrong type.
    """
    if len(arguments) != len(types):
        raise InvalidArgument(f"pattern `{pattern}` has {len(types)} parameters, not {len(arguments)}")
    checked: list[object] = []
    for position, (type_, argument) in enumerate(zip(types, arguments, strict=True)):
        if argument is FREE:
            checked.append(argument)
        elif isinstance(type_, ObjectType):
            if type(argument) is not int:
                raise TypeMismatch(
                    _mismatch(library, pattern, position, f"the id of a `{type_.cls}`", argument)
                )
            if not model.graph.alive(argument):
                return None
            checked.append(argument)
        elif accepts(type_, argument):
            checked.append(float(argument) if type_ is Scalar.FLOAT else argument)  # type: ignore[arg-type]
        else:
            raise TypeMismatch(_mismatch(library, pattern, position, f"`{type_name(type_)}`", argument))
    return tuple(checked)


def _mismatch(library: Library, pattern: str, position: int, wanted: str, argument: object) -> str:
    name = library.get(pattern).parameters[position].name
    return f"parameter `{name}` of `{pattern}` takes {wanted}, not {argument!r}"
