"""Trees become Python text."""

from __future__ import annotations

import ast

import pytest
from hypothesis import given, strategies as st

from envgraph import code

A, B, C = code.Local("a"), code.Local("b"), code.Local("c")


def operation(operator: str, *operands: code.Expression) -> code.Operation:
    return code.Operation(operator, operands)


def text(*body: object) -> str:
    return code.print_source(body).text  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("node", "expected"),
    [
        (code.Call(code.Name("f"), (A, code.Constant(1))), "f(a, 1)"),
        (code.Subscript(code.Call(code.Name("f")), code.Tuple((A,))), "f()[(a,)]"),
        (code.Tuple(()), "()"),
        (code.Tuple((A, B)), "(a, b)"),
        (code.AttributeAccess(code.AssignmentExpression(A, B), "x"), "(a := b).x"),
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
        (operation("is not", code.AssignmentExpression(A, B), code.Constant(None)), "(a := b) is not None"),
        (code.ConditionalExpression(A, B, code.ConditionalExpression(B, C, A)), "b if a else c if b else a"),
        (
            code.ConditionalExpression(code.ConditionalExpression(A, B, C), B, C),
            "b if (b if a else c) else c",
        ),
        (code.DictExpression(((A, B), (code.Tuple((A,)), C))), "{a: b, (a,): c}"),
        (code.DictExpression(()), "{}"),
        (
            code.Comprehension(operation("+", A, B), A, code.ConditionalExpression(A, B, C)),
            "[a + b for a in (b if a else c)]",
        ),
        (
            code.Call(code.Name("any"), (code.Comprehension(A, A, B, operation("or", A, B), is_lazy=True),)),
            "any((a for a in b if a or b))",
        ),
        (
            code.Call(code.Lambda((A, B), code.ConditionalExpression(A, B, C))),
            "(lambda a, b: b if a else c)()",
        ),
        (code.Tuple((code.Lambda((), A), B)), "(lambda: a, b)"),
        (operation("+", code.ConditionalExpression(A, B, C), code.Constant(True)), "(b if a else c) + True"),
    ],
)
def test_parentheses_are_printed_only_where_needed(node: code.Expression, expected: str) -> None:
    assert code.expression_text(node) == expected


def expressions() -> st.SearchStrategy[code.Expression]:
    leaves: st.SearchStrategy[code.Expression] = st.one_of(
        st.sampled_from([A, B, C]),
        st.integers(0, 9).map(code.Constant),
        st.sampled_from([None, True]).map(code.Constant),
    )

    def larger(inner: st.SearchStrategy[code.Expression]) -> st.SearchStrategy[code.Expression]:
        two = st.tuples(inner, inner)
        return st.one_of(
            st.builds(code.Operation, st.sampled_from(["and", "or", "+", "-", "*", "==", "<", "in", "is"]), two),
            st.builds(code.Operation, st.sampled_from(["not", "-"]), st.tuples(inner)),
            st.builds(code.ConditionalExpression, inner, inner, inner),
            st.builds(code.Call, inner, two),
            st.builds(code.Subscript, inner, inner),
            st.builds(code.AttributeAccess, st.sampled_from([A, B]), st.just("m")),
            st.builds(code.Tuple, two),
            st.builds(code.AssignmentExpression, st.sampled_from([A, B]), inner),
        )

    return st.recursive(leaves, larger, max_leaves=12)


def with_all_parentheses(node: code.Expression) -> str:
    match node:
        case code.Operation(operator, (one,)):
            return f"({operator} ({with_all_parentheses(one)}))"
        case code.Operation(operator, (left, right)):
            return f"(({with_all_parentheses(left)}) {operator} ({with_all_parentheses(right)}))"
        case code.ConditionalExpression(test, then, otherwise):
            parts = [f"({with_all_parentheses(part)})" for part in (then, test, otherwise)]
            return f"({parts[0]} if {parts[1]} else {parts[2]})"
        case code.Call(function, arguments):
            return f"({with_all_parentheses(function)})({', '.join(map(with_all_parentheses, arguments))})"
        case code.Subscript(collection, key):
            return f"({with_all_parentheses(collection)})[{with_all_parentheses(key)}]"
        case code.AssignmentExpression(local, value):
            return f"({local.name} := {with_all_parentheses(value)})"
        case code.Tuple(items):
            return f"({', '.join(map(with_all_parentheses, items))})"
        case _:
            return code.expression_text(node)


@given(expressions())
def test_python_parses_printed_expressions_to_the_same_tree(node: code.Expression) -> None:
    def shape(source: str) -> str:
        tree = ast.parse(source, mode="eval")
        for each in ast.walk(tree):  # `a and (b and c)` is `a and b and c`
            if isinstance(each, ast.BoolOp):
                while any(isinstance(v, ast.BoolOp) and type(v.op) is type(each.op) for v in each.values):
                    each.values = [
                        w
                        for v in each.values
                        for w in (v.values if isinstance(v, ast.BoolOp) and type(v.op) is type(each.op) else [v])
                    ]
        return ast.dump(tree)

    assert shape(code.expression_text(node)) == shape(with_all_parentheses(node))


def test_statements_are_printed_as_python() -> None:
    body: code.Body = (
        code.Assign(code.Local("out"), code.Call(code.Name("list"))),
        code.For(
            code.Tuple((A,)),
            code.Name("rows"),
            (
                code.Assign(code.Tuple((B,)), A),
                code.If(B, (code.BreakOrContinue("continue"),), (code.Assign(code.Subscript(C, A), B, "+="),)),
                code.While(code.Constant(True), (code.BreakOrContinue("break"),)),
                code.Try(
                    (code.ExpressionStatement(code.Call(code.Name("f"))),),
                    (
                        code.ExceptClause(code.Name("Error"), None, ()),
                        code.ExceptClause(code.Name("Other"), C, (code.Raise(code.Call(code.Name("told"), (C,))),)),
                        code.ExceptClause(code.Name("Third"), None, (code.Raise(),)),
                    ),
                ),
                code.Yield(A),
                code.Yield(code.Local("out"), is_from=True),
            ),
        ),
        code.Return(),
    )
    assert text(code.Function("view", (A, B), body)) == (
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


def test_directly_nested_ifs_are_joined_with_and() -> None:
    inner = code.If(operation("or", B, C), (code.Return(C),))
    assert text(code.If(A, (inner,))) == "if a and (b or c):\n    return c\n"
    assert text(code.If(A, (inner,), (code.Return(B),))).startswith("if a:\n    if b or c:\n")
    assert text(code.If(A, (inner, code.Return(A)))).startswith("if a:\n    if b or c:\n")


def test_long_conditions_are_printed_on_several_lines() -> None:
    names = [code.Local(f"{'x' * 30}{number}") for number in range(4)]
    nested: code.Body = (code.Return(A),)
    for name in reversed(names):
        nested = (code.If(name, nested, origin=name.name),)
    found = code.print_source(nested)
    lines = found.text.splitlines()
    assert lines[0] == "if ("
    assert lines[1:5] == [f"    {'and ' if n else ''}{name.name}" for n, name in enumerate(names)]
    assert lines[5:] == ["):", "    return a"]
    assert len(found.origins) == len(lines)


def test_trees_are_equal_regardless_of_their_origins() -> None:
    assert code.ExpressionStatement(A, origin="here") == code.ExpressionStatement(A, origin="there")
    assert code.Constant(1) != code.Constant(True)
    assert len({code.Constant(1), code.Constant(True), code.Constant(1)}) == 2
    assert code.Local("a", "int") != code.Local("a", "object")
