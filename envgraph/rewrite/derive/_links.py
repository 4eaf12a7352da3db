"""Operators on links between objects that are there: add, remove, change, swap, and move between containers."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Final

from envgraph.metamodel import Reference
from envgraph.pattern import Move, Negation, Variable
from envgraph.rewrite.derive._draft import Draft
from envgraph.rewrite.derive._schema import Association, End, Schema

Operator = tuple[str, str, Draft, str, bool]
"""Kind, name without the group, draft, doc, whether links of deleted objects go with them (SPO)."""


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
            draft = Draft(schema, group)
            _relink(draft, end, holder, links, kind)
            possible = all(place.flexible for place, _ in draft.balances)
            if possible and not (symmetric and suffix == ".source"):  # the same as `.target`
                name = f"{holder}.{end.name}"
                yield kind, f"{kind}.{name}{suffix}", draft, doc.format(name, holder=holder), False


def _relink(draft: Draft, end: End, holder: str, links: str, kind: str) -> None:
    """Remove and add the links of a template, from objects of `holder`."""
    words = links.split()
    changes = list(zip(words[::3], words[1::3], words[2::3], strict=True))
    near = {one for _, one, _ in changes if not one.startswith("target")}
    for _, *ends in sorted(changes, key=lambda change: change[0] == "+"):
        for name in ends:
            if name not in draft.types:
                draft.node(name, holder if name in near else end.far)
    for one, other in combinations(draft.types, 2):
        # An end of a symmetric link to itself would have another number of links afterwards.
        if (one in near) == (other in near) or (end.association.symmetric and kind == "swap"):
            draft.differ(one, other)
    for sign, source, target in changes:
        (draft.link if sign == "+" else draft.unlink)(end, source, target)


def container_operators(schema: Schema, group: str, cls: str) -> Iterator[Operator]:
    """The operators that change the containers of the objects of a class."""
    for association in schema.associations:
        end = End(association, forward=True)
        child = _narrower(schema, cls, end.far)
        if end.contains and child is not None and not association.frozen:
            yield from _move(Draft(schema, group), end, cls, child)
            yield from _exchange(Draft(schema, group), end, cls, child)


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


def _move(draft: Draft, end: End, cls: str, child: str) -> Iterator[Operator]:
    if not end.flexible:
        return
    part, container = draft.node("part", child), draft.node("container", end.near)
    draft.spared(part, child)
    draft.spared(container, end.near)
    draft.absent(end, container, part)
    draft.ask(end.room(container))
    draft.not_inside(part, container)
    for before in draft.schema.ends_over(child):
        if before.contained:
            _leave(draft, before, end, part, container)
    draft.act(Move(Variable(part), Variable(container), end.reference.name))
    yield "move", f"move.{cls}.{end.name}", draft, f"A `{child}` goes into another `{end.reference}`.", False


def _leave(draft: Draft, before: End, end: End, part: str, container: str) -> None:
    """The container that an object is in can do without it."""
    same = before.association is end.association
    if before.association.frozen or (before.lower and not same):
        draft.ask([Negation(before.path(part, "_"))])
        return
    draft.unfrozen(before, part)
    if before.other.lower:
        draft.short(before, part, part, *((container,) if same else ()))


def _exchange(draft: Draft, end: End, cls: str, child: str) -> Iterator[Operator]:
    pairs = []
    for _ in range(2):
        part, container = draft.node("part", child), draft.node("container", end.near)
        draft.spared(part, child)
        draft.spared(container, end.near)
        pairs.append((part, container))
    (one, first), (two, second) = pairs
    for part, old, new in ((one, first, second), (two, second, first)):
        draft.not_inside(part, new)
        draft.unlink(end, old, part)
        draft.link(end, new, part)
    doc = f"Two containers exchange a `{child}` of `{end.reference}`."
    yield "swap", f"swap.{cls}.{end.name}", draft, doc, False
