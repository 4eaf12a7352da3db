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
from envgraph.rewrite._plan import (
    Absorb,
    Assign as Assign_,
    BlockPlan,
    ChangeTargets,
    Compute,
    Delete,
    Increase,
    Link,
    Rehome,
    SetTargets,
    SetValue,
    SetValues,
    Unlink,
)
from envgraph.rewrite.check._containment import content_of
from envgraph.rewrite.run._effects import ON_MODEL, ON_VALUES, absorb

_VERBS: Final = (
    *("alive", "delete", "link", "new", "retype", "set_target", "set_targets", "set_value"),
    *("target", "unlink", "value", "values"),
)
"""Methods of the graph that generated code calls."""

Namer = Callable[[int], code.Local | code.Index]
"""A function that returns the variable for a slot."""


class Writer:
    """A generator of the code of rule functions, which collects the constants that the code refers to.

    Args:
        model: the model that the function changes.
        slot: returns the variable for a slot.
        lossy: True for SPO semantics, False for DPO.
        sure: True if objects are certainly of the classes in the plan, so that links can be changed without checks.
        again: called for a created link that already exists; None for no call.
        redo: True if the code completes an interrupted application, so that some changes may be made already. Ids of
            new objects are counted from `first`, and sums are computed only if they are None.
        doomed: the objects that the whole application deletes, filled at run time; None if only this block deletes.
        endangered: classes of objects that may be deleted together with another deleted object.

    Attributes:
        namespace: values for the names in the code.
        sums: local variables for values that are computed between changes.
    """

    def __init__(
        self,
        model: Model,
        slot: Namer,
        *,
        lossy: bool,
        sure: bool = False,
        again: Callable[[Link, int, int], None] | None = None,
        redo: bool = False,
        doomed: Collection[int] | None = None,
        endangered: Collection[str | None] = (),
    ) -> None:
        self.model = model
        self.doomed = doomed
        self.endangered = endangered
        self.slot = slot
        self.sure = sure
        self.again = again
        self.redo = redo
        self.sums: list[code.Local] = []
        self.semantics = "spo" if lossy else "dpo"
        self.lossy = lossy
        self.namespace: dict[str, Any] = {
            **EXPRESSION_NAMESPACE,
            **{name: getattr(model.graph, name) for name in _VERBS},
            **{f"_{one.__name__}": partial(one, model.graph) for one in ON_MODEL},
            **{f"_{one.__name__}": one for one in ON_VALUES},
            "_absorb": partial(absorb, model.graph, lossy=lossy),
            "_extend": model.graph.add_target,
            "_semantics": self.semantics,
            "_again": again,
        }
        if redo:
            self.namespace["made"] = lambda node, cls: (
                node if model.graph.alive(node) else model.graph.new_at(node, cls)
            )

    def constant(self, value: object) -> code.Name:
        """Add a constant to the namespace and return its name."""
        name = f"k{len(self.namespace)}"
        self.namespace[name] = value
        return code.Name(name)

    def slots(self, numbers: Iterable[int]) -> code.Tuple:
        """Return code for a tuple of the variables of slots."""
        return code.Tuple(tuple(self.slot(number) for number in numbers))

    # --- the phases of a block, in order

    def compute(self, plan: BlockPlan) -> list[code.Statement]:
        """Emit code that checks required links and computes all values on the state before the rule."""
        asked = [code.Do(code.call("_there", *self._ends(u)), u) for u in plan.unlinks if u.required]
        return [*asked, *(code.Assign(self.slot(c.slot), self._value(c), origin=c) for c in plan.computed)]

    def unlink(self, plan: BlockPlan) -> list[code.Statement]:
        """Emit code that removes links, and takes objects out of old containers before any object is moved."""
        fresh = {new.node for new in plan.creates}
        leaving = [
            self._leave(move, move.container in fresh) for move in plan.moves if move.node not in fresh
        ]
        setting = [change for change in plan.sets if isinstance(change, SetTargets | ChangeTargets)]
        housing = [change for change in setting if self._houses(change.reference)]
        others = len(plan.moves) + sum(self._houses(link.reference) for link in plan.links)
        if not self.sure or len(housing) + others > 1:
            leaving += [statement for change in housing for statement in self._release(change, fresh)]
        return [*map(self._unlink, plan.unlinks), *leaving]

    def _houses(self, reference: Reference) -> bool:
        relation = self.model.graph.store.relations[reference.index]
        return relation.containment or relation.contained

    def _release(self, op: SetTargets | ChangeTargets, fresh: set[int]) -> list[code.Statement]:
        """Emit code that removes objects from containers which they leave because targets are set."""
        known = tuple(value for value in op.values if value not in fresh)
        if op.object in fresh and (not op.reference.containment or _removes(op)):
            return []
        if _removes(op):
            return [self._assign(replace(op, values=known), op)]
        node = code.NONE if op.object in fresh else self.slot(op.object)
        every = code.Constant(isinstance(op, SetTargets))
        return [
            code.Do(code.call("_release", node, self.constant(op.reference), self.slots(known), every), op)
        ]

    def delete(self, plan: BlockPlan) -> list[code.Statement]:
        """Emit code that deletes the objects that still exist."""
        return [self._delete(d, plan) for d in plan.deletes]

    def strip(self, plan: BlockPlan) -> list[code.Statement]:
        """Emit code that removes and stores the links of objects to be merged."""
        return [
            code.Assign(self.slot(a.links), code.call("_strip", self.slot(a.absorbed)), origin=a)
            for a in plan.absorbs
        ]

    def keep(self, slots: tuple[int, ...], plan: BlockPlan) -> code.Statement:
        """Emit code that checks that the rule's preserved objects were not deleted with their containers."""
        names = tuple(plan.names[slot] for slot in slots)
        return code.Do(code.call("_check_kept", self.slots(slots), self.constant(names)))

    def retype(self, plan: BlockPlan) -> list[code.Statement]:
        """Emit code that retypes objects."""
        lossy = code.Constant(self.lossy)
        return [
            code.Do(code.call("retype", self.slot(r.node), self.constant(r.cls), lossy), r)
            for r in plan.retypes
        ]

    def create(self, plan: BlockPlan) -> list[code.Statement]:
        """Emit code that creates objects."""
        return [
            code.Assign(self.slot(new.node), self._new(number, self.constant(new.cls)), origin=new)
            for number, new in enumerate(plan.creates)
        ]

    def _new(self, number: int, cls: code.Name) -> code.Expression:
        if not self.redo:
            return code.call("new", cls)
        return code.call("made", code.Operation("+", (FIRST, code.Constant(number))), cls)

    def link(self, plan: BlockPlan) -> list[code.Statement]:
        """Emit code for merges, moves and new links."""
        moves = [
            code.Do(
                code.call("link", self.slot(m.container), self.constant(m.reference), self.slot(m.node)), m
            )
            for m in plan.moves
        ]
        fresh = {new.node for new in plan.creates}
        housed = Counter(
            content_of(op.reference, op.source, op.target, self.model.metamodel) for op in plan.links
        )
        housed.update(op.node for op in plan.moves)
        links = []
        for op in plan.links:
            content = content_of(op.reference, op.source, op.target, self.model.metamodel)
            homeless = content in fresh and housed[content] == 1
            new = op.source in fresh or op.target in fresh
            links.append(self._link(op, fresh=new, homeless=homeless))
        return [*map(self._absorb, plan.absorbs), *moves, *links]

    def assign(self, plan: BlockPlan) -> list[code.Statement]:
        """Emit code that sets attributes and references."""
        return [statement for change in plan.sets for statement in self._assigned(change)]

    # --- parts

    def _ends(self, op: Unlink | Link) -> tuple[code.Expression, code.Name, code.Expression]:
        return self.slot(op.source), self.constant(op.reference), self.slot(op.target)

    def _unlink(self, op: Unlink) -> code.Statement:
        """Emit code that removes a link if it exists."""
        if not self.sure:
            return code.Do(code.call("unlink", *self._ends(op)), op)
        relation = self.model.graph.store.relations[op.reference.index]
        source, target = self.slot(op.source), self.slot(op.target)
        forward, disconnect = self.constant(relation.forward), self.constant(relation.disconnect)
        there_ = code.Operation("in", (target, code.Index(forward, source)))
        return code.If(there_, (code.Do(code.call(disconnect, source, target)),), origin=op)

    def _make(self, op: Link, homeless: bool) -> code.Expression:
        """Emit an expression that adds a missing link; `homeless` if the contained end certainly has no container."""
        relation = self.model.graph.store.relations[op.reference.index]
        source, reference, target = self._ends(op)
        if relation.containment or relation.contained:
            return code.call("link" if homeless else "_house", source, reference, target)
        if not self.sure:
            return code.call("link", source, reference, target)
        forward, backward = self.constant(relation.forward), self.constant(relation.backward)
        room = []
        if relation.upper < maxsize:
            room.append(_fewer(code.Index(forward, source), relation.upper))
        if relation.opposite_upper < maxsize:
            room.append(_fewer(code.Index(backward, target), relation.opposite_upper))
        made = code.call(self.constant(relation.connect), source, target)
        # If an end is full, `link` raises the error.
        return (
            code.Choice(code.joined("and", room, True), made, code.call("link", source, reference, target))
            if room
            else made
        )

    def _leave(self, op: Rehome, fresh: bool) -> code.Statement:
        """Emit code that removes an object from its container; `fresh` if the new container is not created yet."""
        container = code.NONE if fresh else self.slot(op.container)
        return code.Do(code.call("_leave", self.slot(op.node), container, self.constant(op.reference)), op)

    def _delete(self, op: Delete, plan: BlockPlan) -> code.Statement:
        # The object may have been deleted with its container, or its container may be deleted later.
        node = self.slot(op.node)
        test: code.Expression = code.call("alive", node)
        if plan.classes[op.node] in self.endangered and (self.doomed is not None or len(plan.deletes) > 1):
            others = self.slots(other.node for other in plan.deletes if other is not op)
            doomed = others if self.doomed is None else self.constant(self.doomed)
            test = code.Operation("and", (test, code.inverse(code.call("_inside", node, doomed))))
        return code.If(test, (code.Do(code.call("delete", node, code.Name("_semantics"))),), origin=op)

    def _absorb(self, op: Absorb) -> code.Statement:
        return code.Do(code.call("_absorb", *map(self.slot, (op.kept, op.absorbed, op.links))), op)

    def _link(self, op: Link, *, fresh: bool, homeless: bool) -> code.Statement:
        """Emit code that adds a link unless it exists; `fresh` is True if the rule creates an end. See `_make`."""
        source, target = self.slot(op.source), self.slot(op.target)
        forward = self.constant(self.model.graph.store.relations[op.reference.index].forward)
        made = code.Do(self._make(op, homeless))
        again: code.Body = ()
        if self.again is not None and not fresh:
            again = (code.Do(code.call("_again", self.constant(op), source, target)),)
        missing = code.Operation("not in", (target, code.Index(forward, source)))
        return code.If(code.some(target), (code.If(missing, (made,), again),), origin=op)

    def _assigned(self, op: Assign_) -> list[code.Statement]:
        if not isinstance(op, Increase):
            return [self._assign(op, op)]
        # Two statements, because repeating the second one after an interruption changes nothing.
        node, attribute, value = self.slot(op.object), self.constant(op.attribute), self.slot(op.value)
        new: code.Expression
        if op.attribute.many:
            old = code.call("values", node, attribute)
            new = (
                code.call("_more", old, value, attribute)
                if op.operator == "+="
                else code.call("_less", old, value)
            )
        else:
            function = "_add" if op.operator == "+=" else "_subtract"
            one = code.call("_need", code.call("value", node, attribute), self.constant(str(op.attribute)))
            new = code.call("_bounded", code.call(function, one, value))
        total = code.Local(f"t{len(self.sums)}")
        self.sums.append(total)
        summed: code.Statement = code.Assign(total, new, origin=op)
        if self.redo:
            summed = code.If(code.Operation("is", (total, code.NONE)), (summed,), origin=op)
        return [summed, code.Do(code.call("set_value", node, attribute, total), op)]

    def _assign(
        self, op: SetValue | SetValues | SetTargets | ChangeTargets, origin: Assign_
    ) -> code.Statement:
        node = self.slot(op.object)
        match op:
            case SetValue(_, attribute):
                value = code.NONE if op.value is None else self.slot(op.value)
                return code.Do(code.call("set_value", node, self.constant(attribute), value), origin)
            case SetValues(_, attribute):
                name = self.constant(attribute)
                values = code.call("_listed", self.slots(op.values), name)
                return code.Do(code.call("set_value", node, name, values), origin)
            case SetTargets(_, reference) if reference.many:
                targets = code.call("_present", self.slots(op.values))
                return code.Do(code.call("set_targets", node, self.constant(reference), targets), origin)
            case SetTargets(_, reference):
                target = self.slot(op.values[0]) if op.values else code.NONE
                return code.Do(code.call("set_target", node, self.constant(reference), target), origin)
            case ChangeTargets(_, reference):
                change = "_extend" if op.operator == "+=" else "unlink"
                changed = code.Do(code.call(change, node, self.constant(reference), _T))
                return code.For(_T, self.slots(op.values), (code.If(code.some(_T), (changed,)),), origin)

    # --- values

    def _value(self, compute: Compute) -> code.Expression:
        types = {name: type_ for name, _, type_ in compute.scope}
        names: dict[str, code.Expression] = {name: self.slot(slot) for name, slot, _ in compute.scope}
        reader = PathReader(self, types, names)
        expression = reader.without_paths(compute.expression, compute.needed)
        return self.expression(expression, reader.names, reader.types)

    def expression(
        self, expression: Term, names: Mapping[str, code.Expression], types: Mapping[str, StaticType | None]
    ) -> code.Expression:
        """Emit the code of an expression without paths."""
        base = len(self.namespace)
        known = {name: type_ for name, type_ in types.items() if type_ is not None}
        compiled = compile_expression(expression, names, known, constant=lambda n: code.Name(f"c{base}_{n}"))
        for number, literal in enumerate(compiled.constants):
            self.namespace[f"c{base}_{number}"] = literal
        return compiled.tree


