"""Tabulate operations on strings: programs know strings only by their numbers among all strings of a family."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from itertools import product
from math import prod

from envgraph.code import dataclass
from envgraph.env.compiled._compiled_costs import COSTS
from envgraph.env.compiled._member_data import NO_INT
from envgraph.env.compiled._not_compiled import NotCompiled
from envgraph.metamodel import EnumType, Scalar, Value
from envgraph.pattern import Expression, StaticType, value_of


@dataclass(frozen=True, slots=True)
class TextTable:
    """A table of the results of an expression for all values of its variables `x1`, `x2`, ..

    The results follow the strides of all variables but the last, by which values are multiplied to find a result.

    Attributes:
        types: the types of the variables: strings, enums or bools.
        result: the type of the results.
    """

    expression: Expression
    types: tuple[StaticType, ...]
    result: StaticType

    def entries(self, numbers: Mapping[str, int]) -> list[int]:
        """Return the table, with the numbers of strings; `NO_INT` for a result that has no value."""
        sizes = [len(domain) for domain in self._domains(numbers)]
        strides = [prod(sizes[place:]) for place in range(1, len(sizes))]
        found = [numbers[one] if isinstance(one, str) else one for one in self.results(sorted(numbers))]
        return strides + [NO_INT if one is None else int(one) for one in found]

    def results(self, strings: Collection[str]) -> list[Value | None]:
        """Return the result for each combination of values, the last one varying fastest; None for no value.

        Raises:
            NotCompiled: there are too many combinations.
        """
        domains = self._domains(strings)
        if prod(map(len, domains)) > COSTS.text_results:
            raise NotCompiled("operations on too many strings that change", self.expression.span)
        rows = ({f"x{number}": value for number, value in enumerate(row, 1)} for row in product(*domains))
        return [value_of(self.expression, row) for row in rows]

    def _domains(self, strings: Collection[str]) -> list[Collection[Value]]:
        """Return the values of each variable, in the order of their numbers."""
        literals = [sorted(type_.literals) if isinstance(type_, EnumType) else (False, True) for type_ in self.types]
        return [strings if type_ is Scalar.STRING else own for type_, own in zip(self.types, literals, strict=True)]


def number_strings(texts: Iterable[str], tables: Iterable[TextTable]) -> dict[str, int]:
    """Return the number of each string, in alphabetical order, and of each string that the tables compute from them.

    Raises:
        NotCompiled: there are too many strings, for example because each gives a longer one.
    """
    made = [table for table in tables if table.result is Scalar.STRING]
    known = sorted({*texts})
    while True:
        found = {text for table in made for text in table.results(known) if isinstance(text, str)}
        if found.issubset(known):
            return {text: number for number, text in enumerate(known)}
        known = sorted({*known, *found})
        if len(known) > COSTS.strings:
            raise NotCompiled("strings that change", made[0].expression.span)
