"""The command `envgraph format`: write files in the standard style."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from envgraph.cli._output import print_diagnostics, print_line
from envgraph.errors import (
    Diagnostic,
    InvalidArgument,
    LoadError,
    Severity,
    Source,
    count_with_noun,
    has_errors,
)
from envgraph.files import replace_file

STDIN = "-"


def format_files(files: Sequence[str], *, check: bool, stdout: bool, language: str | None, derived: bool) -> int:
    """Format files in the standard style; return the exit code.

    The exit code is 1 if a file has errors or, with `check`, if a file would change. With `derived`, print the patterns
    and rules that `derive` statements produce, and write nothing. Family files, which are TOML, are skipped with a
    warning, so that a wildcard may name all files of a domain.

    Raises:
        InvalidArgument: standard input is mixed with files, or its language is missing.
        OSError: a file cannot be written.
    """
    if derived:
        return _print_derived(files)
    if STDIN in files:
        return _format_input(files, check, language)
    diagnostics: list[Diagnostic] = []
    changed = 0
    names = _list_files(files)
    for name in names:
        if name.endswith(".toml"):
            place = Source(name, "").span_between(0, 0)
            diagnostics.append(
                Diagnostic(
                    "not-formatted",
                    "skipped: family files (TOML) are not formatted",
                    place,
                    severity=Severity.WARNING,
                )
            )
            continue
        try:
            text, formatted = _format_file(name)
        except LoadError as error:
            diagnostics += error.diagnostics
            continue
        if stdout:
            _write_stdout(formatted)
        elif text != formatted:
            changed += 1
            if not check:
                replace_file(Path(name), formatted)
            print_line(f"{'would format' if check else 'formatted'} {name}")
    print_diagnostics(diagnostics)
    failed = has_errors(diagnostics)
    if not (stdout or changed or diagnostics):
        print_line(f"nothing to format in {count_with_noun(len(names), 'file')}")
    return int(failed or (check and changed > 0))


def _print_derived(files: Sequence[str]) -> int:
    """Print the patterns and rules that the derivations of files produce, as `.query` and `.rules` texts.

    Raises:
        LoadError: the files, or their imports, have errors.
        InvalidArgument: the files contain no derivations.
    """
    from envgraph.lang import load_workspace, spelled_out, to_text
    from envgraph.rewrite import derived

    workspace = load_workspace(files)
    workspace.raise_errors()
    own = [one for one in workspace.derivations if one.span and one.span.source.name in workspace.roots]
    if not own or workspace.metamodel is None:
        raise InvalidArgument(f"{', '.join(files)}: no `derive` statement found")
    for one in own:
        made = derived(one, workspace.metamodel)
        patterns = to_text(*spelled_out(made.patterns, workspace.metamodel))
        rules = to_text(*spelled_out(made.rules, workspace.metamodel))
        for what, text in (("patterns", patterns), ("rules", rules)):
            if text:
                _write_stdout(f"// --- {what} of `{one.qualified_name}` ---\n\n{text}\n")
    return 0


def _format_input(files: Sequence[str], check: bool, language: str | None) -> int:
    from envgraph.lang import LANGUAGES, TextFiles, format_text, read_source

    class Input(TextFiles):
        """Standard input as a file, so that errors in it can be reported."""

        data = sys.stdin.buffer.read()

        def read(self, name: str, most: int = 0) -> bytes:
            """Return the whole standard input."""
            return self.data

    if len(files) > 1:
        raise InvalidArgument("`-` (standard input) cannot be combined with files")
    if language is None:
        raise InvalidArgument(f"`-` needs `--language`, with one of {', '.join(LANGUAGES)}")
    if language not in LANGUAGES:
        raise InvalidArgument(f"unknown language `{language}`; use one of {', '.join(LANGUAGES)}")
    text = read_source(Input({}), "<stdin>").text
    formatted = format_text(language, text, "<stdin>")
    if not check:
        _write_stdout(formatted)
    return int(check and text != formatted)


def _list_files(files: Sequence[str]) -> list[str]:
    """Return the names of the files and of all formattable files in the directories, each once.

    Raises:
        InvalidArgument: a directory contains no file in a language of envgraph.
    """
    from envgraph.lang import DiskFiles, language_of

    disk = DiskFiles()
    found: list[str] = []
    for name in map(disk.name, files):
        inside = disk.entries(name) if disk.is_directory(name) else [name]
        known = [one for one in inside if one == name or language_of(one)]
        if not known:
            raise InvalidArgument(f"`{name}` contains no file in a language of envgraph")
        found += known
    return list(dict.fromkeys(found))


def _format_file(name: str) -> tuple[str, str]:
    """Return the text of a file, before and after formatting; raise LoadError if it has errors or an unknown type."""
    from envgraph.lang import LANGUAGES, DiskFiles, format_text, language_of, read_source

    language = language_of(name)
    if language is None and DiskFiles().exists(name):
        message = f"`{name}` is not a file in a language of envgraph"
        hint = "name a file that ends in " + ", ".join(f".{one}" for one in (*LANGUAGES, "vql"))
        raise LoadError([Diagnostic("unknown-language", message, Source(name, "").span_between(0, 0), hint)])
    source = read_source(DiskFiles(), name)
    assert language is not None  # An unknown file was refused before.
    return source.text, format_text(language, source.text, name)


def _write_stdout(text: str) -> None:
    # print() would change line ends.
    sys.stdout.flush()
    sys.stdout.buffer.write(text.encode())
    sys.stdout.buffer.flush()
