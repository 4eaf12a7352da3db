"""Write the report page of a family."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import Final

from envgraph.code import dataclass
from envgraph.env import legend
from envgraph.errors import count_with_noun
from envgraph.learn import Experiment, Summary
from envgraph.report._charts import Series, line_chart
from envgraph.report._family_charts import Bar, bar_chart, value_strip
from envgraph.report._html_page import Card, Report, ReportSection, ReportTable
from envgraph.report._training_report import (
    TrainingResults,
    budget_charts,
    format_thousands,
    thin_points,
    training_section,
)
from envgraph.search import (
    BinnedEntropy,
    Family,
    LineageBranch,
    Outcome,
    RunStore,
    format_certificates,
    format_measure,
    format_measures,
    lineage_tree,
)

MOST_CARDS: Final = 200
"""The most members with a picture and a place in the tree of changes; a page of more would be too large to read."""


@dataclass(frozen=True, slots=True)
class SearchRecord:
    """The parts of a run's search that its report shows.

    Attributes:
        history: for each generation its number, its diversity, and the numbers of accepted and rejected children.
        rejections: the number of rejected attempts, by the reason.
        values: the measure of diversity of each accepted model.
        lineage: the rule applications that lead to the members; None if there are too many members.
    """

    history: Sequence[tuple[int, float, int, int]] = ()
    rejections: Mapping[str, int] = field(default_factory=dict)
    values: Sequence[float] = ()
    lineage: LineageBranch | None = None

    @classmethod
    def of(cls, family: Family, store: RunStore) -> SearchRecord:
        """Read the record of the search that generated a family."""
        name = family.domain.problem(family.domain.engine()).diversity_measure_name
        values = [one.measures[name] for one in store.individuals() if name in one.measures]
        readable = store.imported is None and len(family.members) <= MOST_CARDS
        lineage = lineage_tree(store, family) if readable else None
        return cls(store.generation_statistics(), store.rejection_counts(), values, lineage)


Cell = str | int | float | None
"""A cell of a table; numbers are not formatted."""


def family_report(
    family: Family,
    *,
    search: SearchRecord | None = None,
    trained: Sequence[TrainingResults] = (),
    facts: Mapping[str, str] | None = None,
) -> Report:
    """Return the report of a family, of the search that created it, and of the agents trained on it.

    Args:
        family: the family.
        search: the record of the search; None if there was none.
        trained: the results of training, by increasing budget.
        facts: what is needed to repeat the run, shown at the end.
    """
    sections, outcome = [], Outcome.of(family)
    verdict, chart = verdict_and_chart(family, outcome, trained, search.values if search else ())
    if trained:
        sections.append(_stages_section(family, trained))
    sections += [training_section(one, family.members[-1].name) for one in trained]
    if search is not None:
        sections += _search_sections(family, outcome, search, chart)
    count, classes = len(family.members), family.differing_class_counts()
    target = family.members[-1].name
    best = "".join(f"{one.suffix and f' {one.student}:'} {way}" for one in trained if (way := one.best_way(target)))
    result = f" Result: {outcome}." if str(outcome) else ""
    shown = family.members[:MOST_CARDS]
    others = f" Pictures show the first {MOST_CARDS} of {count:,} environments." if count > len(shown) else ""
    return Report(
        title=f"{family.name}: a family of {count} environments",
        summary=f"{_order_sentence(family)}{result}{_unverified_note(family)}{best}{others}",
        verdict=verdict,
        chart=chart,
        cards=tuple(_member_card(family, place, classes) for place in range(len(shown))),
        legend=legend(scene for member in shown if (scene := family.scene(member))),
        sections=tuple(sections),
        facts=facts or {},
    )


def _unverified_note(family: Family) -> str:
    """Return a note if a family with environments has no certificates, otherwise ""."""
    if family.domain.behaviour is None or any(one.certificates for one in family.members):
        return ""
    return " Shortest plans and optimal returns are not computed yet: run `envgraph verify`."


def _order_sentence(family: Family) -> str:
    """Return a sentence that names the order of the members and the target."""
    target, spec = family.members[-1], family.domain.spec
    if spec.searches_whole_families and spec.curriculum.order is None:
        return f"In the order that the search found; the target {target.name}, the initial model, is the last."
    if target.initial:
        return f"Ordered from the easiest to the hardest; the target {target.name}, the initial model, is the last."
    return f"Ordered from the easiest to the hardest; {target.name}, the last, is the target."


def stage_rows(family: Family, trained: Sequence[TrainingResults] = ()) -> list[dict[str, Cell]]:
    """Return the rows of `stage_table` by column, with numbers: success from 0 to 1, None for unknown values."""
    columns, rows = _stage_cells(family, trained)
    return [dict(zip([name for name, _ in columns], row, strict=True)) for row in rows]


def stage_table(family: Family, trained: Sequence[TrainingResults] = ()) -> ReportTable:
    """Return a table with one row for each environment: measures, numbers of objects of varying classes, and results.

    Success and return are those of agents that were trained on the curriculum up to the environment, on that
    environment. A last row has the results of training on the target alone, if there was any.
    """
    columns, rows = _stage_cells(family, trained)
    measures = {
        name: format_measure([one.measures[name] for one in family.members]) for name in family.members[0].measures
    }
    cells = [
        [*measures[name], *("" for _ in rows[len(family.members) :])]
        if name in measures
        else ["" if row[place] is None else format(row[place], as_) for row in rows]
        for place, (name, as_) in enumerate(columns)
    ]
    shown = tuple(zip(*cells, strict=True))
    about = "Success and return: agents trained on the curriculum up to each environment, evaluated there"
    about += "; by the number of training steps on each environment." if len(trained) > 1 else "."
    return ReportTable(about, tuple(name for name, _ in columns), shown, frozenset(range(1, len(columns))))


def _stage_cells(
    family: Family, trained: Sequence[TrainingResults]
) -> tuple[list[tuple[str, str]], list[tuple[Cell, ...]]]:
    """Return the columns of the stage table, each with its name and number format, and the rows."""
    measures = list(family.members[0].measures)
    varying = family.differing_class_counts()
    reached = [{one.label: one for one in budget.stages.summaries()} if budget.stages else {} for budget in trained]
    first, target = family.members[0].name, family.members[-1].name
    rows: list[tuple[Cell, ...]] = []
    for place, member in enumerate(family.members):
        label = member.name if member.name == first else f"{first}-{member.name}"
        counts = (numbers[place] for numbers in varying.values())
        results = (cell for summaries in reached for cell in _result_cells(summaries.get(label)))
        rows.append((member.name, *(member.measures[name] for name in measures), *counts, *results))
    alone = [_baseline_summary(budget.experiment, target) for budget in trained]
    if any(alone):
        blank = [None] * (len(measures) + len(varying))
        rows.append((f"{target} alone", *blank, *(cell for one in alone for cell in _result_cells(one))))
    columns = [("environment", ""), *((name, "") for name in measures)]
    columns += [(name, "") for name in varying]
    for budget in trained:
        at = f" at {format_thousands(budget.steps)}{budget.suffix}" if len(trained) > 1 else budget.suffix
        columns += [(f"success{at}", ".0%"), (f"return{at}", "z.2f")]
    return columns, rows


def _baseline_summary(experiment: Experiment, label: str) -> Summary | None:
    found = [one for one in experiment.summaries() if (one.kind, one.label) == ("baseline", label)]
    return found[0] if found else None


def _result_cells(summary: Summary | None) -> tuple[float | None, float | None]:
    return (None, None) if summary is None else (summary.success_rate, summary.mean_return)


def _member_card(family: Family, place: int, classes: Mapping[str, Sequence[int]]) -> Card:
    member = family.members[place]
    facts = format_measures(family, member)
    facts += [(cls, str(numbers[place])) for cls, numbers in classes.items()]
    facts += format_certificates(member, family.members)
    return Card(member.name, family.svg(member), tuple(facts), member.initial)


def _search_sections(family: Family, outcome: Outcome, search: SearchRecord, shown: str) -> list[ReportSection]:
    """Return the sections on the course of the search, and on the changes that lead to the members.

    `shown` is the chart at the head of the page, which is not repeated.
    """
    sections = []
    if len(search.history) > 1 or search.rejections:
        sections.append(_search_section(family, outcome, search, shown))
    if search.lineage is not None and search.lineage.branches:
        text = (
            "The rule applications that lead from the initial model to each environment. "
            "Environments on one branch share the changes before it."
        )
        sections.append(ReportSection("Changes from the initial model", (text,), lineage=search.lineage))
    return sections


def _search_section(family: Family, outcome: Outcome, search: SearchRecord, shown: str) -> ReportSection:
    unit = f" {outcome.unit}" if outcome.unit else ""
    accepted, rejected = len(search.values), sum(search.rejections.values())
    sentences = [
        f"{count_with_noun(max(0, len(search.history) - 1), 'generation')}, "
        f"{count_with_noun(accepted, 'accepted model')}, {count_with_noun(rejected, 'rejected attempt')}."
    ]
    charts = []
    if len(search.history) > 1:
        points = thin_points(search.history)
        sentences.append(f"The last family has a diversity of {search.history[-1][1]:.3f}{unit}.")
        charts = [
            line_chart(
                [Series("diversity", tuple(float(row[0]) for row in points), tuple(row[1] for row in points))],
                x_label="generation",
                y_label=f"{family.domain.spec.diversity.kind.replace('_', ' ')}{unit and f',{unit}'}",
                title="Diversity of the family over the generations",
            )
        ]
    if outcome.bins:
        strip = _strip(family, search.values)
        place = "at the head of the page" if strip == shown else "below"
        sentences.append(
            f"In the chart {place}, each dot is an environment at its value. "
            "Numbers below bins count the accepted models in them."
        )
        charts = ([] if strip == shown else [strip]) + charts
    tables = []
    if search.rejections:
        counts = sorted(search.rejections.items(), key=lambda one: (-one[1], one[0]))
        rows = tuple((reason, f"{count:,}", f"{count / rejected:.0%}") for reason, count in counts)
        tables = [ReportTable("Why attempts were rejected.", ("reason", "attempts", "share"), rows, frozenset({1, 2}))]
    return ReportSection("Search", (" ".join(sentences),), tuple(charts), tuple(tables))


def _strip(family: Family, others: Sequence[float] = ()) -> str:
    """Return the chart of the members' values of the diversity measure, with its bins if it has any."""
    problem = family.domain.problem(family.domain.engine())
    name, bins = problem.diversity_measure_name, problem.diversity
    bounds: tuple[float, ...] = ()
    if isinstance(bins, BinnedEntropy):
        width = (bins.high - bins.low) / bins.bins
        bounds = tuple(bins.low + place * width for place in range(bins.bins + 1))
    values = [(member.name, member.measures[name]) for member in family.members]
    return value_strip(values, x_label=name, bounds=bounds, others=others)


