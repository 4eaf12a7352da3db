"""Every valid model of a small metamodel, by trying all of them: an oracle that knows nothing of rules and models.

A model is written as its `Form`: the same for isomorphic models, and different for all others.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations_with_replacement, permutations, product

from envgraph.graph import Model
from envgraph.metamodel import Attribute, EnumType, Metamodel, Reference, Scalar, Value

Pairs = Iterable[tuple[int, int]]
Form = tuple[tuple[object, ...], tuple[object, ...]]
"""Class and values of each object, and the links of each reference, in the order that makes the form least."""


def all_models(metamodel: Metamodel, most: int) -> set[Form]:
    """The forms of all valid models with at most `most` objects.

    Valid: they conform, and every object has a container unless it is of a class that only itself and what it
    contains can contain. Numbers have the values of their range, or the initial one.
    """
    concrete = [cls.name for cls in metamodel.class_list if not cls.abstract]
    found: set[Form] = set()
    for size in range(most + 1):
        for classes in combinations_with_replacement(concrete, size):
            for links in _all_links(metamodel, classes):
                for values in _all_values(metamodel, classes):
                    found.add(form(classes, values, links))
    return found


def form_of(model: Model) -> Form:
    """The form of a model."""
    metamodel = model.metamodel
    nodes = list(model.graph.store.nodes())
    place = {node: position for position, node in enumerate(nodes)}
    classes = [model.graph.class_of(node) for node in nodes]
    values = [
        tuple((attribute.name, model.graph.value(node, attribute)) for attribute in _attributes(metamodel, cls))
        for node, cls in zip(nodes, classes, strict=True)
    ]
    links = [
        (
            str(reference),
            [(place[node], place[target]) for node in nodes for target in model.graph.targets(node, reference)],
        )
        for reference in _written(metamodel)
    ]
    return form(classes, values, links)


def form(classes: Sequence[str], values: Sequence[object], links: Iterable[tuple[str, Pairs]]) -> Form:
    """The least of the descriptions under all numberings of the objects."""
    held = [(name, list(pairs)) for name, pairs in links]
    size = len(classes)

    def described(order: Sequence[int]) -> Form:
        objects: list[object] = [()] * size
        for old, new in enumerate(order):
            objects[new] = (classes[old], values[old])
        renamed = [(name, tuple(sorted((order[s], order[t]) for s, t in pairs))) for name, pairs in held]
        return tuple(objects), tuple(renamed)

    return min((described(order) for order in permutations(range(size))), key=repr)


# --- attributes


def _attributes(metamodel: Metamodel, cls: str) -> list[Attribute]:
    return [feature for feature in metamodel.features(cls).values() if isinstance(feature, Attribute)]


def _all_values(metamodel: Metamodel, classes: Sequence[str]) -> Iterator[list[tuple[tuple[str, Value], ...]]]:
    for chosen in product(*(_values_of_one(metamodel, cls) for cls in classes)):
        yield list(chosen)


def _values_of_one(metamodel: Metamodel, cls: str) -> list[tuple[tuple[str, Value], ...]]:
    attributes = _attributes(metamodel, cls)
    return [
        tuple(zip((attribute.name for attribute in attributes), values, strict=True))
        for values in product(*map(_values, attributes))
    ]


def _values(attribute: Attribute) -> Sequence[Value]:
    if isinstance(attribute.type, EnumType):
        return attribute.type.literals
    if attribute.type is Scalar.BOOL:
        return False, True
    for annotation in attribute.annotations:
        if annotation.name == "range" and attribute.type is Scalar.INT:
            lowest, highest = annotation.arguments
            assert isinstance(lowest, int) and isinstance(highest, int)
            return range(lowest, highest + 1)
    return (attribute.initial,)


# --- links


def _written(metamodel: Metamodel) -> list[Reference]:
    """One reference of each pair of opposites, the containing one if there is one."""
    return [
        reference
        for reference in metamodel.references
        for opposite in (metamodel.opposite(reference),)
        if opposite is None or reference.containment or (not opposite.containment and reference.index <= opposite.index)
    ]


def _all_links(metamodel: Metamodel, classes: Sequence[str]) -> Iterator[list[tuple[str, Pairs]]]:
    references = _written(metamodel)
    choices = [list(_links_of_one(metamodel, reference, classes)) for reference in references]
    for chosen in product(*choices):
        parts = [
            pair for reference, pairs in zip(references, chosen, strict=True) if reference.containment for pair in pairs
        ]
        if _is_forest(parts) and _all_placed(metamodel, classes, parts):
            yield [(str(reference), pairs) for reference, pairs in zip(references, chosen, strict=True)]


def _links_of_one(metamodel: Metamodel, reference: Reference, classes: Sequence[str]) -> Iterator[Pairs]:
    opposite = metamodel.opposite(reference)
    symmetric = opposite is not None and opposite.index == reference.index
    sources = [i for i, cls in enumerate(classes) if metamodel.is_a(cls, reference.owner)]
    targets = [i for i, cls in enumerate(classes) if metamodel.is_a(cls, reference.target)]
    possible = [(s, t) for s in sources for t in targets if not symmetric or s <= t]
    for chosen in product((False, True), repeat=len(possible)):
        pairs = {pair for pair, there in zip(possible, chosen, strict=True) if there}
        if symmetric:
            pairs |= {(target, source) for source, target in pairs}
        forward = all(_allowed(reference, sum(s == i for s, _ in pairs)) for i in sources)
        backward = opposite is None or all(_allowed(opposite, sum(t == i for _, t in pairs)) for i in targets)
        if forward and backward:
            yield sorted(pairs)


def _allowed(reference: Reference, count: int) -> bool:
    return reference.lower <= count and (reference.upper is None or count <= reference.upper)


def _is_forest(parts: Sequence[tuple[int, int]]) -> bool:
    """Whether every part has one container, and nothing is inside itself."""
    above = {part: container for container, part in parts}
    if len(above) < len(parts):
        return False
    for part in above:
        around: list[int] = []
        node: int | None = part
        while node is not None and node not in around:
            around.append(node)
            node = above.get(node)
        if node is not None:
            return False
    return True


def _all_placed(metamodel: Metamodel, classes: Sequence[str], parts: Sequence[tuple[int, int]]) -> bool:
    inside = {part for _, part in parts}
    return all(i in inside or _is_root(metamodel, cls) for i, cls in enumerate(classes))


def _is_root(metamodel: Metamodel, cls: str) -> bool:
    concrete = [one.name for one in metamodel.class_list if not one.abstract]
    holds = {
        one: {
            part
            for feature in metamodel.features(one).values()
            if isinstance(feature, Reference) and feature.containment
            for part in metamodel.concrete_classes(feature.target)
        }
        for one in concrete
    }
    below = {cls}
    while grown := {part for one in below for part in holds[one]} - below:
        below |= grown
    return all(one in below for one in concrete if cls in holds[one])
