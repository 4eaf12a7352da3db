"""Emit code that reads the model: from tables if no rule changes the value, else from the state."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import count

from envgraph import code
from envgraph.code import dataclass
from envgraph.env.compiled.layout._member_data import emit_missing_value, missing_value
from envgraph.env.compiled.layout._model_changes import ModelChanges
from envgraph.env.compiled.layout._program_layout import (
    STATE,
    G,
    ProgramLayout,
    T,
    emit_bit_test,
    emit_state_entry,
    emit_sum,
    emit_table_entry,
    emit_value_entry,
)
from envgraph.env.compiled.layout._relations import (
    ClassInstances,
    FeatureRows,
    KeyColumns,
    StaticRelation,
    column_types,
    split_key_columns,
)
from envgraph.env.compiled.layout._symbols import (
    WORD_BITS,
    AtMostOneRow,
    AttributeColumn,
    BitSetTable,
    BitTable,
    ClassSet,
    ExtentTable,
    GroupedValues,
    GroupStarts,
    ValueDomain,
    ValueTable,
)
from envgraph.env.compiled.matching._link_reading import LinkReader
from envgraph.match.plan import LiveSizes
from envgraph.metamodel import Attribute, Reference, Scalar
from envgraph.pattern import Library, StaticType

SHIFT = code.Constant(5)
"""Shifting a place in a class set by this gives the index of its word."""


class ProgramModule:
    """The functions of a program; each is after those that it calls.

    Functions store matches as rows in the row buffers, which consist of regions of `CAPACITY` rows.

    Attributes:
        functions: the functions.
        levels: for each function, the number of regions of the row buffers that it may use.
        width: number of columns of the widest row.
    """

    def __init__(self) -> None:
        self.functions: list[code.Function] = []
        self.levels: dict[str, int] = {}
        self.width = 1
        self._open: list[int] = []
        self._names: dict[object, str] = {}
        self._fresh = count()

    def new_local(self, prefix: str, type_: str = "int") -> code.Local:
        """Return a local variable with a new name that starts with `prefix`."""
        return code.Local(f"{prefix}{next(self._fresh)}", type_)

    def add_function(self, prefix: str, parameters: Sequence[code.Local], body: code.Body) -> str:
        """Add a function with the state and `parameters` as its parameters, and return the function's name."""
        name = f"{prefix}{len(self.functions)}"
        self.functions.append(code.Function(name, (*STATE, *parameters), body))
        self.levels[name] = self._open[-1]
        return name

    @contextmanager
    def emitting_function(self) -> Iterator[None]:
        """Return a context for emitting a function, which counts the regions of the row buffers that this needs."""
        self._open.append(1)
        yield
        self._open.pop()

    def record_call(self, name: str, above: int) -> None:
        """Record that the current function calls another, whose rows begin `above` regions behind its own rows."""
        self.record_levels(above + self.levels[name])

    def record_levels(self, levels: int) -> None:
        """Record that the current function uses at least `levels` regions of the row buffers."""
        self._open[-1] = max(self._open[-1], levels)

    def function_for(
        self, key: object, prefix: str, write: Callable[[], tuple[Sequence[code.Local], code.Body]]
    ) -> str:
        """Return the name of the function for `key`. The first call emits its parameters and body with `write`."""
        if key not in self._names:
            with self.emitting_function():
                self._names[key] = self.add_function(prefix, *write())
        return self._names[key]


@dataclass(frozen=True, slots=True)
class SetWord:
    """A word of a bit set over the objects of a group of classes; `number` is the word's index in the bit set."""

    group: tuple[str, ...]
    word: code.Local
    number: code.Local


