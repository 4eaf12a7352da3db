"""Charts and the page."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree as ET

import pytest
from hypothesis import given, strategies as st

from envgraph.draw import contrast, parse_colour
from envgraph.env import LegendEntry
from envgraph.errors import InvalidArgument
from envgraph.learn import (
    FamilyMember,
    TrainingSettings,
    compare,
    controls,
    findings,
    run_experiment,
    sequences,
)
from envgraph.metamodel import Glyph
from envgraph.report import (
    Report,
    ReportSection,
    ReportTable,
    SearchRecord,
    Series,
    TrainingResults,
    chart_png,
    family_report,
    line_chart,
    render_html,
    standalone_chart,
)
from envgraph.report._charts import (
    COLOURS,
    COLOURS_ON_DARK,
    tick_values,
)
from envgraph.report._family_charts import Bar, bar_chart, value_strip
from envgraph.report._html_page import (
    Card,
)
from envgraph.search import LineageBranch, RunStore, generate

SVG = '<svg viewBox="0 0 1 1"></svg>'


def chart(*series: Series) -> ET.Element:
    return ET.fromstring(line_chart(series, x_label="steps", y_label="reward <1>", title="A & B"))


@given(st.floats(-1e6, 1e6), st.floats(1e-3, 1e6))
def test_ticks_cover_the_range_evenly(low: float, width: float) -> None:
    marks = tick_values(low, low + width)
    assert marks[0] <= low + 1e-6 * width and marks[-1] >= low + width - 1e-6 * width
    steps = [b - a for a, b in pairwise(marks)]
    assert 2 <= len(marks) <= 9
    assert max(steps) - min(steps) < 1e-6 * max(steps)


def test_ticks_of_a_single_value_surround_it() -> None:
    for number in (2.0, 0.0, 1e17, -1e110):
        assert tick_values(number, number)[0] < number < tick_values(number, number)[-1]


def test_a_chart_places_points_by_their_values() -> None:
    (line,) = chart(Series("up", (0, 10), (0, 5))).iter("polyline")
    (x1, y1), (x2, y2) = (map(float, point.split(",")) for point in line.attrib["points"].split())
    assert x1 < x2 and y1 > y2  # pixels count downwards


def test_thousands_at_an_axis_are_separated_by_commas() -> None:
    labels = [one.text for one in chart(Series("a", (0, 12_000), (0, 1))).iter() if one.tag.endswith("text")]
    assert "10,000" in labels and not any("\\" in (label or "") for label in labels)


def test_a_chart_is_escaped_and_labelled() -> None:
    root = chart(Series("<b>", (0, 1), (0, 1)))
    texts = [element.text for element in root.iter("text")]
    assert {"steps", "reward <1>", "<b>"} <= set(texts)
    assert root.attrib["aria-label"] == "A & B"


def test_bands_are_drawn_as_polygons_and_dashed_series_with_dashes() -> None:
    root = chart(Series("s", (0, 1), (1, 1), low=(0, 0), high=(2, 2), is_dashed=True))
    (band,) = root.iter("polygon")
    assert len(band.attrib["points"].split()) == 4
    (line,) = root.iter("polyline")
    assert "stroke-dasharray" in line.attrib


def test_a_standalone_chart_uses_colours_without_css_variables(monkeypatch: pytest.MonkeyPatch) -> None:
    chart = line_chart([Series("a", (0, 1), (2, 3))], x_label="x", y_label="y", title="t")
    assert "var(--line-0, #0072b2)" in chart
    alone = standalone_chart(chart)
    assert "stroke: #0072b2" in alone and "var(" not in alone
    monkeypatch.setattr("envgraph.report._charts.find_spec", lambda name: None)
    assert chart_png(alone) is None


def test_a_series_has_the_same_colour_in_all_charts_and_long_labels_fit() -> None:
    first = Series("randomised, with epsilon renewed", (0, 1), (0, 1), number=3)
    both = [Series("other", (0, 1), (1, 0), number=0), first]
    for series in ([first], both):
        text = line_chart(series, x_label="x", y_label="y", title="t")
        assert "--line-3" in text and "--line-1" not in text
    places = [float(place) for place in re.findall(r"<text x=\"([0-9.]+)\" y=\"314", text)]
    assert len(places) == 2 and places[1] - places[0] > 28 + 7 * len("other")


def test_twenty_series_are_drawn_in_different_styles() -> None:
    lines = list(chart(*(Series(f"s{place}", (0, 1), (place, 1)) for place in range(20))).iter("polyline"))
    looks = {(one.attrib["style"], one.attrib.get("stroke-dasharray")) for one in lines}
    assert len(looks) == len(lines) == 20


def test_one_point_is_drawn_as_a_dot() -> None:
    assert len(list(chart(Series("dot", (1,), (1,))).iter("circle"))) == 1


@pytest.mark.parametrize(
    ("generations", "labels"), [((0, 1), "0 1"), ((0, 1, 2), "0 1 2"), ((0.5, 1.0), "0.5 0.6 0.7 0.8 0.9 1")]
)
def test_ticks_of_whole_numbers_are_whole_numbers(generations: tuple[float, ...], labels: str) -> None:
    texts = chart(Series("line", generations, generations)).iter("text")
    assert " ".join(one.text or "" for one in texts if one.get("text-anchor") == "middle").startswith(f"{labels} steps")


def test_a_class_that_a_measure_counts_has_no_column_of_its_own(tmp_path: Path) -> None:
    family = generate("burning_forest/paper.toml", tmp_path / "run.sqlite", generations=1, population=3)
    assert "BurningTile" in family.differing_class_counts()
    burning = [float(number) for number in family.differing_class_counts()["BurningTile"]]
    members = [
        replace(one, measures={**one.measures, "fires": number})
        for one, number in zip(family.members, burning, strict=True)
    ]
    measured = replace(family, members=tuple(members))
    assert [*measured.differing_class_counts()] == [
        name for name in family.differing_class_counts() if name != "BurningTile"
    ]
    shown = [name for card in family_report(measured).cards for name, _ in card.facts]
    assert "BurningTile" not in shown and "VegetationTile" in shown


def test_series_with_missing_or_infinite_values_are_refused() -> None:
    for arguments in ({"x": (0, 1), "y": (0,)}, {"x": (), "y": ()}, {"x": (0,), "y": (float("inf"),)}):
        with pytest.raises(InvalidArgument):
            Series("bad", **arguments)  # type: ignore[arg-type]
    with pytest.raises(InvalidArgument):
        line_chart([], x_label="", y_label="", title="")


class _Balanced(HTMLParser):
    """Fails on tags that are not closed in order."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.links += [value or "" for key, value in attrs if key in ("src", "href")]
        if tag not in ("meta", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_the_page_is_well_formed_self_contained_and_escaped() -> None:
    report = Report(
        title="Family <1>",
        summary="six & more",
        cards=(Card("E1", SVG, (("complexity", "0.5"),), fixed=True),),
        legend=(
            LegendEntry("Road", Glyph("R", "#d0d0d0"), "tile"),
            LegendEntry("Link, not up", Glyph("", "#c92a2a"), "line"),
        ),
        sections=(
            ReportSection("S", ("p < q",), (SVG,), (ReportTable("c", ("a", "b"), (("x", "<y>"),), frozenset({1})),)),
        ),
        facts={"seed": "42"},
    )
    html = render_html(report)
    parser = _Balanced()
    parser.feed(html)
    assert not parser.open and not parser.links
    assert "@import" not in html and "url(" not in html
    assert "Family &lt;1&gt;" in html and "&lt;y&gt;" in html and "p &lt; q" in html
    assert html.count(SVG) == 2
    assert re.search(r'<td class="number">&lt;y&gt;</td>', html)


def test_rendering_a_report_is_deterministic() -> None:
    assert render_html(Report("t", "s")) == render_html(Report("t", "s"))


def test_text_and_lines_have_enough_contrast_in_light_and_dark_mode() -> None:
    page = render_html(Report("t", "s"))
    light, dark = (
        dict(re.findall(r"--([\w-]+): (#\w+)", block)) for block in re.findall(r":root \{(.*?)\}", page, re.S)
    )
    for palette, lines in ((light, COLOURS), (dark, COLOURS_ON_DARK)):
        for ground in (palette["paper"], palette["card"]):
            for ink in (palette["ink"], palette["soft"], palette["mark"], *lines):
                assert contrast(parse_colour(ink), parse_colour(ground)) >= 4.5, (ink, ground)
    assert [dark[f"line-{place}"] for place in range(len(COLOURS))] == list(COLOURS_ON_DARK)


def test_the_summary_names_the_target_as_the_last_member(tmp_path: Path) -> None:
    family = generate("burning_forest/paper.toml", tmp_path / "run.sqlite", generations=0, population=3)
    assert family.members[-1].initial
    target = family.members[-1].name
    said = f"Ordered from the easiest to the hardest; the target {target}, the initial model, is the last. "
    assert family_report(family).summary.startswith(said)
    others = replace(family, members=tuple(replace(one, initial=False) for one in family.members))
    assert f"hardest; {target}, the last, is the target. " in family_report(others).summary
    assert family_report(family).summary.endswith("are not computed yet: run `envgraph verify`.")


@pytest.mark.parametrize(
    ("kinds", "drawn"),
    [
        (("suffixes", "baselines"), ["E1-E3 E2-E3 E3", "E1 E2 E3"]),
        (("full", "direct"), ["E1-E3 E3"]),
        (("baselines",), ["E1 E2 E3"]),
    ],
)
def test_curricula_and_direct_training_share_a_chart_without_the_baselines(
    tmp_path: Path, kinds: tuple[Literal["suffixes", "full", "baselines", "direct"], ...], drawn: list[str]
) -> None:
    family = generate("burning_forest/paper.toml", tmp_path / "run.sqlite", generations=0, population=3)
    members = [FamilyMember(one.name, family.explored(one).tabular) for one in family.members]
    names = [one.name for one in members]
    settings = TrainingSettings(steps_per_environment=20, seeds=1)
    chosen = [one for kind in kinds for one in sequences(names, kind)]
    trained = [TrainingResults(steps, run_experiment(members, settings, chosen)) for steps in (20, 30)]
    learning, *training = family_report(family, trained=trained).sections
    for section in (learning, *training):
        labels = [re.findall(r">(?:curriculum|baseline) ([^<]*)<", one) for one in section.charts]
        assert [" ".join(one) for one in labels] == drawn


@pytest.mark.parametrize(("curricula", "charts"), [("suffixes", 3), ("full", 2)])
def test_controls_are_drawn_in_the_chart_of_the_whole_family(
    tmp_path: Path, curricula: Literal["suffixes", "full"], charts: int
) -> None:
    family = generate("burning_forest/paper.toml", tmp_path / "run.sqlite", generations=0, population=3)
    members = [FamilyMember(one.name, family.explored(one).tabular) for one in family.members]
    names = [one.name for one in members]
    chosen = (
        *sequences(names, curricula),
        *sequences(names, "baselines"),
        *controls(names, optimism=[1.0])[1:],
    )
    found = run_experiment(members, TrainingSettings(steps_per_environment=20, seeds=1), chosen)
    differing = replace(found, runs=tuple(replace(one, mean_return=place / 2) for place, one in enumerate(found.runs)))
    *_, training = family_report(family, trained=[TrainingResults(20, differing)]).sections
    assert len(training.charts) == charts + 1
    legend, profiles = (
        re.findall(r'<text x="[\d.]+" y="3[\d.]+">([^<]*)<', training.charts[place]) for place in (-3, -1)
    )
    expected = [
        "curriculum E1-E3",
        "optimistic 1, epsilon 0.05",
        "reversed",
        "randomised",
        "randomised, renewed",
        "baseline E3",
    ]
    assert legend == profiles == expected
    assert "the whole family beside its controls; every environment alone." in training.text[-1]
    caption = next(table.caption for table in training.tables if "to half" in table.columns)
    assert "of the greedy policy after training" in caption and "Agents explore during training" in caption
    assert training.text[:-1] == tuple(findings(compare(differing)))
    agents, comparisons = training.tables
    assert [row[1] for row in agents.rows if row[0].startswith(("control", "baseline"))] == ["60"] * 7
    assert [row[0] for row in comparisons.rows][-2:] == [
        "domain randomisation",
        "domain randomisation with renewed epsilon",
    ]


def test_counts_of_one_have_a_singular_noun(tmp_path: Path) -> None:
    family = generate("burning_forest/paper.toml", tmp_path / "run.sqlite", generations=0, population=3)
    search = SearchRecord([(0, 0.5, 0, 0), (1, 0.5, 1, 1)], {"`require solvable` is violated": 1}, [0.5])
    page = render_html(family_report(family, search=search))
    assert "1 generation, 1 accepted model, 1 rejected attempt. " in page


def test_the_first_screen_says_what_a_family_is_worth(tmp_path: Path) -> None:
    family = generate("burning_forest/paper.toml", tmp_path / "run.sqlite", seed=1, generations=8, population=3)
    untrained = family_report(family)
    assert untrained.verdict.startswith("3 environments with `complexity` from ")
    assert "of 3 bins" in untrained.verdict and "E1" in untrained.chart
    members = [FamilyMember(one.name, family.explored(one).tabular) for one in family.members]
    settings = TrainingSettings(steps_per_environment=20_000, seeds=4)
    ways = [*sequences([one.name for one in members], "full"), *sequences(["E3"], "direct")]
    report = family_report(family, trained=[TrainingResults(20_000, run_experiment(members, settings, ways))])
    taught, alone = (
        f"{one.success_rate:.0%}" for one in run_experiment(members, settings, ways).best_optimistic().summaries()
    )
    assert report.verdict == (
        f"{taught} of 4 agents solve E3 after 60,000 steps on E1-E3; with as many steps on E3 alone, {alone}."
    )
    assert f"E1-E3 {taught}; E3 alone {alone}" in report.chart
    page = unescape(render_html(report))
    assert page.index(report.verdict) < page.index("<figure")


def test_the_report_of_a_run_shows_rejections_bins_and_changes(tmp_path: Path) -> None:
    family = generate("burning_forest/paper.toml", tmp_path / "run.sqlite", seed=1, generations=30, population=4)
    with RunStore.open(tmp_path / "run.sqlite") as store:
        record, rejected = SearchRecord.of(family, store), store.rejection_counts()
    report = family_report(family, search=record)
    search, changes = report.sections
    assert [row[:2] for row in search.tables[0].rows] == [(why, f"{n:,}") for why, n in rejected.most_common()]
    counts = re.findall(r"accepted models in each bin: ([0-9, ]+)", report.chart)
    assert sum(map(int, counts[0].split(", "))) == len(record.values)
    assert len(search.charts) == 1 and report.chart not in search.charts
    page = unescape(render_html(Report("", "", sections=(changes,))))
    assert changes.lineage is not None
    assert all(f"<li>{text}</li>" in page for text in _changes_below(changes.lineage))
    assert "<strong>E1</strong>" in page


def _changes_below(branch: LineageBranch) -> list[str]:
    return [*branch.changes, *(text for one in branch.branches for text in _changes_below(one))]


def test_bars_end_at_their_values() -> None:
    bars = [Bar("a", 0.5, "50%", (0.25, 0.75)), Bar("a very long label that does not fit anywhere at all", 1.0, "100%")]
    root = ET.fromstring(bar_chart(bars, x_label="share", title="Shares", whole=1.0))
    half, whole = (float(one.attrib["width"]) for one in root.iter("rect"))
    assert half == pytest.approx(whole / 2, abs=0.1)
    assert root.attrib["aria-label"].startswith("Shares: a 50%; a very long label")
    (whisker,) = (one for one in root.iter("line") if one.get("class") == "whisker")
    assert float(whisker.attrib["x2"]) - float(whisker.attrib["x1"]) == pytest.approx(whole / 2, abs=0.1)


def test_a_strip_shows_each_member_and_counts_models_by_bin() -> None:
    members = [("E1", 0.1), ("E2", 0.1), ("E3", 2.0)]
    text = value_strip(members, x_label="size", bounds=[0, 0.5, 1], others=[-1, 0.2, 0.5, 0.9, 7])
    root = ET.fromstring(text)
    assert len([*root.iter("circle")]) == 3
    assert "accepted models in each bin: 2, 3" in root.attrib["aria-label"]
    texts = [one.text for one in root.iter("text")]
    assert {"E1, E2", "E3", "2", "3"} <= set(texts)
    assert len([*ET.fromstring(value_strip(members * 50, x_label="size")).iter("circle")]) < 30


def test_a_return_that_rounds_to_zero_has_no_sign(tmp_path: Path) -> None:
    family = generate("burning_forest/paper.toml", tmp_path / "run.sqlite", generations=0, population=3)
    members = [FamilyMember(one.name, family.explored(one).tabular) for one in family.members]
    chosen = sequences([one.name for one in members], "full")
    found = run_experiment(members, TrainingSettings(steps_per_environment=20, seeds=1), chosen)
    nearly = replace(found, runs=tuple(replace(one, mean_return=-0.001) for one in found.runs))
    text = render_html(family_report(family, trained=[TrainingResults(20, nearly)]))
    assert ">0.00<" in text and "-0.00" not in text
