"""Code of a rule for links: assignments to the cells that keep them."""

from __future__ import annotations

from envgraph import code
from envgraph.env.compiled._blocks import Frame
from envgraph.env.compiled._connections import LinkCell
from envgraph.env.compiled._layout import NOBODY, ZERO, call
from envgraph.env.compiled._refused import NotCompiled
from envgraph.env.compiled._site import Site
from envgraph.env.compiled._tables import LinkColumn
from envgraph.metamodel import Reference
from envgraph.pattern import ObjectType
from envgraph.rewrite.plans import Link, Rehome, SetTargets, Unlink


class Links:
    """Writes changes of links.

    Args:
        site: the match that they are made for.
    """

    def __init__(self, site: Site) -> None:
        self._site = site
        self._facts = site.facts

    def _cell(self, source: int, reference: Reference, target: int) -> LinkCell:
        """The cell that keeps a link between the objects in two slots."""
        slots, sure = self._site.slots, self._site.sure
        certain = sure(source, reference.owner), sure(target, reference.target)
        return self._facts.links.cell(reference, slots[source], slots[target], sure=certain)

    def linked(self, source: int, reference: Reference, target: int) -> code.Expression:
        if self._facts.changes.fixed_feature(reference):
            raise AssertionError(reference)
        return code.joined("and", self._cell(source, reference, target).tests, True)

    def unlink(self, unlink: Unlink) -> None:
        kept = self._cell(unlink.source, unlink.reference, unlink.target)
        test = self.linked(unlink.source, unlink.reference, unlink.target)
        self._site.add(code.If(test, (code.Assign(kept.place, kept.unlinked),)))

    def leave_containers(self, move: Rehome) -> None:
        """An object leaves its container, unless that is where it is to go."""
        cls = self._site.frame.classes.get(move.node)
        assert cls is not None
        metamodel, node = self._facts.metamodel, self._site.slots[move.node]
        for reference in metamodel.references:
            if not (reference.containment and metamodel.overlap(cls, reference.target)):
                continue
            stays = None
            if reference == move.reference:
                stays = code.Operation(
                    "!=", (self._held_cell(reference, node, cls), self._site.slots[move.container])
                )
            self._let_go(reference, node, cls, stays)

    def _held_cell(self, reference: Reference, node: code.Expression, cls: str) -> code.Expression:
        """Code for the container of an object by a reference."""
        sure = self._facts.metamodel.is_a(cls, reference.target)
        found = self._facts.links.other_end(reference, node, forward=False, sure=sure)
        assert found is not None
        return found

    def _let_go(
        self, reference: Reference, node: code.Expression, cls: str, test: code.Expression | None
    ) -> None:
        """The container of an object by a reference is no more, if a test holds."""
        stored, same = self._facts.links.column(reference)
        if stored.at_source is same:
            holder = self._facts.local(ObjectType(""))
            self._site.add(code.Assign(holder, self._held_cell(reference, node, cls)))
            place, _ = self._facts.links.near(stored, holder, sure=True)
            there: list[code.Expression] = [code.Operation(">=", (holder, ZERO))]
        else:
            sure = self._facts.metamodel.is_a(cls, reference.target)
            place, there = self._facts.links.near(stored, node, sure=sure)
        tests = [*there, *([] if test is None else [test])]
        cleared = code.Assign(place, NOBODY)
        self._site.add(code.If(code.joined("and", tests, True), (cleared,)) if tests else cleared)

    def link(self, link: Link | Rehome) -> None:
        """Adds a link, unless it is there; both ends need room."""
        if isinstance(link, Rehome):
            source, reference, target = link.container, link.reference, link.node
        else:
            source, reference, target = link.source, link.reference, link.target
        opposite = self._facts.metamodel.opposite(reference)
        content = None
        if reference.containment:
            content, end = target, reference.target
        elif opposite is not None and opposite.containment:
            content, end = source, reference.owner

        def write() -> None:
            if content is not None:
                self._check_contents(content, end)
                self._check_homeless(content, end, reference)
            self._check_room(reference, self._site.slots[source], source, forward=True)
            self._check_room(reference, self._site.slots[target], target, forward=False)
            kept = self._cell(source, reference, target)
            for test in kept.guard:
                self._site.unless(test)
            self._site.add(code.Assign(kept.place, kept.linked))

        made = self._site.collected(write)
        there = code.Operation(">=", (self._site.slots[target], ZERO))
        missing_ = code.inverse(self.linked(source, reference, target))
        test = code.Operation("and", (there, missing_)) if target in self._site.types else missing_
        self._site.add(code.If(test, made))

    def _check_contents(self, content: int, cls: str) -> None:
        """An object that enters a container contains nothing that it could enter."""
        if content in self._site.frame.new:
            self._check_new_contents(content)
            return
        metamodel = self._facts.metamodel
        for one in metamodel.concrete(cls):
            for feature in metamodel.features(one).values():
                if isinstance(feature, Reference) and feature.containment:
                    raise NotCompiled(f"containers that a rule moves (`{one}`)", self._site.body.span)

    def _check_homeless(self, content: int, cls: str, entered: Reference) -> None:
        """The rule is refused where an object is in another container, by another reference than the one it enters."""
        new = self._site.frame.new.get(content), content
        if new[0] is self._site.frame and [inside for inside, _ in self._housed()].count(new) == 1:
            return
        metamodel, cls = self._facts.metamodel, self._site.frame.classes.get(content) or cls
        for reference in metamodel.references:
            if (
                reference.containment
                and reference not in (entered, metamodel.opposite(entered))
                and metamodel.overlap(cls, reference.target)
            ):
                held = self._held_cell(reference, self._site.slots[content], cls)
                self._site.unless(code.Operation("<", (held, ZERO)))

    def _check_new_contents(self, content: int) -> None:
        """What contains a new object is not inside of it, as far as the rule puts it together."""
        first: tuple[Frame | None, int] = self._site.frame.new[content], content
        above = [first]
        for one in above:  # grows meanwhile
            above += [other for inside, other in self._housed() if inside == one and other not in above]
            if (one, first) in self._housed():
                raise NotCompiled("objects that contain each other", self._site.body.span)

    def _housed(self) -> list[tuple[tuple[Frame | None, int], tuple[Frame | None, int]]]:
        """What gets a container, and that: slots with what creates their objects."""
        found: list[tuple[tuple[Frame | None, int], tuple[Frame | None, int]]] = []
        for frame in self._site.blocks.frames:
            pairs = [(move.node, move.container) for move in frame.plan.moves]
            for link in frame.plan.links:
                opposite = self._facts.metamodel.opposite(link.reference)
                if link.reference.containment:
                    pairs.append((link.target, link.source))
                elif opposite is not None and opposite.containment:
                    pairs.append((link.source, link.target))
            found += [
                ((frame.new.get(inside), inside), (frame.new.get(outside), outside))
                for inside, outside in pairs
                if inside in frame.new
            ]
        return found

    def _check_room(self, reference: Reference, node: code.Expression, slot: int, *, forward: bool) -> None:
        """The rule is refused unless an object may have one more target, or one more source."""
        opposite = self._facts.metamodel.opposite(reference)
        upper = reference.upper
        if not forward:
            upper = 1 if reference.containment else None if opposite is None else opposite.upper
        if upper is None:
            return
        sure = self._site.sure(slot, reference.owner if forward else reference.target)
        one = self._facts.links.other_end(reference, node, forward=forward, sure=sure) if upper == 1 else None
        if one is not None:
            self._site.unless(code.Operation("<", (one, ZERO)))
        else:
            counted = call(self._facts.links.counter(reference, forward), node)
            self._site.unless(code.Operation("<", (counted, code.Constant(upper))))

    def set_target(self, change: SetTargets) -> None:
        """The one target of an object; where the opposite of a single one is taken, its holder lets go."""
        site, links, reference = self._site, self._facts.links, change.reference
        stored, same = links.column(reference)
        source = site.slots[change.object]
        target = site.slots[change.values[0]] if change.values else NOBODY
        old: code.Expression
        if stored.at_source is same:
            old, guard = links.near(stored, source, sure=site.sure(change.object, reference.owner))

            def write() -> None:
                for test in guard:
                    site.unless(test)
                self._make_room(stored, reference, target)
                site.add(code.Assign(old, target))  # type: ignore[arg-type]
        else:
            found = links.other_end(reference, source, forward=True, sure=False)
            assert found is not None
            old = self._facts.local(ObjectType(""))
            site.add(code.Assign(old, found))

            def write() -> None:
                self._hold(stored, old, NOBODY)
                self._hold(stored, target, source)

        site.add(code.If(code.Operation("!=", (old, target)), site.collected(write)))

    def _hold(self, stored: LinkColumn, holder: code.Expression, other: code.Expression) -> None:
        """The cell of an object, if there is that object, has another."""
        place, _ = self._facts.links.near(stored, holder, sure=True)
        there = code.Operation(">=", (holder, ZERO))
        self._site.add(code.If(there, (code.Assign(place, other),)))

    def _make_room(self, stored: LinkColumn, reference: Reference, target: code.Expression) -> None:
        """A target that has as many sources as it may have loses its only one, or else the rule is refused."""
        links, opposite = self._facts.links, self._facts.metamodel.opposite(reference)
        there = code.Operation(">=", (target, ZERO))
        if opposite is not None and opposite.upper == 1:
            holder = self._facts.local(ObjectType(""))
            held = links.other_end(reference, target, forward=False, sure=False)
            assert held is not None
            self._site.add(code.Assign(holder, code.Choice(there, held, NOBODY)))
            self._hold(stored, holder, NOBODY)
        elif opposite is not None and opposite.upper is not None:
            counted = call(links.counter(reference, forward=False), target)
            few = code.Operation("<", (counted, code.Constant(opposite.upper)))
            self._site.unless(code.Operation("or", (code.inverse(there), few)))
