"""Storage of links: two adjacency columns for each pair of opposite references."""

from __future__ import annotations

from collections.abc import Callable
from sys import maxsize

from envgraph.graph.store._hashing import reference_code
from envgraph.graph.store._journal import IndexedSet
from envgraph.metamodel import Metamodel, Reference

Ends = list[tuple[int, ...] | IndexedSet[int]]
"""An adjacency column: for each node the objects at the other ends of its links."""


class Relation:
    """The storage of one reference. The two references of an opposite pair share their columns in swapped roles.

    Attributes:
        fact: the reference under which facts about these links are known (see `LinkFact`).
        flipped: True if `fact` is the opposite, so that facts swap source and target.
        symmetric: True if the reference is its own opposite. `forward` and `backward` are then one column.
        forward, backward: for each source its targets, and for each target its sources.
        source_ok: for each class index, True if its objects may be sources. The last entry is False, because the class
            index -1 of a missing object selects it.
        target_ok: as `source_ok`, for targets.
        upper, opposite_upper: the maximal number of links of a source and of a target.
        containment: True if the source contains the target.
        contained: True if the target contains the source.
        plain: True if single-valued and no containment, and if setting a target is never refused.
        code: the number of the reference in the hash.
        added, removing: the callbacks of followers, or None, see `Follower`. Arguments are the ends of the fact.
        connect, disconnect: functions of the `Store` that add a missing link and remove an existing link.
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
        """Return the ends of a link in the order that the fact about the link uses.

        They are swapped if `flipped` is True. For a symmetric reference the smaller id is first.
        """
        if self.flipped or (self.symmetric and source > target):
            return target, source
        return source, target


def columns(metamodel: Metamodel) -> tuple[tuple[Ends, ...], tuple[Ends, ...]]:
    """Return new, empty forward columns and backward columns for all references.

    Opposite references share their two columns: the forward column of a reference is the backward column of its
    opposite.
    """
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
