"""What is said to a person who uses a command wrongly, or has a damaged run."""

from __future__ import annotations

import json
import os
import re
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import click
import pytest

from envgraph.cli import main
from envgraph.cli._app import app
from envgraph.env.compiled.layout._compiled_costs import CompiledCosts
from envgraph.env.compiled.visiting import _plan_search
from envgraph.lang import bundled_domain

Call = Callable[..., str]


@pytest.fixture
def refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """Run a command beside the paper's domain and family, with exit code 1; return the messages."""
    forest = Path(shutil.copytree(bundled_domain("burning_forest"), tmp_path / "forest"))
    (forest / "paper.toml").replace(forest / "family.toml")
    monkeypatch.chdir(tmp_path)

    def run(*arguments: object, code: int = 1) -> str:
        monkeypatch.setattr(sys, "argv", ["envgraph", *map(str, arguments)])
        try:
            found = main()
        except SystemExit as stop:
            found = int(stop.code or 0)
        out, err = capsys.readouterr()
        assert found == code, out + err
        return (err or out) if code else out

    return run


LONG = "9" * 5000


RANGES = [
    ("generate forest", "--seed", 0, 2**63 - 1),
    ("generate forest", "--generations", 0, 10**9),
    ("generate forest", "--population", 1, 10**5),
    ("generate forest", "--samples", 2, 10**5),
    ("generate forest", "--workers", 1, 256),
    ("optimise forest", "--seed", 0, 2**63 - 1),
    ("optimise forest", "--steps", 1, 10**9),
    ("optimise forest", "--solution", 1, 10**9),
    ("train forest", "--seeds", 1, 10**5),
    ("train forest", "--seed-offset", 0, 2**63 - 1),
    ("train forest", "--members", 2, 10**5),
    ("train forest", "--workers", 1, 256),
    ("play forest", "--seed", 0, 2**63 - 1),
    ("verify forest", "--members", 1, 10**5),
    ("verify forest", "--seed", 0, 2**63 - 1),
    ("verify forest", "--workers", 1, 256),
    ("reproduce paper", "--seeds", 1, 10**5),
    ("reproduce paper", "--workers", 1, 256),
    ("audit forest", "--seeds", 2, 10**5),
    ("audit forest", "--controls", 2, 10**5),
    ("audit forest", "--steps", 8 * 4096, 10**9),
    ("audit forest", "--workers", 1, 256),
    ("apply forest forest forest", "--times", 1, 10**6),
    ("apply forest forest forest", "--seed", 0, 2**63 - 1),
    ("adopt FrozenLake-v1", "--seed", 0, 2**63 - 1),
]
"""A command, an option that takes a number, and the least and the largest one."""


@pytest.mark.parametrize(("command", "option", "least", "most"), RANGES)
def test_option_values_outside_their_range_are_refused(
    refused: Call, command: str, option: str, least: int, most: int
) -> None:
    for text in (str(least - 1), str(most + 1), LONG, "1e3", "1_0", "many"):
        message = " ".join(refused(*command.split(), option, text, code=2).split())
        shown = text if len(text) < 20 else text[:20]
        assert f"Invalid value for '{option}': `{shown}" in message.replace(" / '--jobs'", "")
        assert f"is not a whole number from {least:,} to {most:,}" in message


def test_every_option_with_a_number_has_a_tested_range() -> None:
    numbers = {
        (name, option.opts[0])
        for name, command in app.commands.items()
        for option in command.params
        if not isinstance(
            option.type, click.Choice | click.Path | type(click.STRING) | type(click.BOOL) | type(click.FLOAT)
        )
    }
    tested = {(command.partition(" ")[0], option) for command, option, _, _ in RANGES}
    assert numbers == {*tested, ("serve", "--port")}


@pytest.mark.parametrize("port", ["0", "65536", "http"])
def test_ports_have_a_range(refused: Call, port: str) -> None:
    assert "Invalid value for '--port'" in refused("serve", "forest", "--port", port, code=2)


def test_episodes_have_a_million_steps_at_most(refused: Call) -> None:
    file = Path("forest/burning_forest.environment")
    file.write_text(file.read_text("utf-8").replace("limit 200 steps", f"limit {2**63 - 1} steps"), "utf-8")
    message = refused("check", "forest")
    assert f"burning_forest.environment:21:5: `limit` is {2**63 - 1} steps, but must be from 1 to 1,000,000" in message
    assert "ENVGRAPH_LIMITS=10" in message


