"""Operators that create, delete and retype objects."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import permutations

from envgraph.errors import with_article
from envgraph.pattern import (
    Aggregate,
    Binary,
    Check,
    Comparison,
    Constant,
    Constraint,
    Create,
    Negation,
    Node,
    PatternCall,
    TypeConstraint,
    Variable,
)
from envgraph.rewrite.derive._keys import key_owner, new_key
from envgraph.rewrite.derive._plans import Plan, cheapest_plans, creation_plans
from envgraph.rewrite.derive._rule_builder import RuleBuilder, variable_for
from envgraph.rewrite.derive._schema import End, Schema


def creating_and_deleting(schema: Schema, group: str, cls: str, most: int) -> Iterator[RuleBuilder]:
    """Yield the operators that create and delete objects of exactly one class.

    For each operator that creates several objects together, another operator deletes them together. For each operator
    that takes links from other objects, another operator gives links to other objects.
    """
    begun = partial(RuleBuilder, schema, group)
    plans = creation_plans(schema, cls, most)
    for plan in plans:
        builder = begun(f"create.{cls}{_suffix(plan)}", _creation_doc(plan))
        _fulfil(builder, plan, _old(builder, plan))
        yield builder
    doc = f"Delete a `{cls}` with its contents, if no other object then has too few links."
    yield _delete(begun(f"delete.{cls}", doc), Plan((cls,)))
    if any(map(_goes_over, schema.ends_of(cls))):
        doc = f"Delete a `{cls}`, and link the objects that need it to another one."
        yield _rehome(begun(f"delete.{cls}.rehoming", doc), cls)
    for end in schema.ends_of(cls):
        if _goes_over(end, 1) and not schema.overlap(end.near, end.far):
            doc = f"Delete a `{cls}`, and link the objects that need it at `{end.name}` to two others."
            yield _rehome(begun(f"delete.{cls}.spreading.{end.name}.all", doc), cls, end)
    for plan in plans:
        if plan.given(0) and len(plan.tops) == 1:
            yield _spread(begun("", f"Delete a `{cls}`, and link the objects that need it to others."), plan)
        elif not plan.removed and len(plan.tops) > 1:
            first, *others = (plan.new[node] for node in plan.tops)
            doc = f"Delete objects that need each other: {', '.join(f'a `{o}`' for o in (first, *others))}."
            yield _delete(begun(f"delete.{first}.with.{'.'.join(others)}", doc), plan)


# --- plans


def _suffix(plan: Plan) -> str:
    """Return the part of an operator's name that distinguishes the plans of one class."""
    parts = [end.name for _, end, _, far in plan.added if end.contained and far < 0][:1]
    if len(plan.new) > 1:
        parts += ["with", *plan.new[1:]]
    if plan.removed:
        parts += ["stealing", *(link.end.name for link in plan.removed)]
    return "".join(f".{part}" for part in parts)


def _creation_doc(plan: Plan) -> str:
    text = f"Create a new `{plan.new[0]}`"
    if len(plan.new) > 1:
        text += ", together with " + " and ".join(map(with_article, plan.new[1:]))
    return text + (", which takes links that it needs from others." if plan.removed else ".")


def _old(builder: RuleBuilder, plan: Plan) -> dict[int, str]:
    """Add an LHS node for each existing object of a plan. Return the variables by the object's number in the plan."""
    return {~number: builder.node(cls) for number, cls in enumerate(plan.old)}


def _fulfil(builder: RuleBuilder, plan: Plan, names: dict[int, str]) -> None:
    """Add actions that create the objects of a plan and change its links. Add the created objects to `names`.

    Objects with a name in `names` exist already.
    """
    new = {number: cls for number, cls in enumerate(plan.new) if number not in names}
    names |= {number: builder.fresh(variable_for(cls)) for number, cls in new.items()}
    classes = list(new.values())
    nodes = [
        Node(names[number], cls, tuple(new_key(builder, classes, place)))
        for place, (number, cls) in enumerate(new.items())
    ]
    if nodes:
        builder.act(Create(tuple(nodes)))
    for sign, end, near, far in plan.links:
        (builder.link if sign > 0 else builder.unlink)(end, names[near], names[far])


# --- deletion


def _delete(builder: RuleBuilder, plan: Plan) -> RuleBuilder:
    """Make a rule delete the objects that a plan creates, with their contents, under conditions. Return the builder."""
    names = {number: builder.node(plan.new[number], exact=True) for number in plan.tops}
    builder.differ(*names.values())
    builder.delete(*names.values())
    for _, end, near, far in plan.added:
        if near in names and far in names:
            builder.edge(end, names[near], names[far])
    if len(names) > 1 or any(end.contains for end in builder.schema.ends_of(plan.new[0])):
        _Gone(builder).none_short()
    else:
        _leave_all(builder, names[0])
    return builder


