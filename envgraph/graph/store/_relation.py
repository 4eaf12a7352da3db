"""Storage of links: two adjacency columns for each pair of opposite references."""

from __future__ import annotations

from collections.abc import Callable
from sys import maxsize

from envgraph.graph.store._state_hash import text_hash
from envgraph.graph.store._undo_log import IndexedSet
from envgraph.metamodel import Metamodel, Reference

AdjacencyColumn = list[tuple[int, ...] | IndexedSet[int]]
"""An adjacency column: for each node the objects at the other ends of its links."""


class ReferenceStorage:
    """The storage of one reference. The two references of an opposite pair share their columns in swapped roles.

    Attributes:
        fact: the reference under which facts about these links are known (see `LinkFact`).
        is_flipped: True if `fact` is the opposite, so that facts swap source and target.
        is_symmetric: True if the reference is its own opposite. `forward` and `backward` are then one column.
        forward, backward: for each source its targets, and for each target its sources.
        allows_source: for each class index, True if its objects may be sources. The last entry is False, because
            the class index -1 of a missing object selects it.
        allows_target: as `allows_source`, for targets.
        upper, opposite_upper: the maximal number of links of a source and of a target.
        containment: True if the source contains the target.
        is_contained: True if the target contains the source.
        is_set_directly: True if single-valued and no containment, and if setting a target is never refused.
        code: the number of the reference in the hash.
        added, removing: the callbacks of followers, or None, see `Follower`. Arguments are the ends of the fact.
        connect, disconnect: functions of the `Store` that add a missing link and remove an existing link.
    """

    __slots__ = (
        "added",
        "allows_source",
        "allows_target",
        "backward",
        "code",
        "connect",
        "containment",
        "disconnect",
        "fact",
        "forward",
        "is_contained",
        "is_flipped",
        "is_set_directly",
        "is_symmetric",
        "opposite",
        "opposite_upper",
        "reference",
        "removing",
        "upper",
    )

    def __init__(
        self, reference: Reference, metamodel: Metamodel, forward: AdjacencyColumn, backward: AdjacencyColumn
    ) -> None:
        opposite = metamodel.opposite(reference)
        self.reference = reference
        self.opposite = opposite
        self.is_flipped = opposite is not None and opposite.index < reference.index
        self.fact = opposite if self.is_flipped and opposite else reference
        self.is_symmetric = opposite is not None and opposite.index == reference.index
        self.forward = forward
        self.backward = backward
        self.allows_source = metamodel.instance_flags(reference.owner)
        self.allows_target = metamodel.instance_flags(reference.target)
        self.upper = maxsize if reference.upper is None else reference.upper
        self.opposite_upper = maxsize if opposite is None or opposite.upper is None else opposite.upper
        self.containment = reference.containment
        self.is_contained = opposite is not None and opposite.containment
        self.is_set_directly = (
            self.upper == 1 and not (self.containment or self.is_contained) and self.opposite_upper in (1, maxsize)
        )
        self.code = text_hash(f"reference {self.fact}")
        self.added: Callable[[int, int], object] | None = None
        self.removing: Callable[[int, int], object] | None = None
        self.connect: Callable[[int, int], object]
        self.disconnect: Callable[[int, int], object]


def make_columns(metamodel: Metamodel) -> tuple[tuple[AdjacencyColumn, ...], tuple[AdjacencyColumn, ...]]:
    """Return new, empty forward columns and backward columns for all references.

    Opposite references share their two columns: the forward column of a reference is the backward column of its
    opposite.
    """
    forward: list[AdjacencyColumn] = []
    backward: list[AdjacencyColumn] = []
    for reference in metamodel.references:
        opposite = metamodel.opposite(reference)
        if opposite is None or opposite.index > reference.index:
            pair: tuple[AdjacencyColumn, AdjacencyColumn] = ([], [])
        elif opposite.index == reference.index:
            both: AdjacencyColumn = []
            pair = (both, both)
        else:
            pair = (backward[opposite.index], forward[opposite.index])
        forward.append(pair[0])
        backward.append(pair[1])
    return tuple(forward), tuple(backward)
