"""Rewrite derived rules and patterns so that they can be written as text."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from typing import TypeVar

from envgraph.metamodel import Metamodel
from envgraph.pattern import (
    Aggregate,
    Body,
    Comparison,
    Constraint,
    LeftSide,
    Negation,
    Pattern,
    PatternCall,
    Relation,
    Rule,
    RuleBlock,
    Term,
    TypeConstraint,
)

_Definition = TypeVar("_Definition", Pattern, Rule)
_Side = TypeVar("_Side", Body, LeftSide)


def spelled_out(definitions: Iterable[_Definition], metamodel: Metamodel) -> tuple[_Definition, ...]:
    """Return derived rules, or the patterns that they call, with names and conditions that `to_text` can write.

    `wiring.add.Router.links` is renamed to `wiring_add_Router_links`. An exact type becomes a type condition and a
    negation for each subclass. The results match and do the same. Private patterns become public, because rules and
    patterns are written to two files.

    >>> from envgraph.metamodel import Class
    >>> from envgraph.pattern import Derivation
    >>> from envgraph.rewrite import derived_rules
    >>> from envgraph.lang import to_text
    >>> pond = Metamodel("pond", [Class("Fish"), Class("Eel", supertypes=("Fish",))])
    >>> rules = derived_rules(Derivation("kinds", "retype", ("Fish", "Eel")), pond)
    >>> print(to_text(*spelled_out(rules[:1], pond)), end="")
    /** Retype a `Fish` to `Eel`. */
    rule kinds_Fish_Eel {
        lhs { Fish(object); neg Eel(object); }
        modify { retype object : Eel; }
    }
    """
    spelling = _DerivedRewriter(metamodel)
    return tuple(spelling.rewrite_definition(one) for one in definitions)


class _DerivedRewriter:
    def __init__(self, metamodel: Metamodel) -> None:
        self._below: dict[str, list[str]] = {}
        for cls in metamodel.class_list:
            for above in cls.supertypes:
                self._below.setdefault(above, []).append(cls.name)

    def rewrite_definition(self, one: _Definition) -> _Definition:
        """Return a pattern or a rule with expressible names and conditions; a private pattern becomes public."""
        if isinstance(one, Pattern):
            bodies = tuple(self._rewrite_side(body) for body in one.bodies)
            return replace(one, name=_expressible_name(one.name), bodies=bodies, private=False)
        return replace(
            one,
            name=_expressible_name(one.name),
            left=self._rewrite_side(one.left),
            blocks=self._rewrite_blocks(one.blocks),
        )

    def _rewrite_blocks(self, blocks: tuple[RuleBlock, ...]) -> tuple[RuleBlock, ...]:
        return tuple(
            replace(block, left=self._rewrite_side(block.left), blocks=self._rewrite_blocks(block.blocks))
            for block in blocks
        )

    def _rewrite_side(self, side: _Side) -> _Side:
        found = (one for constraint in side.constraints for one in self._rewrite_constraint(constraint))
        return replace(side, constraints=tuple(found))

    def _rewrite_constraint(self, one: Constraint) -> list[Constraint]:
        match one:
            case TypeConstraint(type_, term, True):
                below = self._below.get(type_, ())
                return [replace(one, exact=False), *(Negation(TypeConstraint(sub, term)) for sub in below)]
            case Negation(relation):
                return [replace(one, relation=_rewrite_call(relation))]
            case Comparison(_, left, right):
                return [replace(one, left=_rewrite_term(left), right=_rewrite_term(right))]
            case PatternCall():
                return [_rewrite_call(one)]
        return [one]


def _rewrite_term(term: Term) -> Term:
    if isinstance(term, Aggregate):
        return replace(term, over=_rewrite_call(term.over))
    return term


def _rewrite_call(relation: Relation) -> Relation:
    if not isinstance(relation, PatternCall):
        return relation
    group, mark, rest = relation.pattern.partition("#")
    return replace(relation, pattern=group + _expressible_name(mark + rest))


def _expressible_name(name: str) -> str:
    return re.sub(r"[#.]|::", "_", name)
