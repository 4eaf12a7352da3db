"""Infer the types of function calls in expressions and report their errors."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from envgraph.errors import did_you_mean
from envgraph.pattern._expression_data import FunctionCall, Navigation, Variable
from envgraph.pattern._goals import ObjectType, StaticType
from envgraph.pattern._types import common_number, is_assignable, type_text, wrong_type_error
from envgraph.pattern.expressions._builtin_functions import FUNCTIONS

if TYPE_CHECKING:
    from envgraph.pattern._declared_functions import DeclaredFunction
    from envgraph.pattern.expressions._expression_types import ExpressionChecker


JAVA_HINTS: Final[Mapping[str, str]] = {
    "equalsIgnoreCase": "write `toLower(a) == toLower(b)`",
    "compareTo": "write `a < b`, `a == b` or `a > b`",
    "matches": "write `startsWith`, `endsWith`, `contains` or `indexOf`: there are no regular expressions",
    "valueOf": "write `toInt(x)`, `toFloat(x)` or `toString(x)`",
    "parseInt": "write `toInt(x)`",
    "charAt": "write `substring(text, i, i + 1)`",
    "isNullOrEmpty": "write `isEmpty(text)`: where the text is missing, there is no match",
    "size": "write `text.length`, or `n == count Type.feature(x, _);` outside of the expression",
    "random": "write chance in an environment: `0.5: r() | 0.5: s()`, `apply 0.1: r()` or `apply r(x) weight w`",
    **dict.fromkeys(("class", "eClass", "getClass"), "constrain it outside of the expression: `Type(x)`"),
}
"""Hints for methods of Java and for functions of chance, by name."""


def call_type(checker: ExpressionChecker, node: FunctionCall) -> StaticType | None:
    """Return the type of a function call, or None if unknown. Report errors of the call to the checker."""
    if node.declaration is not None:
        return _declared_call_type(checker, node, node.declaration)
    function = FUNCTIONS.get(node.function) if node.owner is None else None
    if function is None:
        _report_unknown_function(checker, node)
        return None
    if not function.accepts_count(len(node.arguments)):
        message = f"`{function.name}` does not take {len(node.arguments)} arguments"
        checker.report("wrong-arity", message, node, f"write `{function.signature}`")
        return function.result
    types = [
        checker.operand_type(argument, function.name, function.parameter_kind(position))
        for position, argument in enumerate(node.arguments)
    ]
    return function.result or common_number(*types)


def _report_unknown_function(checker: ExpressionChecker, node: FunctionCall) -> None:
    span = node.function_span or node.span
    declare = _declaration_hint(checker, node)
    if node.owner is not None:
        if node.function in FUNCTIONS:
            declare = f"write `{FUNCTIONS[node.function].signature}` if that is meant"
        message = f"`{node.owner}.{node.function}` is a function of Java"
        checker.report_at("java-call", message, span, declare)
        return
    hint = _getter_hint(checker, node) or JAVA_HINTS.get(node.function)
    hint = hint or did_you_mean(node.function, {**(node.declared or {}), **FUNCTIONS})
    checker.report_at("unknown-function", f"unknown function `{node.function}`", span, hint or declare)


def _declaration_hint(checker: ExpressionChecker, node: FunctionCall) -> str:
    """Return a hint that shows how to declare the called function, or what to pass instead of an object."""
    known, parameters = len(checker.problems), []
    for number, argument in enumerate(node.arguments):
        type_ = checker.type_of(argument)
        if checker.is_object(argument) or isinstance(type_, ObjectType):
            del checker.problems[known:]
            return "declare a function, and pass attributes of the object to it"
        name = argument.name if isinstance(argument, Variable) else f"{'abcdefgh'[number % 8]}"
        name = argument.feature if isinstance(argument, Navigation) else name
        parameters.append(f"{name} : {type_text(type_) if type_ else 'int'}")
    del checker.problems[known:]
    declaration = f"function {node.function}({', '.join(parameters)}) : T;"
    return f"declare it with its types, `{declaration}`, and give the engine its code"


def _declared_call_type(
    checker: ExpressionChecker, node: FunctionCall, function: DeclaredFunction
) -> StaticType | None:
    """Check a call of a declared function. Return its result type, or None if the declaration has errors."""
    if function.result is None:
        for argument in node.arguments:
            checker.type_of(argument)
        return None
    if len(node.arguments) != len(function.parameters):
        message = f"`{function.name}` does not take {len(node.arguments)} arguments"
        hint = f"it is declared as `{function.declaration.signature}`"
        checker.report("wrong-arity", message, node, hint)
        return function.result
    for argument, parameter in zip(node.arguments, function.parameters, strict=True):
        type_ = checker.operand_type(argument, function.name, "data", parameter)
        if type_ is not None and not is_assignable(type_, parameter, checker.metamodel):
            checker.problems.append(wrong_type_error(argument, type_, parameter))
    return function.result


def _getter_hint(checker: ExpressionChecker, node: FunctionCall) -> str | None:
    """Return a hint that replaces a Java getter `x.getLength()` by the feature `x.length`, or None."""
    owner = node.arguments[0] if len(node.arguments) == 1 else None
    type_ = checker.scope.get(owner.name) if isinstance(owner, Variable) else None
    if not isinstance(owner, Variable) or not isinstance(type_, ObjectType):
        return None
    name = re.sub("^(get|is)(?=[A-Z])", "", node.function)
    feature = name[:1].lower() + name[1:]
    known = feature in checker.metamodel.features(type_.cls)
    return f"write `{owner.name}.{feature}`" if known else None
