"""Emit code for expressions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import chain
from typing import Final

from envgraph import code
from envgraph.code import dataclass
from envgraph.errors import InvalidArgument
from envgraph.metamodel import EnumType, Metamodel, Scalar
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
from envgraph.pattern._goals import StaticType
from envgraph.pattern._occurrences import MAX_NESTED_OPERATORS, children
from envgraph.pattern.expressions._builtin_functions import FUNCTIONS
from envgraph.pattern.expressions._evaluate import needs_bounds
from envgraph.pattern.expressions._expression_types import ExpressionChecker


@dataclass(frozen=True, slots=True)
class CompiledExpression:
    """Generated code for an expression, with the same value as `evaluate`.

    Attributes:
        tree: the syntax tree of the code. It contains the caller's trees for variables and constants, names of
            `EXPRESSION_NAMESPACE`, and operators, but no text of the user.
        constants: the literals and the declared functions (bound to the places of their calls), by their numbers.
        can_fail: True if the code can raise `EvaluationError`. Otherwise no `try` is needed.
    """

    tree: code.Expression
    constants: tuple[object, ...]
    can_fail: bool

    @property
    def source(self) -> str:
        """Return the code as text, atomic or in parentheses."""
        return code.expression_text(self.tree, code.ATOM)


def compile_expression(
    expression: Expression,
    names: Mapping[str, code.Expression],
    types: Mapping[str, StaticType] | None = None,
    *,
    is_comparison_side: bool = False,
    constant: Callable[[int], code.Expression] = lambda number: code.Subscript(code.Name("k"), code.Constant(number)),
) -> CompiledExpression:
    """Return generated code for a checked expression without paths (as in `Condition` and `Valuation`).

    Args:
        expression: the expression.
        names: the code for each variable.
        types: types of the variables. With types, arithmetic on ints, comparisons and concatenation of strings become
            Python operators. Without types, helper functions inspect the values.
        is_comparison_side: True if the expression is one side of a comparison, where ints are not limited to 64 bits.
        constant: returns the code for the literal with a given number (from 0).

    Raises:
        InvalidArgument: the expression has a path, or a variable that `names` lacks.

    >>> expression = Binary("+", Variable("x"), Constant(1))
    >>> compile_expression(expression, {"x": code.Local("v3")}, {"x": Scalar.INT}).source
    '_bounded(v3 + k[0])'
    """
    writer = _ExpressionEmitter(names, types or {}, constant)
    tree = writer.emit(expression)
    if not is_comparison_side and needs_bounds(expression) and writer.type_of(expression) is not Scalar.FLOAT:
        writer.can_fail = True
        tree = code.emit_call("_bounded", tree)
    return CompiledExpression(tree, tuple(writer.constants), writer.can_fail)


_HELPER_NAMES: Final = {"+": "_add", "-": "_subtract", "*": "_multiply", "/": "_divide", "%": "_remainder"}
_EMPTY_METAMODEL: Final = Metamodel("none", ())


class _ExpressionEmitter:
    """A code generator for one expression, which collects the literals and notes if the code can fail."""

    def __init__(
        self,
        names: Mapping[str, code.Expression],
        types: Mapping[str, StaticType],
        constant: Callable[[int], code.Expression],
    ) -> None:
        self._names = names
        self._types = types
        self._constant_code = constant
        self.constants: list[object] = []
        self.can_fail = False

    def emit(self, node: Expression) -> code.Expression:
        match node:
            case Variable():
                if node.name not in self._names:
                    raise InvalidArgument(f"`names` has no code for variable `{node.name}`")
                return self._names[node.name]
            case Constant():
                return code.NONE if node.value is None else self._emit_literal(node.value)
            case EnumLiteral():
                return self._emit_literal(node.literal)
            case Navigation():
                raise InvalidArgument(f"a path (`.{node.feature}`) has to be lowered before it is compiled")
            case Unary():
                return code.Operation("not" if node.operator == "!" else "-", (self.emit(node.operand),))
            case Binary():
                return self._emit_binary(node)
            case Conditional():
                return code.ConditionalExpression(*map(self.emit, (node.test, node.then, node.otherwise)))
            case FunctionCall():
                arguments = tuple(map(self.emit, node.arguments))
                if node.declaration is not None:
                    return code.Call(self._emit_literal(node.declaration.bound_to_call(node.span)), arguments)
                self.can_fail |= not FUNCTIONS[node.function].total
                return code.emit_call(f"_fn_{node.function}", *arguments)

    def _emit_literal(self, value: object) -> code.Expression:
        self.constants.append(value)
        return self._constant_code(len(self.constants) - 1)

    def _emit_binary(self, node: Binary) -> code.Expression:
        match node.operator:
            case "&&" | "||":
                operator = "and" if node.operator == "&&" else "or"
                return code.Operation(operator, tuple(map(self.emit, children(node))))
            case "==" | "!=" | "<" | "<=" | ">" | ">=":
                return code.Operation(node.operator, (self.emit(node.left), self.emit(node.right)))
        return self._emit_arithmetic(*node.chain())

    def _emit_arithmetic(self, first: Expression, links: list[Binary]) -> code.Expression:
        """Emit nested operations for a chain such as `a + b - c`, or one call of a helper if the chain is long.

        Python's own parser could not read deeply nested code. Set `can_fail` if the code can raise an error.
        """
        tree, rights = self.emit(first), [self.emit(link.right) for link in links]
        if len(links) > MAX_NESTED_OPERATORS:
            self.can_fail = True
            parts = zip([code.Name(_HELPER_NAMES[link.operator]) for link in links], rights, strict=True)
            return code.emit_call("_chain", tree, *chain.from_iterable(parts))
        for link, right in zip(links, rights, strict=True):
            if link.operator in "+-*" and _has_python_semantics(
                link.operator, self.type_of(link.left), self.type_of(link.right)
            ):
                tree = code.Operation(link.operator, (tree, right))
            else:
                self.can_fail = True
                tree = code.emit_call(_HELPER_NAMES[link.operator], tree, right)
        return tree

    def type_of(self, node: Expression) -> StaticType | None:
        """Return the type of an expression, or None if unknown. It is string for an enum literal, as its value."""
        if isinstance(node, EnumLiteral):
            return Scalar.STRING
        return ExpressionChecker(self._types, _EMPTY_METAMODEL, True).type_of(node)


def _has_python_semantics(operator: str, left: StaticType | None, right: StaticType | None) -> bool:
    """Return True if Python's operator computes the same as ours: for two ints, and for `+` of two strings."""
    if left is Scalar.INT and right is Scalar.INT:
        return True
    return operator == "+" and Scalar.STRING in (left, right) and _is_textual(left) and _is_textual(right)


def _is_textual(type_: StaticType | None) -> bool:
    return type_ is Scalar.STRING or isinstance(type_, EnumType)
