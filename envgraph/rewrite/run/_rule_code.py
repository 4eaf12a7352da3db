"""Generation of code for the operations of a plan.

Classes, features and literals are values in the namespace of the generated function. Slot number 3 is the local
variable `e3`, or `e[3]` if blocks share a list of slots. Each statement has the operation that it executes as its
origin.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from functools import partial
from sys import maxsize
from typing import Any, Final

from envgraph import code
from envgraph.graph import Model
from envgraph.metamodel import Attribute, Reference
from envgraph.pattern import (
    EXPRESSION_NAMESPACE,
    Binary,
    Conditional,
    Expression as Term,
    FunctionCall,
    Navigation,
    ObjectType,
    StaticType,
    Unary,
    Variable,
    check_expression,
    children,
    compile_expression,
    is_method,
    with_children,
)
from envgraph.rewrite._rule_plan import (
    AddLink,
    AdjustAttribute,
    AssignOperation as Assign_,
    BlockPlan,
    ChangeTargets,
    ComputeValue,
    DeleteObject,
    MergeObjects,
    MoveToContainer,
    RemoveLink,
    SetAttribute,
    SetAttributeValues,
    SetTargets,
)
from envgraph.rewrite.check._containment import contained_end, container_entries, leaving_changes
from envgraph.rewrite.run._rule_runtime import ON_MODEL, ON_VALUES, merge_objects

_GRAPH_METHODS: Final = (
    *("alive", "delete", "link", "new", "retype", "set_target", "set_targets", "set_value"),
    *("target", "unlink", "value", "values"),
)
"""Methods of the graph that generated code calls."""

SlotVariable = Callable[[int], code.Local | code.Subscript]
"""A function that returns the variable for a slot."""


class RuleCodeEmitter:
    """A generator of the code of rule functions, which collects the constants that the code refers to.

    Args:
        model: the model that the function changes.
        slot: returns the variable for a slot.
        lossy: True for SPO semantics, False for DPO.
        sure: True if objects are certainly of the classes in the plan, so that links can be changed
            without checks.
        again: called for a created link that already exists; None for no call.
        redo: True if the code completes an interrupted application, so that some changes may be made already. Ids of
            new objects are counted from `first`, and sums are computed only if they are None.
        doomed: the objects that the whole application deletes, filled at run time; None if only this block
            deletes.
        endangered: classes of objects that may be deleted together with another deleted object.

    Attributes:
        namespace: values for the names in the code.
        sums: local variables for values that are computed between changes.
    """

    def __init__(
        self,
        model: Model,
        slot: SlotVariable,
        *,
        lossy: bool,
        sure: bool = False,
        again: Callable[[AddLink, int, int], None] | None = None,
        redo: bool = False,
        doomed: Collection[int] | None = None,
        endangered: Collection[str | None] = (),
    ) -> None:
        self.model = model
        self.deleted_objects = doomed
        self.endangered_classes = endangered
        self.slot = slot
        self.has_certain_classes = sure
        self.report_existing = again
        self.is_redo = redo
        self.sums: list[code.Local] = []
        self.semantics = "spo" if lossy else "dpo"
        self.is_spo = lossy
        self.namespace: dict[str, Any] = {
            **EXPRESSION_NAMESPACE,
            **{name: getattr(model.graph, name) for name in _GRAPH_METHODS},
            **{f"_{one.__name__}": partial(one, model.graph) for one in ON_MODEL},
            **{f"_{one.__name__}": one for one in ON_VALUES},
            "_absorb": partial(merge_objects, model.graph, lossy=lossy),
            "_extend": model.graph.add_target,
            "_semantics": self.semantics,
            "_again": again,
        }
        if redo:
            self.namespace["made"] = lambda node, cls: (
                node if model.graph.alive(node) else model.graph.new_at(node, cls)
            )

    def add_constant(self, value: object) -> code.Name:
        """Add a constant to the namespace and return its name."""
        name = f"k{len(self.namespace)}"
        self.namespace[name] = value
        return code.Name(name)

    def slot_tuple(self, numbers: Iterable[int]) -> code.Tuple:
        """Return code for a tuple of the variables of slots."""
        return code.Tuple(tuple(self.slot(number) for number in numbers))

    # --- the phases of a block, in order

    def compute(self, plan: BlockPlan) -> list[code.Statement]:
        """Emit code that checks required links and computes all values on the state before the rule."""
        asked = [
            code.emit_call_statement("_there", *self._link_arguments(u), origin=u)
            for u in plan.unlinks
            if u.is_required
        ]
        return [
            *asked,
            *(code.Assign(self.slot(c.slot), self._emit_value(c), origin=c) for c in plan.computed),
        ]

    def unlink(self, plan: BlockPlan) -> list[code.Statement]:
        """Emit code that removes links, and takes objects out of old containers before any object is moved."""
        fresh = {new.node for new in plan.creates}
        leaving = [self._emit_leave(move, move.container in fresh) for move in plan.moves if move.node not in fresh]
        for change in leaving_changes(plan, self.model.metamodel, alone=self.has_certain_classes):
            leaving += self._emit_release(change, fresh)
        return [*map(self._emit_unlink, plan.unlinks), *leaving]

    def _emit_release(self, op: SetTargets | ChangeTargets, fresh: set[int]) -> list[code.Statement]:
        """Emit code that removes objects from containers which they leave because targets are set."""
        known = tuple(value for value in op.values if value not in fresh)
        if op.object in fresh and (not op.reference.containment or _removes(op)):
            return []
        if _removes(op):
            return [self._emit_set(replace(op, values=known), op)]
        node = code.NONE if op.object in fresh else self.slot(op.object)
        every = code.Constant(isinstance(op, SetTargets))
        return [
            code.emit_call_statement(
                "_release", node, self.add_constant(op.reference), self.slot_tuple(known), every, origin=op
            )
        ]

    def delete(self, plan: BlockPlan) -> list[code.Statement]:
        """Emit code that deletes the objects that still exist."""
        return [self._emit_delete(d, plan) for d in plan.deletes]

    def strip(self, plan: BlockPlan) -> list[code.Statement]:
        """Emit code that removes and stores the links of objects to be merged."""
        return [
            code.Assign(self.slot(a.links_slot), code.emit_call("_strip", self.slot(a.absorbed)), origin=a)
            for a in plan.absorbs
        ]

    def emit_preserved_check(self, slots: tuple[int, ...], plan: BlockPlan) -> code.Statement:
        """Emit code that checks that the rule's preserved objects were not deleted with their containers."""
        names = tuple(plan.names[slot] for slot in slots)
        return code.emit_call_statement("_check_kept", self.slot_tuple(slots), self.add_constant(names))

    def retype(self, plan: BlockPlan) -> list[code.Statement]:
        """Emit code that retypes objects."""
        lossy = code.Constant(self.is_spo)
        return [
            code.emit_call_statement("retype", self.slot(r.node), self.add_constant(r.cls), lossy, origin=r)
            for r in plan.retypes
        ]

    def create(self, plan: BlockPlan) -> list[code.Statement]:
        """Emit code that creates objects."""
        return [
            code.Assign(self.slot(new.node), self._emit_new(number, self.add_constant(new.cls)), origin=new)
            for number, new in enumerate(plan.creates)
        ]

    def _emit_new(self, number: int, cls: code.Name) -> code.Expression:
        if not self.is_redo:
            return code.emit_call("new", cls)
        return code.emit_call("made", code.Operation("+", (FIRST_NEW_ID, code.Constant(number))), cls)

    def link(self, plan: BlockPlan) -> list[code.Statement]:
        """Emit code for merges, moves and new links."""
        moves = [
            code.emit_call_statement(
                "link", self.slot(m.container), self.add_constant(m.reference), self.slot(m.node), origin=m
            )
            for m in plan.moves
        ]
        fresh = {new.node for new in plan.creates}
        entries = container_entries((*plan.moves, *plan.links), self.model.metamodel)
        housed = Counter(content for content, _ in entries)
        links = []
        for op in plan.links:
            content = contained_end(op.reference, op.source, op.target, self.model.metamodel)
            homeless = content in fresh and housed[content] == 1
            new = op.source in fresh or op.target in fresh
            links.append(self._emit_link(op, fresh=new, homeless=homeless))
        return [*map(self._emit_merge, plan.absorbs), *moves, *links]

    def assign(self, plan: BlockPlan) -> list[code.Statement]:
        """Emit code that sets attributes and references."""
        return [statement for change in plan.sets for statement in self._emit_assignment(change)]

    # --- parts

    def _link_arguments(self, op: RemoveLink | AddLink) -> tuple[code.Expression, code.Name, code.Expression]:
        return self.slot(op.source), self.add_constant(op.reference), self.slot(op.target)

    def _emit_unlink(self, op: RemoveLink) -> code.Statement:
        """Emit code that removes a link if it exists."""
        if not self.has_certain_classes:
            return code.emit_call_statement("unlink", *self._link_arguments(op), origin=op)
        relation = self.model.graph.store.relations[op.reference.index]
        source, target = self.slot(op.source), self.slot(op.target)
        forward, disconnect = self.add_constant(relation.forward), self.add_constant(relation.disconnect)
        there_ = code.Operation("in", (target, code.Subscript(forward, source)))
        return code.If(there_, (code.emit_call_statement(disconnect, source, target),), origin=op)

    def _emit_add_link(self, op: AddLink, homeless: bool) -> code.Expression:
        """Emit an expression that adds a missing link; `homeless` if the contained end certainly has no container."""
        relation = self.model.graph.store.relations[op.reference.index]
        source, reference, target = self._link_arguments(op)
        if relation.containment or relation.is_contained:
            return code.emit_call("link" if homeless else "_house", source, reference, target)
        if not self.has_certain_classes:
            return code.emit_call("link", source, reference, target)
        forward, backward = self.add_constant(relation.forward), self.add_constant(relation.backward)
        room = []
        if relation.upper < maxsize:
            room.append(_emit_fewer(code.Subscript(forward, source), relation.upper))
        if relation.opposite_upper < maxsize:
            room.append(_emit_fewer(code.Subscript(backward, target), relation.opposite_upper))
        made = code.emit_call(self.add_constant(relation.connect), source, target)
        # If an end is full, `link` raises the error.
        return (
            code.ConditionalExpression(
                code.emit_joined("and", room, True), made, code.emit_call("link", source, reference, target)
            )
            if room
            else made
        )

    def _emit_leave(self, op: MoveToContainer, fresh: bool) -> code.Statement:
        """Emit code that removes an object from its container; `fresh` if the new container is not created yet."""
        container = code.NONE if fresh else self.slot(op.container)
        return code.emit_call_statement(
            "_leave", self.slot(op.node), container, self.add_constant(op.reference), origin=op
        )

    def _emit_delete(self, op: DeleteObject, plan: BlockPlan) -> code.Statement:
        # The object may have been deleted with its container, or its container may be deleted later.
        node = self.slot(op.node)
        test: code.Expression = code.emit_call("alive", node)
        if plan.classes[op.node] in self.endangered_classes and (
            self.deleted_objects is not None or len(plan.deletes) > 1
        ):
            others = self.slot_tuple(other.node for other in plan.deletes if other is not op)
            doomed = others if self.deleted_objects is None else self.add_constant(self.deleted_objects)
            test = code.Operation("and", (test, code.emit_not(code.emit_call("_inside", node, doomed))))
        return code.If(
            test,
            (code.emit_call_statement("delete", node, code.Name("_semantics")),),
            origin=op,
        )

    def _emit_merge(self, op: MergeObjects) -> code.Statement:
        return code.emit_call_statement("_absorb", *map(self.slot, (op.kept, op.absorbed, op.links_slot)), origin=op)

    def _emit_link(self, op: AddLink, *, fresh: bool, homeless: bool) -> code.Statement:
        """Emit code that adds a link unless it exists; `fresh` is True if the rule creates an end. See
        `_emit_add_link`.
        """
        source, target = self.slot(op.source), self.slot(op.target)
        forward = self.add_constant(self.model.graph.store.relations[op.reference.index].forward)
        made = code.ExpressionStatement(self._emit_add_link(op, homeless))
        again: code.Body = ()
        if self.report_existing is not None and not fresh:
            again = (code.emit_call_statement("_again", self.add_constant(op), source, target),)
        missing = code.Operation("not in", (target, code.Subscript(forward, source)))
        return code.If(code.emit_is_not_none(target), (code.If(missing, (made,), again),), origin=op)

    def _emit_assignment(self, op: Assign_) -> list[code.Statement]:
        if not isinstance(op, AdjustAttribute):
            return [self._emit_set(op, op)]
        # Two statements, because repeating the second one after an interruption changes nothing.
        node, attribute, value = self.slot(op.object), self.add_constant(op.attribute), self.slot(op.value)
        new: code.Expression
        if op.attribute.many:
            old = code.emit_call("values", node, attribute)
            new = (
                code.emit_call("_more", old, value, attribute)
                if op.operator == "+="
                else code.emit_call("_less", old, value)
            )
        else:
            function = "_add" if op.operator == "+=" else "_subtract"
            one = code.emit_call(
                "_need", code.emit_call("value", node, attribute), self.add_constant(str(op.attribute))
            )
            new = code.emit_call("_bounded", code.emit_call(function, one, value))
        total = code.Local(f"t{len(self.sums)}")
        self.sums.append(total)
        summed: code.Statement = code.Assign(total, new, origin=op)
        if self.is_redo:
            summed = code.If(code.Operation("is", (total, code.NONE)), (summed,), origin=op)
        return [summed, code.emit_call_statement("set_value", node, attribute, total, origin=op)]

    def _emit_set(
        self, op: SetAttribute | SetAttributeValues | SetTargets | ChangeTargets, origin: Assign_
    ) -> code.Statement:
        node = self.slot(op.object)
        value: code.Expression
        match op:
            case SetAttribute(_, feature):
                change, name = "set_value", self.add_constant(feature)
                value = code.NONE if op.value is None else self.slot(op.value)
            case SetAttributeValues(_, feature):
                change, name = "set_value", self.add_constant(feature)
                value = code.emit_call("_listed", self.slot_tuple(op.values), name)
            case SetTargets(_, feature) if feature.many:
                change, name = "set_targets", self.add_constant(feature)
                value = code.emit_call("_present", self.slot_tuple(op.values))
            case SetTargets(_, feature):
                change, name = "set_target", self.add_constant(feature)
                value = self.slot(op.values[0]) if op.values else code.NONE
            case ChangeTargets(_, feature):
                change = "_extend" if op.operator == "+=" else "unlink"
                changed = code.emit_call_statement(change, node, self.add_constant(feature), _TARGET)
                each = code.If(code.emit_is_not_none(_TARGET), (changed,))
                return code.For(_TARGET, self.slot_tuple(op.values), (each,), origin)
        return code.emit_call_statement(change, node, name, value, origin=origin)

    # --- values

    def _emit_value(self, compute: ComputeValue) -> code.Expression:
        types = {name: type_ for name, _, type_ in compute.variables}
        names: dict[str, code.Expression] = {name: self.slot(slot) for name, slot, _ in compute.variables}
        reader = PathReader(self, types, names)
        expression = reader.without_paths(compute.expression, compute.is_required)
        return self.emit_expression(expression, reader.names, reader.types)

    def emit_expression(
        self, expression: Term, names: Mapping[str, code.Expression], types: Mapping[str, StaticType | None]
    ) -> code.Expression:
        """Emit the code of an expression without paths."""
        base = len(self.namespace)
        known = {name: type_ for name, type_ in types.items() if type_ is not None}
        compiled = compile_expression(expression, names, known, constant=lambda n: code.Name(f"c{base}_{n}"))
        for number, literal in enumerate(compiled.constants):
            self.namespace[f"c{base}_{number}"] = literal
        return compiled.tree