class ModelReader:
    """An emitter of code that reads the model. Emitted loops enclose all later statements of their block.

    Args:
        module: receives functions.
        layout: receives tables and columns.
        changes: made by the rules.
        library: the patterns.
        sizes: the numbers of objects in the domain's own model.
    """

    def __init__(
        self,
        module: ProgramModule,
        layout: ProgramLayout,
        changes: ModelChanges,
        library: Library,
        sizes: LiveSizes,
    ) -> None:
        self.module = module
        self.layout = layout
        self.changes = changes
        self.library = library
        self.metamodel = library.metamodel
        self.links = LinkReader(self, sizes)

    # --- what no rule changes

    def emit_row_loop(
        self,
        block: code.BodyBuilder,
        relation: StaticRelation,
        bound: Mapping[int, code.Expression],
        wanted: Sequence[int] = (),
    ) -> dict[int, code.Local]:
        """Emit code that runs later statements for each row of a static relation with the bound values.

        If no positions are wanted, the code only tests if a row exists.

        Returns:
            The variables that hold the values at the wanted positions.
        """
        keys, rest = split_key_columns(relation, self.library, tuple(bound))
        place = self._row_index(keys, bound)
        shown = tuple(sorted({*rest, *wanted}))
        if not shown:
            offset = self.layout.offset(BitTable(keys))
            word = emit_table_entry(emit_sum(offset, code.Operation(">>", (place, SHIFT))))
            block.open_test(emit_bit_test(word, place))
            return {}
        types = column_types(relation, self.library)
        found = {position: self.new_local_for(types[position]) for position in shown}
        if self.layout.assumes_functional(AtMostOneRow(keys, shown)):
            for position, local in found.items():
                values = ValueTable(keys, position, shown, types[position])
                block.add(code.Assign(local, emit_value_entry(self.layout, values, place)))
            first = shown[0]
            block.open_test(self.emit_is_present(found[first], types[first]))
        else:
            starts = self.layout.offset(GroupStarts(keys, shown))
            begin, end, row = (self.module.new_local("i") for _ in range(3))
            block.add(code.Assign(begin, emit_table_entry(emit_sum(starts, place))))
            block.add(code.Assign(end, emit_table_entry(emit_sum(starts, place, 1))))
            block.open_loop(row, code.emit_call("range", begin, end))
            for position, local in found.items():
                listed = GroupedValues(keys, shown, position, types[position])
                block.add(code.Assign(local, emit_value_entry(self.layout, listed, row)))
        for position in rest:
            block.open_test(code.emit_equal(found[position], bound[position]))
        return {position: found[position] for position in wanted}

    def _row_index(self, keys: KeyColumns, bound: Mapping[int, code.Expression]) -> code.Expression:
        place: code.Expression | None = None
        for position, width in zip(keys.positions, keys.widths, strict=True):
            size = code.Constant(width) if width else self.layout.stride()
            scaled = () if place is None else (code.Operation("*", (place, size)),)
            place = emit_sum(*scaled, bound[position])
        return code.Constant(0) if place is None else place

    def new_local_for(self, type_: StaticType) -> code.Local:
        """Return a new variable for a value of a type."""
        return self.module.new_local("v", "float" if type_ is Scalar.FLOAT else "int")

    @staticmethod
    def emit_is_present(value: code.Expression, type_: StaticType) -> code.Expression:
        """Return code that tests if a value is not missing."""
        if type_ is Scalar.FLOAT:
            return code.emit_equal(value, value)
        if type_ is Scalar.INT:
            return code.Operation("!=", (value, code.Constant(missing_value(type_))))
        return code.Operation(">=", (value, code.Constant(0)))

    # --- classes

    def emit_is_instance(self, node: code.Expression, cls: str, exact: bool = False) -> code.Expression:
        """Return code that tests if an object is of a class. `exact` excludes subclasses."""
        if self.changes.is_fixed_class(cls, exact):
            block = code.BodyBuilder()
            self.emit_row_loop(block, ClassInstances(cls, exact), {0: node})
            return block.pending_tests[0][0]
        classes = (cls,) if exact else self.metamodel.concrete_classes(cls)
        tests = []
        for group in self.changes.groups:
            place, guard = self.emit_object_index(group, node, class_known=False)
            inside = [self.emit_is_in_set(group, one, place) for one in classes if one in group]
            if inside:
                tests.append(code.emit_joined("and", [*guard, code.emit_joined("or", inside, False)], True))
        for one in classes:
            if self.changes.group_of(one) is None:
                tests.append(self.emit_is_instance(node, one, exact=True))
        return code.emit_joined("or", tests, False)

    def emit_is_alive(self, node: code.Expression, cls: str) -> code.Expression | None:
        """Return code that tests if an object of a class is not deleted; None if such objects are never deleted."""
        if not any(self.metamodel.may_overlap(cls, one) for one in self.changes.deleted):
            return None
        tests: list[code.Expression] = []
        for group in self.changes.groups:
            if not self.changes.deleted.isdisjoint(group):
                place, (there,) = self.emit_object_index(group, node, class_known=False)
                inside = [self.emit_is_in_set(group, one, place) for one in group]
                tests.append(code.emit_joined("or", [code.emit_not(there), *inside], True))
        return code.emit_joined("and", tests, True)

    def emit_is_in_set(self, group: tuple[str, ...], cls: str, place: code.Expression) -> code.Expression:
        """Return code that tests if an object is in a class set of a group, by the object's index in the group."""
        offset = self.layout.offset(ClassSet(group, cls))
        word = emit_state_entry(emit_sum(offset, code.Operation(">>", (place, SHIFT))))
        return emit_bit_test(word, place)

    def emit_object_index(
        self, classes: tuple[str, ...] | ValueDomain, node: code.Expression, *, class_known: bool
    ) -> tuple[code.Expression, list[code.Expression]]:
        """Return code for an object's index among those of some classes, and tests that it has one (none if
        `class_known`). For a value, the index is that among the values of a domain.
        """
        if isinstance(classes, ValueDomain):
            if not classes.is_of_numbers:
                return node, []
            values, count = ExtentTable(classes, "objects"), self.emit_object_count(classes)
            first = self.layout.offset(values)
            rank = code.emit_call("place_of", G if values.is_float else T, first, count, node)
            return rank, [code.Operation(">=", (rank, code.Constant(0)))]
        found = emit_table_entry(emit_sum(self.layout.offset(ExtentTable(classes, "places")), node))
        guard: list[code.Expression] = [] if class_known else [code.Operation(">=", (found, code.Constant(0)))]
        return (code.Constant(0) if self.layout.assume_single(classes) else found), guard

    def emit_loop_over_group(
        self, block: code.BodyBuilder, classes: tuple[str, ...] | ValueDomain
    ) -> tuple[code.Local, code.Expression]:
        """Emit a loop over the objects that may be of some classes, or over the values of a domain.

        Return the variable, and the index of the object or value.
        """
        listed = ExtentTable(classes, "objects")
        node, holders = self.module.new_local("v", "float" if listed.is_float else "object"), self.layout.offset(listed)
        if self.layout.assume_single(classes):
            block.open_test(code.Operation(">", (self.emit_object_count(classes), code.Constant(0))))
            block.add(code.Assign(node, emit_table_entry(holders, listed.is_float)))
            return node, code.Constant(0)
        place = self.module.new_local("i")
        block.open_loop(place, code.emit_call("range", self.emit_object_count(classes)))
        block.add(code.Assign(node, emit_table_entry(emit_sum(holders, place), listed.is_float)))
        return node, place

    def emit_object_count(self, classes: tuple[str, ...] | ValueDomain) -> code.Expression:
        return emit_table_entry(self.layout.offset(ExtentTable(classes, "count")))

    def emit_instance_loop(self, block: code.BodyBuilder, cls: str, exact: bool = False) -> code.Local:
        """Emit a loop over the objects of a class, without those of subclasses if `exact`. Return the variable."""
        classes = (cls,) if exact else self.metamodel.concrete_classes(cls)
        if self.changes.is_fixed_class(cls, exact):
            return self.emit_loop_over_group(block, classes)[0]
        sets = self.class_sets(cls, exact)
        if sets is not None:
            return self.emit_bit_loop(block, self.emit_word_loop(block, sets))
        wider = self.changes.possible_classes(cls) if not exact else self.changes.group_of(cls) or (cls,)
        node, _ = self.emit_loop_over_group(block, wider)
        block.open_test(self.emit_is_instance(node, cls, exact))
        return node

    def class_sets(self, cls: str, exact: bool) -> tuple[ClassSet, ...] | None:
        """Return the bit sets whose union is the extent of a class; None if its classes are not all of one group."""
        classes = (cls,) if exact else self.metamodel.concrete_classes(cls)
        groups = {self.changes.group_of(one) for one in classes}
        (group,) = groups if len(groups) == 1 else (None,)
        return None if group is None else tuple(ClassSet(group, one) for one in group if one in classes)

    def emit_word_loop(
        self,
        block: code.BodyBuilder,
        sets: Sequence[ClassSet],
        within: tuple[KeyColumns, int, code.Expression] | None = None,
    ) -> SetWord:
        """Emit a loop over the words of a union of bit sets. Return the variables of the word and of its index.

        Args:
            block: receives the loop.
            sets: of one group.
            within: a relation, the position of objects in it, and the place of the rows with known values. It restricts
                the words to these objects. None for no restriction.
        """
        group = sets[0].group
        word, number = self.module.new_local("w"), self.module.new_local("n")
        words = emit_table_entry(self.layout.offset(ExtentTable(group, "words")))
        block.open_loop(number, code.emit_call("range", words))
        united = code.emit_joined("|", [emit_state_entry(emit_sum(self.layout.offset(one), number)) for one in sets], 0)
        if within is not None:
            keys, position, place = within
            first = emit_sum(
                self.layout.offset(BitSetTable(keys, position, group)), code.Operation("*", (place, words))
            )
            united = code.Operation("&", (united, emit_table_entry(emit_sum(first, number))))
        block.add(code.Assign(word, united))
        return SetWord(group, word, number)

    def emit_bit_loop(self, block: code.BodyBuilder, set_word: SetWord) -> code.Local:
        """Emit a loop over the objects whose bits are set in a word. The code clears the bits. Return the variable."""
        low = self.module.new_local("l")
        block.open_loop(
            self.module.new_local("_"), code.emit_call("range", code.emit_call("count_bits", set_word.word))
        )
        block.add(code.Assign(low, code.Operation("&", (set_word.word, code.Operation("-", (set_word.word,))))))
        block.add(code.Assign(set_word.word, code.Operation("^", (set_word.word, low))))
        node = self.module.new_local("v", "object")
        block.add(code.Assign(node, self.emit_object_at(set_word, code.emit_call("lowest_bit", low))))
        return node

    def emit_object_at(self, set_word: SetWord, place: code.Expression) -> code.Expression:
        """Return code for the object of the bit at a place of a word."""
        first = code.Operation("*", (set_word.number, code.Constant(WORD_BITS)))
        return emit_table_entry(emit_sum(self.layout.offset(ExtentTable(set_word.group, "objects")), first, place))

    def related_set(
        self, relation: StaticRelation, bound: Mapping[int, code.Expression], position: int
    ) -> tuple[KeyColumns, int, code.Expression] | None:
        """Return the argument `within` of `words` for rows with the bound values.

        Returns None if at most one row has these values, or if a value cannot be an index of a table.
        """
        keys, rest = split_key_columns(relation, self.library, tuple(bound))
        if rest or self.layout.assumes_functional(AtMostOneRow(keys, (position,))):
            return None
        return keys, position, self._row_index(keys, bound)

    # --- attributes

    def emit_attribute_value(
        self, attribute: Attribute, node: code.Expression, *, class_known: bool
    ) -> code.Expression:
        """Return code for a single-valued attribute; `class_known` if the object is known to be of the attribute's
        class.
        """
        assert not attribute.many, "expressions cannot read several values"
        if self.changes.is_fixed_feature(attribute):
            return self._table_value(attribute, attribute.type, node)
        place, guard = self.attribute_cell(attribute, node, class_known=class_known)
        if not guard:
            return place
        return code.ConditionalExpression(guard[0], place, emit_missing_value(attribute.type))

    def _table_value(self, feature: Attribute | Reference, type_: StaticType, node: code.Expression) -> code.Expression:
        keys, _ = split_key_columns(FeatureRows(feature), self.library, (0,))
        return emit_value_entry(self.layout, ValueTable(keys, 1, (1,), type_), node)

    def attribute_cell(
        self, attribute: Attribute, node: code.Expression, *, class_known: bool
    ) -> tuple[code.Subscript, list[code.Expression]]:
        """Return the cell of an attribute that rules change, and the tests to make before the cell is read."""
        classes = self.changes.possible_classes(attribute.owner)
        column = AttributeColumn(attribute, classes)
        place, guard = self.emit_object_index(classes, node, class_known=class_known)
        return emit_state_entry(emit_sum(self.layout.offset(column), place), column.is_float), guard
