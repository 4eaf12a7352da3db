"""Runs on the command line: listed, replaced, gone on with, and what programs read of them."""

from __future__ import annotations

import json
import os
import resource
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from envgraph.cli import main
from envgraph.files import write_lock
from envgraph.search import RunStore, open_family

Call = Callable[..., str]


@pytest.fixture
def envgraph(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """Runs a command in an empty directory; what it prints, or, where it is to fail, all that it says."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")

    def run(*arguments: object, code: int = 0) -> str:
        monkeypatch.setattr(sys, "argv", ["envgraph", *map(str, arguments)])
        try:
            found = main()
        except SystemExit as stop:
            found = int(stop.code or 0)
        out, err = capsys.readouterr()
        assert found == code, out + err
        return out if code == 0 else out + err

    return run


FOREST = ("generate", "burning_forest/paper.toml", "--population", 2)


def test_members_of_runs_and_families_are_matched_and_changed(envgraph: Call) -> None:
    envgraph("new", "copy", "--domain", "burning_forest")
    envgraph("generate", "copy/paper.toml", "--population", 2, "--generations", 3, "--name", "one")
    envgraph("export", "one", "-o", "one.json")
    counts = []
    for run, variant in (("one", "E1"), ("runs/one", 2), ("one.json", "2")):
        asked = ("match", run, "copy/burning_forest.query", "burningTile", "--variant", variant)
        found = envgraph(*asked, "--format", "json")
        counts.append(len(json.loads(found)))
    family = open_family("one.json")
    burning = [len(family.model(member).graph.extent("BurningTile")) for member in family.members]
    assert counts == [*burning, burning[1]] and burning[0] != burning[1]
    rules = ("copy/burning_forest.rules", "spread", "--variant", "E2")
    assert envgraph("apply", "one", *rules).startswith("1: burning_forest.spread(")
    assert "has a match" in envgraph("why-not", "one", *rules)
    assert "rule burning_forest.spread(" in envgraph("explain", "one", *rules)
    assert "has no environment `E9`" in envgraph("explain", "one", *rules[:3], "E9", code=1)


def test_runs_are_listed(envgraph: Call) -> None:
    assert "there are no runs in runs; `envgraph generate` makes one" in envgraph("runs")
    assert "there is no directory `rums`" in envgraph("runs", "-d", "rums", code=1)
    envgraph(*FOREST, "--generations", 1, "--set", "seed=5", "--name", "one")
    envgraph("train", "one", "--steps", 50, "--seeds", 1)
    Path("runs/two").mkdir()
    Path("runs/two/run.sqlite").write_text("nonsense")
    lines = envgraph("runs").splitlines()
    assert [line.split()[0] for line in lines[2:]] == ["one", "two"]
    assert lines[1].split()[-1] == "remark"
    assert "BurningForest" in lines[2] and "50 steps" in lines[2] and "seed=5" in lines[2]
    assert "is not a run store" in lines[3]
    one, two = json.loads(envgraph("runs", "--format", "json"))["runs"]
    assert f" {one['diversity']:.3f} " in lines[2]
    assert one | {"diversity": 0.0} == {
        "run": "one",
        "family": "BurningForest",
        "imported": None,
        "overrides": ["search.generations=1", "search.population=2", "seed=5"],
        "generations": 1,
        "members": 2,
        "diversity": 0.0,
        "trained": [50],
    }
    assert two["run"] == "two" and "is not a run store" in two["problem"]


def test_two_runs_are_compared(envgraph: Call) -> None:
    for name, seed in (("one", 5), ("two", 5), ("three", 6)):
        envgraph(*FOREST, "--generations", 1, "--set", f"seed={seed}", "--name", name)
    assert envgraph("runs", "one", "two") == "one and two do not differ\n"
    lines = envgraph("runs", "one", "three").splitlines()
    assert lines[1].split() == ["what", "differs", "one", "three"]
    told = {line.split()[0]: line.split()[1:] for line in lines[2:]}
    assert told["seed"] == ["5", "6"]
    assert told["member"][:2] == ["E1,", "complexity"]
    assert "generations" not in told
    data = json.loads(envgraph("runs", "one", "three", "--format", "json"))
    assert data["differences"]["seed"] == ["5", "6"]
    assert [[member["name"] for member in members] for members in data["members"]] == [["E1"], ["E1"]]
    assert "name two runs" in envgraph("runs", "one", code=1)
    assert "four" in envgraph("runs", "one", "four", code=1)


def test_replacing_a_run_removes_its_training_and_report(envgraph: Call) -> None:
    envgraph(*FOREST, "--generations", 1, "--name", "a")
    envgraph("train", "a", "--steps", 50, "--seeds", 1)
    envgraph("report", "a")
    Path("runs/a/notes.txt").write_text("mine")
    said = envgraph(*FOREST, "--generations", 2, "--name", "a", code=1)
    assert "resume it with --resume, replace it with --force, or choose another --name" in said
    wrong = ("--force", "--set", 'constraints.forbid=["burningTile"]')
    assert "violates `forbid burningTile`" in envgraph(*FOREST, "--name", "a", *wrong, code=1)
    assert Path("runs/a/report.html").exists()
    envgraph(*FOREST, "--generations", 2, "--name", "a", "--force")
    assert {path.name for path in Path("runs/a").iterdir()} == {"run.sqlite", "notes.txt"}
    assert json.loads(envgraph("runs", "--format", "json"))["runs"][0]["generations"] == 2


def test_an_interrupted_replacement_leaves_the_old_run_unchanged(
    envgraph: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    envgraph(*FOREST, "--generations", 1, "--name", "a")
    envgraph("train", "a", "--steps", 50, "--seeds", 1, "--curricula", "full")
    files = {path: path.read_bytes() for path in Path("runs/a").rglob("*") if path.is_file()}
    with monkeypatch.context() as patched:
        patched.setattr(
            "envgraph.search.evolution._genetic_algorithm.Evolution._create_population",
            raise_keyboard_interrupt,
        )
        said = envgraph(*FOREST, "--name", "a", "--force", code=130)
    assert "the old run in runs/a is unchanged" in said and "--resume" not in said
    assert {path: path.read_bytes() for path in Path("runs/a").rglob("*") if path.is_file()} == files


def raise_keyboard_interrupt(*_: object) -> None:
    raise KeyboardInterrupt


def test_commands_that_write_a_run_are_refused_while_the_run_is_locked(envgraph: Call) -> None:
    envgraph(*FOREST, "--generations", 1, "--name", "a")
    with RunStore.open(Path("runs/a/run.sqlite"), writing=True):
        for command in (
            ("train", "a"),
            ("verify", "a"),
            (*FOREST, "--name", "a", "--force"),
            ("generate", "burning_forest/paper.toml", "--name", "a", "--resume", "--generations", 3),
        ):
            said = envgraph(*command, code=1)
            assert f"process {os.getpid()} on host" in said and "is writing runs/a/run.sqlite" in said
        for command in (("show", "a"), ("runs",), ("report", "a"), ("export", "a", "-o", "family.json")):
            envgraph(*command)
    with write_lock(Path("family.json")):
        assert "is writing family.json" in envgraph("train", "family.json", code=1)
    envgraph("verify", "family.json")


@pytest.mark.parametrize("format", ["text", "json"])
def test_verify_prints_results_that_it_cannot_store(
    envgraph: Call, capsys: pytest.CaptureFixture[str], format: str
) -> None:
    envgraph(*FOREST, "--generations", 1, "--name", "a")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1_000, limits[1]))
        sys.argv = ["envgraph", "verify", "a", "--format", format]
        code = main()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    out, err = capsys.readouterr()
    assert code == 0
    assert "same" in out if format == "text" else len(json.loads(out)["members"]) == 2
    assert "could not be stored: runs/a/run.sqlite cannot be written" in err and "full disk" in err


def test_a_finished_run_resumes_with_more_generations(envgraph: Call) -> None:
    envgraph(*FOREST, "--generations", 1, "--name", "a")
    envgraph("generate", "burning_forest/paper.toml", "--name", "a", "--resume", "--generations", 3)
    assert json.loads(envgraph("runs", "--format", "json"))["runs"][0]["generations"] == 3
    again = ("generate", "burning_forest/paper.toml", "--name", "a", "--resume")
    assert "has 3 generations already" in envgraph(*again, "--generations", 3, code=1)
    for option in (("--seed", 1), ("--set", "seed=1"), ("--population", 3), ("--force",)):
        assert "allows only --generations" in envgraph(*again, *option, code=1)


@pytest.mark.parametrize(
    ("command", "code", "message"),
    [
        (
            ("generate", "burning_forest/paper.toml", "--set", "seed=x"),
            "wrong-type",
            "`seed` must be a whole number",
        ),
        (("show", "nowhere"), "invalid-argument", "there is no run `nowhere`"),
        (("match", "no.model", "no.query", "p"), "missing-file", "there is no such file"),
        (("apply", "no.model", "no.rules", "p"), "missing-file", "there is no such file"),
        (("train", "nowhere"), "invalid-argument", "there is no run `nowhere`"),
        (("report", "nowhere"), "invalid-argument", "there is no run `nowhere`"),
        (("check", "no.model"), "missing-file", "there is no such file"),
    ],
    ids=lambda one: one[0] if isinstance(one, tuple) else None,
)
def test_errors_are_printed_as_json_with_format_json(
    envgraph: Call, command: tuple[str, ...], code: str, message: str
) -> None:
    told = json.loads(envgraph(*command, "--format", "json", code=1))
    assert told["ok"] is False
    assert told["diagnostics"][0]["code"] == code and message in told["diagnostics"][0]["message"]
    assert "Traceback" not in envgraph(*command, code=1)


def test_a_file_that_cannot_be_written_is_a_json_error(envgraph: Call) -> None:
    envgraph(*FOREST, "--generations", 1, "--name", "a")
    Path("taken").mkdir()
    told = json.loads(envgraph("report", "a", "-o", "taken", "--format", "json", code=1))
    assert told["diagnostics"][0]["code"] == "file-error" and "taken" in told["diagnostics"][0]["message"]


def test_json_of_families_and_reports_contains_numbers(envgraph: Call) -> None:
    generated = json.loads(envgraph(*FOREST, "--generations", 1, "--name", "a", "--format", "json"))
    assert generated["maximum"] == 1.0 and generated["bins"] == [2, 2]
    assert generated["warning"]["code"] == "low-diversity"
    envgraph("train", "a", "--steps", 50, "--seeds", 1)
    rows = json.loads(envgraph("report", "a", "--format", "json"))["environments"]
    assert [row["environment"] for row in rows] == ["E1", "E2", "E2 alone"]
    assert all(isinstance(row["success"], float) and 0 <= row["success"] <= 1 for row in rows)
    assert rows[0]["complexity"] == generated["members"][0]["measures"]["complexity"]
    assert type(rows[0]["BurningTile"]) is int and rows[2]["complexity"] is None


def test_json_of_apply_contains_applications_as_objects(envgraph: Call) -> None:
    envgraph("new", "maze")
    rule = ("apply", "maze/maze.model", "maze/maze.rules", "moveRight", "--format", "json")
    ((step,),) = [entry["steps"] for entry in json.loads(envgraph(*rule))["applications"]]
    assert step["rule"] == "maze.moveRight" and step["created"] == {}
    assert step["match"]["there"]["class"] == "Floor" and step["match"]["robot"]["name"] == "robot"


def test_the_option_set_applies_to_commands_that_read_a_family_file(envgraph: Call) -> None:
    assert "no problems" in envgraph("check", "burning_forest", "--set", "search.population=10")
    told = envgraph("check", "burning_forest", "--set", "search.populaton=10", code=1)
    assert "--set:1:" in told and "did you mean `population`" in told
    envgraph("new", "copy", "--domain", "burning_forest")
    told = envgraph("check", "copy/burning_forest.query", "--set", "seed=1", code=1)
    assert "`--set` needs a family file" in told
    envgraph("generate", "copy/paper.toml", "--population", 2, "--generations", 1, "--name", "one")
    envgraph("export", "one", "--format", "ga4cl", "-o", "one.json")
    envgraph("import", "one.json", "--domain", "copy", "--set", "limit=17", "--name", "two")
    assert open_family("two").limit == 17
