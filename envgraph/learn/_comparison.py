"""What can be said of a curriculum beside its controls, in numbers and in words."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count
from statistics import fmean
from typing import Literal

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument
from envgraph.learn._intervals import bootstrap_interval, newcombe_interval, probability_of_improvement
from envgraph.learn._results import Experiment, RunResult
from envgraph.learn._significance import holm, permutation_test
from envgraph.learn._teachers import TEACHERS

Verdict = Literal["better", "worse", "as much", "undecided"]

SIGNIFICANT = 0.05
"""Below it a p-value tells two apart."""

MARGIN = 0.05
"""Where the interval of a difference of success rates lies within so much, one reaches as much as the other."""

_CALLED = {
    "optimistic": "direct training with optimistic values",
    "reversed": "its reverse",
    "shuffled": "shuffled orders",
    "randomised": "domain randomisation",
    "randomised, renewed": "domain randomisation with renewed epsilon",
    "random families": "random families",
    **{name: f"the schedule `{name}`" for name in TEACHERS},
}


@dataclass(frozen=True, slots=True)
class Comparison:
    """A curriculum and a control, trained with the same seeds and as many steps, and evaluated on the target.

    Attributes:
        curriculum: label of the curriculum.
        control: label of the control; what is numbered, "shuffled 1" and so on, is one control, "shuffled".
        called: the control, in words.
        steps: training steps of an agent in all, the same for both.
        by: what is compared: "success"; or "return", where no agent succeeds at all.
        seeds: how many.
        seeds_needed: the fewest with which as many comparisons as are made can tell two apart.
        value, other: means of the curriculum and of the control.
        difference: interval at 95 % of their difference: of success that of Newcombe, of return that of the bootstrap,
            None for a single seed.
        improvement: probability that an agent of the curriculum does better than one of the control.
        p_value: that of `permutation_test`, corrected for as many comparisons as are made (`holm`).
    """

    curriculum: str
    control: str
    called: str
    steps: int
    by: Literal["success", "return"]
    seeds: int
    seeds_needed: int
    value: float
    other: float
    difference: tuple[float, float] | None
    improvement: float
    p_value: float

    @property
    def verdict(self) -> Verdict:
        """What holds of the curriculum: "as much" is success within `MARGIN` of the control's, with some certainty."""
        if self.p_value < SIGNIFICANT:
            return "better" if self.value > self.other else "worse"
        if self.by == "success" and self.difference and max(map(abs, self.difference)) <= MARGIN:
            return "as much"
        return "undecided"

    def __str__(self) -> str:
        by = "return " if self.by == "return" else ""
        chance = "p < 0.001" if self.p_value < 0.001 else f"p = {self.p_value:.2g}"
        seeds = f"{self.seeds:,} seed{'s' if self.seeds > 1 else ''}"
        numbers = f"({by}{self.value:z.2f} against {self.other:z.2f} over {seeds}, {chance})"
        match self.verdict:
            case "as much" if self.value == self.other == 0:
                return f"neither {self.curriculum} nor {self.called} succeeds {numbers}"
            case "as much":
                return f"{self.curriculum} and {self.called} reach as much {numbers}"
            case "undecided" if self.seeds < self.seeds_needed:
                few = f"by so few seeds: it takes {self.seeds_needed}"
                return f"{self.curriculum} and {self.called} cannot be told apart {few} {numbers}"
            case "undecided":
                return f"{self.curriculum} and {self.called} cannot be told apart {numbers}"
            case verdict:
                return f"{self.curriculum} is {verdict} than {self.called} {numbers}"


