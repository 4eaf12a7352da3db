"""The command `envgraph check`: report all problems of files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from envgraph.cli._inputs import Inputs
from envgraph.cli._output import print_diagnostics, print_json, print_line
from envgraph.errors import Diagnostic, InvalidArgument, LoadError, Severity, has_errors, sort_diagnostics


def check_files(
    files: Sequence[str],
    inputs: Inputs,
    ignore: Sequence[str],
    overrides: Sequence[str],
) -> int:
    """Print the errors and warnings of files, and their number; return exit code 1 if there are errors, otherwise 0.

    Args:
        files: files that are read together with the metamodels; each directory or family is read on its own.
        ignore: codes of warnings to leave out.
        overrides: settings that replace those of family files.
    """
    inputs.check_metamodels()
    if overrides and not any(_is_family(name) for name in files):
        raise InvalidArgument("`--set` needs a family file: name one, its directory or a bundled domain")
    found = dict.fromkeys(one for group in _group_files(files) for one in _collect_problems(group, inputs, overrides))
    diagnostics = tuple(one for one in found if one.severity is Severity.ERROR or one.code not in ignore)
    failed = has_errors(diagnostics)
    if not print_json(lambda: {"ok": not failed, "diagnostics": [one.to_dict() for one in diagnostics]}):
        print_diagnostics(diagnostics)
        print_line(_problem_counts(diagnostics) if diagnostics else f"no problems in {', '.join(files)}")
    return int(failed)


def _is_family(name: str) -> bool:
    from envgraph.lang import find_family

    try:
        find_family(name)
    except LoadError:
        return False
    return True


def _group_files(files: Sequence[str]) -> list[list[str]]:
    """Return the groups of files to read together: all single files in one, each directory or family on its own."""
    loose = [name for name in files if "." in Path(name).name and not name.endswith(".toml")]
    loose = [name for name in loose if not Path(name).is_dir()]
    return [[name] for name in files if name not in loose] + ([loose] if loose else [])


def _collect_problems(files: Sequence[str], inputs: Inputs, overrides: Sequence[str]) -> list[Diagnostic]:
    """Return the problems of files that are read together; for families, include the checks that a search makes."""
    from envgraph.lang import load_workspace

    try:
        named = [*inputs.metamodels, *files]
        workspace = load_workspace(named, allow_unresolved=inputs.allow_unresolved, overrides=tuple(overrides))
    except LoadError as error:
        return list(error.diagnostics)
    found = list(workspace.diagnostics)
    if workspace.families:
        from envgraph.search import check_component_options, check_domain

        ask = check_component_options if workspace.errors else check_domain
        found += [one for spec in workspace.families for one in ask(spec, workspace)]
        audited = [spec for spec in workspace.families if spec.audit is not None]
        if audited and not workspace.errors:
            from envgraph.learn.audit import check_audit

            found += [one for spec in audited for one in check_audit(spec, workspace)]
    return sort_diagnostics(found)


def _problem_counts(diagnostics: tuple[Diagnostic, ...]) -> str:
    errors = sum(diagnostic.severity == "error" for diagnostic in diagnostics)
    counts = ((errors, "error"), (len(diagnostics) - errors, "warning"))
    return ", ".join(f"{count} {word}{'s' if count > 1 else ''}" for count, word in counts if count)
