"""Emit code that finds the matches of the blocks of a rule as rows, before the rule changes anything."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from envgraph import code
from envgraph.code import dataclass
from envgraph.env.compiled.layout._program_layout import (
    ONE,
    RF,
    RI,
    TOP,
    ZERO,
    emit_call,
    emit_entry,
    emit_error,
    emit_state_entry,
    emit_sum,
    emit_table_entry,
)
from envgraph.env.compiled.layout._symbols import CreatedCount, ReservedNumbers
from envgraph.env.compiled.matching._body_code import CAPACITY
from envgraph.env.compiled.matching._inlining import local_names
from envgraph.env.compiled.matching._match_emitter import MatchEmitter
from envgraph.env.compiled.matching._term_code import CodeTerm, emit_as_type
from envgraph.match.plan import PatternQuery
from envgraph.metamodel import Attribute, Scalar
from envgraph.pattern import ObjectType, StaticType
from envgraph.rewrite.plans import BlockPlan, RulePlan

Slots = dict[int, code.Expression]


@dataclass(slots=True, eq=False)
class MatchFrame:
    """The matches of a rule or of one of its blocks. A rule's match is in variables; a block's matches are rows.

    Attributes:
        outer: the frame of the enclosing block; None for the rule.
        slots: for the rule, the variables of its match; empty for blocks.
        types: types of the values in slots, if known.
        classes: classes of the objects in slots, if known.
        creators: for each slot of an object that is created, the frame that creates the object.
        row_count, first_row: variables for the number of rows, and for the first row.
        columns: the column of each slot that the outer frame lacks. The next column holds the outer row.
    """

    plan: BlockPlan
    outer: MatchFrame | None
    slots: Slots
    types: dict[int, StaticType | None]
    classes: dict[int, str | None]
    creators: dict[int, MatchFrame]
    row_count: code.Local
    first_row: code.Local
    columns: dict[int, int]

    def slot_cell(self, slot: int, row: code.Expression) -> code.Subscript:
        """Return the cell in which a row stores the value of a slot."""
        return emit_entry(RF if self.types.get(slot) is Scalar.FLOAT else RI, row, self.columns[slot])

    def converted_value(self, slots: Slots, slot: int, attribute: Attribute) -> code.Expression:
        """Return the value of a slot, converted to the type of an attribute."""
        return emit_as_type(CodeTerm(slots[slot], self.types.get(slot, attribute.type)), attribute.type)

    def outer_row_cell(self, row: code.Expression) -> code.Subscript:
        """Return the cell in which a block's row stores the row of the outer match in which it was found."""
        return emit_entry(RI, row, len(self.columns))