def test_budgets_and_member_numbers_outside_their_range_are_refused(refused: Call) -> None:
    refused("generate", "forest", "--name", "f", "--generations", 1, "--population", 2, code=0)
    for text in ("0", "10,0", "1_0", str(10**9 + 1), LONG, f"10,{LONG}"):
        assert "is not a whole number from 1 to 1,000,000,000" in refused("train", "f", "--steps", text)
    for text in ("0", "7", "٣", LONG):
        assert "has no environment" in refused("show", "f", "--variant", text)
    journal = Path("runs/f/training/unfinished.jsonl")
    journal.parent.mkdir()
    for begun in (
        f'"steps":"{LONG}","seeds":1',
        f'"steps":"10","seeds":{10**18}',
        f'"steps":"10","seeds":{LONG}',
        f'"steps":"10","members":{10**18}',
        '"steps":"10","overrides":[1]',
    ):
        journal.write_text(f'{{"format":"envgraph-training-2",{begun}}}\n', "utf-8")
        assert f"{journal}:1: " in refused("train", "f", "--resume")


MODEL, QUERIES, RULES = (
    f"forest/{name}" for name in ("running_4x4.model", "burning_forest.query", "burning_forest.rules")
)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('transform = "sqrt"', 'transform = "sqr"', "family.toml:13:13: `transform`"),
        ("rounds = 500", "rounds = -1", "family.toml:34:54: `rounds`"),
        (
            "forbid = []",
            'forbid = ["startTileFixedLocation"]',
            "family.toml:9:11: the initial model violates `forbid startTileFixedLocation`: it matches "
            "burning_forest.startTileFixedLocation(forest=<Forest#0 forest>, tile=<StartTile#1 y=0 x=0>)",
        ),
        (
            "forbid = []",
            "count = { burningTile = 3 }",
            "family.toml:9:11: the initial model violates `count burningTile in 3..3`: the number of matches is 20",
        ),
    ],
)
def test_check_reports_errors_that_a_search_would_refuse(refused: Call, old: str, new: str, message: str) -> None:
    path = Path("forest/family.toml")
    path.write_text(path.read_text().replace(old, new))
    assert f"forest/{message}" in refused("check", "forest")


def test_reachability_is_not_checked_for_a_model_that_violates_constraints(refused: Call) -> None:
    path = Path("forest/family.toml")
    path.write_text(path.read_text().replace("forbid = []", 'forbid = ["solvable"]\nreachable = ["failure"]'))
    environment = Path("forest/burning_forest.environment")
    environment.write_text(environment.read_text().replace("terminate failure", ""))
    said = refused("check", "forest")
    assert "violates `forbid solvable`" in said and "reachable" not in said
    path.write_text(path.read_text().replace('forbid = ["solvable"]', ""))
    said = refused("check", "forest")
    assert re.search(r"violates `reachable failure`: no plan was found \(none: all \d+ states were searched", said)
    assert "guide" not in said


def test_a_plan_not_found_by_beam_search_gets_a_hint(refused: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CompiledCosts, "breadth", 3)
    monkeypatch.setattr(CompiledCosts, "width", 1)
    monkeypatch.setattr(_plan_search, "NARROW_BEAM", (3, 1))
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")  # compiling takes longer than a beam of one state
    path = Path("forest/family.toml")
    path.write_text(path.read_text().replace("forbid = []", 'forbid = []\nreachable = ["failure"]'))
    environment = Path("forest/burning_forest.environment")
    environment.write_text(environment.read_text().replace("terminate failure", ""))
    said = refused("check", "forest")
    assert re.search(r"was found \(none within \d+ states, by a beam of 1 after the first 3\)", said)
    assert 'write `guide = "name"` in a measure with `kind = "shortest_plan"`' in said and "or raise `limit`" in said
    assert "nothing guides the search, since no `on neg find .. terminate` leaves a number to count" in said
    environment.write_text(environment.read_text().replace("terminate success", ""))
    measure = '[measures.plan]\nkind = "shortest_plan"\n[diversity]'
    path.write_text(path.read_text().replace('reachable = ["failure"]', "").replace("[diversity]", measure))
    said = refused("check", "forest")
    assert "has no value of `plan`: no plan was found (none within" in said
    assert "or raise `limit`; write `otherwise = 0`" in said
    kind = 'kind = "shortest_plan"\n'
    path.write_text(path.read_text().replace(kind, f'{kind}guide = "burningTile"\n'))
    assert "instead of `burningTile` write `guide" in refused("check", "forest")


