"""Emit tests for conflicts between the matches of a rule and its blocks, as the live engine finds them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Literal

from envgraph import code
from envgraph.code import dataclass
from envgraph.env.compiled._blocks import Frame, Slots
from envgraph.env.compiled._layout import NOBODY, ZERO
from envgraph.env.compiled._member import absent
from envgraph.env.compiled._refused import NotCompiled
from envgraph.env.compiled._site import Site
from envgraph.env.compiled._terms import Term, as_float
from envgraph.metamodel import Attribute, Metamodel, Reference, Scalar
from envgraph.pattern import Constant, EnumLiteral, StaticType
from envgraph.rewrite.plans import BlockPlan, ChangeTargets, Increase, SetTargets, SetValue

Kind = Literal[
    "gone", "touched", "class", "owner", "value", "removed", "withdrawn", "added", "targets", "end"
]


@dataclass(frozen=True, slots=True)
class Claim:
    """An effect that a match requires, for comparison with those of other matches.

    Attributes:
        node: slot of the object that the effect is about.
        what: the feature, or the class; None for the container.
        other: slot of the other end of a link, or of the value; None for no value.
        present: slot of an object that may be missing, in which case the claim is void.
        forced: True if the action replaces other links.
        via: the reference of a link to a container.
    """

    kind: Kind
    node: int
    what: Attribute | Reference | str | None = None
    other: int | None = None
    present: int | None = None
    forced: bool = False
    via: Reference | None = None


def claims_of(frame: Frame, metamodel: Metamodel) -> Iterator[Claim]:
    """Yield all effects that a match of a rule or block requires."""
    plan = frame.plan
    for delete in plan.deletes:
        yield Claim("gone", delete.node)
    for retype in plan.retypes:
        yield Claim("touched", retype.node)
        yield Claim("class", retype.node, retype.cls)
    for move in plan.moves:
        yield from _linked(metamodel, move.reference, move.container, move.node, forced=True)
    for link in plan.links:
        yield from _linked(metamodel, link.reference, link.source, link.target, forced=False)
    for change in plan.sets:
        match change:
            case SetValue(node, attribute, value):
                yield Claim("touched", node)
                yield Claim("owner", node, attribute.owner)
                yield Claim("value", node, attribute, value)
            case Increase(node, attribute):
                yield Claim("touched", node)
                yield Claim("owner", node, attribute.owner)
                yield Claim("value", node, attribute, forced=True)
            case SetTargets(node, reference, values):
                yield Claim("touched", node)
                yield Claim("owner", node, reference.owner)
                if not reference.many:  # else no other change is compiled
                    yield Claim("targets", node, reference, values[0] if values else None)
                for value in values:
                    yield from _linked(metamodel, reference, node, value, forced=True)
            case ChangeTargets(node, reference, operator, values):
                yield Claim("touched", node)
                yield Claim("owner", node, reference.owner)
                for value in values:
                    if operator == "+=":
                        yield from _linked(metamodel, reference, node, value, forced=True)
                    else:
                        first, source, target = metamodel.canonical(reference, node, value)
                        yield Claim("withdrawn", source, first, target, present=value)
            case _:
                raise AssertionError(change)
    for unlink in plan.unlinks:
        reference, source, target = metamodel.canonical(unlink.reference, unlink.source, unlink.target)
        yield Claim("removed", source, reference, target)


def _linked(
    metamodel: Metamodel, reference: Reference, source: int, target: int, *, forced: bool
) -> Iterator[Claim]:
    """Yield the effects that adding a link requires."""
    opposite = metamodel.opposite(reference)
    yield Claim("touched", source, present=target)
    yield Claim("touched", target, present=target)
    yield Claim("owner", source, reference.owner, present=target)
    yield Claim("owner", target, reference.target, present=target)
    first, start, end = metamodel.canonical(reference, source, target)
    yield Claim("added", start, first, end, present=target)
    if opposite == reference:
        yield Claim("added", end, first, start, present=target)
    if reference.upper == 1:
        yield Claim("end", source, reference, target, target, forced)
    if opposite is not None and opposite.upper == 1:
        yield Claim("end", target, opposite, source, target, forced)
    if (held := metamodel.containment(reference, source, target)) is not None:
        contains, container, content = held
        yield Claim("end", content, None, container, target, forced, contains)


class Pairs:
    """An emitter of tests that the required effects of two matches contradict each other.

    Args:
        metamodel: of the model.
        rule: the frame of the rule, which has only one match.
    """

    def __init__(self, metamodel: Metamodel, rule: Frame) -> None:
        self._metamodel = metamodel
        self._rule = rule

    def tests(self, one: Frame, slots: Slots, other: Frame, others: Slots) -> Iterator[code.Expression]:
        """Yield the conditions under which a match of one frame contradicts a match of another, or the same, frame."""
        first = [*claims_of(one, self._metamodel)]
        second = [*claims_of(other, self._metamodel)]
        for number, mine in enumerate(first):
            for theirs in second[number:] if one is other else second:
                for a, b in ((mine, theirs), (theirs, mine)):
                    swapped = a is not mine or b is not theirs
                    sides = (other, others, one, slots) if swapped else (one, slots, other, others)
                    found = self._test(a, sides[0], sides[1], b, sides[2], sides[3])
                    if found is not None:
                        yield found
                    if mine is theirs and one is other:
                        break

    def _test(self, a: Claim, fa: Frame, sa: Slots, b: Claim, fb: Frame, sb: Slots) -> code.Expression | None:
        """Return code that tests if claim `a` contradicts claim `b`, or None if it never does.

        Claims of two kinds are tested in one order only, so try both orders. `fa`, `sa` are the frame and slots of `a`.
        """
        metamodel = self._metamodel
        parts: list[code.Expression | None] = []
        match a.kind, b.kind:
            case "gone", "touched":
                pass
            case "class", "class" if a.what != b.what:
                pass
            case "class", "owner" if not metamodel.is_a(str(a.what), str(b.what)):
                pass
            case "value", "value" if a.what == b.what and not (a.forced and b.forced):
                if not (a.forced or b.forced):
                    parts.append(self._differing(a, fa, sa, b, fb, sb))
            case "removed" | "withdrawn", "added" if a.what == b.what:
                parts.append(self._same(a.other, fa, sa, b.other, fb, sb))
                if a.kind == "removed":
                    parts += self._not_added(a, fa, sa)
            case "targets", "targets" if a.what == b.what:
                parts.append(code.Operation("!=", (_value(a, sa), _value(b, sb))))
            case "targets", "added":
                return self._target(a, fa, sa, b, fb, sb)
            case "end", "end" if a.what == b.what and (a.forced or b.forced):
                if a.via == b.via:
                    parts.append(code.Operation("!=", (_value(a, sa), _value(b, sb))))
            case _:
                return None
        return self._all([self._same(a.node, fa, sa, b.node, fb, sb), *parts], a, sa, b, sb)

    def _all(
        self, parts: list[code.Expression | None], a: Claim, sa: Slots, b: Claim, sb: Slots
    ) -> code.Expression | None:
        """Return code that tests if all parts hold and neither claim is void; None if a part is None (never true)."""
        known = [part for part in parts if part is not None]
        if len(known) < len(parts):
            return None
        for claim, slots in ((a, sa), (b, sb)):
            if claim.present is not None:
                known.append(code.Operation(">=", (slots[claim.present], ZERO)))
        return code.joined("and", [part for part in known if part != code.TRUE], True)

    def _same(
        self, slot: int | None, fa: Frame, sa: Slots, other: int | None, fb: Frame, sb: Slots
    ) -> code.Expression | None:
        """Return code that tests if two slots of two matches hold the same object, or None if they never do."""
        assert slot is not None
        assert other is not None
        if fa.new.get(slot) is not fb.new.get(other) or (slot in fa.new and slot != other):
            return None
        cls, another = fa.classes.get(slot), fb.classes.get(other)
        if cls is not None and another is not None and not self._metamodel.overlap(cls, another):
            return None
        rule = self._rule.plan
        if max(slot, other) < rule.variables:
            if slot == other:
                return code.TRUE
            if not rule.coinciding:
                return None
        return code.equal(sa[slot], sb[other])

    def _target(
        self, a: Claim, fa: Frame, sa: Slots, b: Claim, fb: Frame, sb: Slots
    ) -> code.Expression | None:
        """Return code that tests if an added link has another target than a claim sets, or None if it never has."""
        assert isinstance(a.what, Reference)
        assert b.other is not None
        near, far = b.node, b.other
        if a.what != b.what:
            if a.what != self._metamodel.opposite(b.what):  # type: ignore[arg-type]
                return None
            near, far = far, near
        differ = code.Operation("!=", (_value(a, sa), sb[far]))
        return self._all([self._same(a.node, fa, sa, near, fb, sb), differ], a, sa, b, sb)

    def _not_added(self, a: Claim, frame: Frame, slots: Slots) -> list[code.Expression | None]:
        """Return tests that the match does not also add the link that it removes, since such a link stays."""
        found: list[code.Expression | None] = []
        for link in frame.plan.links:
            reference, source, target = self._metamodel.canonical(link.reference, link.source, link.target)
            if reference != a.what:
                continue
            symmetric = self._metamodel.opposite(reference) == reference
            for start, end in [(source, target), (target, source)] if symmetric else [(source, target)]:
                ends = [
                    self._same(a.node, frame, slots, start, frame, slots),
                    self._same(a.other, frame, slots, end, frame, slots),
                ]
                if None not in ends:
                    both = code.joined("and", [end for end in ends if end is not None], True)
                    found.append(code.inverse(both))
        return found

    @staticmethod
    def _differing(a: Claim, fa: Frame, sa: Slots, b: Claim, fb: Frame, sb: Slots) -> code.Expression | None:
        """Return code that tests if the values of two claims differ (NaN equals NaN); None if both are one constant."""
        constants = [_constant(claim, frame) for claim, frame in ((a, fa), (b, fb))]
        if None not in constants and constants[0] == constants[1]:
            return None
        assert isinstance(a.what, Attribute)
        values = [
            absent(a.what.type)
            if claim.other is None
            else fitted(slots[claim.other], frame.types.get(claim.other, a.what.type), a.what)
            for claim, frame, slots in ((a, fa, sa), (b, fb, sb))
        ]
        differ = code.Operation("!=", (values[0], values[1]))
        if a.what.type is not Scalar.FLOAT:
            return differ
        there = [code.equal(value, value) for value in values]
        return code.Operation("and", (differ, code.joined("or", there, False)))


def _value(claim: Claim, slots: Mapping[int, code.Expression]) -> code.Expression:
    return NOBODY if claim.other is None else slots[claim.other]


def _constant(claim: Claim, frame: Frame) -> object:
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


def fitted(value: code.Expression, type_: StaticType | None, attribute: Attribute) -> code.Expression:
    """Return the expression of a value, converted to float if the attribute is a float and the value is not."""
    if attribute.type is Scalar.FLOAT and type_ is not Scalar.FLOAT:
        return as_float(Term(value, Scalar.INT))
    return value


def check_agreement(site: Site) -> None:
    """Emit code that refuses the rule if two of its matches contradict each other.

    Raises:
        NotCompiled: several blocks make changes whose order affects the result.
    """
    frames, pairs = site.blocks.frames, Pairs(site.facts.metamodel, site.rule)
    _check_order(site)
    for number, one in enumerate(frames):
        for other in frames[number:]:
            _check_pair(site, pairs, one, other)


def _check_pair(site: Site, pairs: Pairs, one: Frame, other: Frame) -> None:
    sides = []
    for frame in (one, other):
        row = site.facts.module.fresh("r")
        loads, slots = ([], frame.slots) if frame.outer is None else site.blocks.loaded(frame, row)
        sides.append((frame, row, loads, slots))
    tests = dict.fromkeys(pairs.tests(one, sides[0][3], other, sides[1][3]))
    body: code.Body = tuple(code.If(test, site.fail("REFUSED")) for test in tests)
    for frame, row, loads, _ in reversed(sides):
        if body and frame.outer is not None:
            body = (site.blocks.each(frame, row, loads, body),)
    site.add(*body)


def _check_order(site: Site) -> None:
    """Raise `NotCompiled` if several blocks make changes whose order affects the result."""
    changing: dict[Attribute | Reference, BlockPlan] = {}
    for frame in site.blocks.frames:
        for change in frame.plan.sets:
            feature: Attribute | Reference | None = None
            if isinstance(change, ChangeTargets):
                feature, _, _ = site.facts.metamodel.canonical(change.reference, 0, 0)
            elif isinstance(change, Increase) and change.attribute.type is Scalar.FLOAT:
                feature = change.attribute
            elif isinstance(change, SetTargets):
                opposite = site.facts.metamodel.opposite(change.reference)
                feature = (
                    change.reference if opposite is not None and opposite.upper not in (None, 1) else None
                )
            if feature is not None and changing.setdefault(feature, frame.plan) is not frame.plan:
                raise NotCompiled(f"changes of `{feature}` in several blocks of a rule", frame.plan.span)


def check_kept(site: Site) -> None:
    """Emit code that refuses the rule if an object that it keeps or changes was deleted with its container.

    Raises:
        NotCompiled: blocks delete containers together with objects that these may contain.
    """
    metamodel, frames = site.facts.metamodel, site.blocks.frames
    deletes = [(delete, frame.plan) for frame in frames for delete in frame.plan.deletes]
    doomed = [one for delete, plan in deletes for one in metamodel.concrete(plan.classes[delete.node] or "")]
    endangered = metamodel.all_contents(doomed)
    for frame in frames:
        slots = dict.fromkeys(frame.plan.kept)
        slots.update(dict.fromkeys(c.node for c in claims_of(frame, metamodel) if c.kind == "touched"))
        if len(frames) > 1 and not site.plan.lossy:  # if links go too, order is irrelevant
            slots.update(dict.fromkeys(delete.node for delete in frame.plan.deletes))
        for slot in slots:
            cls = frame.classes.get(slot)
            if slot in frame.new or not any(cls is None or metamodel.overlap(one, cls) for one in endangered):
                continue
            if len(frames) > 1 or cls is None:
                first, plan = deletes[0]
                raise NotCompiled(
                    "a rule with blocks that deletes a container and its contents", first.span or plan.span
                )
            _check_alive(site, slot, cls)


def _check_alive(site: Site, slot: int, cls: str) -> None:
    """Emit code that refuses the rule if the object in a slot is deleted, unless a `delete` action names the object."""
    alive = site.facts.alive(site.slots[slot], cls)
    if alive is not None:
        same = [code.equal(site.slots[slot], site.slots[delete.node]) for delete in site.rule.plan.deletes]
        site.unless(code.joined("or", [alive, *same], False))