def verdict_and_chart(
    family: Family, outcome: Outcome, trained: Sequence[TrainingResults], accepted: Sequence[float] = ()
) -> tuple[str, str]:
    """Return a sentence that says what a family is worth, and the chart that shows it.

    These are the results of training with the largest budget, or else those for the objective, or else the diversity.
    `accepted` has the diversity measure of all accepted models.
    """
    target = family.members[-1].name
    for results in reversed(trained):
        if found := _training_verdict(results, target):
            return found
    if "steps" in outcome.objective:
        return _objective_verdict(family, outcome)
    problem = family.domain.problem(family.domain.engine())
    name, diversity = problem.diversity_measure_name, problem.diversity
    values = [member.measures[name] for member in family.members]
    verdict = f"{count_with_noun(len(values), 'environment')} with `{name}` from {min(values):.3g} to {max(values):.3g}"
    if isinstance(diversity, BinnedEntropy):
        verdict += f", in {len(set(outcome.bins))} of {diversity.bins} bins"
    return f"{verdict}. Train agents on them with `envgraph train` to see what they teach.", _strip(family, accepted)


def _objective_verdict(family: Family, outcome: Outcome) -> tuple[str, str]:
    """Return the verdict on a family that was searched for new learners, and bars of what they reach."""
    said, names = outcome.objective, [member.name for member in family.members]
    success, *_ = said.values()
    steps, alone = f"{said['steps']:,.0f}", said["alone"]
    verdict = (
        f"{success:.0%} of new learners solve {outcome.target} after {steps} steps on these environments, "
        f"{alone:.0%} after as many steps on {outcome.target} alone."
    )
    bars = [Bar(f"{names[0]} to {names[-1]}", success, f"{success:.0%}", emphasised=True)]
    if "unsearched" in said:
        bars.append(Bar("before the search", said["unsearched"], f"{said['unsearched']:.0%}"))
    bars.append(Bar(f"{outcome.target} alone", alone, f"{alone:.0%}"))
    title = f"Success on {outcome.target} after {steps} steps"
    return verdict, bar_chart(
        bars, x_label=f"share of new learners that solve {outcome.target}", title=title, whole=1.0
    )


