"""Python source for the parts of a plan.

The source holds names of ours and operators; classes, features and literals are constants of the generated function's
namespace. Slot number 3 is the local variable `e3`, or `e[3]` where blocks share a list.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from sys import maxsize
from typing import Any, Final, NamedTuple

from envgraph.code import Name, Text
from envgraph.errors import EvaluationError, RuleError, with_article
from envgraph.graph import Model
from envgraph.metamodel import Attribute, Reference, Value, Values
from envgraph.pattern import (
    EXPRESSION_NAMESPACE,
    Binary,
    Conditional,
    Expression,
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
    Assign,
    BlockPlan,
    ChangeClass,
    ChangeTargets,
    Compute,
    Delete,
    Increase,
    Link,
    New,
    Rehome,
    SetTargets,
    SetValue,
    SetValues,
    Unlink,
)

_DRAGGED: Final = "`move` it out of the container, or delete it too"

Namer = Callable[[int], str]
"""The source that stands for a slot."""

LinkFact = tuple[Reference, int, int]
"""A link of a model: reference, source, target."""


Operation = Compute | Unlink | Delete | ChangeClass | New | Absorb | Rehome | Link | Assign


class Line(NamedTuple):
    """A statement of generated source, of one line or several, and what it carries out."""

    source: str
    operation: Operation | None = None

    @property
    def inside(self) -> Line:
        """The statement as part of another one."""
        return Line("\n".join(f" {part}" for part in self.source.split("\n")), self.operation)


class Writer:
    """Writes the source of one function, and keeps the constants it names.

    Args:
        model: that the function changes.
        slot: what stands for a slot.
        lossy: SPO.
        sure: objects are of the classes that the plan says, so that links are changed without a look at them.
        again: told of a link that is created and there already; None if nobody needs to be.
        redo: whether some of the changes may be made already: ids of new objects are counted from `first`, and sums
            are known unless they are None.
        doomed: what the whole application deletes, known when it is made; None if the block alone deletes.
        endangered: classes of objects that may go along with another one that is deleted.

    Attributes:
        namespace: what the source may refer to.
        sums: names of the values that are computed between the changes.
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
        self.sums: list[str] = []
        self.semantics = "spo" if lossy else "dpo"
        self.lossy = lossy
        self.namespace: dict[str, Any] = {
            **EXPRESSION_NAMESPACE,
            "alive": model.alive,
            "delete": model.delete,
            "link": model.link,
            "new": model.new,
            "retype": model.retype,
            "set_target": model.set_target,
            "set_targets": model.set_targets,
            "set_value": model.set_value,
            "target": model.target,
            "unlink": model.unlink,
            "value": model.value,
            "values": model.values,
            "_absorb": lambda kept, absorbed, links: absorb(model, kept, absorbed, links, lossy=lossy),
            "_strip": lambda node: strip(model, node),
            "_leave": lambda node, container, reference: leave(model, node, container, reference),
            "_check_kept": lambda nodes, names: check_kept(model, nodes, names),
            "_extend": model.add_target,
            "_inside": lambda node, others: inside(model, node, others),
            "_house": lambda source, reference, target: house(model, source, reference, target),
            "_release": lambda node, reference, targets, every: release(
                model, node, reference, targets, every
            ),
            "_there": lambda source, reference, target: there(model, source, reference, target),
            "_again": again,
            "_need": need,
            "_present": present,
            "_listed": listed,
            "_more": more,
            "_less": less,
        }
        if redo:
            self.namespace["made"] = lambda node, cls: node if model.alive(node) else model.new_at(node, cls)

    def constant(self, value: object) -> str:
        """A name for a constant."""
        name = f"k{len(self.namespace)}"
        self.namespace[name] = value
        return name

    def slots(self, numbers: tuple[int, ...]) -> str:
        """A tuple of slots."""
        return f"({''.join(f'{self.slot(number)}, ' for number in numbers)})"

    # --- the phases of a block, in order

    def compute(self, plan: BlockPlan) -> list[Line]:
        """Values on the state before the rule, and links that have to be there."""
        asked = [
            Line(f"_there({self.slot(u.source)}, {self.constant(u.reference)}, {self.slot(u.target)})", u)
            for u in plan.unlinks
            if u.required
        ]
        return [*asked, *(Line(f"{self.slot(c.slot)} = {self._value(c)}", c) for c in plan.computed)]

    def unlink(self, plan: BlockPlan) -> list[Line]:
        """Links that go, and objects that leave their container: all before one enters another."""
        fresh = {new.node for new in plan.creates}
        leaving = [
            Line(self._leave(move, move.container in fresh), move)
            for move in plan.moves
            if move.node not in fresh
        ]
        setting = [change for change in plan.sets if isinstance(change, SetTargets | ChangeTargets)]
        housing = [change for change in setting if self._houses(change.reference)]
        others = len(plan.moves) + sum(self._houses(link.reference) for link in plan.links)
        if not self.sure or len(housing) + others > 1:
            leaving += [Line(line, change) for change in housing for line in self._release(change, fresh)]
        return [*(Line(self._unlink(unlink), unlink) for unlink in plan.unlinks), *leaving]

    def _houses(self, reference: Reference) -> bool:
        relation = self.model.store.relations[reference.index]
        return relation.containment or relation.contained

    def _release(self, op: SetTargets | ChangeTargets, fresh: set[int]) -> list[str]:
        """What targets that are set take out of containers."""
        known = tuple(value for value in op.values if value not in fresh)
        if op.object in fresh and (not op.reference.containment or _removes(op)):
            return []
        if _removes(op):
            return [self._assign(replace(op, values=known))]
        node = "None" if op.object in fresh else self.slot(op.object)
        every = isinstance(op, SetTargets)
        return [f"_release({node}, {self.constant(op.reference)}, {self.slots(known)}, {every})"]

    def delete(self, plan: BlockPlan) -> list[Line]:
        """Objects that go."""
        return [Line(self._delete(d, plan), d) for d in plan.deletes]

    def strip(self, plan: BlockPlan) -> list[Line]:
        """Links that objects which are merged take along."""
        return [Line(f"{self.slot(a.links)} = _strip({self.slot(a.absorbed)})", a) for a in plan.absorbs]

    def keep(self, slots: tuple[int, ...], plan: BlockPlan) -> str:
        """Makes sure that what the rule keeps has not gone with its container."""
        names = tuple(plan.names[slot] for slot in slots)
        return f"_check_kept({self.slots(slots)}, {self.constant(names)})"

    def retype(self, plan: BlockPlan) -> list[Line]:
        """Objects that change their class."""
        return [
            Line(f"retype({self.slot(r.node)}, {self.constant(r.cls)}, {self.lossy})", r)
            for r in plan.retypes
        ]

    def create(self, plan: BlockPlan) -> list[Line]:
        """New objects."""
        made = "made(first + {}, {})" if self.redo else "new({1})"
        return [
            Line(f"{self.slot(new.node)} = {made.format(number, self.constant(new.cls))}", new)
            for number, new in enumerate(plan.creates)
        ]

    def link(self, plan: BlockPlan) -> list[Line]:
        """Merges, moves and new links."""
        moves = [
            Line(f"link({self.slot(m.container)}, {self.constant(m.reference)}, {self.slot(m.node)})", m)
            for m in plan.moves
        ]
        fresh = {new.node for new in plan.creates}
        housed = Counter(content_of(op.reference, op.source, op.target, self.model) for op in plan.links)
        housed.update(op.node for op in plan.moves)
        links = []
        for op in plan.links:
            content = content_of(op.reference, op.source, op.target, self.model)
            homeless = content in fresh and housed[content] == 1
            new = op.source in fresh or op.target in fresh
            links.append(Line(self._link(op, fresh=new, homeless=homeless), op))
        return [*(Line(self._absorb(absorb), absorb) for absorb in plan.absorbs), *moves, *links]

    def assign(self, plan: BlockPlan) -> list[Line]:
        """Values and targets that are set."""
        return [line for change in plan.sets for line in self._assigned(change)]

    # --- parts

    def _unlink(self, op: Unlink) -> str:
        return self._take(self.slot(op.source), op.reference, self.slot(op.target))

    def _take(self, source: str, reference: Reference, target: str) -> str:
        """Remove a link, if it is there."""
        relation = self.model.store.relations[reference.index]
        if not self.sure:
            return f"unlink({source}, {self.constant(reference)}, {target})"
        forward, disconnect = self.constant(relation.forward), self.constant(relation.disconnect)
        return f"if {target} in {forward}[{source}]: {disconnect}({source}, {target})"

    def _make(self, source: str, reference: Reference, target: str, homeless: bool) -> str:
        """Add a link that is not there; `homeless` if what it contains, if anything, is surely in no container."""
        relation = self.model.store.relations[reference.index]
        ends = f"({source}, {self.constant(reference)}, {target})"
        if relation.containment or relation.contained:
            return f"link{ends}" if homeless else f"_house{ends}"
        if not self.sure:
            return f"link{ends}"
        forward, backward = self.constant(relation.forward), self.constant(relation.backward)
        room = []
        if relation.upper < maxsize:
            room.append(f"len({forward}[{source}]) < {relation.upper}")
        if relation.opposite_upper < maxsize:
            room.append(f"len({backward}[{target}]) < {relation.opposite_upper}")
        made = f"{self.constant(relation.connect)}({source}, {target})"
        # Where there is no room `link` says so.
        return f"{made} if {' and '.join(room)} else link{ends}" if room else made

    def _leave(self, op: Rehome, fresh: bool) -> str:
        """An object leaves its container; `fresh` if it goes to one that is not there yet."""
        container = "None" if fresh else self.slot(op.container)
        return f"_leave({self.slot(op.node)}, {container}, {self.constant(op.reference)})"

    def _delete(self, op: Delete, plan: BlockPlan) -> str:
        # A container that went before has taken its contents along; one that will go takes them.
        node, test = self.slot(op.node), f"alive({self.slot(op.node)})"
        if plan.classes[op.node] in self.endangered and (self.doomed is not None or len(plan.deletes) > 1):
            others = self.slots(tuple(other.node for other in plan.deletes if other is not op))
            test += (
                f" and not _inside({node}, {others if self.doomed is None else self.constant(self.doomed)})"
            )
        return f"if {test}: delete({node}, {self.semantics!r})"

    def _absorb(self, op: Absorb) -> str:
        return f"_absorb({self.slot(op.kept)}, {self.slot(op.absorbed)}, {self.slot(op.links)})"

    def _link(self, op: Link, *, fresh: bool, homeless: bool) -> str:
        """Adds a link unless it is there; `fresh` if that cannot be, `homeless` as for `_make`."""
        source, target = self.slot(op.source), self.slot(op.target)
        forward = self.constant(self.model.store.relations[op.reference.index].forward)
        made = f"if {target} not in {forward}[{source}]: {self._make(source, op.reference, target, homeless)}"
        if self.again is not None and not fresh:
            made += f"\n else: _again({self.constant(op)}, {source}, {target})"
        return f"if {target} is not None:\n {made}"

    def _assigned(self, op: Assign) -> list[Line]:
        if not isinstance(op, Increase):
            return [Line(self._assign(op), op)]
        # Two steps: to set a value once more changes nothing.
        total = f"t{len(self.sums)}"
        self.sums.append(total)
        begin = f"if {total} is None: " if self.redo else ""
        node, attribute = self.slot(op.object), self.constant(op.attribute)
        if op.attribute.many:
            changed = f"values({node}, {attribute}), {self.slot(op.value)}"
            new = (
                f"{total} = _more({changed}, {attribute})"
                if op.operator == "+="
                else f"{total} = _less({changed})"
            )
            return [Line(begin + new, op), Line(f"set_value({node}, {attribute}, {total})", op)]
        function = "_add" if op.operator == "+=" else "_subtract"
        old = f"_need(value({node}, {attribute}), {self.constant(str(op.attribute))})"
        new = f"{total} = _bounded({function}({old}, {self.slot(op.value)}))"
        return [Line(begin + new, op), Line(f"set_value({node}, {attribute}, {total})", op)]

    def _assign(self, op: SetValue | SetValues | SetTargets | ChangeTargets) -> str:
        node = self.slot(op.object)
        match op:
            case SetValue():
                value = "None" if op.value is None else self.slot(op.value)
                return f"set_value({node}, {self.constant(op.attribute)}, {value})"
            case SetValues():
                attribute = self.constant(op.attribute)
                return f"set_value({node}, {attribute}, _listed({self.slots(op.values)}, {attribute}))"
            case SetTargets():
                return self._set_targets(op)
            case ChangeTargets():
                return self._change_targets(op)

    def _set_targets(self, op: SetTargets) -> str:
        node, reference = self.slot(op.object), self.constant(op.reference)
        if op.reference.many:
            return f"set_targets({node}, {reference}, _present({self.slots(op.values)}))"
        return f"set_target({node}, {reference}, {self.slot(op.values[0]) if op.values else 'None'})"

    def _change_targets(self, op: ChangeTargets) -> str:
        node, reference = self.slot(op.object), self.constant(op.reference)
        loop = f"for t in {self.slots(op.values)}:"
        if op.operator == "+=":
            return f"{loop}\n if t is not None: _extend({node}, {reference}, t)"
        return f"{loop}\n if t is not None: unlink({node}, {reference}, t)"

    # --- values

    def _value(self, compute: Compute) -> str:
        types = {name: type_ for name, _, type_ in compute.scope}
        names = {name: self.slot(slot) for name, slot, _ in compute.scope}
        reader = PathReader(self, types, names)
        expression = reader.without_paths(compute.expression, compute.needed)
        return self.expression(expression, reader.names, reader.types)

    def expression(
        self, expression: Expression, names: Mapping[str, str], types: Mapping[str, StaticType | None]
    ) -> str:
        """The source of an expression without paths."""
        base = len(self.namespace)
        known = {name: type_ for name, type_ in types.items() if type_ is not None}
        sources = {name: Text(source) for name, source in names.items()}
        compiled = compile_expression(
            expression, sources, known, constant=lambda number: Name(f"c{base}_{number}")
        )
        for number, literal in enumerate(compiled.constants):
            self.namespace[f"c{base}_{number}"] = literal
        return compiled.source


