"""Emit the changes of links that a rule makes, as assignments to the cells that store links."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from envgraph import code
from envgraph.env.compiled._block_matches import MatchFrame
from envgraph.env.compiled._containment_code import emit_clear_attribute, emit_is_inside
from envgraph.env.compiled._link_reading import LinkCell
from envgraph.env.compiled._match_conflicts import converted_value
from envgraph.env.compiled._match_statements import MatchStatements
from envgraph.env.compiled._program_layout import NOBODY, ZERO, emit_call
from envgraph.env.compiled._symbols import LinkColumn
from envgraph.metamodel import Reference
from envgraph.pattern import ObjectType
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
        self._statements = matches
        self._facts = matches.facts
        self._merges = any(block.absorbs for block in matches.plan.blocks)

    def _link_cells(self, source: int, reference: Reference, target: int) -> list[LinkCell]:
        """Return the cells that store a link between the objects in two slots: two for a symmetric reference."""
        slots, sure = self._statements.slots, self._statements.has_certain_class
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
        if self._facts.changes.is_fixed_feature(reference):
            raise AssertionError(reference)
        return code.emit_joined("and", self._link_cells(source, reference, target)[0].tests_linked, True)

    def emit_unlink(self, unlink: RemoveLink) -> None:
        cells = self._link_cells(unlink.source, unlink.reference, unlink.target)
        test = self.emit_is_linked(unlink.source, unlink.reference, unlink.target)
        self._statements.append(code.If(test, tuple(code.Assign(kept.place, kept.unlinked_value) for kept in cells)))

    def emit_leave_container(self, content: int, entered: Reference, containers: tuple[int, ...]) -> None:
        """Emit code that removes an object from its container, unless that is the one it enters; `()` for none."""
        cls = self._statements.frame.classes.get(content) or entered.target
        node = self._statements.slots[content]
        for reference in containments_of(cls, self._facts.metamodel):
            holder = self._facts.new_local_for(ObjectType(""))
            tests: list[code.Expression] = [code.Operation(">=", (holder, ZERO))]
            if reference == entered and containers:
                tests.append(code.Operation("!=", (holder, self._statements.slots[containers[0]])))
            cell = self._facts.links.link_cell(reference, holder, node, classes_known=(True, True))
            left = code.Assign(cell.place, cell.unlinked_value)
            self._statements.append(
                code.Assign(holder, self.emit_container(reference, node, cls)),
                code.If(code.emit_joined("and", tests, True), (left,)),
            )

    def emit_release(self, change: SetTargets | ChangeTargets) -> None:
        """Emit code that removes objects from the containers that they leave because of an assignment."""
        statements, reference, values = self._statements, change.reference, change.values
        contains = self._facts.metamodel.opposite(reference)
        if isinstance(change, ChangeTargets) and change.operator == "-=":
            self.emit_change_targets(change)
        elif not reference.containment:
            assert contains is not None
            self.emit_leave_container(change.object, contains, values)
        else:
            if isinstance(change, SetTargets):
                self._emit_drop_targets(change)
            for value in values:
                there = code.Operation(">=", (statements.slots[value], ZERO))
                statements.append_if(there, partial(self.emit_leave_container, value, reference, (change.object,)))

    def emit_container(self, reference: Reference, node: code.Expression, cls: str) -> code.Expression:
        """Return code for the container that holds an object by a reference, -1 for none."""
        sure = self._facts.metamodel.is_a(cls, reference.target)
        found = self._facts.links.only_other_end(reference, node, forward=False, class_known=sure)
        assert found is not None
        return found

    def emit_link(self, link: AddLink | MoveToContainer) -> None:
        """Emit code that adds a link, unless it exists. The code refuses the rule if an end has too many links.

        For a containment, it also refuses containment cycles, and objects that have another container.
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
                self._emit_container_check(content, contains, moves=isinstance(link, MoveToContainer))
            self._emit_room_check(reference, self._statements.slots[source], source, forward=True)
            self._emit_room_check(reference, self._statements.slots[target], target, forward=False)
            cells = self._link_cells(source, reference, target)
            for test in dict.fromkeys(test for kept in cells for test in kept.guard):
                self._statements.append_refuse_unless(test)
            self._statements.append(*(code.Assign(kept.place, kept.linked_value) for kept in cells))

        made = self._statements.collect(write)
        there = code.Operation(">=", (self._statements.slots[target], ZERO))
        missing_ = code.emit_not(self.emit_is_linked(source, reference, target))
        test = code.Operation("and", (there, missing_)) if target in self._statements.frame.types else missing_
        self._statements.append(code.If(test, made))

    def _emit_cycle_check(self, content: int, container: int, cls: str) -> None:
        """Emit code that refuses the rule if an object would enter a container that it contains, at any depth."""
        facts, matches = self._facts, self._statements
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
        maker = self._statements.frame.creators.get(content)
        entering = [node for node, _, frame in self._entries() if node == content and frame.creators.get(node) is maker]
        if moves or (maker is self._statements.frame and len(entering) == 1):
            if self._merges:
                self.emit_leave_container(content, entered, ())
            return
        cls = self._statements.frame.classes.get(content) or entered.target
        for reference in containments_of(cls, self._facts.metamodel):
            if reference != entered:
                held = self.emit_container(reference, self._statements.slots[content], cls)
                self._statements.append_refuse_unless(code.Operation("<", (held, ZERO)))

    def _entries(self) -> Iterator[tuple[int, int, MatchFrame]]:
        """Yield all objects that the rule or its blocks put into containers: content slot, container slot, frame."""
        for frame in self._statements.blocks.frames:
            for content, container in container_entries(frame.plan.operations, self._facts.metamodel):
                yield content, container, frame

    def _emit_room_check(self, reference: Reference, node: code.Expression, slot: int, *, forward: bool) -> None:
        """Emit code that refuses the rule if an object has the most targets allowed, or sources if not `forward`."""
        upper = reference.upper if forward else self._facts.metamodel.max_sources(reference)
        if upper is None:
            return
        sure = self._statements.has_certain_class(slot, reference.owner if forward else reference.target)
        one = (
            self._facts.links.only_other_end(reference, node, forward=forward, class_known=sure) if upper == 1 else None
        )
        if one is not None:
            self._statements.append_refuse_unless(code.Operation("<", (one, ZERO)))
        else:
            counted = emit_call(self._facts.links.emit_counter(reference, forward), node)
            self._statements.append_refuse_unless(code.Operation("<", (counted, code.Constant(upper))))

    def emit_set_target(self, change: SetTargets) -> None:
        """Emit code that sets the only target of an object, or removes it if the change has no value.

        If a single-valued opposite of the target is occupied, the former link is removed.
        """
        matches, links, reference = self._statements, self._facts.links, change.reference
        stored, same = links.column_of(reference)
        source = matches.slots[change.object]
        target = matches.slots[change.values[0]] if change.values else NOBODY
        old: code.Expression
        if stored.belongs_to_sources is same:
            old, guard = links.column_cell(
                stored, source, class_known=matches.has_certain_class(change.object, reference.owner)
            )

            def write() -> None:
                for test in guard:
                    matches.append_refuse_unless(test)
                if links.is_symmetric(reference):
                    self._emit_store(stored, old, NOBODY)
                self._emit_make_room(stored, reference, target)
                matches.append(code.Assign(old, target))  # type: ignore[arg-type]
                if links.is_symmetric(reference):
                    self._emit_store(stored, target, source)
        else:
            found = links.only_other_end(reference, source, forward=True, class_known=False)
            assert found is not None
            old = self._facts.new_local_for(ObjectType(""))
            matches.append(code.Assign(old, found))

            def write() -> None:
                self._emit_store(stored, old, NOBODY)
                self._emit_store(stored, target, source)

        matches.append(code.If(code.Operation("!=", (old, target)), matches.collect(write)))

    def emit_put(self, reference: Reference, container: int, content: int, *, replaces: bool = True) -> None:
        """Emit code that moves an object into a container. If it `replaces`, the former only content leaves.

        The rule is refused if the container is full, or is inside the object.
        """
        matches = self._statements
        self.emit_leave_container(content, reference, ())
        if reference.upper == 1 and replaces:
            self._emit_drop_targets(SetTargets(container, reference, (content,)))
        else:
            self._emit_room_check(reference, matches.slots[container], container, forward=True)
        self._emit_cycle_check(content, container, reference.target)
        (kept,) = self._link_cells(container, reference, content)
        for test in kept.guard:
            matches.append_refuse_unless(test)
        matches.append(code.Assign(kept.place, kept.linked_value))

    def emit_set_targets(self, change: SetTargets) -> None:
        """Emit code that replaces all targets of an object, also of a containment or of its opposite."""
        self._emit_drop_targets(change)
        self.emit_change_targets(ChangeTargets(change.object, change.reference, "+=", change.values))

    def _emit_drop_targets(self, change: SetTargets) -> None:
        """Emit code that removes the targets of an object that an assignment does not name."""
        block, reference, links = code.BodyBuilder(), change.reference, self._facts.links
        source, sure = (
            self._statements.slots[change.object],
            self._statements.has_certain_class(change.object, reference.owner),
        )
        target = links.emit_follow(block, reference, source, forward=True, class_known=sure)
        for value in change.values:
            block.open_test(code.Operation("!=", (target, self._statements.slots[value])))
        ends = (source, target), (target, source)
        for one, other in ends if links.is_symmetric(reference) else ends[:1]:
            kept = links.link_cell(reference, one, other, classes_known=(True, True))
            block.add(code.Assign(kept.place, kept.unlinked_value))
        self._statements.append(*block.finish_body())

    def emit_change_values(self, change: SetAttributeValues | AdjustAttribute) -> None:
        """Emit code that sets all values of a multi-valued attribute, or adds or removes one."""
        attribute, statements, links = change.attribute, self._statements, self._facts.links
        node, sure = statements.slots[change.object], statements.has_certain_class(change.object, attribute.owner)
        if isinstance(change, SetAttributeValues):
            statements.append(*emit_clear_attribute(self._facts, attribute, node, class_known=sure))
        for slot in change.values if isinstance(change, SetAttributeValues) else (change.value,):
            value = converted_value(statements.slots[slot], statements.frame.types.get(slot, attribute.type), attribute)
            cell = links.link_cell(attribute, node, value, classes_known=(sure, True))
            if isinstance(change, AdjustAttribute) and change.operator == "-=":
                held = code.emit_joined("and", cell.tests_linked, True)
                statements.append(code.If(held, (code.Assign(cell.place, cell.unlinked_value),)))
                continue
            for test in cell.guard:
                statements.append_fail_if(code.emit_not(test), "BEYOND")

            def write(cell: LinkCell = cell) -> None:
                if attribute.upper is not None:
                    counted = emit_call(links.emit_counter(attribute, forward=True), node)
                    statements.append_refuse_unless(code.Operation("<", (counted, code.Constant(attribute.upper))))
                statements.append(code.Assign(cell.place, cell.linked_value, "+="))

            made = statements.collect(write)
            statements.append(*([code.If(code.emit_not(cell.is_linked), made)] if attribute.unique else made))

    def emit_change_targets(self, change: ChangeTargets) -> None:
        """Emit code that adds or removes targets. An added target loses its former link of a single-valued opposite."""
        opposite = self._facts.metamodel.opposite(change.reference)
        for value in change.values:
            if change.operator == "-=":
                made = self._statements.collect(
                    lambda value=value: self.emit_unlink(RemoveLink(change.object, change.reference, value))  # type: ignore[misc]
                )
            elif held := self._facts.metamodel.containment_link(change.reference, change.object, value):
                missing = code.emit_not(self.emit_is_linked(change.object, change.reference, value))
                made = (code.If(missing, self._statements.collect(partial(self.emit_put, *held))),)
            elif opposite is not None and opposite.upper == 1:
                made = self._statements.collect(
                    lambda value=value: self.emit_set_target(SetTargets(value, opposite, (change.object,)))  # type: ignore[misc]
                )
            else:
                self.emit_link(AddLink(change.object, change.reference, value))
                continue
            there = code.Operation(">=", (self._statements.slots[value], ZERO))
            self._statements.append(*([code.If(there, made)] if value in self._statements.frame.types else made))

    def _emit_store(self, stored: LinkColumn, holder: code.Expression, other: code.Expression) -> None:
        """Emit code that stores `other` in the column's cell of an object, if the object is not -1."""
        place, _ = self._facts.links.column_cell(stored, holder, class_known=True)
        there = code.Operation(">=", (holder, ZERO))
        self._statements.append(code.If(there, (code.Assign(place, other),)))

    def _emit_make_room(self, stored: LinkColumn, reference: Reference, target: code.Expression) -> None:
        """Emit code that removes the former link to a target, if the reference has a single-valued opposite.

        If the opposite has another maximum, the code refuses the rule when the target has too many sources.
        """
        links, opposite = self._facts.links, self._facts.metamodel.opposite(reference)
        there = code.Operation(">=", (target, ZERO))
        if opposite is not None and opposite.upper == 1:
            holder = self._facts.new_local_for(ObjectType(""))
            held = links.only_other_end(reference, target, forward=False, class_known=False)
            assert held is not None
            self._statements.append(code.Assign(holder, code.ConditionalExpression(there, held, NOBODY)))
            self._emit_store(stored, holder, NOBODY)
        elif opposite is not None and opposite.upper is not None:
            counted = emit_call(links.emit_counter(reference, forward=False), target)
            few = code.Operation("<", (counted, code.Constant(opposite.upper)))
            self._statements.append_refuse_unless(code.Operation("or", (code.emit_not(there), few)))
