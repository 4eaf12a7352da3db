"""What the application of a rule says when the model refuses it, or a value of it cannot be computed.

Generated functions know nothing about places. A table beside each of them, of which an exception's line number is the
index, leads back to the operation and so to the text; it is read when something has failed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import FrameType, MappingProxyType
from typing import Any, Final

from envgraph.errors import EvaluationError, RuleError, Span
from envgraph.graph import Model
from envgraph.metamodel import Attribute
from envgraph.pattern import explained
from envgraph.rewrite._plan import Compute, Link, RulePlan, Unlink
from envgraph.rewrite.run._source import Dragged, Line, Operation

OPERATIONS: Final = "_operations"
"""The name of the tables in the namespace of generated functions, by the name of the function."""

_ADVICE: Final[Mapping[str, str]] = MappingProxyType(
    {
        "containment": "ask on the left side for a container that is not inside the object",
        "ambiguous": "the matches must want the same: ask for more on the left side of the block",
        "dangling": "delete these links as well, or write `@semantics(spo)` before the rule: then they go along",
        "full": "delete what is in the way, or write `set`, which replaces it; or ask for room on the left side",
        "identification": "say on the left side that they are different, with `!=`",
        "lost-link": "delete these links as well, or write `@semantics(spo)` before the rule: then they are lost",
        "missing-link": "draw the link on the left side, so that the rule matches only where it is",
    }
)


def table(lines: Sequence[Line]) -> tuple[Operation | None, ...]:
    """The operation of each line of the source of a function, whose head is the first."""
    return (None, *(line.operation for line in lines for _ in line.source.split("\n")))


def refusal(plan: RulePlan, error: RuleError | EvaluationError, model: Model) -> RuleError | EvaluationError:
    """The reason that the model gives, with the rule that was to be applied and the place; the model is as before."""
    message = f"rule `{plan.name}` cannot be applied: {error.message}"
    operation, frame = _failed(error)
    span = getattr(operation, "span", None) or error.span or plan.span
    if isinstance(error, EvaluationError):
        found = EvaluationError(error.message, span, error.hint)
        if isinstance(operation, Compute) and frame is not None:
            found = _computed(operation, frame, error, model, plan.span)
        return EvaluationError(message, found.span, found.hint)
    details, hint = error.details, _advice(error, operation)
    if isinstance(error, Dragged):
        container = model.container(error.node)
        assert container is not None
        details = (f"{model.describe(error.node)} is in {model.describe(container[0])}",)
        span = next((delete.span for delete in plan.body.deletes), None) or plan.span
    return RuleError(message, rule=plan.name, reason=error.reason, details=details, span=span, hint=hint)


def _failed(error: BaseException) -> tuple[Operation | None, FrameType | None]:
    """The operation that raised an error, and the frame of the generated function."""
    trace = error.__traceback__
    while trace is not None:
        tables = trace.tb_frame.f_globals.get(OPERATIONS)
        if tables is not None:
            return tables[trace.tb_frame.f_code.co_name][trace.tb_lineno - 1], trace.tb_frame
        trace = trace.tb_next
    return None, None


def _advice(error: RuleError, operation: Operation | None) -> str | None:
    if error.hint:
        return error.hint
    if error.reason == "missing-link" and isinstance(operation, Unlink) and operation.span:
        return f"write `{operation.span.text};` on the left side, so that the rule matches only where it is"
    if error.reason == "full" and isinstance(operation, Link) and not operation.reference.many:
        name = operation.reference.name
        return f"write `set` for `{name}`, which replaces its target, or ask for room on the left side"
    return _ADVICE.get(error.reason)


def _computed(
    compute: Compute, frame: FrameType, error: EvaluationError, model: Model, span: Span | None
) -> EvaluationError:
    """An error of an expression, which is evaluated again: values are computed before anything changes."""
    here: Mapping[str, Any] = frame.f_locals
    slots = here.get("e")
    values = {name: slots[slot] if slots else here[f"e{slot}"] for name, slot, _ in compute.scope}

    def read(node: int, name: str) -> Any:
        feature = model.metamodel.feature(model.class_of(node), name)
        assert feature is not None
        return model.value(node, feature) if isinstance(feature, Attribute) else model.target(node, feature)

    return explained(error, compute.expression, values, read, span, "write `check {};` on the left side")
