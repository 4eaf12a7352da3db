"""Operators on links between objects that are there: add, remove, change, swap, and move between containers."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

from envgraph.metamodel import Reference
from envgraph.pattern import Move, Negation, Node, Variable
from envgraph.rewrite.derive._draft import Draft
from envgraph.rewrite.derive._schema import Association, End, Schema

Operator = tuple[str, str, Draft, str, bool]
"""Kind, name without the group, draft, doc, whether links of deleted objects go with them (SPO)."""


def link_operators(schema: Schema, group: str, cls: str) -> Iterator[Operator]:
    """The operators on the links of a class; those of a pair of opposites in one class only once."""
    for end in _own_ends(schema, cls):
        holder = schema.holder(
            cls, end.reference if end.forward else end.association.opposite or end.reference
        )
        yield from _add(Draft(schema, group), end, holder)
        yield from _remove(Draft(schema, group), end, holder)
        yield from _change_source(Draft(schema, group), end, holder)
        yield from _change_target(Draft(schema, group), end, holder)
        yield from _swap(Draft(schema, group), end, holder)
        yield from _loops(schema, group, end, holder)


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


# --- references


def _add(draft: Draft, end: End, holder: str) -> Iterator[Operator]:
    if not (end.flexible and end.other.flexible):
        return
    source, target = draft.node("source", holder), draft.node("target", end.far)
    draft.spared_ends(end, source, target)
    draft.absent(end, source, target)
    draft.ask(end.room(source))
    draft.ask(end.other.room(target))
    draft.link(end, source, target)
    yield "add", f"add.{holder}.{end.name}", draft, f"One more target of `{holder}.{end.name}`.", False


def _remove(draft: Draft, end: End, holder: str) -> Iterator[Operator]:
    if not (end.flexible and end.other.flexible):
        return
    source, target = draft.node("source", holder), draft.node("target", end.far)
    draft.edge(end, source, target)
    draft.spared_ends(end, source, target)
    draft.ask(end.spare(source))
    draft.ask(end.other.spare(target))
    draft.unlink(end, source, target)
    yield "remove", f"remove.{holder}.{end.name}", draft, f"One target less of `{holder}.{end.name}`.", False


def _change_source(draft: Draft, end: End, holder: str) -> Iterator[Operator]:
    if not end.flexible or end.association.symmetric:
        return
    source, target = draft.node("source", holder), draft.node("target", end.far)
    other = draft.node("other", holder)
    draft.edge(end, source, target)
    draft.differ(source, other)
    draft.spared_ends(end, source, target)
    draft.spared(other, holder)
    draft.absent(end, other, target)
    draft.ask(end.spare(source))
    draft.ask(end.room(other))
    draft.unlink(end, source, target)
    draft.link(end, other, target)
    doc = f"A target of `{holder}.{end.name}` goes over to another `{holder}`."
    yield "change", f"change.{holder}.{end.name}.source", draft, doc, False


def _change_target(draft: Draft, end: End, holder: str) -> Iterator[Operator]:
    if not end.other.flexible:
        return
    source, target = draft.node("source", holder), draft.node("target", end.far)
    other = draft.node("other", end.far)
    draft.edge(end, source, target)
    draft.differ(target, other)
    draft.spared_ends(end, source, target)
    if end.other.held:
        draft.spared(other, end.far)
    draft.absent(end, source, other)
    draft.ask(end.other.spare(target))
    draft.ask(end.other.room(other))
    draft.unlink(end, source, target)
    draft.link(end, source, other)
    doc = f"Another target of `{holder}.{end.name}` instead of one that is there."
    yield "change", f"change.{holder}.{end.name}.target", draft, doc, False


def _swap(draft: Draft, end: End, holder: str) -> Iterator[Operator]:
    ends = []
    for _ in range(2):
        source, target = draft.node("source", holder), draft.node("target", end.far)
        draft.edge(end, source, target)
        draft.spared_ends(end, source, target)
        ends.append((source, target))
    (one, first), (two, second) = ends
    for pair in combinations(draft.types, 2):
        # An end of a symmetric link to itself would have another number of links afterwards.
        if end.association.symmetric or pair in ((one, two), (first, second)):
            draft.differ(*pair)
    for source, old, new in ((one, first, second), (two, second, first)):
        draft.absent(end, source, new)
        draft.unlink(end, source, old)
        draft.link(end, source, new)
    doc = f"Two objects exchange a target of `{holder}.{end.name}`."
    yield "swap", f"swap.{holder}.{end.name}", draft, doc, False


def _loops(schema: Schema, group: str, end: End, holder: str) -> Iterator[Operator]:
    """Two objects of a symmetric reference are linked to each other, or each to itself: as many links."""
    if not end.association.symmetric:
        return
    for word, joined in (("joining", True), ("parting", False)):
        draft = Draft(schema, group)
        one, two = draft.node("source", holder), draft.node("target", end.far)
        draft.differ(one, two)
        draft.spared_ends(end, one, two)
        apart, together = [(one, one), (two, two)], [(one, two)]
        before, after = (apart, together) if joined else (together, apart)
        for near, far in before:
            draft.edge(end, near, far)
            draft.unlink(end, near, far)
        for near, far in after:
            draft.absent(end, near, far)
            draft.link(end, near, far)
        doc = f"Two objects are linked {'to each other' if joined else 'each to itself'} by `{holder}.{end.name}`."
        yield "swap", f"swap.{holder}.{end.name}.{word}", draft, doc, False


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
    for frozen in draft.schema.frozen_below(before.far):
        name = draft.name("frozen")
        draft.block("not", [Node(name, frozen)], [before.edge(part, name)])
    if before.other.lower:
        needy = draft.short(before, part)
        if not same:
            draft.may_be(needy, container)


def _exchange(draft: Draft, end: End, cls: str, child: str) -> Iterator[Operator]:
    pairs = []
    for _ in range(2):
        part, container = draft.node("part", child), draft.node("container", end.near)
        draft.edge(end, container, part)
        draft.spared(part, child)
        draft.spared(container, end.near)
        pairs.append((part, container))
    (one, first), (two, second) = pairs
    draft.differ(one, two)
    draft.differ(first, second)
    for part, old, new in ((one, first, second), (two, second, first)):
        draft.not_inside(part, new)
        draft.unlink(end, old, part)
        draft.link(end, new, part)
    doc = f"Two containers exchange a `{child}` of `{end.reference}`."
    yield "swap", f"swap.{cls}.{end.name}", draft, doc, False
