"""Look up the parameters of an engine's rules."""

from __future__ import annotations

from envgraph.errors import InvalidArgument
from envgraph.rewrite import Engine, Signature


def signature_of(engine: Engine, name: str) -> Signature | None:
    """Return the signature of a rule, unit or group; None if the name is unknown or ambiguous."""
    try:
        return engine.signature(name)
    except InvalidArgument:
        return None


def callable_names(engine: Engine) -> list[str]:
    """Return qualified and simple names of all rules, units and groups, for hints."""
    names = [*engine.rules, *engine.units, *engine.groups]
    return list(dict.fromkeys([*names, *(engine.signature(name).simple_name for name in names)]))


def format_call(signature: Signature) -> str:
    """Return a call with the parameters' names: `forward(packet, hop, latency)`."""
    return f"{signature.simple_name}({', '.join(parameter.name for parameter in signature.parameters)})"
