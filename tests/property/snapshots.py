"""Deep copies of what can be seen of a model, every order included."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from envgraph.graph import Model
from tests.facts import ClassFact, Fact, LinkFact, ValueFact


def snapshot(model: Model) -> dict[str, object]:
    """Everything that can be asked of a model but its revision."""
    nodes = [node for cls in model.metamodel.class_list for node in model.graph.exact_extent(cls.name)]
    return {
        "extents": {cls.name: list(model.graph.extent(cls.name)) for cls in model.metamodel.class_list},
        "classes": [(node, model.graph.class_of(node), model.graph.object_name(node)) for node in nodes],
        "values": [
            (str(a), node, repr(model.graph.value(node, a))) for a in model.metamodel.attributes for node in nodes
        ],
        "targets": [
            (str(r), node, list(model.graph.targets(node, r)), list(model.graph.sources(node, r)))
            for r in model.metamodel.references
            for node in nodes
        ],
        "names": {name: node for name, node in model.graph.store.by_name.items() if node is not None},
        "next_id": model.graph.store.next_id,
        "hash": model.state_hash(),
    }


def facts(model: Model) -> Iterator[Fact]:
    """All facts of a model, each once."""
    for node in model.graph.store.nodes():
        yield ClassFact(model.graph.class_of(node), node)
        for attribute in model.metamodel.attributes:
            for value in dict.fromkeys(model.graph.values(node, attribute)):
                yield ValueFact(attribute, node, value)
        for reference in model.metamodel.references:
            opposite = model.metamodel.opposite(reference)
            for target in model.graph.targets(node, reference):
                if opposite is not None and opposite.index < reference.index:
                    continue
                if opposite is not reference or node <= target:
                    yield LinkFact(reference, node, target)


def spelt(found: Iterable[Fact]) -> list[tuple[str, ...]]:
    """Facts as texts, sorted; their reprs leave out what is long."""
    return sorted((*map(str, one[:-1]), repr(one[-1])) for one in found)


def has_fact(model: Model, fact: Fact) -> bool:
    """Whether the model has a fact."""
    match fact:
        case ClassFact(cls, node):
            return model.graph.alive(node) and model.graph.class_of(node) == cls
        case ValueFact(attribute, node, value):
            return value in model.graph.values(node, attribute)
        case LinkFact(reference, source, target):
            return model.graph.has_link(source, reference, target)


class Shadow:
    """A listener that keeps the set of facts up to date from what it is told."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.facts = list(facts(model))
        self.restorations = 0

    def inserted(self, fact: Fact) -> None:
        """A fact that is new, and in the model already."""
        assert fact not in self.facts
        assert has_fact(self.model, fact)
        self.facts.append(fact)

    def removing(self, fact: Fact) -> None:
        """A fact that was there, and still is in the model."""
        assert has_fact(self.model, fact)
        self.facts.remove(fact)

    def restored(self) -> None:
        """Everything may have changed."""
        self.restorations += 1
        self.facts = list(facts(self.model))

    def check(self) -> None:
        """Assert that what was told is what is there."""
        assert spelt(self.facts) == spelt(facts(self.model))
