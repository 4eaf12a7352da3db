"""Operators that create, delete and retype objects."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import permutations

from envgraph.errors import quote_with_article
from envgraph.pattern import (
    Aggregate,
    Binary,
    Check,
    Comparison,
    Constant,
    Constraint,
    CreateAction,
    Negation,
    PatternCall,
    RuleNode,
    TypeConstraint,
    Variable,
)
from envgraph.rewrite.derive._creation_plans import CreationPlan, cheapest_plans, creation_plans
from envgraph.rewrite.derive._reference_ends import ReferenceEnd, Schema
from envgraph.rewrite.derive._rule_builder import RuleBuilder, variable_name_for
from envgraph.rewrite.derive._unused_keys import choose_key, key_owner


def object_operators(schema: Schema, group: str, cls: str, max_plans: int) -> Iterator[RuleBuilder]:
    """Yield the operators that create and delete objects of exactly one class.

    For each operator that creates several objects together, another operator deletes them together. For each operator
    that takes links from other objects, another operator gives links to other objects.
    """
    begun = partial(RuleBuilder, schema, group)
    plans = creation_plans(schema, cls, max_plans)
    for plan in plans:
        builder = begun(f"create.{cls}{_name_suffix(plan)}", _creation_doc(plan))
        _carry_out_plan(builder, plan, _add_existing(builder, plan))
        yield builder
    doc = f"Delete a `{cls}` with its contents, if no other object then has too few links."
    yield _delete_with_contents(begun(f"delete.{cls}", doc), CreationPlan((cls,)))
    if any(map(_is_relinkable, schema.ends_of(cls))):
        doc = f"Delete a `{cls}`, and link the objects that need it to another one."
        yield _delete_rehoming(begun(f"delete.{cls}.rehoming", doc), cls)
    for end in schema.ends_of(cls):
        if _is_relinkable(end, 1) and not schema.overlap(end.near_class, end.far_class):
            doc = f"Delete a `{cls}`, and link the objects that need it at `{end.name}` to two others."
            yield _delete_rehoming(begun(f"delete.{cls}.spreading.{end.name}.all", doc), cls, end)
    for plan in plans:
        if plan.donated_links(0) and len(plan.top_objects) == 1:
            yield _delete_spreading(begun("", f"Delete a `{cls}`, and link the objects that need it to others."), plan)
        elif not plan.removed_links and len(plan.top_objects) > 1:
            first, *others = (plan.new[node] for node in plan.top_objects)
            doc = f"Delete objects that need each other: {', '.join(f'a `{o}`' for o in (first, *others))}."
            yield _delete_with_contents(begun(f"delete.{first}.with.{'.'.join(others)}", doc), plan)


# --- plans


def _name_suffix(plan: CreationPlan) -> str:
    """Return the part of an operator's name that distinguishes the plans of one class."""
    parts = [end.name for _, end, _, far in plan.added_links if end.is_contained and far < 0][:1]
    if len(plan.new) > 1:
        parts += ["with", *plan.new[1:]]
    if plan.removed_links:
        parts += ["stealing", *(link.end.name for link in plan.removed_links)]
    return "".join(f".{part}" for part in parts)


def _creation_doc(plan: CreationPlan) -> str:
    text = f"Create a new `{plan.new[0]}`"
    if len(plan.new) > 1:
        text += ", together with " + " and ".join(map(quote_with_article, plan.new[1:]))
    return text + (", which takes links that it needs from others." if plan.removed_links else ".")


def _add_existing(builder: RuleBuilder, plan: CreationPlan) -> dict[int, str]:
    """Add an LHS node for each existing object of a plan. Return the variables by the object's number in the plan."""
    return {~number: builder.add_node(cls) for number, cls in enumerate(plan.old)}


