"""Compare the claims of the paper with the results of many seeds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from math import sqrt
from statistics import NormalDist, fmean
from typing import Final, Literal

import numpy as np

from envgraph.code import dataclass
from envgraph.learn import (
    FEWEST_UNITS,
    SIGNIFICANT,
    Summary,
    bootstrap_interval,
    holm,
    mean_test,
    wilson_interval,
)
from envgraph.report.reproduction._published import AGENTS, NORMAL
from envgraph.report.reproduction._training_runs import BudgetResults, FamilySample, Reproduction

Verdict = Literal["holds", "does not hold", "depends on the seed", "undecided"]

NEARLY_ALL, NEARLY_NONE = 0.95, 0.05
"""Bounds of success: an interval above 0.95 counts as the paper's 100 %, an interval below 0.05 as its 0 %."""

_EASY, _AGENTS = "from easy to hard is the order that teaches", "agents of the published family"
_DIFFERENCES: Final = (
    ("Random families do not reach what the published one does", "10, 47, 63 %", "E1-E6", "random"),
    ("Families that are searched for teach more than random ones", "one family", "own", "random"),
    ("To order random families by complexity raises success", "+3, -4, 0 points", "ordered", "random"),
    (f"In the published family {_EASY}", "not compared", "E1-E6", "reversed"),
    (f"In families that are searched for {_EASY}", "not compared", "own", "own, reversed"),
)
"""Claims that one training method is better than another: sentence, published numbers, first and second method."""

_UNITS: Final = {
    "random": "random families",
    "ordered": "random families",
    "own": "searches",
    "own, reversed": "searches",
}
"""The independent units of each sample, each with the mean of its agents; for the published family they are agents."""


@dataclass(frozen=True, slots=True)
class PaperClaim:
    """A sentence of the paper, or an expectation that follows from the paper, with its test.

    Attributes:
        text: the sentence.
        paper: the published result.
        here: the result of the reproduction.
        if_significant: the verdict if the test is significant, or if nothing is tested.
        over: the units of the test, such as "200 searches".
        p_value: the p-value of the two-sided test, with Holm's correction for all claims; None if not tested.
        if_not_significant: the verdict if the test is not significant.
    """

    text: str
    paper: str
    here: str
    if_significant: Verdict
    over: str = ""
    p_value: float | None = None
    if_not_significant: Verdict = "undecided"

    @property
    def verdict(self) -> Verdict:
        """Return `if_significant` if the test is significant or nothing was tested, otherwise `if_not_significant`."""
        is_clear = self.p_value is None or self.p_value < SIGNIFICANT
        return self.if_significant if is_clear else self.if_not_significant

    @property
    def test(self) -> str:
        """Return the p-value and the units as text; "" if nothing was tested."""
        if self.p_value is None:
            return ""
        return f"p {'< 0.001' if self.p_value < 0.001 else f'= {self.p_value:.2g}'}, {self.over}"


def check_paper_claims(found: Reproduction) -> list[PaperClaim]:
    """Return the tested claims in the order of the paper, without those that were not trained or measured."""
    stated = [*_rate_claims(found), *_difference_claims(found), *_time_claims(found)]
    corrected = iter(holm([one.p_value for one in stated if one.p_value is not None]))
    return [one if one.p_value is None else replace(one, p_value=next(corrected)) for one in stated]


def format_rate(rate: float, interval: tuple[float, float] | None = None) -> str:
    """Format a rate and its 95 % interval.

    >>> format_rate(0.5, (0.41, 0.59))
    '50 % (41-59)'
    """
    ends = f" ({100 * interval[0]:.0f}-{100 * interval[1]:.0f})" if interval else ""
    return f"{100 * rate:.0f} %{ends}"


def summaries_by_label(budget: BudgetResults) -> dict[str, Summary]:
    """Return the summaries of the published family's agents, by label."""
    return {one.label: one for one in budget.experiment.summaries()}


def success_interval(sample: FamilySample) -> tuple[float, float]:
    """Return the 95 % interval of the mean success over the families.

    It is the bootstrap interval, or Wilson's interval if each family has one agent.
    """
    if sample.agents == 1:
        return wilson_interval(fmean(sample.success), len(sample.success))
    return bootstrap_interval(sample.success) or (0.0, 1.0)


def _success_values(budget: BudgetResults, name: str) -> Sequence[float]:
    """Return the success of each family of the sample `name`, or of each agent of the curriculum `name`."""
    if name in budget.samples:
        return budget.samples[name].success
    runs = budget.experiment.best_optimistic().runs
    return [run.success_rate for run in runs if run.label == name or run.label.startswith(f"{name} ")]


