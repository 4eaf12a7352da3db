"""The example domains as engines."""

from __future__ import annotations

from envgraph.lang import bundled_domain, load_workspace
from envgraph.rewrite import Engine


def domain(name: str, model: str) -> Engine:
    """An engine on a model of a bundled domain with all its rules."""
    place = bundled_domain(name)
    return load_workspace([str(place / f"{name}.rules"), str(place / f"{model}.model")]).engine()
