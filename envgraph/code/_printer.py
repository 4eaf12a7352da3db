"""Print syntax trees as Python source text, with the origin of each line."""

from __future__ import annotations

from typing import Final, NamedTuple, assert_never

from envgraph.code._syntax_tree import (
    Assign,
    AssignmentExpression,
    AttributeAccess,
    Body,
    BreakOrContinue,
    Call,
    Comprehension,
    ConditionalExpression,
    Constant,
    DictExpression,
    Expression,
    ExpressionStatement,
    For,
    Function,
    If,
    Lambda,
    Local,
    Name,
    Operation,
    PythonText,
    Raise,
    Return,
    Statement,
    Subscript,
    Try,
    Tuple,
    While,
    Yield,
)

INDENT: Final = "    "
MAX_CONDITION_COLUMNS: Final = 100
"""Conditions longer than this are broken into several lines, since people read generated code too."""

_CHOICE, _OR, _AND, _NOT, _COMPARISON, _BIT_OR, _BIT_XOR, _BIT_AND, _SHIFT, _SUM, _PRODUCT, _MINUS, ATOM = range(13)
"""Precedence levels of operators, the loosest first."""
_PRECEDENCES: Final = {
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


class PrintedSource(NamedTuple):
    """Printed source text with the origin of each line.

    Attributes:
        text: the source text; it ends with a line break.
        origins: the origin of each line, in order.
    """

    text: str
    origins: tuple[object, ...]


def print_source(definitions: Body) -> PrintedSource:
    """Return the source text of statements, with the origin of each line."""
    printer = _SourcePrinter()
    printer.print_body(definitions, "", None)
    return PrintedSource("\n".join([*printer.lines, ""]), tuple(printer.origins))


class _SourcePrinter:
    """A printer that collects source lines and their origins."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.origins: list[object] = []

    def add_line(self, text: str, origin: object) -> None:
        self.lines.append(text)
        self.origins.append(origin)

    def print_body(self, statements: Body, pad: str, origin: object) -> None:
        for statement in statements:
            self.print_statement(statement, pad, origin if statement.origin is None else statement.origin)

    def print_compound(self, head: str, statements: Body, pad: str, origin: object) -> None:
        """Write a head line such as `for x in y:` and, indented below, its statements, or `pass` if there are none."""
        self.add_line(f"{pad}{head}:", origin)
        if statements:
            self.print_body(statements, pad + INDENT, origin)
        else:
            self.add_line(f"{pad}{INDENT}pass", origin)

    def print_statement(self, node: Statement, pad: str, origin: object) -> None:
        match node:
            case Assign(target, value, operator):
                self.add_line(f"{pad}{_target_text(target)} {operator} {expression_text(value)}", origin)
            case ExpressionStatement(value):
                self.add_line(f"{pad}{expression_text(value)}", origin)
            case If():
                self.print_if(node, pad, origin)
            case For(target, iterable, body):
                self.print_compound(f"for {_target_text(target)} in {expression_text(iterable)}", body, pad, origin)
            case Return(value):
                self.add_line(f"{pad}return {expression_text(value)}" if value else f"{pad}return", origin)
            case Yield(value, each):
                self.add_line(f"{pad}yield {'from ' if each else ''}{expression_text(value)}", origin)
            case Function(name, parameters, body):
                self.print_compound(f"def {name}({_comma_separated(parameters)})", body, pad, origin)
            case While(test, body):
                self.print_compound(f"while {expression_text(test)}", body, pad, origin)
            case BreakOrContinue(how):
                self.add_line(f"{pad}{how}", origin)
            case Raise(value):
                self.add_line(f"{pad}raise {expression_text(value)} from None" if value else f"{pad}raise", origin)
            case Try(body, handlers):
                self.print_compound("try", body, pad, origin)
                for handler in handlers:
                    name = f" as {handler.name.name}" if handler.name else ""
                    self.print_compound(f"except {handler.error.name}{name}", handler.body, pad, origin)
            case _:
                assert_never(node)

    def print_if(self, node: If, pad: str, origin: object) -> None:
        """Write an `if` statement; tests nested directly inside each other become one condition joined by `and`."""
        tests = [node.test]
        while not node.otherwise and len(node.then) == 1:
            inner = node.then[0]
            if not isinstance(inner, If) or inner.otherwise:
                break
            node = inner
            tests.append(node.test)
        texts = [expression_text(test, _AND if len(tests) > 1 else _CHOICE) for test in tests]
        if sum(map(len, texts)) + 5 * len(texts) < MAX_CONDITION_COLUMNS - len(pad):
            head = f"if {' and '.join(texts)}"
        else:
            self.add_line(f"{pad}if (", origin)
            for number, text in enumerate(texts):
                self.add_line(f"{pad}{INDENT}{'and ' if number else ''}{text}", origin)
            head = ")"
        self.print_compound(head, node.then, pad, origin)
        if node.otherwise:
            self.print_compound("else", node.otherwise, pad, origin)


def _target_text(node: Local | Name | Subscript | AttributeAccess | Tuple) -> str:
    if isinstance(node, Tuple):
        return f"{_comma_separated(node.items)}{',' * (len(node.items) == 1)}"
    return node.name if isinstance(node, Local) else expression_text(node)


def _comma_separated(nodes: tuple[Expression, ...]) -> str:
    return ", ".join([node.name if isinstance(node, Local | Name) else expression_text(node) for node in nodes])


def expression_text(node: Expression, precedence: int = _CHOICE) -> str:
    """Return the source text of an expression, in parentheses if the surrounding operator requires them.

    Args:
        node: the expression.
        precedence: the precedence of the surrounding operator. An expression of lower precedence gets parentheses.
    """
    match node:
        case Local(name) | Name(name):
            return name
        case Call(Name(name), arguments):
            return f"{name}({_comma_separated(arguments)})"
        case Call(function, arguments):
            return f"{expression_text(function, ATOM)}({_comma_separated(arguments)})"
        case Subscript(Local(name), Local(key)):
            return f"{name}[{key}]"
        case Subscript(Local(name), key):
            return f"{name}[{expression_text(key)}]"
        case Subscript(collection, key):
            return f"{expression_text(collection, ATOM)}[{expression_text(key)}]"
        case Operation():
            text, own = _operation_text(node)
            return f"({text})" if own < precedence else text
        case Constant(value):
            return repr(value)
        case Tuple():
            return f"({_target_text(node)})"
        case AssignmentExpression(local, value):
            return f"({local.name} := {expression_text(value)})"
        case AttributeAccess(object_, name):
            return f"{expression_text(object_, ATOM)}.{name}"
        case ConditionalExpression(test, then, otherwise):
            chosen = f"{expression_text(then, _OR)} if {expression_text(test, _OR)}"
            text = f"{chosen} else {expression_text(otherwise)}"
            return f"({text})" if precedence > _CHOICE else text
        case DictExpression(items):
            return f"{{{', '.join(f'{expression_text(key)}: {expression_text(value)}' for key, value in items)}}}"
        case Comprehension(value, target, elements, test, late):
            # Parenthesise conditional expressions: Python would read their `if` as the comprehension's filter.
            text = f"{expression_text(value)} for {target.name} in {expression_text(elements, _OR)}"
            text += f" if {expression_text(test, _OR)}" if test else ""
            return f"({text})" if late else f"[{text}]"
        case Lambda(parameters, value):
            names = ", ".join(each.name for each in parameters)
            text = f"lambda {names}: {expression_text(value)}" if names else f"lambda: {expression_text(value)}"
            return f"({text})" if precedence > _CHOICE else text
        case PythonText(text):
            return text


def _operation_text(node: Operation) -> tuple[str, int]:
    operator, operands = node.operator, node.operands
    own = _PRECEDENCES[operator]
    if len(operands) == 1:
        own, sign = (_NOT, "not ") if operator == "not" else (_MINUS, operator)
        return sign + expression_text(operands[0], own), own
    first, *others = operands
    left = own + (own == _COMPARISON)
    right = own + (own >= _COMPARISON)
    text = expression_text(first, left)
    for other in others:
        text += f" {operator} {expression_text(other, right)}"
    return text, own
