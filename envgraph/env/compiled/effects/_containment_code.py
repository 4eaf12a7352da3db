"""Emit code for containment: tests if an object contains another, and deletion of an object with its contents."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from envgraph import code
from envgraph.env.compiled.layout._member_data import emit_missing_value
from envgraph.env.compiled.layout._program_layout import (
    NOBODY,
    ONE,
    RI,
    TOP,
    ZERO,
    emit_entry,
    emit_error,
    emit_state_entry,
    emit_sum,
)
from envgraph.env.compiled.layout._symbols import WORD_BITS, ClassSet
from envgraph.env.compiled.matching._body_code import CAPACITY
from envgraph.env.compiled.matching._model_reading import ModelReader
from envgraph.metamodel import Attribute, Metamodel, Reference
from envgraph.rewrite.plans import contained_end

REFUSED = emit_error("REFUSED"), code.Return(NOBODY)


def emit_is_inside(facts: ModelReader) -> str:
    """Emit a function that tests if its first object is its second, or contains it at any depth. Return its name."""
    node, above, found = (facts.module.new_local("v", "object") for _ in range(3))

    def write() -> tuple[Sequence[code.Local], code.Body]:
        up: list[code.Statement] = [code.Assign(found, NOBODY)]
        for reference in facts.metamodel.references:
            if reference.containment:
                end = facts.links.only_other_end(reference, above, forward=False, class_known=False)
                assert end is not None, "an object has one container"
                up.append(code.If(code.Operation("<", (found, ZERO)), (code.Assign(found, end),)))
        body = (
            code.If(code.emit_equal(above, node), (code.Return(code.TRUE),)),
            *up,
            code.Assign(above, found),
        )
        there = code.Operation(">=", (above, ZERO))
        return [node, above], (code.While(there, body), code.Return(code.FALSE))

    return facts.module.function_for("inside", "inside", write)


def emit_delete(facts: ModelReader, classes: tuple[str, ...], lossy: bool) -> str:
    """Emit a function that deletes an object of some concrete classes with its contents. Return the function's name.

    The function returns -1 if the deletion is refused, else 0. It stores the objects in column 0 of the rows from `top`
    on, and marks them by object number in column 1.

    Args:
        facts: reads the model.
        classes: of the object.
        lossy: True to delete links to remaining objects as well. Otherwise such dangling edges refuse the deletion,
            except the link to the object's own container.
    """
    return facts.module.function_for(
        ("delete", classes, lossy), "delete", lambda: _emit_delete_body(facts, classes, lossy)
    )


def _emit_delete_body(
    facts: ModelReader, classes: tuple[str, ...], lossy: bool
) -> tuple[Sequence[code.Local], code.Body]:
    root, node = facts.module.new_local("v", "object"), facts.module.new_local("v", "object")
    count, number, stride = (facts.module.new_local(prefix) for prefix in "nks")
    facts.module.width = max(facts.module.width, 2)
    every = tuple(dict.fromkeys((*classes, *facts.metamodel.all_content_classes(classes))))
    read = code.Assign(node, emit_entry(RI, emit_sum(TOP, number), ZERO))
    each = code.emit_call("range", count)
    body: list[code.Statement] = [
        code.Assign(stride, facts.layout.stride()),
        code.If(code.Operation(">", (stride, CAPACITY)), (emit_error("OVERFLOW"), code.Return(NOBODY))),
        code.For(number, code.emit_call("range", stride), (code.Assign(_mark_cell(number), ZERO),)),
        code.Assign(count, ZERO),
        *_emit_append(root, count),
        code.Assign(number, ZERO),
        code.While(
            code.Operation("<", (number, count)),
            (read, code.Assign(number, ONE, "+="), *_emit_contents(facts, every, node, count)),
        ),
    ]
    if not lossy:
        body.append(code.For(number, each, (read, *_emit_dangling_check(facts, every, node, number))))
    body.append(code.For(number, each, (read, *_emit_erase(facts, every, node))))
    return [root], (*body, code.Return(ZERO))


def _mark_cell(node: code.Expression) -> code.Subscript:
    return emit_entry(RI, emit_sum(TOP, node), ONE)


def _emit_append(node: code.Expression, count: code.Local) -> tuple[code.Statement, ...]:
    stored = code.Assign(emit_entry(RI, emit_sum(TOP, count), ZERO), node)
    return stored, code.Assign(_mark_cell(node), ONE), code.Assign(count, ONE, "+=")


def _emit_contents(
    facts: ModelReader, classes: Sequence[str], node: code.Local, count: code.Local
) -> Iterator[code.Statement]:
    for reference, forward in ends_of(facts.metamodel, classes):
        if contained_end(reference, False, True, facts.metamodel) is forward:
            block = code.BodyBuilder()
            content = facts.links.emit_follow(block, reference, node, forward=forward, class_known=False)
            block.add(*_emit_append(content, count))
            yield from block.finish_body()


def _emit_dangling_check(
    facts: ModelReader, classes: Sequence[str], node: code.Local, number: code.Local
) -> Iterator[code.Statement]:
    """Yield statements that refuse the rule if an object has a dangling edge: a link to an object that is not deleted.

    If `number` is 0, the object is the root of the deletion. Then a link to itself dangles, and its container does not.
    """
    for reference, forward in ends_of(facts.metamodel, classes):
        block = code.BodyBuilder()
        other = facts.links.emit_follow(block, reference, node, forward=forward, class_known=False)
        first = code.emit_equal(number, ZERO)
        loop = code.Operation("and", (first, code.emit_equal(other, node)))
        stays: code.Expression = code.Operation("or", (code.emit_equal(_mark_cell(other), ZERO), loop))
        if contained_end(reference, True, False, facts.metamodel) is forward:
            stays = code.Operation("and", (stays, code.emit_not(first)))
        block.add(code.If(stays, REFUSED))
        yield from block.finish_body()


def _emit_erase(facts: ModelReader, classes: Sequence[str], node: code.Local) -> Iterator[code.Statement]:
    """Yield statements that remove all links and values of an object, and remove it from all class sets."""
    links = facts.links
    for reference, forward in ends_of(facts.metamodel, classes):
        block = code.BodyBuilder()
        _, link = links.loop_over_links(block, reference, node, forward=forward, class_known=False)
        block.add(code.Assign(link.place, link.unlinked_value))
        yield from block.finish_body()
    yield from emit_clear_values(facts, classes, node)


def emit_clear_values(facts: ModelReader, classes: Sequence[str], node: code.Expression) -> Iterator[code.Statement]:
    """Yield statements that remove all values of an object, and remove it from all class sets."""
    for attribute in stored_attributes(facts, classes).values():
        yield from emit_clear_attribute(facts, attribute, node, class_known=False)
    for group in dict.fromkeys(facts.changes.group_of(cls) for cls in classes):
        assert group is not None
        yield from emit_leave_sets(facts, group, node, class_known=False)


def emit_leave_sets(
    facts: ModelReader, group: tuple[str, ...], node: code.Expression, *, class_known: bool
) -> Iterator[code.Statement]:
    """Yield statements that remove an object from the bit sets of all classes in a group of classes."""
    found, guard = facts.emit_object_index(group, node, class_known=class_known)
    place = facts.module.new_local("p")
    rest = code.Operation("^", (code.Constant(2**WORD_BITS - 1), code.emit_call("bit_at", place)))
    body = [
        code.Assign(word, code.Operation("&", (word, rest)))
        for word in (class_set_word(facts, group, cls, place) for cls in group)
    ]
    whole = (code.Assign(place, found), *body)
    yield from (code.If(code.emit_joined("and", guard, True), whole),) if guard else whole


def class_set_word(facts: ModelReader, group: tuple[str, ...], cls: str, place: code.Expression) -> code.Subscript:
    """Return the word of a class set that has an object's bit, by the object's index in its group of classes."""
    offset = facts.layout.offset(ClassSet(group, cls))
    return emit_state_entry(emit_sum(offset, code.Operation(">>", (place, code.Constant(5)))))


def stored_attributes(facts: ModelReader, classes: Iterable[str]) -> dict[int, Attribute]:
    """Return the attributes of objects of some classes by their index, without multi-valued ones that no rule sets."""
    features = (feature for cls in classes for feature in facts.metamodel.features(cls).values())
    found = (one for one in features if isinstance(one, Attribute))
    return {one.index: one for one in found if not one.many or one.index in facts.changes.domains}


def emit_clear_attribute(
    facts: ModelReader, attribute: Attribute, node: code.Expression, *, class_known: bool
) -> code.Body:
    """Return statements that remove all values of an object's attribute."""
    if attribute.many:
        block = code.BodyBuilder()
        _, held = facts.links.loop_over_links(block, attribute, node, forward=True, class_known=class_known)
        block.add(code.Assign(held.place, held.unlinked_value))
        return block.finish_body()
    place, guard = facts.attribute_cell(attribute, node, class_known=class_known)
    cleared = code.Assign(place, emit_missing_value(attribute.type))
    return (code.If(code.emit_joined("and", guard, True), (cleared,)) if guard else cleared,)


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