class PathReader:
    """Replaces the paths of an expression by variables, whose source reads the model.

    A path that leads nowhere is None where `evaluate` gives None, and an error where an operator needs a value.
    """

    def __init__(
        self, writer: Writer, types: Mapping[str, StaticType | None], names: Mapping[str, str]
    ) -> None:
        self.writer = writer
        self.metamodel = writer.model.metamodel
        self.types = dict(types)
        self.names = dict(names)

    def without_paths(self, node: Expression, needed: bool = False) -> Expression:
        """The expression without paths; `needed` where the operator around it takes no None."""
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
        source, feature = self._read(node)
        if needed:
            source = f"_need({source}, {self.writer.constant(node.feature)})"
        name = f"#{len(self.names)}"
        self.names[name] = source
        self.types[name] = ObjectType(feature.target) if isinstance(feature, Reference) else feature.type
        return Variable(name)

    def _read(self, node: Navigation) -> tuple[str, Attribute | Reference]:
        owner = self._type(node.object)
        assert isinstance(owner, ObjectType), "the expression has been checked"
        feature = self.metamodel.feature(owner.cls, node.feature)
        assert feature is not None
        inner = node.object
        base = self._read(inner)[0] if isinstance(inner, Navigation) else self._base(inner)
        read = "value" if isinstance(feature, Attribute) else "target"
        constant = self.writer.constant(feature)
        if isinstance(inner, Variable):
            return f"{read}({base}, {constant})", feature
        temporary = f"t{len(self.writer.namespace)}"
        self.writer.namespace[temporary] = None
        return f"(None if ({temporary} := {base}) is None else {read}({temporary}, {constant}))", feature

    def _type(self, node: Expression) -> StaticType | None:
        return check_expression(node, self.types, self.metamodel)[0]

    def _base(self, node: Expression) -> str:
        if isinstance(node, Variable):
            return self.names[node.name]
        return self.writer.expression(self.without_paths(node), self.names, self.types)