def _leave_all(builder: RuleBuilder, name: str, but: Sequence[End] = ()) -> None:
    """Add the conditions for deleting an object: it contains nothing, and linked objects can do without their links.

    Links at the ends `but` get no condition. Contents would be deleted too and leave other objects with too few links.
    """
    for end in builder.schema.ends_of(builder.types[name]):
        if end.contains:
            builder.absent(end, name)
        elif end not in but:
            builder.leave(end, name)


class _Gone:
    """The objects that an operator deletes, together with everything that they contain."""

    def __init__(self, builder: RuleBuilder) -> None:
        self.builder = builder
        self.roots = {root: builder.types[root] for root in builder.gone}
        self.typed = [TypeConstraint(cls, Variable(root)) for root, cls in self.roots.items()]
        self.part, self.far, self.lost, self.all = map(builder.fresh, ("part", "far", "lost", "all"))

    def none_short(self) -> None:
        """Add a condition that no remaining object has too few links afterwards and no frozen object is affected."""
        schema = self.builder.schema
        bodies = [body for end in schema.ends for body in self.short(end)]
        contents = [end for cls in self.roots.values() for end in schema.contents(cls)]
        for cls in dict.fromkeys(cls for end in contents for cls in schema.frozen_below(end.far)):
            of_class = TypeConstraint(cls, Variable(self.part))
            bodies += [[*self.typed, of_class, way] for way in self.ways(self.part, cls)]
        if bodies:
            short = self.builder.pattern(f"#{self.builder.name}.short", self.roots, bodies)
            self.builder.ask([Negation(self.find(short))])

    def find(self, pattern: str, *more: str) -> PatternCall:
        """Return a call of a pattern with the objects that the rule deletes, and further variables, as arguments."""
        return PatternCall(pattern, tuple(map(Variable, (*self.roots, *more))))

    def ways(self, name: str, cls: str) -> Iterator[Comparison | PatternCall]:
        """Yield constraints, of which one holds if an object is deleted: the rule deletes it or a container of it."""
        for root, outer in self.roots.items():
            if self.builder.schema.overlap(outer, cls):
                yield Comparison("==", Variable(name), Variable(root))
            yield from self.builder.inside(outer, root, name, cls)

    def short(self, end: End) -> Iterator[list[Constraint]]:
        """Yield pattern bodies that match if links at a reference end of a deleted object forbid the deletion.

        The links are frozen, or a remaining linked object is frozen or would have too few links.
        """
        path = end.path(self.part, self.far)
        links: list[list[Constraint]] = [[*self.typed, way, path] for way in self.ways(self.part, end.near)]
        if end.frozen:
            yield from links
        if end.contains or end.frozen or not links:
            return
        for way in self.ways(self.far, end.far):
            stays = replace(way, operator="!=") if isinstance(way, Comparison) else Negation(way)
            links = [[*link, stays] for link in links]
        for cls in self.builder.schema.frozen_below(end.far) if end.other.held else ():
            yield from ([*link, TypeConstraint(cls, Variable(self.far))] for link in links)
        if end.other.lower:
            yield self.too_few(end, links)

    def too_few(self, end: End, links: Sequence[Sequence[Constraint]]) -> list[Constraint]:
        """Return constraints that hold if a remaining object keeps fewer links than its lower bound after the deletion.

        `links` are the pattern bodies that match the links of remaining objects to deleted objects.
        """
        suffix = f"#{self.builder.name}.{end.reference}.{'far' if end.forward else 'near'}"
        parameters = {**self.roots, self.far: end.far, self.part: end.near}
        lost = self.find(self.builder.pattern(suffix, parameters, links), self.far, "_")
        left = Binary("-", Variable(self.all), Variable(self.lost))
        return [
            lost,
            Comparison("==", Variable(self.lost), Aggregate("count", lost)),
            Comparison("==", Variable(self.all), end.other.count(self.far)),
            Check(Binary("<", left, Constant(end.other.lower))),
        ]


# --- deletion that gives others something else


def _spread(builder: RuleBuilder, plan: Plan) -> RuleBuilder:
    """Delete an object and give its links to the objects from which its creation would have taken them.

    This is the inverse of an operator that creates an object and takes links from others.
    """
    name, given = builder.node(plan.new[0], exact=True), plan.given(0)
    names: dict[int, str] = {}
    for _, _, donor, far in given:
        for node, wanted in ((donor, "other"), (far, "")):
            if node not in names:
                names[node] = builder.node(plan.old[~node], wanted)
                builder.differ(name, names[node])
    lost = [(end, far) for _, end, near, far in plan.added if near == 0 and far in names]
    for end, far in lost:
        builder.lose(end, name, names[far])
    for _, end, donor, far in given:
        builder.link(end, names[donor], names[far])
    builder.delete(name)
    _leave_all(builder, name)
    builder.name = f"delete.{plan.new[0]}.spreading.{'.'.join(end.name for end, _ in lost)}"
    return builder


