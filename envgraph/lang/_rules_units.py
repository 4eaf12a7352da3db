"""Control units: the tree to data."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from lark import Token, Tree

from envgraph.lang._expressions import Reading, expressions_of
from envgraph.lang._parsing import qualified_name_of, tokens, trees
from envgraph.lang._query_conditions import condition_of
from envgraph.pattern import (
    Alap,
    Atomic,
    Call,
    Check,
    Choice,
    If,
    Negation,
    PatternCall,
    Repeat,
    Sequence,
    Step,
    Try,
)


def block_of(reading: Reading, tree: Tree[Token]) -> Sequence:
    """The steps of a `block` tree."""
    return Sequence(tuple(step_of(reading, part) for part in trees(tree.children)), reading.span(tree))


def step_of(reading: Reading, tree: Tree[Token]) -> Step:
    """The data of one step."""
    return _STEPS[tree.data](reading, tree)


def _call(reading: Reading, tree: Tree[Token]) -> Call:
    name = trees(tree.children, "qualified_name")[0]
    return Call(
        qualified_name_of(name),
        expressions_of(reading, tree),
        bool(tokens(tree.children, "ALL")),
        reading.span(tree),
        name_span=reading.span(name),
    )


def _choice(reading: Reading, tree: Tree[Token]) -> Choice:
    return Choice(tuple(_call(reading, part) for part in trees(tree.children)), reading.span(tree))


def _alap(reading: Reading, tree: Tree[Token]) -> Alap:
    return Alap(_only_block(reading, tree), reading.span(tree))


def _atomic(reading: Reading, tree: Tree[Token]) -> Atomic:
    return Atomic(_only_block(reading, tree), reading.span(tree))


def _only_block(reading: Reading, tree: Tree[Token]) -> Sequence:
    return block_of(reading, trees(tree.children, "block")[0])


def _repeat(reading: Reading, tree: Tree[Token]) -> Repeat:
    bounds = tokens(tree.children, "INT")
    lower, upper = int(bounds[0]), int(bounds[-1])
    return Repeat(lower, upper, _only_block(reading, tree), reading.span(tree))


def _try(reading: Reading, tree: Tree[Token]) -> Try:
    body, *otherwise = (block_of(reading, part) for part in trees(tree.children, "block"))
    return Try(body, next(iter(otherwise), None), reading.span(tree))


def _if(reading: Reading, tree: Tree[Token]) -> If | Sequence:
    """Without a condition that can be asked only the first branch is left; the file is refused anyway."""
    asked, then, *otherwise = trees(tree.children)
    condition = condition_of(reading, asked)
    body = block_of(reading, then)
    if not isinstance(condition, PatternCall | Negation | Check):
        if condition is not None:
            hint = "write `find` and a pattern, or `check` and an expression"
            reading.error("wrong-condition", "`if` asks `find`, `neg find` or `check`", asked, hint)
        reading.gap(asked)
        return body
    others = [
        block_of(reading, part) if part.data == "block" else step_of(reading, part) for part in otherwise
    ]
    return If(condition, body, next(iter(others), None), reading.span(tree))


_STEPS: Mapping[str, Callable[[Reading, Tree[Token]], Step]] = {
    "call": _call,
    "choice": _choice,
    "alap": _alap,
    "atomic": _atomic,
    "repeat": _repeat,
    "try": _try,
    "if": _if,
}
