"""Tabulate operations on strings: programs know strings only by their numbers among all strings of a family."""

from __future__ import annotations

from collections.abc import Collection
from itertools import product
from math import prod

from envgraph.code import dataclass
from envgraph.env.compiled.layout._compiled_costs import COSTS
from envgraph.env.compiled.layout._member_data import NO_INT
from envgraph.env.compiled.layout._not_compiled import NotCompiled
from envgraph.metamodel import EnumType, Scalar, Value
from envgraph.pattern import Expression, StaticType, value_of


@dataclass(frozen=True, slots=True)
class TextTable:
    """A table of the results of an expression for all values of its variables `x1`, `x2`, ..

    The results, which are ints or bools, follow the strides of all variables but the last, by which values are
    multiplied to find a result.

    Attributes:
        types: the types of the variables: strings, enums or bools.
    """

    expression: Expression
    types: tuple[StaticType, ...]

    def entries(self, strings: Collection[str]) -> list[int]:
        """Return the table for all strings of a family in the order of their numbers; `NO_INT` for no value.

        Raises:
            NotCompiled: there are too many combinations of values.
        """
        domains: list[Collection[Value]] = []
        for type_ in self.types:
            own = sorted(type_.literals) if isinstance(type_, EnumType) else (False, True)
            domains.append(strings if type_ is Scalar.STRING else own)
        sizes = [len(domain) for domain in domains]
        if prod(sizes) > COSTS.text_results:
            raise NotCompiled("operations on too many strings that change", self.expression.span)
        rows = ({f"x{number}": value for number, value in enumerate(row, 1)} for row in product(*domains))
        found = (value_of(self.expression, row) for row in rows)
        strides = [prod(sizes[place:]) for place in range(1, len(sizes))]
        return strides + [NO_INT if one is None else int(one) for one in found]
