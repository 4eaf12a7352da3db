"""Types and values of expressions."""

import pytest

from envgraph.code import Name
from envgraph.errors import EvaluationError, InvalidArgument, exact_key
from envgraph.metamodel import Scalar
from envgraph.pattern import (
    EXPRESSION_NAMESPACE,
    Constant,
    EnumLiteral,
    FunctionCall,
    Navigation,
    ObjectType,
    Unary,
    Variable,
    check_expression,
    check_holds,
    compile_expression,
    evaluate,
    value_of,
)
from envgraph.pattern.expressions._builtin_functions import (
    FUNCTIONS,
)
from tests.unit.pattern.building import COLOUR, METAMODEL, NONE, cond, expr, op, text

INT, FLOAT, BOOL, STRING = Scalar.INT, Scalar.FLOAT, Scalar.BOOL, Scalar.STRING
SCOPE = {
    "n": INT,
    "f": FLOAT,
    "b": BOOL,
    "s": STRING,
    "c": COLOUR,
    "cell": ObjectType("Cell"),
    "door": ObjectType("Door"),
}


def call(name, *arguments):
    return FunctionCall(name, tuple(map(expr, arguments)))


def checked(expression, **options):
    type_, problems = check_expression(expr(expression), SCOPE, METAMODEL, **options)
    return type_, [problem.code for problem in problems]


@pytest.mark.parametrize(
    ("type_", "expression"),
    [
        (INT, op("n", "+", 1)),
        (FLOAT, op("n", "+", 1.0)),
        (FLOAT, op("n", "/", "f")),
        (INT, op("n", "/", 2)),
        (STRING, op(text("p"), "+", op("n", "+", 1))),
        (STRING, op("c", "+", text("!"))),
        (BOOL, op("n", "<", "f")),
        (BOOL, op("s", "<", text("b"))),
        (BOOL, op("b", "&&", Unary("!", expr("b")))),
        (BOOL, op("c", "==", "::red")),
        (BOOL, op("::red", "!=", "c")),
        (BOOL, op("n", "==", "f")),
        (COLOUR, cond("b", "::red", "c")),
        (COLOUR, cond("b", "c", "::red")),
        (INT, cond("b", 1, "n")),
        (ObjectType("Cell"), cond("b", "cell.right", "cell")),
        (INT, expr("cell.right.left.x")),
        (COLOUR, expr("door.colour")),
        (BOOL, op("cell.right", "==", NONE)),
        (BOOL, op(NONE, "!=", "cell.right.left")),
        (BOOL, op("cell.right", "==", "cell.left")),
        (INT, call("abs", "n")),
        (FLOAT, call("abs", "f")),
        (FLOAT, call("min", "n", 2, "f")),
        (INT, call("length", "s")),
        (STRING, call("toString", "c")),
        (STRING, call("substring", "s", 1)),
        (STRING, call("substring", "s", 1, 2)),
        (None, NONE),
        (INT, cond("b", NONE, "n")),
        (ObjectType("Cell"), cond("b", "cell", NONE)),
        (INT, Navigation(cond("b", "cell", "door"), "x")),
    ],
)
def test_expressions_have_their_expected_types(type_, expression):
    assert checked(expression) == (type_, [])


@pytest.mark.parametrize(
    ("code", "expression"),
    [
        ("unknown-variable", op("m", "+", 1)),
        ("unknown-variable", op("_", "+", 1)),
        ("unknown-function", call("root", "n")),
        ("unknown-feature", expr("cell.z")),
        ("unknown-feature", expr("cell.open")),
        ("unknown-feature", expr("cell.x.y")),
        ("unknown-feature", expr("n.x")),
        ("many-valued", expr("cell.items")),
        ("unknown-enum", op("Color::red", "==", "c")),
        ("unknown-enum", op("::red", "==", "::red")),
        ("unknown-enum", op("n", "==", "::red")),
        ("unknown-enum", cond("b", "::red", "::blue")),
        ("unknown-literal", op("c", "==", "::rad")),
        ("operand-type", op("c", "==", text("red"))),
        ("operand-type", op("c", "==", "Way::west")),
        ("operand-type", op("n", "==", "b")),
        ("operand-type", op("s", "-", "n")),
        ("operand-type", op("b", "+", 1)),
        ("operand-type", op("c", "+", 1)),
        ("operand-type", op("cell", "+", text("x"))),
        ("operand-type", op("c", "<", "s")),
        ("operand-type", op("s", "<", "n")),
        ("operand-type", op("n", "&&", "b")),
        ("operand-type", op("cell.right", "==", "n")),
        ("operand-type", op("cell", "==", Constant(3))),
        ("operand-type", Unary("!", expr("n"))),
        ("operand-type", Unary("-", expr("s"))),
        ("operand-type", op("n", "+", NONE)),
        ("operand-type", cond("n", 1, 2)),
        ("operand-type", cond("b", 1, 2.0)),
        ("operand-type", cond("b", 1, text("a"))),
        ("operand-type", call("sqrt", "s")),
        ("operand-type", call("substring", "s", 1.5)),
        ("none-test", op("n", "==", NONE)),
        ("none-test", op(NONE, "==", NONE)),
        ("wrong-arity", call("min", "n")),
        ("wrong-arity", call("abs", "n", "n")),
    ],
)
def test_one_mistake_gives_one_diagnostic(code, expression):
    assert checked(expression)[1] == [code]


