"""Write the report sections on training: tables, learning curves, and comparisons of a curriculum with its controls."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from statistics import fmean, pstdev
from typing import TypeVar

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument
from envgraph.learn import (
    BestWay,
    Comparison,
    Experiment,
    RunResult,
    Summary,
    best_way,
    compare,
    findings,
    performance_profile,
)
from envgraph.report._charts import Series, line_chart
from envgraph.report._html_page import ReportSection, ReportTable

T = TypeVar("T")

_MOST_POINTS = 400
"""About the maximum number of points of a line; more points than pixels only make the page larger."""


@dataclass(frozen=True, slots=True)
class TrainingResults:
    """The results of training with one budget.

    Attributes:
        steps: training steps for each environment.
        experiment: curricula and baselines, evaluated on the target.
        stages: the curriculum up to each environment, evaluated there; None if no curriculum was trained on.
        can_succeed: True if an episode on the target can end in success.
        student: the kind of agent that learned, one of `STUDENTS`.
    """

    steps: int
    experiment: Experiment
    stages: Experiment | None = None
    can_succeed: bool = True
    student: str = "tabular"

    @property
    def suffix(self) -> str:
        """Return ", " and the student, for titles; "" for tabular agents."""
        return "" if self.student == "tabular" else f", {self.student}"

    def best_way(self, target: str) -> BestWay | None:
        """Return the best way to train for the target; None if there are fewer than two ways."""
        return best_way(self.experiment, target, can_succeed=self.can_succeed)


def _chart_panels(lines: Iterable[tuple[str, str]], target: str) -> dict[str, list[tuple[str, str]]]:
    """Return the lines (kind, label) of each chart, by chart title.

    Charts of curricula and of controls also show training on the target alone. If other baselines exist, or nothing
    else, the last chart shows all baselines.
    """
    every = list(lines)
    taught, compared, alone = (
        [one for one in every if one[0] == kind] for kind in ("curriculum", "control", "baseline")
    )
    beside = [one for one in alone if one[1] == target]
    panels = {}
    if taught and not (compared and len(taught) == 1):
        panels["the curricula beside the target alone"] = [*taught, *beside]
    if compared:
        panels["the whole family beside its controls"] = [*taught[:1], *compared, *beside]
    if len(alone) > len(beside) or not panels:
        panels["every environment alone"] = alone
    return panels


def _colour_numbers(panels: Mapping[str, Iterable[tuple[str, str]]]) -> dict[tuple[str, str], int]:
    """Return the colour number of each line, the same in every chart, in the order of occurrence."""
    found = dict.fromkeys(one for panel in panels.values() for one in panel)
    return {one: number for number, one in enumerate(found)}


def _line_label(kind: str, label: str) -> str:
    """Return the label of a line for the legend; controls omit their kind."""
    return label if kind == "control" else f"{kind} {label}"


def budget_charts(trained: Sequence[TrainingResults], target: str) -> tuple[str, ...]:
    """Return charts of the success on the target by training budget; success need not increase with the budget."""
    lines: dict[tuple[str, str], list[Summary]] = {}
    for budget in trained:
        for one in budget.experiment.best_optimistic().summaries():
            label = "optimistic" if one.label.startswith("optimistic") else one.label  # its initial values differ
            lines.setdefault((one.kind, label), []).append(one)
    panels = _chart_panels(lines, target)
    numbers = _colour_numbers(panels)
    series = {
        (kind, label): Series(
            _line_label(kind, label),
            tuple(float(one.steps) for one in points),
            tuple(one.success_rate for one in points),
            tuple(one.success_interval[0] for one in points),
            tuple(one.success_interval[1] for one in points),
            is_dashed=kind != "curriculum",
            number=numbers[kind, label],
        )
        for (kind, label), points in lines.items()
        if (kind, label) in numbers
    }
    return tuple(
        line_chart(
            [series[one] for one in panel],
            x_label="training steps in all",
            y_label=f"success on {target}",
            title=f"Success on {target} by training budget{trained[0].suffix}, with Wilson intervals at 95 %",
        )
        for panel in panels.values()
    )


def training_section(trained: TrainingResults, target: str) -> ReportSection:
    experiment = trained.experiment.best_optimistic()
    summaries = experiment.summaries()
    comparisons = compare(experiment, can_succeed=trained.can_succeed)
    tables = [_agents_table(summaries, target)]
    if comparisons:
        tables.append(_comparisons_table(comparisons))
    panels = _chart_panels(((one.kind, one.label) for one in summaries), target)
    numbers = _colour_numbers(panels)
    series: dict[tuple[str, str], Series] = {
        key: replace(reward_curve(one, runs_of(experiment, one)), number=numbers[key])
        for one in summaries
        if (key := (one.kind, one.label)) in numbers
    }
    charts = tuple(
        line_chart(
            [series[one] for one in panel],
            x_label="training step",
            y_label="cumulative reward",
            title="Cumulative reward during training",
        )
        for panel in panels.values()
    )
    text = "Cumulative reward during training: mean over the seeds, and one standard deviation around it."
    if len(charts) > 1:
        text += f" The charts show {'; '.join(panels)}."
    if any("controls" in name for name in panels):
        text += " The last chart shows performance profiles: the share of agents whose return is above a value."
    title = f"Training for {target}, {format_thousands(trained.steps)} steps an environment{trained.suffix}"
    return ReportSection(
        title, (*findings(comparisons), text), (*charts, *_profile_charts(experiment, panels)), tuple(tables)
    )


def _agents_table(summaries: Sequence[Summary], target: str) -> ReportTable:
    """Return a table with one row for each curriculum, baseline or control."""
    rows = tuple(
        (
            f"{one.kind} {one.label}",
            f"{one.steps:,}",
            str(one.runs),
            f"{one.success_rate:.0%}",
            _format_interval(one.success_interval, ".0%"),
            f"{one.mean_return:z.2f}",
            f"{one.return_iqm:z.2f}",
            _format_interval(one.iqm_interval, "z.2f"),
            f"{one.success_before:.0%}",
            "" if one.steps_to_threshold is None else f"{one.steps_to_threshold:,}",
        )
        for one in summaries
    )
    caption = (
        f"Agents evaluated on {target}. Steps: all training steps of an agent. Success and return are those of the "
        "greedy policy after training. Intervals are at 95 %: Wilson's interval of "
        "the success, and the bootstrap interval of the interquartile mean (IQM) of the returns. Before: success on "
        "the target before the last stage. To half: the training step, including earlier stages, at which half of the "
        f"episodes on {target} first succeed, as the median over the seeds. Agents explore during training, so that "
        "they may succeed where a greedy policy repeats the same actions."
    )
    first = ("trained on", "steps", "seeds", "success", "interval")
    columns = (*first, "return", "IQM", "interval", "before", "to half")
    return ReportTable(caption, columns, rows, frozenset(range(1, len(columns))))


def _comparisons_table(comparisons: Sequence[Comparison]) -> ReportTable:
    """Return a table with one row for each control."""
    first = comparisons[0]
    as_ = ".0%" if first.by == "success" else "z.2f"
    rows = tuple(
        (
            one.called,
            format(one.value, as_),
            format(one.other, as_),
            _format_interval(one.difference, as_),
            f"{one.improvement:.2f}",
            "< 0.001" if one.p_value < 0.001 else f"{one.p_value:.2g}",
        )
        for one in comparisons
    )
    caption = (
        f"The {first.by} of {first.curriculum} and of controls with as many steps: 95 % interval of the "
        "difference, probability that an agent is better than an agent of the control (ties count half), and p-value "
        "of a permutation test paired by seeds, with Holm's correction."
    )
    columns = ("control", first.curriculum, "control's", "difference", "improvement", "p")
    return ReportTable(caption, columns, rows, frozenset(range(1, len(columns))))


def _format_interval(ends: tuple[float, float] | None, as_: str) -> str:
    return "" if ends is None else " to ".join(format(end, as_) for end in ends)


def _profile_charts(experiment: Experiment, panels: Mapping[str, Sequence[tuple[str, str]]]) -> tuple[str, ...]:
    """Return one chart of the share of agents whose return exceeds a value, with the lines of the chart of controls.

    Return () without such a chart, or if all returns are equal.
    """
    panel = next((panel for name, panel in panels.items() if "controls" in name), [])
    numbers = _colour_numbers(panels)
    returns = {one: [run.mean_return for run in experiment.runs if (run.kind, run.label) == one] for one in panel}
    every = sorted({value for values in returns.values() for value in values})
    if len(every) < 2:
        return ()
    low, high = every[0], every[-1]
    points = [low + (high - low) * place / 100 for place in range(-1, 101)]
    series = [
        Series(
            _line_label(*one),
            tuple(points),
            tuple(performance_profile(values, points).tolist()),
            is_dashed=one[0] != "curriculum",
            number=numbers[one],
        )
        for one, values in returns.items()
    ]
    return (line_chart(series, x_label="return", y_label="share of the agents above it", title="Performance profiles"),)


def runs_of(experiment: Experiment, summary: Summary) -> list[RunResult]:
    return [run for run in experiment.runs if (run.kind, run.label) == (summary.kind, summary.label)]


def reward_curve(summary: Summary, runs: Sequence[RunResult]) -> Series:
    """Return the mean reward curve of runs, with its standard deviation; InvalidArgument if checkpoints differ."""
    steps = runs[0].curve.steps
    if any(run.curve.steps != steps for run in runs):
        raise InvalidArgument(f"the runs of {summary.label} have different checkpoints")
    at = thin_points(range(len(steps)))
    values = [[run.curve.reward[place] for run in runs] for place in at]
    means, spread = [fmean(one) for one in values], [pstdev(one) for one in values]
    return Series(
        _line_label(summary.kind, summary.label),
        tuple(float(steps[place]) for place in at),
        tuple(means),
        tuple(mean - width for mean, width in zip(means, spread, strict=True)),
        tuple(mean + width for mean, width in zip(means, spread, strict=True)),
        is_dashed=summary.kind != "curriculum",
    )


def thin_points(points: Sequence[T]) -> list[T]:
    """Return at most 401 of the points, evenly spaced, including the last one."""
    stride = -(-len(points) // _MOST_POINTS)
    return [*points[: len(points) - 1 : stride], points[-1]]


def format_thousands(number: int) -> str:
    """Format whole thousands in short, other numbers in full.

    >>> format_thousands(50_000), format_thousands(2_500)
    ('50k', '2500')
    """
    return f"{number // 1000}k" if number % 1000 == 0 else str(number)
