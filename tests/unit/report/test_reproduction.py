"""The paper's experiments made again: what is trained, what is said of it, what is written."""

import csv
from dataclasses import replace
from pathlib import Path

import pytest

from envgraph.errors import InvalidArgument
from envgraph.learn import Experiment
from envgraph.report import render_html
from envgraph.report.reproduction import (
    Claim,
    Reproduction,
    _runs,
    claims,
    figures,
    generation_times,
    published_files,
    reproduce,
    reproduction_report,
    write_tables,
)
from tests.unit.learn.forest_tables import DATA


@pytest.fixture(scope="module")
def found() -> Reproduction:
    """With two of the random families."""
    with pytest.MonkeyPatch.context() as patch:
        family, random = published_files()
        patch.setattr(_runs, "published_files", lambda: (family, random[:2]))
        times = {6: {8: 1.0, 12: 2.0}}
        return replace(reproduce(seeds=2, budgets=(50_000, 300), times=False), times=times)


def held(found: Reproduction) -> dict[str, Claim]:
    return {claim.text: claim for claim in claims(found)}


def test_what_is_trained_is_what_the_paper_trains(found: Reproduction) -> None:
    family, random = published_files()
    assert len(random) == 30 and family.text == (DATA / "environment-config.json").read_text()
    assert [budget.steps for budget in found.budgets] == [300, 50_000]
    for budget in found.budgets:
        runs = {(run.label, run.seed): run for run in budget.experiment.runs}
        assert {seed for _, seed in runs} == {0, 1}
        assert {"E1-E6", "E5-E6", "E1", "E6", "optimistic 4.394", "reversed", "randomised"} <= {
            one for one, _ in runs
        }
        assert runs["E1-E6", 0].steps == runs["E6", 0].steps == 6 * budget.steps
        assert {name: len(one.success) for name, one in budget.samples.items()} == {
            "random": 2,
            "ordered": 2,
            "own": 2,
            "own, reversed": 2,
        }
    assert found.diversity == pytest.approx([2.585, 2.585], abs=1e-3)
    again = found.budgets[1].experiment
    assert {run.success_rate for run in again.runs if run.label == "E1-E6"} == {1.0}
    assert {run.success_rate for run in again.runs if run.label == "E6"} == {0.0}


def with_success(found: Reproduction, label: str, successes: int, of: int) -> Reproduction:
    """As if so many of the agents of a curriculum had succeeded with the normal budget."""
    budget = found.budgets[1]
    runs: list[object] = [run for run in budget.experiment.runs if run.label != label]
    (one, *_) = (run for run in budget.experiment.runs if run.label == label)
    runs += [replace(one, seed=seed, success_rate=float(seed < successes)) for seed in range(of)]
    return replace(found, budgets=(replace(budget, experiment=Experiment(tuple(runs))),))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("successes", "verdict"),
    [(0, "holds"), (3, "holds"), (80, "depends on the seed"), (199, "does not hold")],
)
def test_a_claim_is_judged_by_the_interval_of_the_success(
    found: Reproduction, successes: int, verdict: str
) -> None:
    claim = held(with_success(found, "E5-E6", successes, 200))["Agents of E5-E6 do not"]
    assert claim.verdict == verdict
    assert claim.paper == "0 %"
    assert f"E5-E6 {successes / 200:.0%}".replace("%", " %") in claim.here


def test_with_few_seeds_nothing_is_decided(found: Reproduction) -> None:
    claim = held(found)["Agents of E5-E6 do not"]
    assert (claim.verdict, claim.here) == ("undecided", "E5-E6 0 % (0-66)")
    assert held(found)["The generated curriculum reaches 100 % with every budget"].verdict != "holds"
    growth = held(found)["The time of generation scales well with the size of the map"]
    assert (growth.here, growth.verdict) == ("1.0 s at 8x8, 2.0 s at 12x12", "holds")


def test_the_page_and_the_tables_say_the_same(found: Reproduction, tmp_path: Path) -> None:
    page = render_html(reproduction_report(found))
    assert "The tables of the paper, with many seeds" in page and page.count("</svg>") > 10
    assert figures(found).keys() == {"random_families_300", "random_families_50000"}
    written = write_tables(found, tmp_path / "new")
    assert [path.name for path in written] == [
        "claims.csv",
        "table_3.csv",
        "table_4.csv",
        "table_5.csv",
        "families.csv",
    ]
    with (tmp_path / "new" / "claims.csv").open() as file:
        for row in csv.DictReader(file):
            assert row["verdict"] in page and row["claim"] in page
    with (tmp_path / "new" / "table_3.csv").open() as file:
        rows = [*csv.reader(file)]
    assert rows[7][:3] == ["E1-E6", "100 %", "100 % (34-100)"]
    assert (tmp_path / "new" / "published" / "300" / "runs.csv").exists()


def test_generation_is_timed_for_maps_of_any_size() -> None:
    times = generation_times(sizes=(8, 9), populations=(3,), generations=2)
    assert times.keys() == {3} and times[3].keys() == {8, 9}
    assert all(seconds > 0 for seconds in times[3].values())


def test_a_number_that_is_not_positive_is_refused() -> None:
    with pytest.raises(InvalidArgument, match="`seeds` and `budgets` must be positive"):
        reproduce(seeds=0)