def _removes(op: SetTargets | ChangeTargets) -> bool:
    return isinstance(op, ChangeTargets) and op.operator == "-="


def need(value: Value | int | None, feature: str) -> Value | int:
    """The value, which an operator needs.

    Raises:
        EvaluationError: there is none.
    """
    if value is None:
        raise EvaluationError(f"`{feature}` has no value")
    return value


def listed(values: Values, attribute: Attribute) -> Values:
    """The values of an attribute with many: each once, unless it may have one several times."""
    return tuple(dict.fromkeys(values)) if attribute.unique else values


def more(values: Values, value: Value, attribute: Attribute) -> Values:
    """The values with one more at the end; see `listed`."""
    return listed((*values, value), attribute)


def less(values: Values, value: Value) -> Values:
    """The values without one, wherever it stands."""
    return tuple(one for one in values if one != value)


class Dragged(RuleError):
    """An object that a rule keeps or changes would go with its container; `node` is there again after a rollback."""

    def __init__(self, message: str, node: int) -> None:
        super().__init__(message, reason="containment", hint=_DRAGGED)
        self.node = node


def check_kept(model: Model, nodes: tuple[int, ...], names: tuple[str, ...]) -> None:
    """Check that objects are still there.

    Raises:
        Dragged: one went with its container.
    """
    for node, name in zip(nodes, names, strict=True):
        if not model.alive(node):
            what = f"`{name}` is kept" if name else "an object is changed"
            raise Dragged(f"{what}, and goes with a container that is deleted", node)