def _goes_over(end: End, elsewhere: int = 0) -> bool:
    """Return True if objects that need a link at this end may be linked to another object in place of a deleted one.

    `elsewhere` is the number of links that are given to a third object.
    """
    fits = end.upper is None or 2 * end.lower <= end.upper + elsewhere
    return bool(end.other.lower) and fits and not (end.frozen or end.reference.containment)


def _rehome(builder: RuleBuilder, cls: str, shared: End | None = None) -> RuleBuilder:
    """Add the deletion of an object, and link objects that need it to another object of the class. Return the builder.

    If an end is `shared`, one link at this end is given to a third object of the class.
    """
    name, other = builder.node(cls, exact=True), builder.node(cls, "other")
    builder.differ(name, other)
    if shared is not None:
        third = builder.node(cls, "third")
        builder.differ(name, other, third)
        for receiver, needy in [(one, builder.node(shared.far)) for one in (third, other)]:
            builder.ask([shared.other.least(needy)])
            builder.lose(shared, name, needy)
            builder.link(shared, receiver, needy)
    builder.delete(name)
    over = [end for end in builder.schema.ends_of(cls) if _goes_over(end, int(end == shared))]
    _leave_all(builder, name, over)
    for end in over:
        _go_over(builder, end, name, other, int(end == shared))
    return builder


def _go_over(builder: RuleBuilder, end: End, name: str, other: str, elsewhere: int) -> None:
    """Link objects that would have too few links at a reference end without `name` to the object `other` instead.

    Require that they all fit there; `elsewhere` of the links are given to a third object.
    """
    if end.held:
        builder.spared(other)
    builder.untouched(end, name)
    if end.upper is not None:
        ours, theirs = (Variable(builder.fresh("links")) for _ in range(2))
        builder.ask(Comparison("==", links, end.count(one)) for links, one in ((ours, name), (theirs, other)))
        builder.ask([Check(Binary("<=", Binary("+", ours, theirs), Constant(end.upper + elsewhere)))])
    stuck, needy = builder.fresh("stuck"), builder.fresh("needy")
    edges, least = [end.edge(name, stuck), end.edge(other, stuck)], end.other.least(stuck)
    builder.block("not", stuck, end.far, edges, [least], but=builder.served(end))
    edge = end.edge(other, needy)
    wanted: list[Constraint] = [end.other.least(needy), Negation(end.path(other, needy))]
    link = Create((Node(edge.source), Node(edge.target)), (edge,))
    builder.block("forall", needy, end.far, [end.edge(name, needy)], wanted, (link,), but=builder.served(end))


# --- new classes


def retypings(schema: Schema, group: str, cls: str, most: int) -> Iterator[RuleBuilder]:
    """Yield the operators that retype an object from one concrete subclass of a class to another."""
    for before, start in retyping_starts(schema, cls):
        for plan in cheapest_plans(schema, start, most):
            name, doc = f"{before}.{start.new[0]}{_suffix(plan)}", f"Retype a `{before}` to `{start.new[0]}`."
            yield _retype(RuleBuilder(schema, group, f"retype.{name}", doc), before, plan)


def retyping_starts(schema: Schema, cls: str) -> Iterator[tuple[str, Plan]]:
    """Yield pairs: the class before a retyping, and the start of the plan for the class after it."""
    classes = [sub for sub in schema.metamodel.concrete(cls) if not schema.frozen(sub)]
    for before, after in permutations(classes, 2):
        if _has_place(schema, before, after):
            kept = [end for end in schema.ends_of(after) if end.contained or schema.is_a(before, end.near)]
            yield before, Plan((after,), tuple(kept))


def _has_place(schema: Schema, before: str, after: str) -> bool:
    if before in schema.roots and after not in schema.roots:
        return False
    had = schema.containers(before)
    keys = [key_owner(schema, cls) for cls in (after, before)]
    return keys[0] in (None, keys[1]) and all(end in had for end in schema.containers(after) if end.lower)


def _retype(builder: RuleBuilder, before: str, plan: Plan) -> RuleBuilder:
    after, name = plan.new[0], builder.node(before, exact=True)
    names = {0: name, **_old(builder, plan)}
    builder.retype(name, after, [link.end.reference for link in plan.added])
    for one, cls in builder.types.items():
        if one != name and not builder.schema.is_a(after, cls):
            builder.differ(name, one)
    _fulfil(builder, plan, names)
    return builder