def test_check_warns_about_agents_without_objects_in_the_model(refused: Call) -> None:
    model, environment = Path("forest/target_8x8.model"), Path("forest/burning_forest.environment")
    model.write_text(model.read_text().replace("R", "V"))  # no roads
    text = environment.read_text()
    road = "agent road : RoadTile { action wait = nothing() }\n"
    environment.write_text(text.replace("limit", f"{road} agent start : StartTile {{ }} limit"))
    told = json.loads(refused("check", "forest", "--format", "json", code=0))["diagnostics"]
    assert [(one["severity"], one["message"], Path(one["file"]).name) for one in told] == [
        ("warning", "there is no agent `road`: the model has no `RoadTile`", "burning_forest.environment")
    ]
    environment.write_text(text.replace("limit", f"{road} limit"))
    assert "there is no agent: the model has no `RoadTile`" in refused("check", "forest")


def test_check_reads_domains_separately_and_loose_files_together(refused: Call) -> None:
    shutil.copytree("forest", "copy")
    assert "no problems" in refused("check", "forest", "copy/family.toml", MODEL, RULES, code=0)


@pytest.mark.parametrize(
    ("where", "message"),
    [
        (["tile=truck"], "`tile` must be a `BurningTile`, but `truck` is a `FireTruck`"),
        (["tile=forest", "tile=truck"], "`tile` must be a `BurningTile`"),
        (["forest=forest", "forest=forest"], "`forest` is given twice"),
    ],
)
def test_values_of_parameters_are_checked(refused: Call, where: list[str], message: str) -> None:
    options = [part for one in where for part in ("--where", one)]
    assert message in refused("match", MODEL, QUERIES, "burningTile", *options)


def test_an_object_of_the_wrong_class_gets_no_spelling_hint(refused: Call) -> None:
    said = refused("match", MODEL, QUERIES, "burningTile", "-w", "tile=tile[0, 0]")
    assert re.fullmatch(
        r"error: `tile` must be a `BurningTile`, but `tile\[0, 0\]` is a `StartTile`; there are `tile\[.*\n",
        said,
    )


def test_messages_use_the_right_article_for_types(refused: Call) -> None:
    assert "`burning` must be an `int`" in refused("match", MODEL, QUERIES, "fireDensity", "-w", "burning=x")


@pytest.mark.parametrize("name", ["../out", "a/b", ".."])
def test_names_of_runs_outside_the_runs_directory_are_refused(refused: Call, name: str) -> None:
    assert "cannot be the name of a run" in refused("generate", "forest", "--generations", 1, "--name", name)


def test_a_directory_as_output_file_is_refused(refused: Call) -> None:
    Path("forest.json").mkdir()
    message = refused("apply", MODEL, RULES, "spread", "--output", "forest.json")
    assert message == "error: forest.json: is a directory\n"


@pytest.fixture(scope="module")
def run_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from envgraph.search import generate

    path = tmp_path_factory.mktemp("runs") / "run.sqlite"
    generate("burning_forest/paper.toml", path, generations=2, population=2)
    return path


@pytest.mark.parametrize(
    "damage",
    [
        "UPDATE setting SET value = '3' WHERE key = 'roots'",
        "DELETE FROM setting WHERE key = 'roots'",
        "DELETE FROM member",
        "UPDATE individual SET trace = 'x'",
        "UPDATE individual SET trace = '[[1]]'",
        "UPDATE individual SET measures = '[]'",
        "UPDATE individual SET parent = id",
        "UPDATE individual SET measures = '{}'",
        "UPDATE individual SET measures = '{\"complexity\": NaN}'",
        "UPDATE individual SET measures = '{\"complexity\": 1e999}'",
        "UPDATE individual SET model = (SELECT model FROM individual WHERE id = 0), state_hash = 'x'",
        "UPDATE setting SET value = '[]' WHERE key = 'roots'",
        "UPDATE setting SET value = '{\"seed\": 3}' WHERE key = 'overrides'",
        "INSERT INTO setting VALUES ('imported', '3')",
        "UPDATE source SET text = x'ff'",
        "UPDATE generation SET reasons = '[]'",
        "UPDATE generation SET diversity = 'x'",
        "UPDATE member SET individual = 'x'",
        "DROP TABLE member",
    ],
)
def test_a_damaged_run_is_refused(refused: Call, run_store: Path, damage: str) -> None:
    Path("runs/bad").mkdir(parents=True)
    shutil.copy(run_store, "runs/bad")
    with closing(sqlite3.connect("runs/bad/run.sqlite")) as db:
        db.execute(damage)
        db.commit()
    for command in (("show", "bad"), ("generate", "forest", "--resume", "--name", "bad")):
        assert "runs/bad/run.sqlite is damaged: " in refused(*command)


