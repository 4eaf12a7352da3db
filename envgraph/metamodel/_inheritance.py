"""Compute the inherited features of all classes at once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence

from envgraph.metamodel._features import Class, Feature
from envgraph.metamodel._reachability import strong_components

_Shared = Mapping[str, tuple[str, Feature]]


def linearise(name: str, classes: Mapping[str, Class]) -> tuple[str, ...]:
    """Return the class and its supertypes, breadth first, each once; unknown names are left out, cycles are cut."""
    order: dict[str, None] = {}
    queue = [name]
    for current in queue:
        if current in order or current not in classes:
            continue
        order[current] = None
        queue.extend(classes[current].supertypes)
    return tuple(order)


def supertypes_first(classes: Mapping[str, Class]) -> list[list[str]]:
    """Return lists of classes, supertypes before subtypes: one class each, or all classes of an inheritance cycle."""
    known = {name: [above for above in cls.supertypes if above in classes] for name, cls in classes.items()}
    return [names[::-1] for names, _ in strong_components(list(classes), known.__getitem__)]


class Inheritance:
    """The inheritance of a set of classes that may contain errors, such as cycles or unknown supertypes.

    Attributes:
        table: the classes by name.
        unknown: names that may be defined in text that could not be read.
    """

    def __init__(self, classes: Sequence[Class], table: Mapping[str, Class], unknown: Collection[str]) -> None:
        self.table = table
        self.unknown = unknown
        self._component: dict[str, int] = {}
        self._own: dict[str, Mapping[str, Feature]] = {}
        # A name can be inherited twice only if several classes declare it; all other names are left out.
        counts = Counter(name for cls in classes for name in {f.name: None for f in cls.features})
        self._shared: dict[str, _Shared] = {}
        for index, members in enumerate(supertypes_first(table)):
            self._component.update(dict.fromkeys(members, index))
            found: dict[str, tuple[str, Feature]] = {}
            for name in members:
                for feature in table[name].features:
                    if counts[feature.name] > 1:
                        found.setdefault(feature.name, (name, feature))
            supertypes = dict.fromkeys(above for name in members for above in table[name].supertypes)
            shared_tables = {id(each): each for name in supertypes if (each := self._shared.get(name))}
            inherited = list(shared_tables.values())
            if not found and len(inherited) == 1:
                shared: _Shared = inherited[0]  # All classes of a long chain share one table.
            else:
                for one in inherited:
                    for name, item in one.items():
                        found.setdefault(name, item)
                shared = found
            self._shared.update(dict.fromkeys(members, shared))

    def cycle_number(self, name: str, above: str) -> int | None:
        """Return the number of the inheritance cycle that contains a class and its supertype; None if there is none."""
        component = self._component.get(name)
        return component if component == self._component.get(above, -1) else None

    def own_features(self, name: str) -> Mapping[str, Feature]:
        """Return the features that a class declares itself, by name."""
        if name not in self._own:
            self._own[name] = {feature.name: feature for feature in self.table[name].features}
        return self._own[name]

    def shared_features(self, name: str) -> _Shared:
        """Map own and inherited feature names to owner and feature; leave out names that only one class declares."""
        return self._shared.get(name, {})
