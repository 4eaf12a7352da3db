"""Plans of new objects: which links one needs, and what may be at their other ends.

A plan starts with one new object. Each link that it needs, its container included, goes to another new object, to an
object that is there and has room, or to one that another object gives away. New objects need links of their own, so
plans grow until nothing is missing; the cheapest come first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from heapq import heappop, heappush
from itertools import chain, zip_longest
from typing import Final

from envgraph.code import dataclass
from envgraph.rewrite.derive._schema import End, Link, Schema

MOST_NEW: Final = 4
"""How many objects one operator creates."""

MOST_LINKS: Final = 12
"""How many links one operator creates."""

MOST_PLANS: Final = 400
"""How many plans, finished or not, are looked at for one class."""


@dataclass(frozen=True, slots=True)
class Plan:
    """New objects, numbered from 0, old ones, from -1 downwards, and links that are added and removed.

    Attributes:
        new: class of each new object. The first of a retyping is there already, with the links of its old class.
        kept: the ends at which the first object keeps what it has, in a retyping.
        old: class of each object that is there.
        links: those that are added are from new objects. One is removed between two old objects, a donor and what it
            gives to a new object; or both are linked to the new object instead.
    """

    new: tuple[str, ...]
    kept: tuple[End, ...] = ()
    old: tuple[str, ...] = ()
    links: tuple[Link[int], ...] = ()

    @property
    def added(self) -> list[Link[int]]:
        """The links that are added."""
        return [link for link in self.links if link.sign > 0]

    @property
    def removed(self) -> list[Link[int]]:
        """The links that are removed."""
        return [link for link in self.links if link.sign < 0]

    def given(self, node: int) -> list[Link[int]]:
        """The links that donors give to a new object."""
        return [link for link in self.removed if link.far in self.at(node, link.end)]

    @property
    def tops(self) -> list[int]:
        """The new objects that no other new object contains."""
        containers = map(self.container, range(len(self.new)))
        return [node for node, one in enumerate(containers) if one is None or one < 0]

    def at(self, node: int, end: End) -> list[int]:
        """Return what an object is linked to at an end by the plan."""
        found = [far for _, one, near, far in self.added if near == node and one == end]
        found += [near for _, one, near, far in self.added if far == node and one.other == end]
        return list(dict.fromkeys(found))

    def container(self, node: int) -> int | None:
        """What contains a new object, or None."""
        for _, end, near, far in self.added:
            if end.reference.containment and node == (far if end.contains else near):
                return near if end.contains else far
        return None

    def with_link(self, node: int, end: End, far: int, *donor: int) -> Plan:
        """The plan with one link more, to an object that perhaps is linked to a donor until then."""
        removed = [Link(-1, end, one, far) for one in donor]
        return replace(self, links=(*self.links, *removed, Link(1, end, node, far)))

    def with_new(self, cls: str) -> tuple[Plan, int]:
        """The plan with one more new object, and its number."""
        return replace(self, new=(*self.new, cls)), len(self.new)

    def with_old(self, cls: str) -> tuple[Plan, int]:
        """The plan with one more old object, and its number."""
        return replace(self, old=(*self.old, cls)), ~len(self.old)


def creation_plans(schema: Schema, cls: str, most: int) -> list[Plan]:
    """The cheapest plans for an object of a class; [] if nothing that may be touched gives it what it needs."""
    return cheapest_plans(schema, Plan((cls,)), most)


def cheapest_plans(schema: Schema, start: Plan, most: int) -> list[Plan]:
    """Plans that create little, and plans that need little that is there, in turns."""
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
    while queue and len(found) < most and len(seen) < MOST_PLANS:
        plan = heappop(queue)[-1]
        need = first_need(schema, plan)
        if need is None:
            found.append(plan)
            continue
        node, ends = need
        for larger in (larger for end in ends for larger in _choices(schema, plan, node, end)):
            shape = _shape(larger)
            if len(larger.new) <= MOST_NEW and len(larger.added) <= MOST_LINKS and shape not in seen:
                seen.add(shape)
                heappush(queue, (cost(larger), len(seen), larger))
    return found


def _shape(plan: Plan) -> object:
    """Return what plans have in common that differ in the order of their choices alone."""

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


# --- what is missing


def first_need(schema: Schema, plan: Plan) -> tuple[int, tuple[End, ...]] | None:
    """The first new object that lacks something, and the ends of which one has to get a link; () for hopeless."""
    for node, cls in enumerate(plan.new):
        kept = plan.kept if node == 0 else ()
        if not kept:
            container = _needed_container(schema, plan, node)
            if container is not None:
                return node, container
        # What it contains comes first: the other links may go there.
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


# --- what it may be linked to


def _choices(schema: Schema, plan: Plan, node: int, end: End) -> Iterator[Plan]:
    """The plan with one link more, in each way that there is."""
    if end.frozen:
        return
    yield from _to_new(schema, plan, node, end)
    if not end.contains:
        yield from _to_old(plan, node, end)
        yield from _stealing(schema, plan, node, end)
    if not end.contained:
        yield from _with_another(schema, plan, node, end)


def _room(plan: Plan, node: int, end: End) -> bool:
    """Return whether the plan leaves an object room at an end."""
    return end.upper is None or len(plan.at(node, end)) < end.upper


def _to_new(schema: Schema, plan: Plan, node: int, end: End) -> Iterator[Plan]:
    """To an object that the plan creates anyway, perhaps itself."""
    for far, cls in enumerate(plan.new):
        if not schema.is_a(cls, end.far) or far in plan.at(node, end):
            continue
        if far == 0 and end.other in plan.kept:
            continue  # how much room it has is not known
        if end.reference.containment and _around(plan, node, far, end):
            continue
        if _room(plan, far, end.other):
            yield plan.with_link(node, end, far)


def _around(plan: Plan, node: int, far: int, end: End) -> bool:
    """Return whether a new object cannot become the container of another: that one has one, or is around it."""
    part, container = (far, node) if end.contains else (node, far)
    above: int | None = container
    while above is not None and above != part:
        above = plan.container(above)
    return above == part or plan.container(part) is not None


def _to_old(plan: Plan, node: int, end: End) -> Iterator[Plan]:
    """To an object that has room; where room is scarce, also to one that another new object is linked to."""
    if not end.other.flexible:
        return  # all that there are have as many links as they may have
    larger, far = plan.with_old(end.far)
    yield larger.with_link(node, end, far)
    if end.other.upper is None:
        return
    busy = {one for _, _, *ends in plan.removed for one in ends}
    for far in dict.fromkeys(far for _, one, _, far in plan.added if far < 0 and one == end):
        if far not in busy and far not in plan.at(node, end) and _room(plan, far, end.other):
            yield plan.with_link(node, end, far)


def _stealing(schema: Schema, plan: Plan, node: int, end: End) -> Iterator[Plan]:
    """To an object that another one gives away; it may be linked to the new object instead, which comes between."""
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
    """To another new object: one that it contains, or one that cannot be there before it."""
    for cls in schema.metamodel.concrete(end.far):
        if not schema.frozen(cls) and (end.contains or schema.coupled(plan.new[node], cls)):
            larger, far = plan.with_new(cls)
            yield larger.with_link(node, end, far)
