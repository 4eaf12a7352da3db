"""Run an audit: all runs of all methods. Each result is stored as it ends, so an interrupted audit can be continued."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, fields
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

from envgraph.code import dataclass
from envgraph.errors import EvaluationError, InvalidArgument
from envgraph.files import replace_file, run_in_workers
from envgraph.lang import Bundle
from envgraph.learn.audit._audit_levels import AuditLevels, make_levels
from envgraph.learn.audit._audit_settings import AuditSettings
from envgraph.learn.audit._methods import EDITING, METHODS, AuditMethod
from envgraph.learn.audit._student_run import AuditRun, run_method
from envgraph.search import Domain

FORMAT: Final = 3
"""The version of results; increased if the same files give other results than before."""

_Source = tuple[Bundle, tuple[str, ...]]
"""The texts of a domain, for other processes to read, and the settings that override them."""

Progress = Callable[[int, int, str], None]
"""A callback that gets the number of finished units of work, the number of all units, and their name."""


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """The runs of an audit of one domain.

    Attributes:
        name: the name of the domain.
        levels: the levels that students learned on and were tested on.
        settings: the settings of the audit.
        runs: the runs by method in the order of `METHODS`, then by seed.
    """

    name: str
    levels: AuditLevels
    settings: AuditSettings
    runs: tuple[AuditRun, ...]

    def runs_of(self, method: str) -> dict[int, AuditRun]:
        """Return the runs of a method by their seeds."""
        return {run.seed: run for run in self.runs if run.method == method}

    @property
    def methods(self) -> list[str]:
        """Return the names of the methods that were run, in order."""
        return list(dict.fromkeys(run.method for run in self.runs))


def audit(
    domain: Domain,
    settings: AuditSettings,
    directory: Path,
    *,
    methods: Sequence[AuditMethod] = METHODS,
    workers: int = 1,
    force: bool = False,
    progress: Progress = lambda done, total, what: None,
) -> Study:
    """Run an audit, or continue it: a run whose result is in the directory is not repeated.

    Args:
        domain: the domain of the levels.
        settings: the settings of the audit.
        directory: the directory for levels and results; created if it does not exist.
        methods: some of `METHODS` and `EDITING`.
        workers: number of runs at a time; does not change results.
        force: True to replace another audit in the directory.
        progress: a callback that gets the numbers of finished and of all units of work, and their name.

    Raises:
        InvalidArgument: the directory has another audit, or a result in it cannot be read.
        EvaluationError: the mutation rules make too few levels, or too few that are solvable.
    """
    _claim_directory(directory, _data_of_all_runs(domain, settings), force)
    levels_file = directory / "levels.npz"
    if not levels_file.exists():
        make_levels(domain, settings, lambda done, total: progress(done, total, "levels")).save(levels_file)
    levels = AuditLevels.load(levels_file)
    _check_solvable(levels, domain, settings)
    planned = [(method, seed) for method, seed in _planned_runs(settings, methods)]
    missing = [one for one in planned if not _result_path(directory, *one).exists()]
    known = len(planned) - len(missing)
    progress(known, len(planned), "runs")
    source = domain.workspace.bundle(), domain.overrides
    for done in _do_missing_runs(directory, settings, missing, workers, source):
        progress(known + done, len(planned), "runs")
    order = {method.name: place for place, method in enumerate((*METHODS, *EDITING))}
    runs = sorted(
        (read_run(_result_path(directory, *one)) for one in planned),
        key=lambda run: (order[run.method], run.seed),
    )
    return Study(domain.spec.name, levels, settings, tuple(runs))


def _check_solvable(levels: AuditLevels, domain: Domain, settings: AuditSettings) -> None:
    found, wanted = int(levels.solvable[levels.training].sum()), settings.policy.levels
    if found < wanted:
        message = f"{found} of the {len(levels.training):,} training levels are solvable, but a batch needs {wanted}"
        span = domain.spec.audit.span("levels") if domain.spec.audit else None
        raise EvaluationError(
            message, span, "increase `levels`, or reduce the number of mutations, `initial_applications`"
        )


def read_run(path: Path) -> AuditRun:
    """Read the result of a run.

    Raises:
        InvalidArgument: the file cannot be read, or has another form.
    """
    try:
        data: dict[str, Any] = json.loads(path.read_text("utf-8"))
        values: dict[str, Any] = {}
        for one in fields(AuditRun):
            value = data[one.name]
            values[one.name] = tuple(value) if isinstance(value, list) else value
        return AuditRun(**values)
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise InvalidArgument(f"{path}: the file is not the result of a run; remove it to repeat the run") from error


def _planned_runs(settings: AuditSettings, methods: Sequence[AuditMethod]) -> Iterator[tuple[AuditMethod, int]]:
    """Yield all runs, seed by seed, so that an audit that is stopped has equally many of each method."""
    for seed in range(max(settings.seeds, settings.controls)):
        for method in methods:
            if seed < (settings.seeds if method.is_decisive else min(settings.seeds, settings.controls)):
                yield method, seed


def _do_missing_runs(
    directory: Path,
    settings: AuditSettings,
    missing: Sequence[tuple[AuditMethod, int]],
    workers: int,
    source: _Source,
) -> Iterator[int]:
    """Do the missing runs, and yield the number of finished ones after each."""
    place = str(directory)
    tasks = [(place, settings, *one, source) for one in missing]
    hint = f"run `audit` again with fewer `workers`; finished students are stored in {directory}"
    for count, _ in enumerate(run_in_workers(_do_run, tasks, workers, hint=hint), 1):
        yield count


def _do_run(directory: str, settings: AuditSettings, method: AuditMethod, seed: int, source: _Source) -> None:
    """Do one run, and write its result to a file."""
    domain = Domain.from_bundle(source[0], overrides=source[1]) if method.edits_levels else None
    run = run_method(_load_levels(directory), settings, method, seed, domain=domain)
    path = _result_path(Path(directory), method, seed)
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_file(path, json.dumps(asdict(run)))


@lru_cache(maxsize=1)
def _load_levels(directory: str) -> AuditLevels:
    return AuditLevels.load(Path(directory) / "levels.npz")


def _result_path(directory: Path, method: AuditMethod, seed: int) -> Path:
    name = "_".join("".join(one if one.isalnum() else " " for one in method.name).split())
    return directory / "runs" / f"{name}.{seed}.json"


def _data_of_all_runs(domain: Domain, settings: AuditSettings) -> dict[str, Any]:
    """Return the data that all runs depend on: the texts, and the settings except the number of seeds."""
    texts = sorted(text for name, text in domain.workspace.sources.items() if name != domain.spec.path)
    rules = [str(rule) for rule in domain.spec.mutation.rules], domain.spec.mutation.initial_applications
    counted = {name: value for name, value in asdict(settings).items() if name not in ("seeds", "controls")}
    about = {
        "format": FORMAT,
        "seed": domain.spec.seed,
        "mutation": rules,
        "constraints": repr(domain.spec.constraints),
    }
    digest = sha256("\0".join(texts).encode("utf-8", "surrogatepass")).hexdigest()
    found: dict[str, Any] = json.loads(json.dumps({**about, "settings": counted, "texts": digest}))
    return found


def _claim_directory(directory: Path, about: dict[str, Any], force: bool) -> None:
    """Mark a directory as that of this audit; delete another audit in it if `force`, otherwise raise an error."""
    path = directory / "audit.json"
    if path.exists():
        try:
            known = json.loads(path.read_text("utf-8"))
        except ValueError:
            known = None
        if known == about:
            return
        if not force:
            raise InvalidArgument(
                f"{directory} contains another audit, with other files or settings",
                "give `--force` to replace it, or another `--directory`",
            )
        (directory / "levels.npz").unlink(missing_ok=True)
        for file in (directory / "runs").glob("*.json"):
            file.unlink()
    directory.mkdir(parents=True, exist_ok=True)
    replace_file(path, json.dumps(about, indent=1))
