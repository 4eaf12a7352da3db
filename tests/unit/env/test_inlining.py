"""Functions of a program that are called from one place stand there, and do the same."""

from itertools import count, product

from envgraph import code
from envgraph.code import (
    Assign,
    Call,
    Constant,
    For,
    Function,
    If,
    Local,
    Name,
    Operation,
    Return,
    define_functions,
)
from envgraph.env.compiled.matching._inlining import inline_functions

N, M, ROUND = Local("n"), Local("m"), Local("i")


def sums() -> tuple[Function, ...]:
    """`above` and `doubled` are called from one place, `plus` from two; all of them have a variable `n`."""
    plus = Function("plus", (N, M), (Return(Operation("+", (N, M))),))
    loop = For(ROUND, code.emit_call("range", M), (Assign(N, Constant(2), "+="),))
    doubled = Function("doubled", (M,), (Assign(N, Constant(0)), loop, Return(N)))
    early = If(Operation(">", (M, Constant(3))), (Return(Constant(-1)),))
    above = Function("above", (M,), (early, Assign(N, Call(Name("plus"), (M, M))), Return(N)))
    twice = Assign(M, Call(Name("doubled"), (Operation("+", (N, Constant(1))),)))
    entry = Function("entry", (N,), (twice, Assign(N, Call(Name("plus"), (N, M))), Return(Call(Name("above"), (N,)))))
    return plus, doubled, above, entry


def test_functions_that_are_called_once_are_inlined_with_fresh_variables() -> None:
    numbers = count()
    short = inline_functions(sums(), ["entry"], lambda prefix: Local(f"{prefix}_{next(numbers)}"))
    assert [function.name for function in short] == ["plus", "entry"]
    wanted, found = (define_functions(functions, "<sums>", {})["entry"] for functions in (sums(), short))
    assert [found(number) for number in range(-2, 5)] == [wanted(number) for number in range(-2, 5)]
    assert {wanted(number) for number in range(-2, 5)} >= {-1}


def test_function_with_early_return_is_not_inlined_where_its_value_is_used() -> None:
    early = If(Operation(">", (M, Constant(3))), (Return(Constant(-1)),))
    some = Function("some", (M,), (early, Return(M)))
    entry = Function("entry", (M, N), (Assign(N, Call(Name("some"), (M,)), "="), Return(N)))
    kept = inline_functions((some, entry), ["entry"], Local)
    assert [function.name for function in kept] == ["some", "entry"]
    run = define_functions(kept, "<kept>", {})["entry"]
    assert [run(one, two) for one, two in product((1, 5), (0, 7))] == [1, 1, -1, -1]
