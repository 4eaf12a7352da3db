"""Write links of a model, containment included."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from envgraph.errors import InvalidArgument
from envgraph.graph.store._relation import ReferenceStorage
from envgraph.graph.write import _write_errors as refusals
from envgraph.metamodel import Reference

if TYPE_CHECKING:
    from envgraph.graph.model._graph import Graph


def link(graph: Graph, source: int, reference: Reference, target: int) -> bool:
    """Add a link of a reference and of its opposite. Return False if the link exists already.

    If an object is linked into a container, it is first removed from its old container.

    Raises:
        TypeMismatch: an end is not of the class that the reference requires.
        RuleError: the reference, or its opposite at the target, is "full", or the link would close a cycle of
            "containment".
    """
    relation = graph.store.relations[reference.index]
    classes = graph.store.classes
    if not (relation.allows_source[classes[source]] and relation.allows_target[classes[target]]):
        raise refusals.wrong_link_error(graph, source, reference, target)
    if relation.is_contained:
        assert relation.opposite is not None
        return graph.link(target, relation.opposite, source)
    ends = relation.forward[source]
    if target in ends:
        return False
    if len(ends) >= relation.upper:
        raise refusals.full_reference_error(graph, source, reference)
    if relation.containment:
        return _move_into_container(graph, relation, source, target)
    if len(relation.backward[target]) >= relation.opposite_upper:
        assert relation.opposite is not None
        raise refusals.full_reference_error(graph, target, relation.opposite)
    relation.connect(source, target)
    return True


def add_target(graph: Graph, source: int, reference: Reference, target: int) -> bool:
    """Add a link as `link` does. If the opposite is single-valued, the target is first unlinked from its old source.

    Raises:
        TypeMismatch, RuleError: as `link`.
    """
    relation = graph.store.relations[reference.index]
    if relation.opposite is None or relation.opposite_upper != 1 or target in relation.forward[source]:
        return graph.link(source, reference, target)
    graph.set_target(target, relation.opposite, source)
    return True


def insert_target(graph: Graph, source: int, reference: Reference, index: int, target: int) -> None:
    """Link a target and move it to `index`, with the meaning of `list.insert`. A target linked already is only moved.

    Raises:
        TypeMismatch, RuleError: as `link`.
    """
    relation = graph.store.relations[reference.index]
    with graph.history.transaction_unless_loading():
        graph.add_target(source, reference, target)
        others = len(relation.forward[source]) - 1
        place = max(0, others + index) if index < 0 else min(index, others)
        graph.store.move_target(relation, source, target, place)


def _move_into_container(graph: Graph, relation: ReferenceStorage, container: int, node: int) -> bool:
    """Move an object into a container, out of its old container, and return True.

    Raises:
        RuleError: the container is the object itself, or inside it.
    """
    above: int | None = container
    while above is not None:
        if above == node:
            raise refusals.cyclic_containment_error(graph, node, container)
        found = graph.container(above)
        above = found and found[0]
    old = graph.container(node)
    try:
        if old:
            graph.store.relations[old[1].index].disconnect(old[0], node)
        relation.connect(container, node)
    except BaseException:
        graph.store.interrupted_writes.append((link, (graph, container, relation.reference, node)))
        graph.store.interrupted_writes.repair()
        raise
    return True


def unlink(graph: Graph, source: int, reference: Reference, target: int) -> bool:
    """Remove a link of a reference and of its opposite. Return False if the link does not exist."""
    relation = graph.store.relations[reference.index]
    if target not in relation.forward[source]:
        return False
    relation.disconnect(source, target)
    return True


def set_target(graph: Graph, source: int, reference: Reference, target: int | None) -> None:
    """Make `target` the only target of a reference of `source`. None removes all targets.

    Unlike `link`, the function unlinks the old target. If the opposite is single-valued, it also unlinks the target
    from its old source.

    Raises:
        TypeMismatch: an end is not of the class that the reference requires.
        RuleError: a cycle of "containment", or a full many-valued opposite. Nothing has changed then.
    """
    relation = graph.store.relations[reference.index]
    if not relation.is_set_directly:
        graph.set_targets(source, reference, () if target is None else (target,))
        return
    classes = graph.store.classes
    if not (relation.allows_source[classes[source]] and (target is None or relation.allows_target[classes[target]])):
        raise refusals.wrong_link_error(graph, source, reference, target)
    old = relation.forward[source]
    if old and old[0] == target:
        return
    try:
        if old:
            relation.disconnect(source, old[0])
        if target is not None:
            if relation.opposite_upper == 1:
                holders = relation.backward[target]
                if holders:
                    relation.disconnect(holders[0], target)
            relation.connect(source, target)
    except BaseException:
        graph.store.interrupted_writes.append((set_target, (graph, source, reference, target)))
        graph.store.interrupted_writes.repair()
        raise


def set_targets(graph: Graph, source: int, reference: Reference, targets: Sequence[int]) -> None:
    """Replace all targets of a reference of `source`, in the order of `targets`. Links are replaced as in `set_target`.

    Raises:
        TypeMismatch, RuleError: as `set_target`; also more targets than the upper bound allows ("full").
        InvalidArgument: a target occurs twice.
    """
    relation = graph.store.relations[reference.index]
    classes = graph.store.classes
    if not relation.allows_source[classes[source]]:
        raise refusals.wrong_link_error(graph, source, reference, None)
    for target in targets:
        if not relation.allows_target[classes[target]]:
            raise refusals.wrong_link_error(graph, source, reference, target)
    old = relation.forward[source]
    if len(old) == len(targets) and tuple(old) == tuple(targets):
        return
    if not targets:  # clearing is never refused, so no transaction is needed
        graph.store.interrupted_writes.run(_clear_targets, relation, source)
        return
    if len(targets) > relation.upper:
        raise refusals.full_reference_error(graph, source, reference)
    if len(targets) > 1 and len(set(targets)) < len(targets):
        raise InvalidArgument(f"an object is given twice as a target of `{reference}`: name each target once")
    with graph.history.transaction_unless_loading():
        _replace_targets(graph, relation, source, targets)


def _clear_targets(relation: ReferenceStorage, source: int) -> None:
    for target in tuple(relation.forward[source]):
        relation.disconnect(source, target)


def _replace_targets(graph: Graph, relation: ReferenceStorage, source: int, targets: Sequence[int]) -> None:
    old = tuple(relation.forward[source])
    wanted = set(targets)
    kept = [target for target in old if target in wanted]
    # Remaining targets keep their links if they come first in the new order. Otherwise all are relinked for the order.
    in_place = kept == list(targets[: len(kept)])
    for target in old:
        if not in_place or target not in wanted:
            relation.disconnect(source, target)
    if relation.opposite_upper == 1:
        for target in targets:
            holders = relation.backward[target]
            if holders and holders[0] != source:
                relation.disconnect(holders[0], target)
    for target in targets:
        graph.link(source, relation.reference, target)
    # With more than 32 targets, removals have moved the last targets into the gaps.
    graph.store.set_distinct(relation.forward, source, tuple(targets))
    graph.store.revision += 1


def container(graph: Graph, node: int) -> tuple[int, Reference] | None:
    """Return the object that contains `node`, and the containment reference. Return None for a root."""
    for relation in graph.tables.container_relations[graph.store.classes[node]]:
        holders = relation.backward[node]
        if holders:
            return holders[0], relation.reference
    return None
