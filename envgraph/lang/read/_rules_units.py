"""Parse the control units of rules."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from lark import Token, Tree

from envgraph.lang.read._expressions import expression_of, expressions_of
from envgraph.lang.read._query_conditions import condition_of, term_of
from envgraph.lang.read._reading import Reading
from envgraph.lang.syntax._parsing import qualified_name_of, tokens, trees
from envgraph.pattern import (
    Alap,
    Applicable,
    Atomic,
    Call,
    Choice,
    Constant,
    Constraint,
    EnumLiteral,
    Evaluation,
    Expression,
    If,
    Repeat,
    Sequence,
    Step,
    Try,
    Variable,
)


def block_of(reading: Reading, tree: Tree[Token]) -> Sequence:
    """Parse a `block` tree into a sequence of steps."""
    return Sequence(tuple(step_of(reading, part) for part in trees(tree.children)), reading.span(tree))


def step_of(reading: Reading, tree: Tree[Token]) -> Step:
    """Parse one step of a unit."""
    return _STEPS[tree.data](reading, tree)


def _call(reading: Reading, tree: Tree[Token]) -> Call:
    name = trees(tree.children, "qualified_name")[0]
    top = [int(tokens(part.children, "INT")[0]) for part in trees(tree.children, "top")]
    by = trees(tree.children, "by")
    return Call(
        qualified_name_of(name),
        expressions_of(reading, tree),
        bool(top or tokens(tree.children, "ALL")),
        reading.span(tree),
        reading.span(name),
        bool(tokens(tree.children, "FIRST")),
        top[0] if top else None,
        expression_of(reading, trees(by[0].children)[0]) if by else None,
        tuple(
            condition
            for where in trees(tree.children, "where")
            for part in trees(where.children)
            if (condition := _asked(reading, part)) is not None
        ),
    )


def _asked(reading: Reading, tree: Tree[Token]) -> Constraint | None:
    """Parse a condition; if it is invalid (which is reported), record its text as a gap and return None."""
    condition = condition_of(reading, tree)
    if condition is None:
        reading.gap(tree)
    return condition


def _choice(reading: Reading, tree: Tree[Token]) -> Choice:
    return Choice(tuple(_alternative(reading, part) for part in trees(tree.children)), reading.span(tree))


def _alternative(reading: Reading, tree: Tree[Token]) -> Step:
    return block_of(reading, tree) if tree.data == "block" else _call(reading, tree)


def _only_block(reading: Reading, tree: Tree[Token]) -> Sequence:
    return block_of(reading, trees(tree.children, "block")[0])


def _repeat(reading: Reading, tree: Tree[Token]) -> Repeat:
    bounds = [_bound(reading, part) for part in trees(tree.children) if part.data != "block"]
    return Repeat(bounds[0], bounds[-1], _only_block(reading, tree), reading.span(tree))


def _bound(reading: Reading, tree: Tree[Token]) -> int | Expression:
    """Parse the bound of `repeat`: an int, or an expression that is evaluated when the step begins."""
    expression = expression_of(reading, tree)
    if isinstance(expression, Constant) and type(expression.value) is int:
        return expression.value
    return expression


def _try(reading: Reading, tree: Tree[Token]) -> Try:
    body, *otherwise = (block_of(reading, part) for part in trees(tree.children, "block"))
    return Try(body, next(iter(otherwise), None), reading.span(tree))


def _if(reading: Reading, tree: Tree[Token]) -> If | Sequence:
    """Parse an `if` step; if its condition is invalid (already reported), return only the first branch."""
    asked, then, *otherwise = trees(tree.children)
    condition: Constraint | Applicable | None = _applicable(reading, asked)
    if condition is None:
        condition = _asked(reading, asked)
    body = block_of(reading, then)
    if condition is None:
        return body
    others = [
        block_of(reading, part) if part.data == "block" else step_of(reading, part) for part in otherwise
    ]
    return If(condition, body, next(iter(others), None), reading.span(tree))


def _applicable(reading: Reading, tree: Tree[Token]) -> Applicable | None:
    """Parse the condition `rule` or `rule(a, b)`, which asks if a rule is applicable; return None for other conditions.

    Return None for `name(a)` too, which is parsed as a type constraint; the check of units decides if it names a rule.
    """
    if tree.data == "asked":
        name = tokens(tree.children, "NAME")[0]
        return Applicable(str(name), (), len(tree.children) > 1, reading.span(tree))
    relation = trees(tree.children)[0] if tree.data == "negation" else tree
    if relation.data != "type_constraint":
        return None
    head, terms = trees(relation.children)[0], trees(trees(relation.children, "terms")[0].children)
    if head.data != "type" or head.children[0] or len(terms) == 1:
        return None
    arguments = tuple(_argument(reading, term) for term in terms)
    return Applicable(str(head.children[1]), arguments, relation is not tree, reading.span(tree))


def _argument(reading: Reading, tree: Tree[Token]) -> Expression:
    term = term_of(reading, tree)
    if isinstance(term, Evaluation):
        return term.expression
    if not isinstance(term, Variable | Constant | EnumLiteral):
        reading.error(
            "misplaced-expression",
            "this cannot be an argument of a rule",
            tree,
            "write a variable or a value",
        )
        return Variable("_")
    return term


_STEPS: Mapping[str, Callable[[Reading, Tree[Token]], Step]] = {
    "call": _call,
    "choice": _choice,
    "alap": lambda reading, tree: Alap(_only_block(reading, tree), reading.span(tree)),
    "atomic": lambda reading, tree: Atomic(_only_block(reading, tree), reading.span(tree)),
    "repeat": _repeat,
    "try": _try,
    "if": _if,
}
