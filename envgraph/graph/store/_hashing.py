"""The state hash by identity: an exact sum over all facts, condensed to 64 bits when asked for.

Every object has two fixed pseudo-random 64-bit numbers a, b, every class c and reference r has one, and so has every
pair v of attribute and value. The terms are

    a[node] * c,    a[node] * v,    r * a[source] * b[target]

summed as exact integers, which takes one or two multiplications a change. A sum of ready-made hashes would need a
mixing function for each fact, ten times as slow in Python. Different sets of facts are different polynomials in the
random numbers; that they agree at one point has negligible probability (Schwartz 1980, Zippel 1979), and reducing
only at the end avoids the zero divisors of arithmetic modulo 2^64.
"""

from __future__ import annotations

import struct
from hashlib import blake2b, shake_128
from typing import TYPE_CHECKING

from envgraph.metamodel import Attribute, Class, Reference, Value, Values

if TYPE_CHECKING:
    from collections.abc import Sequence

    from envgraph.graph.model._model import Model
    from envgraph.graph.store._store import Store

BLOCK = 1024
"""Numbers of nodes are drawn in blocks of this size."""


def node_salts(start: int, stop: int) -> tuple[list[int], list[int]]:
    """The numbers a and the numbers b of the nodes start..stop-1."""
    first_salts: list[int] = []
    second_salts: list[int] = []
    while start < stop:
        block, first = divmod(start, BLOCK)
        last = min(BLOCK, first + stop - start)
        stream = shake_128(b"envgraph nodes %d" % block).digest(16 * last)
        words = struct.unpack_from(f"<{2 * (last - first)}Q", stream, 16 * first)
        first_salts.extend(words[::2])
        second_salts.extend(words[1::2])
        start += last - first
    return first_salts, second_salts


def code(text: str) -> int:
    """A 64-bit number for a text, the same in every process."""
    return int.from_bytes(blake2b(text.encode("utf-8", "surrogatepass"), digest_size=8).digest(), "little")


def class_code(cls: Class) -> int:
    """The number of a class."""
    return code(f"class {cls.name}")


def reference_code(reference: Reference) -> int:
    """The number of a reference."""
    return code(f"reference {reference}")


def value_code(attribute: Attribute, value: Value | Values) -> int:
    """The number of a value in an attribute; equal values have one number, so -0.0 counts as 0.0.

    That of many values is the sum of theirs: their order does not count, as that of links does not.
    """
    if isinstance(value, tuple | list):
        return sum(value_code(attribute, one) for one in value)
    if value == 0:
        value = abs(value) if isinstance(value, float) else value
    return code(f"value {attribute} {value!r}")


def state_hash(model: Model, since: int | None = None) -> int:
    """A 64-bit hash of all facts by identity: (node, class), (node, attribute, value), (source, reference, target).

    Kept incrementally, and the same in every process. Names of objects and the order of links do not count.

    Args:
        model: the model.
        since: objects with this id and greater ones count as if they had the ids from here on, in their order; that
            takes a look at every fact, unless they have.
    """
    total = model.graph.store.total if since is None else _total_since(model.graph.store, since)
    return int.from_bytes(
        blake2b(total.to_bytes(40, "little", signed=True), digest_size=8).digest(), "little"
    )


def _total_since(store: Store, first: int) -> int:
    """`total`, where the objects with ids from `first` on count as if their ids had no gaps."""
    nodes = [node for node in range(first, store.next_id) if store.classes[node] >= 0]
    if nodes == [*range(first, first + len(nodes))]:
        return store.total
    salts = [*store.salts[0]], [*store.salts[1]]
    for place, node in enumerate(nodes, first):
        salts[0][node], salts[1][node] = store.salts[0][place], store.salts[1][place]
    return recomputed_total(store, salts)


def recomputed_total(store: Store, salts: tuple[Sequence[int], Sequence[int]] | None = None) -> int:
    """Return the sum behind the state hash, from the facts alone; with other numbers of the nodes, if they are given.

    An object whose change of class was interrupted is in no class, and has its values and links.
    """
    first, second = salts or node_salts(0, len(store.classes))
    total = 0
    for node, cls in enumerate(store.classes):
        if cls >= 0:
            total += first[node] * class_code(store.metamodel.class_list[cls])
        for attribute, column in zip(store.metamodel.attributes, store.values, strict=True):
            value = column[node]
            if value is not None:
                total += first[node] * value_code(attribute, value)
        for relation in store.relations:
            for target in relation.forward[node]:
                if relation.flipped or (relation.symmetric and target < node):
                    continue
                total += relation.code * first[node] * second[target]
    return total
