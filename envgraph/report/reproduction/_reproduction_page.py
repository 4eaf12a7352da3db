"""Write the report page of a reproduction, its charts, and its tables as CSV."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from statistics import fmean

from envgraph.learn import write_csv, write_table
from envgraph.report._charts import Series, line_chart
from envgraph.report._family_report import family_report
from envgraph.report._html_page import Report, ReportSection, ReportTable
from envgraph.report._training_report import (
    TrainingResults,
    format_thousands,
    reward_curve,
    runs_of,
    training_section,
)
from envgraph.report.reproduction._paper_claims import (
    PaperClaim,
    check_paper_claims,
    format_rate,
    success_interval,
    summaries_by_label,
)
from envgraph.report.reproduction._published import AGENTS, NORMAL, RANDOM, TIMES
from envgraph.report.reproduction._training_runs import BudgetResults, FamilySample, Reproduction

_SAMPLES = {
    "random": "random families",
    "ordered": "random families, ordered",
    "own": "families of our own",
    "own, reversed": "families of our own, reversed",
}


def reproduction_report(found: Reproduction, facts: dict[str, str] | None = None) -> Report:
    """Return the report: the verdicts, the paper's tables beside ours, and all training on the published family."""
    target, drawn = found.family.members[-1].name, reward_charts(found)
    stated = check_paper_claims(found)
    held = ReportSection(
        "What holds",
        (*map(_format_claim, stated), _SUMMARY.format(sum(one.p_value is not None for one in stated))),
    )
    beside = ReportSection(
        "The tables of the paper, with many seeds",
        charts=tuple(drawn.values()),
        tables=tuple(table for table in (table_3(found), table_4(found), table_5(found)) if table.rows),
    )
    trained = [training_section(TrainingResults(one.steps, one.experiment), target) for one in found.budgets]
    page = family_report(found.family, facts=facts)
    summary = (
        f"The experiments of Liu and David (MODELS 2026) with {found.seeds} training seeds instead of one, and with "
        "controls. Below is the published family."
    )
    title = "A reproduction: families of reinforcement learning environments"
    return replace(page, title=title, summary=summary, sections=(held, beside, *trained))


def _format_claim(claim: PaperClaim) -> str:
    """Format a claim as text.

    >>> _format_claim(PaperClaim("Nothing is learnt", "0 %", "3 % (1-5)", "holds", "90 agents", 0.04321))
    'Nothing is learnt: holds (p = 0.043, 90 agents). In the paper 0 %; here 3 % (1-5).'
    """
    test = f" ({claim.test})" if claim.test else ""
    return f"{claim.text}: {claim.verdict}{test}. In the paper {claim.paper}; here {claim.here}."


_SUMMARY = (
    "Success is the share of agents whose greedy policy reaches the goal of E6, with its 95 % interval in brackets "
    "(Wilson's interval; for differences, Student's). A claim holds if success is above 95 % or below 5 %, as the "
    "paper states, or if a difference (mean of the budgets) is above 0. Its p-value is that of the score test or of "
    "Student's t, with Holm's correction for all {} tested claims; comparisons further below are corrected by budget. "
    "Claims about families that are searched for are tested over searches, each with the mean of its agents. Claims "
    "about the published family are tested over its agents, and say nothing about other families. A claim depends on "
    "the seed if the agents of only some seeds behave as the published agent. With fewer than ten "
    "units a claim is undecided."
)


def claims_table(found: Reproduction) -> ReportTable:
    """Return a table with one row for each claim."""
    rows = tuple((one.text, one.paper, one.here, one.test, one.verdict) for one in check_paper_claims(found))
    columns = ("claim", "paper", "here", "p after Holm", "verdict")
    return ReportTable("Claims of the paper, and what follows from them.", columns, rows)


def table_3(found: Reproduction) -> ReportTable:
    """Return table 3: success of agents of the published family on the target."""
    rows = []
    for budget in found.budgets:
        if budget.steps == NORMAL:
            every = summaries_by_label(budget)
            for label, (success, mean) in AGENTS.items():
                one = every[label]
                here = format_rate(one.success_rate, one.success_interval)
                rows.append((label, format_rate(success), here, f"{mean:.1f}", f"{one.mean_return:z.2f}"))
    caption = f"Table 3: success and mean return on E6 after {NORMAL:,} steps an environment, by what was trained on."
    return ReportTable(caption, ("trained on", "paper", "here", "return", "here"), tuple(rows), frozenset(range(1, 5)))


