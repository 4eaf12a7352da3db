"""Read the keys of one table of a family file, and report every error with its span."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import field, fields
from functools import partial
from math import isfinite
from typing import Any, TypeVar

from envgraph.code import dataclass
from envgraph.errors import RAISE_LIMIT_HINT, Diagnostic, Span, did_you_mean, quote_names, scaled_limit
from envgraph.lang.syntax._toml_parser import TomlText

Spec = TypeVar("Spec")

# The hint for each expected type.
_TYPE_HINTS = {
    "a string": 'write `{} = "..."`',
    "a whole number": "write `{} = 3`, without decimals and without quotation marks",
    "a number": "write `{} = 0.5`, without quotation marks",
    "true or false": "write `{0} = true` or `{0} = false`",
    "a list of names": 'write names in quotation marks: `{} = ["...", "..."]`',
}


@dataclass(frozen=True, slots=True)
class LocatedName:
    """A name in a family file and its span."""

    text: str
    span: Span | None = field(default=None, compare=False, repr=False)

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, slots=True)
class ComponentSpec:
    """The kind and the options of a replaceable part of the search, such as a measure or a selection.

    Attributes:
        name: the user's name of a measure; for all others their role ("diversity", "parents" ..).
        kind: the name of the implementation ("path_complexity", "random" ...).
        options: all other keys of the table.
        text, path: the family file, and the path of the table in it; None if the spec was built in Python.
    """

    name: str
    kind: str
    options: Mapping[str, object] = field(default_factory=dict)
    text: TomlText | None = field(default=None, compare=False, repr=False)
    path: tuple[str, ...] = field(default=(), compare=False, repr=False)

    def span(self, option: str | None = None, *item: int) -> Span | None:
        """Return the span of an option's value, or of an item in it; the span of the table if the option is missing.

        Without an option, return the span of the kind. Return None if the spec was built in Python.
        """
        if self.text is None:
            return None
        named = "kind" if (*self.path, "kind") in self.text.values else "name"
        return self.text.value_span(*self.path, named if option is None else option, *item)

    def key_span(self, *option: str) -> Span | None:
        """Return the span of the key of an option; without an option, the span of the table's name."""
        return self.text.key_span(*self.path, *option) if self.text else None


def key(default: Any, read: Callable[..., Any], /, **limits: Any) -> Any:
    """Return a dataclass field that is read from the key of the same name in a table or component.

    Args:
        default: the value if the key is missing.
        read: a method of `TableReader` or `Options` that takes the key, the default and the limits.
        **limits: keyword arguments of `read`.
    """
    return field(default=default, metadata={"read": partial(read, **limits)})


