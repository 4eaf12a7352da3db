"""Emit tests for conflicts between the matches of a rule and its blocks, as the live engine finds them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations_with_replacement
from typing import NamedTuple

from envgraph import code
from envgraph.env.compiled.effects._block_matches import MatchFrame, Slots
from envgraph.env.compiled.effects._match_statements import MatchStatements
from envgraph.env.compiled.layout._member_data import emit_missing_value
from envgraph.env.compiled.layout._program_layout import NOBODY, ZERO
from envgraph.metamodel import Attribute, Metamodel, Reference, Scalar
from envgraph.pattern import Constant, EnumLiteral
from envgraph.rewrite.plans import AddLink, Claim, claims_of, endangered_classes, kept_objects


class MatchClaim(NamedTuple):
    """A claim of a match: the claim of a rule or block, the frame of its matches, and the slots of one of them."""

    claim: Claim
    frame: MatchFrame
    slots: Slots


class ContradictionTests:
    """An emitter of tests that the claims of two matches contradict each other.

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
        first = [MatchClaim(claim, one, slots) for claim in claims_of(one.plan, self._metamodel)]
        second = [MatchClaim(claim, other, others) for claim in claims_of(other.plan, self._metamodel)]
        for number, mine in enumerate(first):
            for theirs in second[number:] if one is other else second:
                if one is other is self._rule and mine.claim.operation is theirs.claim.operation:
                    continue
                found = self._contradiction(mine, theirs) or self._contradiction(theirs, mine)
                if found is not None:
                    yield found

    def _contradiction(self, a: MatchClaim, b: MatchClaim) -> code.Expression | None:
        """Return code that tests if claim `a` contradicts claim `b`, or None if it never does.

        Claims of two kinds are tested in one order only, so try both orders. See `Claim`.
        """
        one, other = a.claim, b.claim
        parts: list[code.Expression | None] = [self._same_object(a, one.node, b, other.node)]
        same = one.subject == other.subject
        match one.kind, other.kind:
            case "gone", "touched":
                pass
            case "gone", "gone" if one.others or other.others:
                parts += [_differs(a, b)] if one.others and other.others else []
            case "class", "class" if not same:
                pass
            case "class", "owner" if not self._metamodel.is_a(str(one.subject), str(other.subject)):
                pass
            case "value", "value" if same and not (_is_partial(one) and _is_partial(other)):
                parts += [] if _is_partial(one) or _is_partial(other) else [_values_differ(a, b)]
            case "value", "added" if isinstance(one.subject, Reference) and not _is_partial(one):
                parts = self._tests_of_other_target(a, b)
            case "element", "element" if same and one.operator != other.operator:
                parts.append(code.emit_equal(_attribute_values(a)[0], _attribute_values(b)[0]))
            case "removed" | "withdrawn", "added" if same:
                parts.append(self._same_object(a, one.others[0], b, other.others[0]))
                parts += self._tests_not_added(a) if one.kind == "removed" else []
            case "end", "end" if same and (one.forced or other.forced):
                parts += [_differs(a, b)] if one.via == other.via else []
            case _:
                return None
        known = [part for part in parts if part is not None]
        if len(known) < len(parts):  # a part that is None is never true
            return None
        for side in (a, b):
            if side.claim.present is not None:
                known.append(code.Operation(">=", (side.slots[side.claim.present], ZERO)))
        return code.emit_joined("and", [part for part in known if part != code.TRUE], True)

    def _same_object(self, a: MatchClaim, slot: int, b: MatchClaim, other: int) -> code.Expression | None:
        """Return code that tests if two slots of two matches hold the same object, or None if they never do."""
        if a.frame.creators.get(slot) is not b.frame.creators.get(other) or (
            slot in a.frame.creators and slot != other
        ):
            return None
        cls, another = a.frame.classes.get(slot), b.frame.classes.get(other)
        if cls is not None and another is not None and not self._metamodel.may_overlap(cls, another):
            return None
        rule = self._rule.plan
        if max(slot, other) < rule.variable_count:
            if slot == other:
                return code.TRUE
            if not rule.may_coincide:
                return None
        return code.emit_equal(a.slots[slot], b.slots[other])

    def _tests_of_other_target(self, a: MatchClaim, b: MatchClaim) -> list[code.Expression | None]:
        """Return tests that an added link is of an object whose targets a claim sets, and has another target."""
        (far,), near, added = b.claim.others, b.claim.node, b.claim.subject
        assert isinstance(added, Reference)
        if a.claim.subject != added:
            if a.claim.subject != self._metamodel.opposite(added):
                return [None]
            near, far = far, near
        targets = [a.slots[slot] for slot in a.claim.others] or [NOBODY]
        others = [code.Operation("!=", (target, b.slots[far])) for target in targets]
        return [self._same_object(a, a.claim.node, b, near), *others]

    def _tests_not_added(self, a: MatchClaim) -> list[code.Expression | None]:
        """Return tests that the match does not also add the link that it removes, since such a link stays."""
        found: list[code.Expression | None] = []
        for claim in claims_of(a.frame.plan, self._metamodel):
            if claim.kind == "added" and isinstance(claim.operation, AddLink) and claim.subject == a.claim.subject:
                pairs = (a.claim.node, claim.node), (a.claim.others[0], claim.others[0])
                ends = [self._same_object(a, slot, a, other) for slot, other in pairs]
                if None not in ends:
                    both = code.emit_joined("and", [end for end in ends if end is not None], True)
                    found.append(code.emit_not(both))
        return found