def compare(experiment: Experiment) -> tuple[Comparison, ...]:
    """The first curriculum of an experiment beside each control, and beside training on the target alone.

    Only what has as many steps as the curriculum is compared, and only with the seeds that all have.

    Raises:
        InvalidArgument: the runs of something have different seeds.
    """
    taught = next((run for run in experiment.runs if run.kind == "curriculum"), None)
    if taught is None:
        return ()
    groups: dict[str, dict[int, list[RunResult]]] = {}
    given: dict[int, RunResult] = {}
    for run in experiment.runs:
        if (run.kind, run.label) == (taught.kind, taught.label):
            given[run.seed] = run
        elif run.steps == taught.steps and (run.kind == "control" or _direct(run)):
            groups.setdefault(_group(run), {}).setdefault(run.seed, []).append(run)
    return _compared(taught, given, groups)


def findings(comparisons: Sequence[Comparison]) -> list[str]:
    """What holds, in words: first of what it is said, then a sentence for each comparison; [] where there is none."""
    if not comparisons:
        return []
    told = " nothing can be told apart" if all(one.verdict == "undecided" for one in comparisons) else ""
    number = len(comparisons)
    corrected = f" (p-values are corrected for {number} comparisons)" if number > 1 else ""
    return [f"With {comparisons[0].steps:,} steps in all{told}{corrected}:", *map(str, comparisons)]


def _direct(run: RunResult) -> bool:
    """Whether it is training on the target alone."""
    return run.kind == "baseline" and run.steps_before == 0


def _group(run: RunResult) -> str:
    head, _, tail = run.label.rpartition(" ")
    return head if run.kind == "control" and tail.isdecimal() else run.label


def _compared(
    taught: RunResult, given: dict[int, RunResult], groups: dict[str, dict[int, list[RunResult]]]
) -> tuple[Comparison, ...]:
    by: Literal["success", "return"] = "return"
    everything = [
        *given.values(),
        *(run for group in groups.values() for runs in group.values() for run in runs),
    ]
    if any(run.success_rate > 0 for run in everything):
        by = "success"
    found = []
    for control, group in groups.items():
        if group.keys() != given.keys() or len({len(runs) for runs in group.values()}) > 1:
            raise InvalidArgument(f"the runs of `{taught.label}` and `{control}` have different seeds")
        values = [_value(run, by) for run in given.values()]
        others = [[_value(run, by) for run in group[seed]] for seed in given]
        found.append((control, values, others))
    chances = holm([permutation_test(values, others) for _, values, others in found])
    return tuple(
        _comparison(taught, control, by, values, others, p_value, len(found))
        for (control, values, others), p_value in zip(found, chances, strict=True)
    )


def _value(run: RunResult, by: str) -> float:
    return run.success_rate if by == "success" else run.mean_return


def _comparison(
    taught: RunResult,
    control: str,
    by: Literal["success", "return"],
    values: Sequence[float],
    others: Sequence[Sequence[float]],
    p_value: float,
    comparisons: int,
) -> Comparison:
    every = [value for row in others for value in row]
    value, other = fmean(values), fmean(every)
    if by == "success":
        difference: tuple[float, float] | None = newcombe_interval(value, len(values), other, len(every))
    else:
        rows = [value - fmean(row) for value, row in zip(values, others, strict=True)]
        difference = bootstrap_interval(rows)
    return Comparison(
        curriculum=taught.label,
        control=control,
        called=_CALLED.get(control, f"training on {control} alone"),
        steps=taught.steps,
        by=by,
        seeds=len(values),
        seeds_needed=_seeds_needed(comparisons, 1 + len(others[0])),
        value=value,
        other=other,
        difference=difference,
        improvement=float(probability_of_improvement(values, every)),
        p_value=p_value,
    )


def _seeds_needed(comparisons: int, values: int) -> int:
    """The fewest seeds at which the smallest p of so many values a seed, corrected by `holm`, is significant.

    It is that of the first value being the largest at each seed, or at each the smallest: 2 / values ** seeds.

    >>> [_seeds_needed(comparisons, 2) for comparisons in (1, 6)]
    [6, 8]
    """
    return next(seeds for seeds in count(1) if 2 * comparisons / values**seeds < SIGNIFICANT)
