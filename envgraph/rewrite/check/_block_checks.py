"""Checks of the changes of one block for contradictions, lost links, orphans and missing required features."""

from __future__ import annotations

from dataclasses import replace

from envgraph.errors import Diagnostic, Note, Severity, has_errors, quote_with_article
from envgraph.metamodel import Attribute, Feature
from envgraph.pattern import Modification, RuleEdge
from envgraph.rewrite._rule_plan import AdjustAttribute, BlockPlan, ChangeTargets, SetAttributeValues, SetTargets
from envgraph.rewrite.check._claims import claims_of
from envgraph.rewrite.check._containment import contained_end, loses_container
from envgraph.rewrite.check._contradictions import ConflictCheck, Contradiction
from envgraph.rewrite.check._rhs import BlockChanges
from envgraph.rewrite.check._rule_scope import LinkKey, ResolvedEdge, RuleScope


def check_block(changes: BlockChanges, plan: BlockPlan) -> None:
    """Report contradictions in a block, and warn about missing required values, orphans and links lost by retyping.

    Orphans are only checked in a `modify` part without nested blocks. So are lost links, and only under DPO.
    """
    _check_consistent(changes, plan)
    if not has_errors(changes.scope.problems):
        _check_required(changes, plan)  # a wrong value is no missing one
    if isinstance(changes.right_side, Modification) and not plan.nested:
        if changes.rule.semantics == "dpo":
            _check_retyped(changes)
        _check_orphans(changes)


def check_links(changes: BlockChanges) -> None:
    """Report links both deleted and created or preserved. Warn about deleted or redirected links that no LHS has."""
    for key, edge in changes.deleted_edges.items():
        if key in changes.rhs_links or key in changes.links:
            message = f"`{edge.source} -{edge.reference}-> {edge.target}` is both deleted and created or kept"
            hint = "remove the deletion, or the edge that creates or keeps the link"
            changes.scope.error("duplicate-action", message, edge.span, hint)
        else:
            _check_matched_link(changes, key, edge, "nothing happens")
    for key, edge in changes.redirected_edges.items():
        _check_matched_link(changes, key, edge, "the rule is refused")


def _check_matched_link(changes: BlockChanges, key: LinkKey, edge: RuleEdge, effect_if_missing: str) -> None:
    """Warn about a deleted or redirected link that no edge, path or pattern call of the left-hand sides can match.

    The message says `effect_if_missing`, the effect if the link is missing.
    """
    if key in changes.scope.lhs_path_links or any(
        changes.scope.link_key(arrow) == key for arrow in changes.scope.lhs_edges
    ):
        return
    if any({edge.source, edge.target} <= called for called in changes.scope.call_variables):
        return
    text = f"{edge.source} -{edge.reference}-> {edge.target}"
    message = f"the left side does not contain `{text}`: if the link is missing, {effect_if_missing}"
    changes.scope.warn("unmatched-link", message, edge.span, f"add `{text};` to the left side")


def _check_consistent(changes: BlockChanges, plan: BlockPlan) -> None:
    """Report two actions that contradict each other at every match, by a check on variables in place of objects.

    Actions with computed values are skipped, because the values are unknown. If variables may refer to one object, a
    contradiction is reported only if it is about the same variable; otherwise each match is checked when it is applied.
    """
    computed = {each.slot for each in plan.computed}
    sets = (change for change in plan.sets if isinstance(change, SetTargets | ChangeTargets))
    kept = (edge for key, edge in changes.rhs_links.items() if key not in changes.links)
    symbolic = replace(
        plan,
        links=(*plan.links, *map(changes.link_operation, kept)),
        sets=tuple(change for change in sets if computed.isdisjoint(change.values)),
    )
    conflicts = ConflictCheck(changes.scope.metamodel, lambda slot: f"`{plan.names[slot] or '..'}`", strict=True)
    try:
        conflicts.add_match(symbolic, [*claims_of(symbolic, changes.scope.metamodel)], range(len(plan.names)))
        conflicts.check_all()
    except Contradiction as error:
        if plan.may_coincide and not error.is_certain:
            return
        first, second = (want.operation.span for want in error.changes)
        if first and second and second.start < first.start:
            first, second = second, first
        notes = (Note("the other action is here", first),) if first else ()
        if error.is_refused:
            message = f"{error.message}, so that the rule can never be applied"
            hint = "leave one of the two out"
            found = Diagnostic("never-applicable", message, second, hint, Severity.WARNING, notes)
        else:
            found = Diagnostic("contradiction", error.message, second, "leave one of the two out", notes=notes)
        changes.scope.problems.append(found)


def _check_orphans(changes: BlockChanges) -> None:
    """Warn about a preserved object whose LHS container is deleted, unless the rule unlinks or moves the object."""
    gone = changes.deleted_without_merged
    for arrow in changes.scope.lhs_edges:
        own = arrow in changes.lhs_edges or {arrow.source, arrow.target} & {*changes.deleted}
        part = contained_end(arrow.reference, arrow.source, arrow.target, changes.scope.metamodel)
        if part is None:
            continue
        container = arrow.target if part == arrow.source else arrow.source
        if not own or container not in gone or part in changes.scope.deleted or _gets_container(changes, part):
            continue
        if changes.scope.link_key(arrow) in changes.deleted_edges:
            continue
        text = f"{arrow.source} -{arrow.reference.name}-> {arrow.target}"
        message = f"`{container}` is deleted, but `{part}`, which it contains by `{text}`, is kept"
        hint = (
            f"write `delete {part};` or `move {part} to ..`, or `delete {text};` to keep `{part}` without a container"
        )
        changes.scope.warn("orphan", message, changes.deletion_spans.get(container) or arrow.span, hint)


