"""Parse the conditions of a query body: relations, comparisons, checks and their terms."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import cast

from lark import Token, Tree

from envgraph.errors import did_you_mean
from envgraph.lang.read._expression_parser import (
    parse_dotted_literal,
    parse_enum_or_java_constant,
    parse_expression,
    parse_literal,
    parse_variable,
)
from envgraph.lang.read._file_reading import FileReading, resolve_type, type_name_span
from envgraph.lang.read._java_names import JAVA_TYPES
from envgraph.lang.syntax._parser import qualified_name_of, select_tokens, select_trees
from envgraph.pattern import (
    Aggregate,
    AggregateFunction,
    Binary,
    Check,
    Closure,
    ColumnMark,
    Comparison,
    Constant,
    Constraint,
    EnumLiteral,
    Evaluation,
    Expression,
    Navigation,
    Negation,
    PathConstraint,
    PatternCall,
    Relation,
    Term,
    TypeConstraint,
    Variable,
)


def parse_conditions(reading: FileReading, statements: Iterable[Tree[Token]]) -> tuple[Constraint, ...]:
    """Parse several conditions; leave out each invalid condition, which is reported and recorded as a gap."""
    read = []
    for statement in statements:
        condition = parse_condition(reading, statement)
        if condition is None:
            reading.record_gap(statement)
        else:
            read.append(condition)
    return tuple(read)


def parse_condition(reading: FileReading, tree: Tree[Token]) -> Constraint | None:
    """Parse one condition; report an invalid condition and return None."""
    match tree.data:
        case "negation":
            relation = parse_relation(reading, select_trees(tree.children)[0])
            return Negation(relation, reading.span(tree)) if relation else None
        case "check":
            return Check(_parse_check_expression(reading, select_trees(tree.children)[0]), reading.span(tree))
        case "comparison":
            return _parse_comparison(reading, tree)
    return parse_relation(reading, tree)


def _parse_check_expression(reading: FileReading, tree: Tree[Token]) -> Expression:
    """Parse the expression of `check(..)`; the span of the expression leaves out the parentheses."""
    return parse_expression(reading, select_trees(tree.children)[0] if tree.data == "group" else tree)


def parse_relation(reading: FileReading, tree: Tree[Token]) -> Relation | None:
    """Parse `Type(x)`, `Type.f(x, y)` or `find p(..)`; return None if it is invalid, which is then reported."""
    match tree.data:
        case "pattern_call":
            return parse_pattern_call(reading, tree)
        case "path_constraint":
            return _parse_path_constraint(reading, tree)
    return _parse_type_constraint(reading, tree)


def parse_pattern_call(reading: FileReading, tree: Tree[Token]) -> PatternCall:
    """Parse `find p(..)` and record `p` as used; replace the name of an imported pattern by its qualified name."""
    name = select_trees(tree.children, "qualified_name")[0]
    pattern = qualified_name_of(name)
    reading.used_names.add(pattern)
    return PatternCall(
        reading.imported.get(pattern, pattern),
        _parse_terms(reading, tree),
        parse_closure(tree),
        reading.span(tree),
        pattern_span=reading.span(name),
    )


def parse_closure(tree: Tree[Token]) -> Closure:
    """Parse the transitive closure sign `+` or `*` of a relation or arrow; return `Closure.ONCE` if it has none."""
    return next((Closure(str(part.children[0])) for part in select_trees(tree.children, "closure")), Closure.ONCE)


def parse_java_type(reading: FileReading, tree: Tree[Token]) -> str | None:
    """Parse `java Integer` or `java java.lang.Integer` into a data type; report an unknown class and return None."""
    name = qualified_name_of(select_trees(tree.children)[0])
    simple = name.rpartition(".")[2]
    reading.used_names.add(simple)
    if simple not in JAVA_TYPES:
        hint = did_you_mean(simple, JAVA_TYPES) or "the data types are int, float, bool and string"
        reading.error("unknown-type", f"`{name}` is not a data type", select_trees(tree.children)[0], hint)
    return JAVA_TYPES.get(simple)


def _parse_terms(reading: FileReading, tree: Tree[Token]) -> tuple[Term, ...]:
    return tuple(
        parse_term(reading, item)
        for part in select_trees(tree.children, "terms")
        for item in select_trees(part.children)
    )


# --- relations ---


def _parse_type_constraint(reading: FileReading, tree: Tree[Token]) -> Relation | None:
    head = select_trees(tree.children)[0]
    terms = _parse_terms(reading, tree)
    if head.data == "java_type":
        name, span = parse_java_type(reading, head), reading.span(select_trees(head.children)[0])
    else:
        alias, name = (str(part) if part else None for part in head.children)
        if alias and alias not in reading.aliases and len(terms) == 2:
            hint = f"write a path with `.`: `{alias}.{name}(..)`"
            reading.error("unknown-alias", f"no import has the alias `{alias}`", select_tokens(head.children)[0], hint)
            return None
        name, span = resolve_type(reading, head), type_name_span(reading, head)
    if len(terms) != 1:
        hint = f"write `find {reading.text(tree)}` to call a pattern" if terms else f"write `{name}(x)`"
        reading.error("wrong-arity", f"a type constraint takes 1 argument, not {len(terms)}", tree, hint)
        return None
    return TypeConstraint(name, terms[0], span=reading.span(tree), type_span=span) if name else None


def _parse_path_constraint(reading: FileReading, tree: Tree[Token]) -> PathConstraint | None:
    head, path = select_trees(tree.children)[:2]
    terms = _parse_terms(reading, tree)
    type_ = resolve_type(reading, head)
    features = select_tokens(path.children)
    if len(terms) != 2 and reading.parsed.has_mistake(tree):
        reading.record_gap(tree)
        return None
    if len(terms) != 2:
        dotted = ".".join((type_, *features))
        hint = f"write `{dotted}(source, target)`; to call a pattern, write `find`"
        reading.error("wrong-arity", f"a path takes 2 arguments, not {len(terms)}", tree, hint)
        return None
    return PathConstraint(
        type_,
        tuple(str(feature) for feature in features),
        terms[0],
        terms[1],
        parse_closure(tree),
        reading.span(tree),
        type_span=type_name_span(reading, head),
        feature_spans=reading.spans(features),
    )


# --- comparisons ---


def _parse_comparison(reading: FileReading, tree: Tree[Token]) -> Comparison | Check | None:
    left = parse_term(reading, select_trees(tree.children)[0])
    right = _parse_right_operand(reading, select_trees(tree.children)[2])
    comparator = select_tokens(select_trees(tree.children, "comparator")[0].children)[0]
    span = reading.span(tree)
    match str(comparator):
        case "==" | "===":
            return Comparison("==", left, right, span)
        case "!=" | "!==":
            return Comparison("!=", left, right, span)
        case "=":
            reading.error("unexpected-token", "`=` is not a comparison", comparator, "write `==`")
            return Comparison("==", left, right, span)
    hint = f"write `check({reading.text(tree)})`"
    counted = next((side for side in (left, right) if isinstance(side, Aggregate)), None)
    if counted is not None and counted.span is not None:
        shown = reading.text(tree).replace(counted.span.text, "n")
        hint = f"write `n == {counted.span.text}; check({shown});`"
    reading.error("misplaced-expression", f"`{comparator}` is allowed only in a `check`", comparator, hint)
    sides = [side for side in (left, right) if isinstance(side, Variable | Constant | EnumLiteral)]
    return Check(Binary(str(comparator), sides[0], sides[1], span), span) if len(sides) == 2 else None


def _parse_right_operand(reading: FileReading, tree: Tree[Token]) -> Term:
    if tree.data == "bare_call":
        call = parse_pattern_call(reading, select_trees(tree.children)[0])
        hint = f"write `count {reading.text(tree)}` for the number of its matches"
        reading.error("misplaced-call", "the call of a pattern is not a value", tree, hint)
        return Aggregate("count", call, reading.span(tree))
    if tree.data != "bare_arithmetic":
        return parse_term(reading, tree)
    literal = None
    if not select_trees(tree.children):
        owner, _, feature = select_tokens(tree.children)
        literal = parse_dotted_literal(reading, str(owner), feature, tree)
    if literal is not None:
        return literal
    hint = f"write `eval({reading.text(tree)})`"
    reading.error("misplaced-expression", "an expression is allowed only in an `eval`", tree, hint)
    return Evaluation(_parse_bare_expression(reading, tree), reading.span(tree))


def _parse_bare_expression(reading: FileReading, tree: Tree[Token]) -> Expression:
    parts = select_trees(tree.children)
    if not parts:
        owner, _, feature = select_tokens(tree.children)
        return Navigation(parse_variable(reading, owner), str(feature), reading.span(tree), reading.span(feature))
    left, right = parse_term(reading, parts[0]), parse_expression(reading, parts[1])
    if not isinstance(left, Variable | Constant | EnumLiteral):
        return right
    return Binary(str(select_tokens(tree.children)[0]), left, right, reading.span(tree))


# --- terms ---


def parse_term(reading: FileReading, tree: Tree[Token]) -> Term:
    """Parse a term: a variable, constant, enum literal, evaluation or aggregate; replace an invalid term by `_`."""
    return _TERM_PARSERS[tree.data](reading, tree)


def _parse_variable(reading: FileReading, tree: Tree[Token]) -> Variable:
    name = select_tokens(tree.children)[0]
    if name == "null":
        return _report_no_value(reading, tree, "`null` is not a value, so nothing matches it")
    return parse_variable(reading, name)


def _report_no_value(reading: FileReading, tree: Tree[Token], message: str) -> Variable:
    hint = "write `neg Type.feature(x, _)` for a feature without a value"
    reading.error("none-in-query", message, tree, hint)
    reading.record_gap(tree)
    return Variable("_", reading.span(tree))


def _parse_constant(reading: FileReading, tree: Tree[Token]) -> Term:
    literal = select_trees(tree.children)[0]
    if literal.data == "none":
        return _report_no_value(reading, tree, "`none` means that there is no value, so nothing matches it")
    return parse_literal(reading, literal, next(iter(select_tokens(tree.children)), None))


def _parse_positive(reading: FileReading, tree: Tree[Token]) -> Constant:
    literal = select_trees(tree.children)[0]
    if literal.data != "number":
        reading.error("unexpected-sign", "only a number can have a sign", tree, "remove the `+`")
    return parse_literal(reading, literal)


def _parse_hash(reading: FileReading, tree: Tree[Token]) -> ColumnMark:
    name = next((str(token) for token in select_tokens(tree.children)), None)
    return ColumnMark(reading.span(tree), name)


def _parse_evaluation(reading: FileReading, tree: Tree[Token]) -> Evaluation:
    return Evaluation(parse_expression(reading, select_trees(tree.children)[0]), reading.span(tree))


def _parse_unwind(reading: FileReading, tree: Tree[Token]) -> Evaluation:
    hint = "write a pattern with a match for each value; an `eval` has only one value"
    reading.error("eval-unwind", "`eval unwind` is not supported", tree, hint)
    return _parse_evaluation(reading, tree)


def _parse_aggregate(reading: FileReading, tree: Tree[Token]) -> Term:
    function = cast(AggregateFunction, str(select_tokens(select_trees(tree.children, "aggregator")[0].children)[0]))
    relation = parse_relation(reading, select_trees(tree.children)[1])
    if relation is None:
        reading.record_gap(tree)
        return Variable("_", reading.span(tree))
    return Aggregate(function, relation, reading.span(tree))


_TERM_PARSERS: Mapping[str, Callable[[FileReading, Tree[Token]], Term]] = {
    "variable": _parse_variable,
    "enum_literal": parse_enum_or_java_constant,
    "aliased_literal": parse_enum_or_java_constant,
    "constant": _parse_constant,
    "positive": _parse_positive,
    "hash": _parse_hash,
    "evaluation": _parse_evaluation,
    "unwind": _parse_unwind,
    "aggregate": _parse_aggregate,
}
