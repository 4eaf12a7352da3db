"""Convert the syntax trees of `.rules` files to rules, units and derived groups of rules."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, cast

from lark import Token, Tree

from envgraph.lang.read._file_reading import FileReading, TypeNames, resolve_type, type_name_span
from envgraph.lang.read._query_header import DefinitionsFile, name_token, read_definitions
from envgraph.lang.read._query_reader import parse_parameters
from envgraph.lang.read._rules_annotations import parse_marks
from envgraph.lang.read._rules_lhs_rhs import parse_left_side, parse_modification, parse_right_side
from envgraph.lang.read._rules_units import parse_unit_block
from envgraph.lang.syntax._parser import ParseResult, select_tokens, select_trees
from envgraph.pattern import (
    BlockKind,
    Derivation,
    LeftSide,
    Modification,
    RightSide,
    Rule,
    RuleBlock,
    Unit,
)

Definition = Rule | Unit | Derivation

_NESTED = ("condition_block", "rule_block")
_SECTIONS = ("left", "right", "modification", *_NESTED)


def read_rules(parsed: ParseResult, types: TypeNames | None = None) -> DefinitionsFile[Definition]:
    """Return the rules, units and derivations of a `.rules` file that could be read, with header and diagnostics."""
    return read_definitions(parsed, types, _parse_definition)


def _parse_definition(reading: FileReading, package: str, tree: Tree[Token]) -> Definition:
    match tree.data:
        case "rule":
            return _parse_rule(reading, package, tree)
        case "unit":
            return _parse_unit(reading, package, tree)
    return _parse_derivation(reading, package, tree)


def _parse_rule(reading: FileReading, package: str, tree: Tree[Token]) -> Rule:
    name = name_token(tree)
    marks = parse_marks(reading, tree)
    return Rule(
        name=str(name),
        parameters=parse_parameters(reading, tree),
        left=_parse_left_side(reading, tree, name),
        blocks=_parse_blocks(reading, tree),
        right=_parse_right_side(reading, tree),
        package=package,
        weight=marks.weight,
        priority=marks.priority,
        semantics=cast("Literal['dpo', 'spo']", marks.semantics),
        injective=marks.injective,
        homomorphic=marks.homomorphic,
        annotations=marks.annotations,
        doc=reading.parsed.doc_comment(tree),
        span=reading.span(name),
        homomorphic_spans=marks.homomorphic_spans,
    )


def _parse_left_side(reading: FileReading, tree: Tree[Token], owner: Token) -> LeftSide:
    """Parse the left-hand side of a rule or of a `forall` or `optional` block; return an empty one if `lhs` is missing.

    Report a second `lhs`, and a rule without `lhs`. Empty blocks are reported by the later check of rules.
    """
    sides = select_trees(tree.children, "left")
    _report_second_side(reading, "`lhs`", sides)
    if sides:
        return parse_left_side(reading, select_trees(sides[0].children), select_tokens(sides[0].children)[0])
    if tree.data == "rule" and not reading.has_gap(tree):
        hint = "add `lhs { ... }`; it may be empty"
        reading.error("missing-left-side", f"rule `{owner}` has no left-hand side", owner, hint)
        reading.record_gap(tree)
    return LeftSide(span=reading.span(owner))


def _report_second_side(reading: FileReading, noun: str, sides: Iterable[Tree[Token]]) -> None:
    keywords = (select_tokens(side.children)[0] for side in sides)
    reading.first_or_report(noun, keywords, "move its content into the first one")


def _parse_right_side(reading: FileReading, tree: Tree[Token]) -> RightSide | Modification | None:
    """Parse the `rhs` or `modify` of a rule or block; return None if it has neither. Report superfluous ones.

    If both are written, the `rhs` is parsed; if one of them is written twice, the first is parsed.
    """
    rights, modifications = select_trees(tree.children, "right"), select_trees(tree.children, "modification")
    _report_second_side(reading, "`rhs`", rights)
    _report_second_side(reading, "`modify`", modifications)
    if rights and modifications:
        both = sorted([*rights, *modifications], key=lambda side: side.meta.start_pos)
        hint = "keep one of them: `rhs` is the graph after the application, `modify` lists the changes"
        second = next(side for side in both if side.data != both[0].data)
        message = "a rule cannot have both `rhs` and `modify`"
        reading.error("contradiction", message, select_tokens(second.children)[0], hint)
    if rights:
        return parse_right_side(reading, rights[0])
    return parse_modification(reading, modifications[0]) if modifications else None


def _parse_blocks(reading: FileReading, tree: Tree[Token]) -> tuple[RuleBlock, ...]:
    return tuple(_parse_block(reading, part) for part in select_trees(tree.children, *_NESTED))


def _parse_block(reading: FileReading, tree: Tree[Token]) -> RuleBlock:
    if tree.data == "condition_block":
        return _parse_condition_block(reading, tree)
    keyword, *plus = select_tokens(select_trees(tree.children, "nesting")[0].children)
    return _make_block(reading, tree, keyword, "".join((keyword, *plus)), _parse_left_side(reading, tree, keyword))


def _make_block(reading: FileReading, tree: Tree[Token], keyword: Token, kind: str, left: LeftSide) -> RuleBlock:
    return RuleBlock(
        cast(BlockKind, kind),
        left,
        _parse_blocks(reading, tree),
        _parse_right_side(reading, tree),
        reading.span(keyword),
    )


def _parse_condition_block(reading: FileReading, tree: Tree[Token]) -> RuleBlock:
    """Parse a `not` or `require` block, whose conditions are written without `lhs`.

    Report an `lhs` in the block, but parse its conditions too. A later check of rules reports blocks that rewrite.
    """
    keyword = select_tokens(tree.children)[0]
    statements = [part for part in select_trees(tree.children) if part.data not in _SECTIONS]
    for side in select_trees(tree.children, "left"):
        hint = f"write `{keyword} {{ ... }}` without `lhs`"
        reading.error(
            "misplaced-part",
            f"the conditions of `{keyword}` are written directly in it",
            select_tokens(side.children)[0],
            hint,
        )
        statements.extend(select_trees(side.children))
    return _make_block(reading, tree, keyword, str(keyword), parse_left_side(reading, statements, keyword))


def _parse_unit(reading: FileReading, package: str, tree: Tree[Token]) -> Unit:
    name = name_token(tree)
    marks = parse_marks(reading, tree)
    return Unit(
        name=str(name),
        parameters=parse_parameters(reading, tree),
        body=parse_unit_block(reading, select_trees(tree.children, "block")[0]),
        package=package,
        weight=marks.weight,
        priority=marks.priority,
        annotations=marks.annotations,
        doc=reading.parsed.doc_comment(tree),
        span=reading.span(name),
    )


def _parse_derivation(reading: FileReading, package: str, tree: Tree[Token]) -> Derivation:
    name = name_token(tree)
    marks = parse_marks(reading, tree)
    group = select_trees(tree.children, "among", "operators")[0]
    classes = select_trees(group.children, "type")
    return Derivation(
        name=str(name),
        kind="retype" if group.data == "among" else "operators",
        classes=tuple(resolve_type(reading, part) for part in classes),
        package=package,
        weight=marks.weight,
        annotations=marks.annotations,
        doc=reading.parsed.doc_comment(tree),
        span=reading.span(name),
        class_spans=tuple(type_name_span(reading, part) for part in classes),
    )
