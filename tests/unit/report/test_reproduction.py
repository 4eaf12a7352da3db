"""The paper's experiments made again: what is trained, what is said of it, what is written."""

import csv
from dataclasses import replace
from pathlib import Path
from time import sleep
from types import SimpleNamespace

import numpy as np
import pytest

from envgraph.errors import InvalidArgument
from envgraph.learn import Experiment, mean_test, wilson_interval
from envgraph.report import render_html
from envgraph.report.reproduction import (
    PaperClaim,
    _training_runs,
    check_paper_claims,
    reproduce,
    reproduction_report,
    reward_charts,
    write_tables,
)
from envgraph.report.reproduction._published import (
    published_files,
)
from envgraph.report.reproduction._training_runs import (
    Reproduction,
    generation_times,
)
from tests.unit.learn.forest_tables import DATA


@pytest.fixture(scope="module")
def found() -> Reproduction:
    """With two of the random families."""
    with pytest.MonkeyPatch.context() as patch:
        family, random = published_files()
        patch.setattr(_training_runs, "published_files", lambda: (family, random[:2]))
        times = {6: {8: 1.0, 12: 2.0}}
        return replace(reproduce(seeds=2, budgets=(50_000, 300), times=False), times=times)


def claims_by_text(found: Reproduction) -> dict[str, PaperClaim]:
    return {claim.text: claim for claim in check_paper_claims(found)}


def test_the_trained_curricula_and_budgets_are_those_of_the_paper(found: Reproduction) -> None:
    family, random = published_files()
    assert len(random) == 30 and family.text == (DATA / "environment-config.json").read_text()
    assert [budget.steps for budget in found.budgets] == [300, 50_000]
    for budget in found.budgets:
        runs = {(run.label, run.seed): run for run in budget.experiment.runs}
        assert {seed for _, seed in runs} == {0, 1}
        assert {"E1-E6", "E5-E6", "E1", "E6", "optimistic 4.394", "reversed", "randomised"} <= {one for one, _ in runs}
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
    [(0, "holds"), (3, "undecided"), (80, "depends on the seed"), (199, "does not hold")],
)
def test_the_verdict_of_a_claim_uses_corrected_p_values(found: Reproduction, successes: int, verdict: str) -> None:
    claim = claims_by_text(with_success(found, "E5-E6", successes, 200))["Agents of E5-E6 do not"]
    assert claim.verdict == verdict
    assert claim.paper == "0 %"
    assert f"E5-E6 {successes / 200:.0%}".replace("%", " %") in claim.here
    assert claim.over == "200 agents of the published family"
    if successes == 3:  # Wilson's interval is below 5 %, and p = 0.023; but 11 claims are tested
        assert wilson_interval(3 / 200, 200)[1] < 0.05 < (claim.p_value or 0)


def test_claims_are_undecided_with_few_seeds(found: Reproduction) -> None:
    claim = claims_by_text(found)["Agents of E5-E6 do not"]
    assert (claim.verdict, claim.here) == ("undecided", "E5-E6 0 % (0-66)")
    assert {one.verdict for one in check_paper_claims(found) if one.p_value is not None} <= {
        "undecided",
        "depends on the seed",
    }
    growth = claims_by_text(found)["The time of generation scales well with the size of the map"]
    assert (growth.here, growth.verdict) == ("1.0 s of CPU at 8x8, 2.0 s at 12x12", "holds")


def with_samples(found: Reproduction, **success: list[float]) -> Reproduction:
    """As if the families of samples had come to this success with the only budget."""
    budget = found.budgets[1]
    names = {"reverse": "own, reversed"}
    success |= {"ordered": success["random"]} if "random" in success else {}
    samples = {
        names.get(name, name): replace(budget.samples["own"], success=tuple(values)) for name, values in success.items()
    }
    return replace(found, budgets=(replace(budget, samples={**budget.samples, **samples}),))


SEARCHED = "Families that are searched for teach more than random ones"
EASY = "In families that are searched for from easy to hard is the order that teaches"


def test_claims_about_the_method_are_tested_over_searches(found: Reproduction) -> None:
    better, worse = [1.0] * 11 + [0.9], [0.1] * 29 + [0.2]
    claims = claims_by_text(with_samples(found, own=better, reverse=[*worse[:11], 0.5], random=worse))
    assert (claims[SEARCHED].verdict, claims[SEARCHED].over) == (
        "holds",
        "12 searches and 30 random families",
    )
    assert (claims[EASY].verdict, claims[EASY].over) == ("holds", "12 searches")
    assert claims["Families that are searched for teach"].over == "12 searches"
    opposite = claims_by_text(with_samples(found, own=worse[:12], reverse=better, random=better * 2))
    assert opposite[SEARCHED].verdict == opposite[EASY].verdict == "does not hold"
    few = claims_by_text(with_samples(found, own=better[:9], reverse=worse[:9], random=worse))
    assert few[SEARCHED].verdict == few[EASY].verdict == "undecided", "of nine searches"
    assert (
        claims["In the published family from easy to hard is the order that teaches"]
        == (few["In the published family from easy to hard is the order that teaches"])
    ), "agents of one family say nothing of searches, nor searches of it"


def test_claims_are_rarely_decided_for_random_results(found: Reproduction) -> None:
    rng, raw, stands = np.random.default_rng(0), [], 0
    for _ in range(200):
        own, reverse = (rng.integers(2, size=30) / 1 for _ in range(2))
        claim = claims_by_text(with_samples(found, own=own.tolist(), reverse=reverse.tolist()))[EASY]
        stands += claim.verdict in ("holds", "does not hold")
        raw.append(mean_test(float((own - reverse).mean()), own - reverse)[2])
        assert claim.p_value is not None and claim.p_value >= raw[-1]
    assert 0.02 < np.mean(np.array(raw) < 0.05) < 0.09
    assert stands <= 4, "of 200, since p-values are corrected for all claims"


def test_p_values_are_corrected_for_all_claims_that_are_tested(found: Reproduction) -> None:
    tested = [one for one in check_paper_claims(found) if one.p_value is not None]
    assert len(tested) == 11
    assert f"correction for all {len(tested)} tested claims" in render_html(reproduction_report(found))
    assert [one.text for one in check_paper_claims(found) if one.p_value is None] == [
        "The time of generation scales well with the size of the map"
    ]


def test_the_page_and_the_tables_contain_the_same_results(found: Reproduction, tmp_path: Path) -> None:
    page = render_html(reproduction_report(found))
    assert "The tables of the paper, with many seeds" in page and page.count("</svg>") > 10
    assert reward_charts(found).keys() == {"random_families_300", "random_families_50000"}
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


def test_generation_times_are_measured_in_processor_time(monkeypatch: pytest.MonkeyPatch) -> None:
    def wait(folder: str, store: Path, **options: object) -> SimpleNamespace:
        sleep(0.2)  # as if other programs had the processor
        store.touch()
        return SimpleNamespace(diversity=lambda: 0.0)

    monkeypatch.setattr(_training_runs, "generate", wait)
    assert generation_times(sizes=(8,), populations=(3,))[3][8] < 0.1


def test_a_number_that_is_not_positive_is_refused() -> None:
    with pytest.raises(InvalidArgument, match="`seeds` and `budgets` must be positive"):
        reproduce(seeds=0)
