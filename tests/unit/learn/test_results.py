"""Results as data and as files."""

from pathlib import Path

import pytest

from envgraph.errors import InvalidArgument
from envgraph.learn import Curve, Experiment, RunResult, read_csv, write_csv


def run(label: str = "E1-E6", seed: int = 0, success: float = 1.0, total: float = 10.2) -> RunResult:
    curve = Curve((1_000, 2_000), (-8.099999999999895, 0.1), (5, 11), (0, 1))
    return RunResult("curriculum", label, seed, 2_000, 11, success, total, 16.0, curve)


RESULTS = Experiment((run(), run(seed=1, success=0.0, total=-1 / 3), run('a "quoted", label', seed=7)))


def test_runs_of_one_curriculum_are_summed_up() -> None:
    first, second = RESULTS.summaries()
    assert (first.label, first.runs, first.success_rate) == ("E1-E6", 2, 0.5)
    assert first.mean_return == pytest.approx((10.2 - 1 / 3) / 2)
    assert first.success_interval == pytest.approx((0.0945, 0.9055), abs=1e-4)
    assert (
        first.return_interval is not None
        and first.return_interval[0] < -1 / 3 < 10.2 < first.return_interval[1]
    )
    assert (second.label, second.runs, second.return_interval) == ('a "quoted", label', 1, None)


def test_a_smaller_confidence_gives_narrower_intervals() -> None:
    (wide, *_), (narrow, *_) = RESULTS.summaries(), RESULTS.summaries(0.5)
    assert (
        wide.success_interval[0]
        < narrow.success_interval[0]
        < narrow.success_interval[1]
        < wide.success_interval[1]
    )


def test_files_have_stable_columns_and_order(tmp_path: Path) -> None:
    runs, summary, curves = write_csv(RESULTS, tmp_path / "new" / "results")
    assert runs.read_text().splitlines() == [
        "kind,label,seed,steps,episodes,success_rate,mean_return,mean_length",
        "curriculum,E1-E6,0,2000,11,1.0,10.2,16.0",
        "curriculum,E1-E6,1,2000,11,0.0,-0.3333333333333333,16.0",
        'curriculum,"a ""quoted"", label",7,2000,11,1.0,10.2,16.0',
    ]
    lines = summary.read_text().splitlines()
    assert lines[0] == (
        "kind,label,runs,success_rate,success_low,success_high,mean_return,return_low,return_high"
    )
    assert len(lines) == 3 and lines[2].endswith(",10.2,,")
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
        ("runs.csv", 2, "curriculum,E1-E6,one,2000,11,0.0,0.0,16.0", "runs.csv:3: not a line"),
        ("runs.csv", 2, "lesson,E1-E6,1,2000,11,0.0,0.0,16.0", "runs.csv:3: not a line"),
        ("runs.csv", 2, "curriculum,E1-E6,1,2000", "runs.csv:3: not a line"),
        ("runs.csv", 2, "curriculum,E9,1,2000,11,0.0,0.0,16.0", "runs.csv:3: not a line"),
        ("curves.csv", 1, "curriculum,E1-E6,0,1000", "curves.csv:2: not a line"),
        ("curves.csv", 1, 'curriculum,"E1', "curves.csv:"),
    ],
)
def test_a_line_that_is_no_result_is_named(
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
