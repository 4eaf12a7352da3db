"""Compute a hash that is equal for isomorphic models."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from hashlib import blake2b
from typing import TYPE_CHECKING

from envgraph.graph.store._relation import AdjacencyColumn, ReferenceStorage
from envgraph.graph.store._state_hash import value_hash
from envgraph.graph.store._store import Store

if TYPE_CHECKING:
    from envgraph.graph.model._model import Model


def canonical_hash(model: Model) -> int:
    """Return a 64-bit hash that is equal for isomorphic models. Ids, orders and names of objects do not count.

    The hash is computed anew on each call, by colour refinement (Weisfeiler and Leman 1968). The first colour of a node
    is a hash of its class and values. Each round adds the colours of its neighbours, by reference and direction, until
    a round does not increase the number of different colours. The result is the hash of all colours, sorted. Very
    regular models that are not isomorphic may have equal hashes.
    """
    store = model.graph.store
    relations = [relation for relation in store.relations if not relation.is_flipped]
    colours = {node: _digest(_own_facts(store, node)) for node in store.nodes()}
    while True:
        refined = {
            node: _digest([colour, *_neighbour_facts(node, relations, colours)]) for node, colour in colours.items()
        }
        if len(set(refined.values())) == len(set(colours.values())):
            # The colours of this round are hashed, because only they include the links among the final colours.
            return int.from_bytes(_digest(sorted(refined.values()))[:8], "little")
        colours = refined


def _own_facts(store: Store, node: int) -> Iterator[bytes]:
    yield store.metamodel.class_list[store.classes[node]].name.encode()
    for attribute, column in zip(store.metamodel.attributes, store.values, strict=True):
        value = column[node]
        if value is not None:
            yield (value_hash(attribute, value) % 2**64).to_bytes(8, "little")


def _neighbour_facts(node: int, relations: Iterable[ReferenceStorage], colours: dict[int, bytes]) -> Iterator[bytes]:
    for relation in relations:
        yield from _sorted_neighbours(f"{relation.fact}>", relation.forward, node, colours)
        yield from _sorted_neighbours(f"{relation.fact}<", relation.backward, node, colours)


def _sorted_neighbours(name: str, column: AdjacencyColumn, node: int, colours: dict[int, bytes]) -> Iterator[bytes]:
    if column[node]:
        yield name.encode()
        yield from sorted(colours[other] for other in column[node])


def _digest(parts: Iterable[bytes]) -> bytes:
    digest = blake2b(digest_size=16)
    for part in parts:
        digest.update(len(part).to_bytes(4, "little"))
        digest.update(part)
    return digest.digest()
