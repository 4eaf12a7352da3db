"""Storage of links: two columns of adjacency for each pair of opposite references."""

from __future__ import annotations

from collections.abc import Callable
from sys import maxsize

from envgraph.graph.store._hashing import reference_code
from envgraph.graph.store._journal import IndexedSet
from envgraph.metamodel import Metamodel, Reference

Ends = list[tuple[int, ...] | IndexedSet[int]]
"""Column of adjacency: for each node the objects at the other ends of its links."""


class Relation:
    """How one reference is stored; the two references of an opposite pair share columns, crossed over.

    Attributes:
        fact: the reference that facts about these links name (see `LinkFact`).
        flipped: facts have source and target the other way round.
        symmetric: the reference is its own opposite; `forward` and `backward` are one column.
        forward, backward: targets of each source, sources of each target.
        source_ok, target_ok: by index of a class, whether its objects may stand there; one more entry at the end,
            False, is what the class index -1 of a missing object finds.
        upper, opposite_upper: how many links a source and a target may have.
        containment, contained: the source owns the target, or the other way round.
        plain: single-valued, no containment, and never refuses to replace a target.
        code: the reference's number in the hash.
        added, removing: what follows the links, see `Follower`; called with the ends of the fact.
        connect, disconnect: add a link that is not there, and remove one that is; made by the `Store`.
    """

    __slots__ = (
        "added",
        "backward",
        "code",
        "connect",
        "contained",
        "containment",
        "disconnect",
        "fact",
        "flipped",
        "forward",
        "opposite",
        "opposite_upper",
        "plain",
        "reference",
        "removing",
        "source_ok",
        "symmetric",
        "target_ok",
        "upper",
    )

    def __init__(self, reference: Reference, metamodel: Metamodel, forward: Ends, backward: Ends) -> None:
        opposite = metamodel.opposite(reference)
        self.reference = reference
        self.opposite = opposite
        self.flipped = opposite is not None and opposite.index < reference.index
        self.fact = opposite if self.flipped and opposite else reference
        self.symmetric = opposite is not None and opposite.index == reference.index
        self.forward = forward
        self.backward = backward
        self.source_ok = metamodel.instances(reference.owner)
        self.target_ok = metamodel.instances(reference.target)
        self.upper = maxsize if reference.upper is None else reference.upper
        self.opposite_upper = maxsize if opposite is None or opposite.upper is None else opposite.upper
        self.containment = reference.containment
        self.contained = opposite is not None and opposite.containment
        self.plain = (
            self.upper == 1
            and not (self.containment or self.contained)
            and self.opposite_upper in (1, maxsize)
        )
        self.code = reference_code(self.fact)
        self.added: Callable[[int, int], object] | None = None
        self.removing: Callable[[int, int], object] | None = None
        self.connect: Callable[[int, int], object]
        self.disconnect: Callable[[int, int], object]

    def ends(self, source: int, target: int) -> tuple[int, int]:
        """Source and target of the fact for a link of this reference."""
        if self.flipped or (self.symmetric and source > target):
            return target, source
        return source, target


def columns(metamodel: Metamodel) -> tuple[tuple[Ends, ...], tuple[Ends, ...]]:
    """Forward and backward columns of every reference."""
    forward: list[Ends] = []
    backward: list[Ends] = []
    for reference in metamodel.references:
        opposite = metamodel.opposite(reference)
        if opposite is None or opposite.index > reference.index:
            pair: tuple[Ends, Ends] = ([], [])
        elif opposite.index == reference.index:
            both: Ends = []
            pair = (both, both)
        else:
            pair = (backward[opposite.index], forward[opposite.index])
        forward.append(pair[0])
        backward.append(pair[1])
    return tuple(forward), tuple(backward)
