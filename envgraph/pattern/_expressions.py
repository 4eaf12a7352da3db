"""Types of expressions, and what can be wrong with them.

The language, the same in check, eval, set and rewards:

- ints are exact, floats finite; `+ - *` of an int and a float give a float.
- `/` of two ints truncates toward zero and `%` takes the sign of its left side (both as in Java and VIATRA; `mod`
  takes the sign of the divisor). With a float, `/` is the ordinary quotient.
- `+` concatenates as soon as one side is a string: `"p" + (n + 1)`. Floats read as in Python, truth values as `true`
  and `false`, enum literals as their names.
- `== !=` compare values of one type (an int with a float, too), or objects; `< <= > >=` numbers or strings.
- `&& || !` take truth values; `test ? a : b` evaluates one branch, and both have one type.
- `x.f.g` follows single-valued features of the static type; `x.f == none` asks whether the path leads nowhere.
- The functions are those of `FUNCTIONS`, and those that are declared: `FunctionDeclaration`.
- Division by zero, a function outside its domain, a float that is not finite, an int result beyond 64 bits: no value.
  In a check this is false, in an eval the body does not match (VIATRA does the same, and logs it); elsewhere it is an
  `EvaluationError`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from envgraph.errors import MOST_NESTED, Diagnostic, Span, did_you_mean, name_hint, with_article
from envgraph.metamodel import Attribute, EnumType, Metamodel, Reference, Scalar
from envgraph.pattern._bodies import children, depth, none_test, size
from envgraph.pattern._lowered import ObjectType, StaticType
from envgraph.pattern._operations import FUNCTIONS, Function
from envgraph.pattern._terms import (
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
from envgraph.pattern._types import NUMBERS, assignable, comparable, type_text, value_hint, value_type

if TYPE_CHECKING:
    from envgraph.pattern._functions import DeclaredFunction

MOST_PARTS: Final = 50_000
"""How many operands and operators an expression may have: ints in it are exact, and grow with every product."""


def check_expression(
    expression: Expression,
    scope: Mapping[str, StaticType | None],
    metamodel: Metamodel,
    *,
    expected: StaticType | None = None,
    bare_objects: bool = True,
) -> tuple[StaticType | None, list[Diagnostic]]:
    """The static type of an expression and all that is wrong with it.

    Args:
        expression: the expression.
        scope: type of every variable; None for one whose type is unknown because of an error reported elsewhere.
        metamodel: what classes and features mean.
        expected: the type that the place asks for: tells what `::literal` means, and another type is an error.
        bare_objects: whether an object variable may stand alone, as in `set x.ref = y`; not so in check and eval.

    Returns:
        The type, None where it is unknown or the expression is `none`; and the diagnostics.
    """
    found = _too_large(expression)
    if found:
        hint = "compute a part of it with `v == eval(..)` first"
        return None, [_problem("expression-too-deep", found, expression, hint)]
    checker = ExpressionChecker(scope, metamodel, bare_objects)
    type_ = checker.type_of(expression, expected)
    if type_ and expected and not checker.problems and not assignable(type_, expected, metamodel):
        checker.problems.append(wrong_type(expression, type_, expected))
    return type_, checker.problems


def _too_large(expression: Expression) -> str | None:
    if depth(expression) > MOST_NESTED:
        return f"more than {MOST_NESTED} levels inside each other"
    return f"more than {MOST_PARTS} operands and operators" if size(expression) > MOST_PARTS else None


def wrong_type(expression: Expression, type_: StaticType, expected: StaticType) -> Diagnostic:
    """The diagnostic for an expression of one type where another is expected."""
    hint = None
    if (
        isinstance(expected, EnumType)
        and isinstance(expression, Constant)
        and isinstance(expression.value, str)
    ):
        hint = enum_hint(expression.value, expected)
    elif expected is Scalar.INT and type_ is Scalar.FLOAT:
        hint = "`round`, `floor` or `toInt` make an int of it"
    hint = hint or value_hint(expected, None if isinstance(expression, Constant) else type_)
    message = f"expected `{type_text(expected)}`, found `{type_text(type_)}`"
    return _problem("wrong-type", message, expression, hint)


def enum_hint(written: str, enum: EnumType) -> str | None:
    """How to write the literal of an enum that someone wrote as a string."""
    near = did_you_mean(written, enum.literals)
    return near.replace("`", f"`{enum.name}::", 1) if near else None


def _problem(code: str, message: str, expression: Expression, hint: str | None = None) -> Diagnostic:
    return Diagnostic(code, message, expression.span, hint)


class ExpressionChecker:
    """Finds the type of one expression; collects `problems`, at most one for each mistake."""

    def __init__(
        self, scope: Mapping[str, StaticType | None], metamodel: Metamodel, bare_objects: bool
    ) -> None:
        self.scope = scope
        self.metamodel = metamodel
        self.bare_objects = bare_objects
        self.problems: list[Diagnostic] = []

    def _report(
        self, code: str, message: str, node: Expression, hint: str | None = None, *subject: str
    ) -> None:
        self.problems.append(Diagnostic(code, message, node.span, hint, subject=subject))

    def type_of(self, node: Expression, expected: StaticType | None = None) -> StaticType | None:
        """The type, or None where it is unknown; then the reason has been reported, unless it is `none`."""
        match node:
            case Variable():
                return self._variable(node, expected)
            case Constant():
                return None if node.value is None else value_type(node.value)
            case EnumLiteral():
                return self.literal(node, expected)
            case Navigation():
                return self._navigation(node)
            case Unary():
                return self._unary(node)
            case Binary():
                return self._binary(node)
            case Conditional():
                return self._conditional(node, expected)
            case FunctionCall():
                return self._call(node)

    def _variable(self, node: Variable, expected: StaticType | None) -> StaticType | None:
        if node.anonymous:
            self._report("unknown-variable", "`_` has no value", node, "give the variable a name")
            return None
        if node.name not in self.scope:
            if isinstance(expected, EnumType) and node.name in expected.literals:
                hint = f"write `::{node.name}` for the literal"
            else:
                hint = name_hint(node.name, self.scope) or "no variable is known here"
            self._report("unknown-variable", f"unknown variable `{node.name}`", node, hint, node.name)
            return None
        type_ = self.scope[node.name]
        if isinstance(type_, ObjectType) and not self.bare_objects:
            message = f"`{node.name}` is an object, {with_article(type_.cls)}, where only data can stand"
            self._report("bare-object", message, node, self._bare_hint(node.name, type_))
            return None
        return type_

    def _is_object(self, node: Expression) -> bool:
        return isinstance(node, Variable) and isinstance(self.scope.get(node.name), ObjectType)

    def _bare_hint(self, name: str, type_: ObjectType) -> str:
        feature = next(iter(self.metamodel.features(type_.cls)), None)
        attribute = f"a feature such as `{name}.{feature}`" if feature else "a feature of it"
        return f"use {attribute}; objects are compared by `==` and `!=` outside of check and eval"

    def literal(self, node: EnumLiteral, expected: StaticType | None) -> StaticType | None:
        """The enum of a literal; `::literal` takes the one that the place expects."""
        enum: EnumType | None
        if node.enum is not None:
            enum = self.metamodel.enums.get(node.enum)
            if enum is None:
                hint = name_hint(node.enum, self.metamodel.enums)
                self._at("unknown-enum", f"unknown enum `{node.enum}`", node.enum_span or node.span, hint)
                return None
        elif isinstance(expected, EnumType):
            enum = expected
        else:
            self._report("unknown-enum", *self._no_enum(node, expected))
            return None
        if node.literal not in enum.literals:
            message = f"enum `{enum.name}` has no literal `{node.literal}`"
            span = node.literal_span or node.span
            self._at("unknown-literal", message, span, name_hint(node.literal, enum.literals))
            return None
        return enum

    def _no_enum(self, node: EnumLiteral, expected: StaticType | None) -> tuple[str, Expression, str | None]:
        owners = [enum.name for enum in self.metamodel.enum_types if node.literal in enum.literals]
        hint = f"write `{owners[0]}::{node.literal}`" if owners else None
        if expected is None:
            return f"the enum of `::{node.literal}` is not known here", node, hint
        return (
            f"expected `{type_text(expected)}`, found the enum literal `::{node.literal}`",
            node,
            value_hint(expected),
        )

    def _at(self, code: str, message: str, span: Span | None, hint: str | None) -> None:
        self.problems.append(Diagnostic(code, message, span, hint))

    def _navigation(self, node: Navigation) -> StaticType | None:
        # The start of a path is the one place where an object variable may stand in a check.
        if isinstance(node.object, Variable) and not node.object.anonymous and node.object.name in self.scope:
            owner = self.scope[node.object.name]
        else:
            owner = self.type_of(node.object)
        if owner is None:
            return None
        span = node.feature_span or node.span
        if is_method(node, owner):
            return FUNCTIONS[node.feature].result
        if not isinstance(owner, ObjectType):
            message = f"{with_article(type_text(owner))} has no features"
            self._at("unknown-feature", message, span, "leave the feature out: only objects have features")
            return None
        feature = self.metamodel.feature(owner.cls, node.feature)
        if feature is None:
            hint = self.metamodel.left_out(owner.cls, node.feature)
            hint = hint or did_you_mean(node.feature, self.metamodel.features(owner.cls))
            hint = hint or subclass_hint(owner.cls, node.feature, self.metamodel)
            hint = hint or name_hint(node.feature, self.metamodel.features(owner.cls))
            self._at("unknown-feature", f"`{owner.cls}` has no feature `{node.feature}`", span, hint)
            return None
        if feature.many:
            what, end = ("value", "value") if isinstance(feature, Attribute) else ("object", "target")
            hint = f"use a constraint: `{owner.cls}.{feature.name}(.., {end})`, or an aggregate over it"
            self._at("many-valued", f"`{feature}` leads to more than one {what}", span, hint)
            return None
        return ObjectType(feature.target) if isinstance(feature, Reference) else feature.type

    def _unary(self, node: Unary) -> StaticType | None:
        wanted = "bool" if node.operator == "!" else "number"
        type_ = self._operand(node.operand, node.operator, wanted)
        return Scalar.BOOL if node.operator == "!" else type_

    def _operand(
        self, node: Expression, what: str, wanted: str, expected: StaticType | None = None
    ) -> StaticType | None:
        """The type of an operand that has to be of a kind."""
        return self._of_kind(node, self.type_of(node, expected), what, wanted)

    def _of_kind(
        self, node: Expression, type_: StaticType | None, what: str, wanted: str
    ) -> StaticType | None:
        """The type of an operand, if it is of a kind; else None, and that is reported."""
        if _is_none(node):
            advice = "`none` can be compared with a path: `x.f == none`"
            self._report("operand-type", f"`{what}` does not take `none`", node, advice)
        elif type_ is not None and not _is_kind(type_, wanted):
            hint = None
            if isinstance(type_, ObjectType):
                hint = f"use an attribute of `{type_.cls}`"
            elif wanted == "bool" and type_ in NUMBERS:
                hint = "compare it: `.. != 0`"
            elif wanted in {"number", "int"}:
                hint = value_hint(Scalar.INT, type_)
            elif wanted == "string":
                hint = value_hint(Scalar.STRING, type_)
            elif wanted == "bool":
                hint = "compare it: `.. == ..`"
            message = f"`{what}` takes {_KINDS[wanted]}, not `{type_text(type_)}`"
            self._report("operand-type", message, node, hint)
        else:
            return type_
        return None

    def _binary(self, node: Binary) -> StaticType | None:
        match node.operator:
            case "&&" | "||":
                for part in children(node):
                    self._operand(part, node.operator, "bool")
                return Scalar.BOOL
            case "==" | "!=":
                self._equality(node)
                return Scalar.BOOL
            case "<" | "<=" | ">" | ">=":
                self._ordering(node)
                return Scalar.BOOL
            case _:
                return self._arithmetic(node)

    def _arithmetic(self, node: Binary) -> StaticType | None:
        """The type of `a + b - c` and the like; what is left of an operator has the type found so far."""
        first, links = node.chain()
        type_ = self._operand(first, links[0].operator, "data" if links[0].operator == "+" else "number")
        for link in links:
            if link.operator == "+":
                type_ = self._sum(link, type_, self._operand(link.right, "+", "data"))
                continue
            if link is not links[0]:
                type_ = self._of_kind(link.left, type_, link.operator, "number")
            divisor = self._operand(link.right, link.operator, "number")
            if link.operator in "/%" and isinstance(link.right, Constant) and link.right.value == 0:
                advice = "this never has a value: divide by another number"
                self._report("division-by-zero", "division by zero", link.right, advice)
            type_ = _number(type_, divisor)
        return type_

    def _sum(self, node: Binary, left: StaticType | None, right: StaticType | None) -> StaticType | None:
        if Scalar.STRING in (left, right):
            return Scalar.STRING
        for side, type_ in ((node.left, left), (node.right, right)):
            if type_ is not None and type_ not in NUMBERS:
                message = f"`+` adds numbers or strings, not `{type_text(type_)}`"
                hint = "`toString(..)` makes a string of a value"
                if isinstance(type_, ObjectType):
                    hint = f"use an attribute of `{type_.cls}`"
                self._report("operand-type", message, side, hint)
                return None
        return _number(left, right)

    def _ordering(self, node: Binary) -> None:
        left = self._operand(node.left, node.operator, "ordered")
        right = self._operand(node.right, node.operator, "ordered")
        if left and right and (left in NUMBERS) != (right in NUMBERS):
            message = f"`{node.operator}` cannot compare `{type_text(left)}` with `{type_text(right)}`"
            self._report("operand-type", message, node, "compare two numbers, or two strings")

    def _equality(self, node: Binary) -> None:
        if _is_none(node.left) or _is_none(node.right):
            self._none_test(node)
            return
        if not self.bare_objects and self._is_object(node.left) and self._is_object(node.right):
            advice = "compare the objects in a constraint of its own, outside of check and eval"
            self._report("bare-object", "two objects are compared where only data can stand", node, advice)
            return
        left, right = self._sides(node)
        if left is None or right is None:
            return
        if not comparable(left, right, self.metamodel):
            hint = None
            for side, other in ((node.left, right), (node.right, left)):
                if isinstance(side, Constant) and isinstance(side.value, str) and isinstance(other, EnumType):
                    hint = enum_hint(side.value, other) or value_hint(other)
            hint = hint or f"compare {with_article(type_text(left))} with another one"
            message = f"`{node.operator}` cannot compare `{type_text(left)}` with `{type_text(right)}`"
            self._report("operand-type", message, node, hint)

    def _sides(self, node: Binary) -> tuple[StaticType | None, StaticType | None]:
        """Types of both sides; `::literal` on one side takes its enum from the other."""
        left, right = node.left, node.right
        if _is_bare_literal(left) and _is_bare_literal(right):
            return self.type_of(left), None
        if _is_bare_literal(left):
            other = self.type_of(right)
            return self.type_of(left, other) if other else None, other
        other = self.type_of(left)
        if _is_bare_literal(right):
            return other, self.type_of(right, other) if other else None
        return other, self.type_of(right, other if isinstance(right, Variable) else None)

    def _none_test(self, node: Binary) -> None:
        path = none_test(node)
        if path is not None:
            self.type_of(path)
            return
        side = node.right if _is_none(node.left) else node.left
        if self.type_of(side) is not None or _is_none(side) or not self.problems:
            hint = "only a path can be `none`: `x.f == none`"
            self._report("none-test", "this has a value in every match", side, hint)

    def _conditional(self, node: Conditional, expected: StaticType | None) -> StaticType | None:
        self._operand(node.test, "?:", "bool")
        first, second = node.then, node.otherwise
        if _is_none(first) or _is_none(second):
            return self._optional(node, second if _is_none(first) else first, expected)
        if _is_bare_literal(first) and _is_bare_literal(second) and expected is None:
            return self.type_of(first)
        if _is_bare_literal(first) and expected is None:
            otherwise = self.type_of(second)
            then = self.type_of(first, otherwise)
        else:
            then = self.type_of(first, expected)
            otherwise = self.type_of(second, expected or then)
        if then is None or otherwise is None:
            return None
        if then == otherwise:
            return then
        if isinstance(then, ObjectType) and isinstance(otherwise, ObjectType):
            return self._common_class(node, then, otherwise)
        hint = None
        if {then, otherwise} == set(NUMBERS):
            # Silently promoting would make the type of a value depend on the branch taken: `1 / 2` or `1.0 / 2`.
            hint = "write the int as a float (`1.0`), or use `toFloat`"
        message = f"the branches of `?:` are `{type_text(then)}` and `{type_text(otherwise)}`"
        self._report("operand-type", message, node, hint)
        return None

    def _optional(
        self, node: Conditional, branch: Expression, expected: StaticType | None
    ) -> StaticType | None:
        """`test ? x : none`, which a rule may store and a query cannot use."""
        if not self.bare_objects:
            self._report(
                "operand-type", "`none` is no value in a query", node, "put the test into a check of its own"
            )
            return None
        return self.type_of(branch, expected)

    def _common_class(self, node: Conditional, then: ObjectType, otherwise: ObjectType) -> StaticType | None:
        above = [
            name for name in self.metamodel.supertypes(then.cls) if self.metamodel.is_a(otherwise.cls, name)
        ]
        if above:
            return ObjectType(above[0])
        self._report(
            "operand-type",
            f"`{then.cls}` and `{otherwise.cls}` have no common superclass",
            node,
            "read an attribute of each instead",
        )
        return None

    def _call(self, node: FunctionCall) -> StaticType | None:
        if node.declaration is not None:
            return self._declared(node, node.declaration)
        function = FUNCTIONS.get(node.function) if node.owner is None else None
        if function is None:
            self._unknown_function(node)
            return None
        if not function.accepts_count(len(node.arguments)):
            message = f"`{function.name}` does not take {len(node.arguments)} arguments"
            self._report("wrong-arity", message, node, f"write `{function.signature}`")
            return function.result
        types = [
            self._operand(argument, function.name, function.parameter(position))
            for position, argument in enumerate(node.arguments)
        ]
        return function.result or _common_number(function, types)

    def _unknown_function(self, node: FunctionCall) -> None:
        span = node.function_span or node.span
        declare = self._declaring(node)
        if node.owner is not None:
            if node.function in FUNCTIONS:
                declare = f"write `{FUNCTIONS[node.function].signature}` if that is meant"
            message = f"`{node.owner}.{node.function}` is a function of Java"
            self._at("java-call", message, span, declare)
            return
        hint = self._getter_hint(node) or _OF_JAVA.get(node.function)
        hint = hint or did_you_mean(node.function, {**(node.declared or {}), **FUNCTIONS})
        self._at("unknown-function", f"unknown function `{node.function}`", span, hint or declare)

    def _declaring(self, node: FunctionCall) -> str:
        """How to declare a function for a call."""
        known, parameters = len(self.problems), []
        for number, argument in enumerate(node.arguments):
            type_ = self.type_of(argument)
            if self._is_object(argument) or isinstance(type_, ObjectType):
                del self.problems[known:]
                return "declare a function, which takes values: pass features of the object"
            name = argument.name if isinstance(argument, Variable) else f"{'abcdefgh'[number % 8]}"
            name = argument.feature if isinstance(argument, Navigation) else name
            parameters.append(f"{name} : {type_text(type_) if type_ else 'int'}")
        del self.problems[known:]
        declaration = f"function {node.function}({', '.join(parameters)}) : T;"
        return f"declare it with its types, `{declaration}`, and give the engine its code"

    def _declared(self, node: FunctionCall, function: DeclaredFunction) -> StaticType | None:
        """The type of a call of a declared function, which takes values of the types that it says."""
        if function.result is None:
            for argument in node.arguments:
                self.type_of(argument)
            return None
        if len(node.arguments) != len(function.parameters):
            message = f"`{function.name}` does not take {len(node.arguments)} arguments"
            hint = f"it is declared as `{function.declaration.signature}`"
            self._report("wrong-arity", message, node, hint)
            return function.result
        for argument, parameter in zip(node.arguments, function.parameters, strict=True):
            type_ = self._operand(argument, function.name, "data", parameter)
            if type_ is not None and not assignable(type_, parameter, self.metamodel):
                self.problems.append(wrong_type(argument, type_, parameter))
        return function.result

    def _getter_hint(self, node: FunctionCall) -> str | None:
        """For `x.getLength()` of Java: the feature `x.length`."""
        owner = node.arguments[0] if len(node.arguments) == 1 else None
        type_ = self.scope.get(owner.name) if isinstance(owner, Variable) else None
        if not isinstance(owner, Variable) or not isinstance(type_, ObjectType):
            return None
        name = re.sub("^(get|is)(?=[A-Z])", "", node.function)
        feature = name[:1].lower() + name[1:]
        known = feature in self.metamodel.features(type_.cls)
        return f"write `{owner.name}.{feature}`" if known else None


_KINDS: Final[Mapping[str, str]] = {
    "bool": "truth values",
    "number": "numbers",
    "int": "an int",
    "string": "strings",
    "data": "data",
    "ordered": "numbers or strings",
}


_OF_JAVA: Final[Mapping[str, str]] = {
    "equalsIgnoreCase": "write `toLower(a) == toLower(b)`",
    "compareTo": "write `a < b`, `a == b` or `a > b`",
    "matches": "there are no regular expressions, but `startsWith`, `endsWith`, `contains` and `indexOf`",
    "valueOf": "write `toInt(x)`, `toFloat(x)` or `toString(x)`",
    "parseInt": "write `toInt(x)`",
    "charAt": "write `substring(text, i, i + 1)`",
    "size": "write `n == count Type.feature(x, _);` outside of the expression",
}
"""What to write for methods of Java."""


def is_method(node: Navigation, owner: StaticType | None) -> bool:
    """Whether `text.length` is the function of a string, without its brackets."""
    function = FUNCTIONS.get(node.feature)
    return owner is Scalar.STRING and function is not None and function.parameters == ("string",)


def _is_none(node: Expression) -> bool:
    return isinstance(node, Constant) and node.value is None


def _is_bare_literal(node: Expression) -> bool:
    """Whether this is `::literal`, whose enum the place has to tell."""
    return isinstance(node, EnumLiteral) and node.enum is None


def _is_kind(type_: StaticType, kind: str) -> bool:
    match kind:
        case "bool":
            return type_ is Scalar.BOOL
        case "number":
            return type_ in NUMBERS
        case "int":
            return type_ is Scalar.INT
        case "string":
            return type_ is Scalar.STRING
        case "ordered":
            return type_ in NUMBERS or type_ is Scalar.STRING
        case _:
            return not isinstance(type_, ObjectType)


def _number(left: StaticType | None, right: StaticType | None) -> StaticType | None:
    if left is None or right is None:
        return None
    return Scalar.FLOAT if Scalar.FLOAT in (left, right) else Scalar.INT


def _common_number(function: Function, types: list[StaticType | None]) -> StaticType | None:
    if any(type_ is None for type_ in types):
        return None
    return Scalar.FLOAT if Scalar.FLOAT in types else Scalar.INT


def subclass_hint(cls: str, feature: str, metamodel: Metamodel) -> str | None:
    """A hint when it is a subclass that has the feature."""
    for sub in metamodel.class_list:
        if any(own.name == feature for own in sub.features) and metamodel.is_a(sub.name, cls):
            return f"its subclass `{sub.name}` has one: constrain the object with `{sub.name}(..)`"
    return None
