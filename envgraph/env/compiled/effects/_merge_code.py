"""Emit code that merges objects: the links of one object move to another, then the first is deleted."""

from __future__ import annotations

from collections.abc import Iterator

from envgraph import code
from envgraph.env.compiled.effects._containment_code import emit_clear_values, ends_of
from envgraph.env.compiled.effects._link_changes import LinkEmitter
from envgraph.env.compiled.effects._match_statements import MatchStatements
from envgraph.env.compiled.layout._program_layout import ONE, RI, TOP, ZERO, emit_entry, emit_error, emit_sum
from envgraph.env.compiled.matching._body_code import CAPACITY
from envgraph.metamodel import Reference
from envgraph.rewrite.plans import AddLink, MergeObjects, MoveToContainer, containments_of

OTHER_END = -1
"""Slot for the other end of a link that moves."""


class MergeEmitter:
    """An emitter of merges.

    The links of all objects to be merged are removed before any is merged, and stored as rows: the object, a number for
    the reference and direction of the link, and its other end. They follow the rows of the blocks.

    Args:
        matches: the match, and the statements that the code is added to.
        links: emits the changes of links.
    """

    def __init__(self, matches: MatchStatements, links: LinkEmitter) -> None:
        self._match, self._links, self._facts = matches, links, matches.facts
        self._count = self._facts.module.new_local("n")

    def emit_start(self) -> None:
        """Emit code that begins with no stored links."""
        if any(block.absorbs for block in self._match.plan.blocks):
            self._facts.module.record_levels(len(self._match.blocks.frames))
            self._facts.module.width = max(self._facts.module.width, 3)
            self._match.append(code.Assign(self._count, ZERO))

    def _cell(self, number: code.Expression, column: int) -> code.Subscript:
        before = code.Operation("*", (CAPACITY, code.Constant(len(self._match.blocks.frames) - 1)))
        return emit_entry(RI, emit_sum(TOP, before, number), column)

    def _ends(self, merge: MergeObjects) -> Iterator[tuple[int, Reference, bool]]:
        """Yield the references and directions of the links of a merged object, each with a number."""
        for reference, forward in ends_of(self._facts.metamodel, self._classes(merge)):
            yield 2 * reference.index + forward, reference, forward

    def _classes(self, merge: MergeObjects) -> tuple[str, ...]:
        return self._facts.metamodel.concrete_classes(self._match.frame.plan.classes[merge.absorbed] or "")

    def emit_strip(self, merge: MergeObjects) -> None:
        """Emit code that removes and stores all links of an object to be merged."""
        node = self._match.slots[merge.absorbed]
        for number, reference, forward in self._ends(merge):
            block = code.BodyBuilder()
            other, link = self._facts.links.loop_over_links(block, reference, node, forward=forward, class_known=False)
            full = code.Operation(">=", (self._count, CAPACITY))
            block.add(code.If(full, (emit_error("OVERFLOW"), self._match.error_return)))
            for column, value in enumerate((node, code.Constant(number), other)):
                block.add(code.Assign(self._cell(self._count, column), value))
            block.add(code.Assign(self._count, ONE, "+="), code.Assign(link.place, link.unlinked_value))
            self._match.append(*block.finish_body())

    def emit_merge(self, merge: MergeObjects) -> None:
        """Emit code that moves the stored links of an object to another one, and deletes the object.

        The rule is refused if both are one object, or if the model refuses a link. Nothing happens if another match
        has merged the object already.
        """
        kept, node = self._match.slots[merge.kept], self._match.slots[merge.absorbed]
        self._match.append_refuse_unless(code.Operation("!=", (kept, node)))
        alive = self._facts.emit_is_alive(node, self._match.frame.plan.classes[merge.absorbed] or "")
        assert alive is not None
        self._match.append_if(alive, lambda: self._emit_move(merge, kept, node))

    def _emit_move(self, merge: MergeObjects, kept: code.Expression, node: code.Expression) -> None:
        match, fresh = self._match, self._facts.module.new_local
        housed, number, other = fresh("h"), fresh("i"), fresh("v", "object")
        match.append(code.Assign(housed, ZERO))
        cls = match.frame.classes[merge.kept] or ""
        for reference in containments_of(cls, self._facts.metamodel):
            container = self._links.emit_container(reference, kept, cls)
            elsewhere = code.Operation(">=", (container, ZERO)), code.Operation("!=", (container, node))
            match.append(code.If(code.Operation("and", elsewhere), (code.Assign(housed, ONE),)))
        self.emit_strip(merge)  # an earlier merge may have moved links to this object
        match.slots[OTHER_END] = other
        body: list[code.Statement] = [code.Assign(other, self._cell(number, 2))]
        body.append(code.If(code.emit_equal(other, node), (code.Assign(other, kept),)))
        for kind, reference, forward in self._ends(merge):
            ends = (merge.kept, OTHER_END) if forward else (OTHER_END, merge.kept)
            link = AddLink(ends[0], reference, ends[1])
            moved = match.collect(lambda link=link: self._emit_link(link, merge.kept, housed))  # type: ignore[misc]
            body.append(code.If(code.emit_equal(self._cell(number, 1), code.Constant(kind)), moved))
        own = code.If(code.emit_equal(self._cell(number, 0), node), tuple(body))
        match.append(code.For(number, code.emit_call("range", self._count), (own,)))
        match.append(*emit_clear_values(self._facts, self._classes(merge), node))

    def _emit_link(self, link: AddLink, kept: int, housed: code.Local) -> None:
        """Emit code that adds a link of the merged object to the kept one, which stays in a container that it has."""
        match, reference = self._match, link.reference
        fits = [
            self._facts.emit_is_instance(match.slots[slot], cls)
            for slot, cls in ((link.source, reference.owner), (link.target, reference.target))
        ]
        tests = [*fits] if match.plan.is_spo else []
        held = self._facts.metamodel.containment_link(reference, link.source, link.target)
        if held is not None:
            tests.append(code.Operation("!=", (match.slots[link.source], match.slots[link.target])))
            tests += [code.emit_equal(housed, ZERO)] if held[2] == kept else []

        def write() -> None:
            for test in () if match.plan.is_spo else fits:
                match.append_refuse_unless(test)
            self._links.emit_link(link if held is None else MoveToContainer(held[2], held[1], held[0]))

        match.append_if(code.emit_joined("and", tests, True), write)
