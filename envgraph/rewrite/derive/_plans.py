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
from envgraph.rewrite.derive._schema import End, Link, Schema


@dataclass(frozen=True, slots=True)
class Plan:
    """A plan: new objects (numbers 0, 1, ..), existing objects (numbers -1, -2, ..), and links to add and to remove.

    Attributes:
        new: class of each new object. In a retyping, the first one exists already and has the links of its old class.
        kept: in a retyping, the ends at which the first object keeps its links.
        old: class of each existing object.
        links: added links start at new objects. A removed link connects two existing objects: a donor, and the object
            that it gives to a new object. In another form, both of them are linked to the new object instead.
    """

    new: tuple[str, ...]
    kept: tuple[End, ...] = ()
    old: tuple[str, ...] = ()
    links: tuple[Link[int], ...] = ()

    @property
    def added(self) -> list[Link[int]]:
        """Return the links that are added."""
        return [link for link in self.links if link.sign > 0]

    @property
    def removed(self) -> list[Link[int]]:
        """Return the links that are removed."""
        return [link for link in self.links if link.sign < 0]

    def given(self, node: int) -> list[Link[int]]:
        """Return the removed links whose far objects are linked to the new object `node` instead."""
        return [link for link in self.removed if link.far in self.at(node, link.end)]

    @property
    def tops(self) -> list[int]:
        """Return the numbers of the new objects that no other new object contains."""
        containers = map(self.container, range(len(self.new)))
        return [node for node, one in enumerate(containers) if one is None or one < 0]

    def at(self, node: int, end: End) -> list[int]:
        """Return the numbers of the objects to which the plan links an object at a reference end."""
        found = [far for _, one, near, far in self.added if near == node and one == end]
        found += [near for _, one, near, far in self.added if far == node and one.other == end]
        return list(dict.fromkeys(found))

    def container(self, node: int) -> int | None:
        """Return the number of the object that the plan makes the container of a new object, or None."""
        for _, end, near, far in self.added:
            if end.reference.containment and node == (far if end.contains else near):
                return near if end.contains else far
        return None

    def with_link(self, node: int, end: End, far: int, *donor: int) -> Plan:
        """Return the plan with another added link. If a donor is given, its link to the object `far` is removed."""
        removed = [Link(-1, end, one, far) for one in donor]
        return replace(self, links=(*self.links, *removed, Link(1, end, node, far)))

    def with_new(self, cls: str) -> tuple[Plan, int]:
        """Return the plan with another new object, and the number of this object."""
        return replace(self, new=(*self.new, cls)), len(self.new)

    def with_old(self, cls: str) -> tuple[Plan, int]:
        """Return the plan with another existing object, and the number of this object."""
        return replace(self, old=(*self.old, cls)), ~len(self.old)


def creation_plans(schema: Schema, cls: str, most: int) -> list[Plan]:
    """Return at most `most` plans for creating an object of a class, cheapest first.

    The list is empty if the object needs frozen objects, or more objects or links than the limits of this module.
    """
    return cheapest_plans(schema, Plan((cls,)), most)


def cheapest_plans(schema: Schema, start: Plan, most: int) -> list[Plan]:
    """Return at most `most` complete plans, taken in turns from two searches by different costs.

    The first search minimises created objects, the second existing objects that are needed.
    """
    frugal = _cheapest(schema, start, most, lambda plan: (len(plan.new), len(plan.removed), len(plan.old)))
    modest = _cheapest(schema, start, most, lambda plan: (len(plan.old), len(plan.new)))
    found: dict[object, Plan] = {}
    for plan in chain.from_iterable(zip_longest(frugal, modest)):
        if plan is not None:
            found.setdefault(_shape(plan), plan)
    return sorted(list(found.values())[:most], key=lambda plan: (len(plan.new), len(plan.removed)))


def _cheapest(schema: Schema, start: Plan, most: int, cost: Callable[[Plan], tuple[int, ...]]) -> list[Plan]:
    found: list[Plan] = []
    seen: set[object] = set()
    queue: list[tuple[tuple[int, ...], int, Plan]] = [((), 0, start)]
    while queue and len(found) < most and len(seen) < LIMITS["creation plans"]:
        plan = heappop(queue)[-1]
        need = first_need(schema, plan)
        if need is None:
            found.append(plan)
            continue
        node, ends = need
        for larger in (larger for end in ends for larger in _choices(schema, plan, node, end)):
            shape = _shape(larger)
            if (
                len(larger.new) <= LIMITS["new objects"]
                and len(larger.added) <= LIMITS["new links"]
                and shape not in seen
            ):
                seen.add(shape)
                heappush(queue, (cost(larger), len(seen), larger))
    return found


def _shape(plan: Plan) -> object:
    """Return a key that is equal for plans that differ only in the order of their choices."""

    def role(end: End, node: int) -> tuple[int, ...]:
        if node >= 0:
            return 0, node
        used = sum((one, far) == (end, node) for _, one, _, far in plan.added)
        donors = [near for _, _, near, far in plan.removed if node in (near, far)]
        given = sum(near in donors for _, _, near, _ in plan.removed)
        repaid = any(far in donors for *_, far in plan.added)
        return 1, used, given, repaid, node in donors

    links = [(near, end.reference.index, end.forward, role(end, far)) for _, end, near, far in plan.added]
    return plan.new, tuple(sorted(links))


