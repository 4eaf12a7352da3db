"""Emit the changes of links that a rule makes, as assignments to the cells that store links."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

from envgraph import code
from envgraph.env.compiled.effects._block_matches import MatchFrame
from envgraph.env.compiled.effects._containment_code import emit_clear_attribute, emit_is_inside
from envgraph.env.compiled.effects._match_statements import MatchStatements
from envgraph.env.compiled.layout._program_layout import ZERO, emit_call
from envgraph.env.compiled.matching._link_reading import LinkCell
from envgraph.metamodel import Reference
from envgraph.rewrite.plans import (
    AddLink,
    AdjustAttribute,
    ChangeTargets,
    MoveToContainer,
    RemoveLink,
    SetAttributeValues,
    SetTargets,
    container_entries,
    containments_of,
)


class LinkEmitter:
    """An emitter of changes of links.

    Args:
        matches: the match that changes are made for.
    """

    def __init__(self, matches: MatchStatements) -> None:
        self._match = matches
        self._facts = matches.facts
        self._merges = any(block.absorbs for block in matches.plan.blocks)

    def _link_cells(self, source: int, reference: Reference, target: int) -> list[LinkCell]:
        """Return the cells that store a link between the objects in two slots: two for a symmetric reference."""
        slots, sure = self._match.slots, self._match.has_certain_class
        ends = [(source, target), (target, source)] if self._facts.links.is_symmetric(reference) else [(source, target)]
        return [
            self._facts.links.link_cell(
                reference,
                slots[one],
                slots[other],
                classes_known=(sure(one, reference.owner), sure(other, reference.target)),
            )
            for one, other in ends
        ]

    def emit_is_linked(self, source: int, reference: Reference, target: int) -> code.Expression:
        return code.emit_joined("and", self._link_cells(source, reference, target)[0].tests_linked, True)

    def emit_unlink(self, unlink: RemoveLink) -> None:
        cells = self._link_cells(unlink.source, unlink.reference, unlink.target)
        test = self.emit_is_linked(unlink.source, unlink.reference, unlink.target)
        self._match.append(code.If(test, tuple(code.Assign(kept.place, kept.unlinked_value) for kept in cells)))

    def emit_leave_container(self, content: int, entered: Reference, containers: Sequence[int] = ()) -> None:
        """Emit code that removes an object from its container, unless that is one of those that it enters."""
        cls = self._match.frame.classes.get(content) or entered.target
        for reference in containments_of(cls, self._facts.metamodel):
            self._emit_drop(reference, content, containers if reference == entered else (), forward=False)

    def _emit_drop(self, reference: Reference, slot: int, kept: Sequence[int], *, forward: bool) -> None:
        """Emit code that removes an object's links, of which it is the source if `forward`, but not those to `kept`."""
        block, links, node = code.BodyBuilder(), self._facts.links, self._match.slots[slot]
        sure = self._match.has_certain_class(slot, reference.owner if forward else reference.target)
        other = links.emit_follow(block, reference, node, forward=forward, class_known=sure)
        for value in kept:
            block.open_test(code.Operation("!=", (other, self._match.slots[value])))
        ends = (node, other) if forward else (other, node)
        for one, another in (ends, ends[::-1]) if links.is_symmetric(reference) else (ends,):
            cell = links.link_cell(reference, one, another, classes_known=(True, True))
            block.add(code.Assign(cell.place, cell.unlinked_value))
        self._match.append(*block.finish_body())

    def emit_release(self, change: SetTargets | ChangeTargets) -> None:
        """Emit code that removes objects from the containers that they leave because of an assignment."""
        statements, reference, values = self._match, change.reference, change.values
        contains = self._facts.metamodel.opposite(reference)
        if isinstance(change, ChangeTargets) and change.operator == "-=":
            self.emit_change_targets(change)
        elif not reference.containment:
            assert contains is not None
            self.emit_leave_container(change.object, contains, values)
        else:
            if isinstance(change, SetTargets):
                self._emit_drop(reference, change.object, values, forward=True)
            for value in values:
                there = code.Operation(">=", (statements.slots[value], ZERO))
                statements.append_if(there, partial(self.emit_leave_container, value, reference, (change.object,)))

    def emit_container(self, reference: Reference, node: code.Expression, cls: str) -> code.Expression:
        """Return code for the container that holds an object by a reference, -1 for none."""
        sure = self._facts.metamodel.is_a(cls, reference.target)
        found = self._facts.links.only_other_end(reference, node, forward=False, class_known=sure)
        assert found is not None
        return found

    def emit_link(self, link: AddLink | MoveToContainer, *, replaces: bool = False) -> None:
        """Emit code that adds a link, unless it exists, or the target is missing.

        If it `replaces`, the former link of an end that may have only one is removed, and the content leaves its
        container. Otherwise the code refuses the rule if an end has too many links, or the content another container.
        It always refuses containment cycles.
        """
        if isinstance(link, MoveToContainer):
            source, reference, target = link.container, link.reference, link.node
        else:
            source, reference, target = link.source, link.reference, link.target
        held = self._facts.metamodel.containment_link(reference, source, target)

        def write() -> None:
            if held is not None:
                contains, container, content = held
                self._emit_cycle_check(content, container, contains.target)
                if replaces:
                    self.emit_leave_container(content, contains)
                else:
                    self._emit_container_check(content, contains, moves=isinstance(link, MoveToContainer))
            for slot, forward in ((source, True), (target, False)):
                if not (replaces and held is not None and held[2] == slot):
                    self._emit_make_room(reference, slot, forward=forward, replaces=replaces)
            cells = self._link_cells(source, reference, target)
            for test in dict.fromkeys(test for cell in cells for test in cell.guard):
                self._match.append_refuse_unless(test)
            self._match.append(*(code.Assign(cell.place, cell.linked_value) for cell in cells))

        missing = code.emit_not(self.emit_is_linked(source, reference, target))
        overwrites = replaces and self._is_one_value(reference)
        tests = [*(() if overwrites else self._presence_tests(target)), missing]
        self._match.append_if(code.emit_joined("and", tests, True), write)

    def _is_one_value(self, reference: Reference) -> bool:
        """Return True if all that stores a link is a cell of its source, so that -1 is as any target."""
        return reference.upper == 1 and self._facts.metamodel.max_sources(reference) is None

    def _presence_tests(self, slot: int) -> list[code.Expression]:
        """Return the test that a slot has an object; none if it certainly has."""
        plan = self._match.frame.plan
        found = self._match.frame.classes.get(slot) or any(
            each.slot == slot and each.is_required for each in plan.computed
        )
        return [] if found else [code.Operation(">=", (self._match.slots[slot], ZERO))]

    def _emit_cycle_check(self, content: int, container: int, cls: str) -> None:
        """Emit code that refuses the rule if an object would enter a container that it contains, at any depth."""
        facts, matches = self._facts, self._match
        is_empty = content in matches.frame.creators and not self._merges
        if is_empty and all(holder != content for _, holder, _ in self._entries()):
            return
        inner = facts.metamodel.all_content_classes(
            facts.metamodel.concrete_classes(matches.frame.classes.get(content) or cls)
        )
        holder = matches.frame.classes.get(container)
        if any(holder is None or facts.metamodel.may_overlap(one, holder) for one in inner):
            found = emit_call(emit_is_inside(facts), matches.slots[content], matches.slots[container])
            matches.append_refuse_unless(code.emit_not(found))

    def _emit_container_check(self, content: int, entered: Reference, *, moves: bool) -> None:
        """Emit code that refuses the rule if an object already has a container by a reference other than `entered`.

        An object that `moves`, or is created for this container, has none, unless it got that of a merged object.
        """
        maker = self._match.frame.creators.get(content)
        entering = [node for node, _, frame in self._entries() if node == content and frame.creators.get(node) is maker]
        if moves or (maker is self._match.frame and len(entering) == 1):
            if self._merges:
                self.emit_leave_container(content, entered)
            return
        cls = self._match.frame.classes.get(content) or entered.target
        for reference in containments_of(cls, self._facts.metamodel):
            if reference != entered:
                held = self.emit_container(reference, self._match.slots[content], cls)
                self._match.append_refuse_unless(code.Operation("<", (held, ZERO)))

    def _entries(self) -> Iterator[tuple[int, int, MatchFrame]]:
        """Yield all objects that the rule or its blocks put into containers: content slot, container slot, frame."""
        for frame in self._match.blocks.frames:
            for content, container in container_entries(frame.plan.operations, self._facts.metamodel):
                yield content, container, frame

    def _emit_make_room(self, reference: Reference, slot: int, *, forward: bool, replaces: bool) -> None:
        """Emit code for an object that gets one more target, or source if not `forward`, and may have too many.

        If the link `replaces` another one, that is removed. Otherwise, the code refuses the rule.
        """
        links, node = self._facts.links, self._match.slots[slot]
        upper = reference.upper if forward else self._facts.metamodel.max_sources(reference)
        if upper is None:
            return
        if upper == 1 and replaces:
            if links.is_symmetric(reference) or not links.has_own_cell(reference, forward):
                self._emit_drop(reference, slot, (), forward=forward)
            return
        sure = self._match.has_certain_class(slot, reference.owner if forward else reference.target)
        one = links.only_other_end(reference, node, forward=forward, class_known=sure) if upper == 1 else None
        if one is not None:
            few = code.Operation("<", (one, ZERO))
        else:
            few = code.Operation("<", (emit_call(links.emit_counter(reference, forward), node), code.Constant(upper)))
        self._match.append_refuse_unless(few)

    def emit_set_targets(self, change: SetTargets) -> None:
        """Emit code that replaces all targets of an object."""
        reference, values = change.reference, change.values
        one = reference.upper == len(values) == 1
        if not (one and (self._is_one_value(reference) or not self._presence_tests(values[0]))):
            self._emit_drop(reference, change.object, values, forward=True)
        self.emit_change_targets(ChangeTargets(change.object, reference, "+=", values))

    def emit_change_targets(self, change: ChangeTargets) -> None:
        """Emit code that adds or removes targets. An added target loses its former link of a single-valued opposite."""
        for value in change.values:
            if change.operator == "-=":
                removed = partial(self.emit_unlink, RemoveLink(change.object, change.reference, value))
                self._match.append_if(code.emit_joined("and", self._presence_tests(value), True), removed)
            else:
                self.emit_link(AddLink(change.object, change.reference, value), replaces=True)

    def emit_change_values(self, change: SetAttributeValues | AdjustAttribute) -> None:
        """Emit code that sets all values of a multi-valued attribute, or adds or removes one."""
        attribute, statements, links = change.attribute, self._match, self._facts.links
        node, sure = statements.slots[change.object], statements.has_certain_class(change.object, attribute.owner)
        if isinstance(change, SetAttributeValues):
            statements.append(*emit_clear_attribute(self._facts, attribute, node, class_known=sure))
        for slot in change.values if isinstance(change, SetAttributeValues) else (change.value,):
            value = statements.frame.converted_value(statements.slots, slot, attribute)
            cell = links.link_cell(attribute, node, value, classes_known=(sure, True))
            if isinstance(change, AdjustAttribute) and change.operator == "-=":
                held = code.emit_joined("and", cell.tests_linked, True)
                statements.append(code.If(held, (code.Assign(cell.place, cell.unlinked_value),)))
                continue
            for test in cell.guard:
                statements.append_fail_if(code.emit_not(test))

            def write(cell: LinkCell = cell) -> None:
                if attribute.upper is not None:
                    counted = emit_call(links.emit_counter(attribute, forward=True), node)
                    statements.append_refuse_unless(code.Operation("<", (counted, code.Constant(attribute.upper))))
                statements.append(code.Assign(cell.place, cell.linked_value, "+="))

            made = statements.collect(write)
            statements.append(*([code.If(code.emit_not(cell.is_linked), made)] if attribute.unique else made))
