"""Emit code that reads links from tables, from a cell for each object at one end, or from a cell for each pair."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from envgraph import code
from envgraph.code import dataclass
from envgraph.env.compiled._layout import NOBODY, ONE, ZERO, call, cell, plus, table
from envgraph.env.compiled._tables import LinkColumn, LinkMatrix, Links, One, Values, keys_of
from envgraph.match.plan import LiveSizes
from envgraph.metamodel import Reference
from envgraph.pattern import ObjectType

if TYPE_CHECKING:
    from envgraph.env.compiled._facts import Facts


@dataclass(frozen=True, slots=True)
class LinkCell:
    """The cell that stores a link.

    Attributes:
        linked, unlinked: its value if the link exists, and if not.
        guard: tests that must hold before the cell is read.
    """

    place: code.Index
    linked: code.Expression
    unlinked: code.Expression
    guard: Sequence[code.Expression] = ()

    @property
    def tests(self) -> list[code.Expression]:
        """Return the tests that all hold exactly if the link exists, in the order in which they have to be made."""
        return [*self.guard, code.equal(self.place, self.linked)]


class Connections:
    """An emitter of code that reads links.

    Args:
        facts: reads the rest of the model.
        sizes: the numbers of objects in the domain's own model.
    """

    def __init__(self, facts: Facts, sizes: LiveSizes) -> None:
        self._facts = facts
        self._sizes = sizes

    def kept(self, reference: Reference) -> tuple[LinkColumn | LinkMatrix, bool]:
        """Return the storage of a changing reference's links, and True unless it belongs to the opposite reference.

        A reference and its opposite share their storage. If it is its own opposite, both directions are stored.
        """
        metamodel = self._facts.metamodel
        opposite = metamodel.opposite(reference)
        if opposite is not None and opposite.index < reference.index:
            return self.kept(opposite)[0], False
        ends = [self._facts.changes.becoming(end) for end in (reference.owner, reference.target)]
        one_source = self._one(reference, forward=False)
        if reference.many and not one_source:
            return LinkMatrix(reference, *ends), True
        source, target = self._sizes.extent(reference.owner), self._sizes.extent(reference.target)
        at_source = not reference.many and (not one_source or source <= target)
        return LinkColumn(reference, at_source, ends[not at_source]), True

    def symmetric(self, reference: Reference) -> bool:
        """Return True if a reference is its own opposite."""
        return self._facts.metamodel.opposite(reference) == reference

    def column(self, reference: Reference) -> tuple[LinkColumn, bool]:
        """Return the same as `kept`, for a reference whose links are stored in a column and not in a matrix."""
        kept, same = self.kept(reference)
        assert isinstance(kept, LinkColumn)
        return kept, same

    def cell(
        self,
        reference: Reference,
        source: code.Expression,
        target: code.Expression,
        *,
        sure: tuple[bool, bool],
    ) -> LinkCell:
        """Return the cell of a link between two objects; `sure` if they are known to be of the classes at the ends."""
        kept, same = self.kept(reference)
        if isinstance(kept, LinkColumn):
            at_source = kept.at_source is same
            holder, other = (source, target) if at_source else (target, source)
            place, guard = self.near(kept, holder, sure=sure[not at_source])
            return LinkCell(place, other, NOBODY, guard)
        ends = [(source, sure[0]), (target, sure[1])]
        (first, first_sure), (second, second_sure) = ends if same else ends[::-1]
        row, guard = self._facts.place(kept.sources, first, sure=first_sure)
        column, more = self._facts.place(kept.targets, second, sure=second_sure)
        return LinkCell(self._pair(kept, row, column), ONE, ZERO, [*guard, *more])

    def near(
        self, column: LinkColumn, node: code.Expression, *, sure: bool
    ) -> tuple[code.Index, list[code.Expression]]:
        """Return an object's cell in a column of links, and the tests to make before the cell is read."""
        place, guard = self._facts.place(column.classes, node, sure=sure)
        return cell(plus(self._facts.layout.offset(column), place)), guard

    def _pair(self, matrix: LinkMatrix, row: code.Expression, column: code.Expression) -> code.Index:
        before = code.Operation("*", (row, self._facts.count(matrix.targets)))
        return cell(plus(self._facts.layout.offset(matrix), before, column))

    # --- following links

    def each(
        self, block: code.Block, reference: Reference, node: code.Expression, *, forward: bool, sure: bool
    ) -> tuple[code.Local, LinkCell]:
        """Emit a loop over an object's targets, or its sources if not `forward`. Return the variable and link cell.

        Call only where `other_end` is None, or where links are stored at the other end.
        """
        facts, (kept, same) = self._facts, self.kept(reference)
        if isinstance(kept, LinkColumn):
            other, place = facts.each(block, kept.classes)
            found = LinkCell(cell(plus(facts.layout.offset(kept), place)), node, NOBODY)
        else:
            begins = forward is same
            near, far = (kept.sources, kept.targets) if begins else (kept.targets, kept.sources)
            here, guard = facts.place(near, node, sure=sure)
            for test in guard:
                block.test(test)
            other, there = facts.each(block, far)
            places = (here, there) if begins else (there, here)
            found = LinkCell(self._pair(kept, *places), ONE, ZERO)
        block.test(code.equal(found.place, found.linked))
        return other, found

    def follow(
        self, block: code.Block, reference: Reference, node: code.Expression, *, forward: bool, sure: bool
    ) -> code.Local:
        """Emit code that runs later statements for each target of an object, or each source if not `forward`.

        Returns the variable for the target or source.
        """
        found = self.other_end(reference, node, forward=forward, sure=sure)
        if found is None:
            return self.each(block, reference, node, forward=forward, sure=sure)[0]
        local = self._facts.local(ObjectType(""))
        block.add(code.Assign(local, found))
        block.test(self._facts.present(local, ObjectType("")))
        return local

    def other_end(
        self, reference: Reference, node: code.Expression, *, forward: bool, sure: bool
    ) -> code.Expression | None:
        """Return code for an object's only target, or its only source if not `forward`. The code yields -1 for none.

        Returns None if an object may have several.
        """
        facts = self._facts
        if facts.changes.fixed_feature(reference):
            near, far = (0, 1) if forward else (1, 0)
            keys, _ = keys_of(Links(reference), facts.library, (near,))
            if not facts.layout.functional(One(keys, (far,))):
                return None
            values = Values(keys, far, (far,), Links(reference).types(facts.library)[far])
            return table(plus(facts.layout.offset(values), node))
        kept, same = self.kept(reference)
        if isinstance(kept, LinkColumn) and (
            kept.at_source is (forward is same) or self.symmetric(reference)
        ):
            place, guard = self.near(kept, node, sure=sure)
            return code.Choice(guard[0], place, NOBODY) if guard else place
        if not self._one(reference, forward):
            return None
        return call(self._finder(reference, forward), node)

    def _one(self, reference: Reference, forward: bool) -> bool:
        """Return True if an object has at most one target, or at most one source if not `forward`."""
        return (reference.upper if forward else self._facts.metamodel.most_sources(reference)) == 1

    def _finder(self, reference: Reference, forward: bool) -> str:
        """Emit a function that finds the object whose cell stores a given object, or -1 for none. Return its name."""

        def write() -> tuple[Sequence[code.Local], code.Body]:
            block, wanted = code.Block(), self._facts.module.fresh("v", "object")
            block.add(code.Return(self.each(block, reference, wanted, forward=forward, sure=False)[0]))
            return [wanted], (*block.body(), code.Return(NOBODY))

        return self._facts.module.once(("find", self.kept(reference)[0]), "find", write)

    def counter(self, reference: Reference, forward: bool) -> str:
        """Emit a function that counts an object's targets, or its sources if not `forward`. Return its name."""
        kept, same = self.kept(reference)

        def write() -> tuple[Sequence[code.Local], code.Body]:
            block, wanted = code.Block(), self._facts.module.fresh("v", "object")
            number = code.Local("n", "int")
            self.each(block, reference, wanted, forward=forward, sure=False)
            block.add(code.Assign(number, ONE, "+="))
            return [wanted], (code.Assign(number, ZERO), *block.body(), code.Return(number))

        return self._facts.module.once(("partners", kept, forward is same), "partners", write)
