"""Parse the conditions of a query body: relations, comparisons, checks and their terms."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Literal, cast

from lark import Token, Tree

from envgraph.errors import did_you_mean
from envgraph.lang.read._expressions import (
    constant_of,
    dotted_literal,
    expression_of,
    literal_of,
    variable_of,
)
from envgraph.lang.read._java import JAVA_TYPES
from envgraph.lang.read._reading import Reading, type_of, type_span_of
from envgraph.lang.syntax._parsing import qualified_name_of, tokens, trees
from envgraph.pattern import (
    Aggregate,
    Binary,
    Check,
    Closure,
    Comparison,
    Constant,
    Constraint,
    EnumLiteral,
    Evaluation,
    Expression,
    Hash,
    Navigation,
    Negation,
    PathConstraint,
    PatternCall,
    Relation,
    Term,
    TypeConstraint,
    Variable,
)

AggregateFunction = Literal["count", "sum", "min", "max", "avg"]


def conditions_of(reading: Reading, statements: Iterable[Tree[Token]]) -> tuple[Constraint, ...]:
    """Parse several conditions; leave out each invalid condition, which is reported and recorded as a gap."""
    read = []
    for statement in statements:
        condition = condition_of(reading, statement)
        if condition is None:
            reading.gap(statement)
        else:
            read.append(condition)
    return tuple(read)


def condition_of(reading: Reading, tree: Tree[Token]) -> Constraint | None:
    """Parse one condition; report an invalid condition and return None."""
    match tree.data:
        case "negation":
            relation = relation_of(reading, trees(tree.children)[0])
            return Negation(relation, reading.span(tree)) if relation else None
        case "check":
            return Check(_in_brackets(reading, trees(tree.children)[0]), reading.span(tree))
        case "comparison":
            return _comparison(reading, tree)
    return relation_of(reading, tree)


def _in_brackets(reading: Reading, tree: Tree[Token]) -> Expression:
    """Parse the expression of `check(..)`; the span of the expression leaves out the parentheses."""
    return expression_of(reading, trees(tree.children)[0] if tree.data == "group" else tree)


def relation_of(reading: Reading, tree: Tree[Token]) -> Relation | None:
    """Parse `Type(x)`, `Type.f(x, y)` or `find p(..)`; return None if it is invalid, which is then reported."""
    match tree.data:
        case "pattern_call":
            return pattern_call_of(reading, tree)
        case "path_constraint":
            return _path_constraint(reading, tree)
    return _type_constraint(reading, tree)


def pattern_call_of(reading: Reading, tree: Tree[Token]) -> PatternCall:
    """Parse `find p(..)` and record `p` as used; replace the name of an imported pattern by its qualified name."""
    name = trees(tree.children, "qualified_name")[0]
    pattern = qualified_name_of(name)
    reading.used.add(pattern)
    return PatternCall(
        reading.imported.get(pattern, pattern),
        _terms(reading, tree),
        closure_of(tree),
        reading.span(tree),
        pattern_span=reading.span(name),
    )


def closure_of(tree: Tree[Token]) -> Closure:
    """Parse the transitive closure sign `+` or `*` of a relation or arrow; return `Closure.ONCE` if it has none."""
    return next((Closure(str(part.children[0])) for part in trees(tree.children, "closure")), Closure.ONCE)


def java_type_of(reading: Reading, tree: Tree[Token]) -> str | None:
    """Parse `java Integer` or `java java.lang.Integer` into a data type; report an unknown class and return None."""
    name = qualified_name_of(trees(tree.children)[0])
    simple = name.rpartition(".")[2]
    reading.used.add(simple)
    if simple not in JAVA_TYPES:
        hint = did_you_mean(simple, JAVA_TYPES) or "the data types are int, float, bool and string"
        reading.error("unknown-type", f"`{name}` is not a data type", trees(tree.children)[0], hint)
    return JAVA_TYPES.get(simple)


def _terms(reading: Reading, tree: Tree[Token]) -> tuple[Term, ...]:
    return tuple(
        term_of(reading, item) for part in trees(tree.children, "terms") for item in trees(part.children)
    )


# --- relations ---


def _type_constraint(reading: Reading, tree: Tree[Token]) -> Relation | None:
    head = trees(tree.children)[0]
    terms = _terms(reading, tree)
    if head.data == "java_type":
        name, span = java_type_of(reading, head), reading.span(trees(head.children)[0])
    else:
        alias, name = (str(part) if part else None for part in head.children)
        if alias and alias not in reading.aliases and len(terms) == 2:
            hint = f"write a path with `.`: `{alias}.{name}(..)`"
            reading.error(
                "unknown-alias", f"no import has the alias `{alias}`", tokens(head.children)[0], hint
            )
            return None
        name, span = type_of(reading, head), type_span_of(reading, head)
    if len(terms) != 1:
        hint = f"write `find {reading.text(tree)}` to call a pattern" if terms else f"write `{name}(x)`"
        reading.error("wrong-arity", f"a type constraint takes 1 argument, not {len(terms)}", tree, hint)
        return None
    return TypeConstraint(name, terms[0], span=reading.span(tree), type_span=span) if name else None


def _path_constraint(reading: Reading, tree: Tree[Token]) -> PathConstraint | None:
    head, path = trees(tree.children)[:2]
    terms = _terms(reading, tree)
    type_ = type_of(reading, head)
    features = tokens(path.children)
    if len(terms) != 2 and reading.parsed.mended(tree):
        reading.gap(tree)
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
        closure_of(tree),
        reading.span(tree),
        type_span=type_span_of(reading, head),
        feature_spans=reading.spans(features),
    )


# --- comparisons ---


def _comparison(reading: Reading, tree: Tree[Token]) -> Comparison | Check | None:
    left = term_of(reading, trees(tree.children)[0])
    right = _right_side(reading, trees(tree.children)[2])
    comparator = tokens(trees(tree.children, "comparator")[0].children)[0]
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


def _right_side(reading: Reading, tree: Tree[Token]) -> Term:
    if tree.data == "bare_call":
        call = pattern_call_of(reading, trees(tree.children)[0])
        hint = f"write `count {reading.text(tree)}` for the number of its matches"
        reading.error("misplaced-call", "the call of a pattern is not a value", tree, hint)
        return Aggregate("count", call, reading.span(tree))
    if tree.data != "bare_arithmetic":
        return term_of(reading, tree)
    literal = None
    if not trees(tree.children):
        owner, _, feature = tokens(tree.children)
        literal = dotted_literal(reading, str(owner), feature, tree)
    if literal is not None:
        return literal
    hint = f"write `eval({reading.text(tree)})`"
    reading.error("misplaced-expression", "an expression is allowed only in an `eval`", tree, hint)
    return Evaluation(_bare_expression(reading, tree), reading.span(tree))


def _bare_expression(reading: Reading, tree: Tree[Token]) -> Expression:
    parts = trees(tree.children)
    if not parts:
        owner, _, feature = tokens(tree.children)
        return Navigation(
            variable_of(reading, owner), str(feature), reading.span(tree), reading.span(feature)
        )
    left, right = term_of(reading, parts[0]), expression_of(reading, parts[1])
    if not isinstance(left, Variable | Constant | EnumLiteral):
        return right
    return Binary(str(tokens(tree.children)[0]), left, right, reading.span(tree))


# --- terms ---


def term_of(reading: Reading, tree: Tree[Token]) -> Term:
    """Parse a term: a variable, constant, enum literal, evaluation or aggregate; replace an invalid term by `_`."""
    return _TERMS[tree.data](reading, tree)


def _variable(reading: Reading, tree: Tree[Token]) -> Variable:
    name = tokens(tree.children)[0]
    if name == "null":
        return _no_value(reading, tree, "`null` is not a value, so nothing matches it")
    return variable_of(reading, name)


def _no_value(reading: Reading, tree: Tree[Token], message: str) -> Variable:
    hint = "write `neg Type.feature(x, _)` for a feature without a value"
    reading.error("none-in-query", message, tree, hint)
    reading.gap(tree)
    return Variable("_", reading.span(tree))


def _constant(reading: Reading, tree: Tree[Token]) -> Term:
    literal = trees(tree.children)[0]
    if literal.data == "none":
        return _no_value(reading, tree, "`none` means that there is no value, so nothing matches it")
    return literal_of(reading, literal, next(iter(tokens(tree.children)), None))


def _positive(reading: Reading, tree: Tree[Token]) -> Constant:
    literal = trees(tree.children)[0]
    if literal.data != "number":
        reading.error("unexpected-sign", "only a number can have a sign", tree, "remove the `+`")
    return literal_of(reading, literal)


def _hash(reading: Reading, tree: Tree[Token]) -> Hash:
    name = next((str(token) for token in tokens(tree.children)), None)
    return Hash(reading.span(tree), name)


def _evaluation(reading: Reading, tree: Tree[Token]) -> Evaluation:
    return Evaluation(expression_of(reading, trees(tree.children)[0]), reading.span(tree))


def _unwind(reading: Reading, tree: Tree[Token]) -> Evaluation:
    hint = "write a pattern with a match for each value; an `eval` has only one value"
    reading.error("eval-unwind", "`eval unwind` is not supported", tree, hint)
    return _evaluation(reading, tree)


def _aggregate(reading: Reading, tree: Tree[Token]) -> Term:
    function = cast(AggregateFunction, str(tokens(trees(tree.children, "aggregator")[0].children)[0]))
    relation = relation_of(reading, trees(tree.children)[1])
    if relation is None:
        reading.gap(tree)
        return Variable("_", reading.span(tree))
    return Aggregate(function, relation, reading.span(tree))


_TERMS: Mapping[str, Callable[[Reading, Tree[Token]], Term]] = {
    "variable": _variable,
    "enum_literal": constant_of,
    "aliased_literal": constant_of,
    "constant": _constant,
    "positive": _positive,
    "hash": _hash,
    "evaluation": _evaluation,
    "unwind": _unwind,
    "aggregate": _aggregate,
}
