"""The lineage of individuals: the rule applications that lead from the initial model to them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field
from typing import NamedTuple

from envgraph.code import dataclass, shorten_repr
from envgraph.graph import ModelSnapshot, Node
from envgraph.metamodel import Value
from envgraph.rewrite import Engine
from envgraph.search._run_store import RunStore
from envgraph.search.domain._domain import Domain
from envgraph.search.families._member_family import Family


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


@dataclass(frozen=True, slots=True)
class LineageBranch:
    """A part of the tree of rule applications that lead from the initial model to the members of a family.

    Attributes:
        changes: a text for each application on the way to this part's state, such as "burn: tile[1, 2] is now
            BurningTile"; () for the initial model.
        members: the names of the members with this state.
        branches: the parts that go on from this state.
    """

    changes: tuple[str, ...] = ()
    members: tuple[str, ...] = ()
    branches: tuple[LineageBranch, ...] = ()


@dataclass(slots=True)
class _Applications:
    """A node of the tree of applications, where members with equal first applications share these."""

    members: list[str] = field(default_factory=list)
    following: dict[tuple[str, tuple[Value, ...]], _Applications] = field(default_factory=dict)


def lineage_tree(store: RunStore, family: Family) -> LineageBranch:
    """Return the tree of rule applications from the initial model to the members of a run.

    Raises:
        InvalidArgument: the stored trace of a member cannot be applied.
    """
    root = _Applications()
    for member in family.members:
        node = root
        for ancestor in store.lineage(member.individual or 0):
            for rule, row in ancestor.trace:
                node = node.following.setdefault((rule, tuple(row)), _Applications())
        node.members.append(member.name)
    return _follow(root, family.domain.engine(), [])


def _follow(node: _Applications, engine: Engine, changes: list[str]) -> LineageBranch:
    """Return the branch that `changes` begin: it ends at the next member, or where the lineages of members part."""
    history = engine.model.graph.history
    savepoint = history.savepoint()
    try:
        while not node.members and len(node.following) == 1:
            ((rule, row), node) = next(iter(node.following.items()))
            changes.append(_replay(engine, rule, row))
        branches = []
        for (rule, row), following in node.following.items():
            before = history.savepoint()
            branches.append(_follow(following, engine, [_replay(engine, rule, row)]))
            history.rollback(before)
        return LineageBranch(tuple(changes), tuple(node.members), tuple(branches))
    finally:
        history.rollback(savepoint)


def _replay(engine: Engine, rule: str, row: tuple[Value, ...]) -> str:
    """Repeat a rule application, and return its text: the rule, and what it changed."""
    shape, graph = engine.prepare(rule).shape, engine.model.graph
    matched = [one for place, one in enumerate(row) if shape.is_object(place) and isinstance(one, int)]
    before = ModelSnapshot.of(graph, matched)
    engine.replay([(rule, row)])
    return f"{rule.partition('.')[2] or rule}: {', '.join(before.changes(graph)) or 'no change of a matched object'}"
