"""Data classes of ours are as those of the standard library."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import pickle
from collections.abc import Callable
from dataclasses import FrozenInstanceError, field, fields, replace
from typing import Any

import pytest

from envgraph.code import dataclass


@dataclass(frozen=True, slots=True)
class Point:
    """Frozen."""

    x: int
    y: int = 0
    tags: list[str] = field(default_factory=list, compare=False)
    place: str | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Named(Point):
    """Inherits fields."""

    name: str = "?"

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", self.name.upper())


@dataclass(slots=True)
class Open:
    """Can be changed."""

    one: int
    rest: list[int] = field(default_factory=list)
    sum: int = field(init=False)
    kept: int | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        self.sum = self.one + sum(self.rest)


@dataclass(frozen=True, slots=True, eq=False)
class Alone:
    """Equal to itself alone."""

    x: object


@dataclass(frozen=True, slots=True)
class Odd:  # noqa: PLW1641
    """Has methods of its own."""

    x: int

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Odd)

    def __repr__(self) -> str:
        return "odd"


@dataclass(frozen=True, slots=True)
class Empty:
    """Has no fields."""


def test_records_are_compared_printed_and_hashed_by_their_fields() -> None:
    one, same, other = Point(1, tags=["a"], place="here"), Point(1), Point(2)
    assert one == same != other and hash(one) == hash(same)
    assert repr(one) == "Point(x=1, y=0, tags=['a'])"
    assert one != (1, 0) and Empty() == Empty() and hash(Empty()) == hash(Empty())
    assert Named(1) != Point(1) and Named(1, name="b") == Named(1, name="B")
    assert repr(Odd(1)) == "odd" and Odd(1) == Odd(2) and Odd(3) in {Odd(3): 0}


def test_records_with_the_same_nan_are_equal() -> None:
    nan = float("nan")
    assert Odd(1) == Odd(1) and Point(nan) == Point(nan)  # type: ignore[arg-type]


def test_frozen_records_refuse_assignment() -> None:
    one = Point(1)
    with pytest.raises(FrozenInstanceError, match="cannot assign to field 'x'"):
        one.x = 2  # type: ignore[misc]
    with pytest.raises(FrozenInstanceError):
        one.strange = 2  # type: ignore[attr-defined]
    with pytest.raises(FrozenInstanceError, match="cannot delete field 'x'"):
        del one.x
    made = Open(1, [2])
    made.one = 5
    assert (made.one, made.sum, made.kept) == (5, 3, None)
    with pytest.raises(AttributeError):
        made.strange = 2  # type: ignore[attr-defined]
    with pytest.raises(TypeError, match="unhashable"):
        hash(made)


def test_default_factories_are_called_for_each_record() -> None:
    assert Open(1).rest is not Open(1).rest
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'x'"):
        Point()  # type: ignore[call-arg]
    assert Alone(1) != Alone(1)


@pytest.mark.parametrize("one", [Point(1, 2, ["t"]), Named(1), Open(3, [1]), Empty()])
def test_copies_pickles_and_replacements_are_equal(one: Any) -> None:
    assert copy.copy(one) == copy.deepcopy(one) == pickle.loads(pickle.dumps(one)) == replace(one) == one


def test_the_repr_of_a_record_that_contains_itself_is_finite() -> None:
    inside: list[object] = []
    inside.append(Alone(inside))
    assert repr(inside[0]) == "Alone(x=[...])"


@pytest.mark.parametrize("made", [Point, Named, Open])
def test_records_have_the_fields_and_signature_of_standard_dataclasses(made: Any) -> None:
    names = [one.name for one in fields(made)]
    body = {name: made.__dict__[name] for name in ("__post_init__",) if name in made.__dict__}
    twin: Callable[..., Any] = dataclasses.make_dataclass(
        made.__name__,
        [(one.name, one.type, _field(one)) for one in fields(made)],
        namespace=body,
        slots=True,
        frozen=made is not Open,
    )
    assert [one.name for one in fields(twin)] == names and made.__match_args__ == twin.__match_args__  # type: ignore[arg-type, attr-defined]
    assert str(inspect.signature(made)) == str(inspect.signature(twin))
    assert repr(made(1)).partition("(")[2] == repr(twin(1)).partition("(")[2]


def _field(one: dataclasses.Field[Any]) -> Any:
    return field(
        default=one.default,
        default_factory=one.default_factory,
        init=one.init,
        repr=one.repr,
        compare=one.compare,
    )  # type: ignore[call-overload]
