"""Patterns, rules and units of Python, in texts or data or some of each: the same data as a file gives."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any, Literal, TypeVar

from envgraph.errors import InvalidArgument
from envgraph.lang.read._from_text import Parts
from envgraph.lang.write._text_rules import annotations_of, block_again, left_again, right_again, steps_again
from envgraph.lang.write._text_terms import TermText, plain_doc
from envgraph.metamodel import Annotation
from envgraph.pattern import (
    Action,
    Alap,
    Atomic,
    Block,
    Body,
    Call,
    Check,
    Choice,
    Comparison,
    Constraint,
    Create,
    DeleteEdge,
    DeleteNode,
    Edge,
    If,
    LeftSide,
    Merge,
    Modification,
    Move,
    Negation,
    Node,
    Parameter,
    PathConstraint,
    PatternCall,
    Redirect,
    Repeat,
    Retype,
    RightSide,
    Sequence,
    Set,
    Step,
    Strategy,
    Try,
    TypeConstraint,
)
from envgraph.pattern import Pattern as PatternData
from envgraph.pattern import Rule as RuleData
from envgraph.pattern import Unit as UnitData

_CONSTRAINTS = (TypeConstraint, PathConstraint, PatternCall, Negation, Comparison, Check)
_ACTIONS = (Create, DeleteNode, DeleteEdge, Set, Retype, Move, Merge, Redirect)
_STEPS = (Call, Sequence, Choice, Alap, Repeat, Try, If, Atomic)

_Data = TypeVar("_Data", RuleData, UnitData)


def Pattern(
    name: str,
    parameters: str | Iterable[Parameter],
    body: str | Body | Iterable[str | Body | Constraint],
    *,
    package: str = "",
    private: bool = False,
    strategy: Strategy | None = None,
    annotations: str | Iterable[Annotation] = (),
    doc: str | None = None,
) -> PatternData:
    """A pattern, for `Engine.add`: equal to what is read from a `.query` file.

    Args:
        name: its name, without the package.
        parameters: what is in the brackets, `a : Tile, b : Tile`, or data.
        body: what is in the braces, or constraints; for several bodies (`or`) a list of texts or `Body`s. The `;` at
            the end of a text may be left out.
        package, private, strategy: see `envgraph.pattern.Pattern`.
        annotations: such as `@Constraint(severity = "error")`, or data.
        doc: the comment before it.

    Raises:
        LoadError: mistakes in texts, each with its place.
        InvalidArgument: a name that is none; something that is neither text nor the data that belongs there.

    >>> from envgraph.lang import to_text
    >>> near = Pattern("near", "a : Tile, b : Tile", ["Tile.right(a, b)", "Tile.down(a, b)"])
    >>> print(to_text(near), end="")
    pattern near(a : Tile, b : Tile) { Tile.right(a, b); } or { Tile.down(a, b); }
    """
    parts = _Reader("pattern", name)
    marks = parts.marks(annotations)
    data = PatternData(
        name,
        parts.parameters(parameters),
        parts.bodies(body),
        package,
        private,
        strategy,
        marks.annotations,
        plain_doc(marks.doc if doc is None else doc),
    )
    parts.finish()
    return data


def Rule(
    name: str,
    parameters: str | Iterable[Parameter] = (),
    lhs: str | LeftSide | Iterable[Node | Edge | Constraint] = (),
    *,
    rhs: str | RightSide | Iterable[Node | Edge | Action] | None = None,
    modify: str | Modification | Iterable[Action] | None = None,
    blocks: str | Iterable[Block] = (),
    package: str = "",
    weight: float | None = None,
    priority: int | None = None,
    semantics: Literal["dpo", "spo"] | None = None,
    injective: bool | None = None,
    homomorphic: Iterable[tuple[str, ...]] | None = None,
    annotations: str | Iterable[Annotation] = (),
    doc: str | None = None,
) -> RuleData:
    """A rule, for `Engine.add`: equal to what is read from a `.rules` file.

    Args:
        name: its name, without the package.
        parameters: what is in the brackets, `hedgehog : Hedgehog, out label : string`, or data.
        lhs: what is in the braces of `lhs`, or nodes, edges and constraints. The `;` at the end of a text, and
            before a `}` in it, may be left out, here and below.
        rhs: what is there afterwards: the inside of `rhs`, or nodes, edges and actions.
        modify: what changes: the inside of `modify`, or actions. Not together with `rhs`.
        blocks: `not { .. }`, `require { .. }`, `forall { .. }`, `optional { .. }`, as one text or as data.
        package: of the name.
        weight, priority, semantics, injective, homomorphic: see `envgraph.pattern.Rule`; None for what the annotations
            say.
        annotations: such as `@weight(2.0) @semantics(spo)`, or data.
        doc: the comment before it.

    Raises:
        LoadError: mistakes in texts, each with its place.
        InvalidArgument: a name that is none; something that is neither text nor the data that belongs there; `rhs`
            and `modify`.

    >>> from envgraph.lang import to_text
    >>> burn = Rule("burn", lhs="tile : RoadTile", modify="retype tile : BurningTile", weight=2.0)
    >>> print(to_text(burn), end="")
    @weight(2.0)
    rule burn {
        lhs { tile : RoadTile; }
        modify { retype tile : BurningTile; }
    }
    """
    if rhs is not None and modify is not None:
        raise InvalidArgument(
            f"`{name}` has `rhs`, what is there afterwards, and `modify`, what changes: keep one of them"
        )
    parts = _Reader("rule", name)
    marks = parts.marks(annotations)
    given = {
        "weight": None if weight is None else float(weight),
        "priority": priority,
        "semantics": semantics,
        "injective": injective,
        "homomorphic": None if homomorphic is None else tuple(map(tuple, homomorphic)),
    }
    data: RuleData = replace(
        marks,
        name=name,
        parameters=parts.parameters(parameters),
        left=parts.left(lhs),
        blocks=parts.blocks(blocks),
        right=parts.modification(modify) if rhs is None else parts.right(rhs),
        package=package,
        doc=marks.doc if doc is None else doc,
        **{key: value for key, value in given.items() if value is not None},
    )
    parts.finish()
    return _said(data)


def Unit(
    name: str,
    parameters: str | Iterable[Parameter] = (),
    body: str | Step | Iterable[str | Step] = (),
    *,
    package: str = "",
    weight: float | None = None,
    priority: int | None = None,
    annotations: str | Iterable[Annotation] = (),
    doc: str | None = None,
) -> UnitData:
    """A unit, for `Engine.add`: equal to what is read from a `.rules` file.

    Args:
        name: its name, without the package.
        parameters: what is in the brackets, `hedgehog : Hedgehog`, or data.
        body: what is in the braces, or steps, or a list of texts and steps. The last `;` of a text, and
            of a block in it, may be left out.
        package: of the name.
        weight, priority: see `envgraph.pattern.Unit`; None for what the annotations say.
        annotations: such as `@weight(2.0)`, or data.
        doc: the comment before it.

    Raises:
        LoadError: mistakes in texts, each with its place.
        InvalidArgument: a name that is none; something that is neither text nor the data that belongs there.

    >>> from envgraph.lang import to_text
    >>> print(to_text(Unit("day", "hog : Hedgehog", "walk(hog); repeat 1..3 { water | mow; }")), end="")
    unit day(hog : Hedgehog) {
        walk(hog);
        repeat 1..3 { water | mow; }
    }
    """
    parts = _Reader("unit", name)
    marks = parts.marks(annotations)
    given = {"weight": None if weight is None else float(weight), "priority": priority}
    data: UnitData = replace(
        marks,
        name=name,
        parameters=parts.parameters(parameters),
        body=parts.steps(body),
        package=package,
        doc=marks.doc if doc is None else doc,
        **{key: value for key, value in given.items() if value is not None},
    )
    parts.finish()
    return _said(data)


def _said(data: _Data) -> _Data:
    """With annotations and comment as a text has them."""
    return replace(data, annotations=annotations_of(data), doc=plain_doc(data.doc), span=None)


class _Reader:
    """The parts of one definition, as text or as data."""

    def __init__(self, kind: str, name: str) -> None:
        if not isinstance(name, str) or not name:
            raise InvalidArgument(f"a {kind} begins with its name, not with {name!r}")
        TermText(name, ()).name(name)
        self._kind = kind
        self._name = name
        self._parts = Parts(kind, name)
        self.finish: Callable[[], None] = self._parts.finish

    def _items(self, part: str, given: Any, kinds: tuple[type, ...], wanted: str) -> tuple[Any, ...]:
        """A single item or several, all of these kinds."""
        single = isinstance(given, kinds)
        items = (given,) if single else tuple(given) if isinstance(given, Iterable) else None
        for item in (given,) if items is None else items:
            if not isinstance(item, kinds):
                raise InvalidArgument(f"`{part}` of `{self._name}` takes a text or {wanted}, not {item!r}")
        return items or ()

    def marks(self, given: str | Iterable[Annotation]) -> Any:
        """A definition that has nothing but annotations."""
        if isinstance(given, str):
            return self._parts.read("annotations", given)
        found = self._items("annotations", given, (Annotation,), "annotations")
        return replace(self._parts.read("annotations", ""), annotations=found)

    def parameters(self, given: str | Iterable[Parameter]) -> tuple[Parameter, ...]:
        """Parameters."""
        if isinstance(given, str):
            found: tuple[Parameter, ...] = self._parts.read("parameters", given).parameters
            return found
        return self._items("parameters", given, (Parameter,), "parameters")

    def bodies(self, given: str | Body | Iterable[str | Body | Constraint]) -> tuple[Body, ...]:
        """One body, or several."""
        wanted = "constraints, or several texts or bodies"
        items = self._items("body", given, (str, Body, *_CONSTRAINTS), wanted)
        conditions = [item for item in items if isinstance(item, _CONSTRAINTS)]
        if not items or (conditions and len(conditions) < len(items)):
            raise InvalidArgument(f"`body` of `{self._name}` takes a text or {wanted}, not {given!r}")
        if conditions:
            return (Body(tuple(conditions)),)
        return tuple(
            self._parts.read("body", one).bodies[0] if isinstance(one, str) else one for one in items
        )

    def left(self, given: str | LeftSide | Iterable[Node | Edge | Constraint]) -> LeftSide:
        """A left side."""
        if isinstance(given, str):
            found: LeftSide = self._parts.read("lhs", given).left
            return found
        if isinstance(given, LeftSide):
            return left_again(given)
        items = self._items("lhs", given, (Node, Edge, *_CONSTRAINTS), "nodes, edges and constraints")
        nodes, edges = _of(items, Node), _of(items, Edge)
        rest = tuple(item for item in items if not isinstance(item, Node | Edge))
        return left_again(LeftSide(nodes, edges, rest))

    def right(self, given: str | RightSide | Iterable[Node | Edge | Action]) -> Any:
        """Return what is there afterwards."""
        if isinstance(given, str):
            return self._parts.read("rhs", given).right
        if isinstance(given, RightSide):
            return right_again(given)
        items = self._items(
            "rhs", given, (Node, Edge, Set, DeleteNode, DeleteEdge), "nodes, edges and `Set`s"
        )
        rest = tuple(item for item in items if not isinstance(item, Node | Edge))
        return right_again(RightSide(_of(items, Node), _of(items, Edge), rest))

    def modification(self, given: str | Modification | Iterable[Action] | None) -> Any:
        """Return what changes, or nothing."""
        if isinstance(given, str):
            return self._parts.read("modify", given).right
        if given is None or isinstance(given, Modification):
            return right_again(given)
        return right_again(Modification(self._items("modify", given, _ACTIONS, "actions")))

    def blocks(self, given: str | Iterable[Block]) -> tuple[Block, ...]:
        """Nested conditions and rules."""
        if isinstance(given, str):
            found: tuple[Block, ...] = self._parts.read("blocks", given).blocks
            return found
        return tuple(map(block_again, self._items("blocks", given, (Block,), "blocks")))

    def steps(self, given: str | Step | Iterable[str | Step]) -> Sequence:
        """One sequence of steps."""
        items = self._items("body", given, (str, *_STEPS), "steps")
        found: list[Step] = []
        for item in items:
            step = self._parts.read("body", item).body if isinstance(item, str) else steps_again(item)
            found += step.steps
        return Sequence(tuple(found))


def _of(items: Iterable[Any], kind: type[Any]) -> tuple[Any, ...]:
    return tuple(item for item in items if isinstance(item, kind))
