"""Emit code that computes the components of an agent's observation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate
from math import prod
from operator import mul

from envgraph import code
from envgraph.behaviour import (
    Behaviour,
    KeyIndex,
    Observation,
    ObserveAround,
    ObservedWindow,
    ObserveFind,
    ObserveObject,
    ObservePath,
    find_helper,
    path_root,
)
from envgraph.env._float_ranges import float_rank
from envgraph.env._observation_components import component_size, observed_range
from envgraph.env._prepared_behaviour import add_helper_pattern
from envgraph.env._prepared_clauses import NameClasses
from envgraph.env.compiled.layout._not_compiled import add_missing_span
from envgraph.env.compiled.layout._program_layout import (
    ONE,
    ZERO,
    Constants,
    L,
    ProgramLayout,
    emit_entry,
    emit_sum,
    emit_table_entry,
)
from envgraph.env.compiled.layout._symbols import IndexByObject
from envgraph.env.compiled.matching._term_code import CodeTerm, emit_as_float, variable_term
from envgraph.env.compiled.steps._clause_code import FunctionEmitter, key_pattern
from envgraph.errors import LARGEST_INT
from envgraph.match.plan import PatternQuery
from envgraph.metamodel import EnumType
from envgraph.pattern import ObjectType, PatternCall

COMPONENTS, NEXT_COMPONENT, OBSERVATION_INDEX = (
    code.Local("C"),
    code.Local("j", "int"),
    code.Local("index", "int"),
)
"""Variables: the components of the observation, the number of the next component, and the index they form."""


class ObservationEmitter:
    """An emitter of the code for observations: each component, and the index that the components form together.

    Args:
        writer: the emitter of the function that observes.
        keys: the indices of objects over the family.
        shape: the sizes of the components.
        behaviour: draws the grid of windows.
    """

    def __init__(self, writer: FunctionEmitter, keys: KeyIndex, shape: Sequence[int], behaviour: Behaviour) -> None:
        self._writer = writer
        self._keys = keys
        self._draw = behaviour.draw
        self._layout: ProgramLayout = writer.facts.layout
        self._metamodel = writer.facts.metamodel
        # The index is 0 and never used if the product of the sizes exceeds 64 bits.
        numbered = prod(shape) <= LARGEST_INT
        weights = [weight * numbered for weight in accumulate(shape[:-1], mul, initial=1)]
        self._weights = self._layout.offset(Constants("components", (len(shape), *weights)))
        writer.append_assignment(NEXT_COMPONENT, ZERO)
        writer.append_assignment(OBSERVATION_INDEX, ZERO)

    def emit_components(
        self, observations: Sequence[tuple[Observation, NameClasses]], scope: Mapping[str, CodeTerm]
    ) -> None:
        """Emit code for the components of `observe` clauses, after those emitted before.

        Args:
            observations: the clauses, each with the classes of the names in its scope.
            scope: code for the value of each name.
        """
        for observation, types in observations:
            with add_missing_span(observation.span):
                if isinstance(observation, ObserveAround):
                    self._emit_window(observation, types, scope)
                else:
                    self._emit_clause_components(observation, types, scope)

    def emit_end(self) -> None:
        """Emit code that sets the remaining components to 0, and returns the index."""
        padding = self._writer.module.new_local("i")
        rest = code.Assign(emit_entry(COMPONENTS, padding), ZERO)
        last = emit_entry(L, self._weights)
        self._writer.append(code.For(padding, code.emit_call("range", NEXT_COMPONENT, last), (rest,)))
        self._writer.append(code.Return(OBSERVATION_INDEX))

    def emit_component(self, value: code.Expression) -> None:
        """Emit code that stores a value as the next component of the observation, and adds its share to the index."""
        writer, weight = self._writer, emit_entry(L, emit_sum(self._weights, 1, NEXT_COMPONENT))
        writer.append(code.Assign(emit_entry(COMPONENTS, NEXT_COMPONENT), value))
        writer.append(code.Assign(OBSERVATION_INDEX, code.Operation("*", (value, weight)), "+="))
        writer.append(code.Assign(NEXT_COMPONENT, ONE, "+="))

    def _emit_match_count(
        self, observation: ObserveFind, types: NameClasses, scope: Mapping[str, CodeTerm], local: code.Local
    ) -> None:
        """Emit code that sets a variable to 1 if there is a match, or to the index of the aggregate of all matches.

        If an aggregate of no match has no value, the variable is set to 0.
        """
        writer, limits = self._writer, observed_range(observation, types, self._metamodel)
        if limits is None:
            found = self._emit_condition_test(observation.call, types, scope)
            writer.append_assignment(local, code.ConditionalExpression(found, ONE, ZERO))
            return
        writer.append_assignment(local, ZERO)
        question = add_helper_pattern(writer.engine, writer.behaviour, lambda n: find_helper(n, observation, types))
        view = writer.pattern_view(question)
        (type_,) = writer.matching.column_types(view)
        values = [scope[bound].value for bound in question.bound]
        rows = writer.emit_function_call(writer.matching.emit_rows(view), *values)
        total = variable_term(writer.matching.row_cells([type_], writer.first_row)[0], type_)
        some = [*writer.bound_alive_tests(question, scope), code.Operation(">", (rows, ZERO))]
        writer.append(code.If(code.emit_joined("and", some, True), (code.Assign(local, _emit_index(total, limits)),)))

    def _emit_window(self, observation: ObserveAround, types: NameClasses, scope: Mapping[str, CodeTerm]) -> None:
        writer, window = self._writer, ObservedWindow(observation, self._draw, types, self._metamodel)
        local, end = writer.module.new_local("i"), emit_sum(NEXT_COMPONENT, len(window.sizes))
        each = code.emit_call("range", NEXT_COMPONENT, end)
        writer.append(code.For(local, each, (code.Assign(emit_entry(COMPONENTS, local), ZERO),)))

        def emit_store(values: Sequence[code.Expression]) -> code.Body:
            shown = emit_entry(COMPONENTS, emit_sum(NEXT_COMPONENT, values[0]))
            return (code.Assign(shown, code.emit_call("max", shown, values[1])),)

        for make in window.helpers:
            question = add_helper_pattern(writer.engine, writer.behaviour, make)
            bound = {name: writer.facts.new_local_for(ObjectType(types[name])) for name in question.bound}
            writer.append(*(code.Assign(local, scope[name].value) for name, local in bound.items()))
            found = writer.matching.emit_each(writer.pattern_view(question), [*bound.values()], emit_store)
            alive = writer.bound_alive_tests(question, scope)
            writer.append(*([code.If(code.emit_joined("and", alive, True), found)] if alive else found))
        component = emit_entry(COMPONENTS, NEXT_COMPONENT)
        writer.append(code.For(local, each, writer.collect(lambda: self.emit_component(component))))

    def _emit_clause_components(
        self, observation: ObservePath | ObserveFind, types: NameClasses, scope: Mapping[str, CodeTerm]
    ) -> None:
        writer, each = self._writer, observation.each
        if each is None:
            gone = None
            if not isinstance(observation, ObserveFind):
                root = path_root(observation.path).name
                gone = writer.deleted_test(scope[root], types[root])
            self._emit_value_component(observation, types, scope, gone)
            return
        cls = each.type or ""
        index = writer.module.new_local("i")

        def write() -> None:
            node = writer.emit_object_at_index(self._keys, cls, index)
            gone = code.Operation("<", (node, ZERO))
            known = {**scope, each.name: variable_term(node, ObjectType(cls), cls)}
            self._emit_value_component(observation, {**types, each.name: cls}, known, gone)

        writer.append(code.For(index, code.emit_call("range", self._emit_index_count(cls)), writer.collect(write)))

    def _emit_value_component(
        self,
        observation: ObservePath | ObserveFind,
        types: NameClasses,
        scope: Mapping[str, CodeTerm],
        gone: code.Expression | None,
    ) -> None:
        """Emit code for one component: the number of the object, number or literal at the end of a path, or of matches.

        The component is the padding value (0, or the value for `none`) if `gone` is true: the path's first object is
        deleted. `gone` is None if this cannot happen. If the object is not visible, the component is the largest
        number, which is reserved for hidden objects.
        """
        writer = self._writer
        local = writer.module.new_local("seen")
        padding: code.Expression = ZERO
        missing: code.Body = writer.failure_statements()
        if isinstance(observation, ObserveObject) and observation.or_none:
            padding = self._emit_index_count(observation.among)
            missing = (code.Assign(local, padding),)

        def emit_read() -> None:
            if isinstance(observation, ObserveFind):
                self._emit_match_count(observation, types, scope, local)
                return
            term = writer.emit_value(observation.path, scope)
            found = writer.collect(lambda: self._emit_component_value(observation, types, term, local, missing))
            if term.tests:
                found = (code.If(code.emit_joined("and", term.tests, True), found, missing),)
            writer.append(*found)

        def emit_if_visible() -> None:
            if observation.visible is None:
                emit_read()
            else:
                is_in_scope = self._emit_condition_test(observation.visible, types, scope)
                hidden = (code.Assign(local, self._emit_hidden_value(observation, types)),)
                writer.append(code.If(is_in_scope, writer.collect(emit_read), hidden))

        if gone is None:
            emit_if_visible()
        else:
            writer.append(code.If(gone, (code.Assign(local, padding),), writer.collect(emit_if_visible)))
        self.emit_component(local)

    def _emit_index_count(self, cls: str) -> code.Expression:
        """Emit code for the number of indices that the family has for a class."""
        return emit_entry(L, self._layout.offset(Constants(("keys", cls), (self._keys.size(cls),))))

    def _emit_condition_test(
        self, call: PatternCall, types: NameClasses, scope: Mapping[str, CodeTerm]
    ) -> code.Expression:
        """Emit code that tests if a condition has a match. Conditions on deleted objects have no match."""
        writer = self._writer
        question = writer.condition_pattern(call, types)
        values = [scope[bound].value for bound in question.bound]
        exists = writer.emit_function_call(
            writer.matching.emit_exists(writer.pattern_view(question, free=False)), *values
        )
        return code.emit_joined("and", [*writer.bound_alive_tests(question, scope), exists], True)

    def _emit_hidden_value(self, observation: ObservePath | ObserveFind, types: NameClasses) -> code.Expression:
        """Return code for the component's value if the object is not visible: the number after all other values."""
        if isinstance(observation, ObserveObject):
            return emit_sum(self._emit_index_count(observation.among), int(observation.or_none))
        return code.Constant(component_size(observation, types, self._keys, self._metamodel) - 1)

    def _emit_component_value(
        self,
        observation: ObservePath,
        types: NameClasses,
        term: CodeTerm,
        local: code.Local,
        missing: code.Body,
    ) -> None:
        writer = self._writer
        match observation:
            case ObserveObject(among=among):
                assert isinstance(term.type, ObjectType), "the behaviour was checked"
                node = writer.facts.new_local_for(term.type)
                writer.append_assignment(node, term.value)
                indices = self._layout.offset(IndexByObject(among))
                found: code.Body = (
                    code.Assign(local, emit_table_entry(emit_sum(indices, node))),
                    *self._emit_find_index(among, node, local),
                    code.If(code.Operation("<", (local, ZERO)), writer.failure_statements()),
                )
                if not self._metamodel.covers(among, term.type.cls):
                    found = (code.If(writer.facts.emit_is_instance(node, among), found, missing),)
                writer.append(*found)
                return
        limits = observed_range(observation, types, self._metamodel)
        if limits is None:
            writer.append_assignment(local, _emit_literal_index(term, self._layout))
            return
        writer.append_assignment(local, _emit_index(term, limits))

    def _emit_find_index(self, cls: str, node: code.Local, local: code.Local) -> code.Body:
        """Emit code that finds the index of an object that a rule has created, by its key; no code if none has one."""
        writer, index = self._writer, self._writer.module.new_local("i")
        key = key_pattern(writer, self._keys, cls, index)
        if key is None:
            return ()
        place = len(key[1])
        view = PatternQuery(key[0].pattern.qualified_name, tuple(range(place + 1)), ())
        has_key = writer.emit_function_call(writer.matching.emit_exists(view), *key[1], node)
        found = code.If(has_key, (code.Assign(local, index), code.BreakOrContinue("break")))
        each = code.For(index, code.emit_call("range", self._emit_index_count(cls)), (found,))
        return (code.If(code.Operation("<", (local, ZERO)), (each,)),)


def _emit_index(term: CodeTerm, limits: tuple[float, float, bool]) -> code.Expression:
    """Emit code for the index of a number in a range: see `number_index`."""
    low, high, is_float = limits
    value = emit_as_float(term) if is_float else term.value
    rank: code.Expression = code.emit_call("min", code.emit_call("max", value, code.Constant(low)), code.Constant(high))
    if is_float:
        rank, low = code.emit_call("float_rank", rank), float_rank(low)
    return code.Operation("-", (rank, code.Constant(low)))


def _emit_literal_index(term: CodeTerm, layout: ProgramLayout) -> code.Expression:
    """Emit code for the position of an enum literal in its enum; values of other types are used unchanged."""
    if not isinstance(term.type, EnumType):
        return term.number_code
    literals = term.type.literals
    if list(literals) == sorted(literals):
        return term.value
    places = tuple(literals.index(literal) for literal in sorted(literals))
    offset = layout.offset(Constants(("places", term.type.name), places))
    return emit_entry(L, emit_sum(offset, term.value))
