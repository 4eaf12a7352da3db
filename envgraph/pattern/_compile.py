"""Python source for an expression."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument
from envgraph.metamodel import EnumType, Metamodel, Scalar
from envgraph.pattern._bodies import LONGEST_NESTED, children
from envgraph.pattern._evaluate import computes
from envgraph.pattern._expressions import ExpressionChecker
from envgraph.pattern._lowered import StaticType
from envgraph.pattern._operations import FUNCTIONS
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


@dataclass(frozen=True, slots=True)
class CompiledExpression:
    """Source of one Python expression that has the value `evaluate` would give.

    Attributes:
        source: in parentheses or atomic. It holds the names the caller gave, the names of constants, names of
            `EXPRESSION_NAMESPACE`, and operators; no text of the user's.
        constants: the literals, and declared functions with the places where they are called, in the order of their
            names.
        fallible: whether it can raise `EvaluationError`; if not, no `try` is needed.
    """

    source: str
    constants: tuple[object, ...]
    fallible: bool


def compile_expression(
    expression: Expression,
    names: Mapping[str, str],
    types: Mapping[str, StaticType] | None = None,
    *,
    constant: Callable[[int], str] = "k[{}]".format,
) -> CompiledExpression:
    """Generate the source of a checked expression without paths (as in `CheckAtom`, `EvaluationAtom`).

    Args:
        expression: the expression.
        names: the source that stands for each variable.
        types: types of the variables. With them, arithmetic on ints, comparisons and concatenation of strings are
            written out; without, helpers look at the values.
        constant: the source for the literal of a number (from 0).

    Raises:
        InvalidArgument: the expression has a path, or a variable that `names` lacks.

    >>> expression = Binary("+", Variable("x"), Constant(1))
    >>> compile_expression(expression, {"x": "v3"}, {"x": Scalar.INT}).source
    '_bounded((v3 + k[0]))'
    """
    writer = _Writer(names, types or {}, constant)
    source = writer.write(expression)
    if computes(expression) and writer.type_of(expression) is not Scalar.FLOAT:
        writer.fallible = True
        source = f"_bounded({source})"
    return CompiledExpression(source, tuple(writer.constants), writer.fallible)


_HELPERS: Final = {"+": "_add", "-": "_subtract", "*": "_multiply", "/": "_divide", "%": "_remainder"}
_EMPTY: Final = Metamodel("none", ())


class _Writer:
    """Writes source, and remembers the literals and whether anything in it can fail."""

    def __init__(
        self, names: Mapping[str, str], types: Mapping[str, StaticType], constant: Callable[[int], str]
    ) -> None:
        self._names = names
        self._types = types
        self._constant = constant
        self.constants: list[object] = []
        self.fallible = False

    def write(self, node: Expression) -> str:
        match node:
            case Variable():
                if node.name not in self._names:
                    raise InvalidArgument(f"no source for variable `{node.name}`")
                return self._names[node.name]
            case Constant():
                return "None" if node.value is None else self._literal(node.value)
            case EnumLiteral():
                return self._literal(node.literal)
            case Navigation():
                raise InvalidArgument(f"a path (`.{node.feature}`) has to be lowered before it is compiled")
            case Unary():
                return f"({'not ' if node.operator == '!' else '-'}{self.write(node.operand)})"
            case Binary():
                return self._binary(node)
            case Conditional():
                test, then, otherwise = map(self.write, (node.test, node.then, node.otherwise))
                return f"({then} if {test} else {otherwise})"
            case FunctionCall():
                arguments = ", ".join(map(self.write, node.arguments))
                if node.declaration is not None:
                    return f"{self._literal(node.declaration.at(node.span))}({arguments})"
                self.fallible |= not FUNCTIONS[node.function].total
                return f"_fn_{node.function}({arguments})"

    def _literal(self, value: object) -> str:
        self.constants.append(value)
        return self._constant(len(self.constants) - 1)

    def _binary(self, node: Binary) -> str:
        match node.operator:
            case "&&":
                return f"({' and '.join(map(self.write, children(node)))})"
            case "||":
                return f"({' or '.join(map(self.write, children(node)))})"
            case "==" | "!=" | "<" | "<=" | ">" | ">=":
                return f"({self.write(node.left)} {node.operator} {self.write(node.right)})"
        return self._arithmetic(*node.chain())

    def _arithmetic(self, first: Expression, links: list[Binary]) -> str:
        """`a + b - c`: nested as it is evaluated, but a long one is a call that Python's own parser can take."""
        source, rights = self.write(first), [self.write(link.right) for link in links]
        if len(links) > LONGEST_NESTED:
            self.fallible = True
            parts = (f"{_HELPERS[link.operator]}, {right}" for link, right in zip(links, rights, strict=True))
            return f"_chain({source}, {', '.join(parts)})"
        for link, right in zip(links, rights, strict=True):
            if link.operator in "+-*" and _inline(
                link.operator, self.type_of(link.left), self.type_of(link.right)
            ):
                source = f"({source} {link.operator} {right})"
            else:
                self.fallible = True
                source = f"{_HELPERS[link.operator]}({source}, {right})"
        return source

    def type_of(self, node: Expression) -> StaticType | None:
        """The type as far as it can be told; a literal's enum is not needed, its value is a string."""
        if isinstance(node, EnumLiteral):
            return Scalar.STRING
        return ExpressionChecker(self._types, _EMPTY, True).type_of(node)


def _inline(operator: str, left: StaticType | None, right: StaticType | None) -> bool:
    """Whether Python's own operator does exactly what ours does: on two ints, or two strings."""
    if left is Scalar.INT and right is Scalar.INT:
        return True
    return operator == "+" and Scalar.STRING in (left, right) and _textual(left) and _textual(right)


def _textual(type_: StaticType | None) -> bool:
    return type_ is Scalar.STRING or isinstance(type_, EnumType)
