"""Emit tests for conflicts between the matches of a rule and its blocks, as the live engine finds them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Literal

from envgraph import code
from envgraph.code import dataclass
from envgraph.env.compiled._block_matches import MatchFrame, Slots
from envgraph.env.compiled._match_statements import MatchStatements
from envgraph.env.compiled._member_data import emit_missing_value
from envgraph.env.compiled._not_compiled import NotCompiled
from envgraph.env.compiled._program_layout import NOBODY, ZERO
from envgraph.env.compiled._term_code import CodeTerm, emit_as_float
from envgraph.metamodel import Attribute, Metamodel, Reference, Scalar
from envgraph.pattern import Constant, EnumLiteral, StaticType
from envgraph.rewrite.plans import AdjustAttribute, BlockPlan, ChangeTargets, SetAttribute, SetTargets

Kind = Literal["gone", "touched", "class", "owner", "value", "removed", "withdrawn", "added", "targets", "end"]


@dataclass(frozen=True, slots=True)
class MatchClaim:
    """An effect that a match requires, for comparison with those of other matches.

    Attributes:
        node: slot of the object that the effect is about.
        subject: the feature, or the class; None for the container.
        other: slot of the other end of a link, or of the value; None for no value.
        present: slot of an object that may be missing, in which case the claim is void.
        forced: True if the action replaces other links.
        via: the reference of a link to a container.
    """

    kind: Kind
    node: int
    subject: Attribute | Reference | str | None = None
    other: int | None = None
    present: int | None = None
    forced: bool = False
    via: Reference | None = None


def claims_of(frame: MatchFrame, metamodel: Metamodel) -> Iterator[MatchClaim]:
    """Yield all effects that a match of a rule or block requires."""
    plan = frame.plan
    for delete in plan.deletes:
        yield MatchClaim("gone", delete.node)
    for retype in plan.retypes:
        yield MatchClaim("touched", retype.node)
        yield MatchClaim("class", retype.node, retype.cls)
    for move in plan.moves:
        yield from _link_claims(metamodel, move.reference, move.container, move.node, forced=True)
    for link in plan.links:
        yield from _link_claims(metamodel, link.reference, link.source, link.target, forced=False)
    for change in plan.sets:
        match change:
            case SetAttribute(node, attribute, value):
                yield MatchClaim("touched", node)
                yield MatchClaim("owner", node, attribute.owner)
                yield MatchClaim("value", node, attribute, value)
            case AdjustAttribute(node, attribute):
                yield MatchClaim("touched", node)
                yield MatchClaim("owner", node, attribute.owner)
                yield MatchClaim("value", node, attribute, forced=True)
            case SetTargets(node, reference, values):
                yield MatchClaim("touched", node)
                yield MatchClaim("owner", node, reference.owner)
                if not reference.many:  # else no other change is compiled
                    yield MatchClaim("targets", node, reference, values[0] if values else None)
                for value in values:
                    yield from _link_claims(metamodel, reference, node, value, forced=True)
            case ChangeTargets(node, reference, operator, values):
                yield MatchClaim("touched", node)
                yield MatchClaim("owner", node, reference.owner)
                for value in values:
                    if operator == "+=":
                        yield from _link_claims(metamodel, reference, node, value, forced=True)
                    else:
                        first, source, target = metamodel.canonical_link(reference, node, value)
                        yield MatchClaim("withdrawn", source, first, target, present=value)
            case _:
                raise AssertionError(change)
    for unlink in plan.unlinks:
        reference, source, target = metamodel.canonical_link(unlink.reference, unlink.source, unlink.target)
        yield MatchClaim("removed", source, reference, target)


def _link_claims(
    metamodel: Metamodel, reference: Reference, source: int, target: int, *, forced: bool
) -> Iterator[MatchClaim]:
    """Yield the effects that adding a link requires."""
    opposite = metamodel.opposite(reference)
    yield MatchClaim("touched", source, present=target)
    yield MatchClaim("touched", target, present=target)
    yield MatchClaim("owner", source, reference.owner, present=target)
    yield MatchClaim("owner", target, reference.target, present=target)
    first, start, end = metamodel.canonical_link(reference, source, target)
    yield MatchClaim("added", start, first, end, present=target)
    if opposite == reference:
        yield MatchClaim("added", end, first, start, present=target)
    if reference.upper == 1:
        yield MatchClaim("end", source, reference, target, target, forced)
    if opposite is not None and opposite.upper == 1:
        yield MatchClaim("end", target, opposite, source, target, forced)
    if (held := metamodel.containment_link(reference, source, target)) is not None:
        contains, container, content = held
        yield MatchClaim("end", content, None, container, target, forced, contains)


class ContradictionTests:
    """An emitter of tests that the required effects of two matches contradict each other.

    Args:
        metamodel: of the model.
        rule: the frame of the rule, which has only one match.
    """

    def __init__(self, metamodel: Metamodel, rule: MatchFrame) -> None:
        self._metamodel = metamodel
        self._rule = rule

    def contradictions(
        self, one: MatchFrame, slots: Slots, other: MatchFrame, others: Slots
    ) -> Iterator[code.Expression]:
        """Yield the conditions under which a match of one frame contradicts a match of another, or the same, frame."""
        first = [*claims_of(one, self._metamodel)]
        second = [*claims_of(other, self._metamodel)]
        for number, mine in enumerate(first):
            for theirs in second[number:] if one is other else second:
                for a, b in ((mine, theirs), (theirs, mine)):
                    swapped = a is not mine or b is not theirs
                    sides = (other, others, one, slots) if swapped else (one, slots, other, others)
                    found = self._contradiction(a, sides[0], sides[1], b, sides[2], sides[3])
                    if found is not None:
                        yield found
                    if mine is theirs and one is other:
                        break

    def _contradiction(
        self,
        a: MatchClaim,
        frame_a: MatchFrame,
        slots_a: Slots,
        b: MatchClaim,
        frame_b: MatchFrame,
        slots_b: Slots,
    ) -> code.Expression | None:
        """Return code that tests if claim `a` contradicts claim `b`, or None if it never does.

        Claims of two kinds are tested in one order only, so try both orders. `frame_a`, `slots_a` are the frame and
        slots of `a`.
        """
        metamodel = self._metamodel
        parts: list[code.Expression | None] = []
        match a.kind, b.kind:
            case "gone", "touched":
                pass
            case "class", "class" if a.subject != b.subject:
                pass
            case "class", "owner" if not metamodel.is_a(str(a.subject), str(b.subject)):
                pass
            case "value", "value" if a.subject == b.subject and not (a.forced and b.forced):
                if not (a.forced or b.forced):
                    parts.append(self._values_differ(a, frame_a, slots_a, b, frame_b, slots_b))
            case "removed" | "withdrawn", "added" if a.subject == b.subject:
                parts.append(self._same_object(a.other, frame_a, slots_a, b.other, frame_b, slots_b))
                if a.kind == "removed":
                    parts += self._tests_not_added(a, frame_a, slots_a)
            case "targets", "targets" if a.subject == b.subject:
                parts.append(code.Operation("!=", (_slot_value(a, slots_a), _slot_value(b, slots_b))))
            case "targets", "added":
                return self._is_other_target(a, frame_a, slots_a, b, frame_b, slots_b)
            case "end", "end" if a.subject == b.subject and (a.forced or b.forced):
                if a.via == b.via:
                    parts.append(code.Operation("!=", (_slot_value(a, slots_a), _slot_value(b, slots_b))))
            case _:
                return None
        return self._conjunction(
            [self._same_object(a.node, frame_a, slots_a, b.node, frame_b, slots_b), *parts],
            a,
            slots_a,
            b,
            slots_b,
        )

    def _conjunction(
        self,
        parts: list[code.Expression | None],
        a: MatchClaim,
        slots_a: Slots,
        b: MatchClaim,
        slots_b: Slots,
    ) -> code.Expression | None:
        """Return code that tests if all parts hold and neither claim is void; None if a part is None (never true)."""
        known = [part for part in parts if part is not None]
        if len(known) < len(parts):
            return None
        for claim, slots in ((a, slots_a), (b, slots_b)):
            if claim.present is not None:
                known.append(code.Operation(">=", (slots[claim.present], ZERO)))
        return code.emit_joined("and", [part for part in known if part != code.TRUE], True)

    def _same_object(
        self,
        slot: int | None,
        frame_a: MatchFrame,
        slots_a: Slots,
        other: int | None,
        frame_b: MatchFrame,
        slots_b: Slots,
    ) -> code.Expression | None:
        """Return code that tests if two slots of two matches hold the same object, or None if they never do."""
        assert slot is not None
        assert other is not None
        if frame_a.creators.get(slot) is not frame_b.creators.get(other) or (
            slot in frame_a.creators and slot != other
        ):
            return None
        cls, another = frame_a.classes.get(slot), frame_b.classes.get(other)
        if cls is not None and another is not None and not self._metamodel.may_overlap(cls, another):
            return None
        rule = self._rule.plan
        if max(slot, other) < rule.variable_count:
            if slot == other:
                return code.TRUE
            if not rule.may_coincide:
                return None
        return code.emit_equal(slots_a[slot], slots_b[other])

    def _is_other_target(
        self,
        a: MatchClaim,
        frame_a: MatchFrame,
        slots_a: Slots,
        b: MatchClaim,
        frame_b: MatchFrame,
        slots_b: Slots,
    ) -> code.Expression | None:
        """Return code that tests if an added link has another target than a claim sets, or None if it never has."""
        assert isinstance(a.subject, Reference)
        assert b.other is not None
        near, far = b.node, b.other
        if a.subject != b.subject:
            if a.subject != self._metamodel.opposite(b.subject):  # type: ignore[arg-type]
                return None
            near, far = far, near
        differ = code.Operation("!=", (_slot_value(a, slots_a), slots_b[far]))
        return self._conjunction(
            [self._same_object(a.node, frame_a, slots_a, near, frame_b, slots_b), differ],
            a,
            slots_a,
            b,
            slots_b,
        )

    def _tests_not_added(self, a: MatchClaim, frame: MatchFrame, slots: Slots) -> list[code.Expression | None]:
        """Return tests that the match does not also add the link that it removes, since such a link stays."""
        found: list[code.Expression | None] = []
        for link in frame.plan.links:
            reference, source, target = self._metamodel.canonical_link(link.reference, link.source, link.target)
            if reference != a.subject:
                continue
            symmetric = self._metamodel.opposite(reference) == reference
            for start, end in [(source, target), (target, source)] if symmetric else [(source, target)]:
                ends = [
                    self._same_object(a.node, frame, slots, start, frame, slots),
                    self._same_object(a.other, frame, slots, end, frame, slots),
                ]
                if None not in ends:
                    both = code.emit_joined("and", [end for end in ends if end is not None], True)
                    found.append(code.emit_not(both))
        return found

    @staticmethod
    def _values_differ(
        a: MatchClaim, frame_a: MatchFrame, slots_a: Slots, b: MatchClaim, frame_b: MatchFrame, slots_b: Slots
    ) -> code.Expression | None:
        """Return code that tests if the values of two claims differ (NaN equals NaN); None if both are one constant."""
        constants = [_constant_value(claim, frame) for claim, frame in ((a, frame_a), (b, frame_b))]
        if None not in constants and constants[0] == constants[1]:
            return None
        assert isinstance(a.subject, Attribute)
        values = [
            emit_missing_value(a.subject.type)
            if claim.other is None
            else converted_value(slots[claim.other], frame.types.get(claim.other, a.subject.type), a.subject)
            for claim, frame, slots in ((a, frame_a, slots_a), (b, frame_b, slots_b))
        ]
        differ = code.Operation("!=", (values[0], values[1]))
        if a.subject.type is not Scalar.FLOAT:
            return differ
        there = [code.emit_equal(value, value) for value in values]
        return code.Operation("and", (differ, code.emit_joined("or", there, False)))


def _slot_value(claim: MatchClaim, slots: Mapping[int, code.Expression]) -> code.Expression:
    return NOBODY if claim.other is None else slots[claim.other]


def _constant_value(claim: MatchClaim, frame: MatchFrame) -> object:
    """Return a comparable value that a claim's value has in every match, or None if it is not a constant.

    A literal constant is returned with its Python type, a missing value as `"no value"`.
    """
    if claim.other is None:
        return "no value"
    for compute in frame.plan.computed:
        if compute.slot == claim.other:
            match compute.expression:
                case Constant(value):
                    return type(value), value
                case EnumLiteral(literal=literal):
                    return literal
    return None


def converted_value(value: code.Expression, type_: StaticType | None, attribute: Attribute) -> code.Expression:
    """Return the expression of a value, converted to float if the attribute is a float and the value is not."""
    if attribute.type is Scalar.FLOAT and type_ is not Scalar.FLOAT:
        return emit_as_float(CodeTerm(value, Scalar.INT))
    return value


def emit_agreement_checks(matches: MatchStatements) -> None:
    """Emit code that refuses the rule if two of its matches contradict each other.

    Raises:
        NotCompiled: several blocks make changes whose order affects the result.
    """
    frames, pairs = matches.blocks.frames, ContradictionTests(matches.facts.metamodel, matches.rule)
    _check_order(matches)
    for number, one in enumerate(frames):
        for other in frames[number:]:
            _emit_pair_check(matches, pairs, one, other)


def _emit_pair_check(matches: MatchStatements, pairs: ContradictionTests, one: MatchFrame, other: MatchFrame) -> None:
    sides = []
    for frame in (one, other):
        row = matches.facts.module.new_local("r")
        loads, slots = ([], frame.slots) if frame.outer is None else matches.blocks.load_match(frame, row)
        sides.append((frame, row, loads, slots))
    tests = dict.fromkeys(pairs.contradictions(one, sides[0][3], other, sides[1][3]))
    body: code.Body = tuple(code.If(test, matches.failure_statements("REFUSED")) for test in tests)
    for frame, row, loads, _ in reversed(sides):
        if body and frame.outer is not None:
            body = (matches.blocks.loop_over_matches(frame, row, loads, body),)
    matches.append(*body)


def _check_order(matches: MatchStatements) -> None:
    """Raise `NotCompiled` if several blocks make changes whose order affects the result."""
    changing: dict[Attribute | Reference, BlockPlan] = {}
    for frame in matches.blocks.frames:
        for change in frame.plan.sets:
            feature: Attribute | Reference | None = None
            if isinstance(change, ChangeTargets):
                feature, _, _ = matches.facts.metamodel.canonical_link(change.reference, 0, 0)
            elif isinstance(change, AdjustAttribute) and change.attribute.type is Scalar.FLOAT:
                feature = change.attribute
            elif isinstance(change, SetTargets):
                opposite = matches.facts.metamodel.opposite(change.reference)
                feature = change.reference if opposite is not None and opposite.upper not in (None, 1) else None
            if feature is not None and changing.setdefault(feature, frame.plan) is not frame.plan:
                raise NotCompiled(f"changes of `{feature}` in several blocks of a rule", frame.plan.span)


def emit_kept_checks(matches: MatchStatements) -> None:
    """Emit code that refuses the rule if an object that it keeps or changes was deleted with its container.

    Raises:
        NotCompiled: blocks delete containers together with objects that these may contain.
    """
    metamodel, frames = matches.facts.metamodel, matches.blocks.frames
    deletes = [(delete, frame.plan) for frame in frames for delete in frame.plan.deletes]
    doomed = [one for delete, plan in deletes for one in metamodel.concrete_classes(plan.classes[delete.node] or "")]
    endangered = metamodel.all_content_classes(doomed)
    for frame in frames:
        slots = dict.fromkeys(frame.plan.preserved_slots)
        slots.update(dict.fromkeys(c.node for c in claims_of(frame, metamodel) if c.kind == "touched"))
        if len(frames) > 1 and not matches.plan.is_spo:  # if links go too, order is irrelevant
            slots.update(dict.fromkeys(delete.node for delete in frame.plan.deletes))
        for slot in slots:
            cls = frame.classes.get(slot)
            if slot in frame.creators or not any(cls is None or metamodel.may_overlap(one, cls) for one in endangered):
                continue
            if len(frames) > 1 or cls is None:
                first, plan = deletes[0]
                raise NotCompiled(
                    "a rule with blocks that deletes a container and its contents", first.span or plan.span
                )
            _emit_alive_check(matches, slot, cls)


def _emit_alive_check(matches: MatchStatements, slot: int, cls: str) -> None:
    """Emit code that refuses the rule if the object in a slot is deleted, unless a `delete` action names the object."""
    alive = matches.facts.emit_is_alive(matches.slots[slot], cls)
    if alive is not None:
        same = [
            code.emit_equal(matches.slots[slot], matches.slots[delete.node]) for delete in matches.rule.plan.deletes
        ]
        matches.append_refuse_unless(code.emit_joined("or", [alive, *same], False))
