"""Trees become Python text."""

from __future__ import annotations

import ast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from envgraph.code import (
    Assign,
    Body,
    Call,
    Choice,
    Constant,
    Do,
    Each,
    Expression,
    For,
    Function,
    Handler,
    If,
    Index,
    Lambda,
    Leave,
    Let,
    Local,
    Mapping,
    Member,
    Name,
    Operation,
    Raise,
    Return,
    Try,
    Tuple,
    While,
    Yield,
    expression_text,
    printed,
)

A, B, C = Local("a"), Local("b"), Local("c")


def operation(operator: str, *operands: Expression) -> Operation:
    return Operation(operator, operands)


def text(*body: object) -> str:
    return printed(body).text  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("node", "expected"),
    [
        (Call(Name("f"), (A, Constant(1))), "f(a, 1)"),
        (Index(Call(Name("f")), Tuple((A,))), "f()[(a,)]"),
        (Tuple(()), "()"),
        (Tuple((A, B)), "(a, b)"),
        (Member(Let(A, B), "x"), "(a := b).x"),
        (operation("not", operation("and", A, B)), "not (a and b)"),
        (operation("and", operation("not", A), B), "not a and b"),
        (operation("and", operation("or", A, B), C), "(a or b) and c"),
        (operation("or", operation("and", A, B), C), "a and b or c"),
        (operation("-", operation("-", A, B), C), "a - b - c"),
        (operation("-", A, operation("-", B, C)), "a - (b - c)"),
        (operation("-", A, operation("==", B, C)), "a - (b == c)"),
        (operation("==", operation("==", A, B), C), "(a == b) == c"),
        (operation("-", operation("+", A, B)), "-(a + b)"),
        (operation("*", operation("-", A), B), "-a * b"),
        (operation("is not", Let(A, B), Constant(None)), "(a := b) is not None"),
        (Choice(A, B, Choice(B, C, A)), "b if a else c if b else a"),
        (Choice(Choice(A, B, C), B, C), "b if (b if a else c) else c"),
        (Mapping(((A, B), (Tuple((A,)), C))), "{a: b, (a,): c}"),
        (Mapping(()), "{}"),
        (Each(operation("+", A, B), A, Choice(A, B, C)), "[a + b for a in (b if a else c)]"),
        (
            Call(Name("any"), (Each(A, A, B, operation("or", A, B), late=True),)),
            "any((a for a in b if a or b))",
        ),
        (Call(Lambda((A, B), Choice(A, B, C))), "(lambda a, b: b if a else c)()"),
        (Tuple((Lambda((), A), B)), "(lambda: a, b)"),
        (operation("+", Choice(A, B, C), Constant(True)), "(b if a else c) + True"),
    ],
)
def test_parentheses_stand_where_they_must(node: Expression, expected: str) -> None:
    assert expression_text(node) == expected


def expressions() -> st.SearchStrategy[Expression]:
    leaves: st.SearchStrategy[Expression] = st.one_of(
        st.sampled_from([A, B, C]),
        st.integers(0, 9).map(Constant),
        st.sampled_from([None, True]).map(Constant),
    )

    def larger(inner: st.SearchStrategy[Expression]) -> st.SearchStrategy[Expression]:
        two = st.tuples(inner, inner)
        return st.one_of(
            st.builds(Operation, st.sampled_from(["and", "or", "+", "-", "*", "==", "<", "in", "is"]), two),
            st.builds(Operation, st.sampled_from(["not", "-"]), st.tuples(inner)),
            st.builds(Choice, inner, inner, inner),
            st.builds(Call, inner, two),
            st.builds(Index, inner, inner),
            st.builds(Member, st.sampled_from([A, B]), st.just("m")),
            st.builds(Tuple, two),
            st.builds(Let, st.sampled_from([A, B]), inner),
        )

    return st.recursive(leaves, larger, max_leaves=12)


