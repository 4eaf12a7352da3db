"""Translation of the changes of a block to its plan."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import combinations
from typing import Literal

from envgraph.pattern import StaticType
from envgraph.rewrite._plan import BlockPlan, ChangeClass, Delete, New, Unlink
from envgraph.rewrite.check._actions import Changes, changes_of
from envgraph.rewrite.check._lhs import LoweredBlock
from envgraph.rewrite.check._lints import check_block, check_links
from envgraph.rewrite.check._variables import may_be_one

TypesOf = Callable[[LoweredBlock], Mapping[str, StaticType | None]]


def plan_of(changes: Changes, types_of: TypesOf) -> BlockPlan:
    """Check a block and its nested blocks, and return their plan. The plan is usable only if no error was reported.

    `types_of` returns the types of the variables in the scope of a nested block.
    """
    check_links(changes)
    identified_links = _identified_links(changes)
    scope = changes.scope
    scope.unlinked.update(changes.unlinks)
    inner = (changes_of(changes.rule, block, scope, types_of(block)) for block in changes.lowered.nested)
    nested = tuple(plan_of(one, types_of) for one in inner)
    plan = _plan(changes, nested, identified_links)
    check_block(changes, plan)
    return plan


def _plan(
    changes: Changes, nested: tuple[BlockPlan, ...], identified_links: tuple[tuple[Unlink, Unlink], ...]
) -> BlockPlan:
    scope, lowered, slot = changes.scope, changes.lowered, changes.scope.slot
    deletes = tuple(Delete(slot(name), changes.gone.get(name)) for name in dict.fromkeys(changes.deleted))
    unlinks = tuple(map(changes.unlink, changes.unlinks.values()))
    links = map(changes.link, changes.links.values())
    return BlockPlan(
        kind=_kind(changes),
        pattern=lowered.pattern.qualified_name,
        arguments=tuple(slot(name) for name in lowered.inherited),
        inherited=changes.inherited,
        names=tuple(scope.names),
        classes=tuple(scope.before(name) for name in scope.names),
        variables=len(lowered.own),
        coinciding=any(_may_coincide(changes, *pair) for pair in combinations(scope.types, 2)),
        identified=_identified(changes),
        identified_links=identified_links,
        computed=tuple(changes.values.computed),
        unlinks=unlinks,
        deletes=deletes,
        retypes=tuple(
            ChangeClass(slot(name), scope.retyped[name], changes.spans.get(name))
            for name in dict.fromkeys(changes.retyped)
        ),
        creates=tuple(
            New(slot(name), scope.created[name]) for name in changes.created if name in scope.created
        ),
        absorbs=tuple(changes.absorbs),
        moves=tuple(changes.moves),
        links=(*links, *changes.values.links),
        sets=tuple(changes.values.sets),
        nested=nested,
        span=lowered.pattern.span,
    )


def _kind(changes: Changes) -> Literal["rule", "forall", "forall+", "optional"]:
    block = changes.lowered.block
    if block is None:
        return "rule"
    assert block.kind in ("forall", "forall+", "optional")
    return block.kind


def _may_coincide(changes: Changes, one: str, other: str) -> bool:
    """Return True if two variables may refer to the same object in a match of this rule."""
    same = changes.scope.equated
    if one == other or frozenset((one, other)) in same:
        return True
    if changes.rule.injective and not may_be_one(one, other, changes.rule.homomorphic, same):
        return False
    left, right = changes.scope.before(one), changes.scope.before(other)
    return bool(left and right and changes.scope.metamodel.overlap(left, right))


def _identified(changes: Changes) -> tuple[tuple[int, int], ...]:
    """Return the slot pairs, new in this block, of a deleted or merged object and a variable that may be the same."""
    scope = changes.scope
    own = {*changes.deleted, *(scope.names[a.absorbed] for a in changes.absorbs)}
    return tuple(
        (scope.slot(name), scope.slot(other))
        for name in scope.deleted
        for other in (scope.types if name in own else changes.lowered.own)
        if name != other and _may_coincide(changes, name, other)
    )


def _identified_links(changes: Changes) -> tuple[tuple[Unlink, Unlink], ...]:
    """Return the pairs, new in this block, of a deleted link and another link of the LHS that may be the same link."""
    scope = changes.scope
    found: list[tuple[Unlink, Unlink]] = []
    for key, gone in {**scope.unlinked, **changes.unlinks}.items():
        for arrow in scope.arrows if key in changes.unlinks else changes.arrows:
            same = scope.key(arrow)
            if same == key or same[0] != key[0]:
                continue
            if _may_coincide(changes, key[1], same[1]) and _may_coincide(changes, key[2], same[2]):
                found.append((changes.unlink(gone), changes.unlink(arrow)))
    return tuple(found)
