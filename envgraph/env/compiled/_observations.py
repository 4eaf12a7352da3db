"""Emit code that computes the components of an agent's observation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import prod

from envgraph import code
from envgraph.behaviour import (
    KeyIndex,
    Observation,
    ObserveFind,
    ObserveObject,
    ObservePath,
    ObserveRange,
    condition_question,
    count_question,
    root_of,
)
from envgraph.env._observing import size_of
from envgraph.env._prepared import Types
from envgraph.env._program import added
from envgraph.env.compiled._layout import ONE, RI, ZERO, Constants, L, Layout, entry, plus, table
from envgraph.env.compiled._refused import standing
from envgraph.env.compiled._tables import IndexOf, indexable
from envgraph.env.compiled._terms import Term, named
from envgraph.env.compiled._writer import Writer
from envgraph.errors import LARGEST_INT
from envgraph.metamodel import EnumType
from envgraph.pattern import ObjectType, PatternCall

SEEN, NEXT, INDEX = code.Local("C"), code.Local("j", "int"), code.Local("index", "int")
"""Variables: the components of the observation, the number of the next component, and the index they form."""


class Observations:
    """An emitter of the code for observations: each component, and the index that the components form together.

    Args:
        writer: the emitter of the function that observes.
        keys: the indices of objects over the family.
        shape: the sizes of the components.
    """

    def __init__(self, writer: Writer, keys: KeyIndex, shape: Sequence[int]) -> None:
        self._writer = writer
        self._keys = keys
        self._layout: Layout = writer.facts.layout
        self._metamodel = writer.facts.metamodel
        # The index is 0 and never used if the product of the sizes exceeds 64 bits.
        numbered = prod(shape) <= LARGEST_INT
        weights = [prod(shape[:place]) * numbered for place in range(len(shape))]
        self._weights = self._layout.offset(Constants("components", (len(shape), *weights)))
        writer.assign(NEXT, ZERO)
        writer.assign(INDEX, ZERO)

    def write(self, observations: Sequence[tuple[Observation, Types]], scope: Mapping[str, Term]) -> None:
        """Emit code for the components of `observe` clauses, after those emitted before.

        Args:
            observations: the clauses, each with the classes of the names in its scope.
            scope: code for the value of each name.
        """
        for observation, types in observations:
            with standing(observation.span):
                if isinstance(observation, ObserveFind):
                    self._see_matches(observation, types, scope)
                else:
                    self._see_path(observation, types, scope)

    def end(self) -> None:
        """Emit code that sets the remaining components to 0, and returns the index."""
        padding = self._writer.module.fresh("i")
        rest = code.Assign(entry(SEEN, padding), ZERO)
        last = entry(L, self._weights)
        self._writer.add(code.For(padding, code.call("range", NEXT, last), (rest,)))
        self._writer.add(code.Return(INDEX))

    def see(self, value: code.Expression) -> None:
        """Emit code that stores a value as the next component of the observation, and adds its share to the index."""
        writer, weight = self._writer, entry(L, plus(self._weights, 1, NEXT))
        writer.add(code.Assign(entry(SEEN, NEXT), value))
        writer.add(code.Assign(INDEX, code.Operation("*", (value, weight)), "+="))
        writer.add(code.Assign(NEXT, ONE, "+="))

    def _see_matches(self, observation: ObserveFind, types: Types, scope: Mapping[str, Term]) -> None:
        writer = self._writer
        local, name = writer.module.fresh("seen"), writer.behaviour
        if observation.up_to is None:
            writer.assign(local, code.Choice(self._holds(observation.call, types, scope), ONE, ZERO))
            self.see(local)
            return
        writer.assign(local, ZERO)
        question = added(writer.engine, name, lambda n: count_question(n, observation.call, types))
        values = [scope[bound].value for bound in question.bound]
        rows = writer.call(writer.matching.rows(writer.key(question)), *values)
        most = code.call("min", entry(RI, writer.top, 0), code.Constant(observation.up_to))
        some = [*writer.bound_alive(question, scope), code.Operation(">", (rows, ZERO))]
        writer.add(code.If(code.joined("and", some, True), (code.Assign(local, most),)))
        self.see(local)

    def _see_path(
        self,
        observation: ObservePath,
        types: Types,
        scope: Mapping[str, Term],
    ) -> None:
        writer, each = self._writer, observation.each
        if each is None:
            root = root_of(observation.path).name
            gone = writer.gone(scope[root], types[root])
            self._see_value(observation, types, scope, gone)
            return
        cls = each.type or ""
        index = writer.module.fresh("i")

        def write() -> None:
            node = writer.keyed(cls, index)
            gone = code.Operation("<", (node, ZERO))
            known = {**scope, each.name: named(node, ObjectType(cls), cls)}
            self._see_value(observation, {**types, each.name: cls}, known, gone)

        writer.add(code.For(index, code.call("range", self._size(cls)), writer.collected(write)))

    def _see_value(
        self,
        observation: ObservePath,
        types: Types,
        scope: Mapping[str, Term],
        gone: code.Expression | None,
    ) -> None:
        """Emit code for one component: the number of the object, int or literal at the end of a path.

        The component is the padding value (0, or the value for `none`) if `gone` is true: the path's first object is
        deleted. `gone` is None if this cannot happen. The component is the last value if the object is not visible.
        """
        writer = self._writer
        local = writer.module.fresh("seen")
        padding: code.Expression = ZERO
        missing: code.Body = writer.fail()
        if isinstance(observation, ObserveObject) and observation.or_none:
            padding = self._size(observation.among)
            missing = (code.Assign(local, padding),)

        def read() -> None:
            term = writer.value(observation.path, scope)
            found = writer.collected(lambda: self._index(observation, term, local, missing))
            if term.tests:
                found = (code.If(code.joined("and", term.tests, True), found, missing),)
            writer.add(*found)

        def look() -> None:
            if observation.visible is None:
                read()
            else:
                in_sight = self._holds(observation.visible, types, scope)
                hidden = (code.Assign(local, self._hidden(observation, types)),)
                writer.add(code.If(in_sight, writer.collected(read), hidden))

        if gone is None:
            look()
        else:
            writer.add(code.If(gone, (code.Assign(local, padding),), writer.collected(look)))
        self.see(local)

    def _size(self, cls: str) -> code.Expression:
        """Emit code for the number of indices that the family has for a class."""
        return entry(L, self._layout.offset(Constants(("keys", cls), (self._keys.size(cls),))))

    def _holds(self, call: PatternCall, types: Types, scope: Mapping[str, Term]) -> code.Expression:
        """Emit code that tests if a condition has a match. Conditions on deleted objects have no match."""
        writer = self._writer
        question = added(writer.engine, writer.behaviour, lambda n: condition_question(n, call, types))
        values = [scope[bound].value for bound in question.bound]
        exists = writer.call(writer.matching.exists(writer.key(question, free=False)), *values)
        return code.joined("and", [*writer.bound_alive(question, scope), exists], True)

    def _hidden(self, observation: ObservePath, types: Types) -> code.Expression:
        """Return code for the component's value if the object is not visible: the number after all other values."""
        if isinstance(observation, ObserveObject):
            return plus(self._size(observation.among), int(observation.or_none))
        return code.Constant(size_of(observation, types, self._keys, self._metamodel) - 1)

    def _index(
        self,
        observation: ObservePath,
        term: Term,
        local: code.Local,
        missing: code.Body,
    ) -> None:
        writer = self._writer
        match observation:
            case ObserveObject(among=among):
                assert isinstance(term.type, ObjectType), "the behaviour was checked"
                node = writer.facts.local(term.type)
                writer.assign(node, term.value)
                indices = self._layout.offset(IndexOf(among, indexable(self._metamodel, among)))
                found: code.Body = (
                    code.Assign(local, table(plus(indices, node))),
                    code.If(code.Operation("<", (local, ZERO)), writer.fail()),
                )
                if not self._metamodel.covers(among, term.type.cls):
                    found = (code.If(writer.facts.is_instance(node, among), found, missing),)
                writer.add(*found)
            case ObserveRange(low=low, high=high):
                clipped = code.call(
                    "min", code.call("max", term.value, code.Constant(low)), code.Constant(high)
                )
                writer.assign(local, code.Operation("-", (clipped, code.Constant(low))))
            case _:
                writer.assign(local, _literal_index(term, self._layout))


def _literal_index(term: Term, layout: Layout) -> code.Expression:
    """Emit code for the position of an enum literal in its enum; values of other types are used unchanged."""
    if not isinstance(term.type, EnumType):
        return term.number
    literals = term.type.literals
    if list(literals) == sorted(literals):
        return term.value
    places = tuple(literals.index(literal) for literal in sorted(literals))
    offset = layout.offset(Constants(("places", term.type.name), places))
    return entry(L, plus(offset, term.value))
