"""Emit code for the rules that a unit applies at chosen matches: if the model refuses a rule, the state is restored."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import field
from typing import TYPE_CHECKING, Final

from envgraph import code
from envgraph.behaviour import RuleCall
from envgraph.code import dataclass
from envgraph.env.compiled.layout._model_changes import plan_of
from envgraph.env.compiled.layout._not_compiled import NotCompiled
from envgraph.env.compiled.layout._program_layout import (
    ERROR,
    ONE,
    RF,
    RI,
    ZERO,
    D,
    emit_entry,
    emit_state_entry,
    emit_sum,
)
from envgraph.env.compiled.matching._body_code import CAPACITY
from envgraph.env.compiled.matching._model_reading import ModelReader
from envgraph.env.compiled.matching._term_code import CodeTerm, variable_term
from envgraph.match.plan import PatternQuery
from envgraph.metamodel import Scalar
from envgraph.pattern import ObjectType, StaticType
from envgraph.rewrite.plans import may_be_refused

if TYPE_CHECKING:
    from envgraph.env.compiled.steps._clause_code import CallResult, FunctionEmitter

CLEAR_REFUSED: Final = code.If(
    code.emit_equal(emit_state_entry(ERROR), code.Name("REFUSED")),
    (code.Assign(emit_state_entry(ERROR), ZERO),),
)
"""Clears the error code if it is `REFUSED`, which a failed step leaves behind; other errors stay."""

Narrow = Callable[[Mapping[str, CodeTerm]], tuple[list[code.Expression], CodeTerm | None]]
"""Emits tests of a match, given by the terms of its variables, and the number that orders it, or None for no order."""


@dataclass(frozen=True, slots=True)
class Arguments:
    """The values that a call gives to parameters, its tests, and the variable for each wanted output parameter."""

    given: Mapping[str, CodeTerm] = field(default_factory=dict)
    tests: Sequence[code.Expression] = ()
    wanted: Mapping[str, str] = field(default_factory=dict)


class RuleAttempts:
    """An emitter of applications of a rule at its matches, which are stored as rows."""

    def __init__(self, writer: FunctionEmitter, rule: RuleCall, arguments: Arguments) -> None:
        self._writer, self._rule, self._wanted = writer, rule, tuple(arguments.wanted)
        self._plan, self._given, self._key = writer.plan_and_view(rule, tuple(arguments.given))
        for name, term in arguments.given.items():
            writer.append_assignment(self._given[self._plan.variables.index(name)], term.number_code)
        self._left, self._row = writer.module.new_local("n"), writer.module.new_local("k")
        self._first: code.Expression = ZERO
        self._column = 0
        self._may_be_refused = may_rule_be_refused(writer, rule)

    @contextmanager
    def rows(self, narrow: Narrow | None = None, limit: int | None = None) -> Iterator[None]:
        """Emit code that stores the matches in rows, reserved within the block; of those that `narrow` keeps, `limit`.

        The rows are sorted.
        """
        writer, key = self._writer, self._key
        find = writer.matching.emit_rows(key) if key.outputs else writer.matching.emit_exists(key)
        found = writer.emit_function_call(find, *self._given.values())
        writer.append_assignment(self._left, found if key.outputs else code.ConditionalExpression(found, ONE, ZERO))
        writer.append(code.If(code.Operation("!=", (emit_state_entry(ERROR), ZERO)), (writer.error_return,)))
        with writer.reserved_rows(CAPACITY) as self._first:
            if narrow is not None:
                self._emit_narrowing(narrow, limit)
            yield

    def _emit_narrowing(self, narrow: Narrow, limit: int | None) -> None:
        """Emit code that keeps the rows that pass tests, the largest values first. A value is in the first column."""
        writer, first, kept = self._writer, self._first, self._writer.module.new_local("n")
        value: CodeTerm | None = None

        def emit_test() -> None:
            nonlocal value
            loads, names = self._load_match()
            writer.append(*loads)
            tests, value = narrow(names)
            self._column = 0 if value is None else 1
            row = emit_sum(first, kept)
            cells = writer.matching.row_cells(writer.matching.column_types(self._key), row, self._column)
            stores = [
                code.Assign(cell, self._slots[position])
                for cell, position in zip(cells, self._key.outputs, strict=True)
            ]
            if value is not None:
                cell = emit_entry(RF if value.type is Scalar.FLOAT else RI, row, 0)
                stores.append(code.Assign(cell, code.Operation("-", (value.value,))))
            more = code.Assign(kept, ONE, "+=")
            writer.append(code.If(code.emit_joined("and", tests, True), (*stores, more)))

        writer.append_assignment(kept, ZERO)
        place = writer.module.new_local("i")
        body = writer.collect(emit_test)
        there = code.Assign(self._row, emit_sum(first, place))
        writer.append(code.For(place, code.emit_call("range", self._left), (there, *body)))
        number: code.Expression = kept
        if value is not None:
            types = [value.type, *writer.matching.column_types(self._key)]
            kinds = sum(1 << column for column, type_ in enumerate(types) if type_ is Scalar.FLOAT)
            widths = map(code.Constant, (len(types), kinds, 0))
            number = code.emit_call("sort_rows", RI, RF, first, kept, *widths)
        writer.append_assignment(
            self._left, number if limit is None else code.emit_call("min", number, code.Constant(limit))
        )

    def _load_match(self) -> tuple[code.Body, dict[str, CodeTerm]]:
        """Return statements that load the row `_row`, and the terms of the match's variables."""
        loads, values = self._writer.matching.load_row(self._key, self._row, self._column)
        self._slots: dict[int, code.Local] = {**self._given, **dict(zip(self._key.outputs, values, strict=True))}
        names: dict[str, CodeTerm] = {}
        for position, (name, type_) in enumerate(zip(self._plan.variables, self._plan.types, strict=True)):
            names[name] = object_or_value_term(self._writer, self._slots[position], type_)
        return loads, names

    # --- applications

    def emit_one(self, result: CallResult, *, in_order: bool = False) -> None:
        """Emit code that applies the rule at a random row, or the first; if it is refused, at another, or the next.

        The variables of the result are 0 before.
        """
        writer, last = self._writer, emit_sum(self._first, self._left)

        def attempt() -> None:
            place = ZERO if in_order else code.emit_call("pick", D, self._left)
            writer.append(code.Assign(self._row, emit_sum(self._first, place)))
            writer.append(code.Assign(emit_state_entry(ERROR), ZERO), *self._load_match()[0])
            drop = code.emit_call_statement("drop_row", RI, RF, self._row, last)
            self._emit_fire(result, (*put_back, drop, code.Assign(self._left, ONE, "-=")))

        with writer.saved_state(self._may_be_refused) as put_back:
            going = code.emit_equal(result.done, ZERO), code.Operation(">", (self._left, ZERO))
            writer.append(code.While(code.Operation("and", going), writer.collect(attempt)))

    def emit_every(self, count_step: Callable[[], None], any_done: code.Local) -> None:
        """Emit code that applies the rule at each row that is still a match, unless it is refused there.

        The code sets `any_done` to 1 if the rule was applied at a row.
        """
        writer, place, once = self._writer, self._writer.module.new_local("i"), self._writer.emit_results({})

        def apply() -> None:
            with writer.saved_state(self._may_be_refused) as put_back:
                self._emit_fire(once, put_back)
            writer.append(code.Assign(any_done, code.emit_call("max", any_done, once.done)))

        def each() -> None:
            count_step()
            loads, names = self._load_match()
            writer.append(code.Assign(self._row, emit_sum(self._first, place)), *loads)
            writer.append_if(emit_holds(writer, self._key.pattern, [*names.values()]), apply)

        body = writer.collect(each)
        writer.append(code.For(place, code.emit_call("range", self._left), body))

    def _emit_fire(self, result: CallResult, refused: code.Body) -> None:
        """Emit code that applies the rule at the loaded row; after a refusal it runs `refused` and sets `done` to 0."""
        writer, rule, done = self._writer, self._rule, result.done

        def emit_effects() -> tuple[list[code.Local], code.Body]:
            here = [writer.facts.new_local_for(type_) for type_ in self._plan.types]
            return here, writer.emit_rule_effects(rule, dict(enumerate(here)), self._wanted)

        fired = writer.module.function_for(("fire", rule.rule, self._wanted), "fire", emit_effects)
        call = writer.emit_function_call(fired, *(self._slots[position] for position in sorted(self._slots)))
        writer.append(result.assign(call))
        fatal = code.Operation("!=", (emit_state_entry(ERROR), code.Name("REFUSED")))
        failed = (code.If(fatal, (writer.error_return,)), *refused, code.Assign(done, ZERO))
        writer.append(code.If(code.Operation("<", (done, ZERO)), failed))


