"""Print results, problems and progress.

Results go to standard output, everything else to standard error, so that the output of `--format json` can be piped.
With that option only `print_json` prints on standard output. Texts may come from files: `escape_unprintable` escapes
their control characters, and all of this package prints through this module.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Final, Protocol

import click

from envgraph.errors import Diagnostic, EnvgraphError, Severity, escape_unprintable
from envgraph.files import replace_file, report_progress

_MAX_STYLED_ROWS: Final = 2000
"""The maximum number of rows of a styled table; longer tables are printed as plain text."""

_MAX_CODES: Final = 3
"""The maximum number of codes in the last line after errors. Who gets more errors corrects these first."""


class UpdateProgress(Protocol):
    """A callback that updates a progress bar."""

    def __call__(self, done: int, remark: str = "") -> None:
        """Set the amount done, and show the remark beside the bar."""


@contextmanager
def output_to_file(output: Path | None, format: str) -> Iterator[None]:
    """Redirect the standard output of the block to a file and use `format` in it; with None, only run the block."""
    if output is None:
        yield
        return
    formats = click.get_current_context().find_root().obj
    formats.append(format)
    try:
        with redirect_stdout(StringIO()) as printed:
            yield
    finally:
        formats.pop()
    replace_file(output, printed.getvalue())
    _write_line(f"wrote {output}")


def wants_json() -> bool:
    """Return True if the running command prints JSON, according to the last format recorded."""
    context = click.get_current_context(silent=True)
    return context is not None and context.find_root().obj[-1:] == ["json"]


def _write_line(line: str) -> None:
    sys.stdout.write(escape_unprintable(line) + "\n")


def print_line(text: str) -> None:
    """Print a line on standard output, unless the output format is JSON."""
    if not wants_json():
        _write_line(text)


def print_lines(text: str) -> None:
    """Print a text of several lines, tabs included, unless the output format is JSON."""
    if not wants_json():
        sys.stdout.write("".join(line + "\n" for line in _visible_lines(text)))


def print_styled_lines(text: str, styles: Mapping[str, str]) -> None:
    """Print a text of several lines; on a terminal, lines with a prefix in `styles` are printed in its style."""
    if not sys.stdout.isatty():
        print_lines(text)
        return
    from rich.console import Console
    from rich.text import Text

    console = Console(soft_wrap=True, highlight=False)
    for line in _visible_lines(text):
        console.print(Text(line, next((style for start, style in styles.items() if line.startswith(start)), "")))


def _visible_lines(text: str) -> list[str]:
    return ["\t".join(map(escape_unprintable, line.split("\t"))) for line in text.split("\n")]


def print_json(value: Callable[[], object]) -> bool:
    """Print a JSON document, which `value` computes, if the output format is JSON; return True if it is."""
    if wanted := wants_json():
        write_json(value())
    return wanted


def write_json(value: object) -> None:
    """Write a JSON document on standard output."""
    try:
        "\N{GREEK SMALL LETTER ALPHA}".encode(sys.stdout.encoding or "utf-8")
        narrow = False
    except UnicodeEncodeError:
        narrow = True
    sys.stdout.write(escape_json(json.dumps(value, ensure_ascii=narrow, indent=2)) + "\n")


def escape_json(text: str) -> str:
    """Return the same JSON document with control characters escaped, which a terminal might otherwise interpret."""
    if text.replace("\n", "").isprintable():
        return text
    return "".join(c if c.isprintable() or c == "\n" else json.dumps(c)[1:-1] for c in text)


def print_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]], right: Iterable[int] = ()) -> None:
    """Print a title and a table, unless the output format is JSON; `right` has the indices of right-aligned columns."""
    if wants_json():
        return
    title, columns = escape_unprintable(title), [escape_unprintable(column) for column in columns]
    rows = [[escape_unprintable(cell) for cell in row] for row in rows]
    if len(rows) > _MAX_STYLED_ROWS or not sys.stdout.isatty():
        _print_unstyled_table(title, columns, rows, frozenset(right))
        return
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(header_style="bold", box=None, pad_edge=False)
    for place, column in enumerate(columns):
        table.add_column(
            Text(column), justify="right" if place in set(right) else "left", no_wrap=not place, overflow="fold"
        )
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    console = Console(highlight=False)
    # The table's own title would be wrapped to the width of the table.
    console.print(Text(title, "bold"))
    console.print(table)


def _print_unstyled_table(
    title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], right: frozenset[int]
) -> None:
    """Print a table without colours and line breaks, because Rich needs a minute for a million rows."""
    from rich.cells import cell_len

    lines = [columns, *rows]
    widths = [max(map(cell_len, column)) for column in zip(*lines, strict=True)]
    encoding = sys.stdout.encoding or "utf-8"
    sys.stdout.write(f"{title}\n")
    for line in lines:
        cells = (
            " " * (width - cell_len(cell)) + cell if place in right else cell + " " * (width - cell_len(cell))
            for place, (cell, width) in enumerate(zip(line, widths, strict=True))
        )
        text = "  ".join(cells).rstrip() + "\n"
        sys.stdout.write(text.encode(encoding, "backslashreplace").decode(encoding))


def print_diagnostics(diagnostics: Iterable[Diagnostic], first: bool = True) -> None:
    """Print diagnostics on standard error, separated by blank lines, also from earlier ones; coloured on a terminal.

    A last line names the command that explains the codes of the errors.
    """
    diagnostics = list(diagnostics)
    if not diagnostics:
        return
    from rich.console import Console
    from rich.text import Text

    console = Console(stderr=True, soft_wrap=True, highlight=False)
    for number, diagnostic in enumerate(diagnostics):
        if number or not first:
            console.print()
        head, *rest = str(diagnostic).split("\n")
        console.print(Text(head, "bold red" if diagnostic.severity is Severity.ERROR else "bold yellow"))
        for line in rest:
            console.print(Text(line, "cyan" if line.startswith("hint:") else ""))
    codes = dict.fromkeys(one.code for one in diagnostics if one.severity is Severity.ERROR)
    if codes:  # warnings show their code themselves
        console.print(Text(f"\nmore: envgraph help {' '.join([*codes][:_MAX_CODES])}", "dim"))


def print_error(error: EnvgraphError | OSError) -> None:
    """Print the diagnostics of an exception, or else its message, on standard error."""
    diagnostics: tuple[Diagnostic, ...] = getattr(error, "diagnostics", ())
    if diagnostics:
        print_diagnostics(diagnostics)
        return
    from rich.console import Console
    from rich.text import Text

    console = Console(stderr=True, soft_wrap=True, highlight=False)
    head, *rest = _visible_lines(_error_message(error))
    console.print(Text("error: ", "bold red") + Text(head))
    for line in rest:
        console.print(Text(line))


def diagnostics_of(error: EnvgraphError | OSError) -> Sequence[Diagnostic]:
    """Return the diagnostics of an exception, or else one with its message."""
    code = re.sub("(?<=[a-z])(?=[A-Z])", "-", type(error).__name__).lower()
    whole = Diagnostic(code if isinstance(error, EnvgraphError) else "file-error", _error_message(error))
    return getattr(error, "diagnostics", ()) or [whole]


def error_to_dict(error: EnvgraphError | OSError) -> dict[str, object]:
    """Return an exception in the JSON form of `envgraph check --format json`."""
    return {"ok": False, "diagnostics": [one.to_dict() for one in diagnostics_of(error)]}


def _error_message(error: EnvgraphError | OSError) -> str:
    if isinstance(error, OSError):
        what = error.strerror or str(error)
        return f"{error.filename or 'standard output'}: {what[:1].lower()}{what[1:]}"
    return str(error)


@contextmanager
def progress_bar(label: str, total: int | None) -> Iterator[UpdateProgress]:
    """Show a progress bar on standard error while the block runs; yield the callback that updates it.

    Without a terminal, a few lines are printed instead (see `report_progress`).
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[remark]}", markup=False),
    )
    console = Console(stderr=True)
    if not console.is_terminal:
        end = "" if total is None else f" of {total}"
        with report_progress() as tell:
            yield lambda done, remark="": tell(f"{label}: {done}{end}" + (remark and f", {remark}"))
        return
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(escape_unprintable(label), total=total, remark="")

        def advance(done: int, remark: str = "") -> None:
            progress.update(task, completed=done)
            tell(remark)

        with report_progress(lambda text: progress.update(task, remark=text)) as tell:
            yield advance
