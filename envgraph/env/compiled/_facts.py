"""Emit code that reads the model: from tables if no rule changes the value, else from the state."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import count

from envgraph import code
from envgraph.code import dataclass
from envgraph.env.compiled._changes import Changes
from envgraph.env.compiled._connections import Connections
from envgraph.env.compiled._layout import STATE, Layout, Text, bit, cell, plus, table
from envgraph.env.compiled._member import absent, missing
from envgraph.env.compiled._refused import NotCompiled
from envgraph.env.compiled._tables import (
    WORD,
    AttributeColumn,
    Bits,
    ClassSet,
    Extent,
    Instances,
    Keys,
    Links,
    Listed,
    One,
    Relation,
    SetsOf,
    Starts,
    Values,
    keys_of,
)
from envgraph.match.plan import LiveSizes
from envgraph.metamodel import Attribute, Reference, Scalar
from envgraph.pattern import Library, StaticType

SHIFT = code.Constant(5)
"""Shifting a place in a class set by this gives the index of its word."""


class Module:
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

    def fresh(self, prefix: str, type_: str = "int") -> code.Local:
        """Return a local variable with a new name that starts with `prefix`."""
        return code.Local(f"{prefix}{next(self._fresh)}", type_)

    def add(self, prefix: str, parameters: Sequence[code.Local], body: code.Body) -> str:
        """Add a function with the state and `parameters` as its parameters, and return the function's name."""
        name = f"{prefix}{len(self.functions)}"
        self.functions.append(code.Function(name, (*STATE, *parameters), body))
        self.levels[name] = self._open[-1]
        return name

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Return a context for emitting a function, which counts the regions of the row buffers that this needs."""
        self._open.append(1)
        yield
        self._open.pop()

    @contextmanager
    def trial(self) -> Iterator[None]:
        """Return a context at whose end all functions that were added within it are discarded."""
        functions, levels, names = [*self.functions], {**self.levels}, {**self._names}
        with self.writing():
            yield
        self.functions[:], self.levels, self._names = functions, levels, names

    def uses(self, name: str, above: int) -> None:
        """Record that the current function calls another, whose rows begin `above` regions behind its own rows."""
        self.needs(above + self.levels[name])

    def needs(self, levels: int) -> None:
        """Record that the current function uses at least `levels` regions of the row buffers."""
        self._open[-1] = max(self._open[-1], levels)

    def once(
        self, key: object, prefix: str, write: Callable[[], tuple[Sequence[code.Local], code.Body]]
    ) -> str:
        """Return the name of the function for `key`. The first call emits its parameters and body with `write`."""
        if key not in self._names:
            with self.writing():
                self._names[key] = self.add(prefix, *write())
        return self._names[key]


@dataclass(frozen=True, slots=True)
class WordOf:
    """A word of a bit set over the objects of a group of classes; `number` is the word's index in the bit set."""

    group: tuple[str, ...]
    word: code.Local
    number: code.Local


