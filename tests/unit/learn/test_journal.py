"""Agents of a training under way, line by line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from envgraph.errors import InvalidArgument
from envgraph.learn import (
    FamilyMember,
    Journal,
    RunResult,
    TrainingSettings,
    fingerprint,
    run_experiment,
    sequences,
)
from tests.unit.learn.small_tables import random_table

FAMILY = [FamilyMember(f"E{number}", random_table(number)) for number in (1, 2)]
SETTINGS = TrainingSettings(
    steps_per_environment=100, evaluation_episodes=5, limit=25, checkpoint=40, seeds=2
)
RESULTS = run_experiment(FAMILY, SETTINGS, sequences(["E1", "E2"])).runs


def begun(path: Path) -> Journal:
    journal = Journal.create(path, {"seeds": 2})
    journal.add("100", "E2", RESULTS[0])
    journal.add("100", "E1", RESULTS[1])
    journal.add("100", "E2", RESULTS[1])
    return journal


def test_what_is_read_is_what_was_written(tmp_path: Path) -> None:
    begun(tmp_path / "a.jsonl")
    journal = Journal.open(tmp_path / "a.jsonl")
    assert journal.about == {"seeds": 2} and len(journal) == 3
    assert journal.known("100", "E2") == RESULTS and journal.known("100", "E1") == RESULTS[1:]
    assert journal.known("50", "E2") == ()


def test_a_kill_costs_the_line_that_was_being_written(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    begun(path)
    whole = path.read_bytes()
    ends = [place + 1 for place, byte in enumerate(whole) if byte == ord("\n")]
    for size in range(ends[0], len(whole) + 1, 7):
        path.write_bytes(whole[:size])
        journal = Journal.open(path)
        assert len(journal) == sum(end <= size for end in ends) - 1
        journal.add("100", "E9", RESULTS[0])
        assert len(Journal.open(path)) == len(journal)


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
def test_a_line_that_was_edited_is_told(old: str, new: str, line: int, tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    begun(path)
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(
        InvalidArgument, match=f"a.jsonl:{line}: the line is not part of an unfinished training"
    ):
        Journal.open(path)


def test_no_file_and_an_empty_one(tmp_path: Path) -> None:
    with pytest.raises(InvalidArgument, match="No such file"):
        Journal.open(tmp_path / "a.jsonl")
    (tmp_path / "a.jsonl").touch()
    with pytest.raises(InvalidArgument, match=":1: the line is not"):
        Journal.open(tmp_path / "a.jsonl")


def test_every_line_is_one_document(tmp_path: Path) -> None:
    begun(tmp_path / "a.jsonl")
    lines = (tmp_path / "a.jsonl").read_text(encoding="utf-8").splitlines()
    assert [sorted(json.loads(line)) for line in lines] == [
        ["format", "seeds"],
        *[["agent", "part", "target"]] * 3,
    ]


def test_a_fingerprint_is_of_the_environments_and_the_settings() -> None:
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


def test_results_are_what_the_experiment_gives() -> None:
    assert all(isinstance(result, RunResult) for result in RESULTS) and len(RESULTS) == 2
