"""Trees become functions, which know where their lines come from."""

from __future__ import annotations

import pytest

from envgraph import code

X = code.Local("x")


def quotient(origin: object) -> code.Return:
    return code.Return(code.Operation("/", (code.Constant(1), X)), origin=origin)


def test_a_compiled_function_uses_the_given_globals() -> None:
    names = code.define_functions(
        (code.Function("f", (X,), (code.Return(code.Call(code.Name("g"), (X,))),)),), "given", {"g": abs}
    )
    assert names["f"](-3) == 3


def test_an_error_is_traced_to_the_origin_of_its_statement() -> None:
    whole = code.Function(
        "f",
        (X,),
        (code.Assign(code.Local("y"), X, origin="first"), code.If(X, (code.Return(X),)), quotient("last")),
    )
    f = code.define_functions((whole,), "traced", {})["f"]
    assert f(2) == 2
    with pytest.raises(ZeroDivisionError) as error:
        f(0)
    origin, frame = code.origin_of(error.value)
    assert origin == "last"
    assert frame is not None and frame.f_locals == {"x": 0, "y": 0}


def test_statements_without_an_origin_have_the_origin_of_their_loop() -> None:
    broken = code.ExpressionStatement(code.Operation("/", (code.Constant(1), code.Constant(0))))
    loop = code.For(X, code.Name("E"), (code.Assign(code.Local("y"), X), broken), origin="loop")
    f = code.define_functions((code.Function("f", (), (loop,)),), "inside", {"E": [1]})["f"]
    with pytest.raises(ZeroDivisionError) as error:
        f()
    assert code.origin_of(error.value)[0] == "loop"


def test_errors_outside_compiled_code_have_no_origin() -> None:
    with pytest.raises(ZeroDivisionError) as error:
        1 / 0  # noqa: B018
    assert code.origin_of(error.value) == (None, None)