def _is_partial(claim: Claim) -> bool:
    """Return True for a change that agrees with those of other matches: of some targets, or a sum of amounts."""
    return bool(claim.operator) and not claim.others


def _differs(a: MatchClaim, b: MatchClaim) -> code.Expression:
    """Return code that tests if the other objects of two claims differ."""
    ends = [side.slots[side.claim.others[0]] if side.claim.others else NOBODY for side in (a, b)]
    return code.Operation("!=", tuple(ends))


def _values_differ(a: MatchClaim, b: MatchClaim) -> code.Expression | None:
    """Return code that tests if the values of two claims differ (NaN equals NaN); None if both are one constant."""
    if isinstance(a.claim.subject, Reference):
        if max(len(a.claim.others), len(b.claim.others)) < 2:
            return _differs(a, b)
        targets = [
            [(side.slots[slot], side.frame.classes.get(slot) is None) for slot in side.claim.others] for side in (a, b)
        ]
        return _targets_differ(*targets)
    values = [_attribute_values(side) for side in (a, b)]
    if a.claim.operator != b.claim.operator or len(values[0]) != len(values[1]):
        return code.TRUE
    constants = [_constant_value(side) for side in (a, b)]
    if None not in constants and constants[0] == constants[1]:
        return None
    assert isinstance(a.claim.subject, Attribute)
    tests: list[code.Expression] = []
    for pair in zip(*values, strict=True):
        differ = code.Operation("!=", pair)
        if a.claim.subject.type is Scalar.FLOAT:
            there = [code.emit_equal(value, value) for value in pair]
            differ = code.Operation("and", (differ, code.emit_joined("or", there, False)))
        tests.append(differ)
    return code.emit_joined("or", tests, False)


def _targets_differ(
    one: list[tuple[code.Expression, bool]], other: list[tuple[code.Expression, bool]]
) -> code.Expression:
    """Return code that tests if two lists of targets differ; a pair is an object and True if it may be missing (-1)."""
    for first, second, swapped in ((one, other, False), (other, one, True)):
        if first and (first[0][1] or not second):
            there = code.Operation(">=", (first[0][0], ZERO))
            rest = first[1:], second
            skipped = _targets_differ(*(rest[::-1] if swapped else rest))
            held = _targets_differ([(first[0][0], False), *first[1:]], second) if second else code.TRUE
            return code.ConditionalExpression(there, held, skipped) if first[0][1] else held
    if not one:
        return code.FALSE
    return code.emit_joined(
        "or", [code.Operation("!=", (one[0][0], other[0][0])), _targets_differ(one[1:], other[1:])], False
    )


def _attribute_values(side: MatchClaim) -> list[code.Expression]:
    """Return the new values that a claim requires for an attribute, converted to its type."""
    claim, attribute = side.claim, side.claim.subject
    assert isinstance(attribute, Attribute)
    if not (claim.others or attribute.many):
        return [emit_missing_value(attribute.type)]
    return [side.frame.converted_value(side.slots, slot, attribute) for slot in claim.others]


def _constant_value(side: MatchClaim) -> object:
    """Return a comparable value that a claim's value has in every match, or None if it is not a constant.

    A literal constant is returned with its Python type, a missing value as `"no value"`.
    """
    if not side.claim.others:
        return "no value"
    for compute in side.frame.plan.computed:
        if (compute.slot,) == side.claim.others:
            match compute.expression:
                case Constant(value):
                    return type(value), value
                case EnumLiteral(literal=literal):
                    return literal
    return None


def emit_agreement_checks(matches: MatchStatements) -> None:
    """Emit code that ends the rule with an error if two of its matches contradict each other."""
    pairs = ContradictionTests(matches.facts.metamodel, matches.rule)
    for one, other in combinations_with_replacement(matches.blocks.frames, 2):
        sides = []
        for frame in (one, other):
            row = matches.facts.module.new_local("r")
            loads, slots = matches.blocks.load_match(frame, row)
            sides.append((frame, row, loads, slots))
        tests = dict.fromkeys(pairs.contradictions(one, sides[0][3], other, sides[1][3]))
        body: code.Body = tuple(code.If(test, matches.failure_statements()) for test in tests)
        for frame, row, loads, _ in reversed(sides):
            body = matches.blocks.loop_over_matches(frame, row, loads, body)
        matches.append(*body)


def emit_kept_check(matches: MatchStatements) -> None:
    """Emit code that refuses the rule if an object that the current match keeps or changes went with its container."""
    metamodel = matches.facts.metamodel
    endangered = endangered_classes(matches.plan.blocks, metamodel)
    for slot, cls in kept_objects(matches.frame.plan, metamodel).items():
        alive = matches.facts.emit_is_alive(matches.slots[slot], cls) if cls in endangered else None
        if alive is not None and slot not in matches.frame.creators:

            def same(
                deleted: code.Expression, another: str, slot: int = slot, cls: str = cls
            ) -> code.Expression | None:
                overlap = metamodel.may_overlap(another, cls)
                return code.emit_equal(matches.slots[slot], deleted) if overlap else None

            matches.append_if(
                code.emit_not(alive), lambda: matches.append_refuse_unless(matches.emit_any_deleted(same))
            )
