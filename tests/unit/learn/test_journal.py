"""Agents of a training under way, line by line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from envgraph.errors import InvalidArgument
from envgraph.learn import (
    FamilyMember,
    RunResult,
    TrainingJournal,
    TrainingSettings,
    fingerprint,
    run_experiment,
    sequences,
)
from tests.unit.learn.small_tables import random_table

FAMILY = [FamilyMember(f"E{number}", random_table(number)) for number in (1, 2)]
SETTINGS = TrainingSettings(steps_per_environment=100, evaluation_episodes=5, limit=25, checkpoint=40, seeds=2)
RESULTS = run_experiment(FAMILY, SETTINGS, sequences(["E1", "E2"])).runs


def new_journal(path: Path) -> TrainingJournal:
    journal = TrainingJournal.create(path, {"seeds": 2})
    journal.add("100", "E2", RESULTS[0])
    journal.add("100", "E1", RESULTS[1])
    journal.add("100", "E2", RESULTS[1])
    return journal


def test_results_read_from_a_journal_equal_the_written_results(tmp_path: Path) -> None:
    new_journal(tmp_path / "a.jsonl")
    journal = TrainingJournal.open(tmp_path / "a.jsonl")
    assert journal.about == {"seeds": 2} and len(journal) == 3
    assert journal.results_of("100", "E2") == RESULTS and journal.results_of("100", "E1") == RESULTS[1:]
    assert journal.results_of("50", "E2") == ()


def test_a_truncated_journal_loses_only_its_last_line(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    new_journal(path)
    whole = path.read_bytes()
    ends = [place + 1 for place, byte in enumerate(whole) if byte == ord("\n")]
    for size in range(ends[0], len(whole) + 1, 7):
        path.write_bytes(whole[:size])
        journal = TrainingJournal.open(path)
        assert len(journal) == sum(end <= size for end in ends) - 1
        journal.add("100", "E9", RESULTS[0])
        assert len(TrainingJournal.open(path)) == len(journal)


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ('"format": "envgraph-training-2"', '"format": "other"', 1),
        ('{"format"', '[{"format"', 1),
        ('"target": "E1"', '"target"', 3),
        ('"kind": "curriculum"', '"kind": "school"', 2),
        ('"seed": 0', '"seed": "zero"', 2),
        ('"seed": 0', '"seed": Infinity', 2),
        ('"episodes": [', '"episodes": [1, ', 2),
        ('"curve": {', '"curve": 3, "more": {', 2),
    ],
)
def test_an_edited_line_is_refused_with_its_number(old: str, new: str, line: int, tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    new_journal(path)
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InvalidArgument, match=f"a.jsonl:{line}: the line is not part of an unfinished training"):
        TrainingJournal.open(path)


def test_missing_and_empty_journals_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidArgument, match="No such file"):
        TrainingJournal.open(tmp_path / "a.jsonl")
    (tmp_path / "a.jsonl").touch()
    with pytest.raises(InvalidArgument, match=":1: the line is not"):
        TrainingJournal.open(tmp_path / "a.jsonl")


def test_every_line_of_a_journal_is_a_json_document(tmp_path: Path) -> None:
    new_journal(tmp_path / "a.jsonl")
    lines = (tmp_path / "a.jsonl").read_text(encoding="utf-8").splitlines()
    assert [sorted(json.loads(line)) for line in lines] == [
        ["format", "seeds"],
        *[["agent", "part", "target"]] * 3,
    ]


def test_a_fingerprint_depends_on_the_environments_and_the_settings() -> None:
    tables = {member.name: member.tabular for member in FAMILY}
    other = random_table(1)
    other.reward[0, 0, 0] += 1e-9
    seen = {
        fingerprint(tables, SETTINGS),
        fingerprint(tables, TrainingSettings()),
        fingerprint(dict(reversed(tables.items())), SETTINGS),
        fingerprint({**tables, "E1": other}, SETTINGS),
        fingerprint({"E1": tables["E1"]}, SETTINGS),
    }
    assert len(seen) == 5
    assert fingerprint({name: random_table(int(name[1])) for name in tables}, SETTINGS) in seen


def test_results_of_an_experiment_are_run_results() -> None:
    assert all(isinstance(result, RunResult) for result in RESULTS) and len(RESULTS) == 2
