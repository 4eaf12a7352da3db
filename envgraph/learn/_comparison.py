"""Compare a curriculum with other ways to train for the target, in numbers and in sentences."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count
from statistics import fmean
from typing import Literal

import numpy as np

from envgraph.code import dataclass
from envgraph.draw import html_text
from envgraph.errors import InvalidArgument
from envgraph.learn._curricula import Kind
from envgraph.learn._regret import TEACHERS
from envgraph.learn._results import OPTIMISTIC, THRESHOLD, Experiment, RunResult
from envgraph.learn._significance import holm, permutation_test
from envgraph.solve import bootstrap_interval, newcombe_interval, probability_of_improvement

Measure = Literal["success", "return"]
Verdict = Literal["better", "worse", "equal", "neither", "undecided"]

SIGNIFICANT = 0.05
"""p-values below it are significant."""

MARGIN = 0.05
"""Success rates are "equal" if the whole interval of their difference is within -MARGIN and MARGIN."""

_DISPLAY_NAMES = {
    OPTIMISTIC: "direct training with optimistic values",
    "reversed": "its reverse",
    "shuffled": "shuffled orders",
    "randomised": "domain randomisation",
    "randomised, renewed": "domain randomisation with renewed epsilon",
    "exploring": "direct training from any state",
    **{name: f"the schedule `{name}`" for name in TEACHERS},
}


@dataclass(frozen=True, slots=True)
class Comparison:
    """A comparison of a curriculum with a control: the same seeds and steps, and evaluation on the same target.

    Attributes:
        curriculum, control: the labels of both.
        called: the control in words.
        steps: training steps of an agent in all, the same for both.
        by: the measure that is compared: "success", or "return" if the target cannot end in success.
        seeds, seeds_needed: number of seeds, and the fewest with which the difference can be significant.
        value, other: means of the curriculum and of the control.
        difference: 95 % interval of their difference: Newcombe's for success rates, a bootstrap interval for returns;
            None for a single seed.
        improvement: probability that an agent of the curriculum does better than one of the control.
        p_value: the p-value of `permutation_test`, corrected for the number of comparisons (`holm`).
    """

    curriculum: str
    control: str
    called: str
    steps: int
    by: Measure
    seeds: int
    seeds_needed: int
    value: float
    other: float
    difference: tuple[float, float] | None
    improvement: float
    p_value: float

    @property
    def verdict(self) -> Verdict:
        """Return "neither" if no agent succeeds, "better" or "worse" if significant, "equal" within `MARGIN`.

        In all other cases, return "undecided".
        """
        if self.by == "success" and self.value == self.other == 0:
            return "neither"
        if self.p_value < SIGNIFICANT:
            return "better" if self.value > self.other else "worse"
        if self.by == "success" and self.difference and max(map(abs, self.difference)) <= MARGIN:
            return "equal"
        return "undecided"

    @property
    def is_tie(self) -> bool:
        """Return True if the means are equal, or the difference is not significant although there are enough seeds."""
        return self.value == self.other or (self.p_value >= SIGNIFICANT and self.seeds >= self.seeds_needed)

    def format_mean(self, value: float) -> str:
        """Format a mean as a percentage if successes are compared, otherwise as a mean return."""
        return f"{100 * value:.3g} %" if self.by == "success" else f"a mean return of {value:z.2f}"

    _repr_html_ = html_text

    def __str__(self) -> str:
        by = "return " if self.by == "return" else ""
        chance = "p < 0.001" if self.p_value < 0.001 else f"p = {self.p_value:.2g}"
        both = f"{self.curriculum} and {self.called}"
        seeds = f"{self.seeds:,} seed{'s' if self.seeds > 1 else ''}"
        numbers = f"({by}{self.value:z.2f} against {self.other:z.2f} over {seeds}, {chance})"
        match self.verdict:
            case "neither":
                return f"neither {self.curriculum} nor {self.called} succeeds {numbers}"
            case "equal":
                return f"{both} differ by at most {MARGIN} {numbers}"
            case "undecided" if self.seeds < self.seeds_needed:
                return f"{both}: a significant difference takes at least {self.seeds_needed} seeds {numbers}"
            case "undecided":
                return f"no significant difference between {both} {numbers}"
            case verdict:
                return f"{self.curriculum} is {verdict} than {self.called} {numbers}"


@dataclass(frozen=True, slots=True)
class BestWay:
    """The best of several ways to train for a target, all with the same number of steps.

    Attributes:
        target: name of the target.
        called: the best way in words.
        comparisons: the comparisons of the best way with each other way, the second best first.
        needs_curriculum: False if direct training is among the best and at least half of its agents succeed.
    """

    target: str
    called: str
    comparisons: tuple[Comparison, ...]
    needs_curriculum: bool

    @property
    def best(self) -> list[str]:
        """Return the best way and the ways that tie with it, in words; see `Comparison.is_tie`."""
        return [self.called, *(one.called for one in self.comparisons if one.is_tie)]

    _repr_html_ = html_text

    def __str__(self) -> str:
        first, (*more, last) = self.comparisons[0], self.best
        names = f"{', '.join(more)} and {last} tie, at best" if more else f"{last},"
        ways = f"{len(self.comparisons) + 1} ways to train {self.target} with {first.steps:,} steps"
        agents = f"{first.seeds:,} agent{'s' if first.seeds > 1 else ''}"
        if first.verdict == "neither":
            return f"None of {ways} succeeds with any of {agents}."
        rest = [one for one in self.comparisons if not one.is_tie]
        text = f"Best of {ways}: {names}" if rest else f"All {ways} tie, at best"
        text += f" {first.format_mean(first.value)} of {agents}"
        text += "".join(f"; next {one.called}, {one.format_mean(one.other)}" for one in rest[:1])
        if first.seeds < first.seeds_needed:
            text += f"; a significant difference takes at least {first.seeds_needed} agents"
        return text + ("." if self.needs_curriculum else ". The target needs no curriculum with so many steps.")


def compare(experiment: Experiment, *, can_succeed: bool = True) -> tuple[Comparison, ...]:
    """Compare the first curriculum of an experiment with each control, and with training on the target alone.

    Runs with another number of steps are left out, and all "optimistic" controls but the best. Without a curriculum,
    return ().

    Args:
        experiment: the runs of all ways.
        can_succeed: True if an episode on the target can end in success; if False, returns are compared.

    Raises:
        InvalidArgument: the runs of two ways have different seeds.
    """
    ways = _runs_by_way(experiment)
    return _compare_ways(ways, can_succeed) if ways and ways[0][0].kind == "curriculum" else ()


def best_way(experiment: Experiment, target: str, *, can_succeed: bool = True) -> BestWay | None:
    """Return the best of all ways with the same number of steps; None if there are fewer than two.

    Arguments and errors are those of `compare`; `target` is only used as a name.
    """
    ways = sorted(_runs_by_way(experiment), key=lambda way: -fmean(_measured_values(way, can_succeed)))
    if len(ways) < 2:
        return None
    found = _compare_ways(ways, can_succeed)
    best = [ways[0], *(way for way, one in zip(ways[1:], found, strict=True) if one.is_tie)]
    direct = [way for way in best if way[0].kind == "baseline" or way[0].label.startswith(OPTIMISTIC)]
    enough = can_succeed and any(fmean(_measured_values(way, True)) >= THRESHOLD for way in direct)
    return BestWay(target, _display_name(ways[0][0]), found, not enough)


def findings(comparisons: Sequence[Comparison]) -> list[str]:
    """Return a first line with the steps, then a sentence for each comparison; [] without comparisons."""
    if not comparisons:
        return []
    none = " no difference is significant" * all(one.verdict == "undecided" for one in comparisons)
    number = len(comparisons)
    corrected = f" (p-values are corrected for {number} comparisons)" if number > 1 else ""
    return [f"With {comparisons[0].steps:,} steps in all{none}{corrected}:", *map(str, comparisons)]


def _display_name(run: RunResult) -> str:
    """Return a phrase for sentences, such as "the curriculum E1-E3", for the way in which an agent was trained."""
    if run.kind != "control":
        return f"the curriculum {run.label}" if run.kind == "curriculum" else f"training on {run.label} alone"
    name, _, values = run.label.partition(" ")
    if name == OPTIMISTIC:
        return _DISPLAY_NAMES[name] + (f" of {values.replace(',', ' and')}" if values else "")
    return _DISPLAY_NAMES.get(run.label, run.label.replace(",", " in"))


def _runs_by_way(experiment: Experiment) -> list[list[RunResult]]:
    """Return the runs of each way in lists: first the first curriculum, if any, then ways with as many steps.

    Of the "optimistic" controls only the best is a way.
    """
    runs = [run for run in experiment.best_optimistic().runs if run.kind != "baseline" or not run.steps_before]
    runs.sort(key=lambda run: run.kind != "curriculum")
    ways: dict[tuple[Kind, str], list[RunResult]] = {}
    for run in runs:
        if run.steps == runs[0].steps and (run.kind != "curriculum" or run.label == runs[0].label):
            ways.setdefault((run.kind, run.label), []).append(run)
    return [*ways.values()]


def _measured_values(way: Sequence[RunResult], can_succeed: bool) -> list[float]:
    return [run.success_rate if can_succeed else run.mean_return for run in way]


def _compare_ways(ways: Sequence[Sequence[RunResult]], can_succeed: bool) -> tuple[Comparison, ...]:
    """Return the comparison of the first way with each other way; raise InvalidArgument if their seeds differ."""
    one, seeds, found = ways[0][0], [run.seed for run in ways[0]], []
    first, *others = (_measured_values(way, can_succeed) for way in ways)
    for way in ways:
        if [run.seed for run in way] != seeds:
            raise InvalidArgument(f"the runs of `{one.label}` and `{way[0].label}` have different seeds")
    by: Measure = "success" if can_succeed else "return"
    about, needed = (one.steps, by, len(seeds)), _seeds_needed(len(others))
    chances = holm([permutation_test(first, values) for values in others])
    for way, values, p_value in zip(ways[1:], others, chances, strict=True):
        value, other = fmean(first), fmean(values)
        if can_succeed:
            difference: tuple[float, float] | None = newcombe_interval(value, len(seeds), other, len(seeds))
        else:
            difference = bootstrap_interval(np.subtract(first, values).tolist())
        names, better = (one.label, way[0].label, _display_name(way[0])), probability_of_improvement(first, values)
        found.append(Comparison(*names, *about, needed, value, other, difference, float(better), p_value))
    return tuple(found)


def _seeds_needed(comparisons: int) -> int:
    """Return the fewest seeds with which one of `comparisons` comparisons, corrected by `holm`, can be significant.

    The smallest p, if one way is better at every seed, is 2 / 2 ** seeds before the correction.

    >>> [_seeds_needed(comparisons) for comparisons in (1, 6)]
    [6, 8]
    """
    return next(seeds for seeds in count(1) if 2 * comparisons / 2**seeds < SIGNIFICANT)