def present(targets: tuple[int | None, ...]) -> tuple[int, ...]:
    """The targets that there are, each once."""
    return tuple(dict.fromkeys(target for target in targets if target is not None))


def there(model: Model, source: int, reference: Reference, target: int) -> None:
    """Check that there is a link.

    Raises:
        RuleError: there is none ("missing-link").
    """
    if not model.has_link(source, reference, target):
        ends = f"{model.describe(source)} -{reference.name}-> {model.describe(target)}"
        raise RuleError(f"there is no {ends} to redirect", reason="missing-link", details=[ends])


def leave(model: Model, node: int, container: int | None, reference: Reference) -> None:
    """Take an object out of its container, unless it is already where it is to go, or not there yet."""
    old = model.container(node) if model.alive(node) else None
    if old is not None and old != (container, reference):
        model.unlink(old[0], old[1], node)


def inside(model: Model, node: int, others: Collection[int]) -> bool:
    """Whether an object is contained in one of the others, at any depth."""
    found = model.container(node)
    while found is not None:
        if found[0] in others:
            return True
        found = model.container(found[0])
    return False


def content_of(reference: Reference, source: int, target: int, model: Model) -> int | None:
    """Which end of a link is contained in the other; None if neither is."""
    opposite = model.metamodel.opposite(reference)
    if opposite is not None and opposite.containment:
        return source
    return target if reference.containment else None