def _gets_container(changes: BlockChanges, part: str) -> bool:
    """Return True if the block may put a contained object into another container."""
    slot, metamodel = changes.scope.slot_of(part), changes.scope.metamodel
    if any(move.node == slot for move in changes.moves):
        return True
    if any(contained_end(e.reference, e.source, e.target, metamodel) == part for e in changes.links.values()):
        return True
    sets = (change for change in changes.assignments.operations if isinstance(change, SetTargets | ChangeTargets))
    return any(change.object == slot or slot in change.values for change in sets)


def _check_retyped(changes: BlockChanges) -> None:
    """Warn about retypings to a class that cannot have a preserved LHS link, or that cannot stay in a container."""
    for name in dict.fromkeys(changes.retyped):
        lost = next((arrow for arrow in changes.scope.lhs_edges if _is_lost(changes, arrow, name)), None)
        if lost is None:
            _check_homeless(changes, name)
            continue
        text = f"{lost.source} -{lost.reference.name}-> {lost.target}"
        new = quote_with_article(changes.scope.retyped[name])
        message = f"`{name}` becomes {new}, which cannot have `{text}`"
        hint = f"also write `delete {text};`, or write `@semantics(spo)` before the rule to remove the link"
        notes = (Note("the link is matched here", lost.span),) if lost.span else ()
        whole = f"{message}, so that the rule can never be applied"
        found = Diagnostic("never-applicable", whole, changes.change_spans.get(name), hint, Severity.WARNING, notes)
        changes.scope.problems.append(found)


def _check_homeless(changes: BlockChanges, name: str) -> None:
    """Warn if no container can contain a retyped object, unless it is moved or its link to the container is deleted."""
    before, after, metamodel = (changes.scope.class_before(name), changes.scope.retyped[name], changes.scope.metamodel)
    if any(move.node == changes.scope.slot_of(name) for move in changes.moves):
        return
    unlinked = changes.scope.unlinked.values()
    if any(contained_end(one.reference, one.source, one.target, metamodel) == name for one in unlinked):
        return
    if before and loses_container(metamodel.concrete_classes(before), after, metamodel):
        old, new = quote_with_article(before), quote_with_article(after)
        message = f"no container of {old} can contain {new}, so `{name}` cannot be retyped in a container"
        hint = f"write `move {name} to ..`, or delete the link to its container"
        changes.scope.warn("homeless", message, changes.change_spans.get(name), hint)


def _is_lost(changes: BlockChanges, arrow: ResolvedEdge, name: str) -> bool:
    """Return True if a preserved link does not fit the new class of a retyped object."""
    metamodel, cls, reference = changes.scope.metamodel, changes.scope.retyped[name], arrow.reference
    if changes.scope.link_key(arrow) in changes.scope.unlinked or {arrow.source, arrow.target} & {
        *changes.scope.deleted
    }:
        return False
    moved = any(move.node == changes.scope.slot_of(name) for move in changes.moves)
    if moved and contained_end(reference, arrow.source, arrow.target, metamodel) == name:
        return False
    lacking = arrow.source == name and metamodel.feature(cls, reference.name) != reference
    return lacking or (arrow.target == name and not metamodel.is_a(cls, reference.target))


def _check_required(changes: BlockChanges, plan: BlockPlan) -> None:
    """Warn about required references and value lists that are new for an object and that it does not get."""
    fresh = {name: set[Feature]() for name in changes.created if name in changes.scope.created}
    for name in changes.retyped:
        before = changes.scope.class_before(name)
        fresh[name] = set(changes.scope.metamodel.features(before).values()) if before else set()
    for name, had in fresh.items():
        cls = changes.scope.class_after(name)
        assert cls is not None
        for feature in changes.scope.metamodel.features(cls).values():
            single = isinstance(feature, Attribute) and not feature.many  # a created object has the default value
            if single or feature.lower == 0 or feature in had:
                continue
            if not _provides_feature(plan, changes.scope.slot_of(name), feature, changes.scope):
                _warn_required(changes, name, feature)


def _warn_required(changes: BlockChanges, name: str, feature: Feature) -> None:
    changes.scope.warn(
        "missing-required",
        f"`{name}` gets no `{feature.name}`, but `{feature}` has multiplicity {feature.multiplicity}",
        changes.change_spans.get(name),
        f"add `{feature.name} = ..`",
    )


def _provides_feature(plan: BlockPlan, slot: int, reference: Feature, scope: RuleScope) -> bool:
    """Return True if a plan adds a link of an object by a reference, from either end, or changes an attribute."""
    if isinstance(reference, Attribute):
        given = (one for one in plan.sets if isinstance(one, SetAttributeValues | AdjustAttribute))
        return any((one.object, one.attribute) == (slot, reference) for one in given)
    opposite = scope.metamodel.opposite(reference)
    for link in plan.links:
        if (link.source, link.reference) == (slot, reference) or (link.target, link.reference) == (slot, opposite):
            return True
    for change in plan.sets:
        if isinstance(change, SetTargets | ChangeTargets):
            if (change.object, change.reference) == (slot, reference):
                return True
            if change.reference == opposite and slot in change.values:
                return True
    moved = any(
        (m.container, m.reference) == (slot, reference) or (m.node, m.reference) == (slot, opposite) for m in plan.moves
    )
    return moved or any(_provides_feature(inner, slot, reference, scope) for inner in plan.nested)
