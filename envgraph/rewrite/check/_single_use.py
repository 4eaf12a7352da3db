"""Variables that a rule names once, where they are probably mistyped."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

from envgraph.errors import Diagnostic, Severity
from envgraph.pattern import (
    Block,
    Edge,
    LeftSide,
    Modification,
    Node,
    Parameter,
    RightSide,
    Rule,
    Variable,
    mistyped,
)
from envgraph.rewrite.check._variables import is_named, mentioned, node_names, own_variables


def used_once(rule: Rule) -> list[Diagnostic]:
    """Warn of variables that one constraint mentions and nothing else, and of parameters that nothing mentions.

    Patterns are warned of all of them. In a rule it makes a difference what is named: a match has one for each value of
    its variables, and the objects of a condition differ from those around it. What remains are variables that a
    negation or an aggregate quantifies by itself, and those of conditions that are nearly called like another one.
    """
    given = {parameter.name for parameter in rule.parameters}
    given.update(name for group in rule.homomorphic for name in group)
    found: list[Diagnostic] = []
    uses = _part(rule.left, rule.blocks, rule.right, given, True, found)
    return found + [_unused(one) for one in rule.parameters if not uses[one.name] and one.direction != "out"]


def _part(
    left: LeftSide,
    blocks: Sequence[Block],
    right: RightSide | Modification | None,
    outside: Collection[str],
    matched: bool,
    found: list[Diagnostic],
) -> Counter[str]:
    """Return how often each name stands in a rule or block, those inside included; adds what is wrong.

    `matched`: whether the variables belong to a match.
    """
    places = [variable for constraint in left.constraints for variable in mentioned(constraint)]
    nodes = node_names(left)
    inside = {*outside, *nodes, *(variable.name for variable in places)}
    uses = Counter(variable.name for variable in places)
    uses.update([*nodes, *_names(right)])
    for block in blocks:
        rewrites = block.kind not in ("not", "require")
        uses.update(_part(block.left, block.blocks, block.right, inside, rewrites, found))
    once = [one for one in places if uses[one.name] == 1 and one.name not in outside and is_named(one.name)]
    bound = set(own_variables(left, outside)) if once else set()
    others = inside - {one.name for one in once}
    for one in once:
        if one.name not in bound:
            found.append(_quantified(one))
        elif not matched:
            found.extend(mistyped(one, others))
        others.add(one.name)  # of two such names the second is reported
    return uses


def _names(data: Any) -> Iterator[str]:
    """The names of objects and variables in a right side."""
    match data:
        case Variable() | Node():
            yield data.name
        case Edge():
            yield data.source
            yield data.target
        case tuple():
            for part in data:
                yield from _names(part)
    if is_dataclass(data):
        for field in fields(data):
            if field.compare:
                yield from _names(getattr(data, field.name))


def _unused(parameter: Parameter) -> Diagnostic:
    message = f"parameter `{parameter.name}` is used nowhere: the rule matches once for each of its values"
    hint = "leave it out, or name it in the left side"
    return Diagnostic("unused-parameter", message, parameter.span, hint, Severity.WARNING)


def _quantified(variable: Variable) -> Diagnostic:
    message = f"`{variable.name}` is used only here, so it is quantified inside the call"
    hint = f"start its name with `_` (`_{variable.name}`) if that is meant"
    return Diagnostic("quantified-variable", message, variable.span, hint, Severity.WARNING)
