"""Code generation for expressions and conditions inside units."""

from __future__ import annotations

from collections.abc import Callable, Mapping as Named, Sequence

from envgraph import code
from envgraph.errors import Span
from envgraph.match import Matcher
from envgraph.pattern import (
    Applicable,
    Call,
    Check,
    Constant as Literal,
    Constraint,
    Expression as Term,
    If as If_,
    Step,
    Variable,
    variables_in,
)
from envgraph.rewrite._names import Signature
from envgraph.rewrite.check._unit_check import CheckedUnit
from envgraph.rewrite.run._runner import RuleRunner
from envgraph.rewrite.run._unit_functions import Scope, UnitFunctions


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

    def arguments(
        self, step: Call, callee: Signature, scope: Scope
    ) -> tuple[list[tuple[str, code.Expression]], dict[str, str]]:
        """Return expressions for the given parameters of a call, and the variables that its `out` parameters bind.

        A variable that may have a value is in both results.
        """
        given: list[tuple[str, code.Expression]] = []
        new: dict[str, str] = {}
        for argument, parameter in zip(step.arguments, callee.parameters, strict=False):
            if is_open(argument) is None:
                continue
            if isinstance(argument, Variable):
                name = argument.name
                if name in scope.names:
                    given.append((parameter.name, scope.names[name]))
                if not scope.known(name):
                    new[parameter.name] = name
            else:
                what = f"an argument of `{step.name}`"
                given.append((parameter.name, self.value(argument, scope, what, step.span)))
        return given, new

    def value(self, term: Term, scope: Scope, what: str, span: Span | None = None) -> code.Expression:
        """Emit code that computes an expression, and that fails without a value. Return an expression for the result.

        `what` describes the expression in messages.
        """
        local = self._functions.local("a")
        if isinstance(term, Literal):
            return self._functions.constant(term.value)
        self._functions.now.add(code.Assign(local, self._worked_out(term, scope, what, span)))
        self._functions.fails_if(code.is_none(local), f"{what} has no value", term.span or span)
        return local

    def _worked_out(self, term: Term, scope: Scope, what: str, span: Span | None) -> code.Expression:
        """Return code that computes an expression, or None without a value; `what` describes it in messages."""
        site = self._functions.constant((f"{what} in `{self._name}`", term.span or span))
        term_, values = self._functions.constant(term), self.values(term, scope)
        return code.call("argument", term_, values, code.Name("read"), site)

    def values(self, term: Term, scope: Scope) -> code.Mapping:
        """Return a mapping expression with the values of the variables of an expression."""
        used = {variable.name: scope.names[variable.name] for variable in variables_in(term)}
        return self.mapping(used)

    def mapping(self, names: Named[str, code.Expression]) -> code.Mapping:
        """Return a mapping expression from names to values."""
        return code.Mapping(tuple((self._functions.constant(name), value) for name, value in names.items()))

    def holds(self, step: If_, scope: Scope) -> code.Expression:
        """Return an expression for the condition of an `if`."""
        if id(step) in self._checked.asked:
            return self._applicable(step, scope)
        assert not isinstance(step.condition, Applicable)
        return self.condition(step, 0, step.condition, scope)

    def _applicable(self, step: If_, scope: Scope) -> code.Expression:
        """Return an expression that tests if a rule is applicable."""
        asked, callee = self._checked.asked[id(step)]
        rules = self._functions.constant(self._members(callee.name))
        given: dict[str, code.Expression] = {}
        for argument, parameter in zip(asked.arguments, callee.parameters, strict=False):
            if isinstance(argument, Variable):
                if argument.name in scope.names:
                    given[parameter.name] = scope.names[argument.name]
                continue
            what = f"an argument of `{asked.name}`"
            given[parameter.name] = self._worked_out(argument, scope, what, asked.span)
        rule = code.Local("rule")
        applicable = code.call("is_applicable", rule, self.mapping(given))
        test = code.call("any", code.Each(applicable, rule, rules, late=True))
        return code.inverse(test) if asked.negated else test

    def condition(self, step: Step, number: int, condition: Constraint, scope: Scope) -> code.Expression:
        """Return an expression that tests a condition, given its index `number` in the step."""
        if isinstance(condition, Check):
            asked = condition.expression
            return code.call(
                "holds", self._functions.constant(asked), self.values(asked, scope), code.Name("read")
            )
        found = self._checked.conditions[id(step), number]
        tester = self._functions.constant(self._matcher.tester(found.pattern.qualified_name))
        test = code.call(tester, code.tuple_of(*(scope.names[name] for name in found.arguments)))
        return code.inverse(test) if found.negated else test


def is_open(argument: Term) -> bool | None:
    """Return True if an argument is a named variable, None if it is `_`, and False for other expressions."""
    if not isinstance(argument, Variable):
        return False
    return None if argument.name.startswith("_") else True