def test_an_expected_type_gives_a_literal_its_enum():
    assert checked("::blue", expected=COLOUR) == (COLOUR, [])
    assert checked(cond("b", "::blue", "::red"), expected=COLOUR) == (COLOUR, [])


@pytest.mark.parametrize(
    ("expression", "expected", "codes"),
    [
        (expr("n"), FLOAT, []),
        (expr("f"), INT, ["wrong-type"]),
        (text("red"), COLOUR, ["wrong-type"]),
        (expr("door"), ObjectType("Cell"), []),
        (expr("cell"), ObjectType("Door"), ["wrong-type"]),
        (expr("n"), ObjectType("Cell"), ["wrong-type"]),
        (NONE, ObjectType("Cell"), []),
    ],
)
def test_an_expression_of_another_type_than_expected_is_an_error(expression, expected, codes):
    assert checked(expression, expected=expected)[1] == codes


def test_object_variables_are_values_outside_of_queries_only():
    assert checked(op("cell", "==", "door")) == (BOOL, [])
    assert checked(op("cell", "==", "door"), bare_objects=False)[1] == ["bare-object"]
    assert checked(op("cell.right", "==", "door"), bare_objects=False)[1] == ["bare-object"]
    assert checked(op("cell.x", "==", "door.x"), bare_objects=False)[1] == []


def test_a_variable_of_unknown_type_causes_no_errors():
    expression = op(op("u", "+", 1), "<", op("u.x", "*", 2))
    assert check_expression(expression, {"u": None}, METAMODEL) == (BOOL, [])


def test_too_deep_expressions_are_reported_without_a_crash():
    expression = expr("n")
    for _ in range(5_000):
        expression = Unary("-", expression)
    assert checked(expression)[1] == ["nested-too-deeply"]


def flat(first, count, *operators):
    """`first + 1 - 1 ...` with so many operands besides the first, the operators in turn."""
    expression = expr(first)
    for number in range(count):
        expression = op(expression, operators[number % len(operators)], 1.0 if first == "f" else 1)
    return expression


def deepest(length):
    """An expression of as many levels as are allowed: chains of so many operators inside each other."""
    expression, operators = expr("f"), "*+"
    while True:
        larger = flat(expression, length, operators[0])
        if check_expression(larger, SCOPE, METAMODEL)[1]:
            return expression
        expression, operators = larger, operators[::-1]


@pytest.mark.parametrize("length", [1, 2, 4, 5, 40])
def test_the_deepest_expression_still_compiles(length):
    expression = deepest(length)
    assert checked(expression) == (FLOAT, [])
    compiled = compile_expression(expression, {"f": Name("f")}, SCOPE)
    value = eval(compiled.source, {**EXPRESSION_NAMESPACE, "k": compiled.constants, "f": 2.5})
    assert value == evaluate(expression, {"f": 2.5}) > 2.5 or length == 1


LONG_SUM = flat("n", 3_000, "+", "-", "-")


@pytest.mark.parametrize(
    ("expression", "values", "value"),
    [
        (LONG_SUM, {"n": 5}, -995),
        (flat("f", 3_000, "+", "-", "-"), {"f": 0.5}, -999.5),
        (flat("s", 3_000, "+"), {"s": "a"}, "a" + "1" * 3_000),
        (flat("n", 3_000, "*", "/", "%"), {"n": 7}, 0),
        (op(LONG_SUM, "<", flat("n", 3_000, "+")), {"n": 5}, True),
    ],
)
def test_long_chains_of_operators_are_allowed(expression, values, value):
    assert checked(expression)[1] == []
    assert evaluate(expression, values) == value
    for types in (SCOPE, {}):
        compiled = compile_expression(expression, {name: Name(name) for name in values}, types)
        assert eval(compiled.source, {**EXPRESSION_NAMESPACE, "k": compiled.constants, **values}) == value


