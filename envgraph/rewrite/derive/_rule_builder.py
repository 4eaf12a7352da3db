"""A builder of derived rules, which adds all conditions that keep valid models valid."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from itertools import combinations

from envgraph.metamodel import Reference, simple_name
from envgraph.pattern import (
    Action,
    BlockKind,
    Body,
    Constraint,
    CreateAction,
    DeleteEdge,
    DeleteNode,
    LeftSide,
    Modification,
    MoveAction,
    Negation,
    Parameter,
    Pattern,
    PatternCall,
    RetypeAction,
    Rule,
    RuleBlock,
    RuleEdge,
    RuleNode,
    Strategy,
    TypeConstraint,
    Variable,
)
from envgraph.rewrite.derive._reference_ends import LinkChange, ReferenceEnd, Schema


class RuleBuilder:
    """A rule under construction. Its finished rule keeps every valid model valid.

    Two variables of the left-hand side may refer to the same object unless `require_different` forbids it.

    Attributes:
        name: name of the rule in its group; it begins with the kind of operator.
        doc: description of the rule.
        types: class of each variable of the left-hand side.
        patterns: the patterns that the rule calls, by qualified name.
        changes: the added and removed links, including links of created or deleted objects.
        deleted: the objects that are deleted.
        retyped: the objects that are retyped.
        largest: the variable for the largest number in use, by the name of the pattern of the numbers.
        keys: the variables of keys that are chosen for created objects, by the class that declares the key.
    """

    def __init__(self, schema: Schema, group: str, name: str = "", doc: str = "") -> None:
        self.schema = schema
        self.group = group
        self.name = name
        self.doc = doc
        self.types: dict[str, str] = {}
        self.patterns: dict[str, Pattern] = {}
        self.changes: list[LinkChange[str]] = []
        self.deleted: list[str] = []
        self.retyped: list[str] = []
        self.largest: dict[str, Variable] = {}
        self.keys: dict[str, list[tuple[Variable, ...]]] = {}
        self._names: set[str] = set()
        self._edges: list[RuleEdge] = []
        self._constraints: list[Constraint] = []
        self._blocks: list[RuleBlock] = []
        self._actions: list[Action] = []
        self._different: set[frozenset[str]] = set()
        self._hom: list[tuple[str, str]] = []

    # --- the left side

    def reserve_name(self, preferred_name: str) -> str:
        """Reserve an unused name and return it: the wanted name, with a number if needed."""
        found, number = preferred_name, 1
        while found in self._names:
            number += 1
            found = f"{preferred_name}{number}"
        self._names.add(found)
        return found

    def add_node(self, cls: str, wanted: str = "", *, exact: bool = False) -> str:
        """Add an LHS node of a class, or of exactly this class, and return its variable."""
        name = self.reserve_name(wanted or variable_name_for(cls))
        self.types[name] = cls
        if exact and self.schema.metamodel.concrete_classes(cls) != (cls,):
            self._constraints.append(TypeConstraint(cls, Variable(name), exact=True))
        return name

    def add_edge(self, end: ReferenceEnd, near: str, far: str) -> None:
        """Add an LHS edge: the link must exist."""
        self._edges.append(end.edge(near, far))

    def forbid_link(self, end: ReferenceEnd, near: str, far: str = "_") -> None:
        """Add the condition that a link does not exist; without `far`, that the object has no links at the end."""
        self.add_constraints([Negation(end.path(near, far))])

    def add_constraints(self, constraints: Iterable[Constraint]) -> None:
        """Add constraints to the LHS, except those that it already contains."""
        self._constraints += [c for c in constraints if c not in self._constraints]

    def require_different(self, *names: str) -> None:
        """Require that LHS variables refer to different objects."""
        self._different.update(map(frozenset, combinations(names, 2)))

    def forbid_frozen(self, name: str) -> None:
        """Add the condition that an LHS object is not of a frozen class."""
        frozen = self.schema.frozen_below(self.types[name])
        self.add_constraints(Negation(TypeConstraint(cls, Variable(name))) for cls in frozen)

    def add_block(
        self,
        kind: BlockKind,
        inner: str,
        cls: str,
        edges: Iterable[RuleEdge],
        constraints: Iterable[Constraint] = (),
        actions: tuple[Action, ...] = (),
        *,
        except_for: Iterable[str] = (),
    ) -> None:
        """Add a `not` or `forall` block about a variable `inner`, which may match LHS objects except those in
        `except_for`.
        """
        left = LeftSide((RuleNode(inner, cls),), tuple(edges), tuple(constraints))
        self._blocks.append(RuleBlock(kind, left, right=Modification(actions) if actions else None))
        outer = (name for name, known in self.types.items() if self.schema.overlap(known, cls))
        self._hom += [(inner, name) for name in outer if name not in except_for]

    def add_pattern(
        self,
        suffix: str,
        parameters: Mapping[str, str],
        bodies: Iterable[Iterable[Constraint]],
        strategy: Strategy | None = "search",
    ) -> str:
        """Add a private pattern with typed parameters for this derivation and return its qualified name."""
        package, _, name = self.group.rpartition(".")
        declared = tuple(Parameter(parameter, cls) for parameter, cls in parameters.items())
        made = Pattern(
            name + suffix,
            declared,
            tuple(Body(tuple(one)) for one in bodies),
            package=package,
            private=True,
            strategy=strategy,
        )
        self.patterns[made.qualified_name] = made
        return made.qualified_name

    # --- containment

    def inside_calls(self, outer: str, container: str, part: str, inner: str) -> Iterator[PatternCall]:
        """Yield pattern calls, of which one holds if `part` (class `inner`) is inside `container` (class `outer`).

        The part may be nested deeper. Each containment has a pattern, as a closure would need a common class of parts.
        """
        overlap = self.schema.overlap
        for end in self.schema.contents(outer):
            if overlap(end.far_class, inner):
                suffix = f"#{outer}.contains.{end.reference}"
                name = self.group + suffix
                if name not in self.patterns:
                    self.patterns[name] = Pattern(name, (), ())  # a placeholder, since the pattern may call itself
                    bodies: list[list[Constraint]] = []
                    if overlap(outer, end.near_class):
                        bodies.append([end.path("container", "part")])
                    above = self.inside_calls(outer, "container", "middle", end.near_class)
                    bodies += [[way, end.path("middle", "part")] for way in above]
                    del self.patterns[name]
                    self.add_pattern(suffix, {"container": outer, "part": end.far_class}, bodies)
                yield PatternCall(name, (Variable(container), Variable(part)))

    # --- the right side

    def add_actions(self, *actions: Action) -> None:
        """Add actions to the right-hand side."""
        self._actions += actions

    def add_link(self, end: ReferenceEnd, near: str, far: str) -> None:
        """Add an action that creates a link, and record the link in `changes`."""
        edge = end.edge(near, far)
        self.add_actions(CreateAction((RuleNode(edge.source), RuleNode(edge.target)), (edge,)))
        self.changes.append(LinkChange(1, end, near, far))

    def remove_link(self, end: ReferenceEnd, near: str, far: str) -> None:
        """Add an action that deletes a link, and record the link in `changes`."""
        self.add_actions(DeleteEdge(end.edge(near, far)))
        self.record_lost_link(end, near, far)

    def record_lost_link(self, end: ReferenceEnd, near: str, far: str) -> None:
        """Record a removed link in `changes`, without an action. The finished rule requires that the link exists."""
        self.changes.append(LinkChange(-1, end, near, far))

    def move_object(self, end: ReferenceEnd, container: str, part: str) -> None:
        """Add an action that moves an object, record its new link, and add the conditions for its old container."""
        self.add_actions(MoveAction(Variable(part), Variable(container), end.reference.name))
        self.changes.append(LinkChange(1, end, container, part))
        self.forbid_link(end, container, part)
        for before in self.schema.ends:
            if before.is_contained and self.schema.overlap(self.types[part], before.near_class):
                if before.lower and before != end.opposite_end:
                    self.forbid_link(before, part)
                else:
                    self.give_up_links(before, part)

    def retype_object(self, name: str, new_class: str, gained: Iterable[Reference]) -> None:
        """Record a retyped object, and add the action and the conditions for links that its new class does not have.

        The object must have no old links of the `gained` references, by which it gets new links.
        """
        ends = self.schema.ends_of
        self.retyped.append(name)
        self.add_actions(RetypeAction(Variable(name), new_class))
        for end in ends(self.types[name]):
            if end in ends(new_class):
                continue
            if end.reference.containment or end.reference in gained:
                self.forbid_link(end, name)
            else:
                self.give_up_links(end, name)

    def delete_objects(self, *names: str) -> None:
        """Record objects to delete; `build_rule` adds the deletions after all other actions."""
        self.deleted += names

    def give_up_links(self, end: ReferenceEnd, name: str) -> None:
        """Add conditions for an object that loses its links at an end: no linked object is frozen or needs its link.

        If the end is frozen, the object must have no links there.
        """
        if end.is_frozen:
            self.forbid_link(end, name)
            return
        self.forbid_frozen_links(end, name)
        if end.opposite_end.lower:
            needy = self.reserve_name("needy")
            least = end.opposite_end.has_only_needed(needy)
            self.add_block(
                "not",
                needy,
                end.far_class,
                [end.edge(name, needy)],
                [least],
                except_for=self.served_objects(end),
            )

    def forbid_frozen_links(self, end: ReferenceEnd, name: str) -> None:
        """Require that an object has no links at a reference end to frozen objects that own these links."""
        for cls in self.schema.frozen_below(end.far_class) if end.opposite_end.holds_links else ():
            frozen = self.reserve_name("frozen")
            self.add_block("not", frozen, cls, [end.edge(name, frozen)])

    def served_objects(self, end: ReferenceEnd) -> list[str]:
        """Return the LHS objects that may lose a link to an end without condition: they get another, or are deleted."""
        added = (place for link in self.changes if link.sign > 0 for place in _link_ends(link))
        return [name for place, name in added if place == end.opposite_end] + self.deleted

    # --- the rule

    @property
    def preserved_objects(self) -> set[str]:
        """Return the LHS objects that are neither deleted nor retyped."""
        return self.types.keys() - {*self.deleted, *self.retyped}

    @property
    def balances(self) -> dict[tuple[ReferenceEnd, str], int]:
        """Return the change in the number of links of each preserved object, by end and object.

        Zero changes, and ends at which the object has its container, are left out.
        """
        found: Counter[tuple[ReferenceEnd, str]] = Counter()
        for link in self.changes:
            found.update(dict.fromkeys(_link_ends(link), link.sign))
        return {
            (end, name): more
            for (end, name), more in found.items()
            if more and name in self.preserved_objects and not end.is_contained
        }

    def build_rule(self) -> Rule:
        """Add the conditions that keep a valid model valid, and return the finished rule. Call this once."""
        self._add_conditions()
        package, _, group = self.group.rpartition(".")
        coinciding = [
            pair
            for pair in combinations(self.types, 2)
            if frozenset(pair) not in self._different and self.schema.overlap(*map(self.types.__getitem__, pair))
        ]
        nodes = tuple(RuleNode(name, cls) for name, cls in self.types.items())
        deleted = (DeleteNode(Variable(name)) for name in self.deleted)
        return Rule(
            f"{group}.{self.name}",
            left=LeftSide(nodes, tuple(self._edges), tuple(self._constraints)),
            blocks=tuple(self._blocks),
            right=Modification((*self._actions, *deleted)),
            package=package,
            semantics="spo" if self.deleted or self.retyped else "dpo",
            homomorphic=(*coinciding, *self._hom),
            doc=self.doc,
        )

    def _add_conditions(self) -> None:
        """Add the conditions that added and removed links need so that a valid model stays valid."""
        for link in self.changes:
            sign, end, near, far = link
            for place, name in _link_ends(link):
                if place.holds_links and name in self.preserved_objects:
                    self.forbid_frozen(name)
            if sign < 0:
                self.add_edge(end, near, far)
            elif {near, far} <= self.preserved_objects:
                if end.is_container:
                    self.require_different(far, near)
                    self.add_constraints(map(Negation, self.inside_calls(self.types[far], far, near, self.types[near])))
                else:
                    self.forbid_link(end, near, far)
        for (end, name), more in self.balances.items():
            self.add_constraints(end.allows_change(name, more))
        for one, two in combinations(self.changes, 2):
            if one.sign == two.sign and one.end.reference == two.end.reference:
                self._require_different_links(one, two)

    def _require_different_links(self, one: LinkChange[str], two: LinkChange[str]) -> None:
        """Require different objects for two added, or two removed, links, as each condition is about one link."""
        pairs: list[tuple[str, str]] = []
        if one.end == two.end:
            pairs = [(one.near, two.near), (one.far, two.far)]
            if one.sign > 0 and one.near != two.near and one.end.opposite_end.upper is None:
                pairs = pairs[:1]
        elif one.sign < 0:
            pairs = [(one.near, two.far), (two.near, one.far)]
        for first, second in pairs:
            if first != second and {first, second} <= self.preserved_objects:
                self.require_different(first, second)


def _link_ends(link: LinkChange[str]) -> list[tuple[ReferenceEnd, str]]:
    """Return the ends of a link with their objects; only one end if a symmetric link leads from an object to itself."""
    return list(dict.fromkeys(((link.end, link.near), (link.end.opposite_end, link.far))))


def variable_name_for(cls: str) -> str:
    """Return a variable name for an object of a class: the simple class name with a lower-case first letter."""
    name = simple_name(cls)
    return name[0].lower() + name[1:]
