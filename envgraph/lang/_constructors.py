"""Patterns, rules and units of Python, in texts or data or some of each: the same data as a file gives."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Literal, TypeVar

from envgraph.errors import InvalidArgument
from envgraph.lang._parts import Parts
from envgraph.lang.write._text_rules import annotations_of
from envgraph.lang.write._text_terms import plain_doc
from envgraph.metamodel import Annotation
from envgraph.pattern import (
    Action,
    Block,
    Body,
    Constraint,
    Edge,
    LeftSide,
    Modification,
    Node,
    Parameter,
    Pattern as PatternData,
    RightSide,
    Rule as RuleData,
    Step,
    Strategy,
    Unit as UnitData,
)

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
    parts = Parts("pattern", name)
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
    parts = Parts("rule", name)
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
    parts = Parts("unit", name)
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
