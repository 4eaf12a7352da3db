"""Code generation for expressions and conditions inside units."""

from __future__ import annotations

from collections.abc import Callable, Mapping as Named, Sequence

from envgraph import code
from envgraph.errors import Span
from envgraph.match import Matcher
from envgraph.pattern import (
    Applicable,
    Check,
    Constant as Literal,
    Constraint,
    Expression as Term,
    IfStep as If_,
    Step,
    UnitCall,
    Variable,
    variables_in,
)
from envgraph.rewrite._signatures import Signature
from envgraph.rewrite.check._unit_check import CheckedUnit
from envgraph.rewrite.run._rule_runner import RuleRunner
from envgraph.rewrite.run._unit_function_code import RUN, UnitFunctions, VariableScope


class UnitValues:
    """A generator of values and conditions in the functions of one checked unit.

    Args:
        checked: the unit.
        functions: the functions being generated.
        matcher: evaluates conditions.
        members: returns the rules of a group, or a rule alone, by name.
    """

    def __init__(
        self,
        checked: CheckedUnit,
        functions: UnitFunctions,
        matcher: Matcher,
        members: Callable[[str], Sequence[RuleRunner]],
    ) -> None:
        self._checked = checked
        self._name = checked.unit.qualified_name
        self._functions = functions
        self._matcher = matcher
        self._members = members

    def emit_arguments(
        self, step: UnitCall, callee: Signature, scope: VariableScope
    ) -> tuple[list[tuple[str, code.Expression]], dict[str, str]]:
        """Return expressions for the given parameters of a call, and the variables that its `out` parameters bind.

        A variable that may have a value is in both results.
        """
        given: list[tuple[str, code.Expression]] = []
        new: dict[str, str] = {}
        for argument, parameter in zip(step.arguments, callee.parameters, strict=False):
            if is_variable_argument(argument) is None:
                continue
            if isinstance(argument, Variable):
                name = argument.name
                if name in scope.names:
                    given.append((parameter.name, scope.names[name]))
                if not scope.is_set(name):
                    new[parameter.name] = name
            else:
                what = f"an argument of `{step.name}`"
                given.append((parameter.name, self.emit_value(argument, scope, what, step.span)))
        return given, new

    def emit_value(self, term: Term, scope: VariableScope, what: str, span: Span | None = None) -> code.Expression:
        """Emit code that computes an expression, and that fails without a value. Return an expression for the result.

        `what` describes the expression in messages.
        """
        local = self._functions.new_local("a")
        if isinstance(term, Literal):
            return self._functions.add_constant(term.value)
        self._functions.current.add(code.Assign(local, self._emit_computation(term, scope, what, span)))
        self._functions.emit_failure_if(code.emit_is_none(local), f"{what} has no value", term.span or span)
        return local

    def _emit_computation(self, term: Term, scope: VariableScope, what: str, span: Span | None) -> code.Expression:
        """Return code that computes an expression, or None without a value; `what` describes it in messages."""
        call_site = self._functions.add_constant((f"{what} in `{self._name}`", term.span or span))
        term_, values = self._functions.add_constant(term), self.emit_variable_values(term, scope)
        return code.emit_call("argument", term_, values, code.Name("read"), call_site)

    def emit_variable_values(self, term: Term, scope: VariableScope) -> code.DictExpression:
        """Return a mapping expression with the values of the variables of an expression."""
        used = {variable.name: scope.names[variable.name] for variable in variables_in(term)}
        return self.emit_mapping(used)

    def emit_mapping(self, names: Named[str, code.Expression]) -> code.DictExpression:
        """Return a mapping expression from names to values."""
        return code.DictExpression(tuple((self._functions.add_constant(name), value) for name, value in names.items()))

    def emit_if_condition(self, step: If_, scope: VariableScope) -> code.Expression:
        """Return an expression for the condition of an `if`."""
        if id(step) in self._checked.applicability_tests:
            return self._emit_applicable(step, scope)
        assert not isinstance(step.condition, Applicable)
        return self.emit_condition(step, 0, step.condition, scope)

    def _emit_applicable(self, step: If_, scope: VariableScope) -> code.Expression:
        """Return an expression that tests if a rule is applicable."""
        asked, callee = self._checked.applicability_tests[id(step)]
        rules = self._functions.add_constant(self._members(callee.name))
        given: dict[str, code.Expression] = {}
        for argument, parameter in zip(asked.arguments, callee.parameters, strict=False):
            if isinstance(argument, Variable):
                if argument.name in scope.names:
                    given[parameter.name] = scope.names[argument.name]
                continue
            what = f"an argument of `{asked.name}`"
            given[parameter.name] = self._emit_computation(argument, scope, what, asked.span)
        rule = code.Local("rule")
        applicable = code.emit_call("is_applicable", RUN, rule, self.emit_mapping(given))
        test = code.emit_call("any", code.Comprehension(applicable, rule, rules, is_lazy=True))
        return code.emit_not(test) if asked.negated else test

    def emit_condition(self, step: Step, number: int, condition: Constraint, scope: VariableScope) -> code.Expression:
        """Return an expression that tests a condition, given its index `number` in the step."""
        if isinstance(condition, Check):
            asked = condition.expression
            return code.emit_call(
                "holds",
                self._functions.add_constant(asked),
                self.emit_variable_values(asked, scope),
                code.Name("read"),
            )
        found = self._checked.conditions[id(step), number]
        tester = self._functions.add_constant(self._matcher.prepare_test(found.pattern.qualified_name))
        test = code.emit_call(tester, code.emit_tuple(*(scope.names[name] for name in found.arguments)))
        return code.emit_not(test) if found.negated else test


def is_variable_argument(argument: Term) -> bool | None:
    """Return True if an argument is a named variable, None if it is `_`, and False for other expressions."""
    if not isinstance(argument, Variable):
        return False
    return None if argument.name.startswith("_") else True
