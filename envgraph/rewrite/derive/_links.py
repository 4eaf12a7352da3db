"""Operators on links between objects that are there: add, remove, change, swap, and move between containers."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Final

from envgraph.metamodel import Reference
from envgraph.pattern import Move, Negation, Variable
from envgraph.rewrite.derive._rule_builder import RuleBuilder
from envgraph.rewrite.derive._schema import Association, End, Schema

Operator = tuple[str, str, RuleBuilder, str, bool]
"""Kind, name without the group, builder, doc, whether links of deleted objects go with them (SPO)."""


_TEMPLATES: Final = (
    ("add", "", "+ source target", "One more target of `{}`."),
    ("remove", "", "- source target", "One target less of `{}`."),
    (
        "change",
        ".source",
        "- source target + other target",
        "A target of `{}` goes over to another `{holder}`.",
    ),
    (
        "change",
        ".target",
        "- source target + source other",
        "Another target of `{}` instead of one that is there.",
    ),
    (
        "swap",
        "",
        "- source target + source target2 - source2 target2 + source2 target",
        "Two objects exchange a target of `{}`.",
    ),
)
"""Kind, end of the name, the links that are removed (-) and added (+), and doc of operators on a reference."""

_LOOPS: Final = (
    (
        "swap",
        ".joining",
        "- source source - target target + source target",
        "Two objects are linked to each other by `{}`.",
    ),
    (
        "swap",
        ".parting",
        "- source target + source source + target target",
        "Two objects are linked each to itself by `{}`.",
    ),
)
"""As many links of a symmetric reference: between two objects, or of each to itself."""


def link_operators(schema: Schema, group: str, cls: str) -> Iterator[Operator]:
    """The operators on the links of a class; those of a pair of opposites in one class only once."""
    for end in _own_ends(schema, cls):
        feature = end.reference if end.forward else end.association.opposite or end.reference
        holder, symmetric = schema.holder(cls, feature), end.association.symmetric
        for kind, suffix, links, doc in (*_TEMPLATES, *(_LOOPS if symmetric else ())):
            builder = RuleBuilder(schema, group)
            _relink(builder, end, holder, links, kind)
            possible = all(place.flexible for place, _ in builder.balances)
            if possible and not (symmetric and suffix == ".source"):  # the same as `.target`
                name = f"{holder}.{end.name}"
                yield kind, f"{kind}.{name}{suffix}", builder, doc.format(name, holder=holder), False


def _relink(builder: RuleBuilder, end: End, holder: str, links: str, kind: str) -> None:
    """Remove and add the links of a template, from objects of `holder`."""
    words = links.split()
    changes = list(zip(words[::3], words[1::3], words[2::3], strict=True))
    near = {one for _, one, _ in changes if not one.startswith("target")}
    for _, *ends in sorted(changes, key=lambda change: change[0] == "+"):
        for name in ends:
            if name not in builder.types:
                builder.node(name, holder if name in near else end.far)
    for one, other in combinations(builder.types, 2):
        # An end of a symmetric link to itself would have another number of links afterwards.
        if (one in near) == (other in near) or (end.association.symmetric and kind == "swap"):
            builder.differ(one, other)
    for sign, source, target in changes:
        (builder.link if sign == "+" else builder.unlink)(end, source, target)


def container_operators(schema: Schema, group: str, cls: str) -> Iterator[Operator]:
    """The operators that change the containers of the objects of a class."""
    for association in schema.associations:
        end = End(association, forward=True)
        child = _narrower(schema, cls, end.far)
        if end.contains and child is not None and not association.frozen:
            yield from _move(RuleBuilder(schema, group), end, cls, child)
            yield from _exchange(RuleBuilder(schema, group), end, cls, child)


def _own_ends(schema: Schema, cls: str) -> Iterator[End]:
    seen: list[Association] = []
    for feature in schema.features(cls):
        if not isinstance(feature, Reference):
            continue
        (association,) = (a for a in schema.associations if feature in (a.reference, a.opposite))
        if association in seen or association.frozen or association.reference.containment:
            continue
        seen.append(association)
        yield End(association, forward=feature == association.reference)


def _narrower(schema: Schema, one: str, other: str) -> str | None:
    """The class whose objects are instances of both, where one is a subclass of the other."""
    if schema.is_a(one, other):
        return one
    return other if schema.is_a(other, one) else None


# --- containment


def _move(builder: RuleBuilder, end: End, cls: str, child: str) -> Iterator[Operator]:
    if not end.flexible:
        return
    part, container = builder.node("part", child), builder.node("container", end.near)
    builder.spared(part, child)
    builder.spared(container, end.near)
    builder.absent(end, container, part)
    builder.ask(end.room(container))
    builder.not_inside(part, container)
    for before in builder.schema.ends_over(child):
        if before.contained:
            _leave(builder, before, end, part, container)
    builder.act(Move(Variable(part), Variable(container), end.reference.name))
    yield (
        "move",
        f"move.{cls}.{end.name}",
        builder,
        f"A `{child}` goes into another `{end.reference}`.",
        False,
    )


def _leave(builder: RuleBuilder, before: End, end: End, part: str, container: str) -> None:
    """The container that an object is in can do without it."""
    same = before.association is end.association
    if before.association.frozen or (before.lower and not same):
        builder.ask([Negation(before.path(part, "_"))])
        return
    builder.unfrozen(before, part)
    if before.other.lower:
        builder.short(before, part, part, *((container,) if same else ()))


def _exchange(builder: RuleBuilder, end: End, cls: str, child: str) -> Iterator[Operator]:
    pairs = []
    for _ in range(2):
        part, container = builder.node("part", child), builder.node("container", end.near)
        builder.spared(part, child)
        builder.spared(container, end.near)
        pairs.append((part, container))
    (one, first), (two, second) = pairs
    for part, old, new in ((one, first, second), (two, second, first)):
        builder.not_inside(part, new)
        builder.unlink(end, old, part)
        builder.link(end, new, part)
    doc = f"Two containers exchange a `{child}` of `{end.reference}`."
    yield "swap", f"swap.{cls}.{end.name}", builder, doc, False