def test_writing_a_family_as_json_to_an_svg_file_is_refused(refused: Call) -> None:
    said = refused("export", "nowhere", "-o", "family.svg")
    assert "`family.svg` would contain JSON" in said and "--format svg" in said


@pytest.mark.parametrize(
    "command",
    [
        ("show", "family.json"),
        ("show", "family.json", "--format", "json"),
        ("show", "family.json", "--variant", "E1"),
        ("export", "family.json"),
        ("export", "family.json", "--format", "ga4cl"),
        ("export", "family.json", "--format", "svg"),
        ("report", "family.json"),
        ("train", "family.json"),
    ],
    ids=" ".join,
)
def test_every_command_refuses_an_edited_family(refused: Call, run_store: Path, command: tuple[str, ...]) -> None:
    text = refused("export", str(run_store), code=0)
    for damage in ('"complexity": NaN', '"complexity": "high"', '"complexity": 1e999', '"complexiti": 0.5'):
        broken = re.sub('"complexity": 0[.0-9]*', damage, text, count=1)
        line = next(number for number, one in enumerate(broken.splitlines(), 1) if damage in one)
        Path("family.json").write_text(broken)
        said = refused(*command)
        assert "family.json" in said and (str(line) in said or str(line - 1) in said)  # or where its table begins


def test_a_resumed_run_that_cannot_be_written_is_refused(refused: Call, run_store: Path) -> None:
    Path("runs/bad").mkdir(parents=True)
    shutil.copy(run_store, "runs/bad")
    with closing(sqlite3.connect("runs/bad/run.sqlite")) as db:
        db.execute("DELETE FROM generation")
        db.commit()
    assert "cannot be written" in refused("generate", "forest", "--resume", "--name", "bad")


@pytest.mark.parametrize("format", ["text", "json"])
def test_names_are_escaped_if_the_terminal_cannot_encode_them(refused: Call, format: str) -> None:
    path = Path("forest/burning_forest.rules")
    path.write_text(path.read_text("utf-8").replace("retype tile : RoadTile", "retype tilé : RoadTile"), "utf-8")
    command = [sys.executable, "-m", "envgraph", "check", "forest", "--format", format]
    ended = subprocess.run(
        command, capture_output=True, text=True, check=False, env={**os.environ, "PYTHONIOENCODING": "ascii"}
    )
    assert ended.returncode == 1
    assert "Traceback" not in ended.stderr
    if format == "json":
        assert "`tilé`" in json.loads(ended.stdout)["diagnostics"][0]["message"]
    else:
        assert r"`til\xe9`" in ended.stderr


def test_a_search_that_finds_too_few_members_prints_a_warning(
    refused: Call, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = Path("forest/family.toml")
    path.write_text(path.read_text().replace('rules = ["retypings"]', 'rules = ["collect"]'))
    constraint = "forbid = []\n[constraints.count]\ncollectedWater = 0"
    path.write_text(path.read_text().replace("forbid = []", constraint))
    monkeypatch.setattr(sys, "argv", ["envgraph", "generate", "forest", "--generations", "1"])
    assert main() == 0
    assert "warning: only 1 of 6 environments that satisfy the constraints were found" in capsys.readouterr().err


def test_show_refuses_queries_and_suggests_check(refused: Call) -> None:
    said = refused("show", QUERIES)
    assert f"`{QUERIES}` is not a run, model or metamodel; use `envgraph check {QUERIES}` to check it" in said


def test_matching_a_group_is_refused_as_a_group(refused: Call) -> None:
    message = refused("match", MODEL, RULES, "retypings")
    assert "`retypings` is a group, which has no matches of its own; ask for one of its rules" in message


def test_match_with_a_run_asks_for_a_variant(refused: Call) -> None:
    assert "`h3` is not a file; for a run or family, add an environment: `--variant E1`" in refused(
        "match", "h3", QUERIES, "burningTile"
    )
