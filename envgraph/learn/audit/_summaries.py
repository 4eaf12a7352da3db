"""Summarise an audit as rows for CSV files, the terminal and the page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from envgraph.code import dataclass
from envgraph.learn._results import write_table
from envgraph.learn.audit._audit_settings import PROTOCOL
from envgraph.learn.audit._findings import Finding, paired_differences, seed_and_level_test
from envgraph.learn.audit._methods import METHODS
from envgraph.learn.audit._student_run import AuditRun
from envgraph.learn.audit._study import Study
from envgraph.solve import bootstrap_interval, cvar, probability_of_improvement

BASELINE: Final = METHODS[0].name


@dataclass(frozen=True, slots=True)
class MethodSummary:
    """Statistics of all runs of a method in a domain. Success is exact, on levels that no student has learned on.

    Attributes:
        domain, method, seeds: the runs: their domain and method, and the number of seeds.
        success: mean success over seeds and held-out levels.
        low, high: 95 % interval of the success over seeds; the value itself for a single seed.
        gain, gain_low, gain_high: mean paired difference to domain randomisation, with its interval over seeds and
            levels; 0 for domain randomisation itself.
        improvement: probability that a run is better than one of domain randomisation with one of the same seeds.
        hard: mean success on the hard levels.
        worst: mean of the worst 30 % of the held-out levels (CVaR, by the mean success over seeds of each level).
        regret: mean exact regret on the held-out levels.
        greedy: mean success of the greedy policy.
        updates: mean number of batches that were learned on.
        at_equal_updates: mean paired difference to domain randomisation after equally many updates.
        learned_solvable: share of the levels learned on that are solvable.
    """

    domain: str
    method: str
    seeds: int
    success: float
    low: float
    high: float
    gain: float
    gain_low: float
    gain_high: float
    improvement: float
    hard: float
    worst: float
    regret: float
    greedy: float
    updates: float
    at_equal_updates: float
    learned_solvable: float


def summarise_methods(study: Study) -> list[MethodSummary]:
    """Return statistics of the runs of each method in a study, in the order of the methods."""
    base = study.runs_of(BASELINE)
    found = []
    for method in study.methods:
        runs = study.runs_of(method)
        finals = [run.final_success for run in runs.values()]
        low, high = bootstrap_interval(finals) or (finals[0], finals[0])
        differences = paired_differences(study, method, BASELINE) if method != BASELINE else None
        gain, gain_low, gain_high, improvement = 0.0, 0.0, 0.0, 0.5
        if differences is not None:
            gain = float(differences.mean())
            gain_low, gain_high, _ = seed_and_level_test(differences)
            others = [base[seed].final_success for seed in runs if seed in base]
            improvement = float(probability_of_improvement(finals, others))
        levels = np.mean([run.success for run in runs.values()], axis=0)
        equal = [
            run.final_success - float(np.interp(run.updates[-1], base[seed].updates, base[seed].curve))
            for seed, run in runs.items()
            if seed in base
        ]
        found.append(
            MethodSummary(
                domain=study.name,
                method=method,
                seeds=len(runs),
                success=float(np.mean(finals)),
                low=low,
                high=high,
                gain=gain,
                gain_low=gain_low,
                gain_high=gain_high,
                improvement=improvement,
                hard=float(np.mean([run.hard for run in runs.values()])),
                worst=cvar(levels, PROTOCOL.worst),
                regret=float(np.mean([run.regret for run in runs.values()])),
                greedy=float(np.mean([run.greedy for run in runs.values()])),
                updates=float(np.mean([run.updates[-1] for run in runs.values()])),
                at_equal_updates=float(np.mean(equal)) if equal else 0.0,
                learned_solvable=float(np.mean([run.learned_solvable for run in runs.values()])),
            )
        )
    return found


def write_audit(studies: Sequence[Study], findings: Sequence[Finding], directory: Path) -> list[Path]:
    """Write `methods.csv`, `runs.csv`, `curves.csv`, `levels.csv`, `rankings.csv` and `claims.csv`; return their paths.

    Equal audits give equal files. `levels.csv` has the success of each run on each held-out level.
    """
    directory.mkdir(parents=True, exist_ok=True)
    names, stated = tuple(MethodSummary.__dataclass_fields__), tuple(Finding.__dataclass_fields__)
    of_run = ("domain", "method", "seed")
    runs = [((study.name, run.method, run.seed), study, run) for study in studies for run in study.runs]
    rankings = [{"domain": study.name, "seed": run.seed, **one} for _, study, run in runs for one in run.rankings]
    files: dict[str, tuple[Sequence[str], Iterable[Sequence[Any]]]] = {
        "methods": (
            names,
            (_column_values(one, names) for study in studies for one in summarise_methods(study)),
        ),
        "runs": (
            (*of_run, "success", "hard", "regret", "greedy", "updates", "learned_solvable"),
            ((*of, *_final_values(run)) for of, _, run in runs),
        ),
        "curves": (
            (*of_run, "steps", "updates", "success"),
            ((*of, *point) for of, _, run in runs for point in zip(run.steps, run.updates, run.curve, strict=True)),
        ),
        "levels": (
            (*of_run, "level", "success"),
            (
                (*of, *pair)
                for of, study, run in runs
                for pair in zip(study.levels.held_out.tolist(), run.success, strict=True)
            ),
        ),
        "rankings": (
            tuple(rankings[0]) if rankings else ("domain",),
            (tuple(one.values()) for one in rankings),
        ),
        "claims": (("verdict", *stated), (_column_values(one, ("verdict", *stated)) for one in findings)),
    }
    paths = []
    for name, (columns, rows) in files.items():
        paths.append(directory / f"{name}.csv")
        write_table(paths[-1], columns, rows)
    return paths


def _final_values(run: AuditRun) -> tuple[float, ...]:
    hard = float(np.mean(run.hard))
    return run.final_success, hard, run.regret, run.greedy, run.updates[-1], run.learned_solvable


def _column_values(one: object, names: Iterable[str]) -> list[Any]:
    return [getattr(one, name) for name in names]
