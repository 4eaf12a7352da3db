"""`envgraph check`."""

from __future__ import annotations

from envgraph.cli._output import OutputFormat, print_diagnostics, print_json
from envgraph.errors import Diagnostic, LoadError, has_errors


def check_files(files: list[str], format: OutputFormat) -> int:
    """Print all problems of the files; the exit code."""
    from envgraph.lang import load_workspace

    diagnostics: tuple[Diagnostic, ...]
    try:
        diagnostics = tuple(load_workspace(files).diagnostics)
    except LoadError as error:
        diagnostics = error.diagnostics
    failed = has_errors(diagnostics)
    if format is OutputFormat.JSON:
        print_json({"ok": not failed, "diagnostics": [diagnostic.to_dict() for diagnostic in diagnostics]})
    else:
        print_diagnostics(diagnostics)
        print(_summary(diagnostics) if diagnostics else f"no problems in {', '.join(files)}")
    return int(failed)


def _summary(diagnostics: tuple[Diagnostic, ...]) -> str:
    errors = sum(diagnostic.severity == "error" for diagnostic in diagnostics)
    counts = ((errors, "error"), (len(diagnostics) - errors, "warning"))
    return ", ".join(f"{count} {word}{'s' if count > 1 else ''}" for count, word in counts if count)
