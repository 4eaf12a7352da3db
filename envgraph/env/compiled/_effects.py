"""What a rule does to a state, as assignments to its cells."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from envgraph import code
from envgraph.env.compiled._blocks import Blocks, Frame
from envgraph.env.compiled._contradictions import Pairs, fitted
from envgraph.env.compiled._facts import Stored, call
from envgraph.env.compiled._layout import BEYOND, cell, failed, plus
from envgraph.env.compiled._matching import Matching
from envgraph.env.compiled._member import absent
from envgraph.env.compiled._refused import NotCompiled
from envgraph.env.compiled._tables import WORD, ClassSet
from envgraph.env.compiled._terms import Term, Terms, literal, named
from envgraph.metamodel import Attribute, Reference, Scalar
from envgraph.pattern import ObjectType, StaticType
from envgraph.rewrite.plans import (
    BlockPlan,
    ChangeClass,
    Compute,
    Delete,
    Increase,
    Link,
    New,
    Rehome,
    RulePlan,
    SetTargets,
    SetValue,
    Unlink,
)

REFUSED = code.Name("REFUSED")
MISSING = code.Constant(-1)


class Effects:
    """Writes what a rule does: each phase for all matches of all blocks before the next.

    Args:
        matching: finds matches of blocks, and reads the model.
        plan: of the rule.
        slots: variables for the slots of the match.
        leave: what the function returns where the rule is refused.
    """

    def __init__(
        self, matching: Matching, plan: RulePlan, slots: Sequence[code.Expression], leave: code.Return
    ) -> None:
        self._facts = matching.facts
        self._plan = plan
        self._leave = leave
        self._statements: list[code.Statement] = []
        self._blocks = Blocks(matching, plan, dict(enumerate(slots)), leave)
        self._rule = self._blocks.frames[0]
        self._enter(self._rule, self._rule.slots, None)

    def write(self) -> code.Body:
        """All changes, in order; a refusal sets the error of the state."""
        self._add(*self._blocks.collect())
        body = self._plan.body
        self._each(self._compute_all)
        if body.nested or body.coinciding or body.contended:
            self._check_agreement()
        phases = self._unlink_all, self._delete_all, self._retype_all, self._create_all, self._link_all
        for phase in phases:
            self._each(phase)
        self._each(self._set_all)
        return tuple(self._statements)

    def _enter(self, frame: Frame, slots: dict[int, code.Expression], row: code.Local | None) -> None:
        """From now on statements are about a match of a frame."""
        self._frame, self._slots, self._row = frame, slots, row
        self._body, self._types = frame.plan, frame.types

    def _each(self, write: Callable[[], None]) -> None:
        """Do something for each match of the rule and of its blocks."""
        for frame in self._blocks.frames:
            if frame.outer is None:
                write()
                continue
            row = self._facts.module.fresh("r")
            loads, slots = self._blocks.loaded(frame, row)
            self._enter(frame, slots, row)
            made = self._collected(write)
            if made:
                self._add(self._blocks.each(frame, row, loads, made))
            self._enter(self._rule, self._rule.slots, None)

    def _collected(self, write: Callable[[], None]) -> list[code.Statement]:
        """The statements that something writes."""
        before, self._statements = self._statements, []
        write()
        made, self._statements = self._statements, before
        return made

    # --- phases

    def _compute_all(self) -> None:
        self._identify()
        for unlink in self._body.unlinks:
            if unlink.required:
                self._unless(self._linked(unlink.source, unlink.reference, unlink.target))
        for compute in self._body.computed:
            self._compute(compute)

    def _unlink_all(self) -> None:
        for unlink in self._body.unlinks:
            self._unlink(unlink)
        for move in self._body.moves:
            self._leave_containers(move)

    def _delete_all(self) -> None:
        for delete in self._body.deletes:
            self._delete(delete)

    def _retype_all(self) -> None:
        for retype in self._body.retypes:
            self._retype(retype)

    def _create_all(self) -> None:
        for new in self._body.creates:
            self._create(new)

    def _link_all(self) -> None:
        for move in self._body.moves:
            self._link(move)
        for link in self._body.links:
            self._link(link)

    def _set_all(self) -> None:
        for change in self._body.sets:
            match change:
                case SetValue():
                    self._set(change)
                case Increase():
                    self._increase(change)
                case SetTargets():
                    self._set_target(change)
                case _:
                    raise AssertionError(change)

    # --- agreement

    def _check_agreement(self) -> None:
        """The rule is refused where two matches contradict each other."""
        frames, pairs = self._blocks.frames, Pairs(self._facts.metamodel, self._rule)
        self._check_order()
        for number, one in enumerate(frames):
            for other in frames[number:]:
                self._check_pair(pairs, one, other)

    def _check_pair(self, pairs: Pairs, one: Frame, other: Frame) -> None:
        sides = []
        for frame in (one, other):
            row = self._facts.module.fresh("r")
            loads, slots = ([], frame.slots) if frame.outer is None else self._blocks.loaded(frame, row)
            sides.append((frame, row, loads, slots))
        tests = dict.fromkeys(pairs.tests(one, sides[0][3], other, sides[1][3]))
        body: list[code.Statement] = [code.If(test, (failed(REFUSED), self._leave)) for test in tests]
        for frame, row, loads, _ in reversed(sides):
            if body and frame.outer is not None:
                body = [self._blocks.each(frame, row, loads, body)]
        self._add(*body)

    def _check_order(self) -> None:
        """Changes of which the order shows are made by one block."""
        changing: dict[Attribute | Reference, BlockPlan] = {}
        for frame in self._blocks.frames:
            for change in frame.plan.sets:
                feature: Attribute | Reference | None = None
                if isinstance(change, Increase) and change.attribute.type is Scalar.FLOAT:
                    feature = change.attribute
                elif isinstance(change, SetTargets):
                    opposite = self._facts.metamodel.opposite(change.reference)
                    feature = (
                        change.reference if opposite is not None and opposite.upper not in (None, 1) else None
                    )
                if feature is not None and changing.setdefault(feature, frame.plan) is not frame.plan:
                    raise NotCompiled(f"`{feature}` in several blocks of a rule", frame.plan.span)

    def _identify(self) -> None:
        """The rule is refused where what is deleted is also something else that the match has."""
        for gone, other in self._body.identified:
            self._unless(code.Operation("!=", (self._slots[gone], self._slots[other])))
        for one, another in self._body.identified_links:
            ends, others = (one.source, one.target), (another.source, another.target)
            if one.reference != another.reference:
                others = others[::-1]
            pairs = zip(ends, others, strict=True)
            same = [code.equal(self._slots[end], self._slots[other]) for end, other in pairs]
            self._unless(code.inverse(code.joined("and", same, True)))

    def slot(self, number: int) -> code.Expression:
        """The value of a slot, after `write`."""
        return self._slots[number]

    # --- statements

    def _add(self, *statements: code.Statement) -> None:
        self._statements += statements

    def _unless(self, test: code.Expression) -> None:
        """The rule is refused unless something holds."""
        self._add(code.If(code.inverse(test), (failed(REFUSED), self._leave)))

    def _sure(self, slot: int, cls: str) -> bool:
        own = self._frame.classes.get(slot)
        return own is not None and self._facts.metamodel.is_a(own, cls)

    # --- values

    def _compute(self, compute: Compute) -> None:
        names = {}
        for name, slot, type_ in compute.scope:
            sure = self._frame.classes.get(slot)
            names[name] = named(self._slots[slot], type_, sure)
        terms = Terms(self._facts, names)
        term = terms.write(compute.expression, self._expected(compute.slot))
        self._add(*terms.steps)
        for test in term.valid if not compute.needed else term.tests:
            self._unless(test)
        self._types[compute.slot] = term.type
        local = self._facts.local(term.type or ObjectType(""))
        value = term.number
        optional = term.present if not compute.needed else ()
        if term.beyond is not None and self._expected(compute.slot) is not Scalar.FLOAT:
            self._unless_beyond(code.joined("and", [*optional, term.beyond], True))
        if optional:
            value = code.Choice(
                code.joined("and", optional, True), value, absent(term.type or ObjectType(""))
            )
        self._add(code.Assign(local, value))
        self._slots[compute.slot] = local
        if self._row is not None:
            self._add(code.Assign(self._frame.space(compute.slot, self._row), local))

    def _expected(self, slot: int) -> StaticType | None:
        """The type of what gets the value of a slot."""
        values = (SetValue, Increase)
        found = (one.attribute for one in self._body.sets if isinstance(one, values) and one.value == slot)
        return next((attribute.type for attribute in found), None)

    def _fitting(self, slot: int, attribute: Attribute) -> code.Expression:
        """The value of a slot as one of an attribute."""
        return fitted(self._slots[slot], self._types.get(slot, attribute.type), attribute)

    def _unless_beyond(self, test: code.Expression) -> None:
        """The rule is refused if an int is too large for the state."""
        self._add(code.If(test, (failed(BEYOND), self._leave)))

    def _cell(self, slot: int, attribute: Attribute) -> code.Index:
        node = self._slots[slot]
        place, guard = self._facts.attribute_cell(attribute, node, sure=self._sure(slot, attribute.owner))
        for test in guard:
            self._unless(test)
        return place

    def _set(self, change: SetValue) -> None:
        attribute = change.attribute
        if change.value is None:
            self._add(code.Assign(self._cell(change.object, attribute), absent(attribute.type)))
            return
        value = self._fitting(change.value, attribute)
        self._add(code.Assign(self._cell(change.object, attribute), value))

    def _increase(self, change: Increase) -> None:
        attribute = change.attribute
        place = self._cell(change.object, attribute)
        self._unless(self._facts.present(place, attribute.type))
        made = code.Operation(change.operator[0], (place, self._fitting(change.value, attribute)))
        local = self._facts.local(attribute.type)
        self._add(code.Assign(local, made))
        if attribute.type is Scalar.FLOAT:
            self._unless(code.Operation("<", (code.call("abs", local), code.Name("INFINITY"))))
        if (beyond := Term(local, attribute.type, bits=WORD + 1).beyond) is not None:
            self._unless_beyond(beyond)
        self._add(code.Assign(place, local))

    # --- links

    def _ends(
        self, source: int, reference: Reference, target: int
    ) -> tuple[Stored, code.Index, code.Expression, list[code.Expression]]:
        """The cell that keeps a link, the other end, and what has to hold for there to be that cell."""
        stored, same = self._facts.stored(reference)
        at_source = stored.at_source is same
        holder, other = (source, target) if at_source else (target, source)
        end = reference.owner if at_source else reference.target
        place, guard = self._facts.link_cell(stored, self._slots[holder], sure=self._sure(holder, end))
        return stored, place, self._slots[other], guard

    def _linked(self, source: int, reference: Reference, target: int) -> code.Expression:
        if self._facts.changes.fixed_feature(reference):
            raise AssertionError(reference)
        _, place, other, guard = self._ends(source, reference, target)
        return code.joined("and", [*guard, code.equal(place, other)], True)

    def _unlink(self, unlink: Unlink) -> None:
        _, place, _, _ = self._ends(unlink.source, unlink.reference, unlink.target)
        test = self._linked(unlink.source, unlink.reference, unlink.target)
        self._add(code.If(test, (code.Assign(place, MISSING),)))

    def _leave_containers(self, move: Rehome) -> None:
        """An object leaves its container, unless that is where it is to go."""
        cls = self._frame.classes.get(move.node)
        assert cls is not None
        metamodel, node = self._facts.metamodel, self._slots[move.node]
        for reference in metamodel.references:
            if not (reference.containment and metamodel.overlap(cls, reference.target)):
                continue
            stays = None
            if reference == move.reference:
                stays = code.Operation(
                    "!=", (self._held_cell(reference, node, cls), self._slots[move.container])
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
            self._add(code.Assign(holder, self._held_cell(reference, node, cls)))
            place, _ = self._facts.link_cell(stored, holder, sure=True)
            there: list[code.Expression] = [code.Operation(">=", (holder, code.Constant(0)))]
        else:
            sure = self._facts.metamodel.is_a(cls, reference.target)
            place, there = self._facts.link_cell(stored, node, sure=sure)
        tests = [*there, *([] if test is None else [test])]
        cleared = code.Assign(place, MISSING)
        self._add(code.If(code.joined("and", tests, True), (cleared,)) if tests else cleared)

    def _link(self, link: Link | Rehome) -> None:
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
        before = self._statements
        self._statements = []
        if content is not None:
            self._check_contents(content, end)
            self._check_homeless(content, end, reference)
        self._check_room(reference, self._slots[source], source, forward=True)
        self._check_room(reference, self._slots[target], target, forward=False)
        _, place, other, guard = self._ends(source, reference, target)
        for test in guard:
            self._unless(test)
        made = (*self._statements, code.Assign(place, other))
        self._statements = before
        there = code.Operation(">=", (self._slots[target], code.Constant(0)))
        missing_ = code.inverse(self._linked(source, reference, target))
        test = code.Operation("and", (there, missing_)) if target in self._types else missing_
        self._add(code.If(test, made))

    def _check_contents(self, content: int, cls: str) -> None:
        """An object that enters a container contains nothing that it could enter."""
        if content in self._frame.new:
            self._check_new_contents(content)
            return
        metamodel = self._facts.metamodel
        for one in metamodel.concrete(cls):
            for feature in metamodel.features(one).values():
                if isinstance(feature, Reference) and feature.containment:
                    raise NotCompiled(f"containers that a rule moves (`{one}`)", self._body.span)

    def _check_homeless(self, content: int, cls: str, entered: Reference) -> None:
        """The rule is refused where an object is in another container, by another reference than the one it enters."""
        new = self._frame.new.get(content), content
        if new[0] is self._frame and [inside for inside, _ in self._housed()].count(new) == 1:
            return
        metamodel, cls = self._facts.metamodel, self._frame.classes.get(content) or cls
        for reference in metamodel.references:
            if (
                reference.containment
                and reference not in (entered, metamodel.opposite(entered))
                and metamodel.overlap(cls, reference.target)
            ):
                held = self._held_cell(reference, self._slots[content], cls)
                self._unless(code.Operation("<", (held, code.Constant(0))))

    def _check_new_contents(self, content: int) -> None:
        """What contains a new object is not inside of it, as far as the rule puts it together."""
        first: tuple[Frame | None, int] = self._frame.new[content], content
        above = [first]
        for one in above:  # grows meanwhile
            above += [other for inside, other in self._housed() if inside == one and other not in above]
            if (one, first) in self._housed():
                raise NotCompiled("objects that contain each other", self._body.span)

    def _housed(self) -> list[tuple[tuple[Frame | None, int], tuple[Frame | None, int]]]:
        """What gets a container, and that: slots with what creates their objects."""
        found: list[tuple[tuple[Frame | None, int], tuple[Frame | None, int]]] = []
        for frame in self._blocks.frames:
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
        sure = self._sure(slot, reference.owner if forward else reference.target)
        one = self._facts.other_end(reference, node, forward=forward, sure=sure) if upper == 1 else None
        if one is not None:
            self._unless(code.Operation("<", (one, code.Constant(0))))
        else:
            stored, _ = self._facts.stored(reference)
            self._unless(code.Operation("<", (call(self._holders(stored), node), code.Constant(upper))))

    def _holders(self, stored: Stored) -> str:
        """The function that counts the objects whose cell has another."""
        module, facts = self._facts.module, self._facts
        name = module.named(("holders", stored))
        if name is None:
            block, wanted, number = code.Block(), module.fresh("v", "object"), code.Local("n", "int")
            facts.holding(block, stored, wanted)
            block.add(code.Assign(number, code.Constant(1), "+="))
            body = (code.Assign(number, code.Constant(0)), *block.body(), code.Return(number))
            with module.writing():
                name = module.keep(("holders", stored), module.add("holders", (wanted,), body))
        return name

    def _set_target(self, change: SetTargets) -> None:
        """The one target of an object; where the opposite of a single one is taken, its holder lets go."""
        facts, reference = self._facts, change.reference
        opposite = facts.metamodel.opposite(reference)
        stored, same = facts.stored(reference)
        source = self._slots[change.object]
        target = self._slots[change.values[0]] if change.values else MISSING
        at_source = stored.at_source is same
        before, self._statements = self._statements, []
        if at_source:
            sure = self._sure(change.object, reference.owner)
            place, guard = facts.link_cell(stored, source, sure=sure)
            for test in guard:
                self._unless(test)
            old: code.Expression = place
            there = code.Operation(">=", (target, code.Constant(0)))
            if opposite is not None and opposite.upper == 1:
                holder = facts.local(ObjectType(""))
                held = facts.other_end(reference, target, forward=False, sure=False)
                assert held is not None
                self._add(code.Assign(holder, code.Choice(there, held, MISSING)))
                other, _ = facts.link_cell(stored, holder, sure=True)
                self._add(
                    code.If(code.Operation(">=", (holder, code.Constant(0))), (code.Assign(other, MISSING),))
                )
            elif opposite is not None and opposite.upper is not None:
                few = code.Operation(
                    "<", (call(self._holders(stored), target), code.Constant(opposite.upper))
                )
                self._unless(code.Operation("or", (code.inverse(there), few)))
            self._add(code.Assign(place, target))
        else:
            found = facts.other_end(reference, source, forward=True, sure=False)
            assert found is not None
            local = facts.local(ObjectType(""))
            before.append(code.Assign(local, found))
            old = local
            held_by, _ = facts.link_cell(stored, local, sure=True)
            self._add(
                code.If(code.Operation(">=", (local, code.Constant(0))), (code.Assign(held_by, MISSING),))
            )
            place, _ = facts.link_cell(stored, target, sure=True)
            self._add(
                code.If(code.Operation(">=", (target, code.Constant(0))), (code.Assign(place, source),))
            )
        made = tuple(self._statements)
        self._statements = before
        self._add(code.If(code.Operation("!=", (old, target)), made))

    # --- objects

    def _create(self, new: New) -> None:
        """A new object is there; its attributes have their initial values."""
        facts, node, there = self._facts, self._slots[new.node], self._facts.module.fresh("p")
        group = facts.changes.group_of(new.cls)
        assert group is not None
        self._add(code.Assign(there, facts.place(group, node, sure=True)[0]))
        self._add(code.Assign(self._word(group, new.cls, there), _bit_at(there), "|="))
        for attribute in facts.metamodel.features(new.cls).values():
            if isinstance(attribute, Attribute) and not attribute.many:
                place, _ = facts.attribute_cell(attribute, node, sure=True)
                value = attribute.initial
                assert not isinstance(value, tuple)
                self._add(code.Assign(place, literal(facts, value, attribute.type).number))

    def _retype(self, retype: ChangeClass) -> None:
        group = self._facts.changes.group_of(retype.cls)
        assert group is not None
        place = self._leave_sets(group, retype.node)
        word = self._word(group, retype.cls, place)
        self._add(code.Assign(word, _bit_at(place), "|="))

    def _leave_sets(self, group: tuple[str, ...], slot: int) -> code.Expression:
        """An object is in none of the sets of its group."""
        facts = self._facts
        place = facts.module.fresh("p")
        self._add(code.Assign(place, facts.place(group, self._slots[slot], sure=True)[0]))
        for cls in group:
            word = self._word(group, cls, place)
            rest = code.Operation(
                "&", (word, code.Operation("^", (code.Constant(2**WORD - 1), _bit_at(place))))
            )
            self._add(code.Assign(word, rest))
        return place

    def _word(self, group: tuple[str, ...], cls: str, place: code.Expression) -> code.Index:
        offset = self._facts.layout.offset(ClassSet(group, cls))
        return cell(plus(offset, code.Operation(">>", (place, code.Constant(5)))))

    def _delete(self, delete: Delete) -> None:
        cls = self._body.classes[delete.node]
        assert cls is not None
        facts, node = self._facts, self._slots[delete.node]
        metamodel = facts.metamodel
        concrete = metamodel.concrete(cls)
        if not concrete:
            return
        for reference in metamodel.references:
            opposite = metamodel.opposite(reference)
            if opposite is not None and opposite.index < reference.index:
                continue
            if metamodel.overlap(cls, reference.owner):
                self._drop(reference, node, cls, forward=True)
            if metamodel.overlap(cls, reference.target):
                self._drop(reference, node, cls, forward=False)
        attributes = {
            f.index: f
            for one in concrete
            for f in metamodel.features(one).values()
            if isinstance(f, Attribute) and not f.many
        }
        for attribute in attributes.values():
            place, guard = facts.attribute_cell(attribute, node, sure=metamodel.is_a(cls, attribute.owner))
            cleared = code.Assign(place, absent(attribute.type))
            self._add(code.If(code.joined("and", guard, True), (cleared,)) if guard else cleared)
        group = facts.changes.group_of(concrete[0])
        assert group is not None
        self._leave_sets(group, delete.node)

    def _drop(self, reference: Reference, node: code.Expression, cls: str, *, forward: bool) -> None:
        """The links of an object that goes, at one end of a reference: refused where they would dangle."""
        facts = self._facts
        opposite = facts.metamodel.opposite(reference)
        stored, _ = facts.stored(reference)
        content = reference.containment if not forward else opposite is not None and opposite.containment
        if stored.at_source is forward:
            end = reference.owner if forward else reference.target
            place, guard = facts.link_cell(stored, node, sure=facts.metamodel.is_a(cls, end))
            if content or self._plan.lossy:
                cleared = code.Assign(place, MISSING)
                self._add(code.If(code.joined("and", guard, True), (cleared,)) if guard else cleared)
            else:
                free = code.Operation("<", (place, code.Constant(0)))
                self._unless(code.Choice(guard[0], free, code.TRUE) if guard else free)
                cleared = code.Assign(place, MISSING)
                self._add(code.If(guard[0], (cleared,)) if guard else cleared)
            return
        block = code.Block()
        holder = facts.holding(block, stored, node)
        place, _ = facts.link_cell(stored, holder, sure=True)
        if content or self._plan.lossy:
            block.add(code.Assign(place, MISSING))
        else:
            block.add(failed(REFUSED), self._leave)
        self._add(*block.body())


def _bit_at(place: code.Expression) -> code.Expression:
    return code.call("bit_at", place)
