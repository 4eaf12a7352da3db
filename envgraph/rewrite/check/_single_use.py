"""Variables that a rule names once, where they are probably mistyped."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator

from envgraph.code import walk
from envgraph.errors import Diagnostic, Severity
from envgraph.pattern import (
    Block,
    Body,
    Edge,
    Node,
    Parameter,
    Reading,
    Rule,
    Variable,
    mistyped,
    quantified_variable,
)
from envgraph.rewrite.check._variables import is_named, node_names


def used_once(rule: Rule) -> list[Diagnostic]:
    """Warn of variables that one constraint mentions and nothing else, and of parameters that nothing mentions.

    Patterns are warned of all of them. In a rule it makes a difference what is named: a match has one for each value of
    its variables, and the objects of a condition differ from those around it. What remains are variables that a
    negation or an aggregate quantifies by itself, and those of conditions that are nearly called like another one.
    """
    given = {parameter.name for parameter in rule.parameters}
    given.update(name for group in rule.homomorphic for name in group)
    found: list[Diagnostic] = []
    uses = _check_part(rule, given, True, found)
    return found + [_unused(one) for one in rule.parameters if not uses[one.name] and one.direction != "out"]


def _check_part(
    part: Rule | Block, outside: Collection[str], matched: bool, found: list[Diagnostic]
) -> Counter[str]:
    """Add warnings about a rule or block to `found`; return how often each name occurs in it, inner blocks included.

    Args:
        outside: the names that enclosing parts declare.
        matched: whether the variables belong to a match.
    """
    reading, nodes = Reading(Body(part.left.constraints), ()), node_names(part.left)
    inside = {*outside, *nodes, *reading.names}
    uses = Counter({name: len(places) for name, places in reading.occurrences.items()})
    uses.update([*nodes, *_names(part)])
    for block in part.blocks:
        uses.update(_check_part(block, inside, block.kind not in ("not", "require"), found))
    once = [name for name in reading.names if uses[name] == 1 and name not in outside and is_named(name)]
    others = inside.difference(once)
    for name in once:
        variable = reading.occurrences[name][0].variable
        if reading.quantified(name) is not None:
            found.append(quantified_variable(variable))
        elif not matched:
            found.extend(mistyped(variable, others))
        others.add(name)  # of two such names the second is reported
    return uses


def _names(part: Rule | Block) -> Iterator[str]:
    """Yield the names of objects and variables in a right side, once for each place."""
    for one in walk(part.right):
        if isinstance(one, Variable | Node):
            yield one.name
        elif isinstance(one, Edge):
            yield from (one.source, one.target)


def _unused(parameter: Parameter) -> Diagnostic:
    message = f"parameter `{parameter.name}` is used nowhere: the rule matches once for each of its values"
    hint = "leave it out, or name it in the left side"
    return Diagnostic("unused-parameter", message, parameter.span, hint, Severity.WARNING)
