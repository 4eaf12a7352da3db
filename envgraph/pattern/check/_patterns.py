"""Run all checks of patterns, in an order in which consequences of an earlier error are not reported."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain

from envgraph.errors import (
    Diagnostic,
    Note,
    Severity,
    Span,
    did_you_mean,
    has_errors,
    name_hint,
    quote_with_article,
    sort_diagnostics,
)
from envgraph.metamodel import EnumType, Feature, Reference, Value
from envgraph.pattern._analysis import PatternAnalysis, calls_of, defined_feature_name, defined_features
from envgraph.pattern._enumerable_variables import Binding
from envgraph.pattern._expression_data import Constant, EnumLiteral, Expression, Variable
from envgraph.pattern._feature_paths import derived_feature_warning, is_derived, target_type
from envgraph.pattern._goals import ObjectType, StaticType
from envgraph.pattern._occurrences import (
    VariableUse,
    expressions_of,
    grouped_relations,
    positive_relations,
    terms_of,
    variable_occurrences,
)
from envgraph.pattern._query_data import (
    Body,
    Check,
    Comparison,
    Parameter,
    PathConstraint,
    Pattern,
    PatternCall,
    Relation,
)
from envgraph.pattern._type_inference import BodyTypes
from envgraph.pattern._types import is_assignable, is_subtype, least_common_supertypes, static_type, type_text
from envgraph.pattern.check._cartesian_products import check_connected
from envgraph.pattern.check._pattern_header import check_duplicates, check_header, is_too_long
from envgraph.pattern.check._pattern_recursion import check_recursion
from envgraph.pattern.check._relation_check import RelationCheck, RelationPlace
from envgraph.pattern.check._type_conflicts import TypeCheck, shared_classes
from envgraph.pattern.check._variable_usage import UsageCheck, unreferenced_message
from envgraph.pattern.expressions._expression_types import check_expression


def check_patterns(
    analysis: PatternAnalysis, unchanged: Collection[str] = ()
) -> tuple[list[Diagnostic], frozenset[str], frozenset[str]]:
    """Return all diagnostics of the new patterns of an analysis, in text order, and two sets of qualified names.

    The first set contains the patterns that cannot be added: those with errors, and those that call them or unknown
    names. The second contains the patterns without problems whose check needs only the pattern and its callees.

    Args:
        analysis: the patterns.
        unchanged: the second set of an earlier check, without patterns of which they or a callee have changed.
    """
    known = {name: entry.pattern for name, entry in analysis.known.items()}
    problems = list(check_duplicates(analysis.patterns, known))
    patterns = analysis.new_patterns
    broken: set[str] = set()
    clean: set[str] = set()
    unchanged, defined = frozenset(unchanged), defined_features(analysis.entries)
    for pattern in patterns:
        entry = analysis.entries[pattern.qualified_name]
        is_whole = not (pattern.mended or pattern.unknown)
        header = list(check_header(pattern, analysis.metamodel))
        if header or not is_whole or pattern.qualified_name not in unchanged:
            found = _PatternCheck(analysis, pattern, defined).problems(header)
        else:
            found = []
        if has_errors(found):
            broken.add(pattern.qualified_name)
        elif not found and is_whole and not entry.reads and defined_feature_name(pattern) is None:
            clean.add(pattern.qualified_name)
        problems.extend(found)
    for one in check_recursion(patterns, analysis.entries):
        if one.severity is Severity.ERROR:
            broken.update(map(str, one.subject))
        problems.append(one)
    unsound = analysis.with_callers(broken)
    if not unsound:
        # Only now does a type that is still unknown have no other cause; otherwise it would repeat another error.
        untyped = {pattern.qualified_name: list(_untyped_parameters(pattern, analysis)) for pattern in patterns}
        problems.extend(chain.from_iterable(untyped[one.qualified_name] for one in patterns if not one.mended))
        unsound = analysis.with_callers(name for name, found in untyped.items() if found)
    if not analysis.unknown:
        problems.extend(_unused_private_patterns(patterns, analysis))
    return sort_diagnostics(dict.fromkeys(problems)), unsound, frozenset(clean)


def _unused_private_patterns(patterns: Sequence[Pattern], analysis: PatternAnalysis) -> Iterator[Diagnostic]:
    called = {
        analysis.entries[pattern.qualified_name].calls.get(call.pattern)
        for pattern in patterns
        for body in pattern.bodies
        for call, _ in calls_of(body)
        if analysis.entries[pattern.qualified_name].calls.get(call.pattern) != pattern.qualified_name
    }
    for pattern in patterns:
        # Searches use patterns annotated as constraints.
        annotated = any(annotation.name == "Constraint" for annotation in pattern.annotations)
        if pattern.private and not annotated and pattern.qualified_name not in called:
            message = f"private pattern `{pattern.name}` is never called"
            hint = "remove `private` so that other files can call it, or remove the pattern"
            yield Diagnostic("unused-private-pattern", message, pattern.span, hint, Severity.WARNING)


def _untyped_parameters(pattern: Pattern, analysis: PatternAnalysis) -> Iterator[Diagnostic]:
    types = analysis.entries[pattern.qualified_name].types
    for parameter, type_ in zip(pattern.parameters, types, strict=True):
        if type_ is None:
            message = f"the type of parameter `{parameter.name}` is unknown"
            hint = f"write `{parameter.name} : Type`"
            yield Diagnostic("untyped-parameter", message, parameter.span or pattern.span, hint)


class _PatternCheck:
    """The check of one pattern: its header, its bodies, and the types of its parameters over all bodies."""

    def __init__(self, analysis: PatternAnalysis, pattern: Pattern, defined: Mapping[Feature, str]) -> None:
        self._analysis = analysis
        self._pattern = pattern
        self._metamodel = analysis.metamodel
        self._defined = defined

    def problems(self, header: Sequence[Diagnostic]) -> list[Diagnostic]:
        found = list(header)
        tainted = {p.name for p in self._pattern.parameters if p.type and static_type(p.type, self._metamodel) is None}
        names = Counter(p.name for p in self._pattern.parameters)
        tainted.update(name for name, count in names.items() if count > 1 or name.startswith("_"))
        tainted.update(self._pattern.unknown)
        bodies = [
            _BodyCheck(self._analysis, self._pattern, number, tainted)
            for number, body in enumerate(self._pattern.bodies)
            if body.constraints and not is_too_long(body)
        ]
        inside = [problem for body in bodies for problem in body.problems()]
        found.extend(_merge_unreferenced(inside, len(self._pattern.bodies)))
        if not has_errors(found):
            found.extend(_check_definition(self._pattern, self._analysis))
            reads = self._analysis.entries[self._pattern.qualified_name].reads
            found.extend(derived_feature_warning(r.feature, r.span) for r in reads if r.feature not in self._defined)
        if not has_errors(found) and not self._pattern.mended:
            for parameter in self._pattern.parameters:
                found.extend(self._check_parameter_type(parameter, bodies))
        return found

    def _check_parameter_type(self, parameter: Parameter, bodies: Sequence[_BodyCheck]) -> Iterator[Diagnostic]:
        span = parameter.span or self._pattern.span
        declared = static_type(parameter.type, self._metamodel)
        if declared is None:
            yield from self._check_inferred_type(parameter, bodies)
            return
        if any(body.types.type_of(parameter.name) == declared for body in bodies):
            return  # the body agrees with the declaration
        inferred = [type_ for body in bodies if (type_ := body.type_without_declaration(parameter.name)) is not None]
        above = least_common_supertypes(inferred, self._metamodel) if len(inferred) == len(bodies) and inferred else []
        if len(above) == 1 and above[0] != declared and is_subtype(above[0], declared, self._metamodel):
            narrower = type_text(above[0])
            first, second = quote_with_article(type_text(declared)), quote_with_article(narrower)
            message = f"`{parameter.name}` is declared {first}, but is always {second}"
            where, hint = parameter.type_span or span, f"write `{parameter.name} : {narrower}`"
            yield Diagnostic("less-specific-type", message, where, hint, Severity.WARNING)

    def _check_inferred_type(self, parameter: Parameter, bodies: Sequence[_BodyCheck]) -> Iterator[Diagnostic]:
        span = parameter.span or self._pattern.span
        for body in bodies:
            several = body.type_check.ambiguous_types(parameter.name)
            if several:
                names = " and ".join(f"`{type_text(type_)}`" for type_ in several)
                shared = shared_classes(several, body.types)
                hint = (
                    f"declare it, for example `{parameter.name} : {shared[0]}`"
                    if shared
                    else "use another variable for one of them: no object is of both types"
                )
                yield Diagnostic("ambiguous-type", f"`{parameter.name}` is both {names}", span, hint)
                return
        known = [type_ for body in bodies if (type_ := body.types.type_of(parameter.name)) is not None]
        above: list[StaticType] = least_common_supertypes(known, self._metamodel) if known else []
        names = ", ".join(f"`{type_text(type_)}`" for type_ in dict.fromkeys(known))
        if known and not above:
            message = f"the bodies give `{parameter.name}` types without a common supertype: {names}"
            hint = "use another parameter for one of them, or two patterns"
            yield Diagnostic("no-common-supertype", message, span, hint)
        elif len(above) > 1:
            names = " or ".join(f"`{type_text(type_)}`" for type_ in above)
            hint = f"declare its type: {names}"
            yield Diagnostic("ambiguous-type", f"the type of `{parameter.name}` could be {names}", span, hint)
        elif above:
            message = f"no type declared for `{parameter.name}`, inferred `{type_text(above[0])}`"
            hint = f"write `{parameter.name} : {type_text(above[0])}`"
            yield Diagnostic("undeclared-type", message, span, hint, Severity.WARNING)


def _check_definition(pattern: Pattern, analysis: PatternAnalysis) -> Iterator[Diagnostic]:
    """Report a pattern that cannot define the feature in its annotation, for example because it is not derived."""
    defines, entry = defined_feature_name(pattern), analysis.entries[pattern.qualified_name]
    if defines is None or not entry.types or None in entry.types:
        return
    (name, span), metamodel = defines, analysis.metamodel
    source, value = entry.types[0], entry.types[-1]
    if not isinstance(source, ObjectType) or value is None or len(entry.types) != 2:
        message = "a pattern that defines a feature must have two parameters: an object and a value of the feature"
        yield Diagnostic("query-feature", message, span, f"write `pattern {pattern.name}(this : Class, value)`")
        return
    feature = entry.defines
    if feature is None:
        hint = metamodel.left_out_reason(source.cls, name) or name_hint(name, metamodel.features(source.cls))
        message = f"`{source.cls}` has no feature `{name}`, so the annotation has no effect"
        yield Diagnostic("query-feature", message, span, hint, Severity.WARNING)
        return
    others = [one for one in analysis.entries.values() if one.defines is feature]
    early = [one.pattern for one in analysis.known.values() if any(r.feature is feature for r in one.reads)]
    type_ = target_type(feature)
    hint, notes = "", tuple[Note, ...]()
    if not is_derived(feature):
        message, hint = f"`{feature}` is not derived", "mark it `@derived` in the metamodel"
    elif isinstance(feature, Reference) and (feature.opposite or feature.containment):
        message = f"`{feature}` has an opposite or contains objects: a query cannot define it"
        hint = "define a reference that has no opposite and is no containment"
    elif not is_assignable(value, type_, metamodel):
        message = (
            f"`{feature}` has values of type `{type_text(type_)}`, but `{pattern.parameters[1].name}` has type "
            f"`{type_text(value)}`"
        )
        hint = f"declare `{pattern.parameters[1].name} : {type_text(type_)}`"
    elif others[0].pattern is not entry.pattern:
        message, hint = f"two queries define `{feature}`", "remove one of the annotations"
        notes = (Note("the first one is here", others[0].pattern.span),)
    elif early:
        message = f"`{early[0].qualified_name}` was added before, and reads `{feature}`"
        hint = f"add both patterns together, or first the pattern that defines `{feature}`"
    else:
        return
    yield Diagnostic("query-feature", message, span, hint, notes=notes)


def _merge_unreferenced(problems: Sequence[Diagnostic], bodies: int) -> Iterator[Diagnostic]:
    """Yield the problems. Report a parameter that is unreferenced in all bodies once, instead of once in each body."""
    missed = Counter(one.span for one in problems if one.code == "unreferenced-parameter" and one.span)
    reported: set[Span] = set()
    for one in problems:
        if bodies < 2 or one.span is None or missed[one.span] < bodies or one.code != "unreferenced-parameter":
            yield one
        elif one.span not in reported:
            reported.add(one.span)
            yield replace(one, message=unreferenced_message(str(one.subject[0])))


class _BodyCheck:
    """The check of one body.

    A variable involved in an error is tainted: other problems of the variable are not reported, because they may be
    consequences of the error.

    Attributes:
        types: the types of its variables.
        type_check: the check for type conflicts.
    """

    def __init__(self, analysis: PatternAnalysis, pattern: Pattern, number: int, tainted: set[str]) -> None:
        self._analysis = analysis
        self._pattern = pattern
        self._body: Body = pattern.bodies[number]
        self._location_phrase = f" in body {number + 1}" if len(pattern.bodies) > 1 else ""
        self.types: BodyTypes = analysis.body_types(pattern, self._body)
        self._tainted = set(tainted)
        self.type_check = TypeCheck(self.types, self._tainted)

    def problems(self) -> list[Diagnostic]:
        found: list[Diagnostic] = []
        sound = self._check_relations(found)
        conflicts = TypeCheck(self.types, self._tainted)
        found.extend(conflicts.check_conflicts())
        for name in conflicts.contradicted_names:
            self._tainted.update(self.types.reading.united_names(name))
        self._check_expressions(found)
        self.type_check = TypeCheck(self.types, self._tainted)
        usage = self._usage_check(self._pattern.mended or any(one.code == "wrong-arity" for one in found))
        for place in sound:
            found.extend(self.type_check.check_arguments(place))
            found.extend(usage.check_negation(place))
        for constraint in self._body.constraints:
            if isinstance(constraint, Comparison):
                wrong = list(self.type_check.check_comparison(constraint))
                found.extend(wrong)
                found.extend(usage.check_comparison(constraint))
                found.extend(() if has_errors(wrong) else _check_trivial(constraint))
        found.extend(usage.check_variables(errors=has_errors(found)))
        for place in sound:
            found.extend(usage.check_inputs(place))
        if not self._pattern.mended and not has_errors(found):
            few = {name for name in self.types.reading.names if isinstance(self.types.type_of(name), EnumType)}
            found.extend(check_connected(self.types.reading, self._pattern, few))
        return found

    def type_without_declaration(self, name: str) -> StaticType | None:
        """Return the type that the body gives a parameter if the declared type of the parameter is ignored, or None."""
        parameters = tuple(
            Parameter(p.name, None if p.name == name else p.type, p.direction) for p in self._pattern.parameters
        )
        callee = self._analysis.callee_lookup(self._pattern)
        return BodyTypes(self.types.reading, parameters, self._analysis.metamodel, callee).type_of(name)

    def _check_relations(self, found: list[Diagnostic]) -> list[RelationPlace]:
        check = RelationCheck(self._pattern, self.types, self._analysis.names)
        sound: list[RelationPlace] = []
        places = [RelationPlace(relation) for relation in positive_relations(self._body)]
        for number, (relation, aggregate) in enumerate(grouped_relations(self._body)):
            places.append(RelationPlace(relation, number, aggregate))
        for place in places:
            if isinstance(place.relation, PatternCall) and self.types.callee(place.relation.pattern) is None:
                self._taint(place.relation)
        for place in places:
            unknown = self._has_unknown_start(place.relation)
            problems = [] if unknown else check.problems(place)
            found.extend(problems)
            if unknown or has_errors(problems):
                self._taint(place.relation)
                self._taint_results(place.aggregate)
            else:
                sound.append(place)
        return sound

    def _has_unknown_start(self, relation: Relation) -> bool:
        """Return True if an error elsewhere leaves the source of a path, or the called pattern, unknown."""
        match relation:
            case PathConstraint("", _, Variable(name)) if self.types.type_of_term(relation.source) is None:
                return name in self._tainted
            case PatternCall(name):
                return self.types.callee(name) is None and name in self._analysis.unknown
        return False

    def _taint(self, relation: Relation) -> None:
        for term in terms_of(relation):
            if isinstance(term, Variable) and not term.is_anonymous:
                self._tainted.update(self.types.reading.united_names(term.name))

    def _check_expressions(self, found: list[Diagnostic]) -> None:
        roots = {
            self.types.reading.representative(name) for name in self._tainted if name in self.types.reading.occurrences
        }
        scope = {
            name: None if self.types.reading.representative(name) in roots else type_
            for name, type_ in self.types.types.items()
        }
        for expression, owner in expressions_of(self._body):
            found.extend(self._check_path_sources(expression, scope))
            type_, problems = check_expression(expression, scope, self._analysis.metamodel, bare_objects=False)
            found.extend(problems)
            if isinstance(owner, Check) and type_ is not None and type_text(type_) != "bool" and not problems:
                message = f"a check needs a truth value, not `{type_text(type_)}`"
                hint = "compare it: `check(.. == ..)`"
                found.append(Diagnostic("check-not-boolean", message, expression.span or owner.span, hint))
            if isinstance(expression, Constant) and expression.value is None:
                hint = "write `check(x.feature == none)` to test for a missing value"
                where = expression.span or owner.span
                found.append(Diagnostic("none-argument", "`none` is no value", where, hint))
            if problems:
                self._taint_results(owner)
                for occurrence in variable_occurrences(expression):
                    if occurrence.variable.name in self.types.reading.occurrences:
                        self._tainted.update(self.types.reading.united_names(occurrence.variable.name))

    def _check_path_sources(
        self, expression: Expression, scope: Mapping[str, StaticType | None]
    ) -> Iterator[Diagnostic]:
        """Yield an error for each path that starts at a variable of unknown type, and taint the variable."""
        for occurrence in variable_occurrences(expression):
            variable = occurrence.variable
            if occurrence.use is VariableUse.READ or variable.name not in self.types.reading.occurrences:
                continue  # `_` and unknown names are reported elsewhere
            group = self.types.reading.united_names(variable.name)
            if self._tainted.intersection(group):
                continue
            if scope[variable.name] is None:
                self._tainted.update(group)
                hint = did_you_mean(variable.name, [name for name in scope if name not in group])
                message = f"the class of `{variable.name}` is unknown"
                hint = hint or f"write `Class({variable.name})`"
                where = variable.span or expression.span
                yield Diagnostic("untyped-source", message, where, hint, subject=(variable.name,))

    def _taint_results(self, owner: object) -> None:
        """Taint (exclude from reports) the variables compared with `owner`, an eval or aggregate with an error."""
        for constraint in self._body.constraints:
            if isinstance(constraint, Comparison):
                for term, other in ((constraint.left, constraint.right), (constraint.right, constraint.left)):
                    if other is owner and isinstance(term, Variable) and not term.is_anonymous:
                        self._tainted.update(self.types.reading.united_names(term.name))

    def _usage_check(self, unclear: bool) -> UsageCheck:
        entry = self._analysis.entries[self._pattern.qualified_name]
        given = [self._pattern.parameters[position].name for position in entry.inputs]
        binding = Binding(self.types, self._pattern.parameters, given)
        return UsageCheck(self._pattern, self.types, binding, self._tainted, self._location_phrase, unclear)


def _check_trivial(comparison: Comparison) -> Iterator[Diagnostic]:
    left, right = comparison.left, comparison.right
    if any(isinstance(side, Constant) and side.value is None for side in (left, right)):
        return  # reported as an error of its own
    if isinstance(left, Constant | EnumLiteral) and isinstance(right, Constant | EnumLiteral):
        code, message, same = (
            "constant-comparison",
            "both sides are constants",
            _literal_value(left) == _literal_value(right),
        )
    elif isinstance(left, Variable) and isinstance(right, Variable) and left.name == right.name != "_":
        code, message, same = "self-comparison", f"`{left.name}` is compared with itself", True
    else:
        return
    always = same == (comparison.operator == "==")
    hint = "this always holds: leave it out" if always else "this never holds, so the body has no match"
    yield Diagnostic(code, message, comparison.span, hint, Severity.WARNING)


def _literal_value(term: Constant | EnumLiteral) -> Value | None:
    return term.value if isinstance(term, Constant) else term.literal
