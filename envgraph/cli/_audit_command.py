"""The command `envgraph audit`: evaluate the scores by which curricula choose levels."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from dataclasses import asdict, replace
from importlib.metadata import version
from pathlib import Path
from typing import Final

from envgraph import __version__
from envgraph.cli._output import print_json, print_line, print_table, progress_bar
from envgraph.errors import InvalidArgument, check_known
from envgraph.files import replace_file, write_lock
from envgraph.lang import DiskFiles, bundled_domains, data_path
from envgraph.learn.audit import (
    EDITING,
    METHODS,
    AuditMethod,
    AuditSettings,
    Finding,
    Study,
    audit,
    findings_of,
    parse_audit_settings,
    summarise_methods,
    write_audit,
)
from envgraph.report import audit_figures, audit_report, render_html, standalone_chart
from envgraph.search import Domain

AUDIT_FILE: Final = "audit/audit.toml"


def audit_scores(
    families: Sequence[str],
    directory: Path,
    *,
    seeds: int | None,
    controls: int | None,
    steps: int | None,
    methods: str | None,
    workers: int,
    force: bool,
    overrides: Sequence[str],
) -> None:
    """Audit each family, and write tables, figures and the page.

    Raises:
        InvalidArgument: a method is unknown, two families have the same name, or a directory holds another audit.
        LoadError: a file has errors; lists all of them.
    """
    chosen = _select_methods(methods)
    found: list[tuple[Domain, AuditSettings]] = []
    for family in families:
        domain = Domain.load(_audit_file(family), overrides=overrides)
        settings = parse_audit_settings(domain)
        settings = replace(
            settings,
            seeds=seeds or settings.seeds,
            controls=controls or settings.controls,
            steps=steps or settings.steps,
        )
        found.append((domain, settings))
    names = [domain.spec.name for domain, _ in found]
    if len(set(names)) < len(names):
        raise InvalidArgument(
            "two of the families have the same name, and would share a directory",
            "change `name` in one of the family files",
        )
    studies = [
        _run_study(domain, settings, directory / domain.spec.name, chosen, workers, force) for domain, settings in found
    ]
    findings = findings_of(studies)
    write_audit(studies, findings, directory)
    for name, chart in audit_figures(studies, findings).items():
        replace_file(directory / f"{name}.svg", standalone_chart(chart))
    page = directory / "audit.html"
    replace_file(page, render_html(audit_report(studies, findings, _reproduction_facts(found))))
    _print_results(studies, findings, page)


def _run_study(
    domain: Domain,
    settings: AuditSettings,
    directory: Path,
    methods: Sequence[AuditMethod],
    workers: int,
    force: bool,
) -> Study:
    directory.mkdir(parents=True, exist_ok=True)
    with write_lock(directory / "audit.json"), progress_bar(f"{domain.spec.name}", None) as advance:
        return audit(
            domain,
            settings,
            directory,
            methods=methods,
            workers=workers,
            force=force,
            progress=lambda done, total, what: advance(done, f"of {total:,} {what}"),
        )


def _audit_file(family: str) -> str:
    """Return the audit file of a directory or bundled domain, or another path unchanged; raise if a domain has none."""
    files = DiskFiles()
    if files.is_directory(files.name(family)):
        return f"{family.rstrip('/')}/{AUDIT_FILE}"
    if family not in bundled_domains():
        return family
    audited = [name for name in bundled_domains() if data_path("rules", name, AUDIT_FILE).is_file()]
    if family not in audited:
        hint = "use a bundled domain with one: " + ", ".join(f"`{name}`" for name in audited)
        raise InvalidArgument(f"the bundled domain `{family}` has no `{AUDIT_FILE}`", hint)
    return f"{family}/{AUDIT_FILE}"


def _select_methods(names: str | None) -> list[AuditMethod]:
    """Return the baseline and the named methods (separated by semicolons); by default all standard methods."""
    if names is None:
        return list(METHODS)
    every = (*METHODS, *EDITING)
    known = {method.name: method for method in every}
    wanted = [METHODS[0].name, *(name.strip() for name in names.split(";"))]
    for name in wanted:
        check_known(name, known, f"unknown method `{name}`")
    return [method for method in every if method.name in wanted]


def _print_results(studies: Sequence[Study], findings: Sequence[Finding], page: Path) -> None:
    if print_json(
        lambda: {
            "page": str(page),
            "methods": [asdict(one) for study in studies for one in summarise_methods(study)],
            "claims": [{**asdict(one), "verdict": one.verdict} for one in findings],
        }
    ):
        return
    for study in studies:
        found = summarise_methods(study)
        lines = [
            (
                one.method,
                str(one.seeds),
                f"{one.success:.3f}",
                f"{one.gain:+z.3f}",
                f"{one.gain_low:+z.3f} to {one.gain_high:+z.3f}",
                f"{one.improvement:.2f}",
                f"{one.hard:.3f}",
            )
            for one in found
        ]
        columns = ("method", "seeds", "success", "minus DR", "95 % interval", "PoI", "hard levels")
        print_table(f"{study.name}: exact success on held-out levels", columns, lines, (1, 2, 3, 5, 6))
    for one in findings:
        print_line(str(one))
    print_line(f"page: {page}")


def _reproduction_facts(found: Sequence[tuple[Domain, AuditSettings]]) -> dict[str, str]:
    """Return the settings and versions needed to reproduce the audit."""
    facts = {}
    for domain, settings in found:
        policy = settings.policy
        seeds, others = settings.seeds - 1, min(settings.seeds, settings.controls) - 1
        facts[domain.spec.name] = ", ".join(
            (
                f"{domain.spec.path}, seed {domain.spec.seed} of the levels",
                f"seeds of students 0 to {seeds}, of methods that are not decisive 0 to {others}",
                f"{settings.steps:,} steps",
                f"sees {', '.join((*settings.sees, *settings.knows))}",
                f"{policy.hidden} hidden units",
                f"{policy.epochs} epochs of {policy.minibatches} minibatches",
                f"{policy.levels} levels x {policy.steps} steps a batch",
                f"learning rate {policy.learning_rate:g}",
                f"entropy {policy.entropy:g}",
                f"discount {policy.discount:g}",
                f"lambda {policy.smoothing:g}",
                f"episodes of {policy.limit} steps",
                f"rewards times {settings.scale:g}",
            )
        )
    facts["definitions"] = "docs/evidence/levels.md"
    facts["versions"] = f"envgraph {__version__}, Python {platform.python_version()}, NumPy {version('numpy')}"
    return facts