def _training_verdict(results: TrainingResults, target: str) -> tuple[str, str] | None:
    """Return the verdict on a family that agents were trained on, and bars for each way to train.

    Return None if no agents were trained on a curriculum and on the target alone.
    """
    summaries = results.experiment.best_optimistic().summaries()
    taught = next((one for one in summaries if one.kind == "curriculum"), None)
    alone = next((one for one in summaries if (one.kind, one.label) == ("baseline", target)), None)
    if taught is None or alone is None:
        return None
    others = [one for one in summaries if one.kind == "control" and one.steps == taught.steps]
    bars = [_way_bar(one, results.can_succeed, one is taught) for one in (taught, *others, alone)]
    bars[1:] = sorted(bars[1:], key=lambda bar: -bar.value)
    first, last = bars[0], next(bar for bar in bars if bar.label == f"{target} alone")
    what = f"of {taught.runs} agents solve {target}" if results.can_succeed else f"is the mean return on {target}"
    after = f"after {taught.steps:,} steps"
    verdict = f"{first.text} {what} {after} on {taught.label}; with as many steps on {target} alone, {last.text}."
    if others:
        best = next(bar for bar in bars[1:] if bar is not last)
        verdict += f" The best control, {best.label}: {best.text}."
    axis = f"share of agents that solve {target}" if results.can_succeed else f"mean return on {target}"
    whole = 1.0 if results.can_succeed else None
    title = f"Results on {target} {after}{results.suffix}, with intervals at 95 %"
    return verdict, bar_chart(bars, x_label=axis, title=title, whole=whole)


def _way_bar(summary: Summary, by_success: bool, emphasised: bool) -> Bar:
    label = f"{summary.label} alone" if summary.kind == "baseline" else summary.label
    if by_success:
        return Bar(label, summary.success_rate, f"{summary.success_rate:.0%}", summary.success_interval, emphasised)
    return Bar(label, summary.mean_return, f"{summary.mean_return:z.2f}", summary.return_interval, emphasised)


def _stages_section(family: Family, trained: Sequence[TrainingResults]) -> ReportSection:
    students = dict.fromkeys(one.student for one in trained)
    alike = [[one for one in trained if one.student == student] for student in students]
    charts = [budget_charts(ones, family.members[-1].name) for ones in alike if len(ones) > 1]
    return ReportSection(
        "Learning along the curriculum", charts=sum(charts, ()), tables=(stage_table(family, trained),)
    )
