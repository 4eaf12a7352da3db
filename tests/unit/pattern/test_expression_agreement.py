"""Random typed expressions: the evaluator, generated code with types, and generated code without them agree."""

from __future__ import annotations

from functools import cache

import hypothesis.strategies as st
from hypothesis import given

from envgraph.code import Name
from envgraph.errors import EvaluationError
from envgraph.metamodel import EnumType, Scalar, accepts
from envgraph.pattern import (
    EXPRESSION_NAMESPACE,
    Binary,
    Conditional,
    Constant,
    EnumLiteral,
    FunctionCall,
    Unary,
    Variable,
    check_expression,
    compile_expression,
    evaluate,
)
from envgraph.pattern.expressions._builtin_functions import (
    FUNCTIONS,
)
from envgraph.pattern.expressions._expression_code import (
    CompiledExpression,
)
from tests.unit.pattern.building import COLOUR, METAMODEL

SCOPE = {
    "i": Scalar.INT,
    "j": Scalar.INT,
    "f": Scalar.FLOAT,
    "g": Scalar.FLOAT,
    "s": Scalar.STRING,
    "t": Scalar.STRING,
    "b": Scalar.BOOL,
    "c": COLOUR,
}

INTS = st.one_of(st.integers(-3, 3), st.sampled_from([2**62, -(2**63), 10**30, 7, -7]))
FLOATS = st.one_of(st.sampled_from([0.0, -0.0, 0.5, -2.5, 1e308, -1e308, 3.0]), st.floats(-10, 10))
STRINGS = st.text("ab0", max_size=4)
VALUES = {
    Scalar.INT: INTS,
    Scalar.FLOAT: FLOATS,
    Scalar.STRING: STRINGS,
    Scalar.BOOL: st.booleans(),
    COLOUR: st.sampled_from(COLOUR.literals),
}
ARGUMENTS = {"int": [Scalar.INT], "string": [Scalar.STRING], "number": [Scalar.INT, Scalar.FLOAT]}
ARGUMENTS["data"] = list(VALUES)


def leaves(type_):
    names = st.sampled_from([name for name, own in SCOPE.items() if own == type_]).map(Variable)
    if isinstance(type_, EnumType):
        return names | VALUES[type_].map(lambda literal: EnumLiteral(type_.name, literal))
    return names | VALUES[type_].map(Constant)


@cache
def of_type(type_, depth):
    """Expressions of exactly one static type; made once each, or there would be thousands of strategies."""
    if depth == 0:
        return leaves(type_)
    parts = [leaves(type_), conditionals(type_, depth), calls(type_, depth)]
    if type_ in (Scalar.INT, Scalar.FLOAT):
        parts += [arithmetic(type_, depth), of_type(type_, depth - 1).map(lambda e: Unary("-", e))]
    if type_ is Scalar.STRING:
        parts.append(concatenations(depth))
    if type_ is Scalar.BOOL:
        parts += [
            comparisons(depth),
            connectives(depth),
            of_type(type_, depth - 1).map(lambda e: Unary("!", e)),
        ]
    return st.one_of(parts)


def conditionals(type_, depth):
    branch = of_type(type_, depth - 1)
    return st.builds(Conditional, of_type(Scalar.BOOL, depth - 1), branch, branch)


def arithmetic(type_, depth):
    operators = st.sampled_from(["+", "-", "*", "/", "%"])
    own, integer = of_type(type_, depth - 1), of_type(Scalar.INT, depth - 1)
    return st.builds(Binary, operators, own, own) | st.builds(Binary, operators, own, integer)


def concatenations(depth):
    string = of_type(Scalar.STRING, depth - 1)
    other = st.sampled_from(list(VALUES)).flatmap(lambda type_: of_type(type_, depth - 1))
    return st.builds(Binary, st.just("+"), string, other) | st.builds(Binary, st.just("+"), other, string)


def comparisons(depth):
    def pair(type_):
        side = of_type(type_, depth - 1)
        ordered = type_ in (Scalar.INT, Scalar.FLOAT, Scalar.STRING)
        operators = ["==", "!=", "<", "<=", ">", ">="] if ordered else ["==", "!="]
        return st.builds(Binary, st.sampled_from(operators), side, side)

    return st.sampled_from(list(VALUES)).flatmap(pair)


def connectives(depth):
    side = of_type(Scalar.BOOL, depth - 1)
    return st.builds(Binary, st.sampled_from(["&&", "||"]), side, side)


def calls(type_, depth):
    def call(function):
        kinds = [function.parameter_kind(position) for position in range(len(function.parameters))]
        if function.result is None:  # the type of the arguments
            arguments = [of_type(type_, depth - 1) for _ in kinds]
        else:
            arguments = [
                st.sampled_from(ARGUMENTS[kind]).flatmap(lambda own: of_type(own, depth - 1)) for kind in kinds
            ]
        return st.tuples(*arguments).map(lambda made: FunctionCall(function.name, made))

    fitting = [
        function
        for function in FUNCTIONS.values()
        if function.result is type_ or (function.result is None and type_ in (Scalar.INT, Scalar.FLOAT))
    ]
    return st.sampled_from(fitting).flatmap(call) if fitting else leaves(type_)


TYPED = st.sampled_from(list(VALUES)).flatmap(lambda type_: st.tuples(st.just(type_), of_type(type_, 3)))
ENVIRONMENTS = st.fixed_dictionaries({name: VALUES[type_] for name, type_ in SCOPE.items()})


def run(compiled: CompiledExpression, values):
    # The names in the source are the ones given below and the helpers: a name from the user would be a NameError.
    names = {f"v_{name}": value for name, value in values.items()}
    return eval(compiled.source, {**EXPRESSION_NAMESPACE, "__builtins__": {}, "k": compiled.constants, **names})


def outcome(call):
    try:
        result = call()
    except EvaluationError:
        return EvaluationError
    return type(result), repr(result)


@given(TYPED, ENVIRONMENTS)
def test_evaluator_and_generated_code_agree(typed, values):
    type_, expression = typed
    assert check_expression(expression, SCOPE, METAMODEL) == (type_, [])
    names = {name: Name(f"v_{name}") for name in SCOPE}
    expected = outcome(lambda: evaluate(expression, values))
    for types in (SCOPE, None):
        compiled = compile_expression(expression, names, types)
        assert outcome(lambda compiled=compiled: run(compiled, values)) == expected
        assert compiled.can_fail or expected is not EvaluationError
    if expected is not EvaluationError:
        assert accepts(type_, evaluate(expression, values))
