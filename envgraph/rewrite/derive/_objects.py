"""Operators that create, delete and retype objects."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

from envgraph.errors import with_article
from envgraph.pattern import (
    Aggregate,
    Binary,
    Body,
    Check,
    Comparison,
    Constant,
    Constraint,
    Create,
    Negation,
    Node,
    PatternCall,
    Retype,
    Term,
    TypeConstraint,
    Variable,
)
from envgraph.rewrite.derive._keys import key_owner, new_key
from envgraph.rewrite.derive._links import Operator
from envgraph.rewrite.derive._plans import Plan, creation_plans, retyping_plans
from envgraph.rewrite.derive._rule_builder import RuleBuilder, variable_for
from envgraph.rewrite.derive._schema import End, Schema


def creating_and_deleting(schema: Schema, group: str, cls: str, most: int) -> Iterator[Operator]:
    """The operators that make and remove objects of exactly one class.

    What an operator creates together, another one deletes together; what one steals, another one spreads.
    """
    plans = creation_plans(schema, cls, most)
    for plan in plans:
        yield _create(RuleBuilder(schema, group), plan)
    yield _delete(RuleBuilder(schema, group), cls)
    yield from _rehome(RuleBuilder(schema, group), cls)
    for end in schema.ends_of(cls):
        if _goes_over(end, 1) and not schema.metamodel.overlap(end.near, end.far):
            yield _share(RuleBuilder(schema, group), cls, end)
    for plan in plans:
        if plan.steals and len(plan.tops) == 1:
            yield _spread(RuleBuilder(schema, group), plan)
        elif not plan.steals and len(plan.tops) > 1:
            yield _delete_together(RuleBuilder(schema, group), plan)


# --- the objects of a plan as variables


class _Cast:
    """Variables for the objects of a plan."""

    def __init__(self, builder: RuleBuilder, plan: Plan) -> None:
        self.builder = builder
        self.plan = plan
        self.new: list[str] = []
        self.old: list[str] = []

    def declare_old(self) -> None:
        """Declare the objects that are there."""
        builder, plan = self.builder, self.plan
        for old in plan.old:
            self.old.append(builder.node(variable_for(old.cls), old.cls))

    def variable(self, position: int, new: bool) -> str:
        """The variable of an object."""
        return self.new[position] if new else self.old[position]

    def connect(self) -> None:
        """Make the links of the plan."""
        for link in self.plan.links:
            if not link.far_new:
                donor = self.plan.old[link.far].stolen_from
                if donor is not None:
                    self.builder.unlink(link.end, self.old[donor], self.old[link.far])
            self.builder.link(link.end, self.new[link.near], self.variable(link.far, link.far_new))


def _suffix(plan: Plan) -> str:
    """Return what tells the operators for the plans of one class apart, for names."""
    parts = [link.end.name for link in plan.links if link.end.contained and not link.far_new][:1]
    if len(plan.new) > 1:
        parts += ["with", *plan.new[1:]]
    stolen = [
        link.end.name
        for link in plan.links
        if not link.far_new and plan.old[link.far].stolen_from is not None
    ]
    if stolen:
        parts += ["stealing", *stolen]
    return "".join(f".{part}" for part in parts)


def _create(builder: RuleBuilder, plan: Plan) -> Operator:
    cast = _Cast(builder, plan)
    cast.declare_old()
    cast.new += [builder.name(variable_for(cls)) for cls in plan.new]
    nodes = [
        Node(name, cls, tuple(new_key(builder, plan.new, number)))
        for number, (name, cls) in enumerate(zip(cast.new, plan.new, strict=True))
    ]
    builder.act(Create(tuple(nodes)))
    cast.connect()
    return "create", f"create.{plan.new[0]}{_suffix(plan)}", builder, _creation_doc(plan), False


def _creation_doc(plan: Plan) -> str:
    text = f"A new `{plan.new[0]}`"
    if len(plan.new) > 1:
        text += ", together with " + " and ".join(map(with_article, plan.new[1:]))
    return text + (", which takes what it needs from others." if plan.steals else ".")


# --- deletion


def _delete(builder: RuleBuilder, cls: str) -> Operator:
    name = builder.node(variable_for(cls), cls, exact=True)
    if builder.schema.contains_any(cls):
        _none_short(builder, f"delete.{cls}", [name])
    else:
        for end in builder.schema.ends_of(cls):
            builder.lacking(end, name, name)
    builder.delete(name)
    doc = f"A `{cls}` goes, with what it contains, if everybody else can do without."
    return "delete", f"delete.{cls}", builder, doc, True


def _delete_together(builder: RuleBuilder, plan: Plan) -> Operator:
    """Delete together what was created together."""
    classes = {number: plan.new[number] for number in plan.tops}
    names = {number: builder.node(variable_for(cls), cls, exact=True) for number, cls in classes.items()}
    for one, other in combinations(names.values(), 2):
        builder.differ(one, other)
    for link in plan.links:
        if link.far_new and link.near in names and link.far in names:
            builder.edge(link.end, names[link.near], names[link.far])
    first, *others = classes.values()
    name = f"delete.{first}.with.{'.'.join(others)}"
    _none_short(builder, name, list(names.values()))
    for gone in names.values():
        builder.delete(gone)
    doc = (
        "Objects that need each other go together: "
        + ", ".join(f"a `{cls}`" for cls in classes.values())
        + "."
    )
    return "delete", name, builder, doc, True


def _none_short(builder: RuleBuilder, name: str, roots: Sequence[str]) -> None:
    """Forbid deletions after which an object has fewer links than its multiplicity asks for."""
    gone = _Gone(builder, name, roots)
    bodies = [body for end in builder.schema.ends for body in gone.short(end)]
    bodies += gone.frozen()
    if bodies:
        short = builder.pattern(f"#{name}.short", gone.parameters, bodies)
        builder.ask([Negation(_find(short, roots))])


class _Gone:
    """Objects that are about to go, with everything inside them."""

    def __init__(self, builder: RuleBuilder, name: str, roots: Sequence[str]) -> None:
        self.builder = builder
        self.name = name
        self.parameters = {root: builder.types[root] for root in roots}
        self.typed = [TypeConstraint(cls, Variable(root)) for root, cls in self.parameters.items()]

    def each(self, part: str, cls: str) -> Iterator[Constraint]:
        """The ways in which an object of a class is one of them."""
        overlap = self.builder.schema.metamodel.overlap
        for root, outer in self.parameters.items():
            if overlap(outer, cls):
                yield Comparison("==", Variable(part), Variable(root))
            for end in self.builder.contents(outer):
                if overlap(end.far, cls):
                    yield self.builder.inside(end, outer, root, part)

    def none(self, name: str, cls: str) -> Iterator[Constraint]:
        """An object of a class is none of them."""
        for way in self.each(name, cls):
            match way:
                case Comparison(_, left, right):
                    yield Comparison("!=", left, right)
                case PatternCall():
                    yield Negation(way)

    def frozen(self) -> Iterator[Body]:
        """One of them is to be left alone."""
        for outer in self.parameters.values():
            for end in self.builder.contents(outer):
                for cls in self.builder.schema.frozen_below(end.far):
                    for way in self.each("part", cls):
                        yield Body((*self.typed, TypeConstraint(cls, Variable("part")), way))

    def short(self, end: End) -> Iterator[Body]:
        """Yield bodies in which an object that stays has too few links afterwards, or is to be left alone."""
        links = [(*self.typed, way, end.path("part", "far")) for way in self.each("part", end.near)]
        if end.association.frozen:
            yield from map(Body, links)
        if end.contains or end.association.frozen or not links:
            return
        links = [(*link, *self.none("far", end.far)) for link in links]
        if end.other.held:
            for cls in self.builder.schema.frozen_below(end.far):
                yield from (Body((*link, TypeConstraint(cls, Variable("far")))) for link in links)
        if end.other.lower:
            yield self._too_few(end, [Body(link) for link in links])

    def _too_few(self, end: End, links: Sequence[Body]) -> Body:
        suffix = f"#{self.name}.{end.reference}.{'far' if end.forward else 'near'}"
        parameters = {**self.parameters, "far": end.far, "part": end.near}
        lost = self.builder.pattern(suffix, parameters, links)
        roots = tuple(self.parameters)
        counts: list[tuple[str, Term]] = [
            ("lost", Aggregate("count", _find(lost, roots, "far", "_"))),
            ("all", end.other.count("far")),
        ]
        left = Binary("-", Variable("all"), Variable("lost"))
        return Body(
            (
                _find(lost, roots, "far", "_"),
                *(Comparison("==", Variable(name), count) for name, count in counts),
                Check(Binary("<", left, Constant(end.other.lower))),
            )
        )


def _find(pattern: str, roots: Sequence[str], *more: str) -> PatternCall:
    return PatternCall(pattern, tuple(Variable(name) for name in (*roots, *more)))


# --- deletion that gives others something else


def _empty(builder: RuleBuilder, name: str, cls: str) -> None:
    """The object contains nothing: what is inside would go as well, and could leave others short."""
    for end in builder.schema.ends_of(cls):
        if end.contains:
            builder.ask([Negation(end.path(name, "_"))])


def _spread(builder: RuleBuilder, plan: Plan) -> Operator:
    """The inverse of stealing: what needs the object goes over to others, to as many as gave it away."""
    cls = plan.new[0]
    name = builder.node(variable_for(cls), cls, exact=True)
    _empty(builder, name, cls)
    moved: list[tuple[End, str]] = []
    receivers: dict[int, str] = {}
    for link in plan.links:
        donor = None if link.far_new else plan.old[link.far].stolen_from
        if link.near != 0 or donor is None:
            continue
        if donor not in receivers:
            receivers[donor] = builder.node("other", link.end.near)
        receiver, target = receivers[donor], builder.node(variable_for(link.end.far), link.end.far)
        builder.differ(name, receiver)
        builder.differ(name, target)
        builder.lose(link.end, name, target)
        moved.append((link.end, target))
        if plan.old[donor].repaid:
            builder.lose(link.end, receiver, name)
            moved.append((link.end.other, receiver))
        builder.link(link.end, receiver, target)
    for end in builder.schema.ends_of(cls):
        builder.lacking(end, name, name, *(target for one, target in moved if one == end))
    builder.delete(name)
    stolen = [end.name for end, _ in moved]
    doc = f"A `{cls}` goes, and what needs it goes over to others."
    return "delete", f"delete.{cls}.spreading.{'.'.join(stolen)}", builder, doc, True


def _rehome(builder: RuleBuilder, cls: str) -> Iterator[Operator]:
    """Link whatever would have too few links to one other object of the class."""
    name, other = builder.node(variable_for(cls), cls, exact=True), builder.node("other", cls)
    builder.differ(name, other)
    if _all_over(builder, cls, name, other):
        builder.delete(name)
        doc = f"A `{cls}` goes, and another one takes its place where it is needed."
        yield "delete", f"delete.{cls}.rehoming", builder, doc, True


def _share(builder: RuleBuilder, cls: str, end: End) -> Operator:
    """As rehoming, but of those that would have too few links at one end, one is linked to a third object."""
    name, other = builder.node(variable_for(cls), cls, exact=True), builder.node("other", cls)
    third = builder.node("third", cls)
    for one, two in combinations((name, other, third), 2):
        builder.differ(one, two)
    needy = [builder.node(variable_for(end.far), end.far) for _ in range(2)]
    for target, receiver in zip(needy, (third, other), strict=True):
        builder.lose(end, name, target)
        builder.ask([Comparison("==", end.other.count(target), Constant(end.other.lower))])
        builder.link(end, receiver, target)
    _all_over(builder, cls, name, other, shared=end)
    builder.delete(name)
    doc = f"A `{cls}` goes, and two others take its place at `{end.name}`."
    return "delete", f"delete.{cls}.spreading.{end.name}.all", builder, doc, True


def _goes_over(end: End, elsewhere: int = 0) -> bool:
    """Return whether who needs an object at an end may go over to another one, all but some that go elsewhere."""
    fits = end.upper is None or 2 * end.lower <= end.upper + elsewhere
    return bool(end.other.lower) and fits and not (end.association.frozen or end.contained or end.contains)


def _all_over(builder: RuleBuilder, cls: str, name: str, other: str, shared: End | None = None) -> bool:
    """Link, at every end, what would have too few links to the other object; return whether there is such an end.

    At the shared end one link goes elsewhere.
    """
    _empty(builder, name, cls)
    ends = builder.schema.ends_of(cls)
    for end in ends:
        if _goes_over(end, int(end == shared)):
            _rehome_end(builder, end, name, other, int(end == shared))
        else:
            builder.lacking(end, name, name)
    return any(map(_goes_over, ends))


def _rehome_end(builder: RuleBuilder, end: End, name: str, other: str, elsewhere: int) -> None:
    if end.held:
        builder.spared(other, end.near)
    if end.other.held:
        builder.unfrozen(end, name)
    if end.upper is not None:
        ours, theirs = builder.name("links"), builder.name("links")
        for number, one in ((ours, name), (theirs, other)):
            builder.ask([Comparison("==", Variable(number), end.count(one))])
        together = Binary("+", Variable(ours), Variable(theirs))
        builder.ask([Check(Binary("<=", together, Constant(end.upper + elsewhere)))])
    stuck, needy = builder.name("stuck"), builder.name("needy")
    short = {one: Comparison("==", end.other.count(one), Constant(end.other.lower)) for one in (stuck, needy)}
    edges = [end.edge(name, stuck), end.edge(other, stuck)]
    builder.block("not", [Node(stuck, end.far)], edges, [short[stuck]])
    edge = end.edge(other, needy)
    link = Create((Node(edge.source), Node(edge.target)), (edge,))
    builder.block(
        "forall",
        [Node(needy, end.far)],
        [end.edge(name, needy)],
        [short[needy], Negation(end.path(other, needy))],
        [link],
    )
    for one in (stuck, needy):
        for known in builder.types:
            if known != name and not (elsewhere and builder.types[known] == end.far):
                builder.may_be(one, known)


# --- new classes


def retypings(schema: Schema, group: str, cls: str, most: int) -> Iterator[Operator]:
    """The operators that make an object an instance of another subclass of a class."""
    classes = [sub for sub in schema.metamodel.concrete(cls) if not schema.frozen(sub)]
    for before in classes:
        for after in classes:
            if before != after and _has_place(schema, before, after):
                for plan in retyping_plans(schema, before, after, most):
                    yield _retype(RuleBuilder(schema, group), before, after, plan)


def _has_place(schema: Schema, before: str, after: str) -> bool:
    if before in schema.roots and after not in schema.roots:
        return False
    had = schema.containers(before)
    keys = [key_owner(schema, cls) for cls in (after, before)]
    return keys[0] in (None, keys[1]) and all(end in had for end in schema.containers(after) if end.lower)


def _retype(builder: RuleBuilder, before: str, after: str, plan: Plan) -> Operator:
    cast = _Cast(builder, plan)
    name = builder.node(variable_for(before), before, exact=True)
    cast.declare_old()
    for old in cast.old:
        if not builder.schema.is_a(after, builder.types[old]):
            builder.differ(name, old)
    kept = builder.schema.ends_of(after)
    gained = [link.end.association for link in plan.links]
    for end in builder.schema.ends_of(before):
        if end in kept:
            continue
        if end.contains or end.contained or end.association in gained:
            builder.ask([Negation(end.path(name, "_"))])
        else:
            builder.lacking(end, name)
    cast.new += [name, *(builder.name(variable_for(cls)) for cls in plan.new[1:])]
    fresh = [
        Node(one, cls, tuple(new_key(builder, plan.new[1:], number - 1)))
        for number, (one, cls) in enumerate(zip(cast.new, plan.new, strict=True))
        if number
    ]
    builder.act(Retype(Variable(name), after), *([Create(tuple(fresh))] if fresh else []))
    cast.connect()
    doc = f"`{before}` becomes `{after}`."
    return "retype", f"retype.{before}.{after}{_suffix(plan)}", builder, doc, True
