"""Checks of rules, and their translation to plans."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, combinations, zip_longest
from typing import Final

from envgraph.code import dataclass
from envgraph.errors import (
    MAX_NESTING,
    Diagnostic,
    Severity,
    Span,
    duplicate_diagnostics,
    has_errors,
    name_hint,
    quote_with_article,
)
from envgraph.metamodel import Metamodel
from envgraph.pattern import (
    Aggregate,
    Constraint,
    CreateAction,
    Library,
    LibraryEntry,
    Modification,
    Negation,
    ObjectType,
    Parameter,
    PatternCall,
    RightSide,
    Rule,
    RuleBlock,
    RuleNode,
    StaticType,
    TypeConstraint,
    Variable,
    constraint_terms,
    static_type,
    type_hint,
)
from envgraph.rewrite._rule_plan import BlockPlan, RulePlan
from envgraph.rewrite.check._annotations import (
    annotation_span,
    check_annotations,
    check_duplicate_parameters,
    check_weight,
    without_generated_names,
)
from envgraph.rewrite.check._block_plan import build_plan
from envgraph.rewrite.check._lhs_and_nac import LhsLowering, LoweredBlock
from envgraph.rewrite.check._lhs_variables import all_names, is_named, own_variables
from envgraph.rewrite.check._rhs import read_changes
from envgraph.rewrite.check._rule_scope import RuleScope
from envgraph.rewrite.check._single_use import check_single_use

RULE_ANNOTATIONS = ("hom", "match", "priority", "semantics", "weight")

_LHS_WARNINGS: Final = (
    "always-different",
    "constant-comparison",
    "derived-feature",
    "never-matches",
    "self-comparison",
)
"""Codes of pattern warnings that are also reported for left-hand sides."""


@dataclass(frozen=True, slots=True)
class CheckedRule:
    """A checked rule: its diagnostics, and its plan if it has no errors.

    Attributes:
        entries: its left-hand sides as patterns for a library; empty if there are errors.
        plan: the plan of the rule; None if there are errors.
    """

    rule: Rule
    entries: tuple[LibraryEntry, ...]
    plan: RulePlan | None
    problems: tuple[Diagnostic, ...]


def check_rule(rule: Rule, library: Library) -> CheckedRule:
    """Check a rule and return its diagnostics, with its plan and patterns if it has no errors."""
    problems = [*_check_header(rule), *_check_names(rule), *_check_types(rule, library)]
    if _nesting_depth(rule) > MAX_NESTING:
        hint = "move a part of the rule into a pattern, and call it with `find`"
        message = f"blocks are nested more than {MAX_NESTING} levels deep"
        return CheckedRule(rule, (), None, (*problems, Diagnostic("nested-too-deeply", message, rule.span, hint)))
    called = _called_types(rule, library)
    lowering = LhsLowering(rule, library, _untyped_variables(rule, called, library.metamodel))
    lowered = lowering.lower(_created_outputs(rule))
    problems += [_with_class_hint(one, called) for one in lowering.problems]
    checked = library.analyse(*lowering.patterns)
    problems += _lhs_problems(checked.problems, lowering, called, problems)
    known = None
    if not has_errors(problems) and not checked.invalid_names:
        known = {entry.pattern.qualified_name: entry for entry in checked.entries}
    outside = _block_names(rule.blocks)
    scope = RuleScope(library.metamodel, problems, block_names=outside, derived_features=library.definitions)
    for parameter in rule.parameters:
        if parameter.type:
            scope.declared[parameter.name] = {parameter.type}
    changes = read_changes(rule, lowered, scope, _variable_types(lowered, known))
    body = build_plan(changes, lambda block: _variable_types(block, known))
    left = known[lowered.pattern.qualified_name] if known else None
    inputs = tuple(lowered.own_variables[position] for position in left.inputs) if left else ()
    outputs = _output_slots(rule, changes.scope, inputs)
    _check_homomorphic(rule, changes.scope, problems)
    if left is not None and not has_errors(problems):
        problems += _check_effect(rule, lowered, body)
        problems += check_single_use(rule)
    if has_errors(problems) or left is None:
        return CheckedRule(rule, (), None, tuple(problems))
    plan = RulePlan(
        name=rule.qualified_name,
        weight=float(rule.weight),
        priority=rule.priority,
        parameters=tuple(parameter.name for parameter in rule.parameters),
        variables=lowered.own_variables,
        types=left.known_types,
        inputs=inputs,
        outputs=outputs,
        is_spo=rule.semantics == "spo",
        body=body,
        exact_class=_exact_class(lowered),
        span=rule.span,
    )
    return CheckedRule(rule, checked.entries, plan, tuple(problems))


def _lhs_problems(
    problems: Sequence[Diagnostic],
    lowering: LhsLowering,
    called: Mapping[str, StaticType | None],
    reported: Sequence[Diagnostic],
) -> list[Diagnostic]:
    """Return the errors and some warnings of the library (`problems`) about left-hand sides, without repetitions of
    `reported`.

    A diagnostic is a repetition if its span has a diagnostic already, or if it says that an untyped parameter is
    unreferenced. If all are repetitions and no error is reported yet, all are returned.
    """
    places = {problem.span for problem in reported if problem.span}

    def repeats_earlier_problem(problem: Diagnostic) -> bool:
        unreferenced = problem.code == "unreferenced-parameter"
        return problem.span in places or (unreferenced and not lowering.untyped.isdisjoint(problem.subject))

    found = [
        without_generated_names(one)
        for one in problems
        if one.severity is Severity.ERROR or (one.code in _LHS_WARNINGS and one.span)
    ]
    fresh = [_with_class_hint(one, called) for one in found if not repeats_earlier_problem(one)]
    return fresh if fresh or has_errors(reported) else found


def _untyped_variables(rule: Rule, called: Mapping[str, StaticType | None], metamodel: Metamodel) -> Iterator[str]:
    """Yield variables whose type is unknown because of a mistake in their declaration or in a pattern call."""
    yield from (name for name, type_ in called.items() if type_ is None)
    declared: list[Parameter | RuleNode] = [*rule.parameters, *_lhs_nodes(rule)]
    for one in declared:
        if one.type and static_type(one.type, metamodel) is None:
            yield one.name


def _called_types(rule: Rule, library: Library) -> dict[str, StaticType | None]:
    """Return the types that pattern calls anywhere in a rule imply for variables; None where a call has a mistake."""
    found: dict[str, StaticType | None] = {}
    parts: list[Rule | RuleBlock] = [rule]
    for part in parts:  # the list grows inside the loop
        parts += part.blocks
        for call in chain.from_iterable(map(_pattern_calls, part.left.constraints)):
            pattern = library.resolve(call.pattern, rule.package)
            sound = pattern is not None and len(pattern.parameters) == len(call.arguments)
            types = library.parameter_types(pattern.qualified_name) if pattern and sound else ()
            for term, type_ in zip_longest(call.arguments, types):
                if isinstance(term, Variable) and (type_ is None or term.name not in found):
                    found[term.name] = type_
    return found


def _pattern_calls(constraint: Constraint) -> Iterator[PatternCall]:
    """Yield the pattern calls in a constraint, including those under `neg` and in aggregates."""
    relations = [constraint.relation if isinstance(constraint, Negation) else constraint]
    relations += [term.over for term in constraint_terms(constraint) if isinstance(term, Aggregate)]
    yield from (relation for relation in relations if isinstance(relation, PatternCall))


def _with_class_hint(problem: Diagnostic, called: Mapping[str, StaticType | None]) -> Diagnostic:
    """Return a diagnostic, with the class as hint if it is about an untyped variable and a pattern call implies one."""
    if problem.code not in ("untyped-source", "untyped-variable"):
        return problem
    name = str(problem.subject[0])
    type_ = called.get(name)
    return replace(problem, hint=f"write `{name} : {type_.cls}`") if isinstance(type_, ObjectType) else problem


def _lhs_nodes(part: Rule | RuleBlock) -> Iterator[RuleNode]:
    """Yield the nodes in the left-hand sides of a rule and of its blocks."""
    yield from part.left.nodes
    for block in part.blocks:
        yield from _lhs_nodes(block)


def _nesting_depth(rule: Rule) -> int:
    levels = 0
    level = rule.blocks
    while level:
        levels += 1
        level = tuple(inner for block in level for inner in block.blocks)
    return levels


def _variable_types(block: LoweredBlock, known: Mapping[str, LibraryEntry] | None) -> Mapping[str, StaticType | None]:
    """Return the types of the variables in scope, as inferred by the library for the patterns in `known`.

    If `known` is None, because there are errors, return the types that the left-hand sides alone imply.
    """
    if known is None:
        return block.types
    found = known[block.pattern.qualified_name].types
    return {
        **block.types,
        **dict(zip((*block.inherited_variables, *block.own_variables), found, strict=True)),
    }


def _created_outputs(rule: Rule) -> set[str]:
    """Return the `out` parameters that the right-hand side creates, which are therefore not part of the match."""
    outputs = {p.name for p in rule.parameters if p.direction == "out"}
    left = {node.name for node in rule.left.nodes} | {e for edge in rule.left.edges for e in (edge.source, edge.target)}
    return {name for name in _created_names(rule.right) if name in outputs and name not in left}


def _created_names(right: RightSide | Modification | None) -> list[str]:
    """Return the names of nodes with a class in a right-hand side: new objects, and in `rhs` also retyped objects."""
    match right:
        case Modification(actions):
            nodes = [node for action in actions if isinstance(action, CreateAction) for node in action.nodes]
        case RightSide():
            nodes = list(right.nodes)
        case None:
            nodes = []
    return [node.name for node in nodes if node.type]


def _exact_class(lowered: LoweredBlock) -> str | None:
    constraints = lowered.pattern.bodies[0].constraints
    if len(lowered.own_variables) == 1 and len(constraints) == 1 and not lowered.nested:
        match constraints[0]:
            case TypeConstraint(cls, Variable(), True):
                return cls
    return None


# --- the header


def _check_header(rule: Rule) -> Iterable[Diagnostic]:
    yield from check_weight(rule.weight, rule.annotations, rule.span)
    yield from check_annotations(rule.annotations, RULE_ANNOTATIONS)
    if rule.semantics not in ("dpo", "spo"):
        span = annotation_span(rule.annotations, "semantics") or rule.span
        hint = "write `@semantics(dpo)` or `@semantics(spo)`"
        yield Diagnostic("unknown-semantics", f"unknown semantics `{rule.semantics}`", span, hint)


def _check_names(rule: Rule) -> Iterable[Diagnostic]:
    yield from check_duplicate_parameters(rule.parameters)
    for parameter in rule.parameters:
        if not is_named(parameter.name):
            hint = "choose a name without a leading `_`: such a name stands for any value and cannot be used again"
            message = f"`{parameter.name}` cannot name a parameter"
            yield Diagnostic("bad-name", message, parameter.span, hint)
    named = ((one.name, one.span) for one in rule.left.nodes if one.type is not None and is_named(one.name))
    hint = "choose another name; for the same object write `{}` without a class"
    yield from duplicate_diagnostics(named, "`{}` is declared twice", hint)


def _check_types(rule: Rule, library: Library) -> Iterable[Diagnostic]:
    """Report unknown types of parameters. Types in the left-hand side are checked together with it."""
    for parameter in rule.parameters:
        if parameter.type and static_type(parameter.type, library.metamodel) is None:
            hint = type_hint(parameter.type, library.metamodel)
            yield Diagnostic(
                "unknown-type",
                f"unknown type `{parameter.type}`",
                parameter.type_span or parameter.span,
                hint,
            )


# --- checks of the whole rule


def _output_slots(rule: Rule, scope: RuleScope, unbound: Sequence[str]) -> tuple[tuple[str, int], ...]:
    """Return name and slot of the `out` parameters. Report those that are deleted, get no value or get a wrong class.

    `unbound` contains the variables that only a caller can bind; they give an `out` parameter no value.
    """
    found: list[tuple[str, int]] = []
    mentioned = all_names(rule.left)
    for parameter in rule.parameters:
        name = parameter.name
        if parameter.direction != "out":
            continue
        if name in scope.deleted:
            message = f"`{name}` is deleted by this rule, so it cannot be an `out` parameter"
            scope.error("deleted-variable", message, parameter.span, "remove the deletion, or the parameter")
        elif name in scope.created:
            found.append((name, scope.slot_of(name)))
            _check_created_output(parameter, scope)
        elif name not in mentioned or name in unbound:
            hint = "bind it in the left side, or create it in the right side"
            scope.error("unbound-output", f"`out` parameter `{name}` gets no value", parameter.span, hint)
        else:
            found.append((name, scope.slot_of(name)))
    return tuple(found)


def _check_created_output(parameter: Parameter, scope: RuleScope) -> None:
    cls = scope.created[parameter.name]
    above = parameter.type
    if above and above in scope.metamodel.classes and not scope.metamodel.is_a(cls, above):
        message = f"`{parameter.name}` is declared as `{above}` and created as `{cls}`"
        scope.error("wrong-type", message, parameter.span, f"write `out {parameter.name} : {cls}`")


def _check_effect(rule: Rule, lowered: LoweredBlock, plan: BlockPlan) -> Iterable[Diagnostic]:
    """Warn about a rule without `out` parameters, or a block, that has no right-hand side and no nested `forall`."""
    block = lowered.block
    if block is None and any(parameter.direction == "out" for parameter in rule.parameters):
        return
    if plan.nested or plan.operations or (rule.right if block is None else block.right) is not None:
        for inner, inner_plan in zip(lowered.nested, plan.nested, strict=True):
            yield from _check_effect(rule, inner, inner_plan)
    elif block is None:
        message = f"rule `{rule.name}` has no right side: it changes nothing"
        hint = "add `modify { .. }`, which may be empty, or declare a `pattern` if you only search for matches"
        yield Diagnostic("no-right-side", message, rule.span, hint, Severity.WARNING)
    else:
        message = f"this `{block.kind}` block has no right side: it changes nothing"
        hint = "add `modify { .. }`" + ("; to state a condition, write `require`" if block.kind == "forall+" else "")
        yield Diagnostic("no-right-side", message, block.span, hint, Severity.WARNING)


def _check_homomorphic(rule: Rule, scope: RuleScope, problems: list[Diagnostic]) -> None:
    """Report names in `@hom` that are not object variables of left-hand sides, and groups that have no effect."""
    nested = _block_variables(rule.blocks)
    for group, places in zip_longest(rule.homomorphic, rule.homomorphic_spans, fillvalue=()):
        spans = dict(zip(group, places, strict=False))
        for name in dict.fromkeys(group):
            span = spans.get(name) or annotation_span(rule.annotations, "hom") or rule.span
            if name not in scope.types and name not in nested:
                hint = name_hint(name, [*scope.types, *nested])
                message = f"the left side has no variable `{name}`"
                problems.append(Diagnostic("unknown-variable", message, span, hint))
            elif scope.types.get(name) is not None and not isinstance(scope.types[name], ObjectType):
                message = f"`{name}` is a data value, but `@hom` is about objects"
                problems.append(Diagnostic("not-an-object", message, span, f"leave `{name}` out of `@hom`"))
        problems.extend(_check_hom_group(group, spans, scope))


def _block_names(blocks: Iterable[RuleBlock]) -> dict[str, str]:
    """Return the variables and created objects of blocks and their nested blocks, each with the kind of its block."""
    found: dict[str, str] = {}
    for block in blocks:
        names = [*own_variables(block.left, ()), *_created_names(block.right)]
        for name, kind in (*dict.fromkeys(names, block.kind).items(), *_block_names(block.blocks).items()):
            found.setdefault(name, kind)
    return found


def _block_variables(blocks: Iterable[RuleBlock]) -> dict[str, None]:
    """Return the variables in the left-hand sides of blocks and of their nested blocks."""
    found: dict[str, None] = {}
    for block in blocks:
        found.update(dict.fromkeys(own_variables(block.left, ())))
        found.update(_block_variables(block.blocks))
    return found


def _check_hom_group(group: Sequence[str], spans: Mapping[str, Span], scope: RuleScope) -> Iterable[Diagnostic]:
    """Report a `@hom` group with fewer than two names. Warn about pairs whose classes share no objects."""
    if len(set(group)) < 2:
        message = "`@hom` needs two or more different variables"
        hint = "write `@hom(a, b)`, or `@match(homomorphic)` for all names"
        yield Diagnostic("bad-annotation", message, spans.get(group[0]) if group else None, hint)
    for one, other in combinations(dict.fromkeys(group), 2):
        left, right = scope.class_before(one), scope.class_before(other)
        if left and right and not scope.metamodel.may_overlap(left, right):
            classes = f"{quote_with_article(left)} and {quote_with_article(right)}"
            message = f"`{one}` and `{other}` are never one object, because no object is both {classes}"
            hint = f"leave `{other}` out"
            yield Diagnostic("useless-annotation", message, spans.get(other), hint, Severity.WARNING)