class BlockMatches:
    """An emitter of code that finds and reads the matches of the blocks of a rule.

    Args:
        matching: emits functions that find matches.
        error_return: the statement that ends the function if the row buffers are too small.

    Attributes:
        frames: the frames of the rule and of each block, in the order of the rule's text.
    """

    def __init__(self, matching: MatchEmitter, plan: RulePlan, slots: Slots, error_return: code.Return) -> None:
        self._matching, self._facts, self._module = matching, matching.facts, matching.module
        self._leave = error_return
        self.frames: list[MatchFrame] = []
        self._add_frame(plan.body, None, slots, dict(enumerate(plan.types)))

    def _add_frame(
        self, plan: BlockPlan, outer: MatchFrame | None, slots: Slots, types: dict[int, StaticType | None]
    ) -> None:
        classes: dict[int, str | None] = {} if outer is None else dict(outer.classes)
        classes.update({slot: cls for slot, cls in enumerate(plan.classes) if cls is not None})
        classes.update({new.node: new.cls for new in plan.creates})
        number, top = self._module.new_local("n"), self._module.new_local("t")
        own = {slot: column for column, slot in enumerate(range(plan.inherited_count, plan.slot_count))}
        frame = MatchFrame(plan, outer, slots, types, classes, {}, number, top, own)
        frame.creators.update({} if outer is None else outer.creators)
        frame.creators.update({new.node: frame for new in plan.creates})
        self.frames.append(frame)
        for inner in plan.nested:
            of_pattern = self._facts.library.parameter_types(inner.pattern)[len(inner.arguments) :]
            found = dict(enumerate(of_pattern, inner.inherited_count))
            self._add_frame(inner, frame, {}, {**types, **found})

    # --- reading rows

    def load_match(self, frame: MatchFrame, row: code.Expression) -> tuple[list[code.Statement], Slots]:
        """Return statements that read the match of a block and its outer blocks, and the expression of each slot."""
        if frame.outer is None:
            return [], frame.slots
        statements: list[code.Statement] = []
        slots: Slots = {}
        for slot in frame.columns:
            slots[slot] = local = self._facts.new_local_for(frame.types.get(slot) or ObjectType(""))
            statements.append(code.Assign(local, frame.slot_cell(slot, row)))
        above = self._module.new_local("r")
        more, outer = self.load_match(frame.outer, above)
        return [*statements, code.Assign(above, frame.outer_row_cell(row)), *more], {**outer, **slots}

    def loop_over_matches(
        self,
        frame: MatchFrame,
        row: code.Local,
        loads: Sequence[code.Statement],
        body: code.Body,
        within: tuple[code.Local, code.Local] | None = None,
    ) -> code.Body:
        """Return a loop that sets `row` to each match of a block, then runs `body` after the `loads` that it needs.

        Return `body` itself for the match of the rule. The matches of an outer match are consecutive: `within` has the
        variable for the outer row, and one for the number of matches before, which is 0 at first, and which the loop
        increases.
        """
        if frame.outer is None or not body:
            return body
        place, outer_row = within or (self._module.new_local("i"), None)
        there = code.Assign(row, emit_sum(frame.first_row, place))
        whole = (there, *self.needed_loads(loads, body), *body)
        if outer_row is None:
            return (code.For(place, code.emit_call("range", frame.row_count), whole),)
        held = code.emit_equal(frame.outer_row_cell(emit_sum(frame.first_row, place)), outer_row)
        left = code.Operation("and", (code.Operation("<", (place, frame.row_count)), held))
        return (code.While(left, (*whole, code.Assign(place, ONE, "+="))),)

    @staticmethod
    def needed_loads(loads: Sequence[code.Statement], body: Sequence[code.Statement]) -> list[code.Statement]:
        """Return the assignments of `loads` whose variables `body` uses, directly or through others, in order."""
        used = local_names(tuple(body))
        found: list[code.Statement] = []
        for statement in reversed(loads):
            assert isinstance(statement, code.Assign)
            if local_names(statement.target) & used:
                used |= local_names(statement.value)
                found.append(statement)
        return found[::-1]

    # --- finding rows

    def emit_search(self) -> Iterator[code.Statement]:
        """Yield statements that find the matches of all blocks, and give created objects their numbers."""
        rule, *blocks = self.frames
        yield from self._emit_numbering(rule, rule.slots, None)
        for place, frame in enumerate(blocks):
            yield code.Assign(frame.first_row, emit_sum(TOP, code.Operation("*", (CAPACITY, code.Constant(place)))))
            yield code.Assign(frame.row_count, ZERO)
        yield from self._emit_inner_blocks(rule, rule.slots, ZERO)

    def _emit_inner_blocks(
        self, outer: MatchFrame, slots: Slots, outer_row: code.Expression
    ) -> Iterator[code.Statement]:
        for frame in self.frames:
            if frame.outer is outer:
                yield from self._emit_matches(frame, slots, outer_row)

    def _emit_matches(
        self, frame: MatchFrame, slots: Mapping[int, code.Expression], outer_row: code.Expression
    ) -> Iterator[code.Statement]:
        """Yield statements that append a block's matches for one outer match, then the matches of its inner blocks."""
        plan, fresh = frame.plan, self._module.new_local
        types = self._facts.library.parameter_types(plan.pattern)
        taken = range(len(plan.arguments))
        outputs = tuple(range(len(taken), len(types)))
        key = PatternQuery(plan.pattern, tuple(taken), outputs)
        name = self._matching.emit_rows(key, self._arguments_fit(frame, types))
        last = len(self.frames) - 1
        self._module.record_call(name, last)
        self._module.width = max(self._module.width, len(frame.columns) + 1)
        space = emit_sum(TOP, code.Operation("*", (CAPACITY, code.Constant(last))))
        above, first, number, one, row = (fresh(prefix) for prefix in "tfnir")
        yield code.Assign(above, space)
        yield code.Assign(number, emit_call(name, *(slots[slot] for slot in plan.arguments), top=above))
        if plan.kind == "optional":
            yield code.Assign(number, code.emit_call("min", number, ONE))
        yield code.Assign(first, frame.row_count)
        room = code.Operation("<=", (emit_sum(frame.row_count, number), CAPACITY))
        yield code.If(code.emit_not(room), (emit_error("OVERFLOW"), self._leave))
        loads, values = self._matching.load_row(key, emit_sum(above, one))
        variables = range(plan.inherited_count, plan.inherited_count + plan.variable_count)
        stores = [code.Assign(frame.slot_cell(slot, row), value) for slot, value in zip(variables, values, strict=True)]
        there = code.Assign(row, emit_sum(frame.first_row, frame.row_count))
        ends = code.Assign(frame.outer_row_cell(row), outer_row), code.Assign(frame.row_count, ONE, "+=")
        yield code.For(one, code.emit_call("range", number), (*loads, there, *stores, *ends))
        reads, own = self.load_match(frame, row)
        body = [*self._emit_numbering(frame, own, row), *self._emit_inner_blocks(frame, own, row)]
        if body:
            there = code.Assign(row, emit_sum(frame.first_row, one))
            whole = (there, *self.needed_loads(reads, body), *body)
            yield code.For(one, code.emit_call("range", first, frame.row_count), whole)

    def _arguments_fit(self, frame: MatchFrame, types: Sequence[StaticType]) -> bool:
        """Return True if the objects passed to a block's pattern are known to be of its parameters' classes."""
        assert frame.outer is not None
        classes, is_a = frame.outer.classes, self._facts.metamodel.is_a
        return all(
            (cls := classes.get(slot)) is not None and is_a(cls, type_.cls)
            for slot, type_ in zip(frame.plan.arguments, types, strict=False)
            if isinstance(type_, ObjectType)
        )

    def _emit_numbering(self, frame: MatchFrame, slots: Slots, row: code.Expression | None) -> Iterator[code.Statement]:
        """Yield statements that give each created object an unused object number, or fail if all are used.

        They also store the number in the block's row. The variables for the objects are added to `slots`.
        """
        layout = self._facts.layout
        for new in frame.plan.creates:
            made, node = emit_state_entry(layout.offset(CreatedCount())), self._module.new_local("v")
            room = code.Operation("<", (made, emit_table_entry(layout.offset(ReservedNumbers("count")))))
            yield code.If(code.emit_not(room), (emit_error("FULL"), self._leave))
            yield code.Assign(node, emit_sum(emit_table_entry(layout.offset(ReservedNumbers("first"))), made))
            yield code.Assign(made, ONE, "+=")
            slots[new.node] = node
            if row is not None:
                yield code.Assign(frame.slot_cell(new.node, row), node)
