"""Write names, expressions, conditions and annotations as text."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from itertools import groupby
from math import isfinite
from typing import Final, Never

from envgraph.errors import InvalidArgument
from envgraph.lang.syntax._parsing import LEVELS, ORDERINGS
from envgraph.metamodel import Annotation, Value
from envgraph.pattern import (
    Aggregate,
    Binary,
    Check,
    Comparison,
    Conditional,
    Constant,
    Constraint,
    EnumLiteral,
    Evaluation,
    Expression,
    FunctionCall,
    Hash,
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
_UNARY: Final = 7
_POSTFIX: Final = 8
_ESCAPES: Final = {"\\": "\\\\", '"': '\\"', "\n": "\\n", "\t": "\\t", "\r": "\\r"}
_OF_NAMES: Final = frozenset({"hom", "match", "semantics"})
_KEYS_OF_NAMES: Final = frozenset({"determines", "forEach", "key"})


class TermText:
    """A writer of the names, expressions and conditions of one definition.

    Args:
        owner: the name of the definition, for error messages.
        keywords: the keywords of the language. A name equal to a keyword is written with a `^` before it.
    """

    def __init__(self, owner: str, keywords: Iterable[str]) -> None:
        self.owner = owner
        self._keywords = frozenset(keywords)

    def refuse(self, reason: str) -> Never:
        """Raise an error that the definition cannot be written as text.

        Raises:
            InvalidArgument: always.
        """
        raise InvalidArgument(f"`{self.owner}` cannot be written as text: {reason}")

    # --- names

    def name(self, name: str) -> str:
        """Return a name as text, a keyword with `^` before it; raise InvalidArgument if it has other signs than `_`."""
        if not _NAME.fullmatch(name):
            self.refuse(f"`{name}` is not a name; a name consists of letters, digits and `_`")
        return f"^{name}" if name in self._keywords else name

    def type(self, name: str) -> str:
        """Return the text of the name of a class or an enum, optionally qualified by its package: `package::Class`."""
        return "::".join(map(self.name, name.split("::", 1)))

    def qualified(self, name: str) -> str:
        """Return the text of a dotted name."""
        return ".".join(map(self.name, name.split(".")))

    def parameters(self, parameters: Sequence[Parameter]) -> str:
        """Return the text of parameters, such as `(in a : T, b)`."""
        return f"({', '.join(map(self._parameter, parameters))})"

    def _parameter(self, one: Parameter) -> str:
        direction = f"{one.direction} " if one.direction else ""
        type_ = f" : {self.type(one.type)}" if one.type is not None else ""
        return f"{direction}{self.name(one.name)}{type_}"

    # --- values and expressions

    def value(self, value: Value | None) -> str:
        """Return the text of a number, bool or string; `none` for None. An infinite number raises InvalidArgument."""
        match value:
            case None:
                return "none"
            case bool():
                return "true" if value else "false"
            case str():
                return string(value)
            case float() if not isfinite(value):
                self.refuse(f"the number `{value}` is not finite")
        return repr(value)

    def expression(self, expression: Expression, level: int = 0) -> str:
        """Return the text of an expression, in parentheses if its precedence is lower than `level`."""
        own, text = self._expression(expression)
        return f"({text})" if own < level else text

    def _expression(self, one: Expression) -> tuple[int, str]:
        match one:
            case Variable(name):
                return _POSTFIX, self.name(name)
            case Constant(value):
                # A number has no features, and neither has `-3`. In parentheses the text can at least be parsed.
                numeric = isinstance(value, int | float) and not isinstance(value, bool)
                return _UNARY if numeric else _POSTFIX, self.value(value)
            case EnumLiteral():
                return _POSTFIX, self.literal(one)
            case Navigation(owner, feature):
                return _POSTFIX, f"{self.expression(owner, _POSTFIX)}.{self.name(feature)}"
            case FunctionCall(function, arguments):
                return _POSTFIX, f"{self.name(function)}({self.expressions(arguments)})"
            case Unary(operator, operand):
                inner = self.expression(operand, _UNARY)
                negative = operator == "-" and inner[0] in "-0123456789"
                return _UNARY, f"{operator}({inner})" if negative else f"{operator}{inner}"
            case Binary():
                return self._binary(one)
            case Conditional(test, then, otherwise):
                first, second = self.expression(test, 1), self.expression(then, 1)
                return 0, f"{first} ? {second} : {self.expression(otherwise)}"

    def _binary(self, one: Binary) -> tuple[int, str]:
        own = LEVELS.get(one.operator)
        if own is None:
            self.refuse(f"`{one.operator}` is not an operator of the language")
        first, links = one.chain()
        parts = [self.expression(first, own + (own == ORDERINGS))]
        parts += [f" {link.operator} {self.expression(link.right, own + 1)}" for link in links]
        return own, "".join(parts)

    def expressions(self, expressions: Iterable[Expression]) -> str:
        """Return the texts of expressions, separated by commas."""
        return ", ".join(map(self.expression, expressions))

    def literal(self, one: EnumLiteral) -> str:
        """Return the text of an enum literal, `Enum::literal` or `::literal`."""
        return f"{self.type(one.enum) if one.enum is not None else ''}::{self.name(one.literal)}"

    # --- conditions

    def term(self, term: Term) -> str:
        """Return the text of a term, such as a variable, `eval(..)`, `count find ..` or `#`."""
        match term:
            case Evaluation(expression):
                return f"eval({self.expression(expression)})"
            case Aggregate(function, over):
                return f"{function} {self.relation(over)}"
            case Hash():
                return "#"
        return self.expression(term)

    def terms(self, terms: Iterable[Term]) -> str:
        """Return the texts of terms, separated by commas, in parentheses."""
        return f"({', '.join(map(self.term, terms))})"

    def relation(self, relation: Relation) -> str:
        """Return the text of `Type(x)`, `Type.f(x, y)` or `find p(..)`."""
        match relation:
            case TypeConstraint(type_, term, exact):
                if exact:
                    self.refuse(
                        f"it requires a `{self.term(term)}` of class `{type_}` itself; conditions also allow subclasses"
                    )
                return f"{self.type(type_)}{self.terms((term,))}"
            case PathConstraint(type_, features, source, target, closure):
                if not type_ or not features:
                    self.refuse("a path needs a class and at least one feature")
                path = ".".join((self.type(type_), *map(self.name, features)))
                return f"{path}{closure.value}{self.terms((source, target))}"
            case PatternCall(pattern, arguments, closure):
                return f"find {self.qualified(pattern)}{closure.value}{self.terms(arguments)}"

    def condition(self, condition: Constraint) -> str:
        """Return the text of one condition, without the `;` behind it."""
        match condition:
            case Negation(relation):
                return f"neg {self.relation(relation)}"
            case Comparison(operator, left, right):
                return f"{self.term(left)} {operator} {self.term(right)}"
            case Check(expression):
                return f"check({self.expression(expression)})"
        return self.relation(condition)

    # --- annotations and comments

    def annotation(self, annotation: Annotation) -> str:
        """Return the text of an annotation, such as `@name(1, key = "v")`."""
        names = annotation.name in _OF_NAMES
        found = [self._argument(value, names) for value in annotation.arguments]
        for key, pairs in groupby(annotation.named, key=lambda pair: pair[0]):
            values = [self._argument(value, key in _KEYS_OF_NAMES) for _, value in pairs]
            text = values[0] if len(values) == 1 else "{" + ", ".join(values) + "}"
            found.append(f"{self.name(key)} = {text}")
        return f"@{self.name(annotation.name)}" + (f"({', '.join(found)})" if found else "")

    def _argument(self, value: Value, names: bool) -> str:
        if names and isinstance(value, str) and _NAME.fullmatch(value):
            return self.name(value)
        return self.value(value)

    def doc(self, doc: str | None) -> str:
        """Return the text of a doc comment with a line break at the end; "" if there is no comment."""
        doc = plain_doc(doc)
        if doc is None:
            return ""
        if "*/" in doc:
            self.refuse("its comment contains `*/`, which would end the comment")
        lines = doc.split("\n")
        if len(lines) == 1 and not doc.startswith("*"):
            return f"/** {doc} */\n" if doc else "/** */\n"
        return "\n".join(("/**", *(f" * {line}".rstrip() for line in lines), " */\n"))


def string(text: str) -> str:
    r"""Return a string literal of the languages, in double quotes.

    >>> print(string('a "b"'))
    "a \"b\""
    """
    return '"' + "".join(_ESCAPES.get(c) or _printable(c) for c in text) + '"'


def _printable(character: str) -> str:
    if character.isprintable() or ord(character) > 0xFFFF:
        return character
    return f"\\u{ord(character):04x}"


def plain_doc(doc: str | None) -> str | None:
    """Return a doc comment as the parser would read it: without blanks around it and at the ends of its lines."""
    if doc is None:
        return None
    return "\n".join(line.expandtabs().rstrip() for line in doc.split("\n")).strip()