_TARGET: Final = code.Local("t")
FIRST_NEW_ID: Final = code.Local("first")
"""The variable with the id of the first new object."""


def _emit_fewer(collection: code.Expression, most: int) -> code.Operation:
    return code.Operation("<", (code.emit_call("len", collection), code.Constant(most)))


class PathReader:
    """A rewriter that replaces the paths of an expression by variables whose code reads the model.

    A path without a value is None in places where `evaluate` gives None, and an error if an operator needs a value.
    """

    def __init__(
        self,
        writer: RuleCodeEmitter,
        types: Mapping[str, StaticType | None],
        names: Mapping[str, code.Expression],
    ) -> None:
        self.writer = writer
        self.metamodel = writer.model.metamodel
        self.types = dict(types)
        self.names = dict(names)

    def without_paths(self, node: Term, needed: bool = False) -> Term:
        """Return the expression with new variables in place of paths. If `needed`, a path without value is an error."""
        match node:
            case Navigation() if is_method(node, self._expression_type(node.object)):
                return FunctionCall(node.feature, (self.without_paths(node.object, True),), node.span)
            case Navigation():
                return self._emit_path(node, needed)
            case Unary() | Binary() | FunctionCall():
                strict = not (isinstance(node, Binary) and node.operator in ("==", "!="))
                return with_children(node, [self.without_paths(part, strict) for part in children(node)])
            case Conditional():
                return replace(
                    node,
                    test=self.without_paths(node.test, True),
                    then=self.without_paths(node.then, needed),
                    otherwise=self.without_paths(node.otherwise, needed),
                )
            case _:
                return node

    def _emit_path(self, node: Navigation, needed: bool) -> Variable:
        value, feature = self._emit_read(node)
        name = f"#{len(self.names)}"
        self.names[name] = code.emit_call("_need", value, self.writer.add_constant(node.feature)) if needed else value
        self.types[name] = ObjectType(feature.target) if isinstance(feature, Reference) else feature.type
        return Variable(name)

    def _emit_read(self, node: Navigation) -> tuple[code.Expression, Attribute | Reference]:
        owner = self._expression_type(node.object)
        assert isinstance(owner, ObjectType), "the expression has been checked"
        feature = self.metamodel.feature(owner.cls, node.feature)
        assert feature is not None
        inner = node.object
        base = self._emit_read(inner)[0] if isinstance(inner, Navigation) else self._emit_base(inner)
        read = "value" if isinstance(feature, Attribute) else "target"
        constant = self.writer.add_constant(feature)
        if isinstance(inner, Variable):
            return code.emit_call(read, base, constant), feature
        temporary = code.Local(f"t{len(self.writer.namespace)}")
        self.writer.namespace[temporary.name] = None
        nowhere = code.Operation("is", (code.AssignmentExpression(temporary, base), code.NONE))
        return code.ConditionalExpression(nowhere, code.NONE, code.emit_call(read, temporary, constant)), feature

    def _expression_type(self, node: Term) -> StaticType | None:
        return check_expression(node, self.types, self.metamodel)[0]

    def _emit_base(self, node: Term) -> code.Expression:
        if isinstance(node, Variable):
            return self.names[node.name]
        return self.writer.emit_expression(self.without_paths(node), self.names, self.types)


def _removes(op: SetTargets | ChangeTargets) -> bool:
    return isinstance(op, ChangeTargets) and op.operator == "-="