def with_all_parentheses(node: Expression) -> str:
    match node:
        case Operation(operator, (one,)):
            return f"({operator} ({with_all_parentheses(one)}))"
        case Operation(operator, (left, right)):
            return f"(({with_all_parentheses(left)}) {operator} ({with_all_parentheses(right)}))"
        case Choice(test, then, otherwise):
            parts = [f"({with_all_parentheses(part)})" for part in (then, test, otherwise)]
            return f"({parts[0]} if {parts[1]} else {parts[2]})"
        case Call(function, arguments):
            return f"({with_all_parentheses(function)})({', '.join(map(with_all_parentheses, arguments))})"
        case Index(collection, key):
            return f"({with_all_parentheses(collection)})[{with_all_parentheses(key)}]"
        case Let(local, value):
            return f"({local.name} := {with_all_parentheses(value)})"
        case Tuple(items):
            return f"({', '.join(map(with_all_parentheses, items))})"
        case _:
            return expression_text(node)


@given(expressions())
def test_python_reads_what_the_tree_says(node: Expression) -> None:
    def shape(source: str) -> str:
        tree = ast.parse(source, mode="eval")
        for each in ast.walk(tree):  # `a and (b and c)` is `a and b and c`
            if isinstance(each, ast.BoolOp):
                while any(isinstance(v, ast.BoolOp) and type(v.op) is type(each.op) for v in each.values):
                    each.values = [
                        w
                        for v in each.values
                        for w in (
                            v.values if isinstance(v, ast.BoolOp) and type(v.op) is type(each.op) else [v]
                        )
                    ]
        return ast.dump(tree)

    assert shape(expression_text(node)) == shape(with_all_parentheses(node))


def test_statements() -> None:
    body: Body = (
        Assign(Local("out"), Call(Name("list"))),
        For(
            Tuple((A,)),
            Name("rows"),
            (
                Assign(Tuple((B,)), A),
                If(B, (Leave("continue"),), (Assign(Index(C, A), B, "+="),)),
                While(Constant(True), (Leave("break"),)),
                Try(
                    (Do(Call(Name("f"))),),
                    (
                        Handler(Name("Error"), None, ()),
                        Handler(Name("Other"), C, (Raise(Call(Name("told"), (C,))),)),
                        Handler(Name("Third"), None, (Raise(),)),
                    ),
                ),
                Yield(A),
                Yield(Local("out"), each=True),
            ),
        ),
        Return(),
    )
    assert text(Function("view", (A, B), body)) == (
        "def view(a, b):\n"
        "    out = list()\n"
        "    for a, in rows:\n"
        "        b, = a\n"
        "        if b:\n"
        "            continue\n"
        "        else:\n"
        "            c[a] += b\n"
        "        while True:\n"
        "            break\n"
        "        try:\n"
        "            f()\n"
        "        except Error:\n"
        "            pass\n"
        "        except Other as c:\n"
        "            raise told(c) from None\n"
        "        except Third:\n"
        "            raise\n"
        "        yield a\n"
        "        yield from out\n"
        "    return\n"
    )


def test_tests_directly_inside_each_other_are_joined() -> None:
    inner = If(operation("or", B, C), (Return(C),))
    assert text(If(A, (inner,))) == "if a and (b or c):\n    return c\n"
    assert text(If(A, (inner,), (Return(B),))).startswith("if a:\n    if b or c:\n")
    assert text(If(A, (inner, Return(A)))).startswith("if a:\n    if b or c:\n")


def test_long_conditions_are_broken() -> None:
    names = [Local(f"{'x' * 30}{number}") for number in range(4)]
    nested: Body = (Return(A),)
    for name in reversed(names):
        nested = (If(name, nested, origin=name.name),)
    found = printed(nested)
    lines = found.text.splitlines()
    assert lines[0] == "if ("
    assert lines[1:5] == [f"    {'and ' if n else ''}{name.name}" for n, name in enumerate(names)]
    assert lines[5:] == ["):", "    return a"]
    assert len(found.origins) == len(lines)


def test_equal_trees_do_the_same() -> None:
    assert Do(A, origin="here") == Do(A, origin="there")
    assert Constant(1) != Constant(True)
    assert len({Constant(1), Constant(True), Constant(1)}) == 2
    assert Local("a", "int") != Local("a", "object")
