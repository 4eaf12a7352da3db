"""One table of a family file: what its keys say, with every mistake at its place."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import field, fields
from functools import partial
from math import isfinite
from typing import Any, TypeVar

from envgraph.code import dataclass
from envgraph.errors import RAISE_LIMIT, Diagnostic, Span, did_you_mean, limit, quoted
from envgraph.lang.syntax._toml import TomlText

Spec = TypeVar("Spec")

# What to write where another type is expected.
_WANTED = {
    "a string": 'write `{} = "..."`',
    "a whole number": "write `{} = 3`, without a fraction and without quotation marks",
    "a number": "write `{} = 0.5`, without quotation marks",
    "true or false": "write `{0} = true` or `{0} = false`",
    "a list of names": 'names stand between `"`: `{} = ["...", "..."]`',
}


@dataclass(frozen=True, slots=True)
class Name:
    """A name in a family file and where it stands."""

    text: str
    span: Span | None = field(default=None, compare=False, repr=False)

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, slots=True)
class ComponentSpec:
    """A part of the search by the name of its kind, with its options as plain data.

    Attributes:
        name: the user's name of a measure; for the others their role ("diversity", "parents" ..).
        kind: what is built ("path_complexity", "random" ...).
        options: everything else in the table.
        text, path: the file that has it, and the names of its table there; None for one of Python.
    """

    name: str
    kind: str
    options: Mapping[str, object] = field(default_factory=dict)
    text: TomlText | None = field(default=None, compare=False, repr=False)
    path: tuple[str, ...] = field(default=(), compare=False, repr=False)

    def span(self, option: str | None = None, *item: int) -> Span | None:
        """Where the value of an option, or an item of it, stands; where the table does if it is not there.

        Without an option where the kind stands.
        """
        if self.text is None:
            return None
        named = "kind" if (*self.path, "kind") in self.text.values else "name"
        return self.text.value(*self.path, named if option is None else option, *item)

    def key_span(self, *option: str) -> Span | None:
        """Where the name of an option stands, or of the table."""
        return self.text.key(*self.path, *option) if self.text else None


def key(default: Any, read: Callable[..., Any], /, **limits: Any) -> Any:
    """A field of a data class that stands for a table, or for a component: the key of its name.

    Args:
        default: what holds where the key is not there.
        read: a question of `Section`, or of `Options`, which takes the key, the default and the limits.
        **limits: see there.
    """
    return field(default=default, metadata={"read": partial(read, **limits)})


@dataclass(slots=True)
class Section:
    """One table. Each question takes a key; what nobody asked for is unknown.

    Attributes:
        path: its name, in parts.
        homes: the keys of each table of the file, for hints; of the top under "".
        there: whether the file has it.
    """

    text: TomlText
    path: tuple[str, ...]
    data: Mapping[str, Any]
    diagnostics: list[Diagnostic]
    homes: Mapping[str, Collection[str]]
    there: bool = True
    asked: dict[str, None] = field(default_factory=dict)

    def __contains__(self, key: str) -> bool:
        return key in self.data

    def span(self, *path: str | int) -> Span:
        return self.text.value(*self.path, *path)

    @property
    def name(self) -> str:
        """What the table is called in messages."""
        return f"`[{'.'.join(self.path)}]`" if self.path else "the file"

    def error(self, code: str, message: str, span: Span, hint: str | None = None) -> None:
        known = bool(self.text.source.name)  # else it is a table of Python
        self.diagnostics.append(Diagnostic(code, message, span if known else None, hint))

    def wrong(self, key: str, wanted: str, *path: str | int, hint: str | None = None) -> None:
        value: Any = self.data[key]
        for step in path:
            value = value[step]
        hint = hint or _WANTED.get(wanted, "").format(key) or None
        self.error("wrong-type", f"`{key}` is {wanted}, not {kind_of(value)}", self.span(key, *path), hint)

    def take(self, key: str) -> Any:
        self.asked[key] = None
        return self.data.get(key)

    def read(self, spec: type[Spec]) -> Spec:
        """The table as a data class, whose fields are made by `key`."""
        made: Any = spec
        found = {one.name: one.metadata["read"](self, one.name, one.default) for one in fields(made)}
        self.finish()
        return spec(**found)

    def string(self, key: str, default: str | None = None) -> Name | None:
        value = self.take(key)
        if value is None:
            return None if default is None else Name(default)
        if not isinstance(value, str):
            self.wrong(key, "a string")
            return None
        if not value.strip():
            self.error("bad-value", f"`{key}` is empty", self.span(key), "write a name, or leave the key out")
            return None
        return Name(value, self.span(key))

    def choice(self, key: str, default: str, known: Iterable[str]) -> str:
        value = self.string(key, default)
        names = tuple(known)
        if value is None or value.text in names:
            return value.text if value else default
        known = f"write `{names[0]}`" if len(names) == 1 else f"there are {quoted(names)}"
        hint = did_you_mean(value.text, names) or known
        self.error("unknown-choice", f"`{key}` cannot be `{value}`", self.span(key), hint)
        return default

    def integer(self, key: str, default: Any, low: int, most: int) -> Any:
        value = self.take(key)
        if value is None:
            return default
        if not _is_int(value):
            self.wrong(key, "a whole number")
            return default
        if value < low:
            message = f"`{key}` is {value}, it must be at least {low}"
            self.error(
                "bad-range", message, self.span(key), f"write `{key} = {low}` or more, or leave it out"
            )
            return default
        if value > limit(most):
            message = f"`{key}` is {value}, but must be at most {limit(most):,}"
            self.error("bad-range", message, self.span(key), RAISE_LIMIT)
            return default
        return int(value)

    def number(self, key: str, default: Any, low: float | None = None, high: float | None = None) -> Any:
        value = self.take(key)
        if value is None:
            return default
        if not _is_number(value):
            self.wrong(key, "a number")
            return default
        below, above = low is not None and value < low, high is not None and value > high
        if below or above or not isfinite(value):
            wanted = f"at least {low:g}" if high is None and low is not None else f"from {low} to {high}"
            wanted = "finite" if low is None else wanted
            message = f"`{key}` is {value}, it must be {wanted}"
            self.error(
                "bad-range", message, self.span(key), "write another number, or leave it out for the default"
            )
            return default
        return float(value)

    def positive(self, key: str, default: Any, high: float) -> Any:
        found = self.number(key, default, 0, high)
        if found == 0:
            message = f"`{key}` is 0, it must be above 0"
            self.error("bad-range", message, self.span(key), f"write `{key} = {default}`, or leave it out")
            return default
        return found

    def boolean(self, key: str, default: bool) -> bool:
        value = self.take(key)
        if value is None or isinstance(value, bool):
            return default if value is None else value
        self.wrong(key, "true or false")
        return default

    def names(self, key: str, default: tuple[Name, ...] = ()) -> tuple[Name, ...]:
        """A list of names; a name alone is a list of one."""
        value = self.take(key)
        if value is None:
            return default
        if isinstance(value, str):
            return (Name(value, self.span(key)),)
        if not isinstance(value, list):
            self.wrong(key, "a list of names", hint=f'write `{key} = ["...", "..."]`')
            return ()
        found: dict[str, Name] = {}
        for index, item in enumerate(value):
            if not isinstance(item, str):
                self.wrong(key, "a list of names", index)
            elif item in found:
                message = f"`{item}` stands in `{key}` twice"
                self.error("duplicate-name", message, self.span(key, index), "leave one out")
            else:
                found[item] = Name(item, self.span(key, index))
        return tuple(found.values())

    def choices(
        self, key: str, default: tuple[Name, ...], what: str, known: tuple[str, ...]
    ) -> tuple[Name, ...]:
        """A list of names, each of which is known."""
        found = self.names(key, default)
        for one in found:
            if one.text not in known and one.span:
                hint = did_you_mean(one.text, known) or f"there are {quoted(known)}"
                self.error("unknown-choice", f"`{one}` is no {what}", one.span, hint)
        return found

    def unless_false(
        self, key: str, default: Any, off: object, read: Callable[..., Any], **limits: Any
    ) -> Any:
        """A key that `false` turns off."""
        if self.data.get(key) is not False:
            return read(self, key, default, **limits)
        self.take(key)
        return off

    def table(self, key: str) -> Section:
        """A table inside, also under a mistyped name, which is unknown then; empty if it is not there."""
        value = self.take(key)
        if value is None:
            tables = (one for one, found in self.data.items() if isinstance(found, dict))
            key = next((one for one in tables if did_you_mean(one, [key])), key)
            value = self.data.get(key)
        if value is not None and not isinstance(value, dict):
            self.wrong(key, "a table", hint=f"write `[{'.'.join((*self.path, key))}]` or `{key} = {{ ... }}`")
            value = None
        return Section(
            self.text, (*self.path, key), value or {}, self.diagnostics, self.homes, value is not None
        )

    def interval(self, key: str, default: tuple[int, int], most: int) -> tuple[int, int]:
        value = self.take(key)
        if value is None:
            return default
        if _is_int(value):
            value = [value, value]
        if not isinstance(value, list) or len(value) != 2 or not all(_is_int(one) for one in value):
            self.wrong(key, "a pair of whole numbers", hint=f"write `{key} = [1, 5]`")
            return default
        if value[1] > limit(most):
            message = f"`{key}` ends at {value[1]}, but must end at {limit(most):,} or lower"
            self.error("bad-range", message, self.span(key), RAISE_LIMIT)
            return default
        if not 0 <= value[0] <= value[1]:
            message = f"`{key}` is {value[0]} to {value[1]}, it must go up from 0 or more"
            self.error("bad-range", message, self.span(key), f"write `{key} = [1, 5]`")
            return default
        return value[0], value[1]

    def component(self, role: str, default: str | None, word: str = "kind") -> ComponentSpec | None:
        """This table as the part of a search; `word` is the key that names it."""
        kind = self.string(word, default)
        if kind is None:
            near = next((key for key in self.data if did_you_mean(key, [word])), None)
            if word not in self.data and near:
                message = f"unknown key `{near}` in {self.name}"
                self.error("unknown-key", message, self.text.key(*self.path, near), f"did you mean `{word}`?")
            elif word not in self.data and self.there:
                self.missing(word, f'write `{word} = "..."`')
            return None
        return self.options(role, kind.text, word)

    def options(self, role: str, kind: str | None = None, word: str | None = None) -> ComponentSpec:
        """This table as options, all but the key that names the kind; the kind is by default the role."""
        options = {key: value for key, value in self.data.items() if key != word}
        return ComponentSpec(role, kind or role, options, self.text, self.path)

    def chosen(self, key: str, default: ComponentSpec) -> ComponentSpec:
        """`key = { name = "...", option = ... }`, or the name alone."""
        value = self.data.get(key)
        if isinstance(value, str):
            self.take(key)
            return ComponentSpec(key, value, {}, self.text, (*self.path, key))
        table = self.table(key)
        if not table.data:
            return default
        return table.component(key, None, "name") or default

    def missing(self, key: str, hint: str) -> None:
        """Reports that a key is not there."""
        self.error("missing-key", f"{self.name} has no `{key}`", self.text.value(*self.path), hint)

    def finish(self) -> None:
        """Reports the keys that nobody asked for."""
        for key in self.data:
            if key not in self.asked:
                message = f"unknown key `{key}` in {self.name}"
                self.error("unknown-key", message, self.text.key(*self.path, key), self._hint(key))

    def _hint(self, key: str) -> str | None:
        near = did_you_mean(key, self.asked)
        homes = [name for name, keys in self.homes.items() if key in keys]
        home = (f"`[{homes[0]}]`" if homes[0] else "the top of the file") if homes else None
        if near and not (home and near != f"did you mean `{key}`?"):
            return near
        if home:
            before = ", before the first `[section]`" if home.startswith("the top") else ""
            return f"`{key}` belongs to {home}{before}"
        return near or (f"there are {quoted(self.asked)}" if self.asked else "leave it out: there are none")


def counts(
    section: Section, name: str, default: tuple[tuple[Name, tuple[int, int | None]], ...]
) -> tuple[tuple[Name, tuple[int, int | None]], ...]:
    """A table of names with bounds such as `"1..5"`."""
    section, found = section.table(name), [*default]
    for key in section.data:
        value = section.take(key)
        bounds = _bounds_of(value)
        span = section.span(key)
        if bounds is None:
            hint = 'write `"1..5"`, `"2..*"` or `3`'
            section.error("bad-range", f"`{key}` has no bounds for its number of matches", span, hint)
        elif bounds[1] is not None and bounds[1] < bounds[0]:
            section.error(
                "bad-range",
                "the upper bound is below the lower one",
                span,
                f'write `"{bounds[1]}..{bounds[0]}"`',
            )
        else:
            found.append((Name(key, section.text.key(*section.path, key)), bounds))
    return tuple(found)


def cover(section: Section, name: str, default: tuple[ComponentSpec, ...]) -> tuple[ComponentSpec, ...]:
    """A table of `measure = 20`, a number of bins, or `measure = { bins = 20, range = [0, 1] }`."""
    section, found = section.table(name), [*default]
    for key, value in section.data.items():
        if _is_int(value):
            section.take(key)
            found.append(ComponentSpec(key, key, {"bins": value}, section.text, (*section.path, key)))
        elif not isinstance(value, dict):
            section.take(key)
            section.wrong(key, "a number of bins", hint=f"write `{key} = 10`, or `{key} = {{ bins = 10 }}`")
        else:
            found.append(section.table(key).options(key))
    return tuple(found)


def _is_int(value: object) -> bool:
    """Return whether a TOML value is a whole number."""
    return isinstance(value, int) and not isinstance(value, bool)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def kind_of(value: object) -> str:
    """Return what a TOML value is, for messages."""
    match value:
        case bool():
            return "a truth value"
        case int():
            return "a whole number"
        case float():
            return "a fraction"
        case str():
            return "a string"
        case list():
            return "a list"
        case dict():
            return "a table"
    return "a date or time"


def _bounds_of(value: object) -> tuple[int, int | None] | None:
    """The numbers of `"1..5"`, `"2..*"`, `"3"`, `3` or `[1, 5]`; None for anything else."""
    if _is_int(value):
        return (value, value) if isinstance(value, int) and value >= 0 else None
    if isinstance(value, list) and len(value) == 2 and all(_is_int(one) and one >= 0 for one in value):
        return value[0], value[1]
    found = (
        re.fullmatch(r"\s*(\d{1,9})(?:\s*\.\.\s*(\d{1,9}|\*))?\s*", value) if isinstance(value, str) else None
    )
    if found is None:
        return None
    low, high = int(found.group(1)), found.group(2)
    return low, low if high is None else None if high == "*" else int(high)
