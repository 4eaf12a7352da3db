"""Plans of new objects: which links one needs, and what may be at their other ends.

A plan starts with one new object. Each link that it needs, its container included, goes to another new object, to an
object that is there and has room, or to one that another object gives away. New objects need links of their own, so
plans grow until nothing is missing; the cheapest come first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from heapq import heappop, heappush
from itertools import zip_longest
from typing import Final

from envgraph.code import dataclass
from envgraph.rewrite.derive._schema import End, Schema

MOST_NEW: Final = 4
"""How many objects one operator creates."""

MOST_LINKS: Final = 12
"""How many links one operator creates."""

MOST_PLANS: Final = 400
"""How many plans, finished or not, are looked at for one class."""


@dataclass(frozen=True, slots=True)
class Old:
    """An object that is there.

    Attributes:
        stolen_from: position of the object that gives it away, or None.
        repaid: it gives something away and is linked to the new object instead.
    """

    cls: str
    stolen_from: int | None = None
    repaid: bool = False


@dataclass(frozen=True, slots=True)
class PlannedLink:
    """A link from a new object; its other end is new, too (`far_new`), or an old one."""

    end: End
    near: int
    far: int
    far_new: bool


@dataclass(frozen=True, slots=True)
class Plan:
    """New objects, old ones, and the links to make.

    Attributes:
        new: class of each new object. The first of a retyping is there already, with the links of its old class.
        kept: the ends at which the first object keeps what it has, in a retyping.
        links: from new objects.
    """

    new: tuple[str, ...]
    kept: tuple[End, ...] = ()
    old: tuple[Old, ...] = ()
    links: tuple[PlannedLink, ...] = ()

    @property
    def steals(self) -> int:
        """How many links are taken from others."""
        return sum(old.stolen_from is not None for old in self.old)

    def ends(self, node: int, end: End) -> list[tuple[bool, int]]:
        """Return what a new object is linked to at an end: (is it new, position)."""
        here = (end, end.other) if end.association.symmetric else (end,)
        there = here if end.association.symmetric else (end.other,)
        found = [(k.far_new, k.far) for k in self.links if k.near == node and k.end in here]
        found += [(True, k.near) for k in self.links if k.far_new and k.far == node and k.end in there]
        return list(dict.fromkeys(found))

    def inside(self, node: int) -> int | None:
        """The new object that contains a new object, or None."""
        for link in self.links:
            if link.far_new and link.end.contains and link.far == node:
                return link.near
            if link.far_new and link.end.contained and link.near == node:
                return link.far
        return None

    def placed(self, node: int) -> bool:
        """Return whether a new object has a container."""
        return self.inside(node) is not None or any(k.near == node and k.end.contained for k in self.links)

    @property
    def tops(self) -> list[int]:
        """The new objects that no other new object contains."""
        return [node for node in range(len(self.new)) if self.inside(node) is None]


def creation_plans(schema: Schema, cls: str, most: int) -> list[Plan]:
    """The cheapest plans for an object of a class; [] if nothing that may be touched gives it what it needs."""
    return _some(schema, Plan((cls,)), most)


def retyping_plans(schema: Schema, before: str, after: str, most: int) -> list[Plan]:
    """Plans for what an object of another class needs in addition."""
    kept = [end for end in schema.ends_of(after) if schema.is_a(before, end.near)]
    kept += [end for end in schema.containers(after) if end not in kept]
    return _some(schema, Plan((after,), tuple(kept)), most)


def _some(schema: Schema, start: Plan, most: int) -> list[Plan]:
    """Plans that create little, and plans that need little that is there, in turns."""
    frugal = _cheapest(schema, start, most, lambda plan: (len(plan.new), plan.steals, len(plan.old)))
    modest = _cheapest(schema, start, most, lambda plan: (len(plan.old), len(plan.new)))
    found: dict[object, Plan] = {}
    for pair in zip_longest(frugal, modest):
        for plan in pair:
            if plan is not None and len(found) < most:
                found.setdefault(_shape(plan), plan)
    return sorted(found.values(), key=lambda plan: (len(plan.new), plan.steals))


def _cheapest(schema: Schema, start: Plan, most: int, cost: Callable[[Plan], tuple[int, ...]]) -> list[Plan]:
    found: list[Plan] = []
    seen: set[object] = set()
    queue: list[tuple[tuple[int, ...], int, Plan]] = [((), 0, start)]
    count = 0
    while queue and len(found) < most and count < MOST_PLANS:
        _, _, plan = heappop(queue)
        need = _need(schema, plan)
        if need is None:
            found.append(plan)
            continue
        node, ends = need
        for larger in (larger for end in ends for larger in _choices(schema, plan, node, end)):
            shape = _shape(larger)
            if len(larger.new) <= MOST_NEW and len(larger.links) <= MOST_LINKS and shape not in seen:
                seen.add(shape)
                count += 1
                heappush(queue, (cost(larger), count, larger))
    return found


def _shape(plan: Plan) -> object:
    """Return what plans have in common that differ in the order of their choices alone."""

    def far(link: PlannedLink) -> tuple[int, ...]:
        if link.far_new:
            return 0, link.far
        donor = plan.old[link.far].stolen_from
        given = -1 if donor is None else sum(old.stolen_from == donor for old in plan.old)
        repaid = plan.old[link.far].repaid or (donor is not None and plan.old[donor].repaid)
        return 1, given, repaid, uses(plan, link.end, link.far)

    def near(link: PlannedLink) -> tuple[int, int, bool]:
        return link.near, link.end.reference.index, link.end.forward

    return plan.new, tuple(sorted((*near(link), far(link)) for link in plan.links))


def _need(schema: Schema, plan: Plan) -> tuple[int, tuple[End, ...]] | None:
    """The first new object that lacks something, and the ends of which one has to get a link; () for hopeless."""
    for node, cls in enumerate(plan.new):
        kept = plan.kept if node == 0 else ()
        if not kept:
            container = _needed_container(schema, plan, node)
            if container is not None:
                return node, container
        # What it contains comes first: the other links may go there.
        for end in sorted(schema.ends_of(cls), key=lambda end: not end.contains):
            if not end.contained and end not in kept and len(plan.ends(node, end)) < end.lower:
                return node, (end,)
    return None


def _needed_container(schema: Schema, plan: Plan, node: int) -> tuple[End, ...] | None:
    containers = schema.containers(plan.new[node])
    demanded = tuple(end for end in containers if end.lower)
    if plan.placed(node):
        return () if any(not plan.ends(node, end) for end in demanded) else None
    if demanded:
        return demanded
    return None if plan.new[node] in schema.roots else tuple(containers)


def _choices(schema: Schema, plan: Plan, node: int, end: End) -> Iterator[Plan]:
    """The plan with one link more, in each way that there is."""
    if end.association.frozen:
        return
    yield from _to_new(schema, plan, node, end)
    if not end.contains:
        yield from _to_old(plan, node, end)
        yield from _stealing(plan, node, end)
        yield from _between(schema, plan, node, end)
    yield from _with_another(schema, plan, node, end)


def _linked(plan: Plan, node: int, end: End, far: int, *, far_new: bool) -> Plan:
    return replace(plan, links=(*plan.links, PlannedLink(end, node, far, far_new)))


def _to_new(schema: Schema, plan: Plan, node: int, end: End) -> Iterator[Plan]:
    """To an object that the plan creates anyway, perhaps itself."""
    for far, cls in enumerate(plan.new):
        if not schema.is_a(cls, end.far) or (True, far) in plan.ends(node, end):
            continue
        if far == 0 and (end.other in plan.kept or (end.association.symmetric and end in plan.kept)):
            continue  # how much room it has is not known
        if end.association.reference.containment and (far == node or _contained(plan, node, far, end)):
            continue
        upper = end.other.upper
        if upper is None or len(plan.ends(far, end.other)) < upper:
            yield _linked(plan, node, end, far, far_new=True)


def _contained(plan: Plan, node: int, far: int, end: End) -> bool:
    """Return whether a new object cannot become the container of another: that one has one, or is around it."""
    part, container = (far, node) if end.contains else (node, far)
    if plan.placed(part):
        return True
    above: int | None = container
    while above is not None and above != part:
        above = plan.inside(above)
    return above == part


def _to_old(plan: Plan, node: int, end: End) -> Iterator[Plan]:
    """To an object that has room; where room is scarce, also to one that another new object is linked to."""
    if not end.other.flexible:
        return  # all that there are have as many links as they may have
    position = len(plan.old)
    yield _linked(replace(plan, old=(*plan.old, Old(end.far))), node, end, position, far_new=False)
    if end.other.upper is None:
        return
    taken = [far for far_new, far in plan.ends(node, end) if not far_new]
    shared = {
        link.far: None
        for link in plan.links
        if not link.far_new and link.end == end and link.far not in taken
        if plan.old[link.far].stolen_from is None and not plan.old[link.far].repaid
    }
    for far in shared:
        if uses(plan, end, far) < end.other.upper:
            yield _linked(plan, node, end, far, far_new=False)


def uses(plan: Plan, end: End, old: int) -> int:
    """Return how many new links of an association an old object gets."""
    return sum(not link.far_new and link.far == old and link.end == end for link in plan.links)


def _stealing(plan: Plan, node: int, end: End) -> Iterator[Plan]:
    """To an object that another one gives away."""
    if end.other.upper is None or not end.flexible or end.contained:
        return
    donors = {
        plan.old[link.far].stolen_from: None
        for link in plan.links
        if link.near == node and link.end == end and not link.far_new
        if plan.old[link.far].stolen_from is not None
    }
    donors = {donor: None for donor in donors if donor is not None and not plan.old[donor].repaid}
    for donor in donors:
        given = sum(old.stolen_from == donor for old in plan.old)
        if end.upper is None or end.lower + given + 1 <= end.upper:
            old = (*plan.old, Old(end.far, donor))
            yield _linked(replace(plan, old=old), node, end, len(plan.old), far_new=False)
    old = (*plan.old, Old(end.near), Old(end.far, len(plan.old)))
    yield _linked(replace(plan, old=old), node, end, len(plan.old) + 1, far_new=False)


def _between(schema: Schema, plan: Plan, node: int, end: End) -> Iterator[Plan]:
    """Into a link between two others, which then are both linked to the new object."""
    both = schema.is_a(plan.new[node], end.near) and schema.is_a(plan.new[node], end.far)
    if not both or end.association.symmetric or end.association.reference.containment or plan.kept:
        return
    upper = end.other.upper
    if upper is not None and len(plan.ends(node, end.other)) >= upper:
        return
    position = len(plan.old)
    old = (*plan.old, Old(end.near, repaid=True), Old(end.far, position))
    taken = _linked(replace(plan, old=old), node, end, position + 1, far_new=False)
    yield _linked(taken, node, end.other, position, far_new=False)


def _with_another(schema: Schema, plan: Plan, node: int, end: End) -> Iterator[Plan]:
    """To another new object: one that it contains, or one that cannot be there before it."""
    if end.contained:
        return
    for cls in schema.metamodel.concrete(end.far):
        if schema.frozen(cls) or not (end.contains or schema.coupled(plan.new[node], cls)):
            continue
        larger = replace(plan, new=(*plan.new, cls))
        yield _linked(larger, node, end, len(plan.new), far_new=True)