@dataclass(slots=True)
class TableReader:
    """A reader of one table. Each method reads a key; keys that were never read are unknown, and `finish` reports them.

    Attributes:
        path: the path of the table's name.
        known_keys: the keys of each table of the file, for hints; "" stands for the top of the file.
        exists: True if the file has this table.
    """

    text: TomlText
    path: tuple[str, ...]
    data: Mapping[str, Any]
    diagnostics: list[Diagnostic]
    known_keys: Mapping[str, Collection[str]]
    exists: bool = True
    read_keys: dict[str, None] = field(default_factory=dict)

    def __contains__(self, key: str) -> bool:
        return key in self.data

    def span(self, *path: str | int) -> Span:
        return self.text.value_span(*self.path, *path)

    @property
    def name(self) -> str:
        """Return the name of the table in messages."""
        return f"`[{'.'.join(self.path)}]`" if self.path else "the file"

    def error(self, code: str, message: str, span: Span, hint: str | None = None) -> None:
        known = bool(self.text.source.name)  # Tables built in Python have no text.
        self.diagnostics.append(Diagnostic(code, message, span if known else None, hint))

    def report_wrong_type(self, key: str, wanted: str, *path: str | int, hint: str | None = None) -> None:
        value: Any = self.data[key]
        for step in path:
            value = value[step]
        hint = hint or _TYPE_HINTS.get(wanted, "").format(key) or None
        self.error(
            "wrong-type",
            f"`{key}` must be {wanted}, not {describe_toml_value(value)}",
            self.span(key, *path),
            hint,
        )

    def raw_value(self, key: str) -> Any:
        self.read_keys[key] = None
        return self.data.get(key)

    def read(self, spec: type[Spec]) -> Spec:
        """Return the table as an instance of a dataclass whose fields are made by `key`; report unknown keys."""
        made: Any = spec
        found = {one.name: one.metadata["read"](self, one.name, one.default) for one in fields(made)}
        self.finish()
        return spec(**found)

    def string(self, key: str, default: str | None = None) -> LocatedName | None:
        value = self.raw_value(key)
        if value is None:
            return None if default is None else LocatedName(default)
        if not isinstance(value, str):
            self.report_wrong_type(key, "a string")
            return None
        if not value.strip():
            self.error("bad-value", f"`{key}` is empty", self.span(key), "write a name, or leave the key out")
            return None
        return LocatedName(value, self.span(key))

    def _typed_value(self, key: str, wanted: str, fits: Callable[[object], bool]) -> Any:
        """Return the value of a key; None if it is missing, or of another type than `wanted`, which is reported."""
        value = self.raw_value(key)
        if value is None or fits(value):
            return value
        self.report_wrong_type(key, wanted)
        return None

    def choice(self, key: str, default: str, known: Iterable[str]) -> str:
        value = self.string(key, default)
        names = tuple(known)
        if value is None or value.text in names:
            return value.text if value else default
        known = f"write `{names[0]}`" if len(names) == 1 else f"use one of {quote_names(names)}"
        hint = did_you_mean(value.text, names) or known
        self.error("unknown-choice", f"`{key}` cannot be `{value}`", self.span(key), hint)
        return default

    def integer(self, key: str, default: Any, low: int, most: str) -> Any:
        value = self._typed_value(key, "a whole number", _is_int)
        if value is None:
            return default
        if value < low:
            message = f"`{key}` is {value}, but must be at least {low}"
            self.error("bad-range", message, self.span(key), f"write `{key} = {low}` or more, or leave it out")
            return default
        if value > scaled_limit(most):
            message = f"`{key}` is {value}, but must be at most {scaled_limit(most):,}"
            self.error("bad-range", message, self.span(key), RAISE_LIMIT_HINT)
            return default
        return int(value)

    def number(self, key: str, default: Any, low: float | None = None, high: float | None = None) -> Any:
        value = self._typed_value(key, "a number", _is_number)
        if value is None:
            return default
        below, above = low is not None and value < low, high is not None and value > high
        if below or above or not isfinite(value):
            wanted = f"at least {low:g}" if high is None and low is not None else f"from {low} to {high}"
            wanted = "finite" if low is None else wanted
            message = f"`{key}` is {value}, but must be {wanted}"
            self.error("bad-range", message, self.span(key), "write another number, or leave it out for the default")
            return default
        return float(value)

    def positive(self, key: str, default: Any, high: float) -> Any:
        found = self.number(key, default, 0, high)
        if found == 0:
            message = f"`{key}` is 0, but must be above 0"
            self.error("bad-range", message, self.span(key), f"write `{key} = {default}`, or leave it out")
            return default
        return found

    def boolean(self, key: str, default: bool) -> bool:
        value = self._typed_value(key, "true or false", lambda value: isinstance(value, bool))
        return default if value is None else bool(value)

    def names(self, key: str, default: tuple[LocatedName, ...] = ()) -> tuple[LocatedName, ...]:
        """Return a list of names, or a single name as a list; report and leave out duplicates and other values."""
        value = self.raw_value(key)
        if value is None:
            return default
        if isinstance(value, str):
            return (LocatedName(value, self.span(key)),)
        if not isinstance(value, list):
            self.report_wrong_type(key, "a list of names", hint=f'write `{key} = ["...", "..."]`')
            return ()
        found: dict[str, LocatedName] = {}
        for index, item in enumerate(value):
            if not isinstance(item, str):
                self.report_wrong_type(key, "a list of names", index)
            elif item in found:
                message = f"`{item}` occurs twice in `{key}`"
                self.error("duplicate-name", message, self.span(key, index), "leave one out")
            else:
                found[item] = LocatedName(item, self.span(key, index))
        return tuple(found.values())

    def choices(
        self, key: str, default: tuple[LocatedName, ...], what: str, known: tuple[str, ...]
    ) -> tuple[LocatedName, ...]:
        """Return a list of names; report names that are not in `known` as an unknown `what`, but keep them."""
        found = self.names(key, default)
        for one in found:
            if one.text not in known and one.span:
                hint = did_you_mean(one.text, known) or f"use one of {quote_names(known)}"
                self.error("unknown-choice", f"`{one}` is not a known {what}", one.span, hint)
        return found

    def unless_false(self, key: str, default: Any, false_value: object, read: Callable[..., Any], **limits: Any) -> Any:
        """Return `false_value` if the value of the key is `false`; otherwise read the key with `read`."""
        if self.data.get(key) is not False:
            return read(self, key, default, **limits)
        self.raw_value(key)
        return false_value

    def table(self, key: str) -> TableReader:
        """Return the nested table of this key; an empty one if it is missing or not a table, which is reported.

        If it is missing, a table with a similar name is read instead; `finish` then reports that name as unknown.
        """
        value = self.raw_value(key)
        if value is None:
            tables = (one for one, found in self.data.items() if isinstance(found, dict))
            key = next((one for one in tables if did_you_mean(one, [key])), key)
            value = self.data.get(key)
        if value is not None and not isinstance(value, dict):
            self.report_wrong_type(
                key, "a table", hint=f"write `[{'.'.join((*self.path, key))}]` or `{key} = {{ ... }}`"
            )
            value = None
        return TableReader(
            self.text, (*self.path, key), value or {}, self.diagnostics, self.known_keys, value is not None
        )

    def interval(self, key: str, default: tuple[int, int], most: str) -> tuple[int, int]:
        value = self.raw_value(key)
        if value is None:
            return default
        if _is_int(value):
            value = [value, value]
        if not isinstance(value, list) or len(value) != 2 or not all(_is_int(one) for one in value):
            self.report_wrong_type(key, "a pair of whole numbers", hint=f"write `{key} = [1, 5]`")
            return default
        if value[1] > scaled_limit(most):
            message = f"`{key}` ends at {value[1]}, but must end at {scaled_limit(most):,} or lower"
            self.error("bad-range", message, self.span(key), RAISE_LIMIT_HINT)
            return default
        if not 0 <= value[0] <= value[1]:
            message = f"`{key}` is {value[0]} to {value[1]}, but must be in ascending order and not negative"
            self.error("bad-range", message, self.span(key), f"write `{key} = [1, 5]`")
            return default
        return value[0], value[1]

    def component(self, role: str, default: str | None, word: str = "kind") -> ComponentSpec | None:
        """Return this table as a component with a role such as "parents"; its kind is the value of the key `word`.

        If this key is missing and `default` (a kind) is None, report this and return None.
        """
        kind = self.string(word, default)
        if kind is None:
            near = next((key for key in self.data if did_you_mean(key, [word])), None)
            if word not in self.data and near:
                message = f"unknown key `{near}` in {self.name}"
                self.error("unknown-key", message, self.text.key_span(*self.path, near), f"did you mean `{word}`?")
            elif word not in self.data and self.exists:
                self.report_missing(word, f'write `{word} = "..."`')
            return None
        return self.options(role, kind.text, word)

    def options(self, role: str, kind: str | None = None, word: str | None = None) -> ComponentSpec:
        """Return this table as a component whose options are all keys but `word`; the kind is by default the role."""
        options = {key: value for key, value in self.data.items() if key != word}
        return ComponentSpec(role, kind or role, options, self.text, self.path)

    def named_component(self, key: str, default: ComponentSpec) -> ComponentSpec:
        """Read a component `key = { name = "...", option = ... }` or `key = "..."`; return `default` if missing."""
        value = self.data.get(key)
        if isinstance(value, str):
            self.raw_value(key)
            return ComponentSpec(key, value, {}, self.text, (*self.path, key))
        table = self.table(key)
        if not table.data:
            return default
        return table.component(key, None, "name") or default

    def report_missing(self, key: str, hint: str) -> None:
        """Report that a required key is missing."""
        self.error("missing-key", f"{self.name} has no `{key}`", self.text.value_span(*self.path), hint)

    def finish(self) -> None:
        """Report all keys that were not read as unknown."""
        for key in self.data:
            if key not in self.read_keys:
                message = f"unknown key `{key}` in {self.name}"
                self.error("unknown-key", message, self.text.key_span(*self.path, key), self._hint(key))

    def _hint(self, key: str) -> str | None:
        near = did_you_mean(key, self.read_keys)
        homes = [name for name, keys in self.known_keys.items() if key in keys]
        home = (f"`[{homes[0]}]`" if homes[0] else "the top of the file") if homes else None
        if near and not (home and near != f"did you mean `{key}`?"):
            return near
        if home:
            before = ", before the first `[section]`" if home.startswith("the top") else ""
            return f"`{key}` belongs to {home}{before}"
        return near or (
            f"the keys here are {quote_names(self.read_keys)}"
            if self.read_keys
            else "remove it: no keys are allowed here"
        )


