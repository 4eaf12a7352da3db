"""Emit code for the changes that a rule makes to objects: creation, deletion and change of class."""

from __future__ import annotations

from envgraph import code
from envgraph.env.compiled.effects._containment_code import (
    class_set_word,
    emit_clear_attribute,
    emit_delete,
    emit_is_inside,
    emit_leave_sets,
    ends_of,
    stored_attributes,
)
from envgraph.env.compiled.effects._match_statements import MatchStatements
from envgraph.env.compiled.layout._program_layout import TOP, ZERO, emit_call, emit_sum
from envgraph.env.compiled.matching._body_code import CAPACITY
from envgraph.env.compiled.matching._term_code import emit_literal
from envgraph.metamodel import Attribute, Reference
from envgraph.rewrite.plans import CreateObject, DeleteObject, RetypeObject, contained_end


class ObjectChangeEmitter:
    """An emitter of the code that creates, retypes and deletes the objects of one match.

    Args:
        matches: the match, and the statements that the code is added to.
    """

    def __init__(self, matches: MatchStatements) -> None:
        self._match = matches
        self._facts = matches.facts

    def emit_create(self, new: CreateObject) -> None:
        """Emit code that adds a new object to the set of its class and gives its attributes their initial values."""
        facts, node, there = self._facts, self._match.slots[new.node], self._facts.module.new_local("p")
        group = facts.changes.group_of(new.cls)
        assert group is not None
        self._match.append(code.Assign(there, facts.emit_object_index(group, node, class_known=True)[0]))
        self._match.append(
            code.Assign(class_set_word(facts, group, new.cls, there), code.emit_call("bit_at", there), "|=")
        )
        for attribute in stored_attributes(facts, [new.cls]).values():
            self._emit_initial_value(attribute, node)

    def emit_retype(self, retype: RetypeObject) -> None:
        """Emit code that changes the class of an object.

        Attributes that the new class lacks are cleared, attributes that it adds get their initial values. Links that
        the new class does not allow are removed if the rule is `is_spo`; otherwise the rule is refused if they exist.
        """
        facts, node, new = self._facts, self._match.slots[retype.node], retype.cls
        cls, group = self._match.frame.plan.classes[retype.node], facts.changes.group_of(new)
        assert cls is not None
        assert group is not None
        for old in facts.metamodel.concrete_classes(cls):
            changed = self._match.collect(lambda old=old: self._emit_class_change(old, new, node))  # type: ignore[misc]
            if old != new and changed:
                self._match.append(code.If(facts.emit_is_instance(node, old, exact=True), changed))
        self._match.append(*emit_leave_sets(facts, group, node, class_known=True))
        place = facts.emit_object_index(group, node, class_known=True)[0]
        self._match.append(code.Assign(class_set_word(facts, group, new, place), code.emit_call("bit_at", place), "|="))

    def _emit_class_change(self, old: str, new: str, node: code.Expression) -> None:
        metamodel = self._facts.metamodel
        for reference, forward in ends_of(metamodel, [old]):
            if not metamodel.is_a(new, reference.owner if forward else reference.target):
                self._emit_drop_or_refuse_links(reference, node, old, forward=forward, drops=self._match.plan.is_spo)
        before, after = (stored_attributes(self._facts, [cls]) for cls in (old, new))
        for index, attribute in before.items():
            if index not in after:
                self._match.append(*emit_clear_attribute(self._facts, attribute, node, class_known=True))
        for index, attribute in after.items():
            if index not in before:
                self._emit_initial_value(attribute, node)

    def _emit_initial_value(self, attribute: Attribute, node: code.Expression) -> None:
        """Emit code that sets an attribute to its initial value; a multi-valued one has no values yet."""
        value = attribute.initial
        if isinstance(value, tuple):
            return
        place, _ = self._facts.attribute_cell(attribute, node, class_known=True)
        self._match.append(code.Assign(place, emit_literal(self._facts, value, attribute.type).number_code))

    def emit_delete(self, delete: DeleteObject) -> None:
        """Emit code that deletes an object and all objects that it contains.

        Links to other objects are removed if the rule is `is_spo`; otherwise they refuse the rule.
        """
        cls = self._match.frame.plan.classes[delete.node]
        assert cls is not None
        facts, node = self._facts, self._match.slots[delete.node]
        metamodel = facts.metamodel
        concrete = metamodel.concrete_classes(cls)
        if not concrete:
            return
        if metamodel.all_content_classes(concrete):
            self._emit_delete_with_contents(concrete, delete.node)
            return
        for reference, forward in ends_of(metamodel, concrete):
            is_content = contained_end(reference, True, False, metamodel) is forward
            self._emit_drop_or_refuse_links(
                reference, node, cls, forward=forward, drops=is_content or self._match.plan.is_spo
            )
        for attribute in stored_attributes(facts, concrete).values():
            sure = metamodel.is_a(cls, attribute.owner)
            self._match.append(*emit_clear_attribute(facts, attribute, node, class_known=sure))
        group = facts.changes.group_of(concrete[0])
        assert group is not None
        self._match.append(*emit_leave_sets(facts, group, node, class_known=True))

    def emit_is_inside_deleted(self, delete: DeleteObject) -> code.Expression:
        """Emit code that tests if the object is contained in another object that the rule deletes, and goes with it.

        Return the test: never true under SPO semantics, where nothing depends on the order of deletions.
        """
        metamodel, node = self._facts.metamodel, self._match.slots[delete.node]
        cls = self._match.frame.plan.classes[delete.node] or ""

        def contains(other: code.Expression, another: str) -> code.Expression | None:
            inner = metamodel.all_content_classes(metamodel.concrete_classes(another))
            if other == node or not any(metamodel.may_overlap(one, cls) for one in inner):
                return None
            within = emit_call(emit_is_inside(self._facts), other, node)
            return code.Operation("and", (code.Operation("!=", (other, node)), within))

        return code.FALSE if self._match.plan.is_spo else self._match.emit_any_deleted(contains)

    def _emit_delete_with_contents(self, concrete: tuple[str, ...], slot: int) -> None:
        """Emit code that calls a function to delete an object and its contents, and leaves if this is refused."""
        facts, matches = self._facts, self._match
        function = emit_delete(facts, concrete, matches.plan.is_spo)
        levels = len(matches.blocks.frames) - 1
        facts.module.record_call(function, levels)
        top = emit_sum(TOP, code.Operation("*", (CAPACITY, code.Constant(levels))))
        gone = code.Operation("<", (emit_call(function, matches.slots[slot], top=top), ZERO))
        matches.append(code.If(gone, (matches.error_return,)))

    def _emit_drop_or_refuse_links(
        self, reference: Reference, node: code.Expression, cls: str, *, forward: bool, drops: bool
    ) -> None:
        """Emit code that removes an object's links of a reference; or, unless `drops`, refuses the rule if it has any.

        Args:
            reference, node, cls: the reference, the object, and the object's known class.
            forward: True for links of which the object is the source, False for links of which it is the target.
            drops: True to remove links; False to refuse the rule if links exist.
        """
        sure = self._facts.metamodel.is_a(cls, reference.owner if forward else reference.target)
        block = code.BodyBuilder()
        _, link = self._facts.links.loop_over_links(block, reference, node, forward=forward, class_known=sure)
        if drops:
            block.add(code.Assign(link.place, link.unlinked_value))
        else:
            block.add(*self._match.failure_statements("REFUSED"))
        self._match.append(*block.finish_body())
