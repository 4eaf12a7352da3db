"""The lineage of individuals: the rule applications that lead from the initial model to them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from envgraph.code import shorten_repr
from envgraph.graph import Node
from envgraph.metamodel import Value
from envgraph.search._run_store import RunStore
from envgraph.search.domain._domain import Domain


@shorten_repr
class LineageStep(NamedTuple):
    """A rule application on the path from the initial model to a member.

    Attributes:
        generation: the generation in which it was made.
        rule: qualified name of the rule.
        match: objects and values by the names of the rule's variables.
    """

    generation: int
    rule: str
    match: dict[str, Node | Value]


def lineage(store: RunStore, domain: Domain, individual: int) -> Iterator[LineageStep]:
    """Yield the rule applications that lead from the initial model to an individual of a run, in their order.

    While a step is processed, the model is in the state before the step. Objects thus have their classes of that time.

    Raises:
        InvalidArgument: the individual does not exist, or its stored trace cannot be applied.
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
