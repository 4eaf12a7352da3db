"""What long work says of itself on standard error."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count
from pathlib import Path

import pytest

from envgraph.cli._output import progress_bar
from envgraph.files import report_counting, report_progress
from envgraph.search import Domain, generate_from_domain

Captured = pytest.CaptureFixture[str]


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[float]]:
    """The time, which tests set."""
    now = [1000.0]
    monkeypatch.setattr("envgraph.files._progress.monotonic", lambda: now[0])
    yield now


def test_progress_in_a_pipe_is_printed_at_doubling_intervals(clock: list[float], capsys: Captured) -> None:
    with report_counting("states of A") as told:
        for second in range(100):
            clock[0] = 1000.0 + second
            told(1000 * second, 0)
    assert capsys.readouterr().err.splitlines() == [
        "states of A: 5,000 (0:00:05)",
        "states of A: 10,000 (0:00:10)",
        "states of A: 20,000 (0:00:20)",
        "states of A: 40,000 (0:00:40)",
        "states of A: 80,000 (0:01:20)",
    ]


def test_progress_of_nested_work_is_printed_on_the_line_of_the_outer_work(clock: list[float], capsys: Captured) -> None:
    with progress_bar("environments", 6) as advance:
        for done in range(6):
            advance(done, f"E{done + 1}")
            with report_counting("states of A") as told:
                clock[0] += 4
                told(400, 1_500)
    assert capsys.readouterr().err.splitlines() == [
        "environments: 1 of 6, E2; states of A: 400, 1,500 outcomes (0:00:08)",
        "environments: 3 of 6, E4; states of A: 400, 1,500 outcomes (0:00:16)",
    ]


def test_repeated_counts_with_the_same_text_are_numbered(clock: list[float], capsys: Captured) -> None:
    with report_progress() as tell:
        for generation in (0, 1):
            if generation:
                tell("generations: 1 of 9")
            for count in (3, 4):
                with report_counting("states of A") as told:
                    clock[0] = 2 * clock[0] + 5.0
                    told(count, 0)
    said = [line.rpartition(" (")[0] for line in capsys.readouterr().err.splitlines()]
    assert said == [
        "states of A: 3",
        "states of A, model 2: 4",
        "generations: 1 of 9; states of A: 3",
        "generations: 1 of 9; states of A, model 2: 4",
    ]


def test_progress_on_a_terminal_is_one_line_that_is_cleared_at_the_end(
    monkeypatch: pytest.MonkeyPatch, capsys: Captured
) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    with report_progress() as tell, report_counting("states\x1b of A") as told:
        tell("E1")
        told(100, 0)
    assert capsys.readouterr().err == "\rE1\x1b[K\rE1; states\\x1b of A: 100\x1b[K\r\x1b[K"


def test_evolution_prints_the_number_of_states_visited_for_measures(
    tmp_path: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ENVGRAPH_CACHE", "off")
    monkeypatch.setattr("envgraph.files._progress.monotonic", count(0, 10).__next__)
    domain = Domain.load(
        "burning_forest/paper.toml", overrides=["search.generations=0", "measures.plan.kind=shortest_plan"]
    )
    with progress_bar("generations", 0):
        generate_from_domain(domain, tmp_path / "run.sqlite")
    assert capsys.readouterr().err.startswith("states of BurningForest: 1 (0:00:10)\n")