@pytest.mark.parametrize(("operator", "value"), [("&&", False), ("||", True)])
def test_long_conjunctions_are_allowed(operator, value):
    expression = op("b", operator, op("n", ">", 0))
    for _ in range(3_000):
        expression = op(expression, operator, "b")
    assert checked(expression) == (BOOL, [])
    values = {"b": not value, "n": int(value)}
    compiled = compile_expression(expression, {"b": Name("b"), "n": Name("n")}, SCOPE)
    assert evaluate(expression, values) is value
    assert eval(compiled.source, {**EXPRESSION_NAMESPACE, "k": compiled.constants, **values}) is value


def test_equality_and_repr_of_long_expressions_need_no_recursion():
    one, same, other = flat("n", 3_000, "+"), flat("n", 3_000, "+"), flat("f", 3_000, "+")
    assert one == same != other
    assert hash(one) == hash(same)
    assert exact_key(one) == exact_key(same) != exact_key(other)
    assert len(exact_key(one)) == 3_000 * 4 + 2
    assert repr(one) == "Binary(operator='+', left=Binary(...), right=Constant(...))"
    inner = "Binary(operator='+', left=Variable(name='n'), right=Constant(value=1))"
    assert repr(flat("n", 2, "+", "-")) == f"Binary(operator='-', left={inner}, right=Constant(value=1))"


def test_errors_inside_a_long_chain_are_reported_once():
    expression = op(op(op("n", "+", "b"), "+", 1), "-", "s")
    assert checked(expression) == (None, ["operand-type", "operand-type"])


def test_too_large_expressions_are_reported():
    _, problems = check_expression(flat("n", 60_000, "+"), SCOPE, METAMODEL)
    assert [problem.message for problem in problems] == ["the expression has more than 50000 operands and operators"]


@pytest.mark.parametrize(
    ("value", "expression"),
    [
        (3, op(7, "/", 2)),
        (-3, op(-7, "/", 2)),
        (-3, op(7, "/", -2)),
        (3.5, op(7, "/", 2.0)),
        (-1, op(-7, "%", 2)),
        (1, op(7, "%", -2)),
        (1, call("mod", -7, 2)),
        (-1.5, op(-7.5, "%", 2)),
        ("p3", op(text("p"), "+", op(2, "+", 1))),
        ("p21", op(op(text("p"), "+", 2), "+", 1)),
        ("true1.0", op(op(True, "+", text("")), "+", 1.0)),
        (10**17, op(10**16, "*", 10)),
        (False, op(False, "&&", op(op(1, "/", 0), "==", 1))),
        (True, op(True, "||", op(op(1, "/", 0), "==", 1))),
        (1, cond(True, 1, op(1, "/", 0))),
        (True, op(1, "==", 1.0)),
        (2.0, call("min", 3.0, 2)),
        (3, call("max", 3, 2)),
        (3.0, call("sqrt", 9)),
        (8.0, call("pow", 2, 3)),
        (-3, call("floor", -2.5)),
        (-2, call("ceil", -2.5)),
        (-2, call("round", -2.5)),
        (3, call("round", 2.5)),
        (0, call("round", 0.49999999999999994)),
        (-2, call("toInt", -2.5)),
        (2.0, call("toFloat", 2)),
        (True, call("startsWith", text("abc"), text("ab"))),
        (True, call("endsWith", text("abc"), text("bc"))),
        (True, call("contains", text("abc"), text("b"))),
        (1, call("indexOf", text("abc"), text("b"))),
        ("bc", call("substring", text("abc"), 1)),
        ("b", call("substring", text("abc"), 1, 2)),
        ("xbc", call("replace", text("abc"), text("a"), text("x"))),
        ("a", call("trim", text(" a "))),
        ("AB", call("toUpper", text("aB"))),
        ("ab", call("toLowerCase", text("aB"))),
        (True, call("isEmpty", text(""))),
        (0, call("length", text(""))),
        (1.0, call("exp", 0)),
        (0.0, call("log", 1)),
        (2, call("abs", -2)),
        ("red", call("toString", "Colour::red")),
    ],
)
def test_expressions_evaluate_to_their_expected_values(value, expression):
    result = evaluate(expression, {})
    assert (result, type(result)) == (value, type(value))


