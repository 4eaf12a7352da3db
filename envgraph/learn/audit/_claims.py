"""Which claims stand: contrasts that were named before the runs, with intervals, and a verdict for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, Literal

import numpy as np
from numpy.random import default_rng
from numpy.typing import NDArray

from envgraph.code import dataclass
from envgraph.learn._comparison import SIGNIFICANT
from envgraph.learn._intervals import bootstrap_interval, probability_of_improvement
from envgraph.learn._significance import holm, permutation_test
from envgraph.learn.audit._methods import CONTRASTS, PROBED, Contrast
from envgraph.learn.audit._run import SHOWN_ROLLOUTS
from envgraph.learn.audit._study import Study

Verdict = Literal["stands", "fails", "undecided"]

MARGIN: Final = 0.01
"""A gain in success that is smaller is none: where the whole interval lies below it, the claim fails."""

ENOUGH: Final = 10
"""Seeds from which an interval alone may say so; those of fewer are too narrow."""

RESAMPLES: Final = 2_000

POOLED: Final = "all domains"


@dataclass(frozen=True, slots=True)
class Finding:
    """What the runs say of a claim.

    Attributes:
        domain: where; or all of them together.
        part: of what: the part of the ladder, or "rank".
        claim: in words; it is that `value` is above 0.
        method, other: what is compared; of a rank correlation the score, and "".
        value: mean difference of success on the held-out levels, paired by seeds; or a rank correlation.
        low, high: interval at 95 %, over seeds and over levels; of a rank correlation over seeds.
        improvement: probability that a run of the first is better than one of the second.
        p_value: of the sign-flip test over seeds, corrected for all claims together.
        seeds: how many.
        margin: an interval below it says that there is nothing to speak of.
    """

    domain: str
    part: str
    claim: str
    method: str
    other: str
    value: float
    low: float
    high: float
    improvement: float
    p_value: float
    seeds: int
    margin: float = MARGIN

    @property
    def verdict(self) -> Verdict:
        """Stands, if the value is above 0 beyond chance; fails, if it is below 0, or too small to speak of."""
        if self.p_value < SIGNIFICANT and self.low > 0.0:
            return "stands"
        if self.high < 0.0 and self.p_value < SIGNIFICANT:
            return "fails"
        if self.high < self.margin and self.seeds >= ENOUGH:
            return "fails"
        return "undecided"

    def __str__(self) -> str:
        chance = "p < 0.001" if self.p_value < 0.001 else f"p = {self.p_value:.2g}"
        numbers = f"{self.value:+z.3f} [{self.low:+z.3f}, {self.high:+z.3f}], {chance}, {self.seeds} seeds"
        return f"{self.domain}: {self.claim}: {self.verdict} ({numbers})"


def findings_of(studies: Sequence[Study], contrasts: Sequence[Contrast] = CONTRASTS) -> list[Finding]:
    """What holds of every claim whose methods were run, in each domain and in all together; p-values after Holm."""
    found = [one for study in studies for one in (*_contrasted(study, contrasts), *_ranked(study))]
    if len(studies) > 1:
        found += _pooled(studies, contrasts)
    adjusted = holm([one.p_value for one in found])
    return [replace(one, p_value=p_value) for one, p_value in zip(found, adjusted, strict=True)]


def two_way_interval(
    differences: NDArray[np.float64], *, resamples: int = RESAMPLES, seed: int = 0
) -> tuple[float, float]:
    """Percentile interval at 95 % of the mean of differences [seeds, levels]; both are drawn anew (Owen 2007).

    So it says what other seeds would have given on other levels of the same generator.
    """
    low, high = np.quantile(two_way_means(differences, seed, resamples=resamples), [0.025, 0.975])
    return float(low), float(high)


def two_way_means(
    differences: NDArray[np.float64], seed: int, *, resamples: int = RESAMPLES
) -> NDArray[np.float64]:
    """Means of resampled differences [resamples], see `two_way_interval`."""
    rng, (seeds, levels) = default_rng(seed), differences.shape
    rows = rng.multinomial(seeds, np.full(seeds, 1.0 / seeds), resamples) / seeds
    columns = rng.multinomial(levels, np.full(levels, 1.0 / levels), resamples) / levels
    found: NDArray[np.float64] = ((rows @ differences) * columns).sum(axis=1)
    return found


def paired(study: Study, method: str, other: str) -> NDArray[np.float64] | None:
    """Differences of success on the held-out levels [seeds, levels], for the seeds that both have; None below two."""
    first, second = study.of(method), study.of(other)
    seeds = sorted(first.keys() & second.keys())
    if len(seeds) < 2:
        return None
    found: NDArray[np.float64] = np.array([first[seed].success for seed in seeds]) - np.array(
        [second[seed].success for seed in seeds]
    )
    return found


def _contrasted(study: Study, contrasts: Sequence[Contrast]) -> list[Finding]:
    found = []
    for one in contrasts:
        differences = paired(study, one.method, one.other)
        if differences is None:
            continue
        by_seed = differences.mean(axis=1)
        first, second = study.of(one.method), study.of(one.other)
        seeds = sorted(first.keys() & second.keys())
        improvement = probability_of_improvement(
            [first[seed].final for seed in seeds], [second[seed].final for seed in seeds]
        )
        found.append(
            Finding(
                study.name,
                one.part,
                one.claim,
                one.method,
                one.other,
                float(by_seed.mean()),
                *two_way_interval(differences),
                float(improvement),
                permutation_test(by_seed, np.zeros(len(seeds))),
                len(seeds),
            )
        )
    return found


def rank_values(study: Study, score: str, column: str, rollouts: int = SHOWN_ROLLOUTS) -> list[float]:
    """A number of `Ranking` of each probed student, mean over the points of its training."""
    found = []
    for run in study.runs:
        values = [
            one[column] for one in run.rankings if one["score"] == score and one["rollouts"] == rollouts
        ]
        if values:
            found.append(float(np.mean(values)))
    return found


def _ranked(study: Study) -> list[Finding]:
    """Whether scores rank levels by their regret: the solvable ones alone, since an unsolvable level has none."""
    found = []
    for score in PROBED:
        values = rank_values(study, score, "regret_solvable")
        interval = bootstrap_interval(values) if len(values) > 1 else None
        if interval is None:
            continue
        claim = f"{score} ranks solvable levels by their regret"
        positive = float(np.mean([(value > 0.0) + (value == 0.0) / 2 for value in values]))
        p_value = permutation_test(values, np.zeros(len(values)))
        found.append(
            Finding(
                study.name,
                "rank",
                claim,
                score,
                "",
                float(np.mean(values)),
                *interval,
                positive,
                p_value,
                len(values),
            )
        )
    return found


def _pooled(studies: Sequence[Study], contrasts: Sequence[Contrast]) -> list[Finding]:
    """Contrasts over all domains, each counting the same."""
    found = []
    for one in contrasts:
        every = [paired(study, one.method, one.other) for study in studies]
        known = [differences for differences in every if differences is not None]
        if len(known) < len(studies):
            continue
        seeds = min(map(len, known))
        by_seed = np.mean([differences.mean(axis=1)[:seeds] for differences in known], axis=0)
        spread = [two_way_means(differences, place) for place, differences in enumerate(known)]
        low, high = np.quantile(np.mean(spread, axis=0), [0.025, 0.975])
        improvement = float(
            np.mean(
                [
                    probability_of_improvement(
                        [run.final for run in study.of(one.method).values()],
                        [run.final for run in study.of(one.other).values()],
                    )
                    for study in studies
                ]
            )
        )
        value = float(np.mean([differences.mean() for differences in known]))
        p_value = permutation_test(by_seed, np.zeros(seeds))
        found.append(
            Finding(
                POOLED,
                one.part,
                one.claim,
                one.method,
                one.other,
                value,
                float(low),
                float(high),
                improvement,
                p_value,
                seeds,
            )
        )
    return found
