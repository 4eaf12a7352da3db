"""Construct patterns, rules and units in Python, from texts, from data, or from a mixture of both.

The result equals the data that is read from a file.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Literal, TypeVar

from envgraph.errors import InvalidArgument
from envgraph.lang._definition_parts import PartReader
from envgraph.lang.write._rule_writer import annotations_of
from envgraph.lang.write._term_writer import normalised_doc
from envgraph.metamodel import Annotation
from envgraph.pattern import (
    Action,
    Body,
    Constraint,
    LeftSide,
    Modification,
    Parameter,
    Pattern as PatternData,
    RightSide,
    Rule as RuleData,
    RuleBlock,
    RuleEdge,
    RuleNode,
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
    """Return a pattern for `Engine.add`, equal to a pattern read from a `.query` file.

    Args:
        name: the name of the pattern, without its package.
        parameters: the text between the parentheses, such as `a : Tile, b : Tile`, or data.
        body: the text between the braces, or constraints. For several bodies (`or`) pass a list of texts or `Body`s.
            The last `;` of a text is optional.
        package, private, strategy: see `envgraph.pattern.Pattern`.
        annotations: text such as `@Constraint(severity = "error")`, or data.
        doc: the comment written before the pattern.

    Raises:
        LoadError: the texts contain mistakes, each reported with its position.
        InvalidArgument: `name` is not a valid name, or an argument is neither a text nor data of the right kind.

    >>> from envgraph.lang import to_text
    >>> near = Pattern("near", "a : Tile, b : Tile", ["Tile.right(a, b)", "Tile.down(a, b)"])
    >>> print(to_text(near), end="")
    pattern near(a : Tile, b : Tile) { Tile.right(a, b); } or { Tile.down(a, b); }
    """
    parts = PartReader("pattern", name)
    marks = parts.read_annotations(annotations)
    data = PatternData(
        name,
        parts.read_parameters(parameters),
        parts.read_bodies(body),
        package,
        private,
        strategy,
        marks.annotations,
        normalised_doc(marks.doc if doc is None else doc),
    )
    parts.raise_errors()
    return data


def Rule(
    name: str,
    parameters: str | Iterable[Parameter] = (),
    lhs: str | LeftSide | Iterable[RuleNode | RuleEdge | Constraint] = (),
    *,
    rhs: str | RightSide | Iterable[RuleNode | RuleEdge | Action] | None = None,
    modify: str | Modification | Iterable[Action] | None = None,
    blocks: str | Iterable[RuleBlock] = (),
    package: str = "",
    weight: float | None = None,
    priority: int | None = None,
    semantics: Literal["dpo", "spo"] | None = None,
    injective: bool | None = None,
    homomorphic: Iterable[tuple[str, ...]] | None = None,
    annotations: str | Iterable[Annotation] = (),
    doc: str | None = None,
) -> RuleData:
    """Return a rule for `Engine.add`, equal to a rule read from a `.rules` file.

    Args:
        name: the name of the rule, without its package.
        parameters: the text between the parentheses, such as `hedgehog : Hedgehog, out label : string`, or data.
        lhs: the left-hand side: the text between the braces of `lhs`, or nodes, edges and constraints. In this text and
            the texts below, a `;` is optional at the end and before a `}`.
        rhs: the right-hand side, the graph after the application: the text inside `rhs`, or nodes, edges and actions.
        modify: the changes: the text inside `modify`, or actions. Give either `rhs` or `modify`.
        blocks: `not { .. }`, `require { .. }`, `forall { .. }` and `optional { .. }` blocks, as one text or as data.
        package: the package of the rule.
        weight, priority, semantics, injective, homomorphic: see `envgraph.pattern.Rule`; None means the value in
            `annotations`, or the default.
        annotations: text such as `@weight(2.0) @semantics(spo)`, or data.
        doc: the comment written before the rule.

    Raises:
        LoadError: the texts contain mistakes, each reported with its position.
        InvalidArgument: `name` is not a valid name, an argument is neither a text nor data of the right kind, or both
            `rhs` and `modify` are given.

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
            f"rule `{name}` has both `rhs` (the graph after the rule) and `modify` (the changes): keep one of them"
        )
    parts = PartReader("rule", name)
    marks = parts.read_annotations(annotations)
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
        parameters=parts.read_parameters(parameters),
        left=parts.read_left_side(lhs),
        blocks=parts.read_blocks(blocks),
        right=parts.read_modification(modify) if rhs is None else parts.read_right_side(rhs),
        package=package,
        doc=marks.doc if doc is None else doc,
        **{key: value for key, value in given.items() if value is not None},
    )
    parts.raise_errors()
    return _with_text_annotations(data)


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
    """Return a unit for `Engine.add`, equal to a unit read from a `.rules` file.

    Args:
        name: the name of the unit, without its package.
        parameters: the text between the parentheses, such as `hedgehog : Hedgehog`, or data.
        body: the text between the braces, or steps, or a list of texts and steps. The last `;` of a text, and of each
            block in it, is optional.
        package: the package of the unit.
        weight, priority: see `envgraph.pattern.Unit`; None means the value in `annotations`, or the default.
        annotations: text such as `@weight(2.0)`, or data.
        doc: the comment written before the unit.

    Raises:
        LoadError: the texts contain mistakes, each reported with its position.
        InvalidArgument: `name` is not a valid name, or an argument is neither a text nor data of the right kind.

    >>> from envgraph.lang import to_text
    >>> print(to_text(Unit("day", "hog : Hedgehog", "walk(hog); repeat 1..3 { water | mow; }")), end="")
    unit day(hog : Hedgehog) {
        walk(hog);
        repeat 1..3 { water | mow; }
    }
    """
    parts = PartReader("unit", name)
    marks = parts.read_annotations(annotations)
    given = {"weight": None if weight is None else float(weight), "priority": priority}
    data: UnitData = replace(
        marks,
        name=name,
        parameters=parts.read_parameters(parameters),
        body=parts.read_steps(body),
        package=package,
        doc=marks.doc if doc is None else doc,
        **{key: value for key, value in given.items() if value is not None},
    )
    parts.raise_errors()
    return _with_text_annotations(data)


def _with_text_annotations(data: _Data) -> _Data:
    """Return a copy as it would be read from its own text: fields such as `weight` also have annotations. No span."""
    return replace(data, annotations=annotations_of(data), doc=normalised_doc(data.doc), span=None)
