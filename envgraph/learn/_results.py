"""Results of experiments as data, and as CSV files."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from io import TextIOWrapper
from itertools import chain
from math import inf
from pathlib import Path
from statistics import fmean
from typing import Any, TypeVar

from envgraph.code import dataclass
from envgraph.draw import html_fields, html_table
from envgraph.errors import EnvgraphError, InvalidArgument, parse_float, parse_int
from envgraph.files import open_input, replacement_draft
from envgraph.learn._curricula import Kind, parse_kind
from envgraph.solve import bootstrap_interval, interquartile_mean, wilson_interval
from envgraph.solve.learning import Curve

Parsed = TypeVar("Parsed")

SUMMARY_COLUMNS = (
    "kind",
    "label",
    "runs",
    "success_rate",
    "success_low",
    "success_high",
    "mean_return",
    "return_low",
    "return_high",
    "return_iqm",
    "iqm_low",
    "iqm_high",
    "success_before",
    "steps_to_threshold",
)
THRESHOLD = 0.5
"""The default share of successes for `steps_to_threshold`."""

OPTIMISTIC = "optimistic"
"""Prefix of the labels of "optimistic" controls, which differ in initial value and epsilon; see `best_optimistic`."""

_FORMULA = ("=", "+", "-", "@", "\t", "\r", "'")

CURVE_COLUMNS = ("kind", "label", "seed", "step", "cumulative_reward", "episodes", "successes")


@dataclass(frozen=True, slots=True)
class RunResult:
    """The result of one training run, and of its evaluation on the target.

    Attributes:
        kind: the kind of the curriculum.
        label: the curriculum's label.
        seed: the run's seed.
        steps: training steps in all.
        episodes: training episodes finished in all.
        success_rate: success rate of the greedy policy on the target, from 0 to 1.
        mean_return: mean return of the greedy policy on the target, undiscounted.
        mean_length: mean length of the greedy policy's episodes, in steps.
        steps_before: training steps before the agent trains on the target alone; all steps if it never does.
        success_before: success rate on the target before the last stage. Its difference to the success rate without
            training is the jumpstart (Taylor and Stone 2009).
        curve: the learning curve.
    """

    kind: Kind
    label: str
    seed: int
    steps: int
    episodes: int
    success_rate: float
    mean_return: float
    mean_length: float
    steps_before: int
    success_before: float
    curve: Curve

    _repr_html_ = html_fields

    def steps_to_threshold(self, threshold: float = THRESHOLD) -> int | None:
        """Return the time to threshold, including the steps of earlier stages (Taylor and Stone 2009, "total time").

        Args:
            threshold: share of the training episodes on the target that end in success between two points of the curve.
                Exploration makes this share lower than the success rate.

        Returns:
            Steps since the beginning of the training; None if the threshold is never reached.
        """
        curve, ended, reached = self.curve, 0, 0
        for steps, episodes, successes in zip(curve.steps, curve.episodes, curve.successes, strict=True):
            new = episodes - ended
            if steps > self.steps_before and new and successes - reached >= threshold * new:
                return steps
            ended, reached = episodes, successes
        return None


RUN_COLUMNS = tuple(field.name for field in fields(RunResult) if field.name != "curve")


def make_result(values: Mapping[str, Any], curve: Curve, whole: Any = int, real: Any = float) -> RunResult:
    """Return the result of a run from values with the names of `RUN_COLUMNS`; `whole` parses ints, `real` floats.

    Raises:
        ValueError, TypeError, LookupError: a value is missing or cannot be parsed.
    """
    parse: dict[Any, Any] = {"Kind": parse_kind, "str": str, "int": whole, "float": real}
    types = {field.name: field.type for field in fields(RunResult)}
    return RunResult(**{name: parse[types[name]](values[name]) for name in RUN_COLUMNS}, curve=curve)


@dataclass(frozen=True, slots=True)
class Summary:
    """Statistics of all runs of one curriculum.

    Attributes:
        kind: the kind of the curriculum.
        label: the curriculum's label.
        runs: number of runs.
        steps: training steps of each run in all.
        success_rate: mean success rate over the runs.
        success_interval: Wilson's interval, with each run as one trial.
        mean_return: mean return over the runs.
        return_interval: interval of `mean_return`, by `bootstrap_interval`; None for a single run.
        return_iqm: interquartile mean of the returns.
        iqm_interval: interval of `return_iqm`, by `bootstrap_interval`; None for a single run.
        success_before: mean success rate before the last stage.
        steps_to_threshold: median over the runs, the lower of two middle values; None if more than half never reach it.
    """

    kind: Kind
    label: str
    runs: int
    steps: int
    success_rate: float
    success_interval: tuple[float, float]
    mean_return: float
    return_interval: tuple[float, float] | None
    return_iqm: float
    iqm_interval: tuple[float, float] | None
    success_before: float
    steps_to_threshold: int | None

    _repr_html_ = html_fields


@dataclass(frozen=True, slots=True)
class Experiment:
    """The results of all runs of an experiment, ordered by curriculum and then by seed."""

    runs: tuple[RunResult, ...]

    def _repr_html_(self) -> str:
        head = ("kind", "curriculum", "runs", "success rate", "95 % interval", "mean return", "steps to threshold")
        return html_table(map(_shown_summary, self.summaries()), head)

    def summaries(self, confidence: float = 0.95) -> tuple[Summary, ...]:
        """Return a summary for each curriculum, in the order of their first runs."""
        groups: dict[tuple[Kind, str], list[RunResult]] = {}
        for run in self.runs:
            groups.setdefault((run.kind, run.label), []).append(run)
        return tuple(_summarise(group, confidence) for group in groups.values())

    def best_optimistic(self) -> Experiment:
        """Return the experiment without "optimistic" controls except the best: by mean success, then by mean return."""
        tried: dict[str, tuple[float, float]] = {}
        for run in self.runs:
            if run.kind == "control" and run.label.startswith(OPTIMISTIC):
                success, total = tried.get(run.label, (0.0, 0.0))
                tried[run.label] = success + run.success_rate, total + run.mean_return
        lesser = {("control", label) for label in tried if label != max(tried, key=lambda one: tried[one])}
        return Experiment(tuple(run for run in self.runs if (run.kind, run.label) not in lesser))


def _shown_summary(one: Summary) -> tuple[object, ...]:
    low, high = one.success_interval
    success = (one.success_rate, f"{low:.3f} to {high:.3f}")
    return (one.kind, one.label, one.runs, *success, one.mean_return, one.steps_to_threshold)


def _summarise(group: Sequence[RunResult], confidence: float) -> Summary:
    success = fmean(run.success_rate for run in group)
    returns = [run.mean_return for run in group]
    times = sorted(inf if (steps := run.steps_to_threshold()) is None else steps for run in group)
    median = times[(len(times) - 1) // 2]
    return Summary(
        kind=group[0].kind,
        label=group[0].label,
        runs=len(group),
        steps=group[0].steps,
        success_rate=success,
        success_interval=wilson_interval(success, len(group), confidence),
        mean_return=fmean(returns),
        return_interval=bootstrap_interval(returns, confidence=confidence),
        return_iqm=float(interquartile_mean(returns)),
        iqm_interval=bootstrap_interval(returns, statistic=interquartile_mean, confidence=confidence),
        success_before=fmean(run.success_before for run in group),
        steps_to_threshold=None if median == inf else int(median),
    )


def write_csv(experiment: Experiment, directory: Path) -> tuple[Path, Path, Path]:
    """Write `runs.csv`, `summary.csv` and `curves.csv` into a directory, which is created if it does not exist.

    Each row is a run, a curriculum, or a point of a run's curve. Reading restores the numbers exactly, and equal
    experiments give equal files.
    """
    directory.mkdir(parents=True, exist_ok=True)
    runs, summary, curves = (directory / name for name in ("runs.csv", "summary.csv", "curves.csv"))
    _write_rows(runs, RUN_COLUMNS, ([getattr(run, one) for one in RUN_COLUMNS] for run in experiment.runs))
    _write_rows(summary, SUMMARY_COLUMNS, (_summary_row(one) for one in experiment.summaries()))
    _write_rows(curves, CURVE_COLUMNS, (row for run in experiment.runs for row in _curve_rows(run)))
    return runs, summary, curves


def read_csv(directory: Path) -> Experiment:
    """Read the experiment that `write_csv` has written. Summaries are computed from the runs.

    Raises:
        InvalidArgument: a file does not exist, or a line is not a valid result.
    """
    points: dict[tuple[str, str, str], list[tuple[int, float, int, int]]] = {}

    def point(row: list[str]) -> None:
        kind, label, seed, step, reward, episodes, successes = row
        points.setdefault((kind, label, seed), []).append(
            (_parse_int64(step), _parse_finite(reward), _parse_int64(episodes), _parse_int64(successes))
        )

    def run(row: list[str]) -> RunResult:
        kind, label, seed, *_ = row
        curve = Curve(*zip(*points[kind, label, seed], strict=True))
        return make_result(dict(zip(RUN_COLUMNS, row, strict=True)), curve, _parse_int64, _parse_finite)

    _read_rows(directory / "curves.csv", CURVE_COLUMNS, point)
    return Experiment(tuple(_read_rows(directory / "runs.csv", RUN_COLUMNS, run)))


def _parse_int64(text: str) -> int:
    found = parse_int(text)
    if found is None:
        raise ValueError(f"`{text[:20]}` is not a whole number of 64 bits")
    return found


def _parse_finite(text: str) -> float:
    found = parse_float(text)
    if found is None:
        raise ValueError(f"`{text[:20]}` is not a finite number")
    return found


def _summary_row(one: Summary) -> tuple[object, ...]:
    nothing = (None, None)
    success = (one.kind, one.label, one.runs, one.success_rate, *one.success_interval)
    returns = (one.mean_return, *(one.return_interval or nothing), one.return_iqm)
    return (*success, *returns, *(one.iqm_interval or nothing), one.success_before, one.steps_to_threshold)


def _curve_rows(run: RunResult) -> Iterable[tuple[object, ...]]:
    curve = run.curve
    for point in zip(curve.steps, curve.reward, curve.episodes, curve.successes, strict=True):
        yield (run.kind, run.label, run.seed, *point)


def _write_rows(path: Path, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    write_table(path, columns, ([_format_cell(value) for value in row] for row in rows))


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a CSV file with the columns as its first line; texts that look like formulas stay as they are."""
    with replacement_draft(path) as draft, draft.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(chain([columns], rows))


