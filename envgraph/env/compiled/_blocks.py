"""Emit code that finds the matches of the blocks of a rule as rows, before the rule changes anything."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from envgraph import code
from envgraph.code import dataclass
from envgraph.env.compiled._bodies import CAPACITY
from envgraph.env.compiled._inlining import names_in
from envgraph.env.compiled._layout import ONE, RF, RI, TOP, ZERO, call, cell, entry, failed, plus, table
from envgraph.env.compiled._matching import Matching
from envgraph.env.compiled._tables import Made, Spare
from envgraph.match.plan import ViewKey
from envgraph.metamodel import Scalar
from envgraph.pattern import ObjectType, StaticType
from envgraph.rewrite.plans import BlockPlan, RulePlan

Slots = dict[int, code.Expression]


@dataclass(slots=True, eq=False)
class Frame:
    """The matches of a rule or of one of its blocks. A rule's match is in variables; a block's matches are rows.

    Attributes:
        outer: the frame of the enclosing block; None for the rule.
        slots: for the rule, the variables of its match; empty for blocks.
        types: types of the values in slots, if known.
        classes: classes of the objects in slots, if known.
        new: for each slot of an object that is created, the frame that creates the object.
        number, top: variables for the number of rows, and for the first row.
        columns: the column of each slot that the outer frame lacks. The next column holds the outer row.
    """

    plan: BlockPlan
    outer: Frame | None
    slots: Slots
    types: dict[int, StaticType | None]
    classes: dict[int, str | None]
    new: dict[int, Frame]
    number: code.Local
    top: code.Local
    columns: dict[int, int]

    def space(self, slot: int, row: code.Expression) -> code.Index:
        """Return the cell in which a row stores the value of a slot."""
        return entry(RF if self.types.get(slot) is Scalar.FLOAT else RI, row, self.columns[slot])

    def outer_row(self, row: code.Expression) -> code.Index:
        """Return the cell in which a block's row stores the row of the outer match in which it was found."""
        return entry(RI, row, len(self.columns))


