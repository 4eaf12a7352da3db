"""What the rules of an engine are called with."""

from __future__ import annotations

from envgraph.errors import InvalidArgument
from envgraph.rewrite import Engine, Signature


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
    return f"{signature.simple}({', '.join(parameter.name for parameter in signature.parameters)})"
