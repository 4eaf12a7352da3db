"""Translation of the changes of a block to its plan."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import combinations
from typing import Literal

from envgraph.pattern import StaticType
from envgraph.rewrite._rule_plan import BlockPlan, CreateObject, DeleteObject, RemoveLink, RetypeObject
from envgraph.rewrite.check._block_checks import check_block, check_links
from envgraph.rewrite.check._lhs_and_nac import LoweredBlock
from envgraph.rewrite.check._lhs_variables import may_be_same
from envgraph.rewrite.check._rhs import BlockChanges, read_changes

TypesOf = Callable[[LoweredBlock], Mapping[str, StaticType | None]]


def build_plan(changes: BlockChanges, types_of: TypesOf) -> BlockPlan:
    """Check a block and its nested blocks, and return their plan. The plan is usable only if no error was reported.

    `types_of` returns the types of the variables in the scope of a nested block.
    """
    check_links(changes)
    identified_links = _identification_link_pairs(changes)
    scope = changes.scope
    scope.unlinked.update(changes.unlinks)
    inner = (read_changes(changes.rule, block, scope, types_of(block)) for block in changes.lowered.nested)
    nested = tuple(build_plan(one, types_of) for one in inner)
    plan = _build_block_plan(changes, nested, identified_links)
    check_block(changes, plan)
    return plan


def _build_block_plan(
    changes: BlockChanges,
    nested: tuple[BlockPlan, ...],
    identified_links: tuple[tuple[RemoveLink, RemoveLink], ...],
) -> BlockPlan:
    scope, lowered, slot = changes.scope, changes.lowered, changes.scope.slot_of
    deletes = tuple(
        DeleteObject(slot(name), changes.deletion_spans.get(name)) for name in dict.fromkeys(changes.deleted)
    )
    unlinks = tuple(map(changes.unlink_operation, changes.unlinks.values()))
    links = map(changes.link_operation, changes.links.values())
    return BlockPlan(
        kind=_block_kind(changes),
        pattern=lowered.pattern.qualified_name,
        arguments=tuple(slot(name) for name in lowered.inherited_variables),
        inherited_count=changes.inherited_count,
        names=tuple(scope.names),
        classes=tuple(scope.class_before(name) for name in scope.names),
        variable_count=len(lowered.own_variables),
        may_coincide=any(_may_coincide(changes, *pair) for pair in combinations(scope.types, 2)),
        identification_pairs=_identification_pairs(changes),
        identification_link_pairs=identified_links,
        computed=tuple(changes.assignments.computed_values),
        unlinks=unlinks,
        deletes=deletes,
        retypes=tuple(
            RetypeObject(slot(name), scope.retyped[name], changes.change_spans.get(name))
            for name in dict.fromkeys(changes.retyped)
        ),
        creates=tuple(
            CreateObject(slot(name), scope.created[name]) for name in changes.created if name in scope.created
        ),
        absorbs=tuple(changes.absorbs),
        moves=tuple(changes.moves),
        links=(*links, *changes.assignments.initial_links),
        sets=tuple(changes.assignments.operations),
        nested=nested,
        span=lowered.pattern.span,
    )


def _block_kind(changes: BlockChanges) -> Literal["rule", "forall", "forall+", "optional"]:
    block = changes.lowered.block
    if block is None:
        return "rule"
    assert block.kind in ("forall", "forall+", "optional")
    return block.kind


def _may_coincide(changes: BlockChanges, one: str, other: str) -> bool:
    """Return True if two variables may refer to the same object in a match of this rule."""
    same = changes.scope.equated
    if one == other or frozenset((one, other)) in same:
        return True
    if changes.rule.injective and not may_be_same(one, other, changes.rule.homomorphic, same):
        return False
    left, right = changes.scope.class_before(one), changes.scope.class_before(other)
    return bool(left and right and changes.scope.metamodel.may_overlap(left, right))


def _identification_pairs(changes: BlockChanges) -> tuple[tuple[int, int], ...]:
    """Return the slot pairs, new in this block, of a deleted or merged object and a variable that may be the same."""
    scope = changes.scope
    own = {*changes.deleted, *(scope.names[a.absorbed] for a in changes.absorbs)}
    return tuple(
        (scope.slot_of(name), scope.slot_of(other))
        for name in scope.deleted
        for other in (scope.types if name in own else changes.lowered.own_variables)
        if name != other and _may_coincide(changes, name, other)
    )


def _identification_link_pairs(changes: BlockChanges) -> tuple[tuple[RemoveLink, RemoveLink], ...]:
    """Return the pairs, new in this block, of a deleted link and another link of the LHS that may be the same link."""
    scope = changes.scope
    found: list[tuple[RemoveLink, RemoveLink]] = []
    for key, gone in {**scope.unlinked, **changes.unlinks}.items():
        for arrow in scope.lhs_edges if key in changes.unlinks else changes.lhs_edges:
            same = scope.link_key(arrow)
            if same == key or same[0] != key[0]:
                continue
            if _may_coincide(changes, key[1], same[1]) and _may_coincide(changes, key[2], same[2]):
                found.append((changes.unlink_operation(gone), changes.unlink_operation(arrow)))
    return tuple(found)