def _rate_claims(found: Reproduction) -> Iterator[PaperClaim]:
    """Yield the claims of tables 3 and 5 whose published success is 100 % or 0 %."""
    for budget in found.budgets:
        for text, labels in (
            ("Agents that were trained on one environment alone do not succeed on E6", [*AGENTS][:6]),
            ("Agents of the curricula E1-E6 to E4-E6 succeed on E6", [*AGENTS][6:10]),
            ("Agents of E5-E6 do not", [*AGENTS][10:]),
            ("Training on E6 alone cannot solve it, even from optimistic values", ["E6", "optimistic"]),
        ):
            if budget.steps == NORMAL:
                parts = {label: _success_values(budget, label) for label in labels}
                yield _rate_claim(text, AGENTS[labels[0]][0], parts, _AGENTS)
    most = max(found.diversity)
    diverse = sum(one >= most - 1e-9 for one in found.diversity) / len(found.diversity)
    taught, own = (
        {f"{one.steps:,}:": _success_values(one, name) for one in found.budgets} for name in ("E1-E6", "own")
    )
    yield _rate_claim("The published curriculum reaches 100 % with every budget", 1.0, taught, _AGENTS)
    claim = _rate_claim("Families that are searched for teach", 1.0, own, _UNITS["own"])
    yield replace(claim, here=f"{format_rate(diverse)} of them have {most:.3f} bits; one agent each, {claim.here}")


def _rate_claim(
    text: str, published_rate: float, success_by_part: Mapping[str, Sequence[float]], units: str
) -> PaperClaim:
    """Return a claim, tested: success is near the published 100 % or 0 % in every part, or far from it in some part.

    Far means on the other side of 50 %. The first test must be significant in all parts, the second in one. Wilson's
    interval inverts these score tests.
    """
    number = min(map(len, success_by_part.values()))
    rates = {name: fmean(part) for name, part in success_by_part.items()}
    alike = [rate if published_rate else 1.0 - rate for rate in rates.values()]  # behave as the published agent
    holds = max(_score_test(NEARLY_ALL - rate, NEARLY_ALL, number) for rate in alike)
    fails = len(success_by_part) * min(_score_test(rate - 0.5, 0.5, number) for rate in alike)
    depends = any(NEARLY_NONE < rate < NEARLY_ALL for rate in alike)
    every = [
        (name, format_rate(rate, wilson_interval(rate, len(success_by_part[name])))) for name, rate in rates.items()
    ]
    otherwise: Verdict = "depends on the seed" if depends else "undecided"
    here = ", ".join(map(" ".join, every))
    return _claim_from_tests(text, format_rate(published_rate), here, (holds, fails), {units: number}, otherwise)


def _score_test(difference: float, bound: float, number: int) -> float:
    return NormalDist().cdf(difference / sqrt(bound * (1.0 - bound) / number))


def _difference_claims(found: Reproduction) -> Iterator[PaperClaim]:
    """Yield a claim for each of `_DIFFERENCES`, tested on the means of the budgets.

    The tests are paired if both samples have the same units.
    """
    for text, paper, name, other in _DIFFERENCES:
        pairs = [[_success_values(budget, one) for budget in found.budgets] for one in (name, other)]
        first, second = (np.mean(one, axis=0) for one in pairs)
        mean = float(first.mean() - second.mean())
        units = {_UNITS.get(one, _AGENTS): len(values) for one, values in ((name, first), (other, second))}
        low, high, p_value = mean_test(mean, *([first - second] if len(units) == 1 else [first, second]))
        here = f"{100 * mean:+z.1f} points ({100 * max(low, -1):+z.1f} to {100 * min(high, 1):+z.1f}): " + ", ".join(
            f"{budget.steps:,}: {format_rate(fmean(one))} against {format_rate(fmean(two))}"
            for budget, one, two in zip(found.budgets, *pairs, strict=True)
        )
        one_sided = (p_value / 2, 1 - p_value / 2)
        yield _claim_from_tests(text, paper, here, one_sided if mean > 0 else one_sided[::-1], units)


def _claim_from_tests(
    text: str,
    paper: str,
    reproduced: str,
    one_sided_p_values: tuple[float, float],
    units: Mapping[str, int],
    otherwise: Verdict = "undecided",
) -> PaperClaim:
    """Return a claim from the p-values of two one-sided tests: that it holds, and that it does not.

    With fewer than 10 units, the claim is undecided.
    """
    p_value = min(1.0, 2 * min(one_sided_p_values)) if min(units.values()) >= FEWEST_UNITS else 1.0
    over = " and ".join(f"{number:,} {name}" for name, number in units.items())
    verdict: Verdict = "holds" if one_sided_p_values[0] < one_sided_p_values[1] else "does not hold"
    return PaperClaim(text, paper, reproduced, verdict, over, p_value, otherwise)


def _time_claims(found: Reproduction) -> Iterator[PaperClaim]:
    """Yield the claim of table 4, about the time of generation, if times were measured."""
    if found.times:
        sizes = {size: seconds for size, seconds in found.times[min(found.times)].items()}
        small, large = min(sizes), max(sizes)
        growth = sizes[large] / sizes[small]
        yield PaperClaim(
            "The time of generation scales well with the size of the map",
            "47 s at 8x8, 50 s at 12x12",
            f"{sizes[small]:.1f} s of CPU at {small}x{small}, {sizes[large]:.1f} s at {large}x{large}",
            "holds" if growth < (large / small) ** 2 else "does not hold",
        )