# --- missing links


def first_need(schema: Schema, plan: Plan) -> tuple[int, tuple[End, ...]] | None:
    """Return the first new object that needs a link, and the ends of which one must get this link.

    Return None if the plan is complete, and no ends if the plan cannot be completed.
    """
    for node, cls in enumerate(plan.new):
        kept = plan.kept if node == 0 else ()
        if not kept:
            container = _needed_container(schema, plan, node)
            if container is not None:
                return node, container
        # Contents first: the other links may lead to these objects.
        for end in sorted(schema.ends_of(cls), key=lambda end: not end.contains):
            if not end.contained and end not in kept and len(plan.at(node, end)) < end.lower:
                return node, (end,)
    return None


def _needed_container(schema: Schema, plan: Plan, node: int) -> tuple[End, ...] | None:
    containers = schema.containers(plan.new[node])
    demanded = tuple(end for end in containers if end.lower)
    if plan.container(node) is not None:
        return () if any(not plan.at(node, end) for end in demanded) else None
    if demanded:
        return demanded
    return None if plan.new[node] in schema.roots else tuple(containers)


# --- possible ends of a link


def _choices(schema: Schema, plan: Plan, node: int, end: End) -> Iterator[Plan]:
    """Yield the plans with one more link of an object at a reference end, for each possible other object."""
    if end.frozen:
        return
    yield from _to_new(schema, plan, node, end)
    if not end.contains:
        yield from _to_old(plan, node, end)
        yield from _stealing(schema, plan, node, end)
    if not end.contained:
        yield from _with_another(schema, plan, node, end)


def _room(plan: Plan, node: int, end: End) -> bool:
    """Return True if an object may have another link at a reference end in the plan."""
    return end.upper is None or len(plan.at(node, end)) < end.upper


def _to_new(schema: Schema, plan: Plan, node: int, end: End) -> Iterator[Plan]:
    """Yield plans that link the object to an object that the plan already creates, perhaps itself."""
    for far, cls in enumerate(plan.new):
        if not schema.is_a(cls, end.far) or far in plan.at(node, end):
            continue
        if far == 0 and end.other in plan.kept:
            continue  # the number of its links is unknown
        if end.reference.containment and _around(plan, node, far, end):
            continue
        if _room(plan, far, end.other):
            yield plan.with_link(node, end, far)


def _around(plan: Plan, node: int, far: int, end: End) -> bool:
    """Return True if a new containment link is impossible: the part has a container already, or contains the other."""
    part, container = (far, node) if end.contains else (node, far)
    above: int | None = container
    while above is not None and above != part:
        above = plan.container(above)
    return above == part or plan.container(part) is not None


def _to_old(plan: Plan, node: int, end: End) -> Iterator[Plan]:
    """Yield plans that link the object to an existing object that may get another link.

    If the number of links at the other end is limited, this may be an object that is linked to another new object.
    """
    if not end.other.flexible:
        return  # no existing object may have another link
    larger, far = plan.with_old(end.far)
    yield larger.with_link(node, end, far)
    if end.other.upper is None:
        return
    busy = {one for _, _, *ends in plan.removed for one in ends}
    for far in dict.fromkeys(far for _, one, _, far in plan.added if far < 0 and one == end):
        if far not in busy and far not in plan.at(node, end) and _room(plan, far, end.other):
            yield plan.with_link(node, end, far)


def _stealing(schema: Schema, plan: Plan, node: int, end: End) -> Iterator[Plan]:
    """Yield plans that link the object to one that a donor gives away, or put the new object between the two."""
    if end.reference.containment:
        return
    larger, far = plan.with_old(end.far)
    spares = end.other.upper is not None and end.flexible
    given = [link.near for link in plan.given(node) if link.end == end]
    for donor in dict.fromkeys(given) if spares else ():
        full = end.upper is not None and end.lower + given.count(donor) >= end.upper
        if not full and donor not in plan.at(node, end.other):
            yield larger.with_link(node, end, far, donor)
    larger, donor = plan.with_old(end.near)
    larger, far = larger.with_old(end.far)
    larger = larger.with_link(node, end, far, donor)
    if spares:
        yield larger
    both = schema.is_a(plan.new[node], end.near) and schema.is_a(plan.new[node], end.far)
    if both and not (end.symmetric or plan.kept) and _room(plan, node, end.other):
        yield larger.with_link(node, end.other, donor)


def _with_another(schema: Schema, plan: Plan, node: int, end: End) -> Iterator[Plan]:
    """Yield plans that create another object and link to it: one that this object contains, or both need each other."""
    for cls in schema.metamodel.concrete(end.far):
        if not schema.frozen(cls) and (end.contains or schema.coupled(plan.new[node], cls)):
            larger, far = plan.with_new(cls)
            yield larger.with_link(node, end, far)