def _format_cell(value: object) -> object:
    """Return the value of a cell to write: text that a spreadsheet would take for a formula is prefixed with `'`.

    >>> _format_cell("=1+1"), _parse_cell(_format_cell("=1+1")), _format_cell("E1-E6"), _format_cell(-0.5)
    ("'=1+1", '=1+1', 'E1-E6', -0.5)
    """
    return f"'{value}" if isinstance(value, str) and value.startswith(_FORMULA) else value


def _parse_cell(cell: str) -> str:
    """Return the text of a cell without the prefix of `_format_cell`."""
    return cell[1:] if cell.startswith("'") else cell


def _read_rows(path: Path, columns: Sequence[str], parse: Callable[[list[str]], Parsed]) -> list[Parsed]:
    """Return what `parse` returns for each row after the header, which must be `columns`.

    Raises:
        InvalidArgument: the file cannot be read, or a row cannot be parsed; the message has the line number.
    """
    parsed: list[Parsed] = []
    line = 1
    try:
        with TextIOWrapper(open_input(path), encoding="utf-8", newline="") as file:
            reader = csv.reader(file, strict=True)
            if tuple(next(reader, ())) != tuple(columns):
                raise InvalidArgument(f"{path}:1: the columns must be {', '.join(columns)}")
            for row in reader:
                line = reader.line_num
                parsed.append(parse(list(map(_parse_cell, row))))
    except OSError as error:
        raise InvalidArgument(f"{path}: {error.strerror}") from error
    except EnvgraphError:
        raise
    except (ValueError, KeyError, csv.Error) as error:
        raise InvalidArgument(f"{path}:{line}: the line is not a valid result") from error
    return parsed
