"""Rules that are generated from a metamodel: search operators and retypings.

The operators have the scheme of Burdusel, Zschaler and John, "Automatic generation of atomic multiplicity-preserving
search operators for search-based model engineering" (Software and Systems Modeling 20, 2021): for a reference `n..m`
whose opposite is `k..l`, the conditions of every operator ensure that a valid model stays valid. In addition to the
paper, objects that need each other are created and deleted together, contained objects are deleted with their
container, and there are operators for numbers, truth values and enums.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, count, permutations

from envgraph.code import dataclass
from envgraph.metamodel import Metamodel
from envgraph.pattern import (
    Derivation,
    LeftSide,
    Modification,
    Pattern,
    RetypeAction,
    Rule,
    TypeConstraint,
    Variable,
)
from envgraph.rewrite.derive._derivation_check import KINDS, kind_weight, most_ways
from envgraph.rewrite.derive._feature_operators import container_operators, link_operators, value_operators
from envgraph.rewrite.derive._object_operators import object_operators, retyping_operators
from envgraph.rewrite.derive._reference_ends import Schema
from envgraph.rewrite.derive._rule_builder import RuleBuilder


@dataclass(frozen=True, slots=True)
class DerivedRules:
    """The rules and patterns that a derivation generates.

    Attributes:
        patterns: the patterns that the rules call.
        rules: the rules, in the order of `KINDS`.
    """

    patterns: tuple[Pattern, ...]
    rules: tuple[Rule, ...]


def derived(derivation: Derivation, metamodel: Metamodel) -> DerivedRules:
    """Return the rules that a derivation without errors generates, and the patterns that they call."""
    if derivation.kind == "operators":
        return _operators(derivation, metamodel)
    return DerivedRules((), _retypings(derivation))


def derived_rules(derivation: Derivation, metamodel: Metamodel) -> tuple[Rule, ...]:
    """Return the rules that a derivation without errors generates.

    For `retype among`: a rule for each ordered pair of classes, in the order of the text; the first class matches
    exactly, without subclasses. For `operators for` see `docs/languages/derived.md`.
    """
    return derived(derivation, metamodel).rules


def _retypings(derivation: Derivation) -> tuple[Rule, ...]:
    return tuple(
        Rule(
            f"{derivation.name}.{before}.{after}",
            left=LeftSide(constraints=(TypeConstraint(before, Variable("object"), exact=True),)),
            right=Modification((RetypeAction(Variable("object"), after),)),
            package=derivation.package,
            weight=derivation.weight,
            doc=f"Retype a `{before}` to `{after}`.",
            span=derivation.span,
        )
        for before, after in permutations(derivation.classes, 2)
    )


# --- operators


def _operators(derivation: Derivation, metamodel: Metamodel) -> DerivedRules:
    """Return the operators of a derivation without errors, with their weights, and the patterns that they call."""
    schema, ways = Schema(metamodel), most_ways(derivation)
    found: dict[str, Rule] = {}
    patterns: dict[str, Pattern] = {}
    retype = kind_weight(derivation, "retype") > 0
    for cls in derivation.classes:
        for builder in _all_operators(schema, derivation.qualified_name, cls, ways, retype):
            rule = _with_unused_name(replace(builder.build_rule(), span=derivation.span), found)
            found.setdefault(rule.name, rule)
            patterns.update(builder.patterns)
    caps = {kind: value for one in derivation.annotations if one.name == "cap" for kind, value in one.named}
    rules: list[Rule] = []
    for kind in KINDS:
        weight = kind_weight(derivation, kind)
        family = [rule for rule in found.values() if _name_part(rule, 1) == kind]
        family = _first_rules(family, int(caps.get(kind, len(family))))
        if weight > 0:
            rules += [replace(rule, weight=weight / len(family)) for rule in family]
    return DerivedRules(tuple(patterns.values()), tuple(rules))


def _all_operators(schema: Schema, group: str, cls: str, max_plans: int, retype: bool) -> Iterator[RuleBuilder]:
    for concrete in schema.metamodel.concrete_classes(cls):
        if not schema.frozen(concrete):
            yield from object_operators(schema, group, concrete, max_plans)
    yield from link_operators(schema, group, cls)
    yield from container_operators(schema, group, cls)
    if retype:
        yield from retyping_operators(schema, group, cls, max_plans)
    yield from value_operators(schema, group, cls)


def _with_unused_name(rule: Rule, found: Mapping[str, Rule]) -> Rule:
    """Return the rule, with a number added to its name if a different rule in `found` has this name."""
    names = chain([rule.name], (f"{rule.name}.{number}" for number in count(2)))
    named = (replace(rule, name=name) for name in names)
    return next(one for one in named if found.get(one.name, one) == one)


def _name_part(rule: Rule, place: int) -> str:
    """Return a part of the name `group.kind.Class..` of a rule, by its index."""
    return rule.name.split(".")[place]


def _first_rules(rules: Sequence[Rule], max_rules: int) -> list[Rule]:
    """Return at most `max_rules` rules, in their order. The first rule of every class is chosen before any second
    rule.
    """
    before: Counter[str] = Counter()
    ranks: list[tuple[int, int]] = []
    for number, rule in enumerate(rules):
        cls = _name_part(rule, 2)
        ranks.append((before[cls], number))
        before[cls] += 1
    return [rules[number] for number in sorted(number for _, number in sorted(ranks)[:max_rules])]