def house(model: Model, source: int, reference: Reference, target: int) -> None:
    """Add a link between a container and an object that is in none: like any other, it needs room at both ends.

    Raises:
        RuleError: the object is in a container ("full"), or the container is inside it ("containment").
    """
    opposite = model.metamodel.opposite(reference)
    if not reference.containment:
        assert opposite is not None
        source, reference, target = target, opposite, source
    old = model.container(target) if model.alive(target) else None
    if old is not None:
        container, feature = model.describe(old[0]), old[1].name
        message = f"{model.describe(target)} is in {container} already"
        raise RuleError(
            message,
            reason="full",
            details=[f"{container} -{feature}-> {model.describe(target)}"],
            hint="`move` or `set` takes it out",
        )
    model.link(source, reference, target)


def release(
    model: Model, node: int | None, reference: Reference, targets: tuple[int | None, ...], every: bool
) -> None:
    """Take out of containers what setting targets will take out; `every`: these will be all of them.

    Args:
        model: the model.
        node: the object that gets the targets; None if it is not there yet.
        reference: that contains, or whose opposite does.
        targets: None is none.
        every: the targets replace those that are there.
    """
    known = node is not None and model.alive(node)
    if not reference.containment:
        opposite = model.metamodel.opposite(reference)
        assert node is not None and opposite is not None
        if known:
            leave(model, node, next(iter(targets), None), opposite)
        return
    if node is not None and known and every:
        for old in tuple(model.targets(node, reference)):
            if old not in targets:
                model.unlink(node, reference, old)
    for target in targets:
        if target is not None:
            leave(model, target, node, reference)


