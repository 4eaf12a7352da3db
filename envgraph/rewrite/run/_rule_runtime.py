"""Functions that the generated code of rules calls at run time, for containers, merges and multi-valued attributes."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

from envgraph.errors import EvaluationError, RuleError, quote_with_article
from envgraph.graph import Graph
from envgraph.metamodel import Attribute, Reference, Value, Values

_CONTAINER_HINT: Final = "`move` it out of the container, or delete it too"

ModelLink = tuple[Reference, int, int]
"""A link of a model: reference, source, target."""


def need(value: Value | int | None, feature: str) -> Value | int:
    """Return a value that an operator needs. `feature` is the name of the value in the message.

    Raises:
        EvaluationError: the value is None.
    """
    if value is None:
        raise EvaluationError(f"`{feature}` has no value")
    return value


def listed(values: Values, attribute: Attribute) -> Values:
    """Return the values of a multi-valued attribute, without duplicates if the attribute is unique."""
    return tuple(dict.fromkeys(values)) if attribute.unique else values


def more(values: Values, value: Value, attribute: Attribute) -> Values:
    """Return the values with one more value at the end, without duplicates if the attribute is unique."""
    return listed((*values, value), attribute)


def less(values: Values, value: Value) -> Values:
    """Return the values without all occurrences of one value."""
    return tuple(one for one in values if one != value)


class DeletedWithContainer(RuleError):
    """An error: an object that a rule preserves or changes would be deleted with its container.

    `node` is the id of the object, which exists again after the rollback.
    """

    def __init__(self, message: str, node: int) -> None:
        super().__init__(message, reason="containment", hint=_CONTAINER_HINT)
        self.node = node


def check_kept(graph: Graph, nodes: tuple[int, ...], names: tuple[str, ...]) -> None:
    """Check that objects still exist. `names` are their names in the rule, or "" for an object that is changed.

    Raises:
        DeletedWithContainer: an object was deleted with its container.
    """
    for node, name in zip(nodes, names, strict=True):
        if not graph.alive(node):
            what = f"`{name}` is kept" if name else "an object is changed"
            raise DeletedWithContainer(f"{what}, but would be deleted with its container", node)


def present(targets: tuple[int | None, ...]) -> tuple[int, ...]:
    """Return the targets that are not None, without duplicates."""
    return tuple(dict.fromkeys(target for target in targets if target is not None))


def there(graph: Graph, source: int, reference: Reference, target: int) -> None:
    """Check that a link exists.

    Raises:
        RuleError: the link does not exist ("missing-link").
    """
    if not graph.has_link(source, reference, target):
        ends = f"{graph.describe(source)} -{reference.name}-> {graph.describe(target)}"
        raise RuleError(f"the link {ends} to redirect does not exist", reason="missing-link", details=[ends])


def leave(graph: Graph, node: int, container: int | None, reference: Reference) -> None:
    """Remove an object from its container, unless it is in the new container already or has no container."""
    old = graph.container(node) if graph.alive(node) else None
    if old is not None and old != (container, reference):
        graph.unlink(old[0], old[1], node)


def inside(graph: Graph, node: int, others: Collection[int]) -> bool:
    """Return True if an object is contained in one of the others, at any depth."""
    found = graph.container(node)
    while found is not None:
        if found[0] in others:
            return True
        found = graph.container(found[0])
    return False


def house(graph: Graph, source: int, reference: Reference, target: int) -> None:
    """Add a containment link for an object that must have no container.

    Raises:
        RuleError: the object has a container or an end is full ("full"), or the container is inside the object
            ("containment").
    """
    found = graph.metamodel.containment_link(reference, source, target)
    assert found is not None
    reference, source, target = found
    old = graph.container(target) if graph.alive(target) else None
    if old is not None:
        container, feature = graph.describe(old[0]), old[1].name
        message = f"{graph.describe(target)} is contained in {container} already"
        raise RuleError(
            message,
            reason="full",
            details=[f"{container} -{feature}-> {graph.describe(target)}"],
            hint="use `move` or `set`, which remove it from there",
        )
    graph.link(source, reference, target)


def release(graph: Graph, node: int | None, reference: Reference, targets: tuple[int | None, ...], every: bool) -> None:
    """Remove objects from the containers that they will leave when targets of a containment are set.

    Args:
        graph: the graph of the model.
        node: the object that gets the targets; None if it is not created yet.
        reference: a containment, or the opposite of a containment.
        targets: the new targets; None is skipped.
        every: True if the targets replace all existing targets.
    """
    known = node is not None and graph.alive(node)
    if not reference.containment:
        opposite = graph.metamodel.opposite(reference)
        assert node is not None and opposite is not None
        if known:
            leave(graph, node, next(iter(targets), None), opposite)
        return
    if node is not None and known and every:
        for old in tuple(graph.targets(node, reference)):
            if old not in targets:
                graph.unlink(node, reference, old)
    for target in targets:
        if target is not None:
            leave(graph, target, node, reference)


def strip(graph: Graph, node: int) -> list[ModelLink]:
    """Remove all links of an object before a merge, and return them."""
    links = links_of(graph, node)
    for reference, source, target in links:
        graph.unlink(source, reference, target)
    return links


def merge_objects(graph: Graph, kept: int, absorbed: int, links: list[ModelLink], *, lossy: bool) -> None:
    """Move the links of `absorbed` to `kept`, then delete `absorbed`. Do nothing if `absorbed` is already deleted.

    A link that both have becomes one link, a link between the two becomes a loop. If `kept` has a container, it stays
    there. `links` are links of `absorbed` that were removed before; they are moved, too.

    Raises:
        RuleError: both are one object ("identification"), the class of `kept` lacks a reference ("lost-link", unless
            `lossy`), or `kept` has another target of a single-valued reference ("full").
    """
    if kept == absorbed:
        raise RuleError("an object cannot be merged with itself", reason="identification")
    if not graph.alive(absorbed):
        return  # another match of a block has merged the same objects
    house = graph.container(kept)
    housed = house is not None and house[0] != absorbed
    # Another merge may have moved links to `absorbed` since its links were removed.
    for reference, source, target in [*links, *strip(graph, absorbed)]:
        link = f"{graph.describe(source)} -{reference.name}-> {graph.describe(target)}"
        source, target = (kept if end == absorbed else end for end in (source, target))
        if reference.containment and (source == target or (target == kept and housed)):
            continue
        ends = ((source, reference.owner), (target, reference.target))
        wrong = next((end for end, cls in ends if not graph.metamodel.is_a(graph.class_of(end), cls)), None)
        if wrong is not None:
            if lossy:
                continue
            found = f"{graph.describe(wrong)}, {quote_with_article(graph.class_of(wrong))},"
            message = f"{found} cannot have the links of `{reference}` that the merge moves"
            raise RuleError(message, reason="lost-link", details=[link])
        graph.link(source, reference, target)
    graph.delete(absorbed, "dpo")


def links_of(graph: Graph, node: int) -> list[ModelLink]:
    """Return all links of an object; a pair of opposites once, by its containment or else by its first reference."""
    found: dict[ModelLink, None] = {}
    cls = graph.class_of(node)
    for reference in graph.metamodel.references:
        opposite = graph.metamodel.opposite(reference)
        if opposite is not None and _precedence(opposite) < _precedence(reference):
            continue
        if graph.metamodel.is_a(cls, reference.owner):
            found.update(((reference, node, other), None) for other in graph.targets(node, reference))
        if graph.metamodel.is_a(cls, reference.target):
            found.update(((reference, other, node), None) for other in graph.sources(node, reference))
    return list(found)


def _precedence(reference: Reference) -> tuple[bool, int]:
    return not reference.containment, reference.index


ON_MODEL: Final = (check_kept, house, inside, leave, release, strip, there)
"""Functions that generated code calls by the name after `_`; the graph argument is bound in advance."""

ON_VALUES: Final = (less, listed, more, need, present)
"""Functions that generated code calls by the name after `_` and that have no graph argument."""