def _carry_out_plan(builder: RuleBuilder, plan: CreationPlan, names: dict[int, str]) -> None:
    """Add actions that create the objects of a plan and change its links. Add the created objects to `names`.

    Objects with a name in `names` exist already.
    """
    new = {number: cls for number, cls in enumerate(plan.new) if number not in names}
    names |= {number: builder.reserve_name(variable_name_for(cls)) for number, cls in new.items()}
    classes = list(new.values())
    nodes = [
        RuleNode(names[number], cls, tuple(choose_key(builder, classes, place)))
        for place, (number, cls) in enumerate(new.items())
    ]
    if nodes:
        builder.add_actions(CreateAction(tuple(nodes)))
    for sign, end, near, far in plan.links:
        (builder.add_link if sign > 0 else builder.remove_link)(end, names[near], names[far])


# --- deletion


def _delete_with_contents(builder: RuleBuilder, plan: CreationPlan) -> RuleBuilder:
    """Make a rule delete the objects that a plan creates, with their contents, under conditions. Return the builder."""
    names = {number: builder.add_node(plan.new[number], exact=True) for number in plan.top_objects}
    builder.require_different(*names.values())
    builder.delete_objects(*names.values())
    for _, end, near, far in plan.added_links:
        if near in names and far in names:
            builder.add_edge(end, names[near], names[far])
    if len(names) > 1 or any(end.is_container for end in builder.schema.ends_of(plan.new[0])):
        _DeletedObjects(builder).forbid_shortage()
    else:
        _remove_links(builder, names[0])
    return builder


def _remove_links(builder: RuleBuilder, name: str, except_ends: Sequence[ReferenceEnd] = ()) -> None:
    """Add the conditions for deleting an object: it contains nothing, and linked objects can do without their links.

    Links at the ends `except_ends` get no condition. Contents would be deleted too and leave other objects with too few
    links.
    """
    for end in builder.schema.ends_of(builder.types[name]):
        if end.is_container:
            builder.forbid_link(end, name)
        elif end not in except_ends:
            builder.give_up_links(end, name)


class _DeletedObjects:
    """The objects that an operator deletes, together with everything that they contain."""

    def __init__(self, builder: RuleBuilder) -> None:
        self.builder = builder
        self.roots = {root: builder.types[root] for root in builder.deleted}
        self.typed = [TypeConstraint(cls, Variable(root)) for root, cls in self.roots.items()]
        self.part, self.far, self.lost, self.all = map(builder.reserve_name, ("part", "far", "lost", "all"))

    def forbid_shortage(self) -> None:
        """Add a condition that no remaining object has too few links afterwards and no frozen object is affected."""
        schema = self.builder.schema
        bodies = [body for end in schema.ends for body in self.shortage_bodies(end)]
        contents = [end for cls in self.roots.values() for end in schema.contents(cls)]
        for cls in dict.fromkeys(cls for end in contents for cls in schema.frozen_below(end.far_class)):
            of_class = TypeConstraint(cls, Variable(self.part))
            bodies += [[*self.typed, of_class, way] for way in self.deleted_constraints(self.part, cls)]
        if bodies:
            short = self.builder.add_pattern(f"#{self.builder.name}.short", self.roots, bodies)
            self.builder.add_constraints([Negation(self.call_pattern(short))])

    def call_pattern(self, pattern: str, *more: str) -> PatternCall:
        """Return a call of a pattern with the objects that the rule deletes, and further variables, as arguments."""
        return PatternCall(pattern, tuple(map(Variable, (*self.roots, *more))))

    def deleted_constraints(self, name: str, cls: str) -> Iterator[Comparison | PatternCall]:
        """Yield constraints, of which one holds if an object is deleted: the rule deletes it or a container of it."""
        for root, outer in self.roots.items():
            if self.builder.schema.overlap(outer, cls):
                yield Comparison("==", Variable(name), Variable(root))
            yield from self.builder.inside_calls(outer, root, name, cls)

    def shortage_bodies(self, end: ReferenceEnd) -> Iterator[list[Constraint]]:
        """Yield pattern bodies that match if links at a reference end of a deleted object forbid the deletion.

        The links are frozen, or a remaining linked object is frozen or would have too few links.
        """
        path = end.path(self.part, self.far)
        links: list[list[Constraint]] = [
            [*self.typed, way, path] for way in self.deleted_constraints(self.part, end.near_class)
        ]
        if end.is_frozen:
            yield from links
        if end.is_container or end.is_frozen or not links:
            return
        for way in self.deleted_constraints(self.far, end.far_class):
            stays = replace(way, operator="!=") if isinstance(way, Comparison) else Negation(way)
            links = [[*link, stays] for link in links]
        for cls in self.builder.schema.frozen_below(end.far_class) if end.opposite_end.holds_links else ():
            yield from ([*link, TypeConstraint(cls, Variable(self.far))] for link in links)
        if end.opposite_end.lower:
            yield self.too_few_links(end, links)

    def too_few_links(self, end: ReferenceEnd, links: Sequence[Sequence[Constraint]]) -> list[Constraint]:
        """Return constraints that hold if a remaining object keeps fewer links than its lower bound after the deletion.

        `links` are the pattern bodies that match the links of remaining objects to deleted objects.
        """
        suffix = f"#{self.builder.name}.{end.reference}.{'far' if end.forward else 'near'}"
        parameters = {**self.roots, self.far: end.far_class, self.part: end.near_class}
        lost = self.call_pattern(self.builder.add_pattern(suffix, parameters, links), self.far, "_")
        left = Binary("-", Variable(self.all), Variable(self.lost))
        return [
            lost,
            Comparison("==", Variable(self.lost), Aggregate("count", lost)),
            Comparison("==", Variable(self.all), end.opposite_end.count_links(self.far)),
            Check(Binary("<", left, Constant(end.opposite_end.lower))),
        ]


