"""The rules of an engine as a behaviour calls them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from envgraph.errors import InvalidArgument
from envgraph.graph import Node
from envgraph.match import Row
from envgraph.metamodel import Value
from envgraph.pattern import type_text
from envgraph.rewrite import Engine, RuleRunner, Signature

Fire = Callable[[Row], Sequence[Value]]
"""Applies a rule at a match, and returns the values of the outputs that were asked for."""


def signature_of(engine: Engine, name: str) -> Signature | None:
    """What a rule, unit or group is called with; None if the name means nothing, or several things."""
    try:
        return engine.signature(name)
    except InvalidArgument:
        return None


def callable_names(engine: Engine) -> list[str]:
    """Qualified and simple names of everything that can be called, for hints."""
    names = [*engine.rules, *engine.units, *engine.groups]
    return list(dict.fromkeys([*names, *(engine.signature(name).simple for name in names)]))


def written(signature: Signature) -> str:
    """How a call is written: `forward(packet, hop, latency)`."""
    parts = []
    for parameter in signature.parameters:
        type_ = f" : {type_text(parameter.type)}" if parameter.type else ""
        parts.append(f"{'out ' if parameter.output else ''}{parameter.name}{type_}")
    return f"{signature.simple}({', '.join(parts)})"


def firing(runner: RuleRunner, outputs: Sequence[str]) -> Fire:
    """Applies a rule and returns some of its outputs, objects as ids."""

    def fire(row: Row) -> Sequence[Value]:
        result = runner.fire(row)
        if not outputs:
            return ()
        found = runner.application(row, result).outputs
        values = (found[name] for name in outputs)
        return [value.id if isinstance(value, Node) else value for value in values]

    return fire