@pytest.mark.parametrize(
    "expression",
    [
        op(1, "/", 0),
        op(1, "%", 0),
        op(1.0, "/", 0.0),
        call("mod", 1, 0),
        op(1e308, "*", 10),
        op(10**400, "*", 1.0),
        op(2**62, "+", 2**62),
        Unary("-", Constant(-(2**63))),
        call("sqrt", -1),
        call("log", 0),
        call("pow", 10, 400),
        call("substring", text("abc"), 2, 1),
        call("replace", Constant("a" * 2_000), text("a"), Constant("b" * 2_000)),
        op(Constant("a" * 600_000), "+", Constant("a" * 600_000)),
    ],
)
def test_expressions_without_a_value_raise_evaluation_errors(expression):
    with pytest.raises(EvaluationError):
        evaluate(expression, {})
    assert value_of(expression, {}) is None
    compiled = compile_expression(expression, {})
    assert compiled.can_fail
    with pytest.raises(EvaluationError):
        eval(compiled.source, {**EXPRESSION_NAMESPACE, "k": compiled.constants})


CELLS = {0: {"x": 4, "right": 1}, 1: {"x": 5, "right": None}}


def read(cell, feature):
    return CELLS[cell].get(feature)


def test_paths_read_the_model():
    assert evaluate(expr("a.right.x"), {"a": 0}, read) == 5
    assert evaluate(expr("a.right.right"), {"a": 0}, read) is None
    assert evaluate(op("a.right.right", "==", NONE), {"a": 0}, read) is True
    assert evaluate(op("a.right.right.right", "==", NONE), {"a": 0}, read) is True
    assert evaluate(op("a.right", "!=", NONE), {"a": 0}, read) is True


def test_operators_refuse_missing_values():
    with pytest.raises(EvaluationError, match="`x` has no value"):
        evaluate(op("a.right.x", "+", 1), {"a": 1}, read)


def test_all_paths_of_a_check_need_values_despite_short_circuits():
    expression = op("b", "||", op("a.right.x", ">", 0))
    assert evaluate(expression, {"a": 1, "b": True}, read) is True
    assert not check_holds(expression, {"a": 1, "b": True}, read)
    assert check_holds(expression, {"a": 0, "b": True}, read)


def test_a_check_may_compare_a_path_with_none():
    assert check_holds(op(op("a.right", "==", NONE), "||", op("a.x", "==", 4)), {"a": 1}, read)


def test_all_paths_in_a_computed_path_start_need_values():
    expression = op(Navigation(cond("b", "a", "a.right"), "x"), ">", 0)
    assert evaluate(expression, {"a": 1, "b": True}, read) is True
    assert not check_holds(expression, {"a": 1, "b": True}, read)
    assert check_holds(expression, {"a": 0, "b": True}, read)


def test_the_value_of_a_failing_eval_is_none():
    assert value_of(expr("a.right.x"), {"a": 1}, read) is None
    assert value_of(op(1, "/", expr("a.right.x")), {"a": 0}, read) == 0


def test_missing_variables_and_models_are_invalid_arguments():
    with pytest.raises(InvalidArgument):
        evaluate(Variable("x"), {})
    with pytest.raises(InvalidArgument):
        evaluate(expr("a.x"), {"a": 0})
    with pytest.raises(InvalidArgument):
        compile_expression(Variable("x"), {})
    with pytest.raises(InvalidArgument):
        compile_expression(expr("a.x"), {"a": Name("a")})


def test_generated_source_contains_no_user_text():
    evil = "__import__('os')"
    compiled = compile_expression(op(Constant(evil), "==", Variable(evil)), {evil: Name("v0")})
    assert compiled.source == "(k[0] == v0)"
    assert compiled.constants == (evil,)


def test_code_with_known_types_uses_python_operators():
    expression = op(op("n", "*", 2), ">", op("n", "-", 1))
    compiled = compile_expression(expression, {"n": Name("v")}, SCOPE, constant=lambda i: Name(f"c{i}"))
    assert (compiled.source, compiled.can_fail) == ("(v * c0 > v - c1)", False)


def test_every_function_has_a_reference_line_and_a_source_name():
    for name, function in FUNCTIONS.items():
        assert function.signature.startswith(f"{name}(")
        assert function.doc
        assert EXPRESSION_NAMESPACE[f"_fn_{name}"] is function.implementation


def test_enum_literals_evaluate_to_their_names():
    assert evaluate(EnumLiteral("Colour", "red"), {}) == "red"


def test_constants_of_different_types_are_different():
    assert len({Constant(1), Constant(True), Constant(1.0), Constant(1)}) == 3