# --- deletion that gives others something else


def _delete_spreading(builder: RuleBuilder, plan: CreationPlan) -> RuleBuilder:
    """Delete an object and give its links to the objects from which its creation would have taken them.

    This is the inverse of an operator that creates an object and takes links from others.
    """
    name, given = builder.add_node(plan.new[0], exact=True), plan.donated_links(0)
    names: dict[int, str] = {}
    for _, _, donor, far in given:
        for node, wanted in ((donor, "other"), (far, "")):
            if node not in names:
                names[node] = builder.add_node(plan.old[~node], wanted)
                builder.require_different(name, names[node])
    lost = [(end, far) for _, end, near, far in plan.added_links if near == 0 and far in names]
    for end, far in lost:
        builder.record_lost_link(end, name, names[far])
    for _, end, donor, far in given:
        builder.add_link(end, names[donor], names[far])
    builder.delete_objects(name)
    _remove_links(builder, name)
    builder.name = f"delete.{plan.new[0]}.spreading.{'.'.join(end.name for end, _ in lost)}"
    return builder


def _is_relinkable(end: ReferenceEnd, given_to_third: int = 0) -> bool:
    """Return True if objects that need a link at this end may be linked to another object in place of a deleted one.

    `given_to_third` is the number of links that are given to a third object.
    """
    fits = end.upper is None or 2 * end.lower <= end.upper + given_to_third
    return bool(end.opposite_end.lower) and fits and not (end.is_frozen or end.reference.containment)


def _delete_rehoming(builder: RuleBuilder, cls: str, shared: ReferenceEnd | None = None) -> RuleBuilder:
    """Add the deletion of an object, and link objects that need it to another object of the class. Return the builder.

    If an end is `shared`, one link at this end is given to a third object of the class.
    """
    name, other = builder.add_node(cls, exact=True), builder.add_node(cls, "other")
    builder.require_different(name, other)
    if shared is not None:
        third = builder.add_node(cls, "third")
        builder.require_different(name, other, third)
        for receiver, needy in [(one, builder.add_node(shared.far_class)) for one in (third, other)]:
            builder.add_constraints([shared.opposite_end.has_only_needed(needy)])
            builder.record_lost_link(shared, name, needy)
            builder.add_link(shared, receiver, needy)
    builder.delete_objects(name)
    over = [end for end in builder.schema.ends_of(cls) if _is_relinkable(end, int(end == shared))]
    _remove_links(builder, name, over)
    for end in over:
        _relink_needy(builder, end, name, other, int(end == shared))
    return builder


