"""Emit the effects of a rule on a state, as assignments to the cells of the state."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from envgraph import code
from envgraph.env.compiled.effects._block_matches import MatchFrame
from envgraph.env.compiled.effects._link_changes import LinkEmitter
from envgraph.env.compiled.effects._match_conflicts import emit_agreement_checks, emit_kept_check
from envgraph.env.compiled.effects._match_statements import MatchStatements
from envgraph.env.compiled.effects._merge_code import MergeEmitter
from envgraph.env.compiled.effects._object_changes import ObjectChangeEmitter
from envgraph.env.compiled.layout._member_data import emit_missing_value
from envgraph.env.compiled.layout._program_layout import ZERO
from envgraph.env.compiled.matching._match_emitter import MatchEmitter
from envgraph.env.compiled.matching._term_code import ExpressionEmitter, variable_term
from envgraph.metamodel import Attribute, Scalar
from envgraph.pattern import Binary, ObjectType, StaticType, Variable
from envgraph.rewrite.plans import (
    AdjustAttribute,
    ChangeTargets,
    ComputeValue,
    RemoveLink,
    RulePlan,
    SetAttribute,
    SetAttributeValues,
    SetTargets,
    leaving_changes,
)


class EffectEmitter:
    """An emitter of the effects of a rule. Each phase handles all matches of all blocks before the next phase begins.

    Args:
        matching: emits functions that find matches of blocks, and has the reader of the model.
        plan: of the rule.
        slots: variables for the slots of the match.
        error_return: the return statement if the rule is refused.
    """

    def __init__(
        self, matching: MatchEmitter, plan: RulePlan, slots: Sequence[code.Expression], error_return: code.Return
    ) -> None:
        self._match = MatchStatements(matching, plan, slots, error_return)
        self._facts = matching.facts
        self._links, self._objects = LinkEmitter(self._match), ObjectChangeEmitter(self._match)
        self._merges = MergeEmitter(self._match, self._links)

    def slot_value(self, number: int) -> code.Expression:
        """Return the value of a slot of the rule. Call after `write`."""
        return self._match.slots[number]

    def emit(self) -> code.Body:
        """Return the statements that find matches, check for conflicts, and make all changes in order.

        The statements set the error of the state and leave if the rule is refused.
        """
        self._match.append(*self._match.blocks.emit_search())
        for phase in (self._emit_computations, self._emit_identity_checks):
            self._emit_phase(phase)
        if self._match.plan.body.may_contradict:
            emit_agreement_checks(self._match)
        for phase in (self._emit_unlinks, self._emit_deletions):
            self._emit_phase(phase)
        self._emit_phase(lambda: emit_kept_check(self._match))
        self._merges.emit_start()
        for phase in (
            self._emit_strips,
            self._emit_retypings,
            self._emit_creations,
            self._emit_links,
            self._emit_assignments,
        ):
            self._emit_phase(phase)
        return self._match.all_statements()

    def _emit_phase(self, write: Callable[[], None]) -> None:
        """Call `write` to emit a phase for the match of the rule, and for the matches of each block in loops.

        The order is that of the live engine: after each match of a block come those of its inner blocks.
        """
        write()
        for loop in self._inner_loops(self._match.rule, write):
            self._match.append(*loop(None))

    def _inner_loops(
        self, outer: MatchFrame, write: Callable[[], None]
    ) -> list[Callable[[code.Local | None], code.Body]]:
        """Return a function for each block in `outer` with statements in a phase.

        It returns a loop over the matches that were found in an outer row, or in any row if it is given None.
        """
        inner = [frame for frame in self._match.blocks.frames if frame.outer is outer]
        return [loop for frame in inner if (loop := self._phase_loop(frame, write)) is not None]

    def _phase_loop(
        self, frame: MatchFrame, write: Callable[[], None]
    ) -> Callable[[code.Local | None], code.Body] | None:
        statements, fresh = self._match, self._facts.module.new_local
        row = fresh("r")
        loads, slots = statements.blocks.load_match(frame, row)
        statements.set_match(frame, slots, row)
        own = statements.collect(write)
        statements.set_match(statements.rule, statements.rule.slots, None)
        inner = self._inner_loops(frame, write)

        def loop(outer_row: code.Local | None) -> code.Body:
            if outer_row is None and not own and len(inner) == 1:
                return inner[0](None)
            within = None if outer_row is None else (fresh("i"), outer_row)
            if within is not None:
                statements.append_assignment(within[0], ZERO)
            body = (*own, *(statement for one in inner for statement in one(row)))
            return statements.blocks.loop_over_matches(frame, row, loads, body, within)

        return loop if own or inner else None

    # --- phases

    def _emit_computations(self) -> None:
        for unlink in self._match.frame.plan.unlinks:
            if unlink.is_required:
                self._match.append_refuse_unless(
                    self._links.emit_is_linked(unlink.source, unlink.reference, unlink.target)
                )
        for compute in self._match.frame.plan.computed:
            self._emit_computation(compute)

    def _emit_unlinks(self) -> None:
        for unlink in self._match.frame.plan.unlinks:
            self._links.emit_unlink(unlink)
        for move in self._match.frame.plan.moves:
            self._links.emit_leave_container(move.node, move.reference, (move.container,))
        alone = not self._match.plan.body.may_contradict
        for change in leaving_changes(self._match.frame.plan, self._facts.metamodel, alone=alone):
            self._links.emit_release(change)

    def _emit_deletions(self) -> None:
        for delete in self._match.frame.plan.deletes:
            made = self._match.collect(lambda each=delete: self._objects.emit_delete(each))  # type: ignore[misc]
            stays = code.emit_not(self._objects.emit_is_inside_deleted(delete))
            self._match.append(*(made if stays == code.TRUE else [code.If(stays, made)]))

    def _emit_strips(self) -> None:
        for absorb in self._match.frame.plan.absorbs:
            self._merges.emit_strip(absorb)

    def _emit_retypings(self) -> None:
        for retype in self._match.frame.plan.retypes:
            self._objects.emit_retype(retype)

    def _emit_creations(self) -> None:
        for new in self._match.frame.plan.creates:
            self._objects.emit_create(new)

    def _emit_links(self) -> None:
        for absorb in self._match.frame.plan.absorbs:
            self._merges.emit_merge(absorb)
        for move in self._match.frame.plan.moves:
            self._links.emit_link(move)
        for link in self._match.frame.plan.links:
            self._links.emit_link(link)

    def _emit_assignments(self) -> None:
        for change in self._match.frame.plan.sets:
            match change:
                case SetAttributeValues(_, attribute) | AdjustAttribute(_, attribute) if attribute.many:
                    self._links.emit_change_values(change)
                case SetAttribute():
                    self._emit_set(change)
                case AdjustAttribute():
                    self._emit_increase(change)
                case SetTargets():
                    self._links.emit_set_targets(change)
                case ChangeTargets():
                    self._links.emit_change_targets(change)
                case _:
                    raise AssertionError(change)

    def _emit_identity_checks(self) -> None:
        """Emit code that refuses the rule if an object or link to be deleted occurs again in the same match."""
        for gone, other in self._match.frame.plan.identification_pairs:
            self._match.append_refuse_unless(code.Operation("!=", (self._match.slots[gone], self._match.slots[other])))
        for one, another in self._match.frame.plan.identification_link_pairs:
            others = (another.source, another.target)
            if one.reference != another.reference:
                others = others[::-1]
            self._emit_difference_check(one, others)
            if self._facts.links.is_symmetric(one.reference):
                self._emit_difference_check(one, others[::-1])

    def _emit_difference_check(self, link: RemoveLink, others: tuple[int, int]) -> None:
        """Emit code that refuses the rule if a link has the same ends as the objects in two slots."""
        slots = self._match.slots
        pairs = zip((link.source, link.target), others, strict=True)
        same = [code.emit_equal(slots[end], slots[other]) for end, other in pairs]
        self._match.append_refuse_unless(code.emit_not(code.emit_joined("and", same, True)))

    # --- values

    def _emit_computation(self, compute: ComputeValue) -> None:
        names = {}
        for name, slot, type_ in compute.variables:
            sure = self._match.frame.classes.get(slot)
            names[name] = variable_term(self._match.slots[slot], type_, sure)
        terms = ExpressionEmitter(self._facts, names)
        term = terms.emit(compute.expression, self._expected_type(compute.slot))
        self._match.append(*terms.statements)
        for test in term.valid if not compute.is_required else term.tests:
            self._match.append_fail_if(code.emit_not(test))
        self._match.frame.types[compute.slot] = term.type
        local = self._facts.new_local_for(term.type or ObjectType(""))
        value = term.number_code
        optional = term.present if not compute.is_required else ()
        if optional:
            value = code.ConditionalExpression(
                code.emit_joined("and", optional, True), value, emit_missing_value(term.type or ObjectType(""))
            )
        self._match.append(code.Assign(local, value))
        self._match.slots[compute.slot] = local
        if self._match.match_row is not None:
            self._match.append(code.Assign(self._match.frame.slot_cell(compute.slot, self._match.match_row), local))

    def _expected_type(self, slot: int) -> StaticType | None:
        """Return the type of the attribute that gets the value of a slot, or None if no attribute does."""
        for change in self._match.frame.plan.sets:
            if isinstance(change, SetAttribute | AdjustAttribute | SetAttributeValues):
                values = change.values if isinstance(change, SetAttributeValues) else (change.value,)
                if slot in values:
                    return change.attribute.type
        return None

    def _attribute_cell(self, slot: int, attribute: Attribute) -> code.Subscript:
        node = self._match.slots[slot]
        place, guard = self._facts.attribute_cell(
            attribute, node, class_known=self._match.has_certain_class(slot, attribute.owner)
        )
        for test in guard:
            self._match.append_refuse_unless(test)
        return place

    def _emit_set(self, change: SetAttribute) -> None:
        attribute = change.attribute
        value = emit_missing_value(attribute.type)
        if change.value is not None:
            value = self._match.frame.converted_value(self._match.slots, change.value, attribute)
            value = _without_negative_zero(value, attribute)
        self._match.append(code.Assign(self._attribute_cell(change.object, attribute), value))

    def _emit_increase(self, change: AdjustAttribute) -> None:
        attribute = change.attribute
        place = self._attribute_cell(change.object, attribute)
        self._match.append_fail_if(code.emit_not(self._facts.emit_is_present(place, attribute.type)))
        amount = self._match.frame.converted_value(self._match.slots, change.value, attribute)
        sides = {"old": place, "by": amount}
        terms = ExpressionEmitter(self._facts, {name: variable_term(sides[name], attribute.type) for name in sides})
        made = terms.emit(Binary(change.operator[0], Variable("old"), Variable("by"), change.span))
        self._match.append(*terms.statements)
        self._match.append_fail_if(code.emit_not(code.emit_joined("and", made.tests, True)))
        self._match.append(code.Assign(place, _without_negative_zero(made.value, attribute)))


def _without_negative_zero(value: code.Expression, attribute: Attribute) -> code.Expression:
    """Return a value with -0.0 replaced by 0.0, since states are compared by their bits."""
    return code.Operation("+", (value, code.Constant(0.0))) if attribute.type is Scalar.FLOAT else value
