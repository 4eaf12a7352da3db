"""Sizes measured in a model, for plans that are made for this model."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence, Sized

from envgraph.graph import Store
from envgraph.match._match_costs import PLAN
from envgraph.match.plan._size_estimates import SizeEstimates
from envgraph.metamodel import Attribute, Reference
from envgraph.pattern import Library


class LiveSizes(SizeEstimates):
    """Sizes measured in a model when they are first needed, then cached."""

    def __init__(self, library: Library, store: Store) -> None:
        super().__init__(library.metamodel)
        self._store = store
        self._numbers = {cls.name: number for number, cls in enumerate(library.metamodel.class_list)}
        self._degrees: dict[tuple[str, bool], float] = {}
        self._values: dict[int, float] = {}

    def direct_extent_size(self, cls: str) -> float:
        """Return the number of direct instances of a class; 0.5 if there are none. The number is cached."""
        if cls not in self._exact:
            self._exact[cls] = float(len(self._store.extents[self._numbers[cls]])) or 0.5
        return self._exact[cls]

    def targets_per_source(self, reference: Reference | Attribute) -> float:
        """Return the average number of targets of sampled objects, or of their values of a many-valued attribute."""
        return self._degree(reference, forward=True)

    def sources_per_target(self, reference: Reference | Attribute) -> float:
        """Return the average number of sources of sampled objects, or estimate how many objects have a given value."""
        if isinstance(reference, Attribute):
            return super().sources_per_target(reference)
        return self._degree(reference, forward=False)

    def link_probability(self, reference: Reference | Attribute) -> float:
        """Return the measured probability that two objects are linked; for an attribute, the fixed estimate of
        `SizeEstimates`.
        """
        if isinstance(reference, Attribute):
            return super().link_probability(reference)
        return min(self.targets_per_source(reference) / max(self.extent_size(reference.target), 1.0), 0.5)

    def value_probability(self, attribute: int) -> float:
        """Return the probability that a sampled object has a given value of the attribute with this index."""
        if attribute not in self._values:
            owner = self._metamodel.attributes[attribute].owner
            column = self._store.values[attribute]
            seen = Counter(column[node] for node in self._sample(owner))
            total = sum(seen.values())
            share = sum(count * count for count in seen.values()) / (total * total) if total else 0.2
            self._values[attribute] = min(max(share, 0.001), 0.9)
        return self._values[attribute]

    def _degree(self, reference: Reference | Attribute, forward: bool) -> float:
        """Return the average number of links or values of sampled objects, at least 0.01; 0.5 without any objects."""
        key = (str(reference), forward)
        if key not in self._degrees:
            store, nodes = self._store, self._sample(reference.owner)
            columns: Sequence[Sequence[Sized]] = store.forward
            if isinstance(reference, Attribute):
                columns = store.distinct
            elif not forward:
                columns, nodes = store.backward, self._sample(reference.target)
            links = sum([len(columns[reference.index][node]) for node in nodes])
            self._degrees[key] = max(links / len(nodes), 0.01) if nodes else 0.5
        return self._degrees[key]

    def _sample(self, cls: str) -> list[int]:
        """Return at least `PLAN.sample` objects of a class, evenly spaced, or all objects if the class has fewer."""
        extents = [self._store.extents[self._numbers[name]] for name in self._metamodel.concrete_classes(cls)]
        total = sum(map(len, extents))
        step = max(1, total // PLAN.sample)
        return [node for extent in extents for node in extent[::step]]
