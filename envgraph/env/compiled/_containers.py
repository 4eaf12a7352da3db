"""Emit code for containment: tests if an object contains another, and deletion of an object with its contents."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from envgraph import code
from envgraph.env.compiled._bodies import CAPACITY
from envgraph.env.compiled._facts import Facts
from envgraph.env.compiled._layout import NOBODY, ONE, RI, TOP, ZERO, cell, entry, failed, plus
from envgraph.env.compiled._member import absent
from envgraph.env.compiled._tables import WORD, ClassSet, LinkColumn
from envgraph.metamodel import Attribute, Metamodel, Reference

REFUSED = failed("REFUSED"), code.Return(NOBODY)


def inside(facts: Facts) -> str:
    """Emit a function that tests if its first object is its second, or contains it at any depth. Return its name."""
    node, above, found = (facts.module.fresh("v", "object") for _ in range(3))

    def write() -> tuple[Sequence[code.Local], code.Body]:
        up: list[code.Statement] = [code.Assign(found, NOBODY)]
        for reference in facts.metamodel.references:
            if reference.containment:
                end = facts.links.other_end(reference, above, forward=False, sure=False)
                assert end is not None, "an object has one container"
                up.append(code.If(code.Operation("<", (found, ZERO)), (code.Assign(found, end),)))
        body = code.If(code.equal(above, node), (code.Return(code.TRUE),)), *up, code.Assign(above, found)
        there = code.Operation(">=", (above, ZERO))
        return [node, above], (code.While(there, body), code.Return(code.FALSE))

    return facts.module.once("inside", "inside", write)


def deleting(facts: Facts, classes: tuple[str, ...], lossy: bool) -> str:
    """Emit a function that deletes an object of some concrete classes with its contents. Return the function's name.

    The function returns -1 if the deletion is refused, else 0. It stores the objects in column 0 of the rows from `top`
    on, and marks them by object number in column 1.

    Args:
        facts: reads the model.
        classes: of the object.
        lossy: True to delete links to remaining objects as well. Otherwise such dangling edges refuse the deletion,
            except the link to the object's own container.
    """
    return facts.module.once(("delete", classes, lossy), "delete", lambda: _deleting(facts, classes, lossy))


def _deleting(facts: Facts, classes: tuple[str, ...], lossy: bool) -> tuple[Sequence[code.Local], code.Body]:
    root, node = facts.module.fresh("v", "object"), facts.module.fresh("v", "object")
    count, number, stride = (facts.module.fresh(prefix) for prefix in "nks")
    facts.module.width = max(facts.module.width, 2)
    every = tuple(dict.fromkeys((*classes, *facts.metamodel.all_contents(classes))))
    read = code.Assign(node, entry(RI, plus(TOP, number), ZERO))
    each = code.call("range", count)
    body: list[code.Statement] = [
        code.Assign(stride, facts.layout.stride()),
        code.If(code.Operation(">", (stride, CAPACITY)), (failed("OVERFLOW"), code.Return(NOBODY))),
        code.For(number, code.call("range", stride), (code.Assign(_mark(number), ZERO),)),
        code.Assign(count, ZERO),
        *_put(root, count),
        code.Assign(number, ZERO),
        code.While(
            code.Operation("<", (number, count)),
            (read, code.Assign(number, ONE, "+="), *_contents(facts, every, node, count)),
        ),
    ]
    if not lossy:
        body.append(code.For(number, each, (read, *_dangling(facts, every, node, number))))
    body.append(code.For(number, each, (read, *_erased(facts, every, node))))
    return [root], (*body, code.Return(ZERO))


def _mark(node: code.Expression) -> code.Index:
    return entry(RI, plus(TOP, node), ONE)


def _put(node: code.Expression, count: code.Local) -> tuple[code.Statement, ...]:
    stored = code.Assign(entry(RI, plus(TOP, count), ZERO), node)
    return stored, code.Assign(_mark(node), ONE), code.Assign(count, ONE, "+=")


def _contents(
    facts: Facts, classes: Sequence[str], node: code.Local, count: code.Local
) -> Iterator[code.Statement]:
    for reference, forward in ends_of(facts.metamodel, classes):
        if holds_content(facts.metamodel, reference, forward):
            block = code.Block()
            content = facts.links.follow(block, reference, node, forward=forward, sure=False)
            block.add(*_put(content, count))
            yield from block.body()


def _dangling(
    facts: Facts, classes: Sequence[str], node: code.Local, number: code.Local
) -> Iterator[code.Statement]:
    """Yield statements that refuse the rule if an object has a dangling edge: a link to an object that is not deleted.

    If `number` is 0, the object is the root of the deletion. Then a link to itself dangles, and its container does not.
    """
    for reference, forward in ends_of(facts.metamodel, classes):
        block = code.Block()
        other = facts.links.follow(block, reference, node, forward=forward, sure=False)
        first = code.equal(number, ZERO)
        loop = code.Operation("and", (first, code.equal(other, node)))
        stays: code.Expression = code.Operation("or", (code.equal(_mark(other), ZERO), loop))
        if holds_content(facts.metamodel, reference, not forward):
            stays = code.Operation("and", (stays, code.inverse(first)))
        block.add(code.If(stays, REFUSED))
        yield from block.body()


def _erased(facts: Facts, classes: Sequence[str], node: code.Local) -> Iterator[code.Statement]:
    """Yield statements that remove all links and values of an object, and remove it from all class sets."""
    links = facts.links
    for reference, forward in ends_of(facts.metamodel, classes):
        kept, _ = links.kept(reference)
        if isinstance(kept, LinkColumn) and kept.at_source is forward:
            place, guard = links.near(kept, node, sure=False)
            yield code.If(code.joined("and", guard, True), (code.Assign(place, NOBODY),))
            continue
        block = code.Block()
        _, link = links.each(block, reference, node, forward=forward, sure=False)
        block.add(code.Assign(link.place, link.unlinked))
        yield from block.body()
    for attribute in single_attributes(facts.metamodel, classes).values():
        place, guard = facts.attribute_cell(attribute, node, sure=False)
        yield code.If(code.joined("and", guard, True), (code.Assign(place, absent(attribute.type)),))
    for group in dict.fromkeys(facts.changes.group_of(cls) for cls in classes):
        assert group is not None
        yield from left(facts, group, node, sure=False)


def left(
    facts: Facts, group: tuple[str, ...], node: code.Expression, *, sure: bool
) -> Iterator[code.Statement]:
    """Yield statements that remove an object from the bit sets of all classes in a group of classes."""
    found, guard = facts.place(group, node, sure=sure)
    place = facts.module.fresh("p")
    rest = code.Operation("^", (code.Constant(2**WORD - 1), code.call("bit_at", place)))
    body = [
        code.Assign(word, code.Operation("&", (word, rest)))
        for word in (word_of(facts, group, cls, place) for cls in group)
    ]
    whole = (code.Assign(place, found), *body)
    yield from (code.If(code.joined("and", guard, True), whole),) if guard else whole


def word_of(facts: Facts, group: tuple[str, ...], cls: str, place: code.Expression) -> code.Index:
    """Return the word of a class set that has an object's bit, by the object's index in its group of classes."""
    offset = facts.layout.offset(ClassSet(group, cls))
    return cell(plus(offset, code.Operation(">>", (place, code.Constant(5)))))


def single_attributes(metamodel: Metamodel, classes: Iterable[str]) -> dict[int, Attribute]:
    """Return the single-valued attributes that objects of some classes have, by their index in the metamodel."""
    features = (feature for cls in classes for feature in metamodel.features(cls).values())
    return {one.index: one for one in features if isinstance(one, Attribute) and not one.many}


def holds_content(metamodel: Metamodel, reference: Reference, forward: bool) -> bool:
    """Return True if a reference's sources (if not `forward`, its targets) contain the objects at the other end."""
    held = metamodel.containment(reference, True, False)
    return held is not None and held[1] is forward


def ends_of(metamodel: Metamodel, classes: Sequence[str]) -> Iterator[tuple[Reference, bool]]:
    """Yield references that objects of some classes may have: with True as sources, with False as targets.

    Of two opposite references, only the first is yielded.
    """
    for reference in metamodel.references:
        opposite = metamodel.opposite(reference)
        if opposite is not None and opposite.index < reference.index:
            continue
        for end, forward in ((reference.owner, True), (reference.target, False)):
            if any(metamodel.is_a(cls, end) for cls in classes):
                yield reference, forward
