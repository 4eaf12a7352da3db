"""Decide which claims hold: contrasts that were named before the runs, with intervals and a verdict for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, Literal

import numpy as np

from envgraph.code import dataclass
from envgraph.draw import html_text
from envgraph.learn._comparison import SIGNIFICANT
from envgraph.learn._significance import FEWEST_UNITS, holm, mean_test
from envgraph.learn.audit._audit_settings import PROTOCOL
from envgraph.learn.audit._methods import CONTRASTS, PROBED, Contrast
from envgraph.learn.audit._ranks import Floats
from envgraph.learn.audit._study import Study
from envgraph.solve import probability_of_improvement

Verdict = Literal["stands", "fails", "undecided"]

ALL_DOMAINS: Final = "all domains"


@dataclass(frozen=True, slots=True)
class Finding:
    """The result of the runs for a claim.

    Attributes:
        domain: the name of the domain, or "all domains".
        part: the part of the ladder that the claim is about, or "rank".
        claim: the claim in words; it says that `value` is above 0.
        method, other: the methods that are compared; for a rank correlation the score, and "".
        value: mean difference of success on the held-out levels, paired by seeds; or a rank correlation.
        low, high: 95 % interval, over seeds and over levels.
        improvement: probability that a run of `method` is better than one of `other`.
        p_value: the p-value of `mean_test` over seeds and levels, corrected for all claims together.
        seeds: number of seeds.
        margin: a claim fails if its whole interval is below it, since the effect is too small to matter.
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
    margin: float = PROTOCOL.margin

    @property
    def verdict(self) -> Verdict:
        """Return "stands" if the value is significantly above 0, "fails" if below 0 or too small, else "undecided".

        With fewer than 10 seeds, the verdict is always "undecided".
        """
        if self.seeds < FEWEST_UNITS:
            return "undecided"
        if self.p_value < SIGNIFICANT and self.value > 0.0:
            return "stands"
        return "fails" if self.p_value < SIGNIFICANT or self.high < self.margin else "undecided"

    _repr_html_ = html_text

    def __str__(self) -> str:
        chance = "p < 0.001" if self.p_value < 0.001 else f"p = {self.p_value:.2g}"
        numbers = f"{self.value:+z.3f} [{self.low:+z.3f}, {self.high:+z.3f}], {chance}, {self.seeds} seeds"
        return f"{self.domain}: {self.claim}: {self.verdict} ({numbers})"


def findings_of(studies: Sequence[Study], contrasts: Sequence[Contrast] = CONTRASTS) -> list[Finding]:
    """Return a finding for each claim whose methods were run, per domain and for all, with Holm's correction."""
    found = [one for study in studies for one in (*_test_contrasts([study], contrasts), *_test_rankings(study))]
    if len(studies) > 1:
        found += _test_contrasts(studies, contrasts)
    adjusted = holm([one.p_value for one in found])
    return [replace(one, p_value=p_value) for one, p_value in zip(found, adjusted, strict=True)]


def seed_and_level_test(differences: Floats) -> tuple[float, float, float]:
    """Return low and high of the 95 % interval of the mean of differences [seeds, levels], and its p-value.

    Interval and p-value generalise to other seeds on other levels of the same generator; see `mean_test`.
    """
    return mean_test(float(differences.mean()), *_seed_and_level_means(differences))


def _seed_and_level_means(differences: Floats) -> list[Floats]:
    """Return the mean of each seed [seeds], and the mean of each level [levels]."""
    return [differences.mean(axis=1), differences.mean(axis=0)]


def paired_differences(study: Study, method: str, other: str) -> Floats | None:
    """Return success of `method` minus `other` on held-out levels [common seeds, levels]; None below two seeds."""
    first, second = study.runs_of(method), study.runs_of(other)
    seeds = sorted(first.keys() & second.keys())
    if len(seeds) < 2:
        return None
    found: Floats = np.array([first[seed].success for seed in seeds]) - np.array(
        [second[seed].success for seed in seeds]
    )
    return found


def _test_contrasts(studies: Sequence[Study], contrasts: Sequence[Contrast]) -> list[Finding]:
    """Return a finding for each contrast whose methods were run in all studies, which have equal weight."""
    found = []
    for one in contrasts:
        every = [paired_differences(study, one.method, one.other) for study in studies]
        known = [differences for differences in every if differences is not None]
        if len(known) == len(studies):
            value = np.mean([differences.mean() for differences in known])
            units = [means / len(known) for differences in known for means in _seed_and_level_means(differences)]
            improvement = float(np.mean([_improvement(study, one) for study in studies]))
            name = studies[0].name if len(studies) == 1 else ALL_DOMAINS
            found.append(_make_finding(name, one, value, units, improvement, min(map(len, known))))
    return found


def _improvement(study: Study, claim: Contrast) -> float:
    first, second = study.runs_of(claim.method), study.runs_of(claim.other)
    seeds = sorted(first.keys() & second.keys())
    values, others = ([runs[seed].final_success for seed in seeds] for runs in (first, second))
    return float(probability_of_improvement(values, others))


def _make_finding(
    domain: str, claim: Contrast, mean: np.float64, units: Sequence[Floats], improvement: float, seeds: int
) -> Finding:
    low, high, p_value = mean_test(float(mean), *units)
    about = domain, claim.part, claim.claim, claim.method, claim.other
    return Finding(*about, float(mean), max(-1.0, low), min(1.0, high), improvement, p_value, seeds)


def rank_values(study: Study, score: str, column: str, rollouts: int = PROTOCOL.shown_rollouts) -> list[float]:
    """Return a column of `Ranking` for each student whose score was probed, averaged over points of training."""
    found = []
    for run in study.runs:
        values = [one[column] for one in run.rankings if one["score"] == score and one["rollouts"] == rollouts]
        if values:
            found.append(float(np.mean(values)))
    return found


def _test_rankings(study: Study) -> list[Finding]:
    """Return a finding for each score with two or more students: that it ranks solvable levels by their regret."""
    found = []
    for score in PROBED:
        values = np.array(rank_values(study, score, "regret_solvable"))
        if len(values) > 1:
            claim = Contrast(f"{score} ranks solvable levels by their regret", "rank", score, "")
            levels = np.mean([run.ranked_levels[score] for run in study.runs if run.ranked_levels], axis=0)
            positive = float(np.mean((values > 0.0) + (values == 0.0) / 2))
            found.append(_make_finding(study.name, claim, values.mean(), [values, levels], positive, len(values)))
    return found
