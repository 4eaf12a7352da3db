"""Trees become functions, which know where their lines come from."""

from __future__ import annotations

import pytest

from envgraph.code import (
    Assign,
    Call,
    Constant,
    Do,
    For,
    Function,
    If,
    Local,
    Name,
    Operation,
    Return,
    define,
    origin_of,
)

X = Local("x")


def quotient(origin: object) -> Return:
    return Return(Operation("/", (Constant(1), X)), origin=origin)


def test_a_function_uses_what_it_is_given() -> None:
    names = define((Function("f", (X,), (Return(Call(Name("g"), (X,))),)),), "given", {"g": abs})
    assert names["f"](-3) == 3


def test_an_error_is_traced_to_where_its_line_comes_from() -> None:
    whole = Function(
        "f", (X,), (Assign(Local("y"), X, origin="first"), If(X, (Return(X),)), quotient("last"))
    )
    f = define((whole,), "traced", {})["f"]
    assert f(2) == 2
    with pytest.raises(ZeroDivisionError) as error:
        f(0)
    origin, frame = origin_of(error.value)
    assert origin == "last"
    assert frame is not None and frame.f_locals == {"x": 0, "y": 0}


def test_what_stands_inside_comes_from_the_same_place() -> None:
    broken = Do(Operation("/", (Constant(1), Constant(0))))
    loop = For(X, Name("E"), (Assign(Local("y"), X), broken), origin="loop")
    f = define((Function("f", (), (loop,)),), "inside", {"E": [1]})["f"]
    with pytest.raises(ZeroDivisionError) as error:
        f()
    assert origin_of(error.value)[0] == "loop"


def test_other_errors_come_from_nowhere() -> None:
    with pytest.raises(ZeroDivisionError) as error:
        1 / 0  # noqa: B018
    assert origin_of(error.value) == (None, None)
