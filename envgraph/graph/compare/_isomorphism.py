"""Decide if models are isomorphic, by colour refinement and, where colours do not decide, by search."""

from __future__ import annotations

from collections.abc import Iterator

from envgraph.code import dataclass
from envgraph.graph.store._store import Store
from envgraph.metamodel import Value, Values

Colours = dict[int, int]
"""A number (colour) for each node. Nodes of different colours cannot correspond in an isomorphism."""


@dataclass(frozen=True, slots=True)
class _ColouredModel:
    """A model without its ids and orders, as stable colours and links.

    Attributes:
        colours: the colour of each node. Colours are stable: nodes of one colour have neighbours of equal colours.
        links: for each node its links, grouped by reference and direction, without empty groups.
    """

    colours: Colours
    links: dict[int, list[tuple[int, tuple[int, ...]]]]


class IsomorphismClasses:
    """A numbering of models: isomorphic models get the same number, other models get different numbers.

    An isomorphism maps the objects of one model to the objects of another and keeps classes, values and links. Ids,
    names and orders do not count. Colours (Weisfeiler and Leman 1968) are interned numbers that are the same for all
    models given to one instance, so the result does not rest on a hash. If the colours do not determine an
    isomorphism, nodes are mapped by trial and the colours are refined again (McKay 1981).

    >>> from envgraph.graph import Model
    >>> from envgraph.metamodel import Class, Metamodel, Reference
    >>> rooms = Metamodel("rooms", [Class("Room", features=(Reference("door", "Room", 0, 1),))])
    >>> ring, pairs = Model(rooms), Model(rooms)
    >>> for model, size in ((ring, 4), (pairs, 2)):
    ...     nodes = [model.create("Room") for _ in range(4)]
    ...     for place, node in enumerate(nodes):
    ...         node.door = nodes[place - place % size + (place + 1) % size]
    >>> ring.canonical_hash() == pairs.canonical_hash()
    True
    >>> shapes = IsomorphismClasses()
    >>> [shapes.class_number(model.graph.store) for model in (ring, pairs, ring)]
    [0, 1, 0]
    """

    def __init__(self) -> None:
        self._numbers: dict[tuple[object, ...], int] = {}
        self._representatives: dict[tuple[int, ...], list[tuple[int, _ColouredModel]]] = {}
        self._count = 0

    def class_number(self, store: Store) -> int:
        """Return the number (from 0) of the isomorphism class of the state. A new class gets the next number."""
        shape = self._coloured(store)
        key = tuple(sorted(shape.colours.values()))
        found = self._representatives.setdefault(key, [])
        for number, other in found:
            if self._isomorphic(other, shape):
                return number
        # If equal colours imply isomorphism, the colours are the key already and the shape is not needed.
        found.append((self._count, _ColouredModel({}, {}) if _is_determined(shape) else shape))
        self._count += 1
        return self._count - 1

    def _intern(self, key: tuple[object, ...]) -> int:
        return self._numbers.setdefault(key, len(self._numbers))

    def _coloured(self, store: Store) -> _ColouredModel:
        sides = [
            column
            for relation in store.relations
            if not relation.is_flipped
            for column in ((relation.forward,) if relation.is_symmetric else (relation.forward, relation.backward))
        ]
        around = {
            node: [(-side, tuple(column[node])) for side, column in enumerate(sides, 1) if column[node]]
            for node in store.nodes()
        }
        columns = store.values
        first = {
            node: self._intern(("object", store.classes[node], *(_without_order(column[node]) for column in columns)))
            for node in around
        }
        return _ColouredModel(self._refine(first, around), around)

    def _refine(self, colours: Colours, around: dict[int, list[tuple[int, tuple[int, ...]]]]) -> Colours:
        """Refine the colours by the colours of neighbours, until their number does not increase, and return the result.

        The result is taken from the last round, so that it also encodes the links of the nodes.
        """
        intern, distinct = self._intern, len(set(colours.values()))
        while True:
            found: Colours = {}
            for node, sides in around.items():
                parts = [colours[node]]
                for side, others in sides:
                    parts.append(side)
                    parts += sorted([colours[other] for other in others])
                found[node] = intern(tuple(parts))
            now = len(set(found.values()))
            if now == distinct:
                return found
            colours, distinct = found, now

    def _isomorphic(self, left: _ColouredModel, right: _ColouredModel) -> bool:
        """Return True if two coloured models are isomorphic. Both must have the same number of nodes of each colour.

        An empty `left` represents a model whose colours already determine it up to isomorphism.
        """
        if not left.colours or _is_determined(right):
            return True
        trials = [self._map_one_node(left, right)]
        while trials:
            pair = next(trials[-1], None)
            if pair is None:
                trials.pop()
            elif _is_determined(pair[0]):
                return True
            else:
                trials.append(self._map_one_node(*pair))
        return False

    def _map_one_node(
        self, left: _ColouredModel, right: _ColouredModel
    ) -> Iterator[tuple[_ColouredModel, _ColouredModel]]:
        """Map one node of `left` to each possible node of `right`, and yield the two models with the refined colours.

        The node belongs to the smallest set of several nodes with one colour. Pairs of models whose colours differ
        after the refinement are skipped.
        """
        classes = _nodes_by_colour(left.colours)
        colour = min((c for c, nodes in classes.items() if len(nodes) > 1), key=lambda c: (len(classes[c]), c))
        mark = self._intern(("mapped", colour))
        fixed = self._refine({**left.colours, classes[colour][0]: mark}, left.links)
        wanted = sorted(fixed.values())
        for node in _nodes_by_colour(right.colours)[colour]:
            tried = self._refine({**right.colours, node: mark}, right.links)
            if sorted(tried.values()) == wanted:
                yield _ColouredModel(fixed, left.links), _ColouredModel(tried, right.links)


def _without_order(value: Value | Values | None) -> object:
    """Return a value of an attribute. A sequence of values is returned sorted."""
    return tuple(sorted(value)) if isinstance(value, tuple | list) else value


def _nodes_by_colour(colours: Colours) -> dict[int, list[int]]:
    found: dict[int, list[int]] = {}
    for node, colour in colours.items():
        found.setdefault(colour, []).append(node)
    return found


def _is_determined(shape: _ColouredModel) -> bool:
    """Return True if all models with these colours are isomorphic.

    This is the case if each node that shares its colour has only neighbours with unique colours.
    """
    alone = {nodes[0] for nodes in _nodes_by_colour(shape.colours).values() if len(nodes) == 1}
    if len(alone) == len(shape.colours):
        return True
    return all(
        other in alone
        for node, sides in shape.links.items()
        if node not in alone
        for _, others in sides
        for other in others
    )
