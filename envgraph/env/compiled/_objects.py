"""Code of a rule for objects: they are created, change their class, and are deleted."""

from __future__ import annotations

from collections.abc import Sequence

from envgraph import code
from envgraph.env.compiled._layout import NOBODY, ZERO, cell, plus
from envgraph.env.compiled._member import absent
from envgraph.env.compiled._site import Site
from envgraph.env.compiled._tables import WORD, ClassSet, LinkColumn
from envgraph.env.compiled._terms import literal
from envgraph.metamodel import Attribute, Reference
from envgraph.rewrite.plans import ChangeClass, Delete, New


class Objects:
    """Writes changes of objects.

    Args:
        site: the match that they are made for.
    """

    def __init__(self, site: Site) -> None:
        self._site = site
        self._facts = site.facts

    def create(self, new: New) -> None:
        """A new object is there; its attributes have their initial values."""
        facts, node, there = self._facts, self._site.slots[new.node], self._facts.module.fresh("p")
        group = facts.changes.group_of(new.cls)
        assert group is not None
        self._site.add(code.Assign(there, facts.place(group, node, sure=True)[0]))
        self._site.add(code.Assign(self._word(group, new.cls, there), _bit_at(there), "|="))
        for attribute in facts.metamodel.features(new.cls).values():
            if isinstance(attribute, Attribute) and not attribute.many:
                place, _ = facts.attribute_cell(attribute, node, sure=True)
                value = attribute.initial
                assert not isinstance(value, tuple)
                self._site.add(code.Assign(place, literal(facts, value, attribute.type).number))

    def retype(self, retype: ChangeClass) -> None:
        group = self._facts.changes.group_of(retype.cls)
        assert group is not None
        place = self._leave_sets(group, retype.node)
        word = self._word(group, retype.cls, place)
        self._site.add(code.Assign(word, _bit_at(place), "|="))

    def _leave_sets(self, group: tuple[str, ...], slot: int) -> code.Expression:
        """An object is in none of the sets of its group."""
        facts = self._facts
        place = facts.module.fresh("p")
        self._site.add(code.Assign(place, facts.place(group, self._site.slots[slot], sure=True)[0]))
        for cls in group:
            word = self._word(group, cls, place)
            rest = code.Operation(
                "&", (word, code.Operation("^", (code.Constant(2**WORD - 1), _bit_at(place))))
            )
            self._site.add(code.Assign(word, rest))
        return place

    def _word(self, group: tuple[str, ...], cls: str, place: code.Expression) -> code.Index:
        offset = self._facts.layout.offset(ClassSet(group, cls))
        return cell(plus(offset, code.Operation(">>", (place, code.Constant(5)))))

    def delete(self, delete: Delete) -> None:
        cls = self._site.body.classes[delete.node]
        assert cls is not None
        facts, node = self._facts, self._site.slots[delete.node]
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
            self._clear(place, absent(attribute.type), guard)
        group = facts.changes.group_of(concrete[0])
        assert group is not None
        self._leave_sets(group, delete.node)

    def _drop(self, reference: Reference, node: code.Expression, cls: str, *, forward: bool) -> None:
        """The links of an object that goes, at one end of a reference: refused where they would dangle."""
        facts = self._facts
        opposite = facts.metamodel.opposite(reference)
        kept, _ = facts.links.kept(reference)
        content = reference.containment if not forward else opposite is not None and opposite.containment
        clears = content or self._site.plan.lossy
        end = reference.owner if forward else reference.target
        sure = facts.metamodel.is_a(cls, end)
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
