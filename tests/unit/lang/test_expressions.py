"""The expression language, read from a check of a query."""

from typing import Any

import pytest

from envgraph.pattern import (
    Binary,
    Check,
    Conditional,
    Constant,
    EnumLiteral,
    Expression,
    FunctionCall,
    Navigation,
    Unary,
    Variable,
    children,
)
from tests.reading import read_definitions

a, b, c, d = (Variable(name) for name in "abcd")


def read(text: str) -> Any:
    return read_definitions(f"pattern p() {{ check({text}); }}", "query", "x")


def expression(text: str) -> Expression:
    file = read(text)
    assert not file.diagnostics
    check = file.definitions[0].bodies[0].constraints[0]
    assert isinstance(check, Check)
    return check.expression


def shown(expression: Expression) -> str:
    """The expression with a pair of parentheses around every part."""
    match expression:
        case Variable(name):
            return name
        case Constant(value):
            return repr(value)
        case Unary(operator, operand):
            return f"({operator}{shown(operand)})"
        case Binary(operator, left, right):
            return f"({shown(left)}{operator}{shown(right)})"
        case Conditional(test, then, otherwise):
            return f"({shown(test)}?{shown(then)}:{shown(otherwise)})"
        case Navigation(owner, feature):
            return f"{shown(owner)}.{feature}"
        case FunctionCall(function, arguments):
            return f"{function}({','.join(map(shown, arguments))})"
        case EnumLiteral(enum, literal):
            return f"{enum or ''}::{literal}"


@pytest.mark.parametrize(
    ("text", "grouped"),
    [
        ("a + b * c", "(a+(b*c))"),
        ("a - b - c", "((a-b)-c)"),
        ("a / b % c * d", "(((a/b)%c)*d)"),
        ("a + b < c - d", "((a+b)<(c-d))"),
        ("a < b == c > d", "((a<b)==(c>d))"),
        ("a == b && c != d", "((a==b)&&(c!=d))"),
        ("a && b || c && d", "((a&&b)||(c&&d))"),
        ("a || b ? c : d", "((a||b)?c:d)"),
        ("a ? b : c ? d : a", "(a?b:(c?d:a))"),
        ("a ? b ? c : d : a", "(a?(b?c:d):a)"),
        ("!a && -b < c", "((!a)&&((-b)<c))"),
        ("!a.b.c", "(!a.b.c)"),
        ("-a.b * c", "((-a.b)*c)"),
        ("(a + b) * c", "((a+b)*c)"),
        ("f(a, b + c).d", "f(a,(b+c)).d"),
        ("a<-b", "(a<(-b))"),
        ("a ? b : ::c", "(a?b:::c)"),
        ("min(count, sum)", "min(count,sum)"),
    ],
)
def test_operators_have_the_precedence_of_java(text: str, grouped: str) -> None:
    assert shown(expression(text)) == grouped


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("12", 12),
        ("0l", 0),
        ("7L", 7),
        ("1.5", 1.5),
        ("2e3", 2000.0),
        ("-3", -3),
        ("-0.25", -0.25),
        ("true", True),
        ("TRUE", True),
        ("false", False),
        ("FALSE", False),
        ("none", None),
        ('"a \\"b\\" \\u00e9"', 'a "b" é'),
        ("'it'", "it"),
    ],
)
def test_literals_have_their_value_and_type(text: str, value: object) -> None:
    found = expression(text)
    assert isinstance(found, Constant)
    assert found == Constant(value)  # type: ignore[arg-type]
    assert type(found.value) is type(value)


def test_enum_literals_are_parsed_with_and_without_their_enum() -> None:
    assert expression("a == Way::west") == Binary("==", a, EnumLiteral("Way", "west"))
    assert expression("a == ::west") == Binary("==", a, EnumLiteral(None, "west"))


def test_triple_equals_is_parsed_as_equality() -> None:
    assert expression("a === b") == Binary("==", a, b)


def test_a_string_method_call_is_parsed_as_a_function_call() -> None:
    assert expression('a.b.startsWith("x")') == FunctionCall("startsWith", (Navigation(a, "b"), Constant("x")))
    assert expression("a.length()") == FunctionCall("length", (a,))


def test_every_name_has_its_span() -> None:
    found = expression("f(a.bb, Way::west)")
    assert isinstance(found, FunctionCall)
    navigation, literal = found.arguments
    assert isinstance(navigation, Navigation)
    assert isinstance(literal, EnumLiteral)
    spans = (
        found.span,
        found.function_span,
        navigation.span,
        navigation.feature_span,
        navigation.object.span,
        literal.span,
        literal.enum_span,
        literal.literal_span,
    )
    texts = ["f(a.bb, Way::west)", "f", "a.bb", "bb", "a", "Way::west", "Way", "west"]
    assert [span.text if span else None for span in spans] == texts


def test_the_span_of_an_expression_includes_its_parentheses() -> None:
    found = expression("d == (a + b) * (c)")
    assert isinstance(found, Binary)
    product = found.right
    assert isinstance(product, Binary)
    parts = (product, product.left, product.right)
    assert [part.span.text if part.span else None for part in parts] == ["(a + b) * (c)", "(a + b)", "c"]


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("a = b", "write `==`"),
        ("a and b", "write `&&`"),
        ("a or b", "write `||`"),
        ("a < b < c", "write `a < b && b < c`"),
    ],
)
def test_operators_of_other_languages_get_a_hint_with_the_right_operator(text: str, hint: str) -> None:
    assert [problem.hint for problem in read(text).diagnostics] == [hint]


@pytest.mark.parametrize("operator", ["+", "*", "&&", "||"])
def test_flat_expressions_may_be_long(operator: str) -> None:
    found = expression(f" {operator} ".join(["1"] * 5000))
    assert children(found) == (Constant(1),) * 5000
    assert found == expression(f"({f' {operator} '.join(['1'] * 4999)}) {operator} 1")


def test_nested_expressions_are_refused_without_a_traceback() -> None:
    problems = read(" == ".join(["1"] * 5000)).diagnostics
    assert [problem.code for problem in problems] == ["nested-too-deeply"]
