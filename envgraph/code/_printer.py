"""Print syntax trees as Python source text, with the origin of each line."""

from __future__ import annotations

from typing import Final, NamedTuple, assert_never

from envgraph.code._tree import (
    Assign,
    Body,
    Call,
    Choice,
    Constant,
    Do,
    Each,
    Expression,
    For,
    Function,
    If,
    Index,
    Lambda,
    Leave,
    Let,
    Local,
    Mapping,
    Member,
    Name,
    Operation,
    Raise,
    Return,
    Statement,
    Text,
    Try,
    Tuple,
    While,
    Yield,
)

INDENT: Final = "    "
MOST_COLUMNS: Final = 100
"""Conditions longer than this are broken into several lines, since people read generated code too."""

_CHOICE, _OR, _AND, _NOT, _COMPARISON, _BIT_OR, _BIT_XOR, _BIT_AND, _SHIFT, _SUM, _PRODUCT, _MINUS, ATOM = (
    range(13)
)
"""Precedence levels of operators, the loosest first."""
_LEVELS: Final = {
    **{
        "or": _OR,
        "and": _AND,
        "not": _NOT,
        "|": _BIT_OR,
        "^": _BIT_XOR,
        "&": _BIT_AND,
        "<<": _SHIFT,
        ">>": _SHIFT,
        "+": _SUM,
        "-": _SUM,
        "*": _PRODUCT,
        "/": _PRODUCT,
        "%": _PRODUCT,
    },
    **dict.fromkeys(("==", "!=", "<", "<=", ">", ">=", "in", "not in", "is", "is not"), _COMPARISON),
}


class Printed(NamedTuple):
    """Printed source text with the origin of each line.

    Attributes:
        text: the source text; it ends with a line break.
        origins: the origin of each line, in order.
    """

    text: str
    origins: tuple[object, ...]


def printed(definitions: Body) -> Printed:
    """Return the source text of statements, with the origin of each line."""
    printer = _Printer()
    printer.body(definitions, "", None)
    return Printed("\n".join([*printer.lines, ""]), tuple(printer.origins))