def table_4(found: Reproduction) -> ReportTable:
    """Return table 4: time of generation."""
    rows = tuple(
        (str(population), f"{size}x{size}", f"{TIMES[population][size]:,}", f"{seconds:.1f}")
        for population, sizes in found.times.items()
        for size, seconds in sizes.items()
    )
    caption = "Table 4: seconds that 1,000 generations take, on the paper's machine, and of CPU time on this one."
    return ReportTable(caption, ("family", "map", "paper", "here"), rows, frozenset(range(4)))


def table_5(found: Reproduction) -> ReportTable:
    """Return table 5: success with random families and with families of our own."""
    rows = []
    for budget in found.budgets:
        published, every = RANDOM.get(budget.steps, {}), summaries_by_label(budget)
        lines = [
            (text, name, format_rate(one.success_rate, one.success_interval), one.mean_return)
            for text, name, one in (
                ("direct training on E6", "direct", every["E6"]),
                ("the published family", "curriculum", every["E1-E6"]),
            )
        ]
        lines += [
            (_SAMPLES[name], name, format_rate(fmean(one.success), success_interval(one)), fmean(one.returns))
            for name, one in budget.samples.items()
        ]
        for text, name, here, mean in lines:
            success, reward = published.get(name, (None, None))
            rows.append(
                (
                    f"{budget.steps:,}",
                    text,
                    "" if success is None else format_rate(success),
                    here,
                    "" if reward is None else f"{reward:.2f}",
                    f"{mean:z.2f}",
                )
            )
    caption = "Table 5: success and mean return on E6 by budget, against random families and families of our own."
    columns = ("steps an environment", "trained on", "paper", "here", "return", "here")
    return ReportTable(caption, columns, tuple(rows), frozenset((0, 2, 3, 4, 5)))


def reward_charts(found: Reproduction) -> dict[str, str]:
    """Return an SVG chart for each budget: cumulative reward of the published family and of all other families."""
    return {f"random_families_{one.steps}": _reward_chart(one) for one in found.budgets}


def _reward_chart(budget: BudgetResults) -> str:
    every = summaries_by_label(budget)
    lines = [reward_curve(every[label], runs_of(budget.experiment, every[label])) for label in ("E1-E6", "E6")]
    lines += [_sample_line(_SAMPLES[name], one) for name, one in budget.samples.items()]
    title = f"Cumulative reward during training, {format_thousands(budget.steps)} steps an environment"
    return line_chart(lines, x_label=f"training step ({title[19:]})", y_label="cumulative reward", title=title)


def _sample_line(label: str, sample: FamilySample) -> Series:
    edges = [(mean - width, mean + width) for mean, width in zip(sample.reward, sample.spread, strict=True)]
    low, high = zip(*edges, strict=True)
    return Series(label, tuple(map(float, sample.steps)), sample.reward, low, high, is_dashed=True)


def write_tables(found: Reproduction, directory: Path) -> list[Path]:
    """Write every table as a CSV file, and the results of each agent of the published family; return the tables' paths.

    Missing directories are created; files of the same name are replaced.
    """
    named = {
        "claims": claims_table(found),
        "table_3": table_3(found),
        "table_4": table_4(found),
        "table_5": table_5(found),
        "families": _families_table(found),
    }
    directory.mkdir(parents=True, exist_ok=True)
    written = []
    for name, table in named.items():
        if table.rows:
            written.append(directory / f"{name}.csv")
            write_table(written[-1], table.columns, table.rows)
    for budget in found.budgets:
        write_csv(budget.experiment, directory / "published" / str(budget.steps))
    return written


def _families_table(found: Reproduction) -> ReportTable:
    """Return a table with one row for each family of each sample."""
    rows = tuple(
        (str(budget.steps), name, str(place), repr(success), repr(mean))
        for budget in found.budgets
        for name, one in budget.samples.items()
        for place, (success, mean) in enumerate(zip(one.success, one.returns, strict=True), start=1)
    )
    return ReportTable("", ("steps_per_environment", "sample", "family", "success_rate", "mean_return"), rows)
