"""Generated code: what becomes functions of Python is compiled and run here, and nowhere else; quick data classes."""

from envgraph.code._compile import define
from envgraph.code._records import dataclass

__all__ = ["dataclass", "define"]
