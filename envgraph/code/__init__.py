"""Generated code: what becomes functions of Python is compiled and run here, and nowhere else."""

from envgraph.code._compile import define

__all__ = ["define"]
