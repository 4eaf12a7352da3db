"""The state hash by identity: an exact sum over all facts, condensed to 64 bits on request.

Every object has two fixed pseudo-random 64-bit numbers a and b. Every class c, every reference r, and every pair v of
an attribute and a value has one number. The terms of the sum are

    a[node] * c,    a[node] * v,    r * a[source] * b[target]

The sum is an exact integer, so a change takes one or two multiplications. A sum of precomputed hashes would need a
mixing function for each fact, which is ten times as slow in Python. Different sets of facts are different polynomials
in the random numbers. The probability that they agree at one point is negligible (Schwartz 1980, Zippel 1979).
Reducing only at the end avoids the zero divisors of arithmetic modulo 2^64.
"""

from __future__ import annotations

import struct
from hashlib import blake2b, shake_128
from typing import TYPE_CHECKING

from envgraph.metamodel import Attribute, Class, Value, Values

if TYPE_CHECKING:
    from collections.abc import Sequence

    from envgraph.graph.model._model import Model
    from envgraph.graph.store._store import Store

SALT_BLOCK_SIZE = 1024
"""The pseudo-random numbers of nodes are generated in blocks of this size."""


def node_salts(start: int, stop: int) -> tuple[list[int], list[int]]:
    """Return the pseudo-random numbers a and b of the nodes `start` to `stop - 1`, as two lists."""
    first_salts: list[int] = []
    second_salts: list[int] = []
    while start < stop:
        block, first = divmod(start, SALT_BLOCK_SIZE)
        last = min(SALT_BLOCK_SIZE, first + stop - start)
        stream = shake_128(b"envgraph nodes %d" % block).digest(16 * last)
        words = struct.unpack_from(f"<{2 * (last - first)}Q", stream, 16 * first)
        first_salts.extend(words[::2])
        second_salts.extend(words[1::2])
        start += last - first
    return first_salts, second_salts


def text_hash(text: str) -> int:
    """Return a 64-bit number for a text. The number is the same in every process."""
    return int.from_bytes(blake2b(text.encode("utf-8", "surrogatepass"), digest_size=8).digest(), "little")


def class_hash(cls: Class) -> int:
    """Return the 64-bit number of a class in the state hash."""
    return text_hash(f"class {cls.name}")


def value_hash(attribute: Attribute, value: Value | Values) -> int:
    """Return the number of a value of an attribute in the state hash. Equal values have equal numbers (-0.0 and 0.0).

    The number of a sequence of values is the sum of the numbers of its values, so their order does not count.
    """
    if isinstance(value, tuple | list):
        return sum(value_hash(attribute, one) for one in value)
    if value == 0:
        value = abs(value) if isinstance(value, float) else value
    return text_hash(f"value {attribute} {value!r}")


def state_hash(model: Model, since: int | None = None) -> int:
    """Return a 64-bit hash of all facts by identity.

    The facts are (node, class), (node, attribute, value) and (source, reference, target). The sum behind the hash is
    updated with every change. The hash is the same in every process. Names of objects and the order of links do not
    count.

    Args:
        model: the model.
        since: if given, the hash is computed as if the objects with ids of `since` or more had consecutive ids from
            `since` on, in the same order. Unless their ids are consecutive already, this visits all facts.
    """
    total = model.graph.store.hash_sum if since is None else _hash_sum_since(model.graph.store, since)
    return int.from_bytes(blake2b(total.to_bytes(40, "little", signed=True), digest_size=8).digest(), "little")


def _hash_sum_since(store: Store, first: int) -> int:
    """Return the sum behind the state hash as if the objects with ids from `first` on had consecutive ids."""
    nodes = [node for node in range(first, store.next_id) if store.classes[node] >= 0]
    if nodes == [*range(first, first + len(nodes))]:
        return store.hash_sum
    salts = [*store.salts[0]], [*store.salts[1]]
    for place, node in enumerate(nodes, first):
        salts[0][node], salts[1][node] = store.salts[0][place], store.salts[1][place]
    return recompute_hash_sum(store, salts)


def recompute_hash_sum(store: Store, salts: tuple[Sequence[int], Sequence[int]] | None = None) -> int:
    """Return the sum behind the state hash, recomputed from all facts of the store.

    Args:
        store: the store. An object whose change of class was interrupted has no class, but its values and links count.
        salts: the numbers a and b of the nodes, if they differ from `node_salts`.
    """
    first, second = salts or node_salts(0, len(store.classes))
    total = 0
    for node, cls in enumerate(store.classes):
        if cls >= 0:
            total += first[node] * class_hash(store.metamodel.class_list[cls])
        for attribute, column in zip(store.metamodel.attributes, store.values, strict=True):
            value = column[node]
            if value is not None:
                total += first[node] * value_hash(attribute, value)
        for relation in store.relations:
            for target in relation.forward[node]:
                if relation.is_flipped or (relation.is_symmetric and target < node):
                    continue
                total += relation.code * first[node] * second[target]
    return total
