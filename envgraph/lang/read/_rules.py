"""Convert the syntax trees of `.rules` files to rules, units and derived groups of rules."""

from __future__ import annotations

from typing import Literal, cast

from lark import Token, Tree

from envgraph.lang.read._query import parameters_of
from envgraph.lang.read._query_header import DefinitionsFile, name_of, read_definitions
from envgraph.lang.read._reading import Reading, TypeNames, type_of, type_span_of
from envgraph.lang.read._rules_annotations import marks_of
from envgraph.lang.read._rules_graph import left_side_of, modification_of, right_side_of
from envgraph.lang.read._rules_units import block_of
from envgraph.lang.syntax._parsing import Parsed, tokens, trees
from envgraph.pattern import (
    Block,
    BlockKind,
    Derivation,
    LeftSide,
    Modification,
    RightSide,
    Rule,
    Unit,
)

Definition = Rule | Unit | Derivation

_NESTED = ("condition_block", "rule_block")
_SECTIONS = ("left", "right", "modification", *_NESTED)


def read_rules(parsed: Parsed, types: TypeNames | None = None) -> DefinitionsFile[Definition]:
    """Return the rules, units and derivations of a `.rules` file that could be read, with header and diagnostics."""
    return read_definitions(parsed, types, _definition)


def _definition(reading: Reading, package: str, tree: Tree[Token]) -> Definition:
    match tree.data:
        case "rule":
            return _rule(reading, package, tree)
        case "unit":
            return _unit(reading, package, tree)
    return _derivation(reading, package, tree)


def _rule(reading: Reading, package: str, tree: Tree[Token]) -> Rule:
    name = name_of(tree)
    marks = marks_of(reading, tree)
    return Rule(
        name=str(name),
        parameters=parameters_of(reading, tree),
        left=_left(reading, tree, name),
        blocks=_blocks(reading, tree),
        right=_right(reading, tree),
        package=package,
        weight=marks.weight,
        priority=marks.priority,
        semantics=cast("Literal['dpo', 'spo']", marks.semantics),
        injective=marks.injective,
        homomorphic=marks.homomorphic,
        annotations=marks.annotations,
        doc=reading.parsed.doc(tree),
        span=reading.span(name),
        homomorphic_spans=marks.homomorphic_spans,
    )


def _left(reading: Reading, tree: Tree[Token], owner: Token) -> LeftSide:
    """Parse the left-hand side of a rule or of a `forall` or `optional` block; return an empty one if `lhs` is missing.

    Report a second `lhs`, and a rule without `lhs`. Empty blocks are reported by the later check of rules.
    """
    sides = trees(tree.children, "left")
    reading.only("`lhs`", (tokens(side.children)[0] for side in sides), "move its content into the first one")
    if sides:
        return left_side_of(reading, trees(sides[0].children), tokens(sides[0].children)[0])
    if tree.data == "rule" and not reading.broken(tree):
        hint = "add `lhs { ... }`; it may be empty"
        reading.error("missing-left-side", f"rule `{owner}` has no left-hand side", owner, hint)
        reading.gap(tree)
    return LeftSide(span=reading.span(owner))


def _right(reading: Reading, tree: Tree[Token]) -> RightSide | Modification | None:
    """Parse the `rhs` or `modify` of a rule or block; return None if it has neither. Report superfluous ones.

    If both are written, the `rhs` is parsed; if one of them is written twice, the first is parsed.
    """
    rights, modifications = trees(tree.children, "right"), trees(tree.children, "modification")
    reading.only(
        "`rhs`", (tokens(side.children)[0] for side in rights), "move its content into the first one"
    )
    reading.only(
        "`modify`",
        (tokens(side.children)[0] for side in modifications),
        "move its content into the first one",
    )
    if rights and modifications:
        both = sorted([*rights, *modifications], key=lambda side: side.meta.start_pos)
        hint = "keep one of them: `rhs` is the graph after the application, `modify` lists the changes"
        second = next(side for side in both if side.data != both[0].data)
        message = "a rule cannot have both `rhs` and `modify`"
        reading.error("contradiction", message, tokens(second.children)[0], hint)
    if rights:
        return right_side_of(reading, rights[0])
    return modification_of(reading, modifications[0]) if modifications else None


def _blocks(reading: Reading, tree: Tree[Token]) -> tuple[Block, ...]:
    return tuple(_block(reading, part) for part in trees(tree.children, *_NESTED))


def _block(reading: Reading, tree: Tree[Token]) -> Block:
    if tree.data == "condition_block":
        return _condition_block(reading, tree)
    keyword, *plus = tokens(trees(tree.children, "nesting")[0].children)
    kind = "".join((keyword, *plus))
    left = _left(reading, tree, keyword)
    return Block(
        cast(BlockKind, kind), left, _blocks(reading, tree), _right(reading, tree), reading.span(keyword)
    )


def _condition_block(reading: Reading, tree: Tree[Token]) -> Block:
    """Parse a `not` or `require` block, whose conditions are written without `lhs`.

    Report an `lhs` in the block, but parse its conditions too. A later check of rules reports blocks that rewrite.
    """
    keyword = tokens(tree.children)[0]
    statements = [part for part in trees(tree.children) if part.data not in _SECTIONS]
    for side in trees(tree.children, "left"):
        hint = f"write `{keyword} {{ ... }}` without `lhs`"
        reading.error(
            "misplaced-part",
            f"the conditions of `{keyword}` are written directly in it",
            tokens(side.children)[0],
            hint,
        )
        statements.extend(trees(side.children))
    return Block(
        cast(BlockKind, str(keyword)),
        left_side_of(reading, statements, keyword),
        _blocks(reading, tree),
        _right(reading, tree),
        reading.span(keyword),
    )


def _unit(reading: Reading, package: str, tree: Tree[Token]) -> Unit:
    name = name_of(tree)
    marks = marks_of(reading, tree)
    return Unit(
        name=str(name),
        parameters=parameters_of(reading, tree),
        body=block_of(reading, trees(tree.children, "block")[0]),
        package=package,
        weight=marks.weight,
        priority=marks.priority,
        annotations=marks.annotations,
        doc=reading.parsed.doc(tree),
        span=reading.span(name),
    )


def _derivation(reading: Reading, package: str, tree: Tree[Token]) -> Derivation:
    name = name_of(tree)
    marks = marks_of(reading, tree)
    group = trees(tree.children, "among", "operators")[0]
    classes = trees(group.children, "type")
    return Derivation(
        name=str(name),
        kind="retype" if group.data == "among" else "operators",
        classes=tuple(type_of(reading, part) for part in classes),
        package=package,
        weight=marks.weight,
        annotations=marks.annotations,
        doc=reading.parsed.doc(tree),
        span=reading.span(name),
        class_spans=tuple(type_span_of(reading, part) for part in classes),
    )
