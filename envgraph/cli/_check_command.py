"""The command `envgraph check`: report all problems of files."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from envgraph.cli._inputs import Inputs
from envgraph.cli._output import diagnostics_of, print_diagnostics, print_json, print_line, wants_json
from envgraph.errors import (
    WARNING_CODES,
    Diagnostic,
    EnvgraphError,
    InvalidArgument,
    LoadError,
    Severity,
    has_errors,
    name_hint,
    sort_diagnostics,
)

if TYPE_CHECKING:
    from envgraph.lang import FamilySpec, Workspace


def check_files(
    files: Sequence[str],
    inputs: Inputs,
    ignore: Sequence[str],
    overrides: Sequence[str],
    no_search: bool,
) -> int:
    """Print the errors and warnings of files, and their number; return exit code 1 if there are errors, otherwise 0.

    What takes long, the search of a family, is done last, and only if its files have no errors.

    Args:
        files: files that are read together with the metamodels; each directory or family is read on its own.
        ignore: codes of warnings to leave out.
        overrides: settings that replace those of family files.
        no_search: True to leave out the searches.
    """
    from envgraph.lang import NEED_ENVIRONMENT

    for code in ignore:
        if code not in WARNING_CODES:
            raise InvalidArgument(f"there is no warning `{code}`", name_hint(code, WARNING_CODES))
    inputs.check_metamodels()
    diagnostics: dict[Diagnostic, None] = {}

    def report(problems: Iterable[Diagnostic]) -> None:
        kept = (one for one in problems if one.severity is Severity.ERROR or one.code not in ignore)
        new = {one: None for one in kept if one not in diagnostics}
        if not wants_json():
            print_diagnostics(new, first=not diagnostics)
        diagnostics.update(new)

    read = [_collect_problems(group, inputs, overrides) for group in _group_files(files)]
    if overrides and not any(workspace is None or workspace.families for _, workspace in read):
        raise InvalidArgument("`--set` needs a family file: name one, its directory or a bundled domain")
    report(one for problems, _ in read for one in problems)
    unsearched = ""
    for problems, workspace in () if no_search else read:
        for spec in workspace.families if workspace else ():
            if workspace and not has_errors(problems):
                report(_domain_problems(spec, workspace, search=True))
            elif spec.constraints.reachable or any(one.kind in NEED_ENVIRONMENT for one in spec.measures):
                unsearched += f"; the states of `{spec.name}` were not searched"
    failed = has_errors(diagnostics)
    if not print_json(lambda: {"ok": not failed, "diagnostics": [one.to_dict() for one in diagnostics]}):
        counts = _problem_counts(diagnostics) if diagnostics else f"no problems in {', '.join(files)}"
        print_line(counts + unsearched)
    return int(failed)


def _group_files(files: Sequence[str]) -> list[list[str]]:
    """Return the groups of files to read together: all single files in one, each directory or family on its own."""
    loose = [name for name in files if "." in Path(name).name and not name.endswith(".toml")]
    loose = [name for name in loose if not Path(name).is_dir()]
    return [[name] for name in files if name not in loose] + ([loose] if loose else [])


def _collect_problems(
    files: Sequence[str], inputs: Inputs, overrides: Sequence[str]
) -> tuple[list[Diagnostic], Workspace | None]:
    """Return the problems of files that are read together, but for those that a search finds, and what was read."""
    from envgraph.lang import load_workspace

    try:
        named = [*inputs.metamodels, *files]
        workspace = load_workspace(named, allow_unresolved=inputs.allow_unresolved, overrides=tuple(overrides))
    except LoadError as error:
        return list(error.diagnostics), None
    return find_problems(workspace), workspace


def find_problems(workspace: Workspace) -> list[Diagnostic]:
    """Return all problems of the files of a workspace, sorted, but for those that a search finds."""
    from envgraph.lang import check_start

    found = list(workspace.diagnostics)
    if not (workspace.families or workspace.errors) and len(workspace.models) == len(workspace.behaviours) == 1:
        found += check_start(workspace.behaviours[0], workspace.models[0])
    for spec in workspace.families:
        found += _domain_problems(spec, workspace, search=False)
        if spec.audit is not None and not workspace.errors:
            from envgraph.learn.audit import check_audit

            found += check_audit(spec, workspace)
    return sort_diagnostics(found)


def _domain_problems(spec: FamilySpec, workspace: Workspace, search: bool) -> Sequence[Diagnostic]:
    """Return the problems of a family, with or without a search; an exception counts as one."""
    from envgraph.search import check_component_options, check_domain

    try:
        return check_component_options(spec, workspace) if workspace.errors else check_domain(spec, workspace, search)
    except EnvgraphError as error:
        return diagnostics_of(error)


def _problem_counts(diagnostics: Collection[Diagnostic]) -> str:
    errors = sum(diagnostic.severity == "error" for diagnostic in diagnostics)
    counts = ((errors, "error"), (len(diagnostics) - errors, "warning"))
    return ", ".join(f"{count} {word}{'s' if count > 1 else ''}" for count, word in counts if count)
