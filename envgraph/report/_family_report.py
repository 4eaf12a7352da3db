"""Write the report page of a family."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from envgraph.env import legend
from envgraph.errors import count_with_noun
from envgraph.learn import Experiment, Summary
from envgraph.report._charts import Series, line_chart
from envgraph.report._html_page import Card, Report, ReportSection, ReportTable
from envgraph.report._training_report import (
    TrainingResults,
    budget_charts,
    format_thousands,
    thin_points,
    training_section,
)
from envgraph.search import Family, Outcome, format_certificates, format_measure, format_measures

History = Sequence[tuple[int, float, int, int]]
"""For each generation its number, its diversity, and the numbers of accepted and rejected children."""


Cell = str | int | float | None
"""A cell of a table; numbers are not formatted."""


def family_report(
    family: Family,
    *,
    history: History = (),
    trained: Sequence[TrainingResults] = (),
    facts: Mapping[str, str] | None = None,
) -> Report:
    """Return the report of a family, of the search that created it, and of the agents trained on it.

    Args:
        family: the family.
        history: the generations of the search, if there was one.
        trained: the results of training, by increasing budget.
        facts: what is needed to repeat the run, shown at the end.
    """
    sections, outcome = [], Outcome.of(family)
    if len(history) > 1:
        sections.append(_search_section(family, outcome, history))
    if trained:
        sections.append(_stages_section(family, trained))
    sections += [training_section(one, family.members[-1].name) for one in trained]
    count, classes = len(family.members), family.differing_class_counts()
    target = family.members[-1].name
    best = "".join(f"{one.suffix and f' {one.student}:'} {way}" for one in trained if (way := one.best_way(target)))
    result = f" Result: {outcome}." if str(outcome) else ""
    return Report(
        title=f"{family.name}: a family of {count} environments",
        summary=f"{_order_sentence(family)}{result}{_unverified_note(family)}{best}",
        cards=tuple(_member_card(family, place, classes) for place in range(count)),
        legend=legend(scene for member in family.members if (scene := family.scene(member))),
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


def _search_section(family: Family, outcome: Outcome, history: History) -> ReportSection:
    points = thin_points(history)
    unit = f" {outcome.unit}" if outcome.unit else ""
    chart = line_chart(
        [Series("diversity", tuple(float(row[0]) for row in points), tuple(row[1] for row in points))],
        x_label="generation",
        y_label=f"{family.domain.spec.diversity.kind.replace('_', ' ')}{unit and f',{unit}'}",
        title="Diversity of the family over the generations",
    )
    accepted, rejected = (int(sum(row[place] for row in history)) for place in (2, 3))
    text = (
        f"{count_with_noun(len(history) - 1, 'generation')}, {count_with_noun(accepted, 'accepted individual')}, "
        f"{count_with_noun(rejected, 'rejected attempt')}. "
        f"The last family has a diversity of {history[-1][1]:.3f}{unit}."
    )
    return ReportSection("Search", (text,), (chart,))


def _stages_section(family: Family, trained: Sequence[TrainingResults]) -> ReportSection:
    students = dict.fromkeys(one.student for one in trained)
    alike = [[one for one in trained if one.student == student] for student in students]
    charts = [budget_charts(ones, family.members[-1].name) for ones in alike if len(ones) > 1]
    return ReportSection(
        "Learning along the curriculum", charts=sum(charts, ()), tables=(stage_table(family, trained),)
    )