def read_match_counts(
    section: TableReader, name: str, default: tuple[tuple[LocatedName, tuple[int, int | None]], ...]
) -> tuple[tuple[LocatedName, tuple[int, int | None]], ...]:
    """Return `default` and the names of a table with bounds such as `"1..5"`; report and leave out wrong bounds."""
    section, found = section.table(name), [*default]
    for key in section.data:
        value = section.raw_value(key)
        bounds = _parse_bounds(value)
        span = section.span(key)
        if bounds is None:
            hint = 'write `"1..5"`, `"2..*"` or `3`'
            section.error("bad-range", f"the number of matches of `{key}` must be a number or a range", span, hint)
        elif bounds[1] is not None and bounds[1] < bounds[0]:
            section.error(
                "bad-range",
                "the upper bound is below the lower one",
                span,
                f'write `"{bounds[1]}..{bounds[0]}"`',
            )
        else:
            found.append((LocatedName(key, section.text.key_span(*section.path, key)), bounds))
    return tuple(found)


def read_cover(section: TableReader, name: str, default: tuple[ComponentSpec, ...]) -> tuple[ComponentSpec, ...]:
    """Return the measures of a table with their bins: `measure = 20`, or `measure = { bins = 20, range = [0, 1] }`."""
    section, found = section.table(name), [*default]
    for key, value in section.data.items():
        if _is_int(value):
            section.raw_value(key)
            found.append(ComponentSpec(key, key, {"bins": value}, section.text, (*section.path, key)))
        elif not isinstance(value, dict):
            section.raw_value(key)
            section.report_wrong_type(key, "a number of bins", hint=f"write `{key} = 10`, or `{key} = {{ bins = 10 }}`")
        else:
            found.append(section.table(key).options(key))
    return tuple(found)


def _is_int(value: object) -> bool:
    """Return True if a TOML value is an integer; booleans are not."""
    return isinstance(value, int) and not isinstance(value, bool)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def describe_toml_value(value: object) -> str:
    """Return a phrase for the type of a TOML value, for error messages, such as "a string"."""
    match value:
        case bool():
            return "a boolean"
        case int():
            return "a whole number"
        case float():
            return "a decimal number"
        case str():
            return "a string"
        case list():
            return "a list"
        case dict():
            return "a table"
    return "a date or time"


def _parse_bounds(value: object) -> tuple[int, int | None] | None:
    """Return the bounds in `"1..5"`, `"2..*"`, `"3"`, `3` or `[1, 5]` (None for `*`); None for any other value."""
    if _is_int(value):
        return (value, value) if isinstance(value, int) and value >= 0 else None
    if isinstance(value, list) and len(value) == 2 and all(_is_int(one) and one >= 0 for one in value):
        return value[0], value[1]
    found = re.fullmatch(r"\s*(\d{1,9})(?:\s*\.\.\s*(\d{1,9}|\*))?\s*", value) if isinstance(value, str) else None
    if found is None:
        return None
    low, high = int(found.group(1)), found.group(2)
    return low, low if high is None else None if high == "*" else int(high)
