"""Parse the syntax trees of expressions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from lark import Token, Tree

from envgraph.errors import (
    name_hint,
    nearest,
)
from envgraph.lang.read._ecore_types import ECORE_TYPES
from envgraph.lang.read._java import (
    CASTS,
    CONSTANTS,
    JAVA_CLASSES,
    JAVA_DOMAINS,
    JAVA_TYPES,
    OPERATORS,
    function_of,
)
from envgraph.lang.read._reading import Reading, type_named
from envgraph.lang.syntax._parsing import (
    MEANT,
    ORDERINGS,
    follows,
    level_of,
    number_of,
    tokens,
    trees,
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

_WORDS: Mapping[str, bool | None] = {"true": True, "false": False, "none": None}
_TYPE_TESTS = frozenset({"isInstanceOf", "oclIsKindOf", "oclIsTypeOf", "oclAsType"})
_REFUSED = frozenset({"=", "and", "or"})


def variable_of(reading: Reading, token: Token) -> Variable:
    """Return a `Variable` with the text and the span of a name token."""
    return Variable(str(token), reading.span(token))


def value_of(reading: Reading, tree: Tree[Token]) -> Expression | tuple[Expression, ...]:
    """Parse the right side of an assignment to a feature: an expression, or a tuple of expressions for a list."""
    if tree.data == "list":
        return expressions_of(reading, tree)
    return expression_of(reading, tree)


def expressions_of(reading: Reading, tree: Tree[Token]) -> tuple[Expression, ...]:
    """Parse the expressions in the `expression_list` of a tree; return an empty tuple if the tree has no such list."""
    return tuple(
        expression_of(reading, item)
        for part in trees(tree.children, "expression_list")
        for item in trees(part.children)
    )


def expression_of(reading: Reading, tree: Tree[Token]) -> Expression:
    """Parse an expression; report errors in it and return the most similar valid expression."""
    return _READERS[tree.data](reading, tree)


def literal_of(reading: Reading, tree: Tree[Token], sign: Token | None = None) -> Constant:
    """Parse a string, boolean, `none`, or number (negated if `sign` is given); report a sign before other values."""
    if sign is not None and tree.data != "number":
        reading.error("unexpected-sign", "only a number can have a sign", sign, "remove the `-`")
        sign = None
    value: Value | None = _WORDS[tree.data] if tree.data in _WORDS else str(tree.children[0])
    if tree.data == "number":
        number = number_of(tokens(tree.children)[0])
        value = number if sign is None else -number
    span = reading.span(tree)
    return Constant(value, span if sign is None else reading.span(sign).to(span))


def enum_literal_of(reading: Reading, tree: Tree[Token]) -> EnumLiteral:
    """Parse an enum literal: `Enum::literal`, `::literal` (its enum is None) or `alias::Enum::literal`."""
    parts = tokens(tree.children)
    alias = None
    if tree.data == "aliased_literal":
        alias = parts.pop(0)
        reading.alias(alias)
    *enum, literal = parts
    return EnumLiteral(
        type_named(reading, str(enum[0]), alias, tree, enums=True) if enum else None,
        str(literal),
        reading.span(tree),
        enum_span=reading.span(enum[0]) if enum else None,
        literal_span=reading.span(literal),
    )


def constant_of(reading: Reading, tree: Tree[Token]) -> EnumLiteral | Constant:
    """Parse an enum literal, or a Java constant such as `Integer::MAX_VALUE`, whose number or boolean is returned."""
    parts = tuple(map(str, tokens(tree.children)))
    if len(parts) == 2 and parts in CONSTANTS and parts[0] not in reading.aliases:
        return Constant(CONSTANTS[parts], reading.span(tree))
    return enum_literal_of(reading, tree)


def _variable(reading: Reading, tree: Tree[Token]) -> Variable | Constant:
    name = tokens(tree.children)[0]
    if name == "null":
        reading.error("unexpected-token", "`null` is not a value of this language", name, "write `none`")
        return Constant(None, reading.span(name))
    return variable_of(reading, name)


def dotted_literal(reading: Reading, owner: str, feature: Token, tree: Tree[Token]) -> EnumLiteral | None:
    """Report `Way.west` and return the literal `Way::west`; return None, without a report, if `owner` is no enum."""
    metamodel = reading.types.metamodel if reading.types else None
    enum = metamodel.enums.get(owner) if metamodel else None
    if enum is None:
        return None
    meant = nearest(feature, enum.literals)
    literal = str(feature) if meant is None or feature in enum.literals else meant
    hint = f"write `{owner}::{literal}`" if meant else name_hint(feature, enum.literals)
    reading.error("unexpected-token", f"a literal of the enum `{owner}` is written with `::`", tree, hint)
    if not meant:
        reading.gap(tree)
    return EnumLiteral(owner, literal, reading.span(tree), literal_span=reading.span(feature))


def _group(reading: Reading, tree: Tree[Token]) -> Expression:
    inner = expression_of(reading, trees(tree.children)[0])
    # The span includes the parentheses, so that the markers under an operand of `&&` cover both of them.
    return (
        replace(inner, span=reading.span(tree)) if isinstance(inner, Binary | Conditional | Unary) else inner
    )


def _navigation(reading: Reading, tree: Tree[Token]) -> Navigation | Constant | EnumLiteral:
    feature = tokens(tree.children)[0]
    path = _steps(trees(tree.children)[0])
    literal = dotted_literal(reading, path[0], feature, tree) if len(path) == 1 else None
    if literal is not None:
        return literal
    if len(path) == 1 and (path[0], str(feature)) in CONSTANTS:
        return Constant(CONSTANTS[path[0], str(feature)], reading.span(tree))
    if _is_java(reading, path) and (len(path) > 1 or path[0] in reading.java or feature.isupper()):
        cls = ".".join(path)
        reading.used.add(path[-1])
        hint = "write its value, or declare a function for it: `function name() : int;`"
        reading.error("java-call", f"the Java constant `{cls}.{feature}` is not available", tree, hint)
        reading.gap(tree)
    owner = expression_of(reading, trees(tree.children)[0])
    return Navigation(owner, str(feature), reading.span(tree), feature_span=reading.span(feature))


def _method(reading: Reading, tree: Tree[Token]) -> Expression:
    """Parse a method call `text.startsWith("a")` as `startsWith(text, "a")`; `Math.max(a, b)` is a static Java call."""
    name = tokens(tree.children)[0]
    path = _steps(trees(tree.children)[0])
    if _is_java(reading, path):
        return _static(reading, tree, ".".join(path), name)
    if name in _TYPE_TESTS:
        return _no_cast(reading, tree)
    owner = expression_of(reading, trees(tree.children)[0])
    return _called(reading, tree, str(name), name, (owner, *expressions_of(reading, tree)))


def _static_method(reading: Reading, tree: Tree[Token]) -> Expression:
    """Parse a static call of Java, such as `Math::max(a, b)`."""
    cls, name = tokens(tree.children)
    return _static(reading, tree, str(cls), name)


def _static(reading: Reading, tree: Tree[Token], cls: str, name: Token) -> Expression:
    """Return a call of the built-in equivalent of a static Java method, or of a function that the file must declare."""
    reading.used.add(cls.rpartition(".")[2])
    ours = function_of(cls, str(name))
    return _called(
        reading, tree, ours or str(name), name, expressions_of(reading, tree), owner=None if ours else cls
    )


def _called(
    reading: Reading,
    tree: Tree[Token],
    function: str,
    name: Token,
    arguments: tuple[Expression, ...],
    owner: str | None = None,
) -> Expression:
    span = reading.span(tree)
    if owner is None and function in OPERATORS and len(arguments) == 2:
        return Binary(OPERATORS[function], arguments[0], arguments[1], span)
    return FunctionCall(function, arguments, span, function_span=reading.span(name), owner=owner)


def _is_java(reading: Reading, path: Sequence[str]) -> bool:
    """Return True if a path such as `a.b.C` begins with a known or imported Java class, or is a full class name."""
    if not path:
        return False
    full = path[0] in JAVA_DOMAINS and any(one[0].isupper() for one in path[1:])
    return full or path[0] in JAVA_CLASSES or path[0] in reading.java


def _steps(tree: Tree[Token]) -> list[str]:
    """Return the names of a path such as `a.b.c`; an empty list if the tree is not a path."""
    names: list[str] = []
    while tree.data == "navigation":
        names += tokens(tree.children)
        tree = trees(tree.children)[0]
    names += tokens(tree.children)
    return list(map(str, reversed(names))) if tree.data == "variable" else []


def _cast(reading: Reading, tree: Tree[Token]) -> Expression:
    """Parse `x as Integer` as `toInt(x)` and `x as Boolean` as `x == true`; report a cast to a class and return `x`."""
    name = tokens(tree.children)[0]
    inner = expression_of(reading, trees(tree.children)[0])
    span = reading.span(tree)
    type_ = JAVA_TYPES.get(name) or (type_name(ECORE_TYPES[name].type) if name in ECORE_TYPES else str(name))
    if type_ == "bool":
        return Binary("==", inner, Constant(True, reading.span(name)), span)
    if type_ in CASTS:
        return FunctionCall(CASTS[type_], (inner,), span, function_span=reading.span(name))
    return _no_cast(reading, tree)


def _no_cast(reading: Reading, tree: Tree[Token]) -> Expression:
    """Report a cast to a class or a type test (`x as Ship`, `x instanceof Ship`), and return the expression `x`."""
    inner, *arguments = trees(tree.children)
    cls = reading.text(arguments[0]) if arguments else tokens(tree.children)[0]
    what = "casts to classes" if tree.data == "cast" else "type tests"
    hint = f"write a condition outside of the expression: `{cls}({reading.text(inner)})`"
    reading.error("cast", f"{what} are not allowed in expressions", tree, hint)
    reading.gap(tree)
    return expression_of(reading, inner)


def _function(reading: Reading, tree: Tree[Token]) -> FunctionCall:
    name = tokens(tree.children)[0]
    arguments = expressions_of(reading, tree)
    return FunctionCall(str(name), arguments, reading.span(tree), function_span=reading.span(name))


def _unary(reading: Reading, tree: Tree[Token]) -> Expression:
    operator = tokens(tree.children)[0]
    inner = trees(tree.children)[0]
    if operator == "-" and inner.data == "number":
        return literal_of(reading, inner, operator)
    return Unary(str(operator), expression_of(reading, inner), reading.span(tree))


def _binary(reading: Reading, tree: Tree[Token]) -> Expression:
    left, operator = trees(tree.children)[0], tokens(tree.children)[0]
    if (
        level_of(operator) == ORDERINGS
        and left.data == "binary"
        and level_of(str(left.children[1])) == ORDERINGS
    ):
        return _compared_twice(reading, tree)
    parts = [tree]
    while follows(trees(parts[-1].children)[0], parts[-1]):
        parts += trees(parts[-1].children)[:1]
    found = expression_of(reading, trees(parts[-1].children)[0])
    for part in reversed(parts):
        right = expression_of(reading, trees(part.children)[1])
        found = Binary(_operator(reading, tokens(part.children)[0]), found, right, reading.span(part))
    return found


def _operator(reading: Reading, token: Token) -> str:
    """Return the operator that a token means; report `=`, `and` and `or`, which mean `==`, `&&` and `||`."""
    meant = MEANT.get(token, str(token))
    if token in _REFUSED:
        what = "is not a comparison" if token == "=" else "is not an operator"
        reading.error("unexpected-token", f"`{token}` {what}", token, f"write `{meant}`")
    return meant


def _compared_twice(reading: Reading, tree: Tree[Token]) -> Binary:
    """Report the chained comparison `a < b < c` and return the expression `a < b && b < c`."""
    left, right = trees(tree.children)
    operator = tokens(tree.children)[0]
    middle = trees(left.children)[1]
    hint = f"write `{reading.text(left)} && {reading.text(middle)} {operator} {reading.text(right)}`"
    reading.error("chained-comparison", "comparisons cannot be chained", operator, hint)
    last = Binary(
        str(operator), expression_of(reading, middle), expression_of(reading, right), reading.span(tree)
    )
    return Binary("&&", expression_of(reading, left), last, reading.span(tree))


def _conditional(reading: Reading, tree: Tree[Token]) -> Conditional:
    test, then, otherwise = (expression_of(reading, part) for part in trees(tree.children))
    return Conditional(test, then, otherwise, reading.span(tree))


_READERS: Mapping[str, Callable[[Reading, Tree[Token]], Expression]] = {
    "variable": _variable,
    "number": literal_of,
    "string": literal_of,
    "true": literal_of,
    "false": literal_of,
    "none": literal_of,
    "enum_literal": constant_of,
    "aliased_literal": constant_of,
    "group": _group,
    "navigation": _navigation,
    "method": _method,
    "static_method": _static_method,
    "cast": _cast,
    "instance_test": _no_cast,
    "function": _function,
    "unary": _unary,
    "binary": _binary,
    "conditional": _conditional,
    "if_else": _conditional,
}
