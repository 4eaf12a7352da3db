"""Runs, and audits that go on."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from envgraph.env.schedules import Sifting
from envgraph.errors import InvalidArgument
from envgraph.learn.audit import (
    METHODS,
    PROBED,
    PROTOCOL,
    AuditMethod,
    AuditRun,
    AuditSettings,
    Study,
    _student_run as one_run,
    _study as module,
    audit,
    findings_of,
    summarise_methods,
    write_audit,
)
from envgraph.learn.audit._audit_levels import (
    AuditLevels,
)
from envgraph.learn.audit._student_run import (
    run_method,
)
from envgraph.learn.audit._study import read_run
from envgraph.search import Domain
from tests.unit.learn.audit.small_levels import corridors, settings

FEW = [METHODS[0], METHODS[1], METHODS[2]]


@pytest.fixture(scope="module")
def domain() -> Domain:
    return Domain.load("keydoor/audit/audit.toml")


@pytest.fixture
def prepared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A directory with levels; runs have their results at once."""
    corridors().save(tmp_path / "levels.npz")
    monkeypatch.setattr(module, "run_method", fake_run_method)
    return tmp_path


def fake_run_method(
    levels: AuditLevels, given: AuditSettings, method: AuditMethod, seed: int, *, domain: Domain | None
) -> AuditRun:
    assert domain is None, "nothing is edited"
    return run(method.name, seed, np.random.default_rng([seed, len(method.name)]).random(8))


def test_a_run_counts_all_steps_and_is_reproducible() -> None:
    levels, given = corridors(), settings()
    first, again = (run_method(levels, given, FEW[2], 1, native=False) for _ in range(2))
    assert first == again
    assert len(first.steps) == len(first.curve) == 8
    assert first.steps[-1] >= given.steps > first.steps[-2]
    sifting = AuditMethod("x", "SFL", Sifting(4, candidates=8, best=2))
    sifted = run_method(levels, given, sifting, 1, native=False)
    assert sifted.updates[-1] < given.steps / 32, "the rollouts took the steps"


