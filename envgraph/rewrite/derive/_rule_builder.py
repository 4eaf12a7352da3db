"""Rules in the making."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from itertools import combinations
from typing import NamedTuple

from envgraph.metamodel import simple_name
from envgraph.pattern import (
    Action,
    Block,
    BlockKind,
    Body,
    Comparison,
    Constant,
    Constraint,
    Create,
    DeleteEdge,
    DeleteNode,
    Edge,
    LeftSide,
    Modification,
    Negation,
    Node,
    Parameter,
    Pattern,
    PatternCall,
    Retype,
    Rule,
    Strategy,
    TypeConstraint,
    Variable,
)
from envgraph.rewrite.derive._schema import End, Schema


class LinkChange(NamedTuple):
    """A link that is added (1) or removed (-1)."""

    sign: int
    end: End
    near: str
    far: str


class RuleBuilder:
    """A rule that is put together piece by piece.

    Variables of the left side may stand for one object unless `differ` was said; those of blocks may not stand for
    objects of the left side unless `may_be` was said.

    Attributes:
        types: class of each variable of the left side.
        patterns: what the rule calls.
        largest: for the name of a pattern of numbers the variable of the left side for the largest one.
        keys: for a class the variables of the keys that are chosen for new objects.
    """

    def __init__(self, schema: Schema, group: str) -> None:
        self.schema = schema
        self.group = group
        self.types: dict[str, str] = {}
        self.patterns: dict[str, Pattern] = {}
        self.largest: dict[str, Variable] = {}
        self.keys: dict[str, list[tuple[Variable, ...]]] = {}
        self._names: dict[str, None] = {}
        self._nodes: list[Node] = []
        self._edges: list[Edge] = []
        self._constraints: list[Constraint] = []
        self._blocks: list[Block] = []
        self._actions: list[Action] = []
        self._differ: set[frozenset[str]] = set()
        self._hom: list[tuple[str, str]] = []
        self._inside: set[str] = set()
        self._changes: list[LinkChange] = []

    # --- the left side

    def name(self, wanted: str) -> str:
        """A name that is still free: the wanted one, or one with a number."""
        found, number = wanted, 1
        while found in self._names:
            number += 1
            found = f"{wanted}{number}"
        self._names[found] = None
        return found

    def node(self, wanted: str, cls: str, *, exact: bool = False) -> str:
        """An object of a class, or of exactly this class."""
        name = self.name(wanted)
        self.types[name] = cls
        self._nodes.append(Node(name, cls))
        if exact and self.schema.metamodel.concrete(cls) != (cls,):
            self._constraints.append(TypeConstraint(cls, Variable(name), exact=True))
        return name

    def edge(self, end: End, near: str, far: str) -> None:
        """A link that has to be there."""
        self._edges.append(end.edge(near, far))

    def absent(self, end: End, near: str, far: str) -> None:
        """A link that must not be there."""
        self.ask([Negation(end.path(near, far))])

    def ask(self, constraints: Iterable[Constraint]) -> None:
        """More conditions."""
        self._constraints += [c for c in constraints if c not in self._constraints]

    def differ(self, one: str, other: str) -> None:
        """Two variables of the left side are different objects."""
        self._differ.add(frozenset((one, other)))

    def spared(self, name: str, cls: str) -> None:
        """An object of a class is none that operators leave alone."""
        self.ask(Negation(TypeConstraint(sub, Variable(name))) for sub in self.schema.frozen_below(cls))

    # --- blocks

    def block(
        self,
        kind: BlockKind,
        nodes: Iterable[Node],
        edges: Iterable[Edge],
        constraints: Iterable[Constraint] = (),
        actions: Iterable[Action] = (),
    ) -> None:
        """A condition, or a nested rule."""
        right = Modification(tuple(actions)) if kind.startswith("forall") else None
        left = LeftSide(tuple(nodes), tuple(edges), tuple(constraints))
        self._blocks.append(Block(kind, left, right=right))

    def may_be(self, inner: str, outer: str) -> None:
        """A variable of a block may stand for an object of the left side."""
        self._hom.append((inner, outer))

    def lacking(self, end: End, near: str, *but: str) -> None:
        """Forbid that an object at the other end has too few links afterwards, or is to be left alone.

        Args:
            end: at which an object of the left side is linked to others now.
            near: the object.
            but: objects of the left side that keep enough links.
        """
        if end.association.frozen:
            self.ask([Negation(end.path(near, "_"))])
            return
        if end.other.held:
            self.unfrozen(end, near)
        if end.other.lower:
            self.short(end, near, *but)

    def unfrozen(self, end: End, near: str) -> None:
        """Forbid that an object at the other end is one that operators leave alone."""
        for cls in self.schema.frozen_below(end.far):
            frozen = self.name("frozen")
            self.block("not", [Node(frozen, cls)], [end.edge(near, frozen)])

    def short(self, end: End, near: str, *but: str) -> None:
        """Forbid that an object at the other end has no link too many, as `lacking`."""
        needy = self.name("needy")
        exact = Comparison("==", end.other.count(needy), Constant(end.other.lower))
        self.block("not", [Node(needy, end.far)], [end.edge(near, needy)], [exact])
        for other in self.types:
            if other not in but:
                self.may_be(needy, other)

    # --- containment

    def not_inside(self, part: str, container: str) -> None:
        """An object is not the container, nor around it."""
        self.differ(part, container)
        self.ask(self.nowhere_in(part, self.types[part], container, self.types[container]))

    def nowhere_in(self, container: str, outer: str, part: str, inner: str) -> list[Constraint]:
        """An object of class `inner` is not inside another of class `outer`, at any depth."""
        return [
            Negation(self.inside(end, outer, container, part))
            for end in self.contents(outer)
            if self.schema.metamodel.overlap(end.far, inner)
        ]

    def contents(self, cls: str) -> list[End]:
        """The ends of the containers that may be an object of a class or inside it."""
        schema = self.schema
        classes = schema.contents(schema.metamodel.concrete(cls))
        return [e for e in schema.ends if e.contains and any(schema.is_a(one, e.near) for one in classes)]

    def inside(self, end: End, outer: str, container: str, part: str) -> PatternCall:
        """An object is, by a containment at last, inside another of class `outer`, at any depth.

        A pattern for each containment, not one with a closure: parts have no class in common.
        """
        overlap = self.schema.metamodel.overlap
        suffix = f"#{outer}.contains.{end.reference}"
        name = self.group + suffix
        if name not in self._inside:
            self._inside.add(name)
            bodies = [Body((end.path("container", "part"),))] if overlap(outer, end.near) else []
            bodies += [
                Body((self.inside(above, outer, "container", "middle"), end.path("middle", "part")))
                for above in self.contents(outer)
                if overlap(above.far, end.near)
            ]
            self.pattern(suffix, {"container": outer, "part": end.far}, bodies)
        return PatternCall(name, (Variable(container), Variable(part)))

    def pattern(
        self,
        suffix: str,
        parameters: Mapping[str, str],
        bodies: Iterable[Body],
        strategy: Strategy | None = "search",
    ) -> str:
        """A pattern for this derivation alone, given its parameters with their types; returns its name."""
        package, _, name = self.group.rpartition(".")
        declared = tuple(Parameter(parameter, cls) for parameter, cls in parameters.items())
        made = Pattern(
            name + suffix, declared, tuple(bodies), package=package, private=True, strategy=strategy
        )
        self.patterns[made.qualified_name] = made
        return made.qualified_name

    # --- the right side

    def act(self, *actions: Action) -> None:
        """What happens."""
        self._actions += actions

    def link(self, end: End, near: str, far: str) -> None:
        """Add a link."""
        edge = end.edge(near, far)
        self.act(Create((Node(edge.source), Node(edge.target)), (edge,)))
        self._changes.append(LinkChange(1, end, near, far))

    def unlink(self, end: End, near: str, far: str) -> None:
        """Remove a link."""
        self.act(DeleteEdge(end.edge(near, far)))
        self.lose(end, near, far)

    def lose(self, end: End, near: str, far: str) -> None:
        """A link goes, with an object at one of its ends."""
        self._changes.append(LinkChange(-1, end, near, far))

    def delete(self, name: str) -> None:
        """Remove an object."""
        self.act(DeleteNode(Variable(name)))

    # --- the rule

    @property
    def kept(self) -> set[str]:
        """The objects of the left side that are neither deleted nor retyped."""
        changed = {action.node.name for action in self._actions if isinstance(action, DeleteNode | Retype)}
        return self.types.keys() - changed

    @property
    def balances(self) -> dict[tuple[End, str], int]:
        """How many links more, or less, each kept object has afterwards at an end."""
        found: Counter[tuple[End, str]] = Counter()
        for sign, end, near, far in self._changes:
            for place in {(end.both, near): 0, (end.other.both, far): 0}:
                found[place] += sign
        return {(end, name): more for (end, name), more in found.items() if more and name in self.kept}

    def guard(self) -> None:
        """Ask for all that the links need which are added and removed, so that a valid model stays valid."""
        for sign, end, near, far in self._changes:
            for one, name in ((end, near), (end.other, far)):
                if one.held and name in self.kept:
                    self.spared(name, self.types[name])
            if sign < 0:
                self.edge(end, near, far)
            elif {near, far} <= self.kept and not end.association.reference.containment:
                self.absent(end, near, far)
        for (end, name), more in self.balances.items():
            self.ask(end.room(name, more) if more > 0 else end.spare(name, -more))
        for pair in combinations(self._changes, 2):
            self._keep_apart(*pair)

    def _keep_apart(self, one: LinkChange, two: LinkChange) -> None:
        """Two links that are both added, or both removed, are different ones, and do not share the same room."""
        if one.sign != two.sign or one.end.association != two.end.association:
            return
        pairs: list[tuple[str, str]] = []
        if one.end == two.end:
            shared = one.sign > 0 and one.near != two.near and one.end.other.upper is None
            pairs = [(one.near, two.near)] if shared else [(one.near, two.near), (one.far, two.far)]
        elif one.sign < 0:
            pairs = [(one.near, two.far), (two.near, one.far)]
        for first, second in pairs:
            if first != second and {first, second} <= self.kept:
                self.differ(first, second)

    def rule(self, name: str, doc: str, *, spo: bool = False) -> Rule:
        """The rule under a name of the group."""
        self.guard()
        package, _, group = self.group.rpartition(".")
        overlap = self.schema.metamodel.overlap
        coinciding = [
            pair
            for pair in combinations(self.types, 2)
            if frozenset(pair) not in self._differ and overlap(*(self.types[one] for one in pair))
        ]
        return Rule(
            f"{group}.{name}",
            left=LeftSide(tuple(self._nodes), tuple(self._edges), tuple(self._constraints)),
            blocks=tuple(self._blocks),
            right=Modification(tuple(self._actions)),
            package=package,
            semantics="spo" if spo else "dpo",
            homomorphic=(*coinciding, *self._hom),
            doc=doc,
        )


def variable_for(cls: str) -> str:
    """The name of a variable for an object of a class."""
    name = simple_name(cls)
    return name[0].lower() + name[1:]
