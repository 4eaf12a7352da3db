"""Write names, expressions, conditions and annotations as text."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from itertools import groupby
from math import isfinite
from typing import Final, Never

from envgraph.errors import InvalidArgument
from envgraph.lang.syntax._parser import ORDERINGS, PRECEDENCES
from envgraph.metamodel import Annotation, Value
from envgraph.pattern import (
    Aggregate,
    Binary,
    Check,
    ColumnMark,
    Comparison,
    Conditional,
    Constant,
    Constraint,
    EnumLiteral,
    Evaluation,
    Expression,
    FunctionCall,
    Navigation,
    Negation,
    Parameter,
    PathConstraint,
    PatternCall,
    Relation,
    Term,
    TypeConstraint,
    Unary,
    Variable,
)

_NAME: Final = re.compile(r"[^\W\d]\w*")
_UNARY_PRECEDENCE: Final = 7
_POSTFIX_PRECEDENCE: Final = 8
_ESCAPES: Final = {"\\": "\\\\", '"': '\\"', "\n": "\\n", "\t": "\\t", "\r": "\\r"}
_ANNOTATIONS_OF_NAMES: Final = frozenset({"hom", "match", "semantics"})
_KEYS_OF_NAMES: Final = frozenset({"determines", "forEach", "key"})


class TermWriter:
    """A writer of the names, expressions and conditions of one definition.

    Args:
        owner: the name of the definition, for error messages.
        keywords: the keywords of the language. A name equal to a keyword is written with a `^` before it.
    """

    def __init__(self, owner: str, keywords: Iterable[str]) -> None:
        self.owner = owner
        self._keywords = frozenset(keywords)

    def raise_unwritable(self, reason: str) -> Never:
        """Raise an error that the definition cannot be written as text.

        Raises:
            InvalidArgument: always.
        """
        raise InvalidArgument(f"`{self.owner}` cannot be written as text: {reason}")

    # --- names

    def format_name(self, name: str) -> str:
        """Return a name as text, a keyword with `^` before it; raise InvalidArgument if it has other signs than `_`."""
        if not _NAME.fullmatch(name):
            self.raise_unwritable(f"`{name}` is not a name; a name consists of letters, digits and `_`")
        return f"^{name}" if name in self._keywords else name

    def format_type_name(self, name: str) -> str:
        """Return the text of the name of a class or an enum, optionally qualified by its package: `package::Class`."""
        return "::".join(map(self.format_name, name.split("::", 1)))

    def format_dotted_name(self, name: str) -> str:
        """Return the text of a dotted name."""
        return ".".join(map(self.format_name, name.split(".")))

    def format_parameters(self, parameters: Sequence[Parameter]) -> str:
        """Return the text of parameters, such as `(in a : T, b)`."""
        return f"({', '.join(map(self._format_parameter, parameters))})"

    def _format_parameter(self, one: Parameter) -> str:
        direction = f"{one.direction} " if one.direction else ""
        type_ = f" : {self.format_type_name(one.type)}" if one.type is not None else ""
        return f"{direction}{self.format_name(one.name)}{type_}"

    # --- values and expressions

    def format_value(self, value: Value | None) -> str:
        """Return the text of a number, bool or string; `none` for None. An infinite number raises InvalidArgument."""
        match value:
            case None:
                return "none"
            case bool():
                return "true" if value else "false"
            case str():
                return format_string(value)
            case float() if not isfinite(value):
                self.raise_unwritable(f"the number `{value}` is not finite")
        return repr(value)

    def format_expression(self, expression: Expression, precedence: int = 0) -> str:
        """Return the text of an expression, in parentheses if its precedence is lower than `precedence`."""
        own, text = self._expression_text(expression)
        return f"({text})" if own < precedence else text

    def _expression_text(self, one: Expression) -> tuple[int, str]:
        match one:
            case Variable(name):
                return _POSTFIX_PRECEDENCE, self.format_name(name)
            case Constant(value):
                # A number has no features, and neither has `-3`. In parentheses the text can at least be parsed.
                numeric = isinstance(value, int | float) and not isinstance(value, bool)
                return _UNARY_PRECEDENCE if numeric else _POSTFIX_PRECEDENCE, self.format_value(value)
            case EnumLiteral():
                return _POSTFIX_PRECEDENCE, self.format_literal(one)
            case Navigation(owner, feature):
                return (
                    _POSTFIX_PRECEDENCE,
                    f"{self.format_expression(owner, _POSTFIX_PRECEDENCE)}.{self.format_name(feature)}",
                )
            case FunctionCall(function, arguments):
                return (
                    _POSTFIX_PRECEDENCE,
                    f"{self.format_name(function)}({self.format_expressions(arguments)})",
                )
            case Unary(operator, operand):
                inner = self.format_expression(operand, _UNARY_PRECEDENCE)
                negative = operator == "-" and inner[0] in "-0123456789"
                return _UNARY_PRECEDENCE, f"{operator}({inner})" if negative else f"{operator}{inner}"
            case Binary():
                return self._binary_text(one)
            case Conditional(test, then, otherwise):
                first, second = self.format_expression(test, 1), self.format_expression(then, 1)
                return 0, f"{first} ? {second} : {self.format_expression(otherwise)}"

    def _binary_text(self, one: Binary) -> tuple[int, str]:
        own = PRECEDENCES.get(one.operator)
        if own is None:
            self.raise_unwritable(f"`{one.operator}` is not an operator of the language")
        first, links = one.chain()
        parts = [self.format_expression(first, own + (own == ORDERINGS))]
        parts += [f" {link.operator} {self.format_expression(link.right, own + 1)}" for link in links]
        return own, "".join(parts)

    def format_expressions(self, expressions: Iterable[Expression]) -> str:
        """Return the texts of expressions, separated by commas."""
        return ", ".join(map(self.format_expression, expressions))

    def format_literal(self, one: EnumLiteral) -> str:
        """Return the text of an enum literal, `Enum::literal` or `::literal`."""
        return f"{self.format_type_name(one.enum) if one.enum is not None else ''}::{self.format_name(one.literal)}"

    # --- conditions

    def format_term(self, term: Term) -> str:
        """Return the text of a term, such as a variable, `eval(..)`, `count find ..` or `#`."""
        match term:
            case Evaluation(expression):
                return f"eval({self.format_expression(expression)})"
            case Aggregate(function, over):
                return f"{function} {self.format_relation(over)}"
            case ColumnMark():
                return "#"
        return self.format_expression(term)

    def format_terms(self, terms: Iterable[Term]) -> str:
        """Return the texts of terms, separated by commas, in parentheses."""
        return f"({', '.join(map(self.format_term, terms))})"

    def format_relation(self, relation: Relation) -> str:
        """Return the text of `Type(x)`, `Type.f(x, y)` or `find p(..)`."""
        match relation:
            case TypeConstraint(type_, term, exact):
                if exact:
                    self.raise_unwritable(
                        f"it requires a `{self.format_term(term)}` of class `{type_}` itself; conditions "
                        "also allow subclasses"
                    )
                return f"{self.format_type_name(type_)}{self.format_terms((term,))}"
            case PathConstraint(type_, features, source, target, closure):
                if not type_ or not features:
                    self.raise_unwritable("a path needs a class and at least one feature")
                path = ".".join((self.format_type_name(type_), *map(self.format_name, features)))
                return f"{path}{closure.value}{self.format_terms((source, target))}"
            case PatternCall(pattern, arguments, closure):
                return f"find {self.format_dotted_name(pattern)}{closure.value}{self.format_terms(arguments)}"

    def format_condition(self, condition: Constraint) -> str:
        """Return the text of one condition, without the `;` behind it."""
        match condition:
            case Negation(relation):
                return f"neg {self.format_relation(relation)}"
            case Comparison(operator, left, right):
                return f"{self.format_term(left)} {operator} {self.format_term(right)}"
            case Check(expression):
                return f"check({self.format_expression(expression)})"
        return self.format_relation(condition)

    # --- annotations and comments

    def format_annotation(self, annotation: Annotation) -> str:
        """Return the text of an annotation, such as `@name(1, key = "v")`."""
        names = annotation.name in _ANNOTATIONS_OF_NAMES
        found = [self._format_argument(value, names) for value in annotation.arguments]
        for key, pairs in groupby(annotation.named, key=lambda pair: pair[0]):
            values = [self._format_argument(value, key in _KEYS_OF_NAMES) for _, value in pairs]
            text = values[0] if len(values) == 1 else "{" + ", ".join(values) + "}"
            found.append(f"{self.format_name(key)} = {text}")
        return f"@{self.format_name(annotation.name)}" + (f"({', '.join(found)})" if found else "")

    def _format_argument(self, value: Value, names: bool) -> str:
        if names and isinstance(value, str) and _NAME.fullmatch(value):
            return self.format_name(value)
        return self.format_value(value)

    def format_doc_comment(self, doc: str | None) -> str:
        """Return the text of a doc comment with a line break at the end; "" if there is no comment."""
        doc = normalised_doc(doc)
        if doc is None:
            return ""
        if "*/" in doc:
            self.raise_unwritable("its comment contains `*/`, which would end the comment")
        lines = doc.split("\n")
        if len(lines) == 1 and not doc.startswith("*"):
            return f"/** {doc} */\n" if doc else "/** */\n"
        return "\n".join(("/**", *(f" * {line}".rstrip() for line in lines), " */\n"))


def format_string(text: str) -> str:
    r"""Return a string literal of the languages, in double quotes.

    >>> print(format_string('a "b"'))
    "a \"b\""
    """
    return '"' + "".join(_ESCAPES.get(c) or _escape_character(c) for c in text) + '"'


def _escape_character(character: str) -> str:
    if character.isprintable() or ord(character) > 0xFFFF:
        return character
    return f"\\u{ord(character):04x}"


def normalised_doc(doc: str | None) -> str | None:
    """Return a doc comment as the parser would read it: without blanks around it and at the ends of its lines."""
    if doc is None:
        return None
    return "\n".join(line.expandtabs().rstrip() for line in doc.split("\n")).strip()