def strip(model: Model, node: int) -> list[LinkFact]:
    """Take away all links of an object that is going to be merged, and return them."""
    links = links_of(model, node)
    for reference, source, target in links:
        model.unlink(source, reference, target)
    return links


def absorb(model: Model, kept: int, absorbed: int, links: list[LinkFact], *, lossy: bool) -> None:
    """Merge two objects: the links of `absorbed` go over to `kept`, then it is deleted.

    A link that both have becomes one, one between the two a loop. The container of `kept` stays, if it has one.

    Raises:
        RuleError: the class of `kept` lacks a reference ("lost-link", unless `lossy`), or `kept` has another target
            there ("full").
    """
    if kept == absorbed:
        raise RuleError("an object cannot be merged with itself", reason="identification")
    if not model.alive(absorbed):
        return  # another match of a block has merged the same two
    house = model.container(kept)
    housed = house is not None and house[0] != absorbed
    # Another merge may have handed links over to this one.
    for reference, source, target in [*links, *strip(model, absorbed)]:
        link = f"{model.describe(source)} -{reference.name}-> {model.describe(target)}"
        source, target = (kept if end == absorbed else end for end in (source, target))
        if reference.containment and (source == target or (target == kept and housed)):
            continue
        ends = ((source, reference.owner), (target, reference.target))
        wrong = next((end for end, cls in ends if not model.metamodel.is_a(model.class_of(end), cls)), None)
        if wrong is not None:
            if lossy:
                continue
            found = f"{model.describe(wrong)}, {with_article(model.class_of(wrong))},"
            message = f"{found} cannot have the links of `{reference}` that are handed over"
            raise RuleError(message, reason="lost-link", details=[link])
        model.link(source, reference, target)
    model.delete(absorbed, "dpo")


def links_of(model: Model, node: int) -> list[LinkFact]:
    """The links at an object; of an opposite pair by the reference that contains, else by the first."""
    found: dict[LinkFact, None] = {}
    cls = model.class_of(node)
    for reference in model.metamodel.references:
        opposite = model.metamodel.opposite(reference)
        if opposite is not None and _precedence(opposite) < _precedence(reference):
            continue
        if model.metamodel.is_a(cls, reference.owner):
            found.update(((reference, node, other), None) for other in model.targets(node, reference))
        if model.metamodel.is_a(cls, reference.target):
            found.update(((reference, other, node), None) for other in model.sources(node, reference))
    return list(found)


def _precedence(reference: Reference) -> tuple[bool, int]:
    return not reference.containment, reference.index
