"""Describe the changes between two states of a model as lines of text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from envgraph.code import dataclass
from envgraph.errors import SHOWN
from envgraph.graph import Model
from envgraph.metamodel import Attribute
from envgraph.page._pictures import format_object, format_value


@dataclass(frozen=True, slots=True)
class ObjectState:
    """The state of an object: the text that names it, and the values of its attributes and references, by name."""

    cls: str
    title: str
    values: Mapping[str, Sequence[Any]]
    links: Mapping[str, Sequence[int]]


def state_of(model: Model) -> dict[int, ObjectState]:
    """Return the state of every object, by id."""
    graph, found = model.graph, {}
    for node in model.nodes():
        features = model.metamodel.features(node.cls).values()
        found[node.id] = ObjectState(
            node.cls,
            format_object(model, node.id),
            {one.name: graph.values(node.id, one) for one in features if isinstance(one, Attribute)},
            {one.name: tuple(graph.targets(node.id, one)) for one in features if not isinstance(one, Attribute)},
        )
    return found


def describe_changes(before: Mapping[int, ObjectState], model: Model) -> list[str]:
    """Return a line for each object that was created, deleted or retyped, and each changed value and link."""
    after = state_of(model)
    lines = list(_changes(before, after))
    more = len(lines) - SHOWN.rows
    return [*lines[: SHOWN.rows], f"and {more:,} more"] if more > 0 else lines


def _changes(before: Mapping[int, ObjectState], after: Mapping[int, ObjectState]) -> Iterator[str]:
    def title(node: int) -> str:
        return (after.get(node) or before[node]).title

    for node, old in before.items():
        if node not in after:
            yield f"deleted {old.title}"
    for node, new in after.items():
        known = before.get(node)
        if known is None:
            yield f"created {new.title}"
        elif known.cls != new.cls:
            yield f"{known.title} is now {new.title}"
        for name, values in new.values.items():
            earlier = known.values.get(name, ()) if known else ()
            if known and earlier != values:
                yield f"{new.title}.{name}: {_join(earlier)} → {_join(values)}"
        for name, targets in new.links.items():
            linked = known.links.get(name, ()) if known else ()
            yield from (f"{new.title}.{name} - {title(one)}" for one in linked if one not in targets)
            yield from (f"{new.title}.{name} + {title(one)}" for one in targets if one not in linked)


def _join(values: Sequence[Any]) -> str:
    return ", ".join(map(format_value, values)) or "none"
