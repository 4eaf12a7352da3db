"""Check and render directories of Jinja2 templates. Errors are reported with their positions."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial
from pathlib import Path, PurePosixPath
from traceback import walk_tb
from typing import Any, Final

from jinja2 import FileSystemLoader, TemplateSyntaxError, nodes
from jinja2.meta import find_undeclared_variables

from envgraph.errors import (
    Diagnostic,
    EvaluationError,
    InvalidArgument,
    LoadError,
    Source,
    Span,
    did_you_mean,
    visible,
)
from envgraph.files import jinja_environment
from envgraph.lang import DiskFiles, read_source

_ENDING: Final = ".j2"

_EACH: Final = "member"
"""A template with this name in its path renders one file per member."""


class Templates:
    """The templates of a directory, read and checked.

    A file `name.j2` is a template of the file `name`; other files are copied unchanged. Paths may contain expressions,
    too. A template with `member` in its path renders one file per member of the family. If its path or its text is
    empty, no file is written. Templates run in Jinja2's sandbox, so that they can only read the given values.

    Args:
        folder: the directory.
        known: the names that templates may use, besides `member`.

    Raises:
        InvalidArgument: the directory does not exist or is empty.
        LoadError: templates have errors; it contains all of them.

    Attributes:
        places: paths of the files in the directory, with `/`, sorted.
        used: the names that the templates use.
    """

    def __init__(self, folder: Path, known: Sequence[str]) -> None:
        hint = "run `envgraph templates DIR` to get the built-in templates"
        if not folder.is_dir():
            raise InvalidArgument(f"there is no directory `{folder}` of templates", hint)
        self._folder = folder
        self._environment = cache(partial(jinja_environment, FileSystemLoader(folder)))
        found = (path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
        self.places = tuple(sorted(found))
        if not self.places:
            raise InvalidArgument(f"directory `{folder}` has no templates in it", hint)
        self.used: set[str] = set()
        self._sources: dict[str, Source] = {}
        self._each: set[str] = set()
        problems = [one for place in self.places for one in self._check(place, {*known})]
        if problems:
            raise LoadError(problems)

    def files(self, values: Mapping[str, Any], members: Sequence[Any]) -> dict[str, str | bytes]:
        """Render all templates, and return the content of the files by path (with `/`).

        Args:
            values: the values by the names that templates may use.
            members: the values of `member`, one after the other.

        Raises:
            InvalidArgument: a template renders an invalid path, or two templates render the same path.
            EvaluationError: an expression has no value or is not allowed; it has the position.
        """
        found: dict[str, str | bytes] = {}
        for place in self.places:
            for given in [{_EACH: one} for one in members] if place in self._each else [{}]:
                self._make(place, {**values, **given}, found)
        return found

    def _make(self, place: str, values: Mapping[str, Any], found: dict[str, str | bytes]) -> None:
        target = self._rendered(place, self._environment("").from_string(place).render, values)
        name = target.removesuffix(_ENDING)
        if not name.rpartition("/")[2]:
            return
        content: str | bytes = (self._folder / place).read_bytes()
        if name != target:
            render = self._environment(PurePosixPath(name).suffix).get_template(place).render
            content = self._rendered(place, render, values)
            if not content.strip():
                return
        if any(part in ("", ".", "..") or not part.isprintable() for part in re.split(r"[/\\]", name)):
            raise InvalidArgument(
                f"the path of template `{place}` renders `{visible(name)}`, which is not a valid path"
            )
        if name in found:
            hint = "write `{{member.name}}` in the path of a template that renders one file per member"
            raise InvalidArgument(f"two templates render `{name}`, the second is `{place}`", hint)
        found[name] = content

    def _rendered(self, place: str, render: Callable[..., str], values: Mapping[str, Any]) -> str:
        try:
            return render(values)
        except Exception as error:  # expressions of a template may raise anything
            source, line = self._source(place), 1
            for frame, number in walk_tb(error.__traceback__):
                for other in self._sources.values():
                    if frame.f_code.co_filename == other.name:
                        source, line = other, number
            raise EvaluationError(_message(error), _line(source, line)) from error

    # --- checks

    def _check(self, place: str, known: set[str]) -> Iterator[Diagnostic]:
        in_path, problems = self._names(Source(f"path of {place}", place), {*known, _EACH})
        yield from problems
        if _EACH in in_path:
            self._each.add(place)
        if place.endswith(_ENDING):
            try:
                source = self._source(place)
            except LoadError as error:
                yield from error.diagnostics
                return
            yield from self._names(source, known | (in_path & {_EACH}))[1]

    def _source(self, place: str) -> Source:
        if place not in self._sources:
            self._sources[place] = read_source(DiskFiles(), str(self._folder / place))
        return self._sources[place]

    def _names(self, source: Source, known: set[str]) -> tuple[set[str], list[Diagnostic]]:
        """Return the names that a template uses, and diagnostics for unknown names. The names are added to `used`."""
        try:
            tree = self._environment("").parse(source.text)
            names = find_undeclared_variables(tree) - {*self._environment("").globals}
        except TemplateSyntaxError as error:
            return set(), [Diagnostic("template-syntax", _message(error), _line(source, error.lineno))]
        self.used |= names
        return names, [_unknown(source, tree, name, known) for name in sorted(names - known)]


def _unknown(source: Source, tree: nodes.Template, name: str, known: set[str]) -> Diagnostic:
    line = next(one.lineno for one in tree.find_all(nodes.Name) if one.name == name)
    span, there_are = _line(source, line), f"there are {', '.join(sorted(known))}"
    found = re.search(rf"\b{re.escape(name)}\b", span.text)
    if found is not None:
        span = source.span(span.start + found.start(), span.start + found.end())
    if name == _EACH:
        there_are = "write `{{member.name}}` in the path of a template that uses `member`"
    return Diagnostic("unknown-name", f"unknown name `{name}`", span, did_you_mean(name, known) or there_are)


def _line(source: Source, number: int) -> Span:
    """Return the span of the line with this number, from 1, without its leading and trailing blanks."""
    start = len("".join(source.text.splitlines(keepends=True)[: number - 1]))
    text = source.line(number)
    return source.span(start + len(text) - len(text.lstrip()), start + max(len(text.rstrip()), 1))


def _message(error: Exception) -> str:
    """Return the first line of an exception's message, with a lower-case first letter and without a final full stop."""
    text = getattr(error, "message", None) or str(error) or type(error).__name__
    text = visible(text.partition("\n")[0].rstrip("."))
    return text[:1].lower() + text[1:]
