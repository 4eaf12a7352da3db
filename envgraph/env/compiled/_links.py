"""Emit the changes of links that a rule makes, as assignments to the cells that store links."""

from __future__ import annotations

from envgraph import code
from envgraph.env.compiled._blocks import Frame
from envgraph.env.compiled._connections import LinkCell
from envgraph.env.compiled._containers import inside
from envgraph.env.compiled._layout import NOBODY, ZERO, call
from envgraph.env.compiled._site import Site
from envgraph.env.compiled._tables import LinkColumn
from envgraph.metamodel import Reference
from envgraph.pattern import ObjectType
from envgraph.rewrite.plans import ChangeTargets, Link, Rehome, SetTargets, Unlink


class Links:
    """An emitter of changes of links.

    Args:
        site: the match that changes are made for.
    """

    def __init__(self, site: Site) -> None:
        self._site = site
        self._facts = site.facts

    def _cells(self, source: int, reference: Reference, target: int) -> list[LinkCell]:
        """Return the cells that store a link between the objects in two slots: two for a symmetric reference."""
        slots, sure = self._site.slots, self._site.sure
        ends = (
            [(source, target), (target, source)]
            if self._facts.links.symmetric(reference)
            else [(source, target)]
        )
        return [
            self._facts.links.cell(
                reference,
                slots[one],
                slots[other],
                sure=(sure(one, reference.owner), sure(other, reference.target)),
            )
            for one, other in ends
        ]

    def linked(self, source: int, reference: Reference, target: int) -> code.Expression:
        if self._facts.changes.fixed_feature(reference):
            raise AssertionError(reference)
        return code.joined("and", self._cells(source, reference, target)[0].tests, True)

    def unlink(self, unlink: Unlink) -> None:
        cells = self._cells(unlink.source, unlink.reference, unlink.target)
        test = self.linked(unlink.source, unlink.reference, unlink.target)
        self._site.add(code.If(test, tuple(code.Assign(kept.place, kept.unlinked) for kept in cells)))

    def leave_containers(self, move: Rehome) -> None:
        """Emit code that removes an object from its container, unless it is the container that the rule moves it to."""
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
        """Return code for the container that holds an object by a reference, -1 for none."""
        sure = self._facts.metamodel.is_a(cls, reference.target)
        found = self._facts.links.other_end(reference, node, forward=False, sure=sure)
        assert found is not None
        return found

    def _let_go(
        self, reference: Reference, node: code.Expression, cls: str, test: code.Expression | None
    ) -> None:
        """Emit code that removes an object from its container by a reference, if `test` holds; always if it is None."""
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
        """Emit code that adds a link, unless it exists. The code refuses the rule if an end has too many links.

        For a containment, it also refuses containment cycles, and objects that have another container.
        """
        if isinstance(link, Rehome):
            source, reference, target = link.container, link.reference, link.node
        else:
            source, reference, target = link.source, link.reference, link.target
        held = self._facts.metamodel.containment(reference, source, target)

        def write() -> None:
            if held is not None:
                contains, container, content = held
                self._check_contents(content, container, contains.target)
                self._check_homeless(content, contains)
            self._check_room(reference, self._site.slots[source], source, forward=True)
            self._check_room(reference, self._site.slots[target], target, forward=False)
            cells = self._cells(source, reference, target)
            for test in dict.fromkeys(test for kept in cells for test in kept.guard):
                self._site.unless(test)
            self._site.add(*(code.Assign(kept.place, kept.linked) for kept in cells))

        made = self._site.collected(write)
        there = code.Operation(">=", (self._site.slots[target], ZERO))
        missing_ = code.inverse(self.linked(source, reference, target))
        test = code.Operation("and", (there, missing_)) if target in self._site.frame.types else missing_
        self._site.add(code.If(test, made))

    def _check_contents(self, content: int, container: int, cls: str) -> None:
        """Emit code that refuses the rule if an object would enter a container that it contains, at any depth."""
        facts, site = self._facts, self._site
        if content in site.frame.new and all(holder != content for _, holder, _ in self._housed()):
            return
        inner = facts.metamodel.all_contents(facts.metamodel.concrete(site.frame.classes.get(content) or cls))
        holder = site.frame.classes.get(container)
        if any(holder is None or facts.metamodel.overlap(one, holder) for one in inner):
            found = call(inside(facts), site.slots[content], site.slots[container])
            site.unless(code.inverse(found))

    def _check_homeless(self, content: int, entered: Reference) -> None:
        """Emit code that refuses the rule if an object already has a container by a reference other than `entered`."""
        maker = self._site.frame.new.get(content)
        entering = [
            node for node, _, frame in self._housed() if node == content and frame.new.get(node) is maker
        ]
        if maker is self._site.frame and len(entering) == 1:
            return
        metamodel, cls = self._facts.metamodel, self._site.frame.classes.get(content) or entered.target
        for reference in metamodel.references:
            if reference.containment and reference != entered and metamodel.overlap(cls, reference.target):
                held = self._held_cell(reference, self._site.slots[content], cls)
                self._site.unless(code.Operation("<", (held, ZERO)))

    def _housed(self) -> list[tuple[int, int, Frame]]:
        """Return all objects that the rule or its blocks put into containers: content slot, container slot, frame."""
        found: list[tuple[int, int, Frame]] = []
        for frame in self._site.blocks.frames:
            found += [(move.node, move.container, frame) for move in frame.plan.moves]
            for link in frame.plan.links:
                held = self._facts.metamodel.containment(link.reference, link.source, link.target)
                if held is not None:
                    found.append((held[2], held[1], frame))
        return found

    def _check_room(self, reference: Reference, node: code.Expression, slot: int, *, forward: bool) -> None:
        """Emit code that refuses the rule if an object has the most targets allowed, or sources if not `forward`."""
        upper = reference.upper if forward else self._facts.metamodel.most_sources(reference)
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
        """Emit code that sets the only target of an object, or removes it if the change has no value.

        If a single-valued opposite of the target is occupied, the former link is removed.
        """
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
                if links.symmetric(reference):
                    self._hold(stored, old, NOBODY)
                self._make_room(stored, reference, target)
                site.add(code.Assign(old, target))  # type: ignore[arg-type]
                if links.symmetric(reference):
                    self._hold(stored, target, source)
        else:
            found = links.other_end(reference, source, forward=True, sure=False)
            assert found is not None
            old = self._facts.local(ObjectType(""))
            site.add(code.Assign(old, found))

            def write() -> None:
                self._hold(stored, old, NOBODY)
                self._hold(stored, target, source)

        site.add(code.If(code.Operation("!=", (old, target)), site.collected(write)))

    def set_container(self, change: SetTargets) -> None:
        """Emit code that moves an object into a new container, or only out of its old one if there is no value."""
        site, reference, value = self._site, change.reference, change.values[0] if change.values else None
        contains = reference if reference.containment else self._facts.metamodel.opposite(reference)
        assert contains is not None
        source, target = site.slots[change.object], NOBODY if value is None else site.slots[value]
        old = self._facts.local(ObjectType(""))
        found = self._facts.links.other_end(reference, source, forward=True, sure=False)
        assert found is not None
        site.add(code.Assign(old, found))
        there = code.Operation(">=", (target, ZERO))

        def write() -> None:
            if reference.containment:
                self._let_go(contains, old, contains.target, code.Operation(">=", (old, ZERO)))
            else:
                self._let_go(contains, source, contains.target, None)
            if value is not None:
                ends = change.object, value
                entering = ends if reference.containment else ends[::-1]
                site.add(code.If(there, site.collected(lambda: self._put(contains, *entering))))

        site.add(code.If(code.Operation("!=", (old, target)), site.collected(write)))

    def _put(self, reference: Reference, container: int, content: int) -> None:
        """Emit code that moves an object into a container. A single-valued reference loses its former content.

        The rule is refused if the container is full, or is inside the object.
        """
        site, metamodel = self._site, self._facts.metamodel
        cls, node = site.frame.classes.get(content) or reference.target, site.slots[content]
        for other in metamodel.references:
            if other.containment and metamodel.overlap(cls, other.target):
                self._let_go(other, node, cls, None)
        if reference.upper == 1:
            inside_ = self._facts.local(ObjectType(""))
            found = self._facts.links.other_end(reference, site.slots[container], forward=True, sure=False)
            assert found is not None
            site.add(code.Assign(inside_, found))
            self._let_go(reference, inside_, reference.target, code.Operation(">=", (inside_, ZERO)))
        else:
            self._check_room(reference, site.slots[container], container, forward=True)
        self._check_contents(content, container, reference.target)
        (kept,) = self._cells(container, reference, content)
        for test in kept.guard:
            site.unless(test)
        site.add(code.Assign(kept.place, kept.linked))

    def set_targets(self, change: SetTargets) -> None:
        """Emit code that replaces all targets of an object."""
        block, reference = code.Block(), change.reference
        source, sure = self._site.slots[change.object], self._site.sure(change.object, reference.owner)
        links = self._facts.links
        target, kept = links.each(block, reference, source, forward=True, sure=sure)
        block.add(code.Assign(kept.place, kept.unlinked))
        if links.symmetric(reference):
            back = links.cell(reference, target, source, sure=(True, sure))
            block.add(code.Assign(back.place, back.unlinked))
        self._site.add(*block.body())
        self.change_targets(ChangeTargets(change.object, reference, "+=", change.values))

    def change_targets(self, change: ChangeTargets) -> None:
        """Emit code that adds or removes targets. An added target loses its former link of a single-valued opposite."""
        opposite = self._facts.metamodel.opposite(change.reference)
        for value in change.values:
            if change.operator == "-=":
                made = self._site.collected(
                    lambda value=value: self.unlink(Unlink(change.object, change.reference, value))  # type: ignore[misc]
                )
            elif opposite is not None and opposite.upper == 1:
                made = self._site.collected(
                    lambda value=value: self.set_target(SetTargets(value, opposite, (change.object,)))  # type: ignore[misc]
                )
            else:
                self.link(Link(change.object, change.reference, value))
                continue
            there = code.Operation(">=", (self._site.slots[value], ZERO))
            self._site.add(*([code.If(there, made)] if value in self._site.frame.types else made))

    def _hold(self, stored: LinkColumn, holder: code.Expression, other: code.Expression) -> None:
        """Emit code that stores `other` in the column's cell of an object, if the object is not -1."""
        place, _ = self._facts.links.near(stored, holder, sure=True)
        there = code.Operation(">=", (holder, ZERO))
        self._site.add(code.If(there, (code.Assign(place, other),)))

    def _make_room(self, stored: LinkColumn, reference: Reference, target: code.Expression) -> None:
        """Emit code that removes the former link to a target, if the reference has a single-valued opposite.

        If the opposite has another maximum, the code refuses the rule when the target has too many sources.
        """
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
