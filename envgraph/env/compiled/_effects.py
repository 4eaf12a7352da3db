"""Emit the effects of a rule on a state, as assignments to the cells of the state."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from envgraph import code
from envgraph.env.compiled._contradictions import check_agreement, check_kept, fitted
from envgraph.env.compiled._links import Links
from envgraph.env.compiled._matching import Matching
from envgraph.env.compiled._member import absent
from envgraph.env.compiled._objects import Objects
from envgraph.env.compiled._site import Site
from envgraph.env.compiled._tables import WORD
from envgraph.env.compiled._terms import Term, Terms, named
from envgraph.metamodel import Attribute, Scalar
from envgraph.pattern import ObjectType, StaticType
from envgraph.rewrite.plans import (
    ChangeTargets,
    Compute,
    Increase,
    RulePlan,
    SetTargets,
    SetValue,
    Unlink,
)


class Effects:
    """An emitter of the effects of a rule. Each phase handles all matches of all blocks before the next phase begins.

    Args:
        matching: emits functions that find matches of blocks, and has the reader of the model.
        plan: of the rule.
        slots: variables for the slots of the match.
        leave: the return statement if the rule is refused.
    """

    def __init__(
        self, matching: Matching, plan: RulePlan, slots: Sequence[code.Expression], leave: code.Return
    ) -> None:
        self._site = Site(matching, plan, slots, leave)
        self._facts = matching.facts
        self._links, self._objects = Links(self._site), Objects(self._site)

    def slot(self, number: int) -> code.Expression:
        """Return the value of a slot of the rule. Call after `write`."""
        return self._site.slots[number]

    def write(self) -> code.Body:
        """Return the statements that find matches, check for conflicts, and make all changes in order.

        The statements set the error of the state and leave if the rule is refused.
        """
        self._site.add(*self._site.blocks.collect())
        body = self._site.plan.body
        self._each(self._compute_all)
        if body.nested or body.coinciding or body.contended:
            check_agreement(self._site)
        for phase in (self._unlink_all, self._delete_all):
            self._each(phase)
        check_kept(self._site)
        for phase in (self._retype_all, self._create_all, self._link_all):
            self._each(phase)
        self._each(self._set_all)
        return self._site.written()

    def _each(self, write: Callable[[], None]) -> None:
        """Call `write` to emit a phase: for the match of the rule, and in a loop for the matches of each block."""
        for frame in self._site.blocks.frames:
            if frame.outer is None:
                write()
                continue
            row = self._facts.module.fresh("r")
            loads, slots = self._site.blocks.loaded(frame, row)
            self._site.enter(frame, slots, row)
            made = self._site.collected(write)
            if made:
                self._site.add(self._site.blocks.each(frame, row, loads, made))
            self._site.enter(self._site.rule, self._site.rule.slots, None)

    # --- phases

    def _compute_all(self) -> None:
        self._identify()
        for unlink in self._site.frame.plan.unlinks:
            if unlink.required:
                self._site.unless(self._links.linked(unlink.source, unlink.reference, unlink.target))
        for compute in self._site.frame.plan.computed:
            self._compute(compute)

    def _unlink_all(self) -> None:
        for unlink in self._site.frame.plan.unlinks:
            self._links.unlink(unlink)
        for move in self._site.frame.plan.moves:
            self._links.leave_containers(move)

    def _delete_all(self) -> None:
        for delete in self._site.frame.plan.deletes:
            made = self._site.collected(lambda each=delete: self._objects.delete(each))  # type: ignore[misc]
            outside = self._objects.outside(delete)
            self._site.add(*([code.If(code.joined("and", outside, True), made)] if outside else made))

    def _retype_all(self) -> None:
        for retype in self._site.frame.plan.retypes:
            self._objects.retype(retype)

    def _create_all(self) -> None:
        for new in self._site.frame.plan.creates:
            self._objects.create(new)

    def _link_all(self) -> None:
        for move in self._site.frame.plan.moves:
            self._links.link(move)
        for link in self._site.frame.plan.links:
            self._links.link(link)

    def _set_all(self) -> None:
        for change in self._site.frame.plan.sets:
            match change:
                case SetValue():
                    self._set(change)
                case Increase():
                    self._increase(change)
                case SetTargets(_, reference) if self._facts.metamodel.containment(reference, 0, 1):
                    self._links.set_container(change)
                case SetTargets(_, reference) if reference.many:
                    self._links.set_targets(change)
                case SetTargets():
                    self._links.set_target(change)
                case ChangeTargets():
                    self._links.change_targets(change)
                case _:
                    raise AssertionError(change)

    def _identify(self) -> None:
        """Emit code that refuses the rule if an object or link to be deleted occurs again in the same match."""
        for gone, other in self._site.frame.plan.identified:
            self._site.unless(code.Operation("!=", (self._site.slots[gone], self._site.slots[other])))
        for one, another in self._site.frame.plan.identified_links:
            others = (another.source, another.target)
            if one.reference != another.reference:
                others = others[::-1]
            self._different(one, others)
            if self._facts.links.symmetric(one.reference):
                self._different(one, others[::-1])

    def _different(self, link: Unlink, others: tuple[int, int]) -> None:
        """Emit code that refuses the rule if a link has the same ends as the objects in two slots."""
        slots = self._site.slots
        pairs = zip((link.source, link.target), others, strict=True)
        same = [code.equal(slots[end], slots[other]) for end, other in pairs]
        self._site.unless(code.inverse(code.joined("and", same, True)))

    # --- values

    def _compute(self, compute: Compute) -> None:
        names = {}
        for name, slot, type_ in compute.scope:
            sure = self._site.frame.classes.get(slot)
            names[name] = named(self._site.slots[slot], type_, sure)
        terms = Terms(self._facts, names)
        term = terms.write(compute.expression, self._expected(compute.slot))
        self._site.add(*terms.steps)
        for test in term.valid if not compute.needed else term.tests:
            self._site.fail_if(code.inverse(test))
        self._site.frame.types[compute.slot] = term.type
        local = self._facts.local(term.type or ObjectType(""))
        value = term.number
        optional = term.present if not compute.needed else ()
        if term.beyond is not None and self._expected(compute.slot) is not Scalar.FLOAT:
            self._site.fail_if(code.joined("and", [*optional, term.beyond], True), "BEYOND")
        if optional:
            value = code.Choice(
                code.joined("and", optional, True), value, absent(term.type or ObjectType(""))
            )
        self._site.add(code.Assign(local, value))
        self._site.slots[compute.slot] = local
        if self._site.row is not None:
            self._site.add(code.Assign(self._site.frame.space(compute.slot, self._site.row), local))

    def _expected(self, slot: int) -> StaticType | None:
        """Return the type of the attribute that gets the value of a slot, or None if no attribute does."""
        values = (SetValue, Increase)
        found = (
            one.attribute
            for one in self._site.frame.plan.sets
            if isinstance(one, values) and one.value == slot
        )
        return next((attribute.type for attribute in found), None)

    def _fitting(self, slot: int, attribute: Attribute) -> code.Expression:
        """Return the value of a slot, converted to the type of an attribute."""
        return fitted(self._site.slots[slot], self._site.frame.types.get(slot, attribute.type), attribute)

    def _cell(self, slot: int, attribute: Attribute) -> code.Index:
        node = self._site.slots[slot]
        place, guard = self._facts.attribute_cell(
            attribute, node, sure=self._site.sure(slot, attribute.owner)
        )
        for test in guard:
            self._site.unless(test)
        return place

    def _set(self, change: SetValue) -> None:
        attribute = change.attribute
        if change.value is None:
            self._site.add(code.Assign(self._cell(change.object, attribute), absent(attribute.type)))
            return
        value = self._fitting(change.value, attribute)
        self._site.add(code.Assign(self._cell(change.object, attribute), _one_zero(value, attribute)))

    def _increase(self, change: Increase) -> None:
        attribute = change.attribute
        place = self._cell(change.object, attribute)
        self._site.fail_if(code.inverse(self._facts.present(place, attribute.type)))
        made = code.Operation(change.operator[0], (place, self._fitting(change.value, attribute)))
        local = self._facts.local(attribute.type)
        self._site.add(code.Assign(local, made))
        if attribute.type is Scalar.FLOAT:
            finite = code.Operation("<", (code.call("abs", local), code.Name("INFINITY")))
            self._site.fail_if(code.inverse(finite))
        if (beyond := Term(local, attribute.type, bits=WORD + 1).beyond) is not None:
            self._site.fail_if(beyond, "BEYOND")
        self._site.add(code.Assign(place, _one_zero(local, attribute)))


def _one_zero(value: code.Expression, attribute: Attribute) -> code.Expression:
    """Return a value with -0.0 replaced by 0.0, since states are compared by their bits."""
    return code.Operation("+", (value, code.Constant(0.0))) if attribute.type is Scalar.FLOAT else value
