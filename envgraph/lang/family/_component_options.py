"""Read the typed options of a component of a family file; collect all errors with their spans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any, TypeVar

from envgraph.errors import RAISE_LIMIT_HINT, Diagnostic, Source, scaled_limit
from envgraph.lang.family._table_reader import ComponentSpec, TableReader
from envgraph.lang.syntax._toml_parser import TomlText

T = TypeVar("T")

LARGEST_NUMBER = 1e300
"""The maximum absolute value of numbers in a family file; it keeps their differences finite."""


class ComponentOptions:
    """A reader of the options of one component: read each option that the component has, then call `finish`.

    A wrong option is recorded in `problems` and its default is returned, so that all errors are found in one pass.
    """

    def __init__(self, spec: ComponentSpec) -> None:
        self.spec = spec
        self.problems: list[Diagnostic] = []
        text, path = spec.text or TomlText(Source("", ""), {}), spec.path or (spec.kind,)
        self._table = TableReader(text, path, spec.options, self.problems, {})

    def read(self, component: type[T]) -> T:
        """Return an instance of a dataclass whose fields are made by `key` with methods of this class."""
        made: Any = component
        return component(**{one.name: one.metadata["read"](self, one.name, one.default) for one in fields(made)})

    def number(self, name: str, default: float, low: float, high: float) -> float:
        """Return a number from `low` to `high`, both included; the default if it is missing or wrong."""
        return float(self._table.number(name, default, low, high))

    def integer(self, name: str, default: int, low: int, most: str) -> int:
        """Return an integer from `low` to the limit `most` (times `ENVGRAPH_LIMITS`); the default if wrong or
        missing.
        """
        found: int = self._table.integer(name, default, low, most)
        return found

    def word(self, name: str, default: str, known: Sequence[str]) -> str:
        """Return one of the words in `known`; the default if the option is missing or wrong."""
        return self._table.choice(name, default, known)

    def name(self, name: str) -> str:
        """Return a required name; return "" if it is missing or wrong, which is reported."""
        found = self._table.string(name)
        if not self.is_given(name):
            self._table.report_missing(name, f'write `{name} = "..."`')
        return found.text if found else ""

    def name_or_none(self, name: str) -> str | None:
        """Return an optional name; return None if it is missing, and "" if it is wrong."""
        return self.name(name) if self.is_given(name) else None

    def names(self, name: str) -> tuple[str, ...]:
        """Return a required name or nonempty list of names; an empty tuple if it is missing or wrong."""
        value = self._table.raw_value(name)
        found = [value] if isinstance(value, str) else value
        if isinstance(found, list) and found and all(isinstance(one, str) for one in found):
            return tuple(found)
        return self._report_wrong(name, "a name or a list of names", (), '["..."]')

    def integers(self, name: str, default: list[int], low: int, most: str) -> tuple[int, ...]:
        """Return an integer or a nonempty list of integers, from `low` to `most`; the default or `(low,)` if wrong."""
        value = self._table.raw_value(name) if self.is_given(name) else default
        found = value if isinstance(value, list) else [value]
        if not found or not all(type(one) is int and low <= one for one in found):
            what = f"a whole number from {low}, or a list of them"
            return self._report_wrong(name, what, tuple(default), f"[{', '.join(map(str, default))}]")
        if max(found) > scaled_limit(most):
            message = f"`{name}` is {max(found)}, but must be at most {scaled_limit(most):,}"
            self._table.error("bad-range", message, self._table.span(name), RAISE_LIMIT_HINT)
            return (low,)
        return tuple(found)

    def number_or_word(self, name: str, word: str) -> float | str | None:
        """Return a number or the word `word`; None if the option is missing or wrong."""
        value = self._table.raw_value(name)
        if value is None or value == word or (type(value) in (int, float) and abs(value) <= LARGEST_NUMBER):
            return value  # type: ignore[no-any-return]
        return self._report_wrong(name, f'a number or "{word}"', None, f'"{word}"')

    def range(self, name: str, default: tuple[float, float]) -> tuple[float, float]:
        """Return a pair of numbers, the lower first; the default if it is missing or wrong."""
        value = self._table.raw_value(name) if self.is_given(name) else list(default)
        fits = isinstance(value, list) and len(value) == 2 and all(type(one) in (int, float) for one in value)
        if fits and -LARGEST_NUMBER <= value[0] < value[1] <= LARGEST_NUMBER:
            return float(value[0]), float(value[1])
        low, high = sorted(value) if fits and value[0] != value[1] else default
        return self._report_wrong(name, "two numbers, the lower first", default, f"[{low:g}, {high:g}]")

    def is_given(self, name: str) -> bool:
        """Return True if the option is set, and mark it as known."""
        self._table.raw_value(name)
        return name in self._table

    def finish(self) -> None:
        """Report every option that was not read.

        If there is one, remove the errors for missing options, because the unknown option is probably a misspelt one.
        """
        if not self._table.read_keys.keys() >= self._table.data.keys():
            self.problems[:] = [problem for problem in self.problems if problem.code != "missing-key"]
        self._table.finish()

    def _report_wrong(self, name: str, what: str, default: T, written: str) -> T:
        hint = f"write `{name} = {written}`"
        if name in self._table:
            self._table.error("wrong-type", f"`{name}` must be {what}", self._table.span(name), hint)
        else:
            self._table.report_missing(name, hint)
        return default