_T: Final = code.Local("t")
FIRST: Final = code.Local("first")
"""The variable with the id of the first new object."""


def _fewer(collection: code.Expression, most: int) -> code.Operation:
    return code.Operation("<", (code.call("len", collection), code.Constant(most)))


class PathReader:
    """A rewriter that replaces the paths of an expression by variables whose code reads the model.

    A path without a value is None in places where `evaluate` gives None, and an error if an operator needs a value.
    """

    def __init__(
        self, writer: Writer, types: Mapping[str, StaticType | None], names: Mapping[str, code.Expression]
    ) -> None:
        self.writer = writer
        self.metamodel = writer.model.metamodel
        self.types = dict(types)
        self.names = dict(names)

    def without_paths(self, node: Term, needed: bool = False) -> Term:
        """Return the expression with new variables in place of paths. If `needed`, a path without value is an error."""
        match node:
            case Navigation() if is_method(node, self._type(node.object)):
                return FunctionCall(node.feature, (self.without_paths(node.object, True),), node.span)
            case Navigation():
                return self._path(node, needed)
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

    def _path(self, node: Navigation, needed: bool) -> Variable:
        value, feature = self._read(node)
        name = f"#{len(self.names)}"
        self.names[name] = code.call("_need", value, self.writer.constant(node.feature)) if needed else value
        self.types[name] = ObjectType(feature.target) if isinstance(feature, Reference) else feature.type
        return Variable(name)

    def _read(self, node: Navigation) -> tuple[code.Expression, Attribute | Reference]:
        owner = self._type(node.object)
        assert isinstance(owner, ObjectType), "the expression has been checked"
        feature = self.metamodel.feature(owner.cls, node.feature)
        assert feature is not None
        inner = node.object
        base = self._read(inner)[0] if isinstance(inner, Navigation) else self._base(inner)
        read = "value" if isinstance(feature, Attribute) else "target"
        constant = self.writer.constant(feature)
        if isinstance(inner, Variable):
            return code.call(read, base, constant), feature
        temporary = code.Local(f"t{len(self.writer.namespace)}")
        self.writer.namespace[temporary.name] = None
        nowhere = code.Operation("is", (code.Let(temporary, base), code.NONE))
        return code.Choice(nowhere, code.NONE, code.call(read, temporary, constant)), feature

    def _type(self, node: Term) -> StaticType | None:
        return check_expression(node, self.types, self.metamodel)[0]

    def _base(self, node: Term) -> code.Expression:
        if isinstance(node, Variable):
            return self.names[node.name]
        return self.writer.expression(self.without_paths(node), self.names, self.types)


def _removes(op: SetTargets | ChangeTargets) -> bool:
    return isinstance(op, ChangeTargets) and op.operator == "-="
