"""Parse the clauses of an environment: actions, effects, observations and drawings."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from typing import cast

from lark import Token, Tree

from envgraph.behaviour import (
    Action,
    Branch,
    Domain,
    DrawGraph,
    DrawGrid,
    DrawnLink,
    EachStep,
    End,
    Observation,
    ObserveAround,
    ObserveAttribute,
    ObserveFind,
    ObserveObject,
    ObserveRange,
    OnFind,
    OnRefused,
    OnReset,
    RuleCall,
    Token as DrawnToken,
)
from envgraph.code import walk_parts
from envgraph.errors import Diagnostic
from envgraph.lang.read._expression_parser import parse_expression, parse_expressions, parse_variable
from envgraph.lang.read._file_reading import FileReading, resolve_type, type_name_span
from envgraph.lang.read._query_conditions import parse_condition, parse_pattern_call
from envgraph.lang.read._query_reader import parse_suppressions
from envgraph.lang.syntax._parser import (
    number_of,
    qualified_name_of,
    select_tokens,
    select_trees,
    signed_number_of,
)
from envgraph.pattern import (
    AggregateFunction,
    EnumLiteral,
    Expression,
    Navigation,
    Negation,
    Parameter,
    PatternCall,
    Variable,
    rewrite_expressions,
)

_NOTHING = "nothing"
_SECOND_REWARD = "write one reward with the sum; for a reward in every step write `each step reward ..`"


# --- actions ---


def parse_action(reading: FileReading, tree: Tree[Token]) -> Action:
    """Parse `action name(parameters) = branches reward e else reward e`; report a second `reward` or `else`."""
    name = select_tokens(tree.children, "NAME")[0]
    domains = [part for group in select_trees(tree.children, "domains") for part in select_trees(group.children)]
    others = select_trees(tree.children, "other")
    reward = reading.first_or_report("`reward`", select_trees(tree.children, "reward"), _SECOND_REWARD)
    other_reward = reading.first_or_report("`else`", others)
    for other in others:
        if not select_tokens(other.children, "REWARD"):
            reading.error("missing-token", "`reward` is missing after `else`", other, "write `else reward ...`")
    branches = parse_branches(reading, select_trees(tree.children, "branches")[0])
    marks = zip(parse_suppressions(reading, tree, "key"), select_trees(tree.children, "annotation"), strict=True)
    keys = [(one, select_trees(part.children, "annotation_argument")) for one, part in marks if one.name == "key"]
    return Action(
        name=str(name),
        branches=branches,
        parameters=tuple((str(select_tokens(part.children)[0]), _parse_domain(reading, part)) for part in domains),
        reward=_parse_optional_expression(reading, reward),
        else_reward=_parse_optional_expression(reading, other_reward),
        keys=tuple(str(key) for one, _ in keys for key in one.arguments),
        span=reading.span(name),
        keys_span=keys[0][0].span if keys else None,
        key_spans=tuple(reading.span(part) for _, parts in keys for part in parts),
        parameter_spans=tuple(reading.span(select_tokens(part.children)[0]) for part in domains),
    )


def _parse_optional_expression(reading: FileReading, tree: Tree[Token] | None) -> Expression | None:
    """Parse the expression of a `reward`, `else` or `weight` clause; return None if the clause is missing."""
    return parse_expression(reading, select_trees(tree.children)[0]) if tree else None


def _parse_domain(reading: FileReading, tree: Tree[Token]) -> Domain:
    """Parse the domain of a parameter; store the name of an enum in `cls` too, which `with_enums` moves to `enum`."""
    part = select_trees(tree.children)[0]
    if part.data == "range":
        low, high = map(int, _parse_bounds(part))
        return Domain(low=low, high=high, span=reading.span(part))
    return Domain(cls=resolve_type(reading, part), span=type_name_span(reading, part))


def _parse_bounds(tree: Tree[Token]) -> tuple[int | float, int | float]:
    low, high = map(signed_number_of, select_trees(tree.children))
    return low, high


def parse_branches(reading: FileReading, tree: Tree[Token]) -> tuple[Branch, ...]:
    """Parse `a(x)` (probability 1), or `0.9: a(x) | 0.1: b(x)`; report a missing probability of several branches."""
    parts = select_trees(tree.children, "branch")
    branches: list[Branch] = []
    for part in parts:
        call = _parse_rule_call(reading, select_trees(part.children, "rule_call")[0])
        chances = select_trees(part.children, "probability")
        if not chances and len(parts) > 1:
            hint = f"write `0.5: {reading.text(part)}`"
            reading.error(
                "missing-probability",
                "this branch needs a probability, because there are several branches",
                part,
                hint,
            )
        branches.append(
            Branch(
                _parse_probability(reading, chances[0]) if chances else 1.0 if len(parts) == 1 else 0.0,
                call,
                reading.span(part),
                probability_span=reading.span(chances[0]) if chances else None,
            )
        )
    return tuple(branches)


def _parse_probability(reading: FileReading, tree: Tree[Token]) -> float | Expression:
    """Parse a probability: a number, a path such as `a.b`, or an expression in parentheses."""
    for part in select_trees(tree.children):
        return parse_path(reading, part) if part.data == "chain" else parse_expression(reading, part)
    return float(number_of(select_tokens(tree.children)[0]))


def _parse_rule_call(reading: FileReading, tree: Tree[Token]) -> RuleCall:
    name = select_trees(tree.children, "qualified_name")[0]
    rule = qualified_name_of(name)
    parts = select_trees(tree.children, "arguments")
    if not parts:
        written = f"{rule}()" if rule == _NOTHING else f"{rule}(...)"
        reading.error("missing-token", "missing `(`", name, f"write `{written}`")
    arguments = tuple(item for part in parts for item in parse_expressions(reading, part))
    return RuleCall(None if rule == _NOTHING else rule, arguments, reading.span(tree), rule_span=reading.span(name))


# --- effects ---


_Part = Tree[Token] | None


def _effect_parts(reading: FileReading, tree: Tree[Token]) -> tuple[_Part, _Part, _Part]:
    """Return the `reward`, the end of the episode and the `apply` of an effect clause. A missing part is None."""
    reward = reading.first_or_report("`reward`", select_trees(tree.children, "reward"), _SECOND_REWARD)
    end = reading.first_or_report("an end", select_trees(tree.children, "end"))
    return reward, end, reading.first_or_report("`apply`", select_trees(tree.children, "apply"))


def parse_each_step(reading: FileReading, tree: Tree[Token]) -> EachStep | None:
    """Parse `each step reward e apply branches`; report an empty clause, and report and ignore an end of episodes."""
    reward, end, apply = _effect_parts(reading, tree)
    if end:
        hint = "write `on find p(..) terminate ..`, with a pattern for the end"
        reading.error("misplaced-part", "`each step` cannot end the episode, which would last one step", end, hint)
    elif not (reward or apply):
        reading.error("empty-clause", "this clause does nothing", tree, "add `reward` or `apply`")
    return EachStep(
        _parse_optional_expression(reading, reward),
        _parse_apply_without_find(reading, apply) if apply else (),
        reading.span(tree),
    )


def _parse_apply_without_find(reading: FileReading, apply: Tree[Token]) -> tuple[Branch, ...]:
    """Parse the branches of an `apply` without `find`; report a `weight`, since there are no matches to sample."""
    for part in select_trees(apply.children, "weight"):
        hint = "write `on find p(x) apply ..`, or `on reset find p(x) apply ..`"
        reading.error(
            "misplaced-part",
            "`weight` needs matches to choose from, but this clause has no `find`",
            part,
            hint,
        )
    return parse_branches(reading, select_trees(apply.children, "branches")[0])


def _parse_apply(reading: FileReading, apply: Tree[Token]) -> tuple[tuple[Branch, ...], Expression | None]:
    """Parse the branches of an `apply`, and the weight expression for sampling a match (None if no weight is given)."""
    branches = parse_branches(reading, select_trees(apply.children, "branches")[0])
    return branches, _parse_optional_expression(reading, next(iter(select_trees(apply.children, "weight")), None))


def parse_on_find(reading: FileReading, tree: Tree[Token]) -> OnFind | None:
    """Parse `on find p(..) ...`; report an empty clause. Report an invalid condition and return None."""
    asked = select_trees(tree.children)[0]
    reward, end, apply = _effect_parts(reading, tree)
    if not (reward or end or apply):
        reading.error("empty-clause", "this clause does nothing", tree, "add `reward`, `terminate` or `apply`")
    condition = _parse_find_condition(reading, asked)
    branches, weight = _parse_apply(reading, apply) if apply else ((), None)
    if condition is None:
        return None
    return OnFind(
        condition,
        _parse_optional_expression(reading, reward),
        _parse_end(end) if end else None,
        branches,
        weight,
        reading.span(tree),
    )


def _parse_find_condition(reading: FileReading, tree: Tree[Token]) -> PatternCall | Negation | None:
    condition = parse_condition(reading, tree)
    if isinstance(condition, PatternCall):
        return condition
    if isinstance(condition, Negation) and isinstance(condition.relation, PatternCall):
        return condition
    if condition is not None:
        hint = "put the condition into a pattern, and write `on find` with the name of the pattern"
        called = re.fullmatch(r"(neg\s+)?([\w.]+\s*\([^()]*\))", reading.span(tree).text)
        if called is not None:
            written = f"`on {called[1] or ''}find {called[2]}`"
            hint = f"write {written} if this is a pattern; otherwise define a pattern for this condition"
        reading.error("wrong-condition", "`on` must be followed by `find` or `neg find`", tree, hint)
    reading.record_gap(tree)
    return None


def _parse_end(tree: Tree[Token]) -> End:
    word = str(tree.children[-1])
    return "truncation" if word == "truncate" else cast("End", word)


def parse_on_refused(reading: FileReading, tree: Tree[Token]) -> OnRefused:
    """Parse `on refused reward e terminate ..` or `on refused nothing()`; report an empty clause and an `apply`."""
    reward, end, apply = _effect_parts(reading, tree)
    hint = "write `reward`, `terminate` or `truncate`, or `on refused nothing()`"
    if apply:
        reading.error("misplaced-part", "`on refused` allows only `reward` and an end of the episode", apply, hint)
    elif not (reward or end or select_trees(tree.children, "nothing")):
        reading.error("empty-clause", "this clause does nothing", tree, hint)
    return OnRefused(_parse_optional_expression(reading, reward), _parse_end(end) if end else None, reading.span(tree))


def parse_on_reset(reading: FileReading, tree: Tree[Token]) -> OnReset | None:
    """Parse `on reset [find p(..)] apply branches`; report a `reward` and an end of the episode, which are ignored.

    Return None if `apply` is missing or the condition is invalid; both are reported.
    """
    reward, end, apply = _effect_parts(reading, tree)
    asked = [part for part in select_trees(tree.children) if part.data not in ("reward", "apply", "end")]
    condition = _parse_find_condition(reading, asked[0]) if asked else None
    for part in (reward, end):
        if part is not None:
            hint = "leave it out"
            reading.error(
                "misplaced-part",
                "`on reset` allows only `apply`, no reward and no end of the episode",
                part,
                hint,
            )
    if apply is None:
        if not (reward or end):
            reading.error("empty-clause", "this clause does nothing", tree, "write `on reset apply rule(...)`")
        return None
    if not asked:
        return OnReset(_parse_apply_without_find(reading, apply), span=reading.span(tree))
    branches, weight = _parse_apply(reading, apply)
    return OnReset(branches, condition, weight, reading.span(tree)) if condition else None


# --- observations ---


def parse_observations(reading: FileReading, tree: Tree[Token]) -> list[Observation]:
    """Parse an `observe ..` clause; return a copy of it for each literal of the enums in its `for`.

    The literals replace the name; those of the last enum vary fastest. Report a second name for objects, and put `_` in
    its place. A name of an unknown type, which is reported later, is the first one.
    """
    each = reading.first_or_report("`for`", select_trees(tree.children, "each_object"))
    names = [_parse_each_name(reading, part) for part in select_trees(each.children)] if each else []
    metamodel = reading.types.metamodel if reading.types else None
    enums, classes = (metamodel.enums, metamodel.classes) if metamodel else ({}, {})
    objects = sorted((one for one in names if one.type not in enums), key=lambda one: one.type in classes)
    if len(objects) > 1 and objects[0].type in classes:
        first, second, *_ = (f"`{one.name}`" for one in objects)
        message = f"`for` takes one name for objects, but {first} and {second} stand for objects"
        reading.add(Diagnostic("duplicate-part", message, objects[1].span, f"write `_` instead of {second}"))
    found = [_parse_observation(reading, tree, next(iter(objects), None))]
    for one in objects[1:]:
        found = [_with_term(found[0], one, Variable("_"))]
    for one in names:
        if enum := enums.get(one.type or ""):
            if Variable(one.name) not in walk_parts(tuple(found)):
                reading.add(Diagnostic("unused-name", f"`{one.name}` is not used", one.span, "leave it out"))
            terms = [EnumLiteral(one.type, literal) for literal in enum.literals]
            found = [_with_term(clause, one, term) for clause in found for term in terms]
    return found


def _with_term(clause: Observation, name: Parameter, term: EnumLiteral | Variable) -> Observation:
    """Return the clause with a term in place of a name."""
    old = Variable(name.name)
    return rewrite_expressions(clause, lambda one: replace(term, span=one.span) if one == old else one)


def _parse_observation(reading: FileReading, tree: Tree[Token], parameter: Parameter | None) -> Observation:
    """Parse an `observe ..` clause: of a window, a pattern, an object, a number in a range or an attribute."""
    visible = reading.first_or_report("`if`", select_trees(tree.children, "visible"))
    only = parse_pattern_call(reading, select_trees(visible.children)[0]) if visible else None
    span = reading.span(tree)
    if tree.data == "around":
        width, height = map(int, select_tokens(tree.children, "INT"))
        return ObserveAround(parse_variable(reading, select_tokens(tree.children)[0]), width, height, only, span)
    observed = select_trees(tree.children)[0]
    inner = select_trees(observed.children)
    match observed.data:
        case "holds" | "count":
            bounds = select_tokens(observed.children, "INT")
            up_to = int(bounds[0]) if bounds else None
            return ObserveFind(parse_pattern_call(reading, inner[0]), up_to, parameter, only, span)
        case "aggregate":
            function = cast(AggregateFunction, str(select_tokens(observed.children)[0]))
            low, high = _parse_bounds(inner[1])
            return ObserveFind(parse_pattern_call(reading, inner[0]), high, parameter, only, span, function, low)
        case "among":
            or_none = bool(select_trees(inner, "or_none"))
            type_ = resolve_type(reading, inner[1])
            path = parse_path(reading, inner[0])
            among_span = type_name_span(reading, inner[1])
            return ObserveObject(path, type_, or_none, parameter, only, span, among_span)
        case "within":
            return ObserveRange(parse_path(reading, inner[0]), *_parse_bounds(inner[1]), parameter, only, span)
    return ObserveAttribute(parse_path(reading, inner[0]), parameter, only, span)


def _parse_each_name(reading: FileReading, tree: Tree[Token]) -> Parameter:
    name, type_ = select_tokens(tree.children)[0], select_trees(tree.children)[0]
    span, type_span = reading.span(name), type_name_span(reading, type_)
    return Parameter(str(name), resolve_type(reading, type_), span=span, type_span=type_span)


def parse_path(reading: FileReading, tree: Tree[Token]) -> Expression:
    """Parse the path `a.b.c` into nested navigations from the variable `a`."""
    first, *features = select_tokens(tree.children)
    path: Expression = parse_variable(reading, first)
    start = reading.span(first)
    for feature in features:
        span = reading.span(feature)
        path = Navigation(path, str(feature), start.joined_with(span), feature_span=span)
    return path


# --- drawing ---


def parse_drawing(reading: FileReading, tree: Tree[Token]) -> DrawGrid | DrawGraph:
    """Parse `draw grid ..` or `draw graph ..`, with the tokens that are drawn on top of objects."""
    span = reading.span(tree)
    drawn = _parse_drawn_tokens(reading, select_trees(tree.children, "tokens"))
    if tree.data == "draw_graph":
        nodes, *links = (_parse_drawn_link(reading, part) for part in select_trees(tree.children, "drawn"))
        return DrawGraph(nodes.cls, nodes.label, drawn, tuple(links), span, nodes.cls_span, nodes.label_span)
    type_ = select_trees(tree.children, "type")[0]
    column, row = names = select_tokens(tree.children, "NAME")
    cls, cls_span = resolve_type(reading, type_), type_name_span(reading, type_)
    return DrawGrid(cls, str(column), str(row), drawn, span, cls_span, *reading.spans(names))


def _parse_drawn_link(reading: FileReading, tree: Tree[Token]) -> DrawnLink:
    type_, labels = select_trees(tree.children)[0], select_tokens(tree.children, "NAME")
    cls, cls_span = resolve_type(reading, type_), type_name_span(reading, type_)
    label, label_span = (str(labels[0]), reading.span(labels[0])) if labels else (None, None)
    return DrawnLink(cls, label, reading.span(tree), cls_span, label_span)


def _parse_drawn_tokens(reading: FileReading, groups: Iterable[Tree[Token]]) -> tuple[DrawnToken, ...]:
    return tuple(_parse_drawn_token(reading, part) for group in groups for part in select_trees(group.children))


def _parse_drawn_token(reading: FileReading, tree: Tree[Token]) -> DrawnToken:
    name = select_tokens(tree.children)[0]
    token = DrawnToken(str(name), parse_path(reading, select_trees(tree.children, "chain")[0]), span=reading.span(tree))
    for type_ in select_trees(tree.children, "type"):
        token = replace(token, cls=resolve_type(reading, type_), cls_span=type_name_span(reading, type_))
    for letter in select_tokens(tree.children, "STRING"):
        token = replace(token, letter=str(letter), letter_span=reading.span(letter))
    return token
