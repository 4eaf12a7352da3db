"""Variable bindings in generated code: the expression for the value of each variable of a body."""

from __future__ import annotations

from collections.abc import Callable

from envgraph import code
from envgraph.match.generate._source_builder import local_variable
from envgraph.metamodel import Value
from envgraph.pattern import Conjunction, StaticType


class VariableBindings:
    """The variables of a conjunction with values at a place of the code, and the expression for each value.

    Args:
        conjunction: the body.
        literal: returns code for the value of a constant, given its type.
        renumbered: if True, local variables are numbered by first use, so that equal code has equal names.

    Attributes:
        expressions: the expressions for the variables; constants are added at first use.
        constants: the variables with a fixed value.
    """

    def __init__(
        self,
        conjunction: Conjunction,
        literal: Callable[[Value, StaticType], code.Expression],
        renumbered: bool = False,
    ) -> None:
        self.expressions: dict[int, code.Expression] = {}
        self.constants = dict(conjunction.constants)
        self._types = conjunction.types
        self._literal = literal
        self._numbers: dict[int, int] | None = {} if renumbered else None

    def has_value(self, variable: int) -> bool:
        """Return True if a variable has a value at this place of the code, or is a constant."""
        return variable in self.expressions or variable in self.constants

    @property
    def bound_variables(self) -> frozenset[int]:
        """Return the variables that have values, without the constants."""
        return frozenset(self.expressions) - self.constants.keys()

    def expression_of(self, variable: int) -> code.Expression:
        """Return the expression for the value of a variable, which must have a value."""
        if variable not in self.expressions:
            self.expressions[variable] = self._literal(self.constants[variable], self._types[variable])
        return self.expressions[variable]

    def local(self, variable: int, prefix: str = "v") -> code.Local:
        """Return the local variable in the code for a variable; other prefixes than "v" are for intermediate values."""
        number = variable if self._numbers is None else self._numbers.setdefault(variable, len(self._numbers))
        return local_variable(prefix, number, self._types[variable] if prefix == "v" else None)
