"""Plans of new objects: a search for the links that new objects need, and for the objects at the other ends.

A plan starts with one new object. Each link that it needs, including the link to its container, leads to another new
object, to an existing object with room for it, or to an object that another one gives away. New objects need links
of their own, so plans grow until nothing is missing. The cheapest plans are found first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from heapq import heappop, heappush
from itertools import chain, zip_longest

from envgraph.code import dataclass
from envgraph.errors import LIMITS
from envgraph.rewrite.derive._reference_ends import LinkChange, ReferenceEnd, Schema


@dataclass(frozen=True, slots=True)
class CreationPlan:
    """A plan: new objects (numbers 0, 1, ..), existing objects (numbers -1, -2, ..), and links to add and to remove.

    Attributes:
        new: class of each new object. In a retyping, the first one exists already and has the links of its old class.
        kept_ends: in a retyping, the ends at which the first object keeps its links.
        old: class of each existing object.
        links: added links start at new objects. A removed link connects two existing objects: a donor, and the object
            that it gives to a new object. In another form, both of them are linked to the new object instead.
    """

    new: tuple[str, ...]
    kept_ends: tuple[ReferenceEnd, ...] = ()
    old: tuple[str, ...] = ()
    links: tuple[LinkChange[int], ...] = ()

    @property
    def added_links(self) -> list[LinkChange[int]]:
        """Return the links that are added."""
        return [link for link in self.links if link.sign > 0]

    @property
    def removed_links(self) -> list[LinkChange[int]]:
        """Return the links that are removed."""
        return [link for link in self.links if link.sign < 0]

    def donated_links(self, node: int) -> list[LinkChange[int]]:
        """Return the removed links whose far objects are linked to the new object `node` instead."""
        return [link for link in self.removed_links if link.far in self.linked_at(node, link.end)]

    @property
    def top_objects(self) -> list[int]:
        """Return the numbers of the new objects that no other new object contains."""
        containers = map(self.container_of, range(len(self.new)))
        return [node for node, one in enumerate(containers) if one is None or one < 0]

    def linked_at(self, node: int, end: ReferenceEnd) -> list[int]:
        """Return the numbers of the objects to which the plan links an object at a reference end."""
        found = [far for _, one, near, far in self.added_links if near == node and one == end]
        found += [near for _, one, near, far in self.added_links if far == node and one.opposite_end == end]
        return list(dict.fromkeys(found))

    def container_of(self, node: int) -> int | None:
        """Return the number of the object that the plan makes the container of a new object, or None."""
        for _, end, near, far in self.added_links:
            if end.reference.containment and node == (far if end.is_container else near):
                return near if end.is_container else far
        return None

    def with_link(self, node: int, end: ReferenceEnd, far: int, *donor: int) -> CreationPlan:
        """Return the plan with another added link. If a donor is given, its link to the object `far` is removed."""
        removed = [LinkChange(-1, end, one, far) for one in donor]
        return replace(self, links=(*self.links, *removed, LinkChange(1, end, node, far)))

    def with_old(self, cls: str) -> tuple[CreationPlan, int]:
        """Return the plan with another existing object, and the number of this object."""
        return replace(self, old=(*self.old, cls)), ~len(self.old)


def creation_plans(schema: Schema, cls: str, max_plans: int) -> list[CreationPlan]:
    """Return at most `max_plans` plans for creating an object of a class, cheapest first.

    The list is empty if the object needs frozen objects, or more objects or links than the limits of this module.
    """
    return cheapest_plans(schema, CreationPlan((cls,)), max_plans)


def cheapest_plans(schema: Schema, start: CreationPlan, max_plans: int) -> list[CreationPlan]:
    """Return at most `max_plans` complete plans, taken in turns from two searches by different costs.

    The first search minimises created objects, the second existing objects that are needed.
    """
    frugal = _cheapest(schema, start, max_plans, lambda plan: (len(plan.new), len(plan.removed_links), len(plan.old)))
    modest = _cheapest(schema, start, max_plans, lambda plan: (len(plan.old), len(plan.new)))
    found: dict[object, CreationPlan] = {}
    for plan in chain.from_iterable(zip_longest(frugal, modest)):
        if plan is not None:
            found.setdefault(_plan_key(plan), plan)
    return sorted(list(found.values())[:max_plans], key=lambda plan: (len(plan.new), len(plan.removed_links)))


def _cheapest(
    schema: Schema, start: CreationPlan, max_plans: int, cost: Callable[[CreationPlan], tuple[int, ...]]
) -> list[CreationPlan]:
    found: list[CreationPlan] = []
    seen: set[object] = set()
    queue: list[tuple[tuple[int, ...], int, CreationPlan]] = [((), 0, start)]
    while queue and len(found) < max_plans and len(seen) < LIMITS["creation plans"]:
        plan = heappop(queue)[-1]
        need = first_need(schema, plan)
        if need is None:
            found.append(plan)
            continue
        node, ends = need
        for larger in (larger for end in ends for larger in _extended_plans(schema, plan, node, end)):
            shape = _plan_key(larger)
            if (
                len(larger.new) <= LIMITS["new objects"]
                and len(larger.added_links) <= LIMITS["new links"]
                and shape not in seen
            ):
                seen.add(shape)
                heappush(queue, (cost(larger), len(seen), larger))
    return found


def _plan_key(plan: CreationPlan) -> object:
    """Return a key that is equal for plans that differ only in the order of their choices."""

    def role(end: ReferenceEnd, node: int) -> tuple[int, ...]:
        if node >= 0:
            return 0, node
        used = sum((one, far) == (end, node) for _, one, _, far in plan.added_links)
        donors = [near for _, _, near, far in plan.removed_links if node in (near, far)]
        given = sum(near in donors for _, _, near, _ in plan.removed_links)
        repaid = any(far in donors for *_, far in plan.added_links)
        return 1, used, given, repaid, node in donors

    links = [(near, end.reference.index, end.forward, role(end, far)) for _, end, near, far in plan.added_links]
    return plan.new, tuple(sorted(links))


# --- missing links


def first_need(schema: Schema, plan: CreationPlan) -> tuple[int, tuple[ReferenceEnd, ...]] | None:
    """Return the first new object that needs a link, and the ends of which one must get this link.

    Return None if the plan is complete, and no ends if the plan cannot be completed.
    """
    for node, cls in enumerate(plan.new):
        kept = plan.kept_ends if node == 0 else ()
        if not kept:
            container = _needed_container(schema, plan, node)
            if container is not None:
                return node, container
        # Contents first: the other links may lead to these objects.
        for end in sorted(schema.ends_of(cls), key=lambda end: not end.is_container):
            if not end.is_contained and end not in kept and len(plan.linked_at(node, end)) < end.lower:
                return node, (end,)
    return None


def _needed_container(schema: Schema, plan: CreationPlan, node: int) -> tuple[ReferenceEnd, ...] | None:
    containers = schema.containers(plan.new[node])
    demanded = tuple(end for end in containers if end.lower)
    if plan.container_of(node) is not None:
        return () if any(not plan.linked_at(node, end) for end in demanded) else None
    if demanded:
        return demanded
    return None if plan.new[node] in schema.roots else tuple(containers)


# --- possible ends of a link


def _extended_plans(schema: Schema, plan: CreationPlan, node: int, end: ReferenceEnd) -> Iterator[CreationPlan]:
    """Yield the plans with one more link of an object at a reference end, for each possible other object."""
    if end.is_frozen:
        return
    yield from _link_to_new(schema, plan, node, end)
    if not end.is_container:
        yield from _link_to_existing(plan, node, end)
        yield from _link_to_donated(schema, plan, node, end)
    for cls in () if end.is_contained else schema.metamodel.concrete_classes(end.far_class):
        if not schema.frozen(cls) and (end.is_container or schema.need_each_other(plan.new[node], cls)):
            yield replace(plan, new=(*plan.new, cls)).with_link(node, end, len(plan.new))


def _has_room(plan: CreationPlan, node: int, end: ReferenceEnd) -> bool:
    """Return True if an object may have another link at a reference end in the plan."""
    return end.upper is None or len(plan.linked_at(node, end)) < end.upper


def _link_to_new(schema: Schema, plan: CreationPlan, node: int, end: ReferenceEnd) -> Iterator[CreationPlan]:
    """Yield plans that link the object to an object that the plan already creates, perhaps itself."""
    for far, cls in enumerate(plan.new):
        if not schema.is_a(cls, end.far_class) or far in plan.linked_at(node, end):
            continue
        if far == 0 and end.opposite_end in plan.kept_ends:
            continue  # the number of its links is unknown
        if end.reference.containment and _cannot_contain(plan, node, far, end):
            continue
        if _has_room(plan, far, end.opposite_end):
            yield plan.with_link(node, end, far)


def _cannot_contain(plan: CreationPlan, node: int, far: int, end: ReferenceEnd) -> bool:
    """Return True if a new containment link is impossible: the part has a container already, or contains the other."""
    part, container = (far, node) if end.is_container else (node, far)
    above: int | None = container
    while above is not None and above != part:
        above = plan.container_of(above)
    return above == part or plan.container_of(part) is not None


def _link_to_existing(plan: CreationPlan, node: int, end: ReferenceEnd) -> Iterator[CreationPlan]:
    """Yield plans that link the object to an existing object that may get another link.

    If the number of links at the other end is limited, this may be an object that is linked to another new object.
    """
    if not end.opposite_end.is_flexible:
        return  # no existing object may have another link
    larger, far = plan.with_old(end.far_class)
    yield larger.with_link(node, end, far)
    if end.opposite_end.upper is None:
        return
    busy = {one for _, _, *ends in plan.removed_links for one in ends}
    for far in dict.fromkeys(far for _, one, _, far in plan.added_links if far < 0 and one == end):
        if far not in busy and far not in plan.linked_at(node, end) and _has_room(plan, far, end.opposite_end):
            yield plan.with_link(node, end, far)


def _link_to_donated(schema: Schema, plan: CreationPlan, node: int, end: ReferenceEnd) -> Iterator[CreationPlan]:
    """Yield plans that link the object to one that a donor gives away, or put the new object between the two."""
    if end.reference.containment:
        return
    larger, far = plan.with_old(end.far_class)
    spares = end.opposite_end.upper is not None and end.is_flexible
    given = [link.near for link in plan.donated_links(node) if link.end == end]
    for donor in dict.fromkeys(given) if spares else ():
        full = end.upper is not None and end.lower + given.count(donor) >= end.upper
        if not full and donor not in plan.linked_at(node, end.opposite_end):
            yield larger.with_link(node, end, far, donor)
    larger, donor = plan.with_old(end.near_class)
    larger, far = larger.with_old(end.far_class)
    larger = larger.with_link(node, end, far, donor)
    if spares:
        yield larger
    both = schema.is_a(plan.new[node], end.near_class) and schema.is_a(plan.new[node], end.far_class)
    if both and not (end.is_symmetric or plan.kept_ends) and _has_room(plan, node, end.opposite_end):
        yield larger.with_link(node, end.opposite_end, donor)