def test_probing_does_not_change_the_training_of_the_student(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(one_run, "ROLLOUTS", (1, PROTOCOL.shown_rollouts))
    levels, given = corridors(), settings()
    first = run_method(levels, given, METHODS[0], 0, native=False)
    unprobed = run_method(levels, given, replace(METHODS[0], name="other"), 0, native=False)
    assert first.rankings
    assert first.shown is not None
    assert not unprobed.rankings and unprobed.ranked_levels is None
    assert first.ranked_levels is not None
    assert list(first.ranked_levels) == list(PROBED)
    assert first.ranked_levels["PVL"] != first.ranked_levels["MaxMC"]
    assert (first.success, first.curve) == (unprobed.success, unprobed.curve)


def files(directory: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in sorted((directory / "runs").glob("*.json"))}


def test_an_interrupted_audit_resumes_to_the_same_result(prepared: Path, domain: Domain) -> None:
    given = replace(settings(), seeds=2)

    def stop(done: int, total: int, what: str) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        audit(domain, given, prepared, methods=FEW, progress=stop)
    before = files(prepared)
    assert len(before) == 2
    study = audit(domain, given, prepared, methods=FEW)
    after = files(prepared)
    assert before.items() <= after.items()
    assert [(run.method, run.seed) for run in study.runs] == [(method.name, seed) for method in FEW for seed in (0, 1)]
    for path in (prepared / "runs").glob("*.json"):
        path.unlink()
    audit(domain, given, prepared, methods=FEW)
    assert files(prepared) == after


def test_an_audit_resumes_with_more_seeds_and_refuses_other_settings(prepared: Path, domain: Domain) -> None:
    given = replace(settings(), seeds=2, controls=2)
    audit(domain, given, prepared, methods=FEW[:1])
    study = audit(domain, replace(given, seeds=3), prepared, methods=FEW[:1])
    assert sorted(study.runs_of("DR")) == [0, 1, 2]
    with pytest.raises(InvalidArgument, match="contains another audit"):
        audit(domain, replace(given, steps=9_999), prepared, methods=FEW[:1])


def test_a_damaged_result_file_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "DR.0.json"
    path.write_text(json.dumps({"method": "DR"}))
    with pytest.raises(InvalidArgument, match=r"DR\.0\.json: the file is not the result of a run; remove it"):
        read_run(path)


def run(method: str, seed: int, success: np.ndarray) -> AuditRun:
    points = tuple(range(1, 9))
    curve = tuple(float(success.mean()) * point / 8 for point in points)
    return AuditRun(method, seed, points, points, curve, tuple(success.tolist()), (0.5,), 0.1, 0.2, 0.3)


def study(gain: float, noise: float, seeds: int = 12) -> Study:
    """Domain randomisation, and solvable levels only, which gain so much."""
    rng, runs = np.random.default_rng(0), []
    for name, more in (("DR", 0.0), ("DR, solvable only", gain)):
        for seed in range(seeds):
            base = np.random.default_rng(seed).random(8) * 0.2 + 0.4
            runs.append(run(name, seed, base + more + rng.standard_normal(8) * noise))
    return Study("Corridors", corridors(), settings(), tuple(runs))


@pytest.mark.parametrize(
    ("gain", "noise", "seeds", "verdict"),
    [
        (0.1, 0.02, 12, "stands"),
        (-0.1, 0.02, 12, "fails"),
        (0.0, 0.004, 12, "fails"),
        (0.02, 0.3, 12, "undecided"),
        (0.1, 0.02, 9, "undecided"),
        (0.1, 0.02, 3, "undecided"),
        (-0.1, 0.02, 3, "undecided"),
    ],
)
def test_the_verdict_depends_on_the_interval_and_the_p_value(
    gain: float, noise: float, seeds: int, verdict: str
) -> None:
    (found,) = findings_of([study(gain, noise, seeds)])
    assert found.claim == "leaving unsolvable levels out helps"
    assert found.verdict == verdict


def study_with_varied_levels(seed: int, gain: float = 0.0) -> Study:
    """A null study, but for the gain: 14 seeds on 20 levels, which differ more in what a method gains than seeds do."""
    rng, runs = np.random.default_rng(seed), []
    levels = 0.1 * rng.standard_normal(20)
    for one in range(14):
        base = rng.random(20)
        runs.append(run("DR", one, base))
        noise = 0.03 * rng.standard_normal() + 0.1 * rng.standard_normal(20)
        runs.append(run("DR, solvable only", one, base + gain + levels + noise))
    return Study("Corridors", corridors(), settings(), tuple(runs))


def test_p_values_are_calibrated_if_levels_differ_more_than_seeds() -> None:
    found = [finding for seed in range(400) for finding in findings_of([study_with_varied_levels(seed)])]
    assert 0.02 < np.mean([one.p_value < 0.05 for one in found]) < 0.08
    assert all((one.p_value < 0.05) == (not one.low <= 0 <= one.high) for one in found)


def test_verdicts_agree_with_their_intervals() -> None:
    found = [finding for seed in range(60) for finding in findings_of([study_with_varied_levels(seed, 0.04)])]
    assert {one.verdict for one in found} >= {"stands", "undecided"}
    for one in found:
        assert one.verdict != "stands" or one.low > 0
        assert one.verdict != "fails" or one.high < one.margin


def test_p_values_are_corrected_for_the_claims_of_all_domains() -> None:
    one = study_with_varied_levels(0, 0.08)
    (alone,) = findings_of([one])
    together = findings_of(
        [one, replace_name(study_with_varied_levels(1), "A"), replace_name(study_with_varied_levels(2), "B")]
    )
    assert together[0].p_value == pytest.approx(4 * alone.p_value), "three domains and all of them"


def study_with_rankings(correlations: list[float], parts: list[float]) -> Study:
    """Students whose scores all rank levels alike."""
    runs = []
    for seed, one in enumerate(correlations):
        rankings = tuple(
            {"score": score, "rollouts": PROTOCOL.shown_rollouts, "regret_solvable": one} for score in PROBED
        )
        levels = dict.fromkeys(PROBED, parts)
        runs.append(replace(run("DR", seed, np.ones(8)), rankings=rankings, ranked_levels=levels))
    return Study("Corridors", corridors(), settings(), tuple(runs))


def test_claims_on_ranks_are_undecided_if_levels_disagree() -> None:
    correlations = [0.1 + 0.001 * place for place in range(12)]
    alike, apart = [0.1, 0.11] * 10, [0.9, -0.7] * 10
    assert {one.verdict for one in findings_of([study_with_rankings(correlations, alike)])} == {"stands"}
    found = findings_of([study_with_rankings(correlations, apart)])
    assert {one.verdict for one in found} == {"undecided"}
    assert all(one.low < 0 < one.high for one in found)


def test_several_domains_have_a_combined_finding() -> None:
    one, other = study(0.1, 0.02), replace_name(study(0.06, 0.02), "Others")
    found = {finding.domain: finding for finding in findings_of([one, other])}
    assert list(found) == ["Corridors", "Others", "all domains"]
    assert found["all domains"].value == pytest.approx((found["Corridors"].value + found["Others"].value) / 2)
    assert found["all domains"].low < found["all domains"].value < found["all domains"].high


def replace_name(one: Study, name: str) -> Study:
    return Study(name, one.levels, one.settings, one.runs)


def test_the_gain_at_equal_updates_uses_the_curve_of_domain_randomisation() -> None:
    levels = np.full(8, 0.8)
    robust = replace(run("robust PLR, PVL", 0, levels), updates=(1, 1, 2, 2, 3, 3, 4, 4))
    found = summarise_methods(Study("x", corridors(), settings(), (run("DR", 0, levels), robust)))
    assert found[1].at_equal_updates == pytest.approx(0.8 - 0.4)


def test_tables_are_written_and_equal_audits_give_equal_files(tmp_path: Path) -> None:
    one = study(0.1, 0.02)
    for name in ("a", "b"):
        write_audit([one], findings_of([one]), tmp_path / name)
    texts = {path.name: path.read_text() for path in (tmp_path / "a").iterdir()}
    assert texts == {path.name: path.read_text() for path in (tmp_path / "b").iterdir()}
    assert texts["claims.csv"].splitlines()[1].startswith("stands,Corridors,filter,")
    assert len(texts["levels.csv"].splitlines()) == 1 + 2 * 12 * 8
