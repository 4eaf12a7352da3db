"""Checks of units, and the translation of their conditions to patterns."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field, replace

from envgraph.code import dataclass
from envgraph.errors import (
    MAX_NESTING,
    Diagnostic,
    Severity,
    Span,
    count_with_noun,
    did_you_mean,
    has_errors,
    list_names,
    quote_with_article,
)
from envgraph.metamodel import Metamodel, Scalar
from envgraph.pattern import (
    Alap,
    Applicable,
    AtomicStep,
    Body,
    Check,
    Constant,
    Constraint,
    EnumLiteral,
    Evaluation,
    Expression,
    IfStep,
    Library,
    LibraryEntry,
    Negation,
    ObjectType,
    Parameter,
    Pattern,
    Repeat,
    StaticType,
    Step,
    StepSequence as Steps,
    TryStep,
    TypeConstraint,
    Unit,
    UnitCall,
    UnitChoice,
    Variable,
    check_expression,
    may_be_assignable,
    static_type,
    type_hint,
    type_text,
    value_hint,
)
from envgraph.rewrite._signatures import CallParameter, Signature, SignatureTable
from envgraph.rewrite.check._annotations import (
    check_annotations,
    check_duplicate_parameters,
    check_weight,
    without_generated_names,
)
from envgraph.rewrite.check._lhs_variables import is_named, parameter_for, variable_occurrences

UNIT_ANNOTATIONS = ("priority", "weight")
UnitVariableTypes = dict[str, StaticType | None]


@dataclass(frozen=True, slots=True)
class ConditionPattern:
    """A condition of a unit: a pattern, and variables of the unit as its arguments. If `negated`, it must not match."""

    pattern: Pattern
    arguments: tuple[str, ...]
    negated: bool


@dataclass(slots=True)
class CheckedUnit:
    """A checked unit: its diagnostics, and the meaning of its names.

    Attributes:
        calls: callee of each call, by the `id` of the step; calls of unknown names are missing.
        conditions: the pattern conditions of each `if` and call, by the `id` of the step and the condition's index.
        applicability_tests: for each `if` that tests if a rule is applicable: this condition and the rule, by the
            `id` of the step.
        types: types of the parameters.
        is_complete: False if a name is unknown because its definition contains errors.
        entries: the patterns of the conditions without errors, for a library.
    """

    unit: Unit
    problems: list[Diagnostic] = field(default_factory=list)
    calls: dict[int, Signature] = field(default_factory=dict)
    conditions: dict[tuple[int, int], ConditionPattern] = field(default_factory=dict)
    applicability_tests: dict[int, tuple[Applicable, Signature]] = field(default_factory=dict)
    types: UnitVariableTypes = field(default_factory=dict)
    is_complete: bool = True
    entries: list[LibraryEntry] = field(default_factory=list)

    @property
    def is_sound(self) -> bool:
        """Return True if the unit has no errors and all its names are known."""
        return self.is_complete and not has_errors(self.problems)


def check_unit(unit: Unit, directory: SignatureTable, library: Library) -> CheckedUnit:
    """Check a unit; return its errors and warnings, and the definitions that its names refer to."""
    checker = _UnitChecker(unit, directory, library)
    checker.check()
    return checker.result


def unit_signature(unit: Unit, metamodel: Metamodel) -> Signature:
    """Return the signature of a unit; its `out` parameters are not required."""
    return Signature(
        unit.qualified_name,
        "unit",
        unit.package,
        tuple(
            CallParameter(one.name, static_type(one.type, metamodel), one.direction == "out", one.direction != "out")
            for one in unit.parameters
        ),
        unit.weight,
        unit.priority,
    )


def nesting_depth(step: Step) -> int:
    """Return the number of levels of nested steps. The count uses no recursion, so no input can exhaust the stack."""
    levels = 0
    level = [step]
    while level:
        levels += 1
        level = [inner for outer in level for inner in inner_steps(outer)]
    return levels


def all_steps(unit: Unit) -> list[Step]:
    """Return all steps of a unit, outer steps before inner ones."""
    steps: list[Step] = [unit.body]
    for step in steps:
        steps += inner_steps(step)
    return steps


def inner_steps(step: Step) -> tuple[Step, ...]:
    """Return the steps directly inside a step."""
    match step:
        case Steps(steps):
            return steps
        case UnitChoice(alternatives):
            return alternatives
        case Alap(body) | AtomicStep(body) | Repeat(_, _, body):
            return (body,)
        case TryStep(body, otherwise) | IfStep(_, body, otherwise):
            return (body,) if otherwise is None else (body, otherwise)
        case UnitCall():
            return ()


def as_applicability_test(condition: Constraint | Applicable) -> Applicable | None:
    """Return a condition such as `burn(x)` or `neg burn(x)` as a test if a rule is applicable; None for other ones."""
    match condition:
        case Applicable():
            return condition
        case Negation(TypeConstraint() as relation):
            found = as_applicability_test(relation)
            return found and replace(found, negated=True)
        case TypeConstraint(name, Variable() | Constant() | EnumLiteral() as term):
            return Applicable(name, (term,), span=condition.span)
        case TypeConstraint(name, Evaluation(expression)):
            return Applicable(name, (expression,), span=condition.span)
    return None


class _UnitChecker:
    def __init__(self, unit: Unit, directory: SignatureTable, library: Library) -> None:
        self.unit = unit
        self.directory = directory
        self.library = library
        self.metamodel = library.metamodel
        self.result = CheckedUnit(unit)

    def check(self) -> None:
        unit = self.unit
        self.result.problems.extend(check_weight(unit.weight, unit.annotations, unit.span))
        self.result.problems.extend(check_annotations(unit.annotations, UNIT_ANNOTATIONS))
        self.result.problems.extend(check_duplicate_parameters(unit.parameters))
        self.result.types = {parameter.name: self._parameter_type(parameter) for parameter in unit.parameters}
        outputs = {parameter.name for parameter in unit.parameters if parameter.direction == "out"}
        scope = {name: type_ for name, type_ in self.result.types.items() if name not in outputs}
        if nesting_depth(unit.body) > MAX_NESTING:
            hint = "move a part of the unit into another unit, and call it"
            self._report_error(
                "nested-too-deeply", f"blocks are nested more than {MAX_NESTING} levels deep", unit.span, hint
            )
            return
        self._check_step(unit.body, scope)
        for parameter in unit.parameters:
            if parameter.name in outputs and parameter.name not in scope:
                self._report_error(
                    "unbound-output",
                    f"`out` parameter `{parameter.name}` gets no value",
                    parameter.span,
                    "pass it to an `out` parameter of a rule, outside of any block",
                )

    def _parameter_type(self, parameter: Parameter) -> StaticType | None:
        if parameter.type is None:
            advice = f"write `{parameter.name} : Class`, or a data type"
            self._report_error("missing-type", f"parameter `{parameter.name}` has no type", parameter.span, advice)
            return None
        type_ = static_type(parameter.type, self.metamodel)
        if type_ is None:
            hint = type_hint(parameter.type, self.metamodel)
            span = parameter.type_span or parameter.span
            self._report_error("unknown-type", f"unknown type `{parameter.type}`", span, hint)
        return type_

    def _report_error(self, code: str, message: str, span: Span | None, hint: str | None = None) -> None:
        self.result.problems.append(Diagnostic(code, message, span, hint))

    # --- steps

    def _check_step(self, step: Step, scope: UnitVariableTypes) -> None:
        """Check a step. Add `out` arguments of calls to `scope`, unless they are in a loop, choice, `try` or `if`."""
        match step:
            case UnitCall():
                self._check_call(step, scope)
            case Steps(steps):
                if not steps:
                    hint = "write the name of a rule or unit, or leave the block out"
                    found = Diagnostic("empty-block", "this block is empty", step.span, hint, Severity.WARNING)
                    self.result.problems.append(found)
            case Repeat():
                self._check_bounds(step, scope)
            case IfStep():
                self._check_if_condition(step, scope)
        for inner in inner_steps(step):
            self._check_step(inner, scope if isinstance(step, Steps | AtomicStep) else dict(scope))

    def _check_bounds(self, step: Repeat, scope: UnitVariableTypes) -> None:
        lower, upper = step.lower, step.upper
        for bound in dict.fromkeys((lower, upper)):
            if not isinstance(bound, int):
                found = check_expression(bound, scope, self.metamodel, expected=Scalar.INT, bare_objects=False)
                self.result.problems.extend(found[1])
        least = lower if isinstance(lower, int) else 0
        if least < 0 or (isinstance(upper, int) and upper < least):
            hint = "write the lower bound first; it must be at least 0"
            shown = f"{least}..{upper}" if isinstance(upper, int) else str(least)
            self._report_error("bad-bounds", f"cannot repeat {shown} times", step.span, hint)

    def _check_call(self, call: UnitCall, scope: UnitVariableTypes) -> None:
        span = call.name_span or call.span
        callee = self._resolve_callee(call)
        if callee is None:
            names = (one.name for one in call.arguments if isinstance(one, Variable) and not one.is_anonymous)
            scope.update((name, None) for name in names if name not in scope)  # they may be `out` arguments
            return
        self.result.calls[id(call)] = callee
        if call.every and callee.kind == "unit":
            self._report_error(
                "wrong-kind", f"`all` takes a rule, and `{call.name}` is a unit", span, "leave `all` out"
            )
            return
        if self._check_arity(call, callee):
            for argument, parameter in zip(call.arguments, callee.parameters, strict=False):
                self._check_argument(argument, parameter, callee, scope, call.every)
        self._check_selection(call, callee, scope)

    def _resolve_callee(self, call: UnitCall) -> Signature | None:
        """Return the signature of a callee. Return None for an unknown or ambiguous name, and report it.

        A name whose definition has errors is not reported; it marks the result as incomplete.
        """
        span = call.name_span or call.span
        found = self.directory.candidates(call.name, self.unit.package)
        if len(found) == 1:
            return self.directory.signatures[found[0]]
        if found:
            names = ", ".join(f"`{name}`" for name in found)
            message = f"`{call.name}` is ambiguous: it may mean {names}"
            self._report_error("ambiguous-name", message, span, "write the qualified name")
        elif call.name in self.library.unknown:
            self.result.is_complete = False
        else:
            message = f"unknown rule or unit `{call.name}`"
            self._report_error("unknown-rule", message, span, self.directory.suggest_name(call.name))
        return None

    # --- the choice of matches

    def _check_selection(self, call: UnitCall, callee: Signature, scope: UnitVariableTypes) -> None:
        """Check `first`, `top`, `where` and `by` of a call. Report them for a callee that is no rule."""
        self._check_selection_words(call)
        used = {"first": call.first, "top": call.limit is not None, "where": call.where, "by": call.by}
        words = [word for word, given in used.items() if given]
        if not words:
            return
        if callee.kind != "rule":
            span = call.name_span or call.span
            message = f"`{words[0]}` takes a rule, and `{call.name}` is a {callee.kind}"
            self._report_error("wrong-kind", message, span, f"leave `{words[0]}` out")
            return
        if any(variable.type is None for variable in callee.variables) or not (
            callee.variables or not callee.parameters
        ):
            return  # the rule has errors, which are reported there
        inside = {**scope, **{variable.name: variable.type for variable in callee.variables}}
        for place, condition in enumerate(call.where):
            self._check_condition(call, place, condition, inside)
        if call.by is not None:
            self._check_order(call.by, inside)

    def _check_selection_words(self, call: UnitCall) -> None:
        if call.limit is not None and call.limit < 1:
            self._report_error("bad-bounds", "`top` must be at least 1", call.span, "write `top 1`")
        if call.limit is not None and call.by is None:
            hint = "write `by` and an expression: the matches with the largest values are taken"
            self._report_error("missing-by", "`top` needs `by`, which orders the matches", call.span, hint)
        if call.by is not None and not call.every:
            hint = "write `top 1` before the rule for the match with the largest value, or `all` for all in this order"
            self._report_error(
                "missing-top", "`by` orders several matches, but this call takes only one", call.by.span, hint
            )
        if (call.first or call.limit is not None) and call.every is not (call.limit is not None):
            message = "a call takes only one of `first`, `all` and `top`"
            self._report_error("wrong-selection", message, call.span, "keep only one of these words")

    def _check_order(self, by: Expression, scope: UnitVariableTypes) -> None:
        type_, problems = check_expression(by, scope, self.metamodel, bare_objects=False)
        self.result.problems.extend(problems)
        if type_ is not None and not problems and type_ not in (Scalar.INT, Scalar.FLOAT):
            message = f"`by` takes a number, not {quote_with_article(type_text(type_))}"
            self._report_error("wrong-type", message, by.span, "order by an attribute that is an int or a float")

    def _check_arity(self, call: UnitCall, callee: Signature) -> bool:
        required = [parameter.name for parameter in callee.parameters if parameter.is_required]
        names = ", ".join(parameter.name for parameter in callee.parameters)
        hint = f"write `{call.name}({names})`; `_` passes no value" if names else f"write `{call.name}`"
        if not call.arguments:
            if required:
                missing = ", ".join(f"`{name}`" for name in required)
                self._report_error("wrong-arity", f"`{call.name}` needs arguments for {missing}", call.span, hint)
            return not required
        if len(call.arguments) != len(callee.parameters):
            count = count_with_noun(len(callee.parameters), "argument")
            message = f"`{call.name}` takes {count}, not {len(call.arguments)}"
            self._report_error("wrong-arity", message, call.span, hint)
            return False
        return True

    def _check_argument(
        self,
        argument: Expression,
        parameter: CallParameter,
        callee: Signature,
        scope: UnitVariableTypes,
        every: bool,
    ) -> None:
        if isinstance(argument, Variable) and not is_named(argument.name):
            if parameter.is_required:
                message = f"`{callee.simple_name}` needs a value for `{parameter.name}`"
                self._report_error("wrong-arity", message, argument.span, "write a value instead of `_`")
            return
        if isinstance(argument, Variable) and argument.name not in scope and parameter.is_output and not every:
            scope[argument.name] = parameter.type
            return
        is_object = isinstance(parameter.type, ObjectType)
        is_matched = any(variable.name == parameter.name for variable in callee.variables)
        if parameter.is_output and callee.kind == "rule" and is_object and not is_matched:
            message = (
                f"`{parameter.name}` of `{callee.simple_name}` is a new object, so no existing value can be passed"
            )
            self._report_error("bound-output", message, argument.span, "write a new name, or `_`")
            return
        expected = None if is_object else parameter.type  # the classes of objects are compared below
        type_, problems = check_expression(argument, scope, self.metamodel, expected=expected)
        self.result.problems.extend(problems)
        if not problems and type_ and parameter.type and not may_be_assignable(type_, parameter.type, self.metamodel):
            message = f"`{parameter.name}` of `{callee.simple_name}` is {quote_with_article(type_text(parameter.type))}"
            fitting = [
                name
                for name, known in scope.items()
                if known and may_be_assignable(known, parameter.type, self.metamodel)
            ]
            hint = f"write {list_names(fitting)}" if fitting else value_hint(parameter.type, type_)
            message = f"{message}, not {quote_with_article(type_text(type_))}"
            self._report_error("wrong-type", message, argument.span, hint)

    # --- conditions

    def _check_if_condition(self, step: IfStep, scope: UnitVariableTypes) -> None:
        """Check the condition of an `if`: a pattern condition, or the name of a rule that must be applicable."""
        asked = as_applicability_test(step.condition)
        if not isinstance(step.condition, Applicable) and (asked is None or not self._is_rule_name(asked.name)):
            self._check_condition(step, 0, step.condition, scope)
            return
        assert asked is not None
        callee = self._resolve_callee(UnitCall(asked.name, span=asked.span))
        if callee is None:
            return
        if callee.kind == "unit":
            hint = "test one of its rules, or write `try { .. } else { .. }`"
            self._report_error(
                "wrong-kind",
                f"`{asked.name}` is a unit, but a condition tests rules",
                asked.span,
                hint,
            )
            return
        self.result.applicability_tests[id(step)] = asked, callee
        call = UnitCall(asked.name, asked.arguments, span=asked.span)
        if self._check_arity(call, callee):
            for argument, parameter in zip(call.arguments, callee.parameters, strict=False):
                self._check_argument(argument, parameter, callee, scope, every=True)

    def _is_rule_name(self, name: str) -> bool:
        """Return True if a name is no type, and names a rule, unit or group or resembles only such a name."""
        if static_type(name, self.metamodel) is not None:
            return False
        rules = [signature.simple_name for signature in self.directory.signatures.values()]
        near = did_you_mean(name, rules) and not did_you_mean(name, self.metamodel.classes)
        return bool(self.directory.candidates(name, self.unit.package) or near)

    def _check_condition(self, step: Step, place: int, condition: Constraint, scope: UnitVariableTypes) -> None:
        unknown = list(self._unknown_variables(condition, scope))
        for variable in unknown:
            hint = did_you_mean(variable.name, scope) or "write `_` for any value"
            self._report_error("unknown-variable", f"unknown variable `{variable.name}`", variable.span, hint)
        if unknown:
            return
        if isinstance(condition, Check):
            expected = static_type("bool", self.metamodel)
            _, problems = check_expression(
                condition.expression, scope, self.metamodel, expected=expected, bare_objects=False
            )
            self.result.problems.extend(problems)
            return
        relation = condition.relation if isinstance(condition, Negation) else condition
        lowered = self._condition_pattern(relation, isinstance(condition, Negation), scope, step.span)
        checked = self.library.analyse(lowered.pattern)
        self.result.problems += [without_generated_names(p) for p in checked.problems if p.severity is Severity.ERROR]
        if checked.invalid_names:
            self.result.is_complete = False
        else:
            self.result.entries += checked.entries
        self.result.conditions[id(step), place] = lowered

    def _unknown_variables(self, condition: Constraint, scope: UnitVariableTypes) -> Iterator[Variable]:
        for variable in variable_occurrences(condition):
            if is_named(variable.name) and variable.name not in scope:
                yield variable

    def _condition_pattern(
        self, relation: Constraint, negated: bool, scope: UnitVariableTypes, span: Span | None
    ) -> ConditionPattern:
        """Return the pattern of a condition. A negation is not part of the pattern, but is applied to its result.

        So arguments of a negated condition need no other binding.
        """
        used = tuple(dict.fromkeys(v.name for v in variable_occurrences(relation) if is_named(v.name)))
        parameters = tuple(parameter_for(name, scope[name]) for name in used)
        name = f"{self.unit.name}#if{len(self.result.conditions) + 1}"
        pattern = Pattern(
            name,
            parameters,
            (Body((relation,), span=span),),
            package=self.unit.package,
            private=True,
            strategy="search",
            span=span,
        )
        return ConditionPattern(pattern, used, negated)
