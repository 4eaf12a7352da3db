"""Bindings: the code that stands for the variables of a body."""

from __future__ import annotations

from envgraph import code
from envgraph.match.generate._write import Module, local
from envgraph.pattern import Conjunction


class Bindings:
    """The variables of a conjunction that have values at some place of the code, and what stands for each.

    Args:
        conjunction: whose variables they are.
        module: receives constants.
        renumbered: local variables are numbered as they are first asked for, so that code that does the same is equal.

    Attributes:
        names: what stands for the variables; for constants from when they are first asked for.
        constants: the variables with one value in all matches.
    """

    def __init__(self, conjunction: Conjunction, module: Module, renumbered: bool = False) -> None:
        self.names: dict[int, code.Expression] = {}
        self.constants = dict(conjunction.constants)
        self._types = conjunction.types
        self._module = module
        self._numbers: dict[int, int] | None = {} if renumbered else None

    def known(self, variable: int) -> bool:
        """Return whether a variable has a value."""
        return variable in self.names or variable in self.constants

    @property
    def changing(self) -> frozenset[int]:
        """The variables with a value that are no constants."""
        return frozenset(self.names) - self.constants.keys()

    def source(self, variable: int) -> code.Expression:
        """Return what stands for a variable that has a value."""
        if variable not in self.names:
            self.names[variable] = self._module.literal(self.constants[variable])
        return self.names[variable]

    def local(self, variable: int, prefix: str = "v") -> code.Local:
        """The local variable for a variable, or for what it is taken from."""
        number = variable if self._numbers is None else self._numbers.setdefault(variable, len(self._numbers))
        return local(prefix, number, self._types[variable] if prefix == "v" else None)
