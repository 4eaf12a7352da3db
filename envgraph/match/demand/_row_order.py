"""Sort rows into the order in which a search returns them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from envgraph.graph import Store
from envgraph.match._matcher import Row
from envgraph.match.plan._search_plan import BodyPlan, StepKind
from envgraph.metamodel import Attribute, Reference
from envgraph.pattern import InstanceAtom, LinkAtom


def order_of(body: BodyPlan, store: Store) -> Callable[[Row], list[int]] | None:
    """Return a sort key for the order of a plan's loops. The key has for each loop the position of the row's value.

    Return None if a loop is not over objects or link ends, or if the rows have no column for its variable.
    """
    columns = {variable: column for column, variable in enumerate(body.conjunction.parameters)}
    loops: list[tuple[Any, int, int]] = []
    for step in body.plan.steps:
        if step.kind is StepKind.LOOP:
            ends: Any
            match step.goal:
                case InstanceAtom(_, far) | LinkAtom(Attribute(), far, _) if (far,) == step.binds:
                    near, ends = far, None
                case LinkAtom(Attribute(index=index), near, far) if (far,) == step.binds:
                    ends = store.distinct[index]
                case LinkAtom(Reference(index=index), near, far) if (far,) == step.binds:
                    ends = store.forward[index]
                case LinkAtom(Reference(index=index), far, near) if (far,) == step.binds:
                    ends = store.backward[index]
                case _:
                    return None
            if near not in columns or far not in columns:
                return None
            loops.append((ends, columns[near], columns[far]))

    def key(row: Row) -> list[int]:
        places: list[int] = []
        for ends, near, far in loops:
            value: Any = row[far]
            if ends is None:  # the loop visits objects class by class
                places += store.classes[value], store.place[value]
            else:
                among = ends[row[near]]
                places.append(among.index(value) if isinstance(among, tuple) else among.where(value))
        return places

    return key
