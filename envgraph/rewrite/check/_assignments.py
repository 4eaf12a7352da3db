"""Translation of assignments in a right-hand side: `read_set` actions, and the braces of object literals."""

from __future__ import annotations

from typing import Literal

from envgraph.errors import Diagnostic, Note, Span, quote_with_article
from envgraph.metamodel import Attribute, Reference, Scalar
from envgraph.pattern import (
    Assignment,
    Constant,
    Expression,
    ObjectType,
    RuleNode,
    SetAction,
    StaticType,
    Variable,
    check_expression,
    derived_reads_in,
    type_text,
    variables_in,
)
from envgraph.rewrite._rule_plan import (
    AddLink,
    AdjustAttribute,
    AssignOperation,
    ChangeTargets,
    ComputeValue,
    SetAttribute,
    SetAttributeValues,
    SetTargets,
)
from envgraph.rewrite.check._rule_scope import RuleScope

Operator = Literal["=", "+=", "-="]
AssignedValue = Expression | tuple[Expression, ...]


class AssignmentReader:
    """A checker of the assignments of one block, which collects them as operations.

    Attributes:
        computed_values: values to compute on the state before the rule.
        initial_links: links of references of new objects; like created edges, they are refused if an end is full.
        operations: all other assignments.
    """

    def __init__(self, scope: RuleScope) -> None:
        self.scope = scope
        self.computed_values: list[ComputeValue] = []
        self.initial_links: list[AddLink] = []
        self.operations: list[AssignOperation] = []
        self._previous: dict[tuple[str, str], tuple[Operator, Span | None]] = {}

    def read_initial_value(self, node: RuleNode, assignment: Assignment) -> None:
        """Check an assignment in the literal of a new object. Add its operation, or report its errors."""
        span = assignment.span or node.span
        where = assignment.feature_span or span
        feature = self._resolve_feature(Variable(node.name, node.span), assignment.feature, "=", where)
        if isinstance(feature, Attribute):
            self._read_attribute(node.name, feature, "=", assignment.value, span)
        elif isinstance(feature, Reference) and not _is_none(assignment.value):
            for value in self._target_slots(feature, assignment.value, span):
                self.initial_links.append(AddLink(self.scope.slot_of(node.name), feature, value, span))

    def read_set(self, action: SetAction) -> None:
        """Check a `read_set` action (`=`, `+=` or `-=`). Add its operation, or report its errors."""
        where = action.feature_span or action.span
        found = self._resolve_feature(action.object, action.feature, action.operator, where)
        if isinstance(found, Attribute):
            self._read_attribute(action.object.name, found, action.operator, action.value, action.span)
        elif isinstance(found, Reference):
            self._read_reference(action.object.name, found, action.operator, action.value, action.span)

    def _resolve_feature(
        self, owner: Variable, feature: str, operator: Operator, span: Span | None
    ) -> Attribute | Reference | None:
        name = owner.name
        cls = (
            self.scope.class_after(name)
            if self.scope.check_object_after(name, owner.span or span, matched=True)
            else None
        )
        found = self.scope.resolve_feature(cls, feature, span) if cls else None
        if found is None:
            return None
        if (name, feature) in self._previous:
            earlier, where = self._previous[name, feature]
            if "=" in (operator, earlier):
                note = Note("the first assignment is here", where)
                message = f"`{name}.{feature}` gets two values"
                self.scope.error("duplicate-assignment", message, span, "leave one of the two out", note)
                return None
        self._previous[name, feature] = operator, span
        return found

    def _read_attribute(
        self, name: str, attribute: Attribute, operator: Operator, value: AssignedValue, span: Span | None
    ) -> None:
        if attribute.many:
            self._read_values(name, attribute, operator, value, span)
        elif isinstance(value, tuple):
            self.scope.error(
                "wrong-type",
                f"`{attribute}` has one value, not a list",
                span,
                "write one value without brackets",
            )
        elif operator != "=" and not _can_increase(attribute, operator):
            message = f"`{operator}` does not apply to `{attribute}`, {quote_with_article(type_text(attribute.type))}"
            self.scope.error("wrong-type", message, span, "write `=`")
        elif operator == "=" and _is_none(value):
            self.operations.append(SetAttribute(self.scope.slot_of(name), attribute, None, span))
        else:
            slot = self._value_slot(value, attribute.type, span, needed=operator != "=" or not attribute.optional)
            if slot is not None:
                object_ = self.scope.slot_of(name)
                self.operations.append(
                    SetAttribute(object_, attribute, slot, span)
                    if operator == "="
                    else AdjustAttribute(object_, attribute, operator, slot, span)
                )

    def _read_values(
        self, name: str, attribute: Attribute, operator: Operator, value: AssignedValue, span: Span | None
    ) -> None:
        """Check an assignment to a multi-valued attribute. Add operations for correct values, and report the others."""
        parts = () if operator == "=" and _is_none(value) else value if isinstance(value, tuple) else (value,)
        slots = [self._value_slot(part, attribute.type, part.span or span, needed=True) for part in parts]
        found = tuple(slot for slot in slots if slot is not None)  # errors of the others are reported already
        object_ = self.scope.slot_of(name)
        if operator == "=":
            self.operations.append(SetAttributeValues(object_, attribute, found, span))
        else:
            self.operations.extend(AdjustAttribute(object_, attribute, operator, slot, span) for slot in found)

    def _read_reference(
        self, name: str, reference: Reference, operator: Operator, value: AssignedValue, span: Span | None
    ) -> None:
        object_ = self.scope.slot_of(name)
        if operator != "=" and not reference.many:
            message = f"`{reference}` has at most one target, so `{operator}` does not apply"
            self.scope.error("wrong-type", message, span, "write `=`, or `= none` to clear it")
        elif operator == "=" and (_is_none(value) or value == ()):
            if reference.lower:
                message = (
                    f"`{name}` gets no `{reference.name}`, but `{reference}` has multiplicity {reference.multiplicity}"
                )
                self.scope.warn("missing-required", message, span, "assign as many targets as it requires")
            self.operations.append(SetTargets(object_, reference, (), span))
        else:
            values = self._target_slots(reference, value, span)
            self.operations.append(
                SetTargets(object_, reference, values, span)
                if operator == "="
                else ChangeTargets(object_, reference, operator, values, span)
            )

    def _target_slots(self, reference: Reference, value: AssignedValue, span: Span | None) -> tuple[int, ...]:
        """Return the slots of the assigned target objects. Report errors of values; values with errors get no slot."""
        if isinstance(value, tuple) and not reference.many and len(value) != 1:
            self.scope.error(
                "wrong-type",
                f"`{reference}` has at most one target, not a list",
                span,
                "write one object without brackets",
            )
            return ()
        found: list[int] = []
        for part in value if isinstance(value, tuple) else (value,):
            where = part.span or span
            if isinstance(part, Variable):
                if self.scope.check_object_after(part.name, where, matched=True) and self.scope.check_target(
                    part.name, reference, where
                ):
                    found.append(self.scope.slot_of(part.name))
            else:
                slot = self._value_slot(part, ObjectType(reference.target), where, needed=False)
                found += [] if slot is None else [slot]
        return tuple(found)

    def _value_slot(
        self, expression: Expression, expected: StaticType, span: Span | None, *, needed: bool
    ) -> int | None:
        """Return the slot of a variable, or of an expression, which is computed on the state before the rule.

        Return None after a reported error. If `needed`, an application raises an error when the value is missing.
        """
        read = {variable.name: variable for variable in variables_in(expression)}
        for name, variable in read.items():
            if name in self.scope.created:
                message = f"`{name}` is created by this rule, so it has no values before the rule"
                self.scope.error("no-value-yet", message, variable.span or span, "use a value of the left side")
                return None
        problems = self._check_value(expression, expected, span)
        self.scope.problems.extend(problems)
        if problems:
            return None
        if isinstance(expression, Variable):
            return self.scope.slot_of(expression.name)
        reads = tuple((name, self.scope.slot_of(name), self.scope.types[name]) for name in read)
        slot = self.scope.add_slot("")
        self.computed_values.append(ComputeValue(slot, expression, reads, needed, isinstance(expected, ObjectType)))
        return slot

    def _check_value(self, expression: Expression, expected: StaticType, span: Span | None) -> list[Diagnostic]:
        if _is_none(expression):
            return [
                Diagnostic(
                    "wrong-type",
                    "`none` cannot be added, removed or listed",
                    expression.span or span,
                    "write `= none` to clear the feature",
                )
            ]
        for read in derived_reads_in(expression, self.scope.types, self.scope.metamodel):
            query = self.scope.derived_features.get(read.feature)
            if query is not None:
                message = f"`{read.feature}` cannot be read in the right side, because query `{query}` defines it"
                hint = f"write `find {query}(object, value)` in the left side, and `value` here"
                return [Diagnostic("query-feature", message, read.span or span, hint)]
        _, problems = check_expression(expression, self.scope.types, self.scope.metamodel, expected=expected)
        return [_with_span(problem, span) for problem in problems]


def _can_increase(attribute: Attribute, operator: Operator) -> bool:
    numeric = attribute.type in (Scalar.INT, Scalar.FLOAT)
    return numeric or (operator == "+=" and attribute.type is Scalar.STRING)


def _is_none(value: AssignedValue) -> bool:
    return isinstance(value, Constant) and value.value is None


def _with_span(problem: Diagnostic, span: Span | None) -> Diagnostic:
    """Return the diagnostic with its own span, or with `span` if it has none."""
    if problem.span is not None or span is None:
        return problem
    return Diagnostic(problem.code, problem.message, span, problem.hint, problem.severity, problem.notes)
