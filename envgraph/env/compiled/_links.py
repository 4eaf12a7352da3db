"""What a rule does to links, as assignments to the cells that keep them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from envgraph import code
from envgraph.env.compiled._blocks import Frame
from envgraph.env.compiled._facts import Stored, call
from envgraph.env.compiled._matrices import linked_with, matrix_cell
from envgraph.env.compiled._refused import NotCompiled
from envgraph.env.compiled._site import MISSING, Site
from envgraph.env.compiled._tables import LinkMatrix, matrix_of
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

    def _ends(
        self, source: int, reference: Reference, target: int
    ) -> tuple[Stored, code.Index, code.Expression, list[code.Expression]]:
        """The cell that keeps a link, the other end, and what has to hold for there to be that cell."""
        stored, same = self._facts.stored(reference)
        at_source = stored.at_source is same
        holder, other = (source, target) if at_source else (target, source)
        end = reference.owner if at_source else reference.target
        place, guard = self._facts.link_cell(
            stored, self._site.slots[holder], sure=self._site.sure(holder, end)
        )
        return stored, place, self._site.slots[other], guard

    def _kept(
        self, source: int, reference: Reference, target: int
    ) -> tuple[code.Index, code.Expression, code.Expression, list[code.Expression]]:
        """The cell that keeps a link, what it is with the link and without, and what has to hold for there to be it."""
        facts, kept = self._facts, matrix_of(self._facts.metamodel, reference)
        if kept is None:
            _, place, other, guard = self._ends(source, reference, target)
            return place, other, MISSING, guard
        matrix, same = kept
        first, second = (source, target) if same else (target, source)
        ends = (first, matrix.reference.owner), (second, matrix.reference.target)
        place, guard = matrix_cell(
            facts,
            matrix,
            self._site.slots[first],
            self._site.slots[second],
            sure=(self._site.sure(*ends[0]), self._site.sure(*ends[1])),
        )
        return place, code.Constant(1), code.Constant(0), guard

    def linked(self, source: int, reference: Reference, target: int) -> code.Expression:
        if self._facts.changes.fixed_feature(reference):
            raise AssertionError(reference)
        place, value, _, guard = self._kept(source, reference, target)
        return code.joined("and", [*guard, code.equal(place, value)], True)

    def unlink(self, unlink: Unlink) -> None:
        place, _, nothing, _ = self._kept(unlink.source, unlink.reference, unlink.target)
        test = self.linked(unlink.source, unlink.reference, unlink.target)
        self._site.add(code.If(test, (code.Assign(place, nothing),)))

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
        found = self._facts.other_end(reference, node, forward=False, sure=sure)
        assert found is not None
        return found

    def _let_go(
        self, reference: Reference, node: code.Expression, cls: str, test: code.Expression | None
    ) -> None:
        """The container of an object by a reference is no more, if a test holds."""
        stored, same = self._facts.stored(reference)
        if stored.at_source is same:
            holder = self._facts.local(ObjectType(""))
            self._site.add(code.Assign(holder, self._held_cell(reference, node, cls)))
            place, _ = self._facts.link_cell(stored, holder, sure=True)
            there: list[code.Expression] = [code.Operation(">=", (holder, code.Constant(0)))]
        else:
            sure = self._facts.metamodel.is_a(cls, reference.target)
            place, there = self._facts.link_cell(stored, node, sure=sure)
        tests = [*there, *([] if test is None else [test])]
        cleared = code.Assign(place, MISSING)
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
        before = self._site.statements
        self._site.statements = []
        if content is not None:
            self._check_contents(content, end)
            self._check_homeless(content, end, reference)
        self._check_room(reference, self._site.slots[source], source, forward=True)
        self._check_room(reference, self._site.slots[target], target, forward=False)
        place, value, _, guard = self._kept(source, reference, target)
        for test in guard:
            self._site.unless(test)
        made = (*self._site.statements, code.Assign(place, value))
        self._site.statements = before
        there = code.Operation(">=", (self._site.slots[target], code.Constant(0)))
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
                self._site.unless(code.Operation("<", (held, code.Constant(0))))

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
        one = self._facts.other_end(reference, node, forward=forward, sure=sure) if upper == 1 else None
        if one is not None:
            self._site.unless(code.Operation("<", (one, code.Constant(0))))
        else:
            kept = matrix_of(self._facts.metamodel, reference)
            counted = (
                self._holders(self._facts.stored(reference)[0])
                if kept is None
                else self._partners(kept[0], forward is kept[1])
            )
            self._site.unless(code.Operation("<", (call(counted, node), code.Constant(upper))))

    def _holders(self, stored: Stored) -> str:
        """The function that counts the objects whose cell has another."""
        return self._counter(
            stored, "holders", lambda block, wanted: self._facts.holding(block, stored, wanted)
        )

    def _partners(self, matrix: LinkMatrix, forward: bool) -> str:
        """The function that counts the targets of an object, or its sources."""

        def loop(block: code.Block, wanted: code.Local) -> None:
            linked_with(self._facts, block, matrix, wanted, forward=forward, sure=False)

        return self._counter((matrix, forward), "partners", loop)

    def _counter(self, of: object, prefix: str, loop: Callable[[code.Block, code.Local], object]) -> str:
        """The function that counts what something loops over for an object."""

        def write() -> tuple[Sequence[code.Local], code.Body]:
            block, wanted = code.Block(), self._facts.module.fresh("v", "object")
            number = code.Local("n", "int")
            loop(block, wanted)
            block.add(code.Assign(number, code.Constant(1), "+="))
            return [wanted], (code.Assign(number, code.Constant(0)), *block.body(), code.Return(number))

        return self._facts.module.once((prefix, of), prefix, write)

    def set_target(self, change: SetTargets) -> None:
        """The one target of an object; where the opposite of a single one is taken, its holder lets go."""
        facts, reference = self._facts, change.reference
        opposite = facts.metamodel.opposite(reference)
        stored, same = facts.stored(reference)
        source = self._site.slots[change.object]
        target = self._site.slots[change.values[0]] if change.values else MISSING
        at_source = stored.at_source is same
        before, self._site.statements = self._site.statements, []
        if at_source:
            sure = self._site.sure(change.object, reference.owner)
            place, guard = facts.link_cell(stored, source, sure=sure)
            for test in guard:
                self._site.unless(test)
            old: code.Expression = place
            there = code.Operation(">=", (target, code.Constant(0)))
            if opposite is not None and opposite.upper == 1:
                holder = facts.local(ObjectType(""))
                held = facts.other_end(reference, target, forward=False, sure=False)
                assert held is not None
                self._site.add(code.Assign(holder, code.Choice(there, held, MISSING)))
                other, _ = facts.link_cell(stored, holder, sure=True)
                self._site.add(
                    code.If(code.Operation(">=", (holder, code.Constant(0))), (code.Assign(other, MISSING),))
                )
            elif opposite is not None and opposite.upper is not None:
                few = code.Operation(
                    "<", (call(self._holders(stored), target), code.Constant(opposite.upper))
                )
                self._site.unless(code.Operation("or", (code.inverse(there), few)))
            self._site.add(code.Assign(place, target))
        else:
            found = facts.other_end(reference, source, forward=True, sure=False)
            assert found is not None
            local = facts.local(ObjectType(""))
            before.append(code.Assign(local, found))
            old = local
            held_by, _ = facts.link_cell(stored, local, sure=True)
            self._site.add(
                code.If(code.Operation(">=", (local, code.Constant(0))), (code.Assign(held_by, MISSING),))
            )
            place, _ = facts.link_cell(stored, target, sure=True)
            self._site.add(
                code.If(code.Operation(">=", (target, code.Constant(0))), (code.Assign(place, source),))
            )
        made = tuple(self._site.statements)
        self._site.statements = before
        self._site.add(code.If(code.Operation("!=", (old, target)), made))