def _relink_needy(builder: RuleBuilder, end: ReferenceEnd, name: str, other: str, given_to_third: int) -> None:
    """Link objects that would have too few links at a reference end without `name` to the object `other` instead.

    Require that they all fit there; `given_to_third` of the links are given to a third object.
    """
    if end.holds_links:
        builder.forbid_frozen(other)
    builder.forbid_frozen_links(end, name)
    if end.upper is not None:
        ours, theirs = (Variable(builder.reserve_name("links")) for _ in range(2))
        builder.add_constraints(
            Comparison("==", links, end.count_links(one)) for links, one in ((ours, name), (theirs, other))
        )
        builder.add_constraints([Check(Binary("<=", Binary("+", ours, theirs), Constant(end.upper + given_to_third)))])
    stuck, needy = builder.reserve_name("stuck"), builder.reserve_name("needy")
    edges, least = [end.edge(name, stuck), end.edge(other, stuck)], end.opposite_end.has_only_needed(stuck)
    builder.add_block("not", stuck, end.far_class, edges, [least], except_for=builder.served_objects(end))
    edge = end.edge(other, needy)
    wanted: list[Constraint] = [end.opposite_end.has_only_needed(needy), Negation(end.path(other, needy))]
    link = CreateAction((RuleNode(edge.source), RuleNode(edge.target)), (edge,))
    builder.add_block(
        "forall",
        needy,
        end.far_class,
        [end.edge(name, needy)],
        wanted,
        (link,),
        except_for=builder.served_objects(end),
    )


# --- new classes


def retyping_operators(schema: Schema, group: str, cls: str, max_plans: int) -> Iterator[RuleBuilder]:
    """Yield the operators that retype an object from one concrete subclass of a class to another."""
    for before, start in retyping_starts(schema, cls):
        for plan in cheapest_plans(schema, start, max_plans):
            name, doc = (
                f"{before}.{start.new[0]}{_name_suffix(plan)}",
                f"Retype a `{before}` to `{start.new[0]}`.",
            )
            yield _retype_by_plan(RuleBuilder(schema, group, f"retype.{name}", doc), before, plan)


def retyping_starts(schema: Schema, cls: str) -> Iterator[tuple[str, CreationPlan]]:
    """Yield pairs: the class before a retyping, and the start of the plan for the class after it."""
    classes = [sub for sub in schema.metamodel.concrete_classes(cls) if not schema.frozen(sub)]
    for before, after in permutations(classes, 2):
        if _keeps_container(schema, before, after):
            kept = [end for end in schema.ends_of(after) if end.is_contained or schema.is_a(before, end.near_class)]
            yield before, CreationPlan((after,), tuple(kept))


def _keeps_container(schema: Schema, old_class: str, new_class: str) -> bool:
    if old_class in schema.roots and new_class not in schema.roots:
        return False
    had = schema.containers(old_class)
    keys = [key_owner(schema, cls) for cls in (new_class, old_class)]
    return keys[0] in (None, keys[1]) and all(end in had for end in schema.containers(new_class) if end.lower)


def _retype_by_plan(builder: RuleBuilder, old_class: str, plan: CreationPlan) -> RuleBuilder:
    after, name = plan.new[0], builder.add_node(old_class, exact=True)
    names = {0: name, **_add_existing(builder, plan)}
    builder.retype_object(name, after, [link.end.reference for link in plan.added_links])
    for one, cls in builder.types.items():
        if one != name and not builder.schema.is_a(after, cls):
            builder.require_different(name, one)
    _carry_out_plan(builder, plan, names)
    return builder
