"""Results as data and as files."""

from dataclasses import replace
from pathlib import Path

import pytest

from envgraph.errors import InvalidArgument
from envgraph.learn import Curve, Experiment, RunResult, read_csv, write_csv


def run(label: str = "E1-E6", seed: int = 0, success: float = 1.0, total: float = 10.2) -> RunResult:
    curve = Curve((1_000, 2_000), (-8.099999999999895, 0.1), (5, 11), (0, 1))
    return RunResult("curriculum", label, seed, 2_000, 11, success, total, 16.0, 1_000, 0.25, curve)


RESULTS = Experiment((run(), run(seed=1, success=0.0, total=-1 / 3), run('a "quoted", label', seed=7)))


def test_runs_of_one_curriculum_are_summed_up() -> None:
    first, second = RESULTS.summaries()
    assert (first.label, first.runs, first.success_rate) == ("E1-E6", 2, 0.5)
    assert first.mean_return == pytest.approx((10.2 - 1 / 3) / 2)
    assert first.success_interval == pytest.approx((0.0945, 0.9055), abs=1e-4)
    assert first.return_interval is not None and first.return_interval == pytest.approx((-1 / 3, 10.2))
    assert (second.label, second.runs, second.return_interval) == ('a "quoted", label', 1, None)


def test_a_smaller_confidence_gives_narrower_intervals() -> None:
    (wide, *_), (narrow, *_) = RESULTS.summaries(), RESULTS.summaries(0.5)
    assert wide.success_interval[0] < narrow.success_interval[0] < narrow.success_interval[1] < wide.success_interval[1]


def test_files_have_stable_columns_and_order(tmp_path: Path) -> None:
    runs, summary, curves = write_csv(RESULTS, tmp_path / "new" / "results")
    assert runs.read_text().splitlines() == [
        "kind,label,seed,steps,episodes,success_rate,mean_return,mean_length,steps_before,success_before",
        "curriculum,E1-E6,0,2000,11,1.0,10.2,16.0,1000,0.25",
        "curriculum,E1-E6,1,2000,11,0.0,-0.3333333333333333,16.0,1000,0.25",
        'curriculum,"a ""quoted"", label",7,2000,11,1.0,10.2,16.0,1000,0.25',
    ]
    lines = summary.read_text().splitlines()
    assert lines[0] == (
        "kind,label,runs,success_rate,success_low,success_high,mean_return,return_low,return_high,"
        "return_iqm,iqm_low,iqm_high,success_before,steps_to_threshold"
    )
    assert len(lines) == 3 and lines[2].endswith(",10.2,,,10.2,,,0.25,")
    assert curves.read_text().splitlines()[:2] == [
        "kind,label,seed,step,cumulative_reward,episodes,successes",
        "curriculum,E1-E6,0,1000,-8.099999999999895,5,0",
    ]


def test_files_read_back_exactly(tmp_path: Path) -> None:
    write_csv(RESULTS, tmp_path)
    assert read_csv(tmp_path) == RESULTS


@pytest.mark.parametrize(
    ("name", "line", "text", "message"),
    [
        ("runs.csv", 0, "kind,label", "runs.csv:1: the columns must be kind, label, seed"),
        ("runs.csv", 2, "curriculum,E1-E6,one,2000,11,0.0,0.0,16.0,0,0.0", "runs.csv:3: the line is not"),
        ("runs.csv", 2, "lesson,E1-E6,1,2000,11,0.0,0.0,16.0,0,0.0", "runs.csv:3: the line is not"),
        ("runs.csv", 2, "curriculum,E1-E6,1,2000", "runs.csv:3: the line is not"),
        ("runs.csv", 2, "curriculum,E1-E6,1,2000,11,0.0,inf,16.0,0,0.0", "runs.csv:3: the line is not"),
        ("runs.csv", 2, "curriculum,E1-E6,1,2000,11,0.0,0.0,16.0,0,nan", "runs.csv:3: the line is not"),
        (
            "runs.csv",
            2,
            f"curriculum,E1-E6,1,2000,{10**400},0.0,0.0,16.0,0,0.0",
            "runs.csv:3: the line is not",
        ),
        (
            "runs.csv",
            2,
            f"curriculum,E1-E6,1,2000,11,0.0,{10**400},16.0,0,0.0",
            "runs.csv:3: the line is not",
        ),
        ("runs.csv", 2, "curriculum,E9,1,2000,11,0.0,0.0,16.0,0,0.0", "runs.csv:3: the line is not"),
        ("curves.csv", 1, "curriculum,E1-E6,0,1000", "curves.csv:2: the line is not"),
        ("curves.csv", 1, 'curriculum,"E1', "curves.csv:"),
    ],
)
def test_an_invalid_line_of_a_result_file_is_refused_by_number(
    tmp_path: Path, name: str, line: int, text: str, message: str
) -> None:
    write_csv(RESULTS, tmp_path)
    lines = (tmp_path / name).read_text().splitlines()
    lines[line] = text
    (tmp_path / name).write_text("\n".join(lines))
    with pytest.raises(InvalidArgument, match=message):
        read_csv(tmp_path)


def test_missing_and_unreadable_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidArgument, match=r"curves\.csv: No such file"):
        read_csv(tmp_path)
    write_csv(RESULTS, tmp_path)
    (tmp_path / "runs.csv").write_bytes(b"kind,\xff\xfe")
    with pytest.raises(InvalidArgument, match=r"runs\.csv:1"):
        read_csv(tmp_path)


@pytest.mark.parametrize(
    ("before", "threshold", "steps"),
    [
        (0, 0.5, 200),  # 2 of 4 episodes
        (100, 0.6, 400),  # 3 of 4; at 300 no episode has ended
        (200, 0.5, 400),
        (0, 0.8, None),
        (500, 0.0, None),  # never on the target
    ],
)
def test_time_to_threshold_counts_all_steps_and_only_episodes_on_the_target(
    before: int, threshold: float, steps: int | None
) -> None:
    curve = Curve((100, 200, 300, 400, 500), (0.0,) * 5, (5, 9, 9, 13, 20), (1, 3, 3, 6, 9))
    one = replace(run(), steps_before=before, curve=curve)
    assert one.steps_to_threshold(threshold) == steps


def test_the_median_time_to_threshold_includes_runs_that_never_reach_it() -> None:
    fast, slow = (Curve((100, 200), (0.0, 0.0), (2, 4), one) for one in ((2, 4), (0, 2)))
    never = Curve((100, 200), (0.0, 0.0), (2, 4), (0, 0))
    for curves, expected in (
        ((fast,), 100),
        ((never, slow), 200),
        ((fast, never, never), None),
        ((fast, slow, never), 200),
    ):
        runs = [replace(run(seed=seed), steps_before=0, curve=curve) for seed, curve in enumerate(curves)]
        assert Experiment(tuple(runs)).summaries()[0].steps_to_threshold == expected
