"""Reading the options of a component: typed, all mistakes together, each at its place in the family file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

from envgraph.errors import RAISE_LIMIT, Diagnostic, did_you_mean, limit
from envgraph.lang import ComponentSpec

T = TypeVar("T")

LARGEST = 1e300
"""Numbers in a family file are no larger, so that differences of them are finite."""


class Options:
    """The options of one component. Ask for each option that it may have, then call `finish`.

    A wrong option gives a diagnostic and its default, so that one look finds all mistakes.
    """

    def __init__(self, spec: ComponentSpec) -> None:
        self.spec = spec
        self.problems: list[Diagnostic] = []
        self._asked: set[str] = set()

    def number(self, name: str, default: float, low: float, high: float) -> float:
        """A number within bounds, both included."""
        value = self._value(name, default)
        if type(value) not in (int, float) or not low <= value <= high:  # type: ignore[operator]
            return self._wrong(name, f"a number from {low:g} to {high:g}", default, f"{default:g}")
        return float(value)  # type: ignore[arg-type]

    def integer(self, name: str, default: int, low: int, most: int | None = None) -> int:
        """A whole number, at least `low`, and at most a limit."""
        value = self._value(name, default)
        if most is not None and self.given(name) and type(value) is int and value > limit(most):
            message = f"`{name}` of `{self.spec.kind}` is {value}, and at most {limit(most):,}"
            self.problems.append(Diagnostic("bad-range", message, self.spec.span(name), RAISE_LIMIT))
            return default
        return (
            value
            if type(value) is int and value >= low
            else self._wrong(name, f"a whole number from {low}", default, str(default))
        )

    def word(self, name: str, default: str, known: Sequence[str]) -> str:
        """One of several words."""
        value = self._value(name, default)
        return (
            value
            if isinstance(value, str) and value in known
            else self._wrong(name, " or ".join(f"`{one}`" for one in known), default, f'"{default}"')
        )

    def name(self, name: str) -> str:
        """A name that must be given."""
        value = self._value(name, None)
        return value if isinstance(value, str) else self._wrong(name, "a name", "", '"..."')

    def names(self, name: str) -> tuple[str, ...]:
        """A name or a list of names, at least one."""
        value = self._value(name, None)
        found = [value] if isinstance(value, str) else value
        if isinstance(found, list) and found and all(isinstance(one, str) for one in found):
            return tuple(found)
        return self._wrong(name, "a name or a list of names", (), '["..."]')

    def integers(self, name: str, default: list[int], low: int, most: int) -> tuple[int, ...]:
        """A whole number or a list of them, at least one, each at least `low`, and at most a limit."""
        value = self._value(name, default)
        found = value if isinstance(value, list) else [value]
        if found and all(type(one) is int and low <= one for one in found):
            if max(found) <= limit(most):
                return tuple(found)
            message = f"`{name}` of `{self.spec.kind}` is {max(found)}, and at most {limit(most):,}"
            self.problems.append(Diagnostic("bad-range", message, self.spec.span(name), RAISE_LIMIT))
            return (low,)
        what = f"a whole number from {low}, or a list of them"
        return self._wrong(name, what, tuple(default), f"[{', '.join(map(str, default))}]")

    def number_or(self, name: str, word: str) -> float | str | None:
        """A number, a certain word, or None where the option is not there."""
        value = self._value(name, None)
        if value is None or value == word or (type(value) in (int, float) and abs(value) <= LARGEST):  # type: ignore[arg-type]
            return value  # type: ignore[return-value]
        return self._wrong(name, f'a number or "{word}"', None, f'"{word}"')

    def range(self, name: str, default: tuple[float, float]) -> tuple[float, float]:
        """Two numbers, the lower first."""
        value = self._value(name, list(default))
        fits = isinstance(value, list) and len(value) == 2 and all(type(one) in (int, float) for one in value)
        if fits and -LARGEST <= value[0] < value[1] <= LARGEST:  # type: ignore[index]
            return float(value[0]), float(value[1])  # type: ignore[index]
        written = f"[{default[0]:g}, {default[1]:g}]"
        if fits and value[1] < value[0]:  # type: ignore[index]
            written = f"[{value[1]:g}, {value[0]:g}]"  # type: ignore[index]
        return self._wrong(name, "two numbers, the lower first", default, written)

    def given(self, name: str) -> bool:
        """Whether the option is there."""
        self._asked.add(name)
        return name in self.spec.options

    def finish(self) -> None:
        """Note every option that was not asked for; an unknown one may be what was meant by one that is missing."""
        if not self._asked.issuperset(self.spec.options):
            self.problems = [problem for problem in self.problems if problem.code != "missing-key"]
        for name in self.spec.options:
            if name not in self._asked:
                known = ", ".join(f"`{one}`" for one in sorted(self._asked)) or "no options: leave it out"
                hint = did_you_mean(name, self._asked) or f"`{self.spec.kind}` has {known}"
                message = f"unknown key `{name}` for `{self.spec.kind}`"
                self.problems.append(Diagnostic("unknown-key", message, self.spec.key_span(name), hint))

    def _value(self, name: str, default: object) -> object:
        self._asked.add(name)
        return self.spec.options.get(name, default)

    def _wrong(self, name: str, what: str, default: T, written: str) -> T:
        message = f"`{name}` of `{self.spec.kind}` is {what}"
        code = "wrong-type" if name in self.spec.options else "missing-key"
        if not any(problem.subject == (name,) for problem in self.problems):
            hint = f"write `{name} = {written}`"
            self.problems.append(Diagnostic(code, message, self.spec.span(name), hint, subject=(name,)))
        return default