class Facts:
    """An emitter of code that reads the model. Emitted loops enclose all later statements of their block.

    Args:
        module: receives functions.
        layout: receives tables and columns.
        changes: made by the rules.
        library: the patterns.
        sizes: the numbers of objects in the domain's own model.
    """

    def __init__(
        self, module: Module, layout: Layout, changes: Changes, library: Library, sizes: LiveSizes
    ) -> None:
        self.module = module
        self.layout = layout
        self.changes = changes
        self.library = library
        self.metamodel = library.metamodel
        self.links = Connections(self, sizes)

    # --- what no rule changes

    def look_up(
        self,
        block: code.Block,
        relation: Relation,
        bound: Mapping[int, code.Expression],
        wanted: Sequence[int] = (),
    ) -> dict[int, code.Local]:
        """Emit code that runs later statements for each row of a static relation with the bound values.

        If no positions are wanted, the code only tests if a row exists.

        Returns:
            The variables that hold the values at the wanted positions.
        """
        keys, rest = keys_of(relation, self.library, tuple(bound))
        place = self._place(keys, bound)
        shown = tuple(sorted({*rest, *wanted}))
        if not shown:
            offset = self.layout.offset(Bits(keys))
            word = table(plus(offset, code.Operation(">>", (place, SHIFT))))
            block.test(bit(word, place))
            return {}
        types = relation.types(self.library)
        found = {position: self.local(types[position]) for position in shown}
        if self.layout.functional(One(keys, shown)):
            for position, local in found.items():
                values = Values(keys, position, shown, types[position])
                entry = table(plus(self.layout.offset(values), place), values.is_float)
                block.add(code.Assign(local, entry))
            first = shown[0]
            block.test(self.present(found[first], types[first]))
        else:
            starts = self.layout.offset(Starts(keys, shown))
            begin, end, row = (self.module.fresh("i") for _ in range(3))
            block.add(code.Assign(begin, table(plus(starts, place))))
            block.add(code.Assign(end, table(plus(starts, place, 1))))
            block.loop(row, code.call("range", begin, end))
            for position, local in found.items():
                listed = Listed(keys, shown, position, types[position] is Scalar.FLOAT)
                entry = table(plus(self.layout.offset(listed), row), listed.is_float)
                block.add(code.Assign(local, entry))
        for position in rest:
            block.test(code.equal(found[position], bound[position]))
        return {position: found[position] for position in wanted}

    def _place(self, keys: Keys, bound: Mapping[int, code.Expression]) -> code.Expression:
        place: code.Expression | None = None
        for position, width in zip(keys.positions, keys.widths, strict=True):
            size = code.Constant(width) if width else self.layout.stride()
            scaled = () if place is None else (code.Operation("*", (place, size)),)
            place = plus(*scaled, bound[position])
        return code.Constant(0) if place is None else place

    def local(self, type_: StaticType) -> code.Local:
        """Return a new variable for a value of a type."""
        return self.module.fresh("v", "float" if type_ is Scalar.FLOAT else "int")

    @staticmethod
    def present(value: code.Expression, type_: StaticType) -> code.Expression:
        """Return code that tests if a value is not missing."""
        if type_ is Scalar.FLOAT:
            return code.equal(value, value)
        if type_ is Scalar.INT:
            return code.Operation("!=", (value, code.Constant(missing(type_))))
        return code.Operation(">=", (value, code.Constant(0)))

    def string(self, text: str) -> code.Expression:
        """Return code for the number that represents a string."""
        return self.layout.offset(Text(text))

    # --- classes

    def is_instance(self, node: code.Expression, cls: str, exact: bool = False) -> code.Expression:
        """Return code that tests if an object is of a class. `exact` excludes subclasses."""
        if self.changes.fixed_class(cls, exact):
            block = code.Block()
            self.look_up(block, Instances(cls, exact), {0: node})
            return block.tests[0][0]
        classes = (cls,) if exact else self.metamodel.concrete(cls)
        tests = []
        for group in self.changes.groups:
            place, guard = self.place(group, node, sure=False)
            inside = [self.in_set(group, one, place) for one in classes if one in group]
            if inside:
                tests.append(code.joined("and", [*guard, code.joined("or", inside, False)], True))
        for one in classes:
            if self.changes.group_of(one) is None:
                tests.append(self.is_instance(node, one, exact=True))
        return code.joined("or", tests, False)

    def alive(self, node: code.Expression, cls: str) -> code.Expression | None:
        """Return code that tests if an object of a class is not deleted; None if such objects are never deleted."""
        if not any(self.metamodel.overlap(cls, one) for one in self.changes.deleted):
            return None
        tests: list[code.Expression] = []
        for group in self.changes.groups:
            if not self.changes.deleted.isdisjoint(group):
                place, (there,) = self.place(group, node, sure=False)
                inside = [self.in_set(group, one, place) for one in group]
                tests.append(code.joined("or", [code.inverse(there), *inside], True))
        return code.joined("and", tests, True)

    def in_set(self, group: tuple[str, ...], cls: str, place: code.Expression) -> code.Expression:
        """Return code that tests if an object is in a class set of a group, by the object's index in the group."""
        offset = self.layout.offset(ClassSet(group, cls))
        word = cell(plus(offset, code.Operation(">>", (place, SHIFT))))
        return bit(word, place)

    def place(
        self, classes: tuple[str, ...], node: code.Expression, *, sure: bool
    ) -> tuple[code.Expression, list[code.Expression]]:
        """Return code for an object's index among those of some classes, and tests that it has one (none if `sure`)."""
        found = table(plus(self.layout.offset(Extent(classes, "places")), node))
        guard: list[code.Expression] = [] if sure else [code.Operation(">=", (found, code.Constant(0)))]
        return (code.Constant(0) if self.layout.single(classes) else found), guard

    def each(self, block: code.Block, classes: tuple[str, ...]) -> tuple[code.Local, code.Expression]:
        """Emit a loop over the objects that may be of some classes. Return the variable, and the object's index."""
        node = self.module.fresh("v", "object")
        holders = self.layout.offset(Extent(classes, "objects"))
        if self.layout.single(classes):
            block.test(code.Operation(">", (self.count(classes), code.Constant(0))))
            block.add(code.Assign(node, table(holders)))
            return node, code.Constant(0)
        place = self.module.fresh("i")
        block.loop(place, code.call("range", self.count(classes)))
        block.add(code.Assign(node, table(plus(holders, place))))
        return node, place

    def count(self, classes: tuple[str, ...]) -> code.Expression:
        return table(self.layout.offset(Extent(classes, "count")))

    def instances(self, block: code.Block, cls: str, exact: bool = False) -> code.Local:
        """Emit a loop over the objects of a class, without those of subclasses if `exact`. Return the variable."""
        classes = (cls,) if exact else self.metamodel.concrete(cls)
        if self.changes.fixed_class(cls, exact):
            return self.each(block, classes)[0]
        sets = self.sets(cls, exact)
        if sets is not None:
            return self.each_in(block, self.words(block, sets))
        wider = self.changes.becoming(cls) if not exact else self.changes.group_of(cls) or (cls,)
        node, _ = self.each(block, wider)
        block.test(self.is_instance(node, cls, exact))
        return node

    def sets(self, cls: str, exact: bool) -> tuple[ClassSet, ...] | None:
        """Return the bit sets whose union is the extent of a class; None if its classes are not all of one group."""
        classes = (cls,) if exact else self.metamodel.concrete(cls)
        groups = {self.changes.group_of(one) for one in classes}
        (group,) = groups if len(groups) == 1 else (None,)
        return None if group is None else tuple(ClassSet(group, one) for one in group if one in classes)

    def words(
        self,
        block: code.Block,
        sets: Sequence[ClassSet],
        within: tuple[Keys, int, code.Expression] | None = None,
    ) -> WordOf:
        """Emit a loop over the words of a union of bit sets. Return the variables of the word and of its index.

        Args:
            block: receives the loop.
            sets: of one group.
            within: a relation, the position of objects in it, and the place of the rows with known values. It restricts
                the words to these objects. None for no restriction.
        """
        group = sets[0].group
        word, number = self.module.fresh("w"), self.module.fresh("n")
        words = table(self.layout.offset(Extent(group, "words")))
        block.loop(number, code.call("range", words))
        united = code.joined("|", [cell(plus(self.layout.offset(one), number)) for one in sets], 0)
        if within is not None:
            keys, position, place = within
            first = plus(
                self.layout.offset(SetsOf(keys, position, group)), code.Operation("*", (place, words))
            )
            united = code.Operation("&", (united, table(plus(first, number))))
        block.add(code.Assign(word, united))
        return WordOf(group, word, number)

    def each_in(self, block: code.Block, of: WordOf) -> code.Local:
        """Emit a loop over the objects whose bits are set in a word. The code clears the bits. Return the variable."""
        low = self.module.fresh("l")
        block.loop(self.module.fresh("_"), code.call("range", code.call("count_bits", of.word)))
        block.add(code.Assign(low, code.Operation("&", (of.word, code.Operation("-", (of.word,))))))
        block.add(code.Assign(of.word, code.Operation("^", (of.word, low))))
        node = self.module.fresh("v", "object")
        block.add(code.Assign(node, self._object(of, code.call("lowest_bit", low))))
        return node

    def _object(self, of: WordOf, place: code.Expression) -> code.Expression:
        first = code.Operation("*", (of.number, code.Constant(WORD)))
        return table(plus(self.layout.offset(Extent(of.group, "objects")), first, place))

    def nth_of(self, of: WordOf, number: code.Expression) -> code.Expression:
        """Return code for the object of the nth bit (from 0) that is set in a word."""
        return self._object(of, code.call("nth_bit", of.word, number))

    def related(
        self, relation: Relation, bound: Mapping[int, code.Expression], position: int
    ) -> tuple[Keys, int, code.Expression] | None:
        """Return the argument `within` of `words` for rows with the bound values.

        Returns None if at most one row has these values, or if a value cannot be an index of a table.
        """
        keys, rest = keys_of(relation, self.library, tuple(bound))
        if rest or self.layout.functional(One(keys, (position,))):
            return None
        return keys, position, self._place(keys, bound)

    # --- attributes

    def value(self, attribute: Attribute, node: code.Expression, *, sure: bool) -> code.Expression:
        """Return code for a single-valued attribute; `sure` if the object is known to be of the attribute's class.

        Raises:
            NotCompiled: the attribute is multi-valued.
        """
        if attribute.many:
            raise NotCompiled(f"an expression that reads the multi-valued attribute `{attribute}`")
        if self.changes.fixed_feature(attribute):
            return self._fixed_value(attribute, attribute.type, node)
        place, guard = self.attribute_cell(attribute, node, sure=sure)
        if not guard:
            return place
        return code.Choice(guard[0], place, absent(attribute.type))

    def _fixed_value(
        self, feature: Attribute | Reference, type_: StaticType, node: code.Expression
    ) -> code.Expression:
        keys, _ = keys_of(Links(feature), self.library, (0,))
        values = Values(keys, 1, (1,), type_)
        return table(plus(self.layout.offset(values), node), values.is_float)

    def attribute_cell(
        self, attribute: Attribute, node: code.Expression, *, sure: bool
    ) -> tuple[code.Index, list[code.Expression]]:
        """Return the cell of an attribute that rules change, and the tests to make before the cell is read."""
        classes = self.changes.becoming(attribute.owner)
        column = AttributeColumn(attribute, classes)
        place, guard = self.place(classes, node, sure=sure)
        return cell(plus(self.layout.offset(column), place), column.is_float), guard
