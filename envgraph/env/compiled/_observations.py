"""What an agent sees of a state, component by component."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import prod

from envgraph import code
from envgraph.behaviour import (
    Observation,
    ObserveAttribute,
    ObserveFind,
    ObserveObject,
    ObserveRange,
    condition_question,
    count_question,
    root_of,
)
from envgraph.env._keys import KeyIndex
from envgraph.env._prepared import Types
from envgraph.env._program import added
from envgraph.env.compiled._layout import ONE, RI, ZERO, Constants, L, Layout, entry, plus, table
from envgraph.env.compiled._refused import standing
from envgraph.env.compiled._tables import IndexOf, indexable
from envgraph.env.compiled._terms import Term, named
from envgraph.env.compiled._writer import Writer
from envgraph.metamodel import EnumType
from envgraph.pattern import ObjectType

SEEN, NEXT, INDEX = code.Local("C"), code.Local("j", "int"), code.Local("index", "int")
"""What is seen, by component; the number of the next one; and the index that they make."""


class Observations:
    """Writes what is observed: each component, and the index that all of them make.

    Args:
        writer: of the function.
        keys: the indices of objects over the family.
        shape: sizes of the components.
    """

    def __init__(self, writer: Writer, keys: KeyIndex, shape: Sequence[int]) -> None:
        self._writer = writer
        self._keys = keys
        self._layout: Layout = writer.facts.layout
        self._metamodel = writer.facts.metamodel
        weights = [prod(shape[:place]) for place in range(len(shape))]
        self._weights = self._layout.offset(Constants("components", (len(shape), *weights)))
        writer.assign(NEXT, ZERO)
        writer.assign(INDEX, ZERO)

    def write(self, observations: Sequence[tuple[Observation, Types]], scope: Mapping[str, Term]) -> None:
        """The components of some clauses come next.

        Args:
            observations: with the classes of the names that they know.
            scope: what the names stand for.
        """
        for observation, types in observations:
            with standing(observation.span):
                if isinstance(observation, ObserveFind):
                    self._see_matches(observation, types, scope)
                else:
                    self._see_path(observation, types, scope)

    def end(self) -> None:
        """What is left of the components is 0."""
        padding = self._writer.module.fresh("i")
        rest = code.Assign(entry(SEEN, padding), ZERO)
        last = entry(L, self._weights)
        self._writer.add(code.For(padding, code.call("range", NEXT, last), (rest,)))
        self._writer.add(code.Return(INDEX))

    def see(self, value: code.Expression) -> None:
        """The next component."""
        writer, weight = self._writer, entry(L, plus(self._weights, 1, NEXT))
        writer.add(code.Assign(entry(SEEN, NEXT), value))
        writer.add(code.Assign(INDEX, code.Operation("*", (value, weight)), "+="))
        writer.add(code.Assign(NEXT, ONE, "+="))

    def _see_matches(self, observation: ObserveFind, types: Types, scope: Mapping[str, Term]) -> None:
        writer = self._writer
        local, name = writer.module.fresh("seen"), writer.behaviour
        writer.assign(local, ZERO)
        if observation.up_to is None:
            question = added(writer.engine, name, lambda n: condition_question(n, observation.call, types))
            values = [scope[bound].value for bound in question.bound]
            exists = writer.call(writer.matching.exists(writer.key(question, free=False)), *values)
            found: code.Body = (code.Assign(local, code.Choice(exists, ONE, ZERO)),)
        else:
            question = added(writer.engine, name, lambda n: count_question(n, observation.call, types))
            values = [scope[bound].value for bound in question.bound]
            rows = writer.call(writer.matching.rows(writer.key(question)), *values)
            counted = entry(RI, writer.top, 0)
            most = code.call("min", counted, code.Constant(observation.up_to))
            some = code.Operation(">", (rows, ZERO))
            found = (code.If(some, (code.Assign(local, most),)),)
        alive = writer.bound_alive(question, scope)
        writer.add(*([code.If(code.joined("and", alive, True), found)] if alive else found))
        self.see(local)

    def _see_path(
        self,
        observation: ObserveObject | ObserveRange | ObserveAttribute,
        types: Types,
        scope: Mapping[str, Term],
    ) -> None:
        writer, each = self._writer, observation.each
        if each is None:
            root = root_of(observation.path).name
            gone = writer.gone(scope[root], types[root])
            self._see_value(observation, scope, gone)
            return
        cls = each.type or ""
        index = writer.module.fresh("i")

        def write() -> None:
            node = writer.keyed(cls, index)
            gone = code.Operation("<", (node, ZERO))
            self._see_value(observation, {**scope, each.name: named(node, ObjectType(cls), cls)}, gone)

        count = Constants(("keys", cls), (self._keys.size(cls),))
        size = entry(L, self._layout.offset(count))
        writer.add(code.For(index, code.call("range", size), writer.collected(write)))

    def _see_value(
        self,
        observation: ObserveObject | ObserveRange | ObserveAttribute,
        scope: Mapping[str, Term],
        gone: code.Expression | None,
    ) -> None:
        """The index of what a path leads to, or the padding where it begins nowhere."""
        writer = self._writer
        local = writer.module.fresh("seen")
        padding: code.Expression = ZERO
        missing: code.Body = writer.fail()
        if isinstance(observation, ObserveObject) and observation.or_none:
            count = Constants(("keys", observation.among), (self._keys.size(observation.among),))
            padding = entry(L, self._layout.offset(count))
            missing = (code.Assign(local, padding),)

        def read() -> None:
            term = writer.value(observation.path, scope)
            found = writer.collected(lambda: self._index(observation, term, local, missing))
            if term.tests:
                found = (code.If(code.joined("and", term.tests, True), found, missing),)
            writer.add(*found)

        if gone is None:
            read()
        else:
            writer.add(code.If(gone, (code.Assign(local, padding),), writer.collected(read)))
        self.see(local)

    def _index(
        self,
        observation: ObserveObject | ObserveRange | ObserveAttribute,
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
    """Code for the place of a literal in its enum; those of other types are what they are."""
    if not isinstance(term.type, EnumType):
        return term.number
    literals = term.type.literals
    if list(literals) == sorted(literals):
        return term.value
    places = tuple(literals.index(literal) for literal in sorted(literals))
    offset = layout.offset(Constants(("places", term.type.name), places))
    return entry(L, plus(offset, term.value))
