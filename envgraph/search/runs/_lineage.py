"""Where the members of a run come from."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from envgraph.code import short_repr
from envgraph.graph import Node
from envgraph.metamodel import Value
from envgraph.search._store import RunStore
from envgraph.search.domain._domain import Domain


@short_repr
class LineageStep(NamedTuple):
    """A rule that was applied on the way from the initial model to a member.

    Attributes:
        generation: in which that was.
        rule: its qualified name.
        match: objects and values by the names of its variables.
    """

    generation: int
    rule: str
    match: dict[str, Node | Value]


def lineage(store: RunStore, domain: Domain, individual: int) -> Iterator[LineageStep]:
    """The rules that lead from the initial model to an individual of a run, in their order.

    While the caller looks at a step the model is as it was before; so objects have the classes that they had then.

    Raises:
        InvalidArgument: there is no such individual, or what the store says of it cannot be applied.
    """
    engine = domain.engine()
    for ancestor in store.lineage(individual):
        for rule, row in ancestor.trace:
            shape, match = engine.prepare(rule).shape, dict[str, Node | Value]()
            for place, (name, value) in enumerate(zip(shape.names, row, strict=True)):
                found = type(value) is int and shape.is_object(place)
                match[name] = engine.model.node(value) if found else value  # type: ignore[arg-type]
            yield LineageStep(ancestor.generation, rule, match)
            engine.replay([(rule, row)])
