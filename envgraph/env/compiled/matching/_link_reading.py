"""Emit code that reads links from tables, from a cell for each object at one end, or from a cell for each pair."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from envgraph import code
from envgraph.code import dataclass
from envgraph.env.compiled.layout._program_layout import (
    NOBODY,
    ONE,
    ZERO,
    emit_call,
    emit_state_entry,
    emit_sum,
    emit_table_entry,
)
from envgraph.env.compiled.layout._relations import FeatureRows, column_types, split_key_columns
from envgraph.env.compiled.layout._symbols import AtMostOneRow, LinkColumn, LinkMatrix, ValueTable
from envgraph.match.plan import LiveSizes
from envgraph.metamodel import Attribute, Reference
from envgraph.pattern import ObjectType

if TYPE_CHECKING:
    from envgraph.env.compiled.matching._model_reading import ModelReader


@dataclass(frozen=True, slots=True)
class LinkCell:
    """The cell that stores a link.

    Attributes:
        linked_value, unlinked_value: its value if the link exists, and if not.
        guard: tests that must hold before the cell is read.
    """

    place: code.Subscript
    linked_value: code.Expression
    unlinked_value: code.Expression
    guard: Sequence[code.Expression] = ()

    @property
    def is_linked(self) -> code.Expression:
        """Return the test that the link exists, to be made after those of `guard`. Cells of matrices are counts."""
        return code.Operation(">=" if self.linked_value is ONE else "==", (self.place, self.linked_value))

    @property
    def tests_linked(self) -> list[code.Expression]:
        """Return the tests that all hold exactly if the link exists, in the order in which they have to be made."""
        return [*self.guard, self.is_linked]


class LinkReader:
    """An emitter of code that reads links.

    Args:
        facts: reads the rest of the model.
        sizes: the numbers of objects in the domain's own model.
    """

    def __init__(self, facts: ModelReader, sizes: LiveSizes) -> None:
        self._facts = facts
        self._sizes = sizes

    def storage_of(self, reference: Reference | Attribute) -> tuple[LinkColumn | LinkMatrix, bool]:
        """Return the storage of a changing reference's links, and True unless it belongs to the opposite reference.

        A reference and its opposite share their storage. If it is its own opposite, both directions are stored. A
        multi-valued attribute that rules set is like a reference to values.
        """
        metamodel = self._facts.metamodel
        if isinstance(reference, Attribute):
            domain = self._facts.changes.domains[reference.index]
            return LinkMatrix(reference, self._facts.changes.possible_classes(reference.owner), domain), True
        opposite = metamodel.opposite(reference)
        if opposite is not None and opposite.index < reference.index:
            return self.storage_of(opposite)[0], False
        ends = [self._facts.changes.possible_classes(end) for end in (reference.owner, reference.target)]
        one_source = self._has_at_most_one(reference, forward=False)
        if reference.many and not one_source:
            return LinkMatrix(reference, *ends), True
        source, target = self._sizes.extent_size(reference.owner), self._sizes.extent_size(reference.target)
        at_source = not reference.many and (not one_source or source <= target)
        return LinkColumn(reference, at_source, ends[not at_source]), True

    def is_symmetric(self, reference: Reference | Attribute) -> bool:
        """Return True if a reference is its own opposite."""
        return isinstance(reference, Reference) and self._facts.metamodel.opposite(reference) == reference

    def has_own_cell(self, reference: Reference | Attribute, forward: bool) -> bool:
        """Return True if links are stored in a cell of each source, or of each target if not `forward`."""
        kept, same = self.storage_of(reference)
        return isinstance(kept, LinkColumn) and kept.belongs_to_sources is (forward is same)

    def link_cell(
        self,
        reference: Reference | Attribute,
        source: code.Expression,
        target: code.Expression,
        *,
        classes_known: tuple[bool, bool],
    ) -> LinkCell:
        """Return the cell of a link between two objects; `classes_known` if they are known to be of the classes at the
        ends.
        """
        kept, same = self.storage_of(reference)
        if isinstance(kept, LinkColumn):
            at_source = kept.belongs_to_sources is same
            holder, other = (source, target) if at_source else (target, source)
            place, guard = self.column_cell(kept, holder, class_known=classes_known[not at_source])
            return LinkCell(place, other, NOBODY, guard)
        ends = [(source, classes_known[0]), (target, classes_known[1])]
        (first, first_sure), (second, second_sure) = ends if same else ends[::-1]
        row, guard = self._facts.emit_object_index(kept.sources, first, class_known=first_sure)
        column, more = self._facts.emit_object_index(kept.targets, second, class_known=second_sure)
        return LinkCell(self._pair_cell(kept, row, column), ONE, ZERO, [*guard, *more])

    def column_cell(
        self, column: LinkColumn, node: code.Expression, *, class_known: bool
    ) -> tuple[code.Subscript, list[code.Expression]]:
        """Return an object's cell in a column of links, and the tests to make before the cell is read."""
        place, guard = self._facts.emit_object_index(column.classes, node, class_known=class_known)
        return emit_state_entry(emit_sum(self._facts.layout.offset(column), place)), guard

    def _pair_cell(self, matrix: LinkMatrix, row: code.Expression, column: code.Expression) -> code.Subscript:
        before = code.Operation("*", (row, self._facts.emit_object_count(matrix.targets)))
        return emit_state_entry(emit_sum(self._facts.layout.offset(matrix), before, column))

    # --- following links

    def loop_over_links(
        self,
        block: code.BodyBuilder,
        reference: Reference | Attribute,
        node: code.Expression,
        *,
        forward: bool,
        class_known: bool,
    ) -> tuple[code.Local, LinkCell]:
        """Emit a loop over an object's targets, or its sources if not `forward`. Return the variable and link cell."""
        facts, (kept, same) = self._facts, self.storage_of(reference)
        if isinstance(kept, LinkColumn) and self.has_own_cell(reference, forward):
            cell, guard = self.column_cell(kept, node, class_known=class_known)
            for test in guard:
                block.open_test(test)
            only = facts.new_local_for(ObjectType(""))
            block.add(code.Assign(only, cell))
            block.open_test(facts.emit_is_present(only, ObjectType("")))
            return only, LinkCell(cell, only, NOBODY)
        if isinstance(kept, LinkColumn):
            other, place = facts.emit_loop_over_group(block, kept.classes)
            found = LinkCell(emit_state_entry(emit_sum(facts.layout.offset(kept), place)), node, NOBODY)
        else:
            begins = forward is same
            near, far = (kept.sources, kept.targets) if begins else (kept.targets, kept.sources)
            here, guard = facts.emit_object_index(near, node, class_known=class_known)
            for test in guard:
                block.open_test(test)
            other, there = facts.emit_loop_over_group(block, far)
            places = (here, there) if begins else (there, here)
            found = LinkCell(self._pair_cell(kept, *places), ONE, ZERO)
        block.open_test(found.is_linked)
        return other, found

    def emit_follow(
        self,
        block: code.BodyBuilder,
        reference: Reference | Attribute,
        node: code.Expression,
        *,
        forward: bool,
        class_known: bool,
    ) -> code.Local:
        """Emit code that runs later statements for each target of an object, or each source if not `forward`.

        Returns the variable for the target or source.
        """
        found = self.only_other_end(reference, node, forward=forward, class_known=class_known)
        if found is None:
            return self.loop_over_links(block, reference, node, forward=forward, class_known=class_known)[0]
        local = self._facts.new_local_for(ObjectType(""))
        block.add(code.Assign(local, found))
        block.open_test(self._facts.emit_is_present(local, ObjectType("")))
        return local

    def only_other_end(
        self, reference: Reference | Attribute, node: code.Expression, *, forward: bool, class_known: bool
    ) -> code.Expression | None:
        """Return code for an object's only target, or its only source if not `forward`. The code yields -1 for none.

        Returns None if an object may have several.
        """
        facts = self._facts
        if facts.changes.is_fixed_feature(reference):
            near, far = (0, 1) if forward else (1, 0)
            keys, _ = split_key_columns(FeatureRows(reference), facts.library, (near,))
            if not facts.layout.assumes_functional(AtMostOneRow(keys, (far,))):
                return None
            values = ValueTable(keys, far, (far,), column_types(FeatureRows(reference), facts.library)[far])
            return emit_table_entry(emit_sum(facts.layout.offset(values), node))
        kept, _ = self.storage_of(reference)
        own = self.has_own_cell(reference, forward) or self.is_symmetric(reference)
        if isinstance(kept, LinkColumn) and own:
            place, guard = self.column_cell(kept, node, class_known=class_known)
            return code.ConditionalExpression(guard[0], place, NOBODY) if guard else place
        if not self._has_at_most_one(reference, forward):
            return None
        return emit_call(self._emit_finder(reference, forward), node)

    def _has_at_most_one(self, reference: Reference | Attribute, forward: bool) -> bool:
        """Return True if an object has at most one target, or at most one source if not `forward`."""
        if isinstance(reference, Attribute):
            return False
        return (reference.upper if forward else self._facts.metamodel.max_sources(reference)) == 1

    def _emit_finder(self, reference: Reference | Attribute, forward: bool) -> str:
        """Emit a function that finds the object whose cell stores a given object, or -1 for none. Return its name."""

        def write() -> tuple[Sequence[code.Local], code.Body]:
            block, wanted = code.BodyBuilder(), self._facts.module.new_local("v", "object")
            block.add(
                code.Return(self.loop_over_links(block, reference, wanted, forward=forward, class_known=False)[0])
            )
            return [wanted], (*block.finish_body(), code.Return(NOBODY))

        return self._facts.module.function_for(("find", self.storage_of(reference)[0]), "find", write)

    def emit_counter(self, reference: Reference | Attribute, forward: bool) -> str:
        """Emit a function that counts an object's targets, or its sources if not `forward`. Return its name."""
        kept, same = self.storage_of(reference)

        def write() -> tuple[Sequence[code.Local], code.Body]:
            block, wanted = code.BodyBuilder(), self._facts.module.new_local("v", "object")
            number = code.Local("n", "int")
            _, found = self.loop_over_links(block, reference, wanted, forward=forward, class_known=False)
            block.add(code.Assign(number, found.place if found.linked_value is ONE else ONE, "+="))
            return [wanted], (code.Assign(number, ZERO), *block.finish_body(), code.Return(number))

        return self._facts.module.function_for(("partners", kept, forward is same), "partners", write)
