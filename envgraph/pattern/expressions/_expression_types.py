"""Infer the types of expressions and report their errors.

The expression language is the same in check, eval, set and rewards:

- Ints are exact, floats finite. `+ - *` of an int and a float give a float.
- `/` of two ints truncates toward zero and `%` takes the sign of its left side (both as in Java and VIATRA; `mod`
  takes the sign of the divisor). With a float, `/` is the ordinary quotient.
- `+` concatenates as soon as one side is a string: `"p" + (n + 1)`. Floats are written as in Python, truth values as
  `true` and `false`, enum literals as their names.
- `== !=` compare values of one type (an int with a float, too), or objects; `< <= > >=` compare numbers or strings.
- `&& || !` take truth values. `test ? a : b` evaluates one branch, and both branches have one type.
- `x.f.g` follows single-valued features of the static type. `x.f == none` is true if the path has no value.
- Functions are the functions in `FUNCTIONS` and declared functions (`FunctionDeclaration`).
- Division by zero, a function outside its domain, a float that is not finite, and an int result beyond 64 bits have no
  value. Then a check is false, and a body with such an eval does not match (as in VIATRA, which also logs it).
  Elsewhere an `EvaluationError` is raised.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, TypeGuard

from envgraph.errors import LIMITS, MAX_NESTING, Diagnostic, Span, did_you_mean, name_hint, quote_with_article
from envgraph.metamodel import Attribute, EnumType, Metamodel, Reference, Scalar
from envgraph.pattern._expression_data import (
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
from envgraph.pattern._goals import ObjectType, StaticType
from envgraph.pattern._occurrences import children, expression_size, nesting_depth, none_test_path
from envgraph.pattern._types import (
    NUMBERS,
    are_comparable,
    common_number,
    enum_hint,
    is_assignable,
    type_text,
    value_hint,
    value_type,
    wrong_type_error,
)
from envgraph.pattern.expressions._builtin_functions import FUNCTIONS
from envgraph.pattern.expressions._function_calls import JAVA_HINTS, call_type


def check_expression(
    expression: Expression,
    scope: Mapping[str, StaticType | None],
    metamodel: Metamodel,
    *,
    expected: StaticType | None = None,
    bare_objects: bool = True,
) -> tuple[StaticType | None, list[Diagnostic]]:
    """Return the static type of an expression and its diagnostics.

    Args:
        expression: the expression.
        scope: the type of every variable; None if the type is unknown because of an error reported elsewhere.
        metamodel: the metamodel that defines classes and features.
        expected: the type required by the context. It decides the enum of `::literal`, and other types are errors.
        bare_objects: True if an object variable may be a value, as in `set x.ref = y`. False in check and eval.

    Returns:
        The type, None if it is unknown or the expression is `none`; and the diagnostics.
    """
    found = _size_problem(expression)
    if found:
        hint = "compute a part of it with `v == eval(..)` first"
        return None, [Diagnostic("nested-too-deeply", found, expression.span, hint)]
    checker = ExpressionChecker(scope, metamodel, bare_objects)
    type_ = checker.type_of(expression, expected)
    if type_ and expected and not checker.problems and not is_assignable(type_, expected, metamodel):
        checker.problems.append(wrong_type_error(expression, type_, expected))
    return type_, checker.problems


def _size_problem(expression: Expression) -> str | None:
    if nesting_depth(expression) > MAX_NESTING:
        return f"the expression has more than {MAX_NESTING} levels of nesting"
    return (
        f"the expression has more than {LIMITS['operands']} operands and operators"
        if expression_size(expression) > LIMITS["operands"]
        else None
    )


class ExpressionChecker:
    """A type checker for one expression. It collects `problems`, at most one for each mistake."""

    def __init__(self, scope: Mapping[str, StaticType | None], metamodel: Metamodel, bare_objects: bool) -> None:
        self.scope = scope
        self.metamodel = metamodel
        self.bare_objects = bare_objects
        self.problems: list[Diagnostic] = []

    def report(self, code: str, message: str, node: Expression, hint: str | None = None, *subject: str) -> None:
        """Add a diagnostic at a part of the expression to `problems`."""
        self.problems.append(Diagnostic(code, message, node.span, hint, subject=subject))

    def type_of(self, node: Expression, expected: StaticType | None = None) -> StaticType | None:
        """Return the type of an expression. None if it is `none`, or if unknown, which has been reported then."""
        match node:
            case Variable():
                return self._variable_type(node, expected)
            case Constant():
                return None if node.value is None else value_type(node.value)
            case EnumLiteral():
                return self.literal_type(node, expected)
            case Navigation():
                return self._navigation_type(node)
            case Unary("!", operand):
                self.operand_type(operand, "!", "bool")
                return Scalar.BOOL
            case Unary(operator, operand):
                return self.operand_type(operand, operator, "number")
            case Binary():
                return self._binary_type(node)
            case Conditional():
                return self._conditional_type(node, expected)
            case FunctionCall():
                return call_type(self, node)

    def _variable_type(self, node: Variable, expected: StaticType | None) -> StaticType | None:
        if node.is_anonymous:
            self.report("unknown-variable", "`_` has no value", node, "give the variable a name")
            return None
        if node.name not in self.scope:
            if isinstance(expected, EnumType) and node.name in expected.literals:
                hint = f"write `::{node.name}` for the literal"
            else:
                hint = name_hint(node.name, self.scope) or "no variable is known here"
            self.report("unknown-variable", f"unknown variable `{node.name}`", node, hint, node.name)
            return None
        type_ = self.scope[node.name]
        if isinstance(type_, ObjectType) and not self.bare_objects:
            message = f"`{node.name}` is an object, {quote_with_article(type_.cls)}, but a data value is required here"
            feature = next(iter(self.metamodel.features(type_.cls)), None)
            instead = f"a feature such as `{node.name}.{feature}`" if feature else "a feature of it"
            hint = f"use {instead}; to compare objects, write the constraint `{node.name} == other;` without `check`"
            self.report("bare-object", message, node, hint)
            return None
        return type_

    def is_object(self, node: Expression) -> TypeGuard[Variable]:
        """Return True if the expression is a variable whose type is a class."""
        return isinstance(node, Variable) and isinstance(self.scope.get(node.name), ObjectType)

    def literal_type(self, node: EnumLiteral, expected: StaticType | None) -> StaticType | None:
        """Return the enum of a literal, or None after reporting an error. `::literal` belongs to the expected enum."""
        enum: EnumType | None
        if node.enum is not None:
            enum = self.metamodel.enums.get(node.enum)
            if enum is None:
                hint = name_hint(node.enum, self.metamodel.enums)
                self.report_at("unknown-enum", f"unknown enum `{node.enum}`", node.enum_span or node.span, hint)
                return None
        elif isinstance(expected, EnumType):
            enum = expected
        else:
            self.report("unknown-enum", *self._unknown_enum_report(node, expected))
            return None
        if node.literal not in enum.literals:
            message = f"enum `{enum.name}` has no literal `{node.literal}`"
            span = node.literal_span or node.span
            self.report_at("unknown-literal", message, span, name_hint(node.literal, enum.literals))
            return None
        return enum

    def _unknown_enum_report(
        self, node: EnumLiteral, expected: StaticType | None
    ) -> tuple[str, Expression, str | None]:
        owners = [enum.name for enum in self.metamodel.enum_types if node.literal in enum.literals]
        hint = f"write `{owners[0]}::{node.literal}`" if owners else None
        if expected is None:
            return f"the enum of `::{node.literal}` is not known here", node, hint
        return (
            f"expected `{type_text(expected)}`, found the enum literal `::{node.literal}`",
            node,
            value_hint(expected),
        )

    def report_at(self, code: str, message: str, span: Span | None, hint: str | None) -> None:
        """Add a diagnostic at a span to `problems`."""
        self.problems.append(Diagnostic(code, message, span, hint))

    def _navigation_type(self, node: Navigation) -> StaticType | None:
        # Only at the start of a path may an object variable occur in a check.
        if isinstance(node.object, Variable) and not node.object.is_anonymous and node.object.name in self.scope:
            owner = self.scope[node.object.name]
        else:
            owner = self.type_of(node.object)
        if owner is None:
            return None
        span = node.feature_span or node.span
        if is_method(node, owner):
            return FUNCTIONS[node.feature].result or owner
        if not isinstance(owner, ObjectType):
            message = f"{quote_with_article(type_text(owner))} has no features"
            advice = JAVA_HINTS.get(node.feature, "leave the feature out: only objects have features")
            self.report_at("unknown-feature", message, span, advice)
            return None
        feature = self.metamodel.feature(owner.cls, node.feature)
        if feature is None:
            hint = self.metamodel.left_out_reason(owner.cls, node.feature)
            hint = hint or did_you_mean(node.feature, self.metamodel.features(owner.cls))
            hint = hint or subclass_hint(owner.cls, node.feature, self.metamodel)
            hint = hint or JAVA_HINTS.get(node.feature)
            hint = hint or name_hint(node.feature, self.metamodel.features(owner.cls))
            self.report_at("unknown-feature", f"`{owner.cls}` has no feature `{node.feature}`", span, hint)
            return None
        if feature.many:
            what, end = ("value", "value") if isinstance(feature, Attribute) else ("object", "target")
            name = f"{owner.cls}.{feature.name}"
            hint = f"use a constraint: `{name}(.., {end})`, or an aggregate: `n == count {name}(.., _)`"
            self.report_at("many-valued", f"`{feature}` leads to more than one {what}", span, hint)
            return None
        return ObjectType(feature.target) if isinstance(feature, Reference) else feature.type

    def operand_type(
        self, node: Expression, operator_name: str, kind: str, expected: StaticType | None = None
    ) -> StaticType | None:
        """Return the type of an operand of `operator_name`. If it is not of the wanted kind, report this and return
        None.
        """
        return self._checked_operand_type(node, self.type_of(node, expected), operator_name, kind)

    def _checked_operand_type(
        self, node: Expression, type_: StaticType | None, operator_name: str, kind: str
    ) -> StaticType | None:
        """Return the given type of an operand if it is of the wanted kind, else report the operand and return None."""
        if _is_none(node):
            advice = "compare `none` only with a path: `x.f == none`"
            self.report("operand-type", f"`{operator_name}` does not take `none`", node, advice)
            return None
        what_it_takes, types = _OPERAND_KINDS.get(kind, ("data", ()))
        if type_ is not None and (type_ not in types if types else isinstance(type_, ObjectType)):
            hint = None
            if isinstance(type_, ObjectType):
                hint = f"use an attribute of `{type_.cls}`"
            elif kind == "bool" and type_ in NUMBERS:
                hint = "compare it: `.. != 0`"
            elif kind in {"number", "int"}:
                hint = value_hint(Scalar.INT, type_)
            elif kind == "string":
                hint = value_hint(Scalar.STRING, type_)
            elif kind == "bool":
                hint = "compare it: `.. == ..`"
            message = f"`{operator_name}` takes {what_it_takes}, not `{type_text(type_)}`"
            self.report("operand-type", message, node, hint)
            return None
        return type_

    def _binary_type(self, node: Binary) -> StaticType | None:
        match node.operator:
            case "&&" | "||":
                for part in children(node):
                    self.operand_type(part, node.operator, "bool")
                return Scalar.BOOL
            case "==" | "!=":
                self._check_equality(node)
                return Scalar.BOOL
            case "<" | "<=" | ">" | ">=":
                self._check_ordering(node)
                return Scalar.BOOL
            case _:
                return self._arithmetic_type(node)

    def _arithmetic_type(self, node: Binary) -> StaticType | None:
        """Return the type of a chain such as `a + b - c`. The operands are checked from left to right."""
        first, links = node.chain()
        type_ = self.operand_type(first, links[0].operator, "data" if links[0].operator == "+" else "number")
        for link in links:
            if link.operator == "+":
                type_ = self._sum_type(link, type_, self.operand_type(link.right, "+", "data"))
                continue
            if link is not links[0]:
                type_ = self._checked_operand_type(link.left, type_, link.operator, "number")
            divisor = self.operand_type(link.right, link.operator, "number")
            if link.operator in "/%" and isinstance(link.right, Constant) and link.right.value == 0:
                advice = "this never has a value: divide by another number"
                self.report("division-by-zero", "division by zero", link.right, advice)
            type_ = common_number(type_, divisor)
        return type_

    def _sum_type(self, node: Binary, left: StaticType | None, right: StaticType | None) -> StaticType | None:
        if Scalar.STRING in (left, right):
            return Scalar.STRING
        for side, type_ in ((node.left, left), (node.right, right)):
            if type_ is not None and type_ not in NUMBERS:
                message = f"`+` adds numbers or strings, not `{type_text(type_)}`"
                hint = "convert it to a string with `toString(..)`"
                if isinstance(type_, ObjectType):
                    hint = f"use an attribute of `{type_.cls}`"
                self.report("operand-type", message, side, hint)
                return None
        return common_number(left, right)

    def _check_ordering(self, node: Binary) -> None:
        left = self.operand_type(node.left, node.operator, "ordered")
        right = self.operand_type(node.right, node.operator, "ordered")
        if left and right and (left in NUMBERS) != (right in NUMBERS):
            message = f"`{node.operator}` cannot compare `{type_text(left)}` with `{type_text(right)}`"
            self.report("operand-type", message, node, "compare two numbers, or two strings")

    def _check_equality(self, node: Binary) -> None:
        if _is_none(node.left) or _is_none(node.right):
            self._check_none_test(node)
            return
        if not self.bare_objects and self.is_object(node.left) and self.is_object(node.right):
            advice = f"write the constraint `{node.left.name} {node.operator} {node.right.name};` without `check`"
            self.report("bare-object", "objects cannot be compared in check and eval", node, advice)
            return
        left, right = self._side_types(node)
        if left is None or right is None:
            return
        if not are_comparable(left, right, self.metamodel):
            hint = None
            for side, other in ((node.left, right), (node.right, left)):
                if isinstance(side, Constant) and isinstance(side.value, str) and isinstance(other, EnumType):
                    hint = enum_hint(side.value, other) or value_hint(other)
            hint = hint or f"compare {quote_with_article(type_text(left))} with another one"
            message = f"`{node.operator}` cannot compare `{type_text(left)}` with `{type_text(right)}`"
            self.report("operand-type", message, node, hint)

    def _side_types(self, node: Binary) -> tuple[StaticType | None, StaticType | None]:
        """Return the types of both sides of a comparison. `::literal` takes its enum from the other side."""
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

    def _check_none_test(self, node: Binary) -> None:
        path = none_test_path(node)
        if path is not None:
            self.type_of(path)
            return
        side = node.right if _is_none(node.left) else node.left
        if self.type_of(side) is not None or _is_none(side) or not self.problems:
            hint = "only a path can be `none`: `x.f == none`"
            self.report("none-test", "this has a value in every match", side, hint)

    def _conditional_type(self, node: Conditional, expected: StaticType | None) -> StaticType | None:
        self.operand_type(node.test, "?:", "bool")
        first, second = node.then, node.otherwise
        if _is_none(first) or _is_none(second):
            return self._optional_type(node, second if _is_none(first) else first, expected)
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
            # Promotion would make the type of a value depend on the branch: `1 / 2` or `1.0 / 2`.
            hint = "write the int as a float (`1.0`), or use `toFloat`"
        message = f"the branches of `?:` have different types: `{type_text(then)}` and `{type_text(otherwise)}`"
        self.report("operand-type", message, node, hint)
        return None

    def _optional_type(self, node: Conditional, branch: Expression, expected: StaticType | None) -> StaticType | None:
        """Return the type of `test ? x : none`, which only a rule may assign. In a query report this, return None."""
        if not self.bare_objects:
            self.report(
                "operand-type",
                "`none` is no value in a query",
                node,
                "write the condition as a separate check: `check(..)`",
            )
            return None
        return self.type_of(branch, expected)

    def _common_class(self, node: Conditional, then: ObjectType, otherwise: ObjectType) -> StaticType | None:
        above = [name for name in self.metamodel.supertypes(then.cls) if self.metamodel.is_a(otherwise.cls, name)]
        if above:
            return ObjectType(above[0])
        self.report(
            "operand-type",
            f"`{then.cls}` and `{otherwise.cls}` have no common superclass",
            node,
            "read an attribute in both branches: `.. ? x.f : y.f`",
        )
        return None


_OPERAND_KINDS: Final[Mapping[str, tuple[str, tuple[StaticType, ...]]]] = {
    "bool": ("truth values", (Scalar.BOOL,)),
    "number": ("numbers", NUMBERS),
    "int": ("an int", (Scalar.INT,)),
    "string": ("strings", (Scalar.STRING,)),
    "ordered": ("numbers or strings", (*NUMBERS, Scalar.STRING)),
}
"""For each kind of operand its name in messages and its types."""


def is_method(node: Navigation, owner: StaticType | None) -> bool:
    """Return True if a path such as `text.length` calls a function of one parameter, for `text` of type `owner`."""
    function = FUNCTIONS.get(node.feature)
    if function is None or len(function.parameters) != 1 or owner is None or isinstance(owner, ObjectType):
        return False
    return owner in _OPERAND_KINDS.get(function.parameters[0], ("", (owner,)))[1]


def _is_none(node: Expression) -> bool:
    return isinstance(node, Constant) and node.value is None


def _is_bare_literal(node: Expression) -> bool:
    """Return True if the expression is an enum literal without its enum: `::literal`."""
    return isinstance(node, EnumLiteral) and node.enum is None


def subclass_hint(cls: str, feature: str, metamodel: Metamodel) -> str | None:
    """Return a hint that names a subclass with the feature, or None if no subclass has it."""
    for sub in metamodel.class_list:
        if any(own.name == feature for own in sub.features) and metamodel.is_a(sub.name, cls):
            return f"constrain the object with `{sub.name}(..)`: this subclass has the feature"
    return None
