"""envgraph: graph rewriting, and families of reinforcement-learning environments made with it.

The names below are loaded when they are first used, so that importing the engine needs neither the parser nor
NumPy nor Gymnasium.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from envgraph.errors import EnvgraphError, LoadError
    from envgraph.graph import Model, Node
    from envgraph.lang import Pattern, Rule, Unit, load, open
    from envgraph.metamodel import Metamodel
    from envgraph.pattern import Derivation
    from envgraph.rewrite import Engine
    from envgraph.search import make, make_aec, make_parallel, make_vec, optimise, register

__version__ = "0.1.0"

_HOME = {
    "Derivation": "envgraph.pattern",
    "Engine": "envgraph.rewrite",
    "EnvgraphError": "envgraph.errors",
    "LoadError": "envgraph.errors",
    "Metamodel": "envgraph.metamodel",
    "Model": "envgraph.graph",
    "Node": "envgraph.graph",
    "Pattern": "envgraph.lang",
    "Rule": "envgraph.lang",
    "Unit": "envgraph.lang",
    "load": "envgraph.lang",
    "make": "envgraph.search",
    "make_aec": "envgraph.search",
    "make_parallel": "envgraph.search",
    "make_vec": "envgraph.search",
    "optimise": "envgraph.search",
    "open": "envgraph.lang",
    "register": "envgraph.search",
}

__all__ = [
    "Derivation",
    "Engine",
    "EnvgraphError",
    "LoadError",
    "Metamodel",
    "Model",
    "Node",
    "Pattern",
    "Rule",
    "Unit",
    "__version__",
    "load",
    "make",
    "make_aec",
    "make_parallel",
    "make_vec",
    "open",
    "optimise",
    "register",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    raise AttributeError(f"module `envgraph` has no attribute `{name}`")


def __dir__() -> list[str]:
    return sorted(__all__)
