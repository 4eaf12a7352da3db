"""Parse the syntax trees of expressions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from lark import Token, Tree

from envgraph.errors import (
    ReplacementHint,
    most_similar,
    name_hint,
)
from envgraph.lang.read._ecore_types import ECORE_TYPES
from envgraph.lang.read._file_reading import FileReading, resolve_type_name
from envgraph.lang.read._java_names import (
    CAST_FUNCTIONS,
    JAVA_CLASSES,
    JAVA_CONSTANTS,
    JAVA_DOMAINS,
    JAVA_TYPES,
    OPERATOR_METHODS,
    builtin_function_for,
)
from envgraph.lang.syntax._parser import (
    MEANT_OPERATORS,
    ORDERINGS,
    continues_chain,
    number_of,
    precedence_of,
    select_tokens,
    select_trees,
)
from envgraph.metamodel import Value, type_name
from envgraph.pattern import (
    Binary,
    Conditional,
    Constant,
    EnumLiteral,
    Expression,
    FunctionCall,
    Navigation,
    Unary,
    Variable,
)

_KEYWORD_VALUES: Mapping[str, bool | None] = {"true": True, "false": False, "none": None}
_TYPE_TESTS = frozenset({"isInstanceOf", "oclIsKindOf", "oclIsTypeOf", "oclAsType"})
_REFUSED_OPERATORS = frozenset({"=", "and", "or"})


def parse_variable(reading: FileReading, token: Token) -> Variable:
    """Return a `Variable` with the text and the span of a name token."""
    return Variable(str(token), reading.span(token))


def parse_assigned_value(reading: FileReading, tree: Tree[Token]) -> Expression | tuple[Expression, ...]:
    """Parse the right side of an assignment to a feature: an expression, or a tuple of expressions for a list."""
    if tree.data == "list":
        return parse_expressions(reading, tree)
    return parse_expression(reading, tree)


def parse_expressions(reading: FileReading, tree: Tree[Token]) -> tuple[Expression, ...]:
    """Parse the expressions in the `expression_list` of a tree; return an empty tuple if the tree has no such list."""
    return tuple(
        parse_expression(reading, item)
        for part in select_trees(tree.children, "expression_list")
        for item in select_trees(part.children)
    )


def parse_expression(reading: FileReading, tree: Tree[Token]) -> Expression:
    """Parse an expression; report errors in it and return the most similar valid expression."""
    return _PARSERS[tree.data](reading, tree)


def parse_literal(reading: FileReading, tree: Tree[Token], sign: Token | None = None) -> Constant:
    """Parse a string, boolean, `none`, or number (negated if `sign` is given); report a sign before other values."""
    if sign is not None and tree.data != "number":
        reading.error("unexpected-sign", "only a number can have a sign", sign, "remove the `-`")
        sign = None
    value: Value | None = _KEYWORD_VALUES[tree.data] if tree.data in _KEYWORD_VALUES else str(tree.children[0])
    if tree.data == "number":
        number = number_of(select_tokens(tree.children)[0])
        value = number if sign is None else -number
    span = reading.span(tree)
    return Constant(value, span if sign is None else reading.span(sign).joined_with(span))


def parse_enum_literal(reading: FileReading, tree: Tree[Token]) -> EnumLiteral:
    """Parse an enum literal: `Enum::literal`, `::literal` (its enum is None) or `alias::Enum::literal`."""
    parts = select_tokens(tree.children)
    alias = None
    if tree.data == "aliased_literal":
        alias = parts.pop(0)
        reading.use_alias(alias)
    *enum, literal = parts
    return EnumLiteral(
        resolve_type_name(reading, str(enum[0]), alias, tree, enums=True) if enum else None,
        str(literal),
        reading.span(tree),
        enum_span=reading.span(enum[0]) if enum else None,
        literal_span=reading.span(literal),
    )


def parse_enum_or_java_constant(reading: FileReading, tree: Tree[Token]) -> EnumLiteral | Constant:
    """Parse an enum literal, or a Java constant such as `Integer::MAX_VALUE`, whose number or boolean is returned."""
    parts = tuple(map(str, select_tokens(tree.children)))
    if len(parts) == 2 and parts in JAVA_CONSTANTS and parts[0] not in reading.aliases:
        return Constant(JAVA_CONSTANTS[parts], reading.span(tree))
    return parse_enum_literal(reading, tree)


def _parse_variable_or_null(reading: FileReading, tree: Tree[Token]) -> Variable | Constant:
    name = select_tokens(tree.children)[0]
    if name == "null":
        reading.error("unexpected-token", "`null` is not a value of this language", name, "write `none`")
        return Constant(None, reading.span(name))
    return parse_variable(reading, name)


def parse_dotted_literal(reading: FileReading, owner: str, feature: Token, tree: Tree[Token]) -> EnumLiteral | None:
    """Report `Way.west` and return the literal `Way::west`; return None, without a report, if `owner` is no enum."""
    metamodel = reading.types.metamodel if reading.types else None
    enum = metamodel.enums.get(owner) if metamodel else None
    if enum is None:
        return None
    meant = most_similar(feature, enum.literals)
    literal = str(feature) if meant is None or feature in enum.literals else meant
    hint = f"write `{owner}::{literal}`" if meant else name_hint(feature, enum.literals)
    reading.error("unexpected-token", f"a literal of the enum `{owner}` is written with `::`", tree, hint)
    if not meant:
        reading.record_gap(tree)
    return EnumLiteral(owner, literal, reading.span(tree), literal_span=reading.span(feature))


def _parse_group(reading: FileReading, tree: Tree[Token]) -> Expression:
    inner = parse_expression(reading, select_trees(tree.children)[0])
    # The span includes the parentheses, so that the markers under an operand of `&&` cover both of them.
    return replace(inner, span=reading.span(tree)) if isinstance(inner, Binary | Conditional | Unary) else inner


def _parse_navigation(reading: FileReading, tree: Tree[Token]) -> Navigation | Constant | EnumLiteral:
    feature = select_tokens(tree.children)[0]
    path = _path_names(select_trees(tree.children)[0])
    literal = parse_dotted_literal(reading, path[0], feature, tree) if len(path) == 1 else None
    if literal is not None:
        return literal
    if len(path) == 1 and (path[0], str(feature)) in JAVA_CONSTANTS:
        return Constant(JAVA_CONSTANTS[path[0], str(feature)], reading.span(tree))
    if _is_java_class(reading, path) and (len(path) > 1 or path[0] in reading.java_imports or feature.isupper()):
        cls = ".".join(path)
        reading.used_names.add(path[-1])
        hint = "write its value, or declare a function for it: `function name() : int;`"
        reading.error("java-call", f"the Java constant `{cls}.{feature}` is not available", tree, hint)
        reading.record_gap(tree)
    owner = parse_expression(reading, select_trees(tree.children)[0])
    return Navigation(owner, str(feature), reading.span(tree), feature_span=reading.span(feature))


def _parse_method_call(reading: FileReading, tree: Tree[Token]) -> Expression:
    """Parse a method call `text.startsWith("a")` as `startsWith(text, "a")`; `Math.max(a, b)` is a static Java call."""
    name = select_tokens(tree.children)[0]
    path = _path_names(select_trees(tree.children)[0])
    if _is_java_class(reading, path):
        return _static_call(reading, tree, ".".join(path), name)
    if name in _TYPE_TESTS:
        return _report_cast(reading, tree)
    owner = parse_expression(reading, select_trees(tree.children)[0])
    return _function_call(reading, tree, str(name), name, (owner, *parse_expressions(reading, tree)))


def _parse_static_call(reading: FileReading, tree: Tree[Token]) -> Expression:
    """Parse a static call of Java, such as `Math::max(a, b)`."""
    cls, name = select_tokens(tree.children)
    return _static_call(reading, tree, str(cls), name)


def _static_call(reading: FileReading, tree: Tree[Token], cls: str, name: Token) -> Expression:
    """Return a call of the built-in equivalent of a static Java method, or of a function that the file must declare."""
    reading.used_names.add(cls.rpartition(".")[2])
    ours = builtin_function_for(cls, str(name))
    return _function_call(
        reading, tree, ours or str(name), name, parse_expressions(reading, tree), owner=None if ours else cls
    )


def _function_call(
    reading: FileReading,
    tree: Tree[Token],
    function: str,
    name: Token,
    arguments: tuple[Expression, ...],
    owner: str | None = None,
) -> Expression:
    span = reading.span(tree)
    if owner is None and function in OPERATOR_METHODS and len(arguments) == 2:
        return Binary(OPERATOR_METHODS[function], arguments[0], arguments[1], span)
    return FunctionCall(function, arguments, span, function_span=reading.span(name), owner=owner)


def _is_java_class(reading: FileReading, path: Sequence[str]) -> bool:
    """Return True if a path such as `a.b.C` begins with a known or imported Java class, or is a full class name."""
    if not path:
        return False
    full = path[0] in JAVA_DOMAINS and any(one[0].isupper() for one in path[1:])
    return full or path[0] in JAVA_CLASSES or path[0] in reading.java_imports


def _path_names(tree: Tree[Token]) -> list[str]:
    """Return the names of a path such as `a.b.c`; an empty list if the tree is not a path."""
    names: list[str] = []
    while tree.data == "navigation":
        names += select_tokens(tree.children)
        tree = select_trees(tree.children)[0]
    names += select_tokens(tree.children)
    return list(map(str, reversed(names))) if tree.data == "variable" else []


def _parse_cast(reading: FileReading, tree: Tree[Token]) -> Expression:
    """Parse `x as Integer` as `toInt(x)` and `x as Boolean` as `x == true`; report a cast to a class and return `x`."""
    name = select_tokens(tree.children)[0]
    inner = parse_expression(reading, select_trees(tree.children)[0])
    span = reading.span(tree)
    type_ = JAVA_TYPES.get(name) or (type_name(ECORE_TYPES[name].type) if name in ECORE_TYPES else str(name))
    if type_ == "bool":
        return Binary("==", inner, Constant(True, reading.span(name)), span)
    if type_ in CAST_FUNCTIONS:
        return FunctionCall(CAST_FUNCTIONS[type_], (inner,), span, function_span=reading.span(name))
    return _report_cast(reading, tree)


def _report_cast(reading: FileReading, tree: Tree[Token]) -> Expression:
    """Report a cast to a class or a type test (`x as Ship`, `x instanceof Ship`), and return the expression `x`."""
    inner, *arguments = select_trees(tree.children)
    cls = reading.text(arguments[0]) if arguments else select_tokens(tree.children)[0]
    what = "casts to classes" if tree.data == "cast" else "type tests"
    hint = f"write a condition outside of the expression: `{cls}({reading.text(inner)})`"
    reading.error("cast", f"{what} are not allowed in expressions", tree, hint)
    reading.record_gap(tree)
    return parse_expression(reading, inner)


def _parse_function_call(reading: FileReading, tree: Tree[Token]) -> FunctionCall:
    name = select_tokens(tree.children)[0]
    arguments = parse_expressions(reading, tree)
    return FunctionCall(str(name), arguments, reading.span(tree), function_span=reading.span(name))


def _parse_unary(reading: FileReading, tree: Tree[Token]) -> Expression:
    operator = select_tokens(tree.children)[0]
    inner = select_trees(tree.children)[0]
    if operator == "-" and inner.data == "number":
        return parse_literal(reading, inner, operator)
    return Unary(str(operator), parse_expression(reading, inner), reading.span(tree))


def _parse_binary(reading: FileReading, tree: Tree[Token]) -> Expression:
    left, operator = select_trees(tree.children)[0], select_tokens(tree.children)[0]
    if (
        precedence_of(operator) == ORDERINGS
        and left.data == "binary"
        and precedence_of(str(left.children[1])) == ORDERINGS
    ):
        return _parse_chained_comparison(reading, tree)
    parts = [tree]
    while continues_chain(select_trees(parts[-1].children)[0], parts[-1]):
        parts += select_trees(parts[-1].children)[:1]
    found = parse_expression(reading, select_trees(parts[-1].children)[0])
    for part in reversed(parts):
        right = parse_expression(reading, select_trees(part.children)[1])
        found = Binary(_check_operator(reading, select_tokens(part.children)[0]), found, right, reading.span(part))
    return found


def _check_operator(reading: FileReading, token: Token) -> str:
    """Return the operator that a token means; report `=`, `and` and `or`, which mean `==`, `&&` and `||`."""
    meant = MEANT_OPERATORS.get(token, str(token))
    if token in _REFUSED_OPERATORS:
        what = "is not a comparison" if token == "=" else "is not an operator"
        hint = ReplacementHint(f"write `{meant}`", str(token), meant)
        reading.error("unexpected-token", f"`{token}` {what}", token, hint)
    return meant


def _parse_chained_comparison(reading: FileReading, tree: Tree[Token]) -> Binary:
    """Report the chained comparison `a < b < c` and return the expression `a < b && b < c`."""
    left, right = select_trees(tree.children)
    operator = select_tokens(tree.children)[0]
    middle = select_trees(left.children)[1]
    hint = f"write `{reading.text(left)} && {reading.text(middle)} {operator} {reading.text(right)}`"
    reading.error("chained-comparison", "comparisons cannot be chained", operator, hint)
    last = Binary(
        str(operator), parse_expression(reading, middle), parse_expression(reading, right), reading.span(tree)
    )
    return Binary("&&", parse_expression(reading, left), last, reading.span(tree))


def _parse_conditional(reading: FileReading, tree: Tree[Token]) -> Conditional:
    test, then, otherwise = (parse_expression(reading, part) for part in select_trees(tree.children))
    return Conditional(test, then, otherwise, reading.span(tree))


_PARSERS: Mapping[str, Callable[[FileReading, Tree[Token]], Expression]] = {
    "variable": _parse_variable_or_null,
    "number": parse_literal,
    "string": parse_literal,
    "true": parse_literal,
    "false": parse_literal,
    "none": parse_literal,
    "enum_literal": parse_enum_or_java_constant,
    "aliased_literal": parse_enum_or_java_constant,
    "group": _parse_group,
    "navigation": _parse_navigation,
    "method": _parse_method_call,
    "static_method": _parse_static_call,
    "cast": _parse_cast,
    "instance_test": _report_cast,
    "function": _parse_function_call,
    "unary": _parse_unary,
    "binary": _parse_binary,
    "conditional": _parse_conditional,
    "if_else": _parse_conditional,
}
