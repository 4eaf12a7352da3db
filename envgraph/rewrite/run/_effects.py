"""Steps of the code of rules at run time: containers, merges, lists of values."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

from envgraph.errors import EvaluationError, RuleError, with_article
from envgraph.graph import Graph
from envgraph.metamodel import Attribute, Reference, Value, Values

_DRAGGED: Final = "`move` it out of the container, or delete it too"

ModelLink = tuple[Reference, int, int]
"""A link of a model: reference, source, target."""


def need(value: Value | int | None, feature: str) -> Value | int:
    """The value, which an operator needs.

    Raises:
        EvaluationError: there is none.
    """
    if value is None:
        raise EvaluationError(f"`{feature}` has no value")
    return value


def listed(values: Values, attribute: Attribute) -> Values:
    """The values of an attribute with many: each once, unless it may have one several times."""
    return tuple(dict.fromkeys(values)) if attribute.unique else values


def more(values: Values, value: Value, attribute: Attribute) -> Values:
    """The values with one more at the end; see `listed`."""
    return listed((*values, value), attribute)


def less(values: Values, value: Value) -> Values:
    """The values without one, wherever it stands."""
    return tuple(one for one in values if one != value)


class Dragged(RuleError):
    """An object that a rule keeps or changes would go with its container; `node` is there again after a rollback."""

    def __init__(self, message: str, node: int) -> None:
        super().__init__(message, reason="containment", hint=_DRAGGED)
        self.node = node


def check_kept(graph: Graph, nodes: tuple[int, ...], names: tuple[str, ...]) -> None:
    """Check that objects are still there.

    Raises:
        Dragged: one went with its container.
    """
    for node, name in zip(nodes, names, strict=True):
        if not graph.alive(node):
            what = f"`{name}` is kept" if name else "an object is changed"
            raise Dragged(f"{what}, and goes with a container that is deleted", node)


def present(targets: tuple[int | None, ...]) -> tuple[int, ...]:
    """The targets that there are, each once."""
    return tuple(dict.fromkeys(target for target in targets if target is not None))


def there(graph: Graph, source: int, reference: Reference, target: int) -> None:
    """Check that there is a link.

    Raises:
        RuleError: there is none ("missing-link").
    """
    if not graph.has_link(source, reference, target):
        ends = f"{graph.describe(source)} -{reference.name}-> {graph.describe(target)}"
        raise RuleError(f"there is no {ends} to redirect", reason="missing-link", details=[ends])


def leave(graph: Graph, node: int, container: int | None, reference: Reference) -> None:
    """Take an object out of its container, unless it is already where it is to go, or not there yet."""
    old = graph.container(node) if graph.alive(node) else None
    if old is not None and old != (container, reference):
        graph.unlink(old[0], old[1], node)


def inside(graph: Graph, node: int, others: Collection[int]) -> bool:
    """Return whether an object is contained in one of the others, at any depth."""
    found = graph.container(node)
    while found is not None:
        if found[0] in others:
            return True
        found = graph.container(found[0])
    return False


def house(graph: Graph, source: int, reference: Reference, target: int) -> None:
    """Add a link between a container and an object that is in none: like any other, it needs room at both ends.

    Raises:
        RuleError: the object is in a container ("full"), or the container is inside it ("containment").
    """
    found = graph.metamodel.containment(reference, source, target)
    assert found is not None
    reference, source, target = found
    old = graph.container(target) if graph.alive(target) else None
    if old is not None:
        container, feature = graph.describe(old[0]), old[1].name
        message = f"{graph.describe(target)} is in {container} already"
        raise RuleError(
            message,
            reason="full",
            details=[f"{container} -{feature}-> {graph.describe(target)}"],
            hint="`move` or `set` takes it out",
        )
    graph.link(source, reference, target)


def release(
    graph: Graph, node: int | None, reference: Reference, targets: tuple[int | None, ...], every: bool
) -> None:
    """Take out of containers what setting targets will take out; `every`: these will be all of them.

    Args:
        graph: of the model.
        node: the object that gets the targets; None if it is not there yet.
        reference: that contains, or whose opposite does.
        targets: None is none.
        every: the targets replace those that are there.
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
    """Take away all links of an object that is going to be merged, and return them."""
    links = links_of(graph, node)
    for reference, source, target in links:
        graph.unlink(source, reference, target)
    return links


def absorb(graph: Graph, kept: int, absorbed: int, links: list[ModelLink], *, lossy: bool) -> None:
    """Merge two objects: the links of `absorbed` go over to `kept`, then it is deleted.

    A link that both have becomes one, one between the two a loop. The container of `kept` stays, if it has one.

    Raises:
        RuleError: the class of `kept` lacks a reference ("lost-link", unless `lossy`), or `kept` has another target
            there ("full").
    """
    if kept == absorbed:
        raise RuleError("an object cannot be merged with itself", reason="identification")
    if not graph.alive(absorbed):
        return  # another match of a block has merged the same two
    house = graph.container(kept)
    housed = house is not None and house[0] != absorbed
    # Another merge may have handed links over to this one.
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
            found = f"{graph.describe(wrong)}, {with_article(graph.class_of(wrong))},"
            message = f"{found} cannot have the links of `{reference}` that are handed over"
            raise RuleError(message, reason="lost-link", details=[link])
        graph.link(source, reference, target)
    graph.delete(absorbed, "dpo")


def links_of(graph: Graph, node: int) -> list[ModelLink]:
    """The links at an object; of an opposite pair by the reference that contains, else by the first."""
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
"""Functions that generated code calls without the graph as an argument, by the name after `_`."""

ON_VALUES: Final = (less, listed, more, need, present)
"""The same for what needs no graph."""
