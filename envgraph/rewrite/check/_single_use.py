"""A check for variables that a rule uses once and that are probably mistyped, and for unused parameters."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator

from envgraph.code import walk_parts
from envgraph.errors import Diagnostic, Severity
from envgraph.pattern import (
    Body,
    BodyVariables,
    Parameter,
    Rule,
    RuleBlock,
    RuleEdge,
    RuleNode,
    Variable,
    misspelling_warnings,
    quantified_variable_warning,
)
from envgraph.rewrite.check._lhs_variables import is_named, node_names


def check_single_use(rule: Rule) -> list[Diagnostic]:
    """Warn about variables that only one constraint mentions, and about parameters that are never used.

    Patterns get a warning for every variable that is used once. In rules such a variable can have an effect: the rule
    matches once for each of its values, and injectivity makes it differ from other objects. So rules get a warning only
    for variables that a negation or an aggregate quantifies, and for condition variables named almost like another.
    """
    given = {parameter.name for parameter in rule.parameters}
    given.update(name for group in rule.homomorphic for name in group)
    found: list[Diagnostic] = []
    uses = _check_part(rule, given, True, found)
    return found + [_unused_warning(one) for one in rule.parameters if not uses[one.name] and one.direction != "out"]


def _check_part(
    part: Rule | RuleBlock, outside: Collection[str], matched: bool, found: list[Diagnostic]
) -> Counter[str]:
    """Add warnings about a rule or block to `found`; return how often each name occurs in it, inner blocks included.

    Args:
        outside: the names that enclosing parts declare.
        matched: True if the variables belong to a match.
    """
    reading, nodes = BodyVariables(Body(part.left.constraints), ()), node_names(part.left)
    inside = {*outside, *nodes, *reading.names}
    uses = Counter({name: len(places) for name, places in reading.occurrences.items()})
    uses.update([*nodes, *_rhs_names(part)])
    for block in part.blocks:
        uses.update(_check_part(block, inside, block.kind not in ("not", "require"), found))
    once = [name for name in reading.names if uses[name] == 1 and name not in outside and is_named(name)]
    others = inside.difference(once)
    for name in once:
        variable = reading.occurrences[name][0].variable
        if reading.quantifying_relation(name) is not None:
            found.append(quantified_variable_warning(variable))
        elif not matched:
            found.extend(misspelling_warnings(variable, others))
        others.add(name)  # of two similar names only the second is reported
    return uses


def _rhs_names(part: Rule | RuleBlock) -> Iterator[str]:
    """Yield the names of objects and variables in a right-hand side, once for each occurrence."""
    for one in walk_parts(part.right):
        if isinstance(one, Variable | RuleNode):
            yield one.name
        elif isinstance(one, RuleEdge):
            yield from (one.source, one.target)


def _unused_warning(parameter: Parameter) -> Diagnostic:
    message = f"parameter `{parameter.name}` is used nowhere: the rule matches once for each of its values"
    hint = "leave it out, or name it in the left side"
    return Diagnostic("unused-parameter", message, parameter.span, hint, Severity.WARNING)
