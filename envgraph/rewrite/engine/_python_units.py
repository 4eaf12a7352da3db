"""Units that are implemented by a Python function."""

from __future__ import annotations

from collections.abc import Callable
from inspect import signature as signature_of
from typing import TYPE_CHECKING, Final

from envgraph.errors import InvalidArgument, RuleError, quote_with_article
from envgraph.graph import Node
from envgraph.pattern import ObjectType, Parameter, static_type, type_hint
from envgraph.rewrite._signatures import CallParameter, Signature
from envgraph.rewrite.engine._described_units import unit_parameters
from envgraph.rewrite.run._unit_programs import UnitProgram
from envgraph.rewrite.run._unit_runtime import Environment, UnitRun, record_refusal

if TYPE_CHECKING:
    from envgraph.rewrite.engine._engine import Engine

ENGINE_PARAMETER: Final = "engine"
"""The name of the parameter to which the engine is passed."""


class PythonUnit(UnitProgram):
    """A unit that calls a Python function with nodes and values, and with the engine if the function takes it.

    The unit fails if the function returns False. It also fails if an application is refused and the function does not
    catch the `RuleError`; the changes of the function are then undone.
    """

    def __init__(self, function: Callable[..., object], signature: Signature, engine: Engine) -> None:
        self.name = signature.name
        self.signature = signature
        self.weight = signature.weight
        self.priority = signature.priority
        self.levels = 1
        self._engine = engine
        self._python_function = function
        self._takes_engine = ENGINE_PARAMETER in signature_of(function).parameters
        self._objects = {p.name for p in signature.parameters if isinstance(p.type, ObjectType)}
        self._function = self._call
        self._source = ""

    def _call(self, run: UnitRun, environment: Environment) -> bool | None:
        engine, model = self._engine, self._engine.model
        arguments: dict[str, object] = {
            name: Node(model, int(value)) if name in self._objects else value for name, value in environment.items()
        }
        if self._takes_engine:
            arguments[ENGINE_PARAMETER] = engine
        before = model.graph.store.revision
        run.refusal = None
        try:
            with engine.runs.with_other_randomness(run.rng) as trace, model.transaction():
                outcome = self._python_function(**arguments)
                if not (outcome is None or isinstance(outcome, bool)):
                    found = quote_with_article(type(outcome).__name__)
                    raise InvalidArgument(
                        f"unit `{self.name}` returned {found}, but must return False if it failed, else True or None"
                    )
                trace.check_state(model.state_hash())
        except RuleError as error:
            if error.reason == "failed":
                run.failure = error.message, error.span
            else:
                record_refusal(run, error)
                run.failure = f"a change by `{self.name}` was refused", None
            return None
        run.gaps.extend(len(run.trace) // 2 + gap for gap in trace.gaps)
        for firing in trace:
            run.record(engine.prepare(firing.rule))
            run.record(firing.values)
        if outcome is False:
            run.failure = f"`{self.name}` returned False", None
            return None
        return bool(trace) or model.graph.store.revision != before


def python_unit_signature(
    function: Callable[..., object], name: str, engine: Engine, weight: float, priority: int
) -> Signature:
    """Return the signature of a unit that a Python function implements.

    Raises:
        InvalidArgument: a parameter has no type, an unknown type, or is of a kind that units cannot have.
    """
    taken = tuple(_call_parameter(one, name, engine) for one in unit_parameters(function, name, (ENGINE_PARAMETER,)))
    return Signature(name, "unit", "", taken, weight, priority)


def _call_parameter(parameter: Parameter, name: str, engine: Engine) -> CallParameter:
    metamodel = engine.model.metamodel
    assert parameter.type is not None, "parameters of functions have types"
    type_ = static_type(parameter.type, metamodel)
    if type_ is None:
        hint = type_hint(parameter.type, metamodel)
        message = f"parameter `{parameter.name}` of unit `{name}` has the unknown type `{parameter.type}`"
        raise InvalidArgument(message, hint)
    return CallParameter(parameter.name, type_, is_required=True)
