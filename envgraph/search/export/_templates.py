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
    escape_unprintable,
)
from envgraph.files import jinja_environment
from envgraph.lang import DiskFiles, read_source

_TEMPLATE_SUFFIX: Final = ".j2"

_MEMBER_NAME: Final = "member"
"""A template with this name in its path renders one file per member."""


class TemplateDirectory:
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
        template_paths: paths of the files in the directory, with `/`, sorted.
        used_names: the names that the templates use.
    """

    def __init__(self, folder: Path, known: Sequence[str]) -> None:
        hint = "run `envgraph templates DIR` to get the built-in templates"
        if not folder.is_dir():
            raise InvalidArgument(f"there is no directory `{folder}` of templates", hint)
        self._folder = folder
        self._environment = cache(partial(jinja_environment, FileSystemLoader(folder)))
        found = (path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
        self.template_paths = tuple(sorted(found))
        if not self.template_paths:
            raise InvalidArgument(f"directory `{folder}` has no templates in it", hint)
        self.used_names: set[str] = set()
        self._sources: dict[str, Source] = {}
        self._each: set[str] = set()
        problems = [one for place in self.template_paths for one in self._check_template(place, {*known})]
        if problems:
            raise LoadError(problems)

    def render_files(self, values: Mapping[str, Any], members: Sequence[Any]) -> dict[str, str | bytes]:
        """Render all templates, and return the content of the files by path (with `/`).

        Args:
            values: the values by the names that templates may use.
            members: the values of `member`, one after the other.

        Raises:
            InvalidArgument: a template renders an invalid path, or two templates render the same path.
            EvaluationError: an expression has no value or is not allowed; it has the position.
        """
        found: dict[str, str | bytes] = {}
        for place in self.template_paths:
            for given in [{_MEMBER_NAME: one} for one in members] if place in self._each else [{}]:
                self._render_file(place, {**values, **given}, found)
        return found

    def _render_file(self, place: str, values: Mapping[str, Any], found: dict[str, str | bytes]) -> None:
        target = self._render_text(place, self._environment("").from_string(place).render, values)
        name = target.removesuffix(_TEMPLATE_SUFFIX)
        if not name.rpartition("/")[2]:
            return
        content: str | bytes = (self._folder / place).read_bytes()
        if name != target:
            render = self._environment(PurePosixPath(name).suffix).get_template(place).render
            content = self._render_text(place, render, values)
            if not content.strip():
                return
        if any(part in ("", ".", "..") or not part.isprintable() for part in re.split(r"[/\\]", name)):
            raise InvalidArgument(
                f"the path of template `{place}` renders `{escape_unprintable(name)}`, which is not a valid path"
            )
        if name in found:
            hint = "write `{{member.name}}` in the path of a template that renders one file per member"
            raise InvalidArgument(f"two templates render `{name}`, the second is `{place}`", hint)
        found[name] = content

    def _render_text(self, place: str, render: Callable[..., str], values: Mapping[str, Any]) -> str:
        try:
            return render(values)
        except Exception as error:  # expressions of a template may raise anything
            source, line = self._read_source(place), 1
            for frame, number in walk_tb(error.__traceback__):
                for other in self._sources.values():
                    if frame.f_code.co_filename == other.name:
                        source, line = other, number
            raise EvaluationError(_error_message(error), _line_span(source, line)) from error

    # --- checks

    def _check_template(self, place: str, known: set[str]) -> Iterator[Diagnostic]:
        in_path, problems = self._check_names(Source(f"path of {place}", place), {*known, _MEMBER_NAME})
        yield from problems
        if _MEMBER_NAME in in_path:
            self._each.add(place)
        if place.endswith(_TEMPLATE_SUFFIX):
            try:
                source = self._read_source(place)
            except LoadError as error:
                yield from error.diagnostics
                return
            yield from self._check_names(source, known | (in_path & {_MEMBER_NAME}))[1]

    def _read_source(self, place: str) -> Source:
        if place not in self._sources:
            self._sources[place] = read_source(DiskFiles(), str(self._folder / place))
        return self._sources[place]

    def _check_names(self, source: Source, known: set[str]) -> tuple[set[str], list[Diagnostic]]:
        """Return the names that a template uses, and diagnostics for unknown names. The names are added to
        `used_names`.
        """
        try:
            tree = self._environment("").parse(source.text)
            names = find_undeclared_variables(tree) - {*self._environment("").globals}
        except TemplateSyntaxError as error:
            return set(), [Diagnostic("template-syntax", _error_message(error), _line_span(source, error.lineno))]
        self.used_names |= names
        return names, [_unknown_name_error(source, tree, name, known) for name in sorted(names - known)]


def _unknown_name_error(source: Source, tree: nodes.Template, name: str, known: set[str]) -> Diagnostic:
    line = next(one.lineno for one in tree.find_all(nodes.Name) if one.name == name)
    span, there_are = _line_span(source, line), f"there are {', '.join(sorted(known))}"
    found = re.search(rf"\b{re.escape(name)}\b", span.text)
    if found is not None:
        span = source.span_between(span.start + found.start(), span.start + found.end())
    if name == _MEMBER_NAME:
        there_are = "write `{{member.name}}` in the path of a template that uses `member`"
    return Diagnostic("unknown-name", f"unknown name `{name}`", span, did_you_mean(name, known) or there_are)


def _line_span(source: Source, line_number: int) -> Span:
    """Return the span of the line with this number, from 1, without its leading and trailing blanks."""
    start = len("".join(source.text.splitlines(keepends=True)[: line_number - 1]))
    text = source.line_text(line_number)
    return source.span_between(start + len(text) - len(text.lstrip()), start + max(len(text.rstrip()), 1))


def _error_message(error: Exception) -> str:
    """Return the first line of an exception's message, with a lower-case first letter and without a final full stop."""
    text = getattr(error, "message", None) or str(error) or type(error).__name__
    text = escape_unprintable(text.partition("\n")[0].rstrip("."))
    return text[:1].lower() + text[1:]
