"""Parse the control units of rules."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from lark import Token, Tree

from envgraph.lang.read._expression_parser import parse_expression, parse_expressions
from envgraph.lang.read._file_reading import FileReading
from envgraph.lang.read._query_conditions import parse_condition, parse_conditions, parse_term
from envgraph.lang.syntax._parser import qualified_name_of, select_tokens, select_trees
from envgraph.pattern import (
    Alap,
    Applicable,
    AtomicStep,
    Constant,
    EnumLiteral,
    Evaluation,
    Expression,
    IfStep,
    Repeat,
    Step,
    StepSequence,
    TryStep,
    UnitCall,
    UnitChoice,
    Variable,
)


def parse_unit_block(reading: FileReading, tree: Tree[Token]) -> StepSequence:
    """Parse a `block` tree into a sequence of steps."""
    return StepSequence(tuple(parse_step(reading, part) for part in select_trees(tree.children)), reading.span(tree))


def parse_step(reading: FileReading, tree: Tree[Token]) -> Step:
    """Parse one step of a unit."""
    return _STEP_PARSERS[tree.data](reading, tree)


def _parse_call(reading: FileReading, tree: Tree[Token]) -> UnitCall:
    name = select_trees(tree.children, "qualified_name")[0]
    top = [int(select_tokens(part.children, "INT")[0]) for part in select_trees(tree.children, "top")]
    by = select_trees(tree.children, "by")
    return UnitCall(
        qualified_name_of(name),
        parse_expressions(reading, tree),
        bool(top or select_tokens(tree.children, "ALL")),
        reading.span(tree),
        reading.span(name),
        bool(select_tokens(tree.children, "FIRST")),
        top[0] if top else None,
        parse_expression(reading, select_trees(by[0].children)[0]) if by else None,
        parse_conditions(
            reading, (part for where in select_trees(tree.children, "where") for part in select_trees(where.children))
        ),
    )


def _parse_choice(reading: FileReading, tree: Tree[Token]) -> UnitChoice:
    return UnitChoice(
        tuple(_parse_alternative(reading, part) for part in select_trees(tree.children)), reading.span(tree)
    )


def _parse_alternative(reading: FileReading, tree: Tree[Token]) -> Step:
    return parse_unit_block(reading, tree) if tree.data == "block" else _parse_call(reading, tree)


def _parse_body(reading: FileReading, tree: Tree[Token]) -> StepSequence:
    return parse_unit_block(reading, select_trees(tree.children, "block")[0])


def _parse_repeat(reading: FileReading, tree: Tree[Token]) -> Repeat:
    bounds = [_parse_bound(reading, part) for part in select_trees(tree.children) if part.data != "block"]
    return Repeat(bounds[0], bounds[-1], _parse_body(reading, tree), reading.span(tree))


def _parse_bound(reading: FileReading, tree: Tree[Token]) -> int | Expression:
    """Parse the bound of `repeat`: an int, or an expression that is evaluated when the step begins."""
    expression = parse_expression(reading, tree)
    if isinstance(expression, Constant) and type(expression.value) is int:
        return expression.value
    return expression


def _parse_try(reading: FileReading, tree: Tree[Token]) -> TryStep:
    body, *otherwise = (parse_unit_block(reading, part) for part in select_trees(tree.children, "block"))
    return TryStep(body, next(iter(otherwise), None), reading.span(tree))


def _parse_if(reading: FileReading, tree: Tree[Token]) -> IfStep | StepSequence:
    """Parse an `if` step; if its condition is invalid (already reported), return only the first branch."""
    asked, then, *otherwise = select_trees(tree.children)
    condition = _parse_applicable(reading, asked) or parse_condition(reading, asked)
    if condition is None:
        reading.record_gap(asked)
    body = parse_unit_block(reading, then)
    if condition is None:
        return body
    others = [
        parse_unit_block(reading, part) if part.data == "block" else parse_step(reading, part) for part in otherwise
    ]
    return IfStep(condition, body, next(iter(others), None), reading.span(tree))


def _parse_applicable(reading: FileReading, tree: Tree[Token]) -> Applicable | None:
    """Parse the condition `rule` or `rule(a, b)`, which asks if a rule is applicable; return None for other conditions.

    Return None for `name(a)` too, which is parsed as a type constraint; the check of units decides if it names a rule.
    """
    if tree.data == "asked":
        name = select_tokens(tree.children, "NAME")[0]
        return Applicable(str(name), (), len(tree.children) > 1, reading.span(tree))
    relation = select_trees(tree.children)[0] if tree.data == "negation" else tree
    if relation.data != "type_constraint":
        return None
    head, terms = (
        select_trees(relation.children)[0],
        select_trees(select_trees(relation.children, "terms")[0].children),
    )
    if head.data != "type" or head.children[0] or len(terms) == 1:
        return None
    arguments = tuple(_parse_argument(reading, term) for term in terms)
    return Applicable(str(head.children[1]), arguments, relation is not tree, reading.span(tree))


def _parse_argument(reading: FileReading, tree: Tree[Token]) -> Expression:
    term = parse_term(reading, tree)
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


_STEP_PARSERS: Mapping[str, Callable[[FileReading, Tree[Token]], Step]] = {
    "call": _parse_call,
    "choice": _parse_choice,
    "alap": lambda reading, tree: Alap(_parse_body(reading, tree), reading.span(tree)),
    "atomic": lambda reading, tree: AtomicStep(_parse_body(reading, tree), reading.span(tree)),
    "repeat": _parse_repeat,
    "try": _parse_try,
    "if": _parse_if,
}
