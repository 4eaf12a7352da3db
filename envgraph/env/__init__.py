"""An agent's behaviour over a model, and the environment as arrays."""

from envgraph.env._tabular import Tabular

__all__ = ["Tabular"]