class _Printer:
    """A printer that collects source lines and their origins."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.origins: list[object] = []

    def line(self, text: str, origin: object) -> None:
        self.lines.append(text)
        self.origins.append(origin)

    def body(self, statements: Body, pad: str, origin: object) -> None:
        for statement in statements:
            self.statement(statement, pad, origin if statement.origin is None else statement.origin)

    def inside(self, head: str, statements: Body, pad: str, origin: object) -> None:
        """Write a head line such as `for x in y:` and, indented below, its statements, or `pass` if there are none."""
        self.line(f"{pad}{head}:", origin)
        if statements:
            self.body(statements, pad + INDENT, origin)
        else:
            self.line(f"{pad}{INDENT}pass", origin)

    def statement(self, node: Statement, pad: str, origin: object) -> None:
        match node:
            case Assign(target, value, operator):
                self.line(f"{pad}{_target(target)} {operator} {expression_text(value)}", origin)
            case Do(value):
                self.line(f"{pad}{expression_text(value)}", origin)
            case If():
                self.condition(node, pad, origin)
            case For(target, iterable, body):
                self.inside(f"for {_target(target)} in {expression_text(iterable)}", body, pad, origin)
            case Return(value):
                self.line(f"{pad}return {expression_text(value)}" if value else f"{pad}return", origin)
            case Yield(value, each):
                self.line(f"{pad}yield {'from ' if each else ''}{expression_text(value)}", origin)
            case Function(name, parameters, body):
                self.inside(f"def {name}({_listed(parameters)})", body, pad, origin)
            case While(test, body):
                self.inside(f"while {expression_text(test)}", body, pad, origin)
            case Leave(how):
                self.line(f"{pad}{how}", origin)
            case Raise(value):
                self.line(
                    f"{pad}raise {expression_text(value)} from None" if value else f"{pad}raise", origin
                )
            case Try(body, handlers):
                self.inside("try", body, pad, origin)
                for handler in handlers:
                    name = f" as {handler.name.name}" if handler.name else ""
                    self.inside(f"except {handler.error.name}{name}", handler.body, pad, origin)
            case _:
                assert_never(node)

    def condition(self, node: If, pad: str, origin: object) -> None:
        """Write an `if` statement; tests nested directly inside each other become one condition joined by `and`."""
        tests = [node.test]
        while not node.otherwise and len(node.then) == 1:
            inner = node.then[0]
            if not isinstance(inner, If) or inner.otherwise:
                break
            node = inner
            tests.append(node.test)
        texts = [expression_text(test, _AND if len(tests) > 1 else _CHOICE) for test in tests]
        if sum(map(len, texts)) + 5 * len(texts) < MOST_COLUMNS - len(pad):
            head = f"if {' and '.join(texts)}"
        else:
            self.line(f"{pad}if (", origin)
            for number, text in enumerate(texts):
                self.line(f"{pad}{INDENT}{'and ' if number else ''}{text}", origin)
            head = ")"
        self.inside(head, node.then, pad, origin)
        if node.otherwise:
            self.inside("else", node.otherwise, pad, origin)


def _target(node: Local | Name | Index | Member | Tuple) -> str:
    if isinstance(node, Tuple):
        return f"{_listed(node.items)}{',' * (len(node.items) == 1)}"
    return expression_text(node)


def _listed(nodes: tuple[Expression, ...]) -> str:
    return ", ".join([expression_text(node) for node in nodes])


def expression_text(node: Expression, level: int = _CHOICE) -> str:
    """Return the source text of an expression, in parentheses if the surrounding operator requires them.

    Args:
        node: the expression.
        level: the precedence of the surrounding operator. An expression of lower precedence gets parentheses.
    """
    match node:
        case Local(name) | Name(name):
            return name
        case Call(function, arguments):
            return f"{expression_text(function, ATOM)}({_listed(arguments)})"
        case Index(collection, key):
            return f"{expression_text(collection, ATOM)}[{expression_text(key)}]"
        case Operation():
            text, own = _operation(node)
            return f"({text})" if own < level else text
        case Constant(value):
            return repr(value)
        case Tuple():
            return f"({_target(node)})"
        case Let(local, value):
            return f"({local.name} := {expression_text(value)})"
        case Member(object_, name):
            return f"{expression_text(object_, ATOM)}.{name}"
        case Choice(test, then, otherwise):
            chosen = f"{expression_text(then, _OR)} if {expression_text(test, _OR)}"
            text = f"{chosen} else {expression_text(otherwise)}"
            return f"({text})" if level > _CHOICE else text
        case Mapping(items):
            return f"{{{', '.join(f'{expression_text(key)}: {expression_text(value)}' for key, value in items)}}}"
        case Each(value, target, elements, test, late):
            # Parenthesise conditional expressions: Python would read their `if` as the comprehension's filter.
            text = f"{expression_text(value)} for {target.name} in {expression_text(elements, _OR)}"
            text += f" if {expression_text(test, _OR)}" if test else ""
            return f"({text})" if late else f"[{text}]"
        case Lambda(parameters, value):
            names = ", ".join(each.name for each in parameters)
            text = (
                f"lambda {names}: {expression_text(value)}" if names else f"lambda: {expression_text(value)}"
            )
            return f"({text})" if level > _CHOICE else text
        case Text(text):
            return text


def _operation(node: Operation) -> tuple[str, int]:
    operator, operands = node.operator, node.operands
    own = _LEVELS[operator]
    if len(operands) == 1:
        own, sign = (_NOT, "not ") if operator == "not" else (_MINUS, operator)
        return sign + expression_text(operands[0], own), own
    first, *others = operands
    left = own + (own == _COMPARISON)
    right = own + (own >= _COMPARISON)
    texts = [expression_text(first, left), *(expression_text(other, right) for other in others)]
    return f" {operator} ".join(texts), own