def may_rule_be_refused(writer: FunctionEmitter, rule: RuleCall) -> bool:
    """Return True if the model may refuse a rule, after which a unit tries another match, or the step goes on.

    Raises:
        NotCompiled: it depends on the order of a block's matches if one is refused or contradicts another.
    """
    plan = plan_of(writer.engine, rule)
    if any(block.identification_pairs or block.identification_link_pairs for block in plan.blocks[1:]):
        raise NotCompiled(
            f"refusals of a rule whose blocks may delete an object that they keep (`{rule.rule}`)", rule.span
        )
    return may_be_refused(plan, writer.facts.metamodel)


def object_or_value_term(writer: FunctionEmitter, value: code.Expression, type_: StaticType | None) -> CodeTerm:
    """Return the term of a variable, whose class is certain if no object of it is created, retyped or deleted."""
    fixed = isinstance(type_, ObjectType) and writer.facts.changes.is_fixed_class(type_.cls)
    return variable_term(value, type_, type_.cls if fixed and isinstance(type_, ObjectType) else None)


def emit_holds(writer: FunctionEmitter, pattern: str, terms: Sequence[CodeTerm]) -> code.Expression:
    """Return code that tests if a pattern holds for values of all its parameters; objects may lack their class."""
    types = writer.facts.library.parameter_types(pattern)
    tests = [
        test
        for term, type_ in zip(terms, types, strict=True)
        if isinstance(type_, ObjectType)
        for test in class_tests(writer.facts, term, type_.cls)
    ]
    exists = writer.matching.emit_exists(PatternQuery(pattern, tuple(range(len(types))), ()))
    held = writer.emit_function_call(exists, *(term.number_code for term in terms))
    return code.emit_joined("and", [*tests, held], True)


def class_tests(facts: ModelReader, term: CodeTerm, cls: str) -> list[code.Expression]:
    """Return the test that an object is of a class and exists; no test if this is certain."""
    assert isinstance(term.type, ObjectType)
    certain = facts.metamodel.is_a(term.certain_class or term.type.cls, cls)
    certain = certain and (term.certain_class is not None or facts.changes.is_fixed_class(cls))
    return [] if certain else [facts.emit_is_instance(term.value, cls)]
