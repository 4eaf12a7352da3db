"""Emit code for the changes that a rule makes to objects: creation, deletion and change of class."""

from __future__ import annotations

from collections.abc import Sequence

from envgraph import code
from envgraph.env.compiled._bodies import CAPACITY
from envgraph.env.compiled._containers import (
    deleting,
    ends_of,
    holds_content,
    inside,
    left,
    single_attributes,
    word_of,
)
from envgraph.env.compiled._layout import NOBODY, TOP, ZERO, call, plus
from envgraph.env.compiled._member import absent
from envgraph.env.compiled._site import Site
from envgraph.env.compiled._tables import LinkColumn
from envgraph.env.compiled._terms import literal
from envgraph.metamodel import Attribute, Reference
from envgraph.rewrite.plans import ChangeClass, Delete, New


class Objects:
    """An emitter of the code that creates, retypes and deletes the objects of one match.

    Args:
        site: the match, and the statements that the code is added to.
    """

    def __init__(self, site: Site) -> None:
        self._site = site
        self._facts = site.facts

    def create(self, new: New) -> None:
        """Emit code that adds a new object to the set of its class and gives its attributes their initial values."""
        facts, node, there = self._facts, self._site.slots[new.node], self._facts.module.fresh("p")
        group = facts.changes.group_of(new.cls)
        assert group is not None
        self._site.add(code.Assign(there, facts.place(group, node, sure=True)[0]))
        self._site.add(code.Assign(word_of(facts, group, new.cls, there), _bit_at(there), "|="))
        for attribute in single_attributes(facts.metamodel, [new.cls]).values():
            self._begin(attribute, node)

    def retype(self, retype: ChangeClass) -> None:
        """Emit code that changes the class of an object.

        Attributes that the new class lacks are cleared, attributes that it adds get their initial values. Links that
        the new class does not allow are removed if the rule is `lossy`; otherwise the rule is refused if they exist.
        """
        facts, node, new = self._facts, self._site.slots[retype.node], retype.cls
        cls, group = self._site.frame.plan.classes[retype.node], facts.changes.group_of(new)
        assert cls is not None
        assert group is not None
        for old in facts.metamodel.concrete(cls):
            changed = self._site.collected(lambda old=old: self._become(old, new, node))  # type: ignore[misc]
            if old != new and changed:
                self._site.add(code.If(facts.is_instance(node, old, exact=True), changed))
        self._leave_sets(group, retype.node)
        place = facts.place(group, node, sure=True)[0]
        self._site.add(code.Assign(word_of(facts, group, new, place), _bit_at(place), "|="))

    def _become(self, old: str, new: str, node: code.Expression) -> None:
        metamodel = self._facts.metamodel
        for reference, forward in ends_of(metamodel, [old]):
            if not metamodel.is_a(new, reference.owner if forward else reference.target):
                self._drop(reference, node, old, forward=forward, clears=self._site.plan.lossy)
        before, after = (single_attributes(metamodel, [cls]) for cls in (old, new))
        for index, attribute in before.items():
            if index not in after:
                place = self._facts.attribute_cell(attribute, node, sure=True)[0]
                self._site.add(code.Assign(place, absent(attribute.type)))
        for index, attribute in after.items():
            if index not in before:
                self._begin(attribute, node)

    def _begin(self, attribute: Attribute, node: code.Expression) -> None:
        """Emit code that sets an attribute to its initial value."""
        place, _ = self._facts.attribute_cell(attribute, node, sure=True)
        value = attribute.initial
        assert not isinstance(value, tuple)
        self._site.add(code.Assign(place, literal(self._facts, value, attribute.type).number))

    def _leave_sets(self, group: tuple[str, ...], slot: int) -> None:
        """Emit code that removes an object from the sets of all classes of its group."""
        self._site.add(*left(self._facts, group, self._site.slots[slot], sure=True))

    def delete(self, delete: Delete) -> None:
        """Emit code that deletes an object and all objects that it contains.

        Links to other objects are removed if the rule is `lossy`; otherwise they refuse the rule.
        """
        cls = self._site.frame.plan.classes[delete.node]
        assert cls is not None
        facts, node = self._facts, self._site.slots[delete.node]
        metamodel = facts.metamodel
        concrete = metamodel.concrete(cls)
        if not concrete:
            return
        if metamodel.all_contents(concrete):
            self._delete_whole(concrete, delete.node)
            return
        for reference, forward in ends_of(metamodel, concrete):
            is_content = holds_content(metamodel, reference, not forward)
            self._drop(reference, node, cls, forward=forward, clears=is_content or self._site.plan.lossy)
        for attribute in single_attributes(metamodel, concrete).values():
            place, guard = facts.attribute_cell(attribute, node, sure=metamodel.is_a(cls, attribute.owner))
            self._clear(place, absent(attribute.type), guard)
        group = facts.changes.group_of(concrete[0])
        assert group is not None
        self._leave_sets(group, delete.node)

    def outside(self, delete: Delete) -> list[code.Expression]:
        """Return expressions that test if the object is not contained in another object that the rule deletes."""
        facts, slots, classes = self._facts, self._site.slots, self._site.frame.plan.classes
        found: list[code.Expression] = []
        for other in self._site.frame.plan.deletes:
            inner = facts.metamodel.all_contents(facts.metamodel.concrete(classes[other.node] or ""))
            if other is not delete and any(
                facts.metamodel.overlap(one, classes[delete.node] or "") for one in inner
            ):
                within = call(inside(facts), slots[other.node], slots[delete.node])
                same = code.equal(slots[other.node], slots[delete.node])
                found.append(code.Operation("or", (same, code.inverse(within))))
        return found

    def _delete_whole(self, concrete: tuple[str, ...], slot: int) -> None:
        """Emit code that calls a function to delete an object and its contents, and leaves if this is refused."""
        facts, site = self._facts, self._site
        function = deleting(facts, concrete, site.plan.lossy)
        levels = len(site.blocks.frames) - 1
        facts.module.uses(function, levels)
        top = plus(TOP, code.Operation("*", (CAPACITY, code.Constant(levels))))
        gone = code.Operation("<", (call(function, site.slots[slot], top=top), ZERO))
        site.add(code.If(gone, (site.leave,)))

    def _drop(
        self, reference: Reference, node: code.Expression, cls: str, *, forward: bool, clears: bool
    ) -> None:
        """Emit code that removes an object's links of a reference, or if not `clears`, refuses the rule if any exist.

        Args:
            reference, node, cls: the reference, the object, and the object's known class.
            forward: True for links of which the object is the source, False for links of which it is the target.
            clears: True to remove links; if False, the rule is refused if links exist.
        """
        facts = self._facts
        kept, _ = facts.links.kept(reference)
        sure = facts.metamodel.is_a(cls, reference.owner if forward else reference.target)
        if isinstance(kept, LinkColumn) and kept.at_source is forward:
            place, guard = facts.links.near(kept, node, sure=sure)
            if not clears:
                free = code.Operation("<", (place, ZERO))
                self._site.unless(code.Choice(guard[0], free, code.TRUE) if guard else free)
            self._clear(place, NOBODY, guard)
            return
        block = code.Block()
        _, link = facts.links.each(block, reference, node, forward=forward, sure=sure)
        if clears:
            block.add(code.Assign(link.place, link.unlinked))
        else:
            block.add(*self._site.fail("REFUSED"))
        self._site.add(*block.body())

    def _clear(self, place: code.Index, nothing: code.Expression, guard: Sequence[code.Expression]) -> None:
        cleared = code.Assign(place, nothing)
        self._site.add(code.If(code.joined("and", guard, True), (cleared,)) if guard else cleared)


def _bit_at(place: code.Expression) -> code.Expression:
    return code.call("bit_at", place)
