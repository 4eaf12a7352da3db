"""Write the report page of an audit of level scores."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import log2

import numpy as np

from envgraph.learn import bootstrap_interval
from envgraph.learn.audit import (
    ALL_DOMAINS,
    PROBED,
    PROTOCOL,
    ROLLOUTS,
    Finding,
    MethodSummary,
    Study,
    rank_values,
    summarise_methods,
)
from envgraph.report._audit_charts import IntervalRow, ScatterPanel, interval_chart, scatter_chart
from envgraph.report._charts import Series, line_chart
from envgraph.report._html_page import Report, ReportSection, ReportTable

_ESTIMATED = tuple(score for score in PROBED if not score.startswith("exact"))
_KINDS = ("unsolvable", "hopeless (p < .05)", "in between", "mastered (p > .95)")
_CURVE_METHODS = ("DR", "DR, solvable only", "PLR, random score", "PLR, MaxMC", "SFL, 16 rollouts")
_EXACT_CURVE_METHODS = ("SFL, exact learnability", "PLR, exact regret", "PLR, exact learnability")


def audit_report(
    studies: Sequence[Study], findings: Sequence[Finding], facts: Mapping[str, str] | None = None
) -> Report:
    """Return the report of an audit of one or several domains.

    Args:
        studies: the studies of the domains.
        findings: the result of `findings_of` for the studies.
        facts: what is needed to repeat the audit, shown at the end.
    """
    names = ", ".join(study.name for study in studies)
    counts = {word: sum(one.verdict == word for one in findings) for word in ("stands", "fails", "undecided")}
    said = ", ".join(f"{word} {count}" for word, count in counts.items())
    sections = [_claims_section(findings)]
    for study in studies:
        sections += [_ranks_section(study), _methods_section(study, findings)]
    if len(studies) > 1:
        sections.append(_pooled_section(findings))
    return Report(
        title=f"Scores of levels, audited: {names}",
        summary=f"How scores rank levels, what agents learn from levels chosen by scores, and what scores cost, "
        f"compared with exact regret and exact learnability. Verdicts on the {len(findings)} claims "
        f"stated before the runs: {said}.",
        sections=tuple(sections),
        facts=facts or {},
    )


def audit_figures(studies: Sequence[Study], findings: Sequence[Finding]) -> dict[str, str]:
    """Return the charts of the report by file name without extension."""
    found: dict[str, str] = {}
    for study in studies:
        name = "".join(one if one.isalnum() else "_" for one in study.name)
        charts = (*_ranks_section(study).charts, *_methods_section(study, findings).charts)
        found |= {f"{name}_figure{number}": chart for number, chart in enumerate(charts, 1)}
    return found


def _claims_section(findings: Sequence[Finding]) -> ReportSection:
    domains = list(dict.fromkeys(one.domain for one in findings))
    known = {(one.claim, one.domain): one for one in findings}
    rows = tuple(
        (claim, *(_format_verdict(known.get((claim, domain))) for domain in domains))
        for claim in dict.fromkeys(one.claim for one in findings)
    )
    text = (
        "A claim says that a value is above 0: the difference of success between two methods of choosing levels, "
        "paired by seeds, or a rank correlation. A claim stands if the value is above 0 with p < .05 after Holm's "
        f"correction for all {len(findings)} claims of this page. It fails if the value is below 0 with p < .05, or if "
        "the whole interval is below .01. Otherwise, or with fewer than ten seeds, it is undecided. The 95 % interval "
        "and the p-value come from the same test, over seeds and over levels."
    )
    about = "The claims stated before the runs, and the value of each; tables 1 and 2 have the intervals."
    return ReportSection("Which claims stand", (text,), tables=(ReportTable(about, ("claim", *domains), rows),))


def _format_verdict(one: Finding | None) -> str:
    return "" if one is None else f"{one.verdict} {one.value:+z.3f}"


def _ranks_section(study: Study) -> ReportSection:
    """Return the section with figures 1 and 2, and table 1: the ranking of levels by scores."""
    charts = []
    shown = next((run.shown for run in study.runs if run.shown), None)
    if shown is not None:
        charts.append(_scatter_figure(shown))
    probed = [run for run in study.runs if run.rankings]
    if probed:
        charts.append(_rollouts_figure(study))
    rows = []
    for score in PROBED:
        values = {name: rank_values(study, score, name) for name in _COLUMNS}
        if values["regret"]:
            rows.append((score, *(_format_mean(values[name]) for name in _COLUMNS)))
    solvable = study.levels.solvable[study.levels.probed].mean()
    text = (
        f"Students were trained by domain randomisation. At four points of training, every score was computed for "
        f"{len(study.levels.probed)} levels that they never train on, {solvable:.0%} of them solvable. Rank "
        f"correlations over all levels come in part from unsolvable levels, which have no regret. Correlations over "
        f"solvable levels alone show how a score ranks difficulty.",
        f"Figure 1: each score from {PROTOCOL.shown_rollouts} rollouts against exact regret, half way through the "
        f"training of one student. Figure 2: rank correlation with exact regret over solvable levels, by the number of "
        f"rollouts; a correlation that does not rise with them shows a bias. Mean and interval over "
        f"{len(probed)} students.",
    )
    table = ReportTable(
        f"Table 1: rank correlations of scores from {PROTOCOL.shown_rollouts} rollouts, and the levels in the highest "
        f"tenth of a score; mean over four points of training and {len(probed)} students, with half the width of the "
        f"95 % interval. A random tenth has {1 - solvable:.2f} unsolvable levels. Capture is the tenth's share of the "
        "highest possible regret.",
        ("score", *_COLUMNS.values()),
        tuple(rows),
        frozenset(range(1, 1 + len(_COLUMNS))),
    )
    return ReportSection(f"{study.name}: what scores rank", text, tuple(charts), (table,))


_COLUMNS = {
    "regret_solvable": "regret, solvable only",
    "regret": "regret, all",
    "learnability": "learnability",
    "success": "success",
    "unsolvable": "unsolvable",
    "hopeless": "hopeless",
    "mastered": "mastered",
    "capture": "capture",
    "repeat": "repeat",
}


def _format_mean(values: Sequence[float]) -> str:
    interval = bootstrap_interval(values)
    mean = float(np.mean(values))
    return f"{mean:.2f}" if interval is None else f"{mean:.2f} ± {(interval[1] - interval[0]) / 2:.2f}"


def _mean_line(label: str, x: Iterable[float], samples: Sequence[Sequence[float]], is_dashed: bool = False) -> Series:
    """Return a line of the means of samples, with the 95 % interval of each as its band."""
    means = tuple(float(np.mean(one)) for one in samples)
    low, high = zip(*(bootstrap_interval(one) or (one[0], one[0]) for one in samples), strict=True)
    return Series(label, tuple(x), means, low, high, is_dashed=is_dashed)


def _scatter_figure(shown: Mapping[str, Sequence[float]]) -> str:
    panels = []
    for score in PROBED:
        kinds: list[list[tuple[float, float]]] = [[], [], [], []]
        for regret, success, solvable, value in zip(
            shown["regret"], shown["success"], shown["solvable"], shown[score], strict=True
        ):
            kind = 0 if not solvable else 1 if success < 0.05 else 3 if success > 0.95 else 2
            kinds[kind].append((regret, value))
        panels.append(ScatterPanel(score, tuple(map(tuple, kinds))))
    return scatter_chart(
        panels, _KINDS, x_label="exact regret", y_label="score", title="Figure 1: scores beside exact regret"
    )


def _rollouts_figure(study: Study) -> str:
    series = []
    for score in _ESTIMATED:
        found = [rank_values(study, score, "regret_solvable", rollouts) for rollouts in ROLLOUTS]
        series.append(_mean_line(score, map(log2, ROLLOUTS), found))
    return line_chart(
        series,
        x_label="rollouts, as a power of 2",
        y_label="rank correlation with regret",
        title="Figure 2: rank correlation with exact regret over solvable levels, by the number of rollouts",
    )


def _methods_section(study: Study, findings: Sequence[Finding]) -> ReportSection:
    """Return the section with figures 3 and 4, and tables 2 and 3: the success of training methods."""
    found = summarise_methods(study)
    levels, settings = study.levels, study.settings
    solvable = levels.solvable[levels.training].mean()
    text = (
        f"Each student makes {settings.steps:,} steps, including all steps for scoring, on levels out of "
        f"{len(levels.training):,}, {solvable:.0%} of them solvable. Success is exact: the probability that the "
        f"student's policy succeeds within {settings.policy.limit} steps, on {len(levels.held_out)} solvable "
        f"levels that it never trains on, and on {len(levels.hard)} whose shortest plans are longer than those of 80 % "
        f"of them. Exact scores cost no steps, because they are computed from tables.",
        "Figure 3: differences to domain randomisation, paired by seeds, with intervals over seeds and levels, and the "
        "probability of improvement. Figure 4: success during training, first by steps, then by updates; the second is "
        "fairer to methods that do not learn from all steps.",
    )
    gains = [one for one in found if one.method != "DR" and one.seeds > 1]
    charts = []
    if gains:
        charts.append(_gains_figure(gains, f"Figure 3: {study.name}, success minus that of domain randomisation"))
    charts += [_curves_figure(study, "steps"), _curves_figure(study, "updates")]
    return ReportSection(
        f"{study.name}: what scores teach",
        text,
        tuple(charts),
        (_methods_table(found), _ladder_table(study, findings)),
    )


def _gains_figure(rows: Sequence[MethodSummary], title: str) -> str:
    return interval_chart(
        [
            IntervalRow(
                one.method,
                one.gain,
                one.gain_low,
                one.gain_high,
                f"{one.gain:+z.3f}, PoI {one.improvement:.2f}",
                not one.gain_low <= 0.0 <= one.gain_high,
            )
            for one in rows
        ],
        x_label="success minus that of domain randomisation",
        title=title,
    )


def _curves_figure(study: Study, by: str) -> str:
    series = []
    for method in (*_CURVE_METHODS, *_EXACT_CURVE_METHODS):
        runs = list(study.runs_of(method).values())
        if not runs:
            continue
        curves = np.array([run.curve for run in runs])
        places = np.mean([getattr(run, by) for run in runs], axis=0).tolist()
        series.append(_mean_line(method, places, curves.T.tolist(), is_dashed=method in _EXACT_CURVE_METHODS))
    title = f"Figure 4: {study.name}, success on held-out levels by {by}"
    return line_chart(series, x_label=by, y_label="success on held-out levels", title=title)


def _methods_table(found: Sequence[MethodSummary]) -> ReportTable:
    rows = tuple(
        (
            one.method,
            str(one.seeds),
            f"{one.success:.3f}",
            "" if one.method == "DR" else f"{one.gain:+z.3f}",
            "" if one.method == "DR" else f"{one.at_equal_updates:+z.3f}",
            f"{one.hard:.3f}",
            f"{one.worst:.3f}",
            f"{one.regret:.3f}",
            f"{one.greedy:.3f}",
            f"{one.updates:.0f}",
            f"{one.learned_solvable:.0%}",
        )
        for one in found
    )
    columns = (
        "method",
        "seeds",
        "success",
        "minus DR",
        "at equal updates",
        "hard levels",
        "worst 30 %",
        "regret",
    )
    return ReportTable(
        "Table 3: every method. Success of the stochastic policy, of its likeliest actions (greedy), and of the worst "
        "30 % of the levels (CVaR); the difference to domain randomisation with as many steps, and after as many "
        "updates; the mean exact regret; and the share of solvable levels among the training levels.",
        (*columns, "greedy", "updates", "solvable"),
        rows,
        frozenset(range(1, 11)),
    )


def _ladder_table(study: Study, findings: Sequence[Finding]) -> ReportTable:
    parts = {
        "buffer": "a buffer alone",
        "filter": "a filter alone",
        "score": "the score",
        "cost": "what rollouts cost",
        "precision": "precision alone",
    }
    rows = tuple(
        (
            parts[one.part],
            f"{one.method} minus {one.other}",
            f"{one.value:+z.3f}",
            f"{one.low:+z.3f} to {one.high:+z.3f}",
            "< .001" if one.p_value < 0.001 else f"{one.p_value:.3f}",
            f"{one.improvement:.2f}",
            str(one.seeds),
            one.verdict,
        )
        for one in findings
        if one.domain == study.name and one.part in parts
    )
    return ReportTable(
        "Table 2: the parts of the gain, from domain randomisation to exact scores. p is the p-value of the "
        "test over seeds and levels, with Holm's correction; PoI is the probability of improvement.",
        ("part", "difference", "success", "interval", "p", "PoI", "seeds", "the claim"),
        rows,
        frozenset({2, 4, 5, 6}),
    )


def _pooled_section(findings: Sequence[Finding]) -> ReportSection:
    rows = [
        IntervalRow(
            f"{one.method} - {one.other}"[:42],
            one.value,
            one.low,
            one.high,
            f"{one.value:+z.3f}, {one.verdict}",
            one.verdict != "undecided",
        )
        for one in findings
        if one.domain == ALL_DOMAINS
    ]
    text = "All domains have equal weight; intervals are over seeds and over the levels of each domain."
    chart = interval_chart(rows, x_label="difference of success", title="Figure 3, all domains together")
    return ReportSection("All domains together", (text,), (chart,))