class Blocks:
    """An emitter of code that finds and reads the matches of the blocks of a rule.

    Args:
        matching: emits functions that find matches.
        leave: the statement that ends the function if the row buffers are too small.

    Attributes:
        frames: the frames of the rule and of each block, in the order of the rule's text.
    """

    def __init__(self, matching: Matching, plan: RulePlan, slots: Slots, leave: code.Return) -> None:
        self._matching, self._facts, self._module = matching, matching.facts, matching.module
        self._leave = leave
        self.frames: list[Frame] = []
        self._add_frame(plan.body, None, slots, dict(enumerate(plan.types)))

    def _add_frame(
        self, plan: BlockPlan, outer: Frame | None, slots: Slots, types: dict[int, StaticType | None]
    ) -> None:
        classes: dict[int, str | None] = {} if outer is None else dict(outer.classes)
        classes.update({slot: cls for slot, cls in enumerate(plan.classes) if cls is not None})
        classes.update({new.node: new.cls for new in plan.creates})
        number, top = self._module.fresh("n"), self._module.fresh("t")
        own = {slot: column for column, slot in enumerate(range(plan.inherited, plan.slots))}
        frame = Frame(plan, outer, slots, types, classes, {}, number, top, own)
        frame.new.update({} if outer is None else outer.new)
        frame.new.update({new.node: frame for new in plan.creates})
        self.frames.append(frame)
        for inner in plan.nested:
            of_pattern = self._facts.library.parameter_types(inner.pattern)[len(inner.arguments) :]
            found = dict(enumerate(of_pattern, inner.inherited))
            self._add_frame(inner, frame, {}, {**types, **found})

    # --- reading rows

    def loaded(self, frame: Frame, row: code.Expression) -> tuple[list[code.Statement], Slots]:
        """Return statements that read the match of a block and its outer blocks, and the expression of each slot."""
        assert frame.outer is not None
        statements: list[code.Statement] = []
        slots: Slots = {}
        for slot in frame.columns:
            slots[slot] = local = self._facts.local(frame.types.get(slot) or ObjectType(""))
            statements.append(code.Assign(local, frame.space(slot, row)))
        if frame.outer.outer is None:
            return statements, {**frame.outer.slots, **slots}
        above = self._module.fresh("r")
        more, outer = self.loaded(frame.outer, above)
        return [*statements, code.Assign(above, frame.outer_row(row)), *more], {**outer, **slots}

    def each(
        self, frame: Frame, row: code.Local, loads: Sequence[code.Statement], body: Sequence[code.Statement]
    ) -> code.Statement:
        """Return a loop that sets `row` to each match of a block, then runs `body` after the `loads` that it needs."""
        place = self._module.fresh("i")
        there = code.Assign(row, plus(frame.top, place))
        return code.For(place, code.call("range", frame.number), (there, *self.needed(loads, body), *body))

    @staticmethod
    def needed(loads: Sequence[code.Statement], body: Sequence[code.Statement]) -> list[code.Statement]:
        """Return the assignments of `loads` whose variables `body` uses, directly or through others, in order."""
        used = names_in(tuple(body))
        found: list[code.Statement] = []
        for statement in reversed(loads):
            assert isinstance(statement, code.Assign)
            if names_in(statement.target) & used:
                used |= names_in(statement.value)
                found.append(statement)
        return found[::-1]

    # --- finding rows

    def collect(self) -> Iterator[code.Statement]:
        """Yield statements that find the matches of all blocks, and give created objects their numbers."""
        rule, *blocks = self.frames
        yield from self._numbered(rule, rule.slots, None)
        for place, frame in enumerate(blocks):
            yield code.Assign(frame.top, plus(TOP, code.Operation("*", (CAPACITY, code.Constant(place)))))
            yield code.Assign(frame.number, ZERO)
        yield from self._inside(rule, rule.slots, ZERO)

    def _inside(self, outer: Frame, slots: Slots, outer_row: code.Expression) -> Iterator[code.Statement]:
        for frame in self.frames:
            if frame.outer is outer:
                yield from self._found(frame, slots, outer_row)

    def _found(
        self, frame: Frame, slots: Mapping[int, code.Expression], outer_row: code.Expression
    ) -> Iterator[code.Statement]:
        """Yield statements that append a block's matches for one outer match, then the matches of its inner blocks."""
        plan, fresh = frame.plan, self._module.fresh
        types = self._facts.library.parameter_types(plan.pattern)
        taken = range(len(plan.arguments))
        outputs = tuple(range(len(taken), len(types)))
        key = ViewKey(plan.pattern, tuple(taken), outputs)
        name = self._matching.rows(key, self._suits(frame, types))
        last = len(self.frames) - 1
        self._module.uses(name, last)
        self._module.width = max(self._module.width, len(frame.columns) + 1)
        space = plus(TOP, code.Operation("*", (CAPACITY, code.Constant(last))))
        above, first, number, one, row = (fresh(prefix) for prefix in "tfnir")
        yield code.Assign(above, space)
        yield code.Assign(number, call(name, *(slots[slot] for slot in plan.arguments), top=above))
        if plan.kind == "optional":
            yield code.Assign(number, code.call("min", number, ONE))
        yield code.Assign(first, frame.number)
        room = code.Operation("<=", (plus(frame.number, number), CAPACITY))
        yield code.If(code.inverse(room), (failed("OVERFLOW"), self._leave))
        loads, values = self._matching.loaded(key, plus(above, one))
        variables = range(plan.inherited, plan.inherited + plan.variables)
        stores = [
            code.Assign(frame.space(slot, row), value) for slot, value in zip(variables, values, strict=True)
        ]
        yield code.For(
            one,
            code.call("range", number),
            (
                *loads,
                code.Assign(row, plus(frame.top, frame.number)),
                *stores,
                code.Assign(frame.outer_row(row), outer_row),
                code.Assign(frame.number, ONE, "+="),
            ),
        )
        reads, own = self.loaded(frame, row)
        body = [*self._numbered(frame, own, row), *self._inside(frame, own, row)]
        if body:
            there = code.Assign(row, plus(frame.top, one))
            whole = (there, *self.needed(reads, body), *body)
            yield code.For(one, code.call("range", first, frame.number), whole)

    def _suits(self, frame: Frame, types: Sequence[StaticType]) -> bool:
        """Return True if the objects passed to a block's pattern are known to be of its parameters' classes."""
        assert frame.outer is not None
        classes, is_a = frame.outer.classes, self._facts.metamodel.is_a
        return all(
            (cls := classes.get(slot)) is not None and is_a(cls, type_.cls)
            for slot, type_ in zip(frame.plan.arguments, types, strict=False)
            if isinstance(type_, ObjectType)
        )

    def _numbered(self, frame: Frame, slots: Slots, row: code.Expression | None) -> Iterator[code.Statement]:
        """Yield statements that give each created object an unused object number, or fail if all are used.

        They also store the number in the block's row. The variables for the objects are added to `slots`.
        """
        layout = self._facts.layout
        for new in frame.plan.creates:
            made, node = cell(layout.offset(Made())), self._facts.local(ObjectType(new.cls))
            room = code.Operation("<", (made, table(layout.offset(Spare("count")))))
            yield code.If(code.inverse(room), (failed("FULL"), self._leave))
            yield code.Assign(node, plus(table(layout.offset(Spare("first"))), made))
            yield code.Assign(made, ONE, "+=")
            slots[new.node] = node
            if row is not None:
                yield code.Assign(frame.space(new.node, row), node)
