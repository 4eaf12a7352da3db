"""Explanation of refused applications, and of values that cannot be computed.

The failed line of the generated function is mapped to an operation of the plan, and the operation to a span in the
text.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import FrameType, MappingProxyType
from typing import Any, Final

from envgraph.code import origin_of
from envgraph.errors import EvaluationError, RuleError, Span
from envgraph.graph import Model
from envgraph.metamodel import Attribute
from envgraph.pattern import explain_error
from envgraph.rewrite._rule_plan import AddLink, ComputeValue, RemoveLink, RulePlan
from envgraph.rewrite.run._rule_runtime import DeletedWithContainer

_ADVICE: Final[Mapping[str, str]] = MappingProxyType(
    {
        "containment": "require in the left side that the container is not inside the object",
        "ambiguous": "restrict the left side of the block, so that its matches make the same changes",
        "dangling": "also delete these links, or write `@semantics(spo)` before the rule to delete them as well",
        "full": "delete the existing link, write `set` to replace it, or match only objects with fewer links",
        "identification": "require in the left side that they are different, with `!=`",
        "lost-link": "also delete these links, or write `@semantics(spo)` before the rule to remove them",
        "missing-link": "add the link to the left side, so that the rule matches only if it exists",
    }
)


def explain_refusal(plan: RulePlan, error: RuleError | EvaluationError, model: Model) -> RuleError | EvaluationError:
    """Return the error of a refused application, with rule, span and hint added. The model must be as before."""
    message = f"rule `{plan.name}` cannot be applied: {error.message}"
    operation, frame = origin_of(error)
    span = getattr(operation, "span", None) or error.span or plan.span
    if isinstance(error, EvaluationError):
        found = EvaluationError(error.message, span, error.hint)
        if isinstance(operation, ComputeValue) and frame is not None:
            found = _explain_value_error(operation, frame, error, model, plan.span)
        return EvaluationError(message, found.span, found.hint)
    details, hint = error.details, _hint(error, operation)
    if isinstance(error, DeletedWithContainer):
        container = model.graph.container(error.node)
        assert container is not None
        details = (f"{model.graph.describe(error.node)} is in {model.graph.describe(container[0])}",)
        span = next((delete.span for delete in plan.body.deletes), None) or plan.span
    return RuleError(message, rule=plan.name, reason=error.reason, details=details, span=span, hint=hint)


def _hint(error: RuleError, operation: object) -> str | None:
    if error.hint:
        return error.hint
    if error.reason == "missing-link" and isinstance(operation, RemoveLink) and operation.span:
        return f"write `{operation.span.text};` in the left side, so that the rule matches only if the link exists"
    if error.reason == "full" and isinstance(operation, AddLink) and not operation.reference.many:
        name = operation.reference.name
        return f"write `set` for `{name}`, which replaces its target, or match only objects without a target"
    return _ADVICE.get(error.reason)


def _explain_value_error(
    compute: ComputeValue, frame: FrameType, error: EvaluationError, model: Model, span: Span | None
) -> EvaluationError:
    """Return the error of an expression with its smallest failing part, found by evaluating the expression again.

    This is possible because values are computed before any change.
    """
    here: Mapping[str, Any] = frame.f_locals
    slots = here.get("e")
    values = {name: slots[slot] if slots else here[f"e{slot}"] for name, slot, _ in compute.variables}

    def read(node: int, name: str) -> Any:
        feature = model.metamodel.feature(model.graph.class_of(node), name)
        assert feature is not None
        return model.graph.value(node, feature) if isinstance(feature, Attribute) else model.graph.target(node, feature)

    return explain_error(error, compute.expression, values, read, span, "write `check {};` on the left side")
