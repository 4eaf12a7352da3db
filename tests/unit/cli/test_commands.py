"""The commands, as a person types them."""

from __future__ import annotations

import errno
import json
import os
import re
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import pytest

import envgraph as package
from envgraph.cli import main
from envgraph.env.compiled import NotCompiled
from envgraph.lang import bundled_domain
from envgraph.search import Family, open_family
from tests.profile import AT_NIGHT

DATA = Path(__file__).parents[3] / "envgraph" / "report" / "reproduction" / "data"

Envgraph = Callable[..., "Result"]

FIRES = ("generate", "burning_forest/paper.toml", "--name", "a", "--generations", 1, "--population", 2)
DOORS = ("generate", "keydoor/diverse.toml", "--name", "run", "--generations", 1)


class Result:
    """What a command gave: exit code, output, messages."""

    def __init__(self, code: int, out: str, err: str) -> None:
        self.code, self.out, self.err = code, out, err

    @property
    def json(self) -> object:
        return json.loads(self.out)


@pytest.fixture
def envgraph(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Envgraph:
    """Runs a command in an empty directory."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")

    def run(*arguments: object) -> Result:
        monkeypatch.setattr(sys, "argv", ["envgraph", *map(str, arguments)])
        try:
            code = main()
        except SystemExit as stop:
            code = stop.code if isinstance(stop.code, int) else 0
        out, err = capsys.readouterr()
        assert "Traceback" not in out + err
        return Result(code, out, err)

    return run


def ok(result: Result) -> Result:
    assert result.code == 0, result.err
    return result


COMMANDS = (
    "new",
    "check",
    "match",
    "explain",
    "why-not",
    "apply",
    "replay",
    "runs",
    "verify",
    "format",
    "convert",
    "generate",
    "show",
    "export",
    "templates",
    "import",
    "train",
    "report",
)


def test_help_names_every_command_and_each_explains_itself(envgraph: Envgraph) -> None:
    text = ok(envgraph("--help")).out
    for command in COMMANDS:
        assert command in text
        assert "Usage: envgraph " + command in " ".join(ok(envgraph(command, "--help")).out.split())


def test_version_is_printed(envgraph: Envgraph) -> None:
    assert ok(envgraph("--version")).out.startswith("envgraph 0.")


def test_a_new_domain_checks_generates_trains_and_reports(envgraph: Envgraph, tmp_path: Path) -> None:
    ok(envgraph("new", "maze"))
    assert "no problems" in ok(envgraph("check", "maze")).out
    quick = ("--set", "objective.effort=4_000_000", "--population", 4, "--require", 0.95)
    found = ok(envgraph("generate", "maze", *quick, "--name", "m")).out
    assert "of new learners solve E4" in found and " 0.0% after as many steps on E4 alone" in found
    ok(envgraph("train", "m", "--seeds", 2))
    shown = ok(envgraph("report", "m")).out
    assert "E4" in shown and "report.html" in shown
    told = ok(envgraph("report", "m", "--format", "json")).json
    names = ["E1", "E2", "E3", "E4", "E4 alone"]
    assert [one["environment"] for one in told["environments"]] == names  # type: ignore[index]
    assert "<svg" in (tmp_path / "runs" / "m" / "report.html").read_text()


def test_generate_warns_about_a_target_that_no_learner_solves(envgraph: Envgraph) -> None:
    ok(envgraph("new", "maze"))
    done = ok(envgraph("generate", "maze", "--set", "objective.effort=1"))
    assert "0.0% of new learners solve E3" in done.out and "needs no other" not in done.out
    assert "[teaches-little]" in done.err


def test_a_new_domain_without_its_objective_is_diverse(envgraph: Envgraph, tmp_path: Path) -> None:
    ok(envgraph("new", "maze"))
    file = tmp_path / "maze" / "family.toml"
    file.write_text(re.sub(r"\[objective\].*?(?=\[diversity\])", "", file.read_text(), flags=re.DOTALL))
    assert "no problems" in ok(envgraph("check", "maze")).out
    found = ok(envgraph("generate", "maze", "--generations", 30, "--format", "json")).json
    plans = {one["measures"]["plan"] for one in found["members"]}  # type: ignore[index]
    assert len(plans) >= 3 and min(plans) == 14


@pytest.mark.parametrize(
    "domain",
    [
        "burning_forest",
        "keydoor",
        "warehouse",
        *(pytest.param(name, marks=AT_NIGHT) for name in ("network", "social_media", "sokoban")),
    ],
)
def test_a_bundled_domain_can_be_copied_to_start_from(envgraph: Envgraph, domain: str) -> None:
    done = ok(envgraph("new", "mine", "--domain", domain))
    assert "wrote mine/" in done.out and "next: envgraph " in done.out
    source = bundled_domain(domain)
    names = sorted(str(path.relative_to("mine")) for path in Path("mine").rglob("*.*"))
    assert names == sorted(str(path.relative_to(source)) for path in source.rglob("*.*"))
    ok(envgraph("check", *(f"mine/{name}" for name in names if name != "audit/audit.toml")))
    again = envgraph("new", "mine", "--domain", domain)
    assert again.code == 1 and "exists already" in again.err


def test_an_unknown_domain_to_copy_gets_a_hint(envgraph: Envgraph) -> None:
    done = envgraph("new", "mine", "--domain", "keydor")
    assert done.code == 1 and "did you mean `keydoor`?" in done.err


def test_new_refuses_existing_directories_and_invalid_names(envgraph: Envgraph) -> None:
    ok(envgraph("new", "maze"))
    again = envgraph("new", "maze")
    assert again.code == 1 and "exists already" in again.err
    bad = envgraph("new", "My Maze")
    assert bad.code == 1 and "cannot be the name of a domain" in bad.err


def test_check_prints_position_line_caret_and_hint(envgraph: Envgraph, tmp_path: Path) -> None:
    ok(envgraph("new", "maze"))
    rules = tmp_path / "maze" / "maze.rules"
    rules.write_text(rules.read_text().replace("set robot.at = there", "set robot.att = there", 1))
    result = envgraph("check", "maze/maze.rules")
    assert result.code == 1
    assert "maze/maze.rules:10:24: " in result.err
    assert "did you mean `at`?" in result.err
    source, caret = result.err.split("\n")[1:3]
    assert source[caret.index("^") :].startswith("att")
    found = envgraph("check", "maze/maze.rules", "--format", "json")
    assert found.code == 1
    assert found.json["diagnostics"][0]["start"] == {"line": 10, "column": 24}  # type: ignore[index]


def test_check_leaves_out_warnings_that_are_ignored(envgraph: Envgraph, tmp_path: Path) -> None:
    (tmp_path / "m.metamodel").write_text("metamodel m\nclass P { int x }\n")
    query = "pattern p(p : P) { P.x(p, x); }\npattern q(p) { P(p); }\n"
    (tmp_path / "m.query").write_text('import "m.metamodel"\n' + query)
    files = (tmp_path / "m.query",)
    assert "[used-once]" in ok(envgraph("check", *files)).err
    shown = ok(envgraph("check", *files, "--ignore", "used-once"))
    assert "[undeclared-type]" in shown.err and "used-once" not in shown.err and "1 warning" in shown.out
    words = ("--ignore", "used-once", "--ignore", "undeclared-type")
    assert "no problems" in ok(envgraph("check", *files, *words)).out
    assert json.loads(ok(envgraph("check", *files, *words, "--format", "json")).out)["diagnostics"] == []
    (tmp_path / "m.query").write_text('import "m.metamodel"\npattern p(p : Q) { P(p); }\n')
    assert envgraph("check", *files, "--ignore", "unknown-type").code == 1


def test_check_reports_missing_files_without_a_traceback(envgraph: Envgraph) -> None:
    for name in ("missing.query", "missing", "no_language.txt"):
        result = envgraph("check", name)
        assert result.code == 1 and name.split(".")[0] in result.err


def test_match_prints_matches_for_people_and_programs(envgraph: Envgraph) -> None:
    ok(envgraph("new", "maze"))
    text = ok(envgraph("match", "maze/maze.model", "maze/maze.query", "solvable")).out
    assert "1 match of solvable" in text and "Start cell[0, 0]" in text
    matches = ok(envgraph("match", "maze/maze.model", "maze/maze.query", "solvable", "--format", "json")).json
    assert matches[0]["goal"]["class"] == "Goal"  # type: ignore[index]
    assert matches[0]["goal"]["attributes"] == {"x": 7, "y": 7}  # type: ignore[index]
    assert "no match" in ok(envgraph("match", "maze/maze.model", "maze/maze.query", "onGoal")).out


def test_match_can_fix_a_parameter(envgraph: Envgraph) -> None:
    ok(envgraph("new", "maze"))
    arguments = ("match", "maze/maze.model", "maze/maze.query", "neighbour", "--format", "json")
    every = ok(envgraph(*arguments)).json
    some = ok(envgraph(*arguments, "--where", "from=1")).json
    assert len(every) == 224 and 2 <= len(some) <= 3  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("where", "message"),
    [("form=1", "did you mean `from`?"), ("from", "NAME=VALUE"), ("from=nobody", "no object `nobody`")],
)
def test_match_reports_invalid_parameter_values(envgraph: Envgraph, where: str, message: str) -> None:
    ok(envgraph("new", "maze"))
    result = envgraph("match", "maze/maze.model", "maze/maze.query", "neighbour", "--where", where)
    assert result.code == 1 and message in result.err


def test_an_unknown_pattern_or_rule_has_a_hint(envgraph: Envgraph) -> None:
    ok(envgraph("new", "maze"))
    result = envgraph("match", "maze/maze.model", "maze/maze.query", "solvabel")
    assert result.code == 1 and "did you mean `solvable`?" in result.err
    result = envgraph("apply", "maze/maze.model", "maze/maze.rules", "moveRigth")
    assert result.code == 1 and "did you mean `moveRight`?" in result.err


def test_apply_prints_applications_and_writes_the_model(envgraph: Envgraph, tmp_path: Path) -> None:
    ok(envgraph("new", "maze"))
    files = ("maze/maze.model", "maze/maze.rules")
    out = ok(envgraph("apply", *files, "moveRight", "--times", 3, "-o", "out/moved.json")).out
    assert "1: maze.moveRight(robot=Robot robot" in out and "3: " in out
    model = json.loads((tmp_path / "out" / "moved.json").read_text())
    (robot,) = [one for one in model["objects"] if one["class"] == "Robot"]
    (cell,) = [one for one in model["objects"] if one["id"] == robot["features"]["at"]]
    assert (cell["features"]["x"], cell["features"].get("y", 0)) == (3, 0)
    none = envgraph("apply", *files, "moveUp")
    assert none.code == 1 and "no match of moveUp" in none.out


def test_apply_fixes_any_variable_of_the_match(envgraph: Envgraph) -> None:
    ok(envgraph("new", "maze"))
    rule = ("apply", "maze/maze.model", "maze/maze.rules", "moveRight")
    assert "there=Floor" in ok(envgraph(*rule, "-w", "there=2")).out
    assert "no match of moveRight" in envgraph(*rule, "-w", "there=3").out
    result = envgraph(*rule, "-w", "their=2")
    assert result.code == 1 and "unknown variable `their`; did you mean `there`?" in result.err


def test_apply_prints_the_key_that_a_deleted_object_had(envgraph: Envgraph) -> None:
    Path("k.metamodel").write_text("metamodel k @key(number) class Room { int number }")
    Path("k.xmi").write_text('<k:Room xmlns:k="k" number="103"/>')
    Path("k.rules").write_text('import "k.metamodel" rule drop { lhs { room : Room; } modify { delete room; } }')
    assert ok(envgraph("apply", "k.xmi", "k.rules", "drop")).out == "1: drop(room=Room {number = 103} (deleted))\n"


def test_match_without_a_name_lists_the_patterns(envgraph: Envgraph) -> None:
    ok(envgraph("new", "maze"))
    files = ("match", "maze/maze.model", "maze/maze.query")
    lines = ok(envgraph(*files)).out.splitlines()
    assert [line.split(maxsplit=1) for line in lines[2:4]] == [
        ["maze.neighbour", "from, to"],
        ["maze.passage", "from, to"],
    ]
    listed = ok(envgraph(*files, "--format", "json")).json
    assert {"pattern": "maze.onGoal", "parameters": ["robot"]} in listed and len(listed) == len(lines) - 2
    assert "#" not in ok(envgraph("match", "maze/maze.model", "maze/maze.rules")).out, "patterns made for rules"
    with open("private.query", "w", encoding="utf-8") as file:
        file.write('import "maze/maze.metamodel" private pattern one(robot : Robot) { Robot(robot); }')
    assert ok(envgraph("match", "maze/maze.model", "private.query")).out == "there are no patterns\n"


def test_apply_prints_the_name_that_a_deleted_object_had(envgraph: Envgraph, tmp_path: Path) -> None:
    (tmp_path / "s.metamodel").write_text("metamodel s class Box { contains Box[0..*] parts int n }")
    (tmp_path / "s.model").write_text(
        'import "s.metamodel" model m : s { top : Box { parts = [ a : Box { n = 1 }, b : Box { n = 2 } ] } }'
    )
    (tmp_path / "s.rules").write_text(
        """import "s.metamodel"
        rule drop(part : Box) {
            lhs { box : Box -parts-> part; }
            modify { delete part; create box -parts-> new : Box; }
        }
        unit both { drop(_); drop(_); }
        """
    )
    result = envgraph("apply", "s.model", "s.rules", "drop", "--where", "part=b", "--trace", "t.jsonl", "-o", "o.xmi")
    assert ok(result).out.splitlines()[0] == "1: drop(part=Box b (deleted), box=Box top); created Box#3"
    both = ok(envgraph("apply", "s.model", "s.rules", "both", "--seed", 1)).out
    assert re.search(r"drop\(part=Box [ab] \(deleted\), box=Box top\)", both)
    assert "Box" in (tmp_path / "o.xmi").read_text()
    assert "1 application" in ok(envgraph("replay", "s.model", "s.rules", "t.jsonl")).out
    told = json.loads(ok(envgraph("apply", "s.model", "s.rules", "both", "--format", "json")).out)
    assert len(told["applications"][0]["steps"]) == 2


def test_a_model_written_by_apply_can_be_matched_and_rewritten(envgraph: Envgraph) -> None:
    ok(envgraph("new", "maze"))
    files = ("maze/maze.rules", "moveRight")
    ok(envgraph("apply", "maze/maze.model", *files, "-o", "one.json"))
    ok(envgraph("apply", "one.json", *files, "-o", "two.json"))
    at_once = ok(envgraph("apply", "maze/maze.model", *files, "--times", 2, "--format", "json")).json
    assert json.loads(Path("two.json").read_text()) == at_once["model"]  # type: ignore[index]
    moved = ok(envgraph("match", "two.json", "maze/maze.query", "neighbour", "--format", "json")).json
    assert len(moved) == 224  # type: ignore[arg-type]


def test_a_broken_model_as_json_is_a_diagnostic(envgraph: Envgraph, tmp_path: Path) -> None:
    ok(envgraph("new", "maze"))
    (tmp_path / "bad.json").write_text('{"format": "envgraph-model-1", "objects": [{"id": 0, "class": "Wrld"}]}')
    result = envgraph("match", "bad.json", "maze/maze.query", "onGoal")
    assert result.code == 1 and "did you mean `World`?" in result.err
    assert result.err.startswith("bad.json:1:63: ") and "^^^^^^" in result.err
    (tmp_path / "bad.json").write_text('{"format": "envgraph-model-1",\n "objects": [}')
    result = envgraph("match", "bad.json", "maze/maze.query", "onGoal")
    assert result.code == 1 and result.err.startswith("bad.json:2:14: ")


def test_titles_of_narrow_tables_are_not_wrapped(envgraph: Envgraph) -> None:
    ok(envgraph("new", "maze"))
    out = ok(envgraph("match", "maze/maze.model", "maze/maze.query", "neighbour", "-w", "from=1")).out
    assert " of neighbour" in out.splitlines()[0]


def test_matching_a_private_pattern_is_refused_as_private(envgraph: Envgraph, tmp_path: Path) -> None:
    ok(envgraph("new", "maze"))
    query = tmp_path / "maze" / "maze.query"
    query.write_text(query.read_text() + "\nprivate pattern hidden(cell : Rock) { Rock(cell); }\n")
    result = envgraph("match", "maze/maze.model", "maze/maze.query", "hidden")
    assert result.code == 1 and "is private" in result.err


def test_training_follows_the_sequences_of_the_family_file(envgraph: Envgraph, tmp_path: Path) -> None:
    ok(envgraph("new", "maze"))
    file = tmp_path / "maze" / "family.toml"
    file.write_text(file.read_text() + '[curriculum]\nsequences = "full"\n')
    ok(envgraph("generate", "maze", "--set", "objective.effort=1", "--population", 5, "--name", "m"))

    def labels(*options: object) -> list[str]:
        train = ("train", "m", "--steps", 50, "--seeds", 1, *options)
        results = ok(envgraph(*train, "--format", "json")).json
        return [f"{one['kind']} {one['label']}" for one in results["results"]]  # type: ignore[index]

    assert labels("--controls", "none") == [
        "curriculum E1-E5",
        *(f"baseline E{place}" for place in range(1, 6)),
    ]
    assert (tmp_path / "runs" / "m" / "training" / "50" / "stages").is_dir()
    assert labels("--curricula", "direct", "--force") == ["baseline E5"]
    assert not (tmp_path / "runs" / "m" / "training" / "50" / "stages").exists()
    assert "E5 alone" in ok(envgraph("report", "m")).out


def test_the_report_shows_the_settings_of_the_run_not_of_the_file(envgraph: Envgraph, tmp_path: Path) -> None:
    small = ("--seed", 7, "--generations", 3, "--population", 3, "--name", "a")
    ok(envgraph("generate", "burning_forest/paper.toml", *small))
    ok(envgraph("report", "a", "-o", "a.html"))
    page = (tmp_path / "a.html").read_text()
    assert "seed 7, population 3, 3 generations" in page
    ok(envgraph("import", DATA / "environment-config.json", "--name", "p"))
    ok(envgraph("report", "p", "-o", "p.html"))
    assert "generations" not in (tmp_path / "p.html").read_text()


def test_apply_runs_a_unit_and_prints_each_step(envgraph: Envgraph) -> None:
    domain = bundled_domain("burning_forest")
    model = domain / "running_4x4.model"
    lines = ok(envgraph("apply", model, domain / "burning_forest.rules", "burnDown")).out.splitlines()
    assert lines and all("1: burning_forest.spread(fire=BurningTile tile[" in line for line in lines)


def test_generate_show_and_export_print_the_same_measures(envgraph: Envgraph, tmp_path: Path) -> None:
    small = ("--generations", 8, "--population", 3, "--seed", 1)
    generated = ok(envgraph("generate", "burning_forest/paper.toml", *small, "--name", "a", "--format", "json")).json
    shown = ok(envgraph("show", "a", "--format", "json")).json
    assert [m["measures"] for m in generated["members"]] == [m["measures"] for m in shown["members"]]  # type: ignore[index]
    ok(envgraph("export", "a", "--format", "ga4cl", "-o", "a.json"))
    maps = json.loads((tmp_path / "a.json").read_text())["environments"]
    assert [m["complexity"] for m in maps] == [m["measures"]["complexity"] for m in shown["members"]]  # type: ignore[index]
    said = ok(envgraph("export", "a", "-o", "family.json")).out.splitlines()
    assert said[0] == "wrote family.json"
    made: dict[str, Any] = {"envgraph": package}
    exec("\n".join(said[1:]), made)
    assert (made["env"].spec.max_episode_steps, made["envs"].num_envs) == (200, 8)
    assert ok(envgraph("show", "family.json", "--format", "json")).json == shown
    assert ok(envgraph("export", "a", "--format", "svg")).out.count(">complexity 0.") == 3
    assert "E2" in ok(envgraph("show", "a", "--variant", "E2")).out


def test_a_family_is_exported_as_a_package(envgraph: Envgraph, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ok(envgraph(*FIRES))
    said = ok(envgraph("export", "a", "--format", "compiled", "-o", "fires")).out.splitlines()
    assert said[0] == "wrote fires"
    monkeypatch.syspath_prepend(tmp_path)
    made: dict[str, Any] = {}
    exec("\n".join(said[1:]), made)
    wanted = package.make_vec(tmp_path / "runs/a", num_envs=8, engine="compiled")
    assert made["observations"].tolist() == wanted.reset(seed=0)[0].tolist()
    assert "Environments" in (tmp_path / "fires/README.md").read_text("utf-8")
    for arguments, told in (((), "add `-o FOLDER`"), (("-o", "fires"), "fires exists already")):
        refused = envgraph("export", "a", "--format", "compiled", *arguments)
        assert refused.code == 1 and told in refused.err

    def program(*_: object) -> None:
        raise NotCompiled("units")

    monkeypatch.setattr(Family, "program", program)
    refused = envgraph("export", "a", "--format", "compiled", "-o", "more")
    assert refused.code == 1 and "cannot be compiled: compiled environments do not support units" in refused.err


def test_a_family_is_exported_as_code_from_templates(envgraph: Envgraph, tmp_path: Path) -> None:
    ok(envgraph(*FIRES))
    said = ok(envgraph("export", "a", "--to", "python", "-o", "fires")).out.splitlines()
    assert said == ["wrote 7 files in fires", "pip install fires", "import fires", "env = fires.make('E2')"]
    assert "| E2 |" in (tmp_path / "fires/README.md").read_text("utf-8")
    said = ok(envgraph("templates", "mine")).out.splitlines()
    assert said[1] == "next: envgraph export RUN --format python --templates mine -o FOLDER"
    (tmp_path / "mine/README.md.j2").write_text("{{ nam }}")
    refused = envgraph("export", "a", "--format", "python", "--templates", "mine", "-o", "more")
    assert refused.code == 1
    assert (
        refused.err
        == "mine/README.md.j2:1:4: unknown name `nam`\n 1 | {{ nam }}\n   |    ^^^\nhint: did you mean `name`?\n"
        "\nmore: envgraph help unknown-name\n"
    )
    (tmp_path / "mine/README.md.j2").write_text("about {{ name }}")
    ok(envgraph("export", "a", "--format", "python", "--templates", "mine", "-o", "more"))
    assert (tmp_path / "more/README.md").read_text("utf-8") == "about BurningForest"
    ok(envgraph("export", "a", "--format", "npz", "-o", "tables.npz"))
    assert (tmp_path / "tables.npz").read_bytes() == (tmp_path / "fires/src/fires/tables.npz").read_bytes()
    refused = envgraph("export", "a", "--format", "frozenlake")
    assert refused.code == 1 and "E1: this environment is not a map of FrozenLake: several of its states" in refused.err
    for arguments, told in (
        (("--format", "python"), "add `-o FOLDER`"),
        (("--format", "npz"), "add `-o FILE`"),
        (("--format", "npz", "--templates", "mine"), "use `--format python`"),
        (("--format", "python", "-o", "fires"), "fires exists already"),
        (("--format", "minigrid"), "format `minigrid` writes a folder"),
        (("--format", "minigrid", "-o", "levels"), "the metamodel has no class `Level`"),
        (("--format", "python", "--templates", "none", "-o", "new"), "run `envgraph templates DIR`"),
    ):
        refused = envgraph("export", "a", *arguments)
        assert refused.code == 1 and told in refused.err


def test_a_family_of_frozen_lakes_is_exported_for_gymnasium(envgraph: Envgraph) -> None:
    ok(envgraph("adopt", "FrozenLake-v1", "-o", "lake"))
    ok(envgraph("generate", "lake", "--generations", 2, "--population", 2, "--name", "lakes"))
    maps = json.loads(ok(envgraph("export", "lakes", "--format", "frozenlake")).out)
    assert maps["E2"]["desc"] == ["SFFF", "FHFH", "FFFH", "HFFG"] != maps["E1"]["desc"]
    for arguments in maps.values():
        assert arguments["success_rate"] == 1.0 / 3.0 and arguments["is_slippery"]
        assert gymnasium.make("FrozenLake-v1", **arguments).spec.max_episode_steps == 100  # type: ignore[union-attr]


def test_generate_does_not_overwrite_a_run(envgraph: Envgraph) -> None:
    small = ("generate", "burning_forest/paper.toml", "--generations", 1, "--name", "a")
    ok(envgraph(*small))
    result = envgraph(*small)
    assert result.code == 1 and "--resume" in result.err


def test_import_keeps_a_published_family(envgraph: Envgraph, tmp_path: Path) -> None:
    ok(envgraph("import", DATA / "environment-config.json", "--name", "published"))
    ok(envgraph("export", "published", "--format", "ga4cl", "-o", "again.json"))
    original = json.loads((DATA / "environment-config.json").read_text())
    assert json.loads((tmp_path / "again.json").read_text()) == original


def test_explain_prints_the_search_plan_for_the_object_counts_of_the_model(envgraph: Envgraph, tmp_path: Path) -> None:
    (tmp_path / "t.metamodel").write_text("metamodel t class A { refers B[*] to } class B { refers A[*] to }")
    asked = 'import "t.metamodel" pattern both(a : A, b : B) { A.to(a, b); B.to(b, a); }'
    (tmp_path / "t.query").write_text(asked)
    for few, many in ("AB", "BA"):
        objects = f"one : {few} {{ }} " + " ".join(f"m{i} : {many} {{ to = [one] }}" for i in range(9))
        (tmp_path / "t.model").write_text(f'import "t.metamodel" model m : t {{ {objects} }}')
        assert f"  for     {few}(" in ok(envgraph("explain", "t.model", "t.query", "both")).out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("generate", "burning_forst"), "did you mean"),
        (("show", "nothing"), "there is no run `nothing`"),
        (("export", "nothing"), "there is no run"),
        (("import", "missing.json"), "missing.json"),
        (("report", "nothing"), "there is no run"),
        (("train", "nothing"), "there is no run"),
        (("reproduce", "papr"), "did you mean `paper`?"),
        (("reproduce", "paper", "--steps", "10k"), "`10k` is not a whole number from 1 to 1,000,000,000"),
        (("generate", "burning_forest/paper.toml", "--resume", "--name", "x"), "run store"),
    ],
)
def test_missing_files_and_runs_are_named(envgraph: Envgraph, arguments: tuple[str, ...], message: str) -> None:
    result = envgraph(*arguments)
    assert result.code == 1 and message in result.err


def test_invalid_command_lines_have_exit_code_2(envgraph: Envgraph) -> None:
    assert envgraph("generate").code == 2
    assert envgraph("genrate", "x").code == 2


def test_unknown_formats_and_curricula_have_hints(envgraph: Envgraph) -> None:
    ok(envgraph(*FIRES))
    result = envgraph("export", "a", "--format", "ga4c")
    assert result.code == 1 and "did you mean `ga4cl`?" in result.err
    result = envgraph("train", "a", "--curricula", "suffix")
    assert result.code == 1 and "did you mean `suffixes`?" in result.err
    assert envgraph("show", "a", "--variant", "E7").code == 1


def test_training_is_the_same_for_any_number_of_workers(envgraph: Envgraph, tmp_path: Path) -> None:
    ok(envgraph("import", DATA / "environment-config.json", "--name", "p"))
    files = []
    for workers in (1, 2):
        ok(envgraph("train", "p", "--steps", 100, "--seeds", 3, "--workers", workers, "--force"))
        files.append({p.name: p.read_bytes() for p in (tmp_path / "runs" / "p" / "training").rglob("*.csv")})
    assert files[0] == files[1] and len(files[0]) == 3


def test_a_killed_run_resumes_to_the_same_family(envgraph: Envgraph, tmp_path: Path) -> None:
    arguments = ["generate", "burning_forest/paper.toml", "--generations", "800", "--seed", "3"]
    ok(envgraph(*arguments, "--name", "whole"))
    command = [sys.executable, "-m", "envgraph", *arguments, "--name", "killed"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    store = tmp_path / "runs" / "killed" / "run.sqlite"
    while generations(store) < 20 and process.poll() is None:
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL, "the run was over before it could be killed"
    assert 20 <= generations(store) < 800
    ok(envgraph("generate", "burning_forest/paper.toml", "--resume", "--name", "killed"))
    exported = [ok(envgraph("export", name, "--format", "ga4cl")).out for name in ("whole", "killed")]
    assert exported[0] == exported[1]


@pytest.mark.parametrize(("number", "word"), [(signal.SIGINT, "interrupted"), (signal.SIGTERM, "terminated")])
def test_an_interrupted_run_prints_how_to_resume(tmp_path: Path, number: int, word: str) -> None:
    command = [sys.executable, "-m", "envgraph", "generate", "burning_forest/paper.toml", "--name", "cut"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    while generations(tmp_path / "runs" / "cut" / "run.sqlite") < 5 and process.poll() is None:
        time.sleep(0.01)
    process.send_signal(number)
    _, messages = process.communicate()
    assert process.returncode == 128 + number
    assert messages.endswith(f"--name cut --directory runs --resume` resumes\n{word}\n")
    assert "Traceback" not in messages


def test_errors_in_texts_stored_in_a_run_name_the_run(envgraph: Envgraph, tmp_path: Path) -> None:
    ok(envgraph("generate", "keydoor/diverse.toml", "--name", "hurt", "--set", "search.generations=1"))
    store = tmp_path / "runs" / "hurt" / "run.sqlite"
    with closing(sqlite3.connect(store)) as connection, connection:
        connection.execute("UPDATE source SET text = 'populatoin = 6\n' || text WHERE path LIKE '%.toml'")
    done = envgraph("generate", "keydoor/diverse.toml", "--name", "hurt", "--resume")
    assert done.code == 1 and "`populatoin`" in done.err
    assert "note: the text is in runs/hurt/run.sqlite" in done.err


OUTPUTS = {
    "full": (
        "os.dup2(os.open('/dev/full', os.O_WRONLY), 1)",
        "error: standard output: no space left on device\n",
    ),
    "closed": ("os.close(1)", "error: standard output: not writable\n"),
    "pipe without reader": ("r, w = os.pipe(); os.dup2(w, 1); os.close(r)", ""),
}


@pytest.mark.parametrize("output", OUTPUTS)
@pytest.mark.parametrize("words", [["check", "{}", "--format", "json"], ["check", "none", "--format", "json"]])
def test_an_output_that_cannot_be_written_is_an_error_of_one_sentence(
    tmp_path: Path, output: str, words: list[str]
) -> None:
    opened, said = OUTPUTS[output]
    if "full" in opened and not Path("/dev/full").exists():
        pytest.skip("no device that is full")
    prepared = [sys.executable, "-c", f"import os, sys; {opened}; os.execv(sys.argv[1], sys.argv[1:])"]
    file = str(bundled_domain("burning_forest") / "burning_forest.metamodel")
    command = [*prepared, sys.executable, "-m", "envgraph", *(word.format(file) for word in words)]
    usual = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    done = subprocess.run(command, cwd=tmp_path, env=usual, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, said)


def generations(store: Path) -> int:
    """How many generations a store has that another process may be writing."""
    if not store.is_file():
        return 0
    with closing(sqlite3.connect(f"file:{store}?mode=ro", uri=True, timeout=30)) as connection:
        (count,) = connection.execute("SELECT count(*) FROM generation").fetchone()
    return int(count)


def test_models_and_metamodels_are_shown_and_drawn(
    envgraph: Envgraph, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ok(envgraph("new", "maze"))
    monkeypatch.setenv("PATH", "")
    model, metamodel = tmp_path / "maze" / "maze.model", tmp_path / "maze" / "maze.metamodel"
    assert "Robot" in ok(envgraph("show", model)).out
    assert ok(envgraph("show", model, "--format", "json")).json["metamodel"] == "maze"  # type: ignore[index]
    assert ok(envgraph("show", model, "--format", "dot")).out.startswith('digraph "')
    assert ok(envgraph("show", model, "--format", "svg")).out.endswith("</svg>\n")
    assert "abstract" in ok(envgraph("show", metamodel)).out
    assert ok(envgraph("show", metamodel, "--format", "dot")).out.startswith('digraph "maze" {')
    assert "<svg" in ok(envgraph("show", metamodel, "--format", "svg")).out
    for name, format in (("a.svg", "svg"), ("a.dot", "dot"), ("a.json", "json"), ("a.txt", "text")):
        printed = ok(envgraph("show", model, "--format", format)).out
        assert ok(envgraph("show", model, "-o", name)).out == f"wrote {name}\n"
        assert Path(name).read_text() == printed
    Path("a.svg").write_text("kept")
    assert envgraph("show", metamodel, "--format", "json", "-o", "a.svg").code == 1
    assert Path("a.svg").read_text() == "kept"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("show", "maze/maze.metamodel", "--format", "json"), "cannot be printed as JSON"),
        (("show", "maze/maze.model", "--variant", "E1"), "`--variant` is allowed only with a run or family"),
        (("show", "maze/none.model", "--format", "svg"), "there is no such file"),
        (("show", "maze", "--format", "dot"), "use `envgraph export maze --format svg` for a run"),
    ],
)
def test_arguments_that_cannot_be_drawn_are_refused(
    envgraph: Envgraph, arguments: tuple[str, ...], message: str
) -> None:
    ok(envgraph("new", "maze"))
    result = envgraph(*arguments)
    assert result.code == 1 and message in result.out + result.err


def test_a_run_is_written_as_a_trace_and_replayed(envgraph: Envgraph) -> None:
    domain = Path(__file__).parents[3] / "rules" / "burning_forest"
    files = (domain / "target_8x8.model", domain / "burning_forest.rules")
    printed = ok(envgraph("apply", *files, "burnDown", "--trace", "out.trace", "-o", "one.json")).out
    assert printed.splitlines()[-2:] == ["wrote out.trace", "wrote one.json"]
    again = ok(envgraph("replay", *files, "out.trace", "-o", "two.json"))
    applications = len(Path("out.trace").read_text().splitlines()) - 2
    assert again.out.startswith(f"{applications} applications; state ")
    assert Path("one.json").read_text() == Path("two.json").read_text()
    assert ok(envgraph("replay", *files, "out.trace", "--format", "json")).json["applications"] == applications


def test_replay_refuses_an_edited_trace_at_the_edited_line(envgraph: Envgraph) -> None:
    domain = Path(__file__).parents[3] / "rules" / "burning_forest"
    files = (domain / "target_8x8.model", domain / "burning_forest.rules")
    ok(envgraph("apply", *files, "changeBurningToRoad", "--trace", "out.trace"))
    text = Path("out.trace").read_text()
    Path("bad.trace").write_text(text.replace('"tile": ', '"tile": 1000'))
    result = envgraph("replay", *files, "bad.trace", "-o", "never.json")
    assert result.code == 1 and result.err.startswith("bad.trace:2:") and "application 1" in result.err
    assert not Path("never.json").exists()
    assert envgraph("replay", *files, "missing.trace").err.startswith("missing.trace:1:1: there is no such file")
    other = envgraph("replay", domain / "running_4x4.model", domain / "burning_forest.rules", "out.trace")
    assert other.code == 1 and "the recorded run began in state" in other.err


def test_apply_prints_why_a_unit_failed(envgraph: Envgraph) -> None:
    ok(envgraph("new", "maze"))
    Path("twice.rules").write_text(
        'import "maze/maze.rules"\nunit far { moveRight; moveUp; moveUp; moveUp; moveUp; moveUp; }\n'
    )
    lines = envgraph("apply", "maze/maze.model", "twice.rules", "far").out.splitlines()
    assert lines[-3].startswith("far failed: `moveUp` has no match (twice.rules:2:")
    assert lines[-1].endswith("^^^^^^")
    assert len(lines) > 1 and lines[0].startswith("1: maze.moveRight(")


def test_errors_during_an_application_show_the_text_of_the_rule(envgraph: Envgraph) -> None:
    ok(envgraph("new", "maze"))
    Path("more.rules").write_text(
        'import "maze/maze.metamodel"\n'
        "rule halve { lhs { robot : Robot -at-> tile; } modify { set tile.x = 1 / (tile.x - tile.x); } }\n"
        "rule vanish { lhs { robot : Robot -at-> tile; } modify { delete tile; } }\n"
        "unit twice(robot : Robot) { halve; }\n"
    )
    for call in (("halve",), ("twice", "-w", "robot=robot")):
        result = envgraph("apply", "maze/maze.model", "more.rules", *call)
        assert result.code == 1
        assert result.err.splitlines() == [
            "more.rules:2:70: rule `halve` cannot be applied: division by zero",
            " 2 | rule halve { lhs { robot : Robot -at-> tile; } modify { set tile.x = 1 / (tile.x - tile.x); } }",
            "   |" + " " * 70 + "^" * 21,
            "hint: write `check (tile.x - tile.x) != 0;` on the left side",
            "",
            "more: envgraph help no-value",
        ]
    result = envgraph("apply", "maze/maze.model", "more.rules", "vanish")
    assert result.code == 1
    assert "more.rules:3:65: rule `vanish` cannot be applied" in result.err
    assert "hint: also delete these links, or write `@semantics(spo)`" in result.err


def test_the_only_object_of_a_class_need_not_be_given_to_a_unit(envgraph: Envgraph) -> None:
    ok(envgraph("new", "maze"))
    Path("more.rules").write_text(
        'import "maze/maze.rules"\n'
        "unit twice(robot : Robot) { moveRight(robot); moveDown(robot); }\n"
        "unit put(robot : Robot, cell : Rock) { moveRight(robot); }\n"
        "rule many(robot : Robot, in least : int) { lhs { robot -at-> here; check here.x > least; } modify { } }\n"
    )
    assert "moveDown(robot=Robot robot" in ok(envgraph("apply", "maze/maze.model", "more.rules", "twice")).out
    asked = ok(envgraph("why-not", "maze/maze.model", "more.rules", "twice"))
    assert "`twice` for robot = `robot` succeeds" in asked.out
    for command in ("apply", "why-not"):
        result = envgraph(command, "maze/maze.model", "more.rules", "put")
        assert result.code == 1 and "write `--where 'cell=cell[2, 0]'`" in result.err
    for command in ("apply", "why-not", "explain"):
        result = envgraph(command, "maze/maze.model", "more.rules", "many")
        assert result.code == 1 and "`many` needs a value for `least`; write `--where least=..`" in result.err


def test_commands_that_run_a_file_count_its_warnings(envgraph: Envgraph) -> None:
    ok(envgraph("new", "maze"))
    Path("more.query").write_text(
        'import "maze/maze.metamodel"\nimport "maze/maze.rules"\n'
        "pattern any(cell : Rock) { Rock(cell); Rock.right(cell, next); }\n"
    )
    assert "2 warnings" in envgraph("check", "more.query").out
    for command in ("match", "explain", "why-not"):
        assert envgraph(command, "maze/maze.model", "more.query", "any").err == (
            "2 warnings: `envgraph check more.query` shows them\n"
        )


def test_explain_prints_environments_and_why_not_refuses_them(envgraph: Envgraph) -> None:
    ok(envgraph("new", "maze"))
    files = "maze/maze.model", "maze/maze.environment"
    assert "environment Maze is compiled" in ok(envgraph("explain", *files, "Maze")).out
    misspelt = envgraph("explain", *files, "Mazze")
    assert misspelt.code == 1
    assert misspelt.err == "error: unknown pattern, rule or environment `Mazze`; did you mean `Maze`?\n"
    elsewhere = envgraph("explain", "maze/maze.model", "maze/maze.query", "Maze")
    assert elsewhere.code == 1 and "give its `.environment` file" in elsewhere.err
    asked = envgraph("why-not", *files, "Maze")
    assert asked.code == 1
    assert (
        asked.err
        == "error: `Maze` is an environment, which has no matches; use `envgraph explain` to see how it is run\n"
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("moveRight", "maze/maze.rules"), "`moveRight` is not a file: write the model first"),
        (("maze/maze.rules", "jump"), "unknown rule, unit or group `jump`"),
        (("maze/maze.rules", "moveRight", "-w", "robot=nobody"), "has no object `nobody`; there "),
        (("maze/maze.rules", "moveRight", "-w", "robot"), "write `--where robot=..`"),
        (("more.rules", "place"), "`place` needs a value for `column`; write `--where column=..`"),
        (
            ("more.rules", "place", "-w", "column=x"),
            "`column` must be an `int`, not `x`; write `--where column=3`",
        ),
        (("more.rules", "place", "-w", f"column={2**63}"), f"`column` must be an `int`, not `{2**63}`"),
        (("more.rules", "place", "-w", f"column={'9' * 5000}"), "`column` must be an `int`, not `999"),
        (("more.rules", "place", "-w", "column=1_0"), "`column` must be an `int`, not `1_0`"),
    ],
)
def test_invalid_arguments_of_apply_get_a_hint(envgraph: Envgraph, arguments: tuple[str, ...], message: str) -> None:
    ok(envgraph("new", "maze"))
    Path("more.rules").write_text(
        'import "maze/maze.metamodel"\n'
        "rule place(column : int) { lhs { robot : Robot -at-> tile; } modify { set tile.x = column; } }\n"
    )
    result = envgraph("apply", "maze/maze.model", *arguments)
    assert result.code == 1
    assert message in result.err


@pytest.mark.parametrize(
    ("target", "command"),
    [
        ("maze/maze.query", ("format", "maze/maze.query")),
        ("out.xmi", ("convert", "maze/maze.model", "out.xmi")),
        ("out.json", ("apply", "maze/maze.model", "maze/maze.rules", "terrain", "-o", "out.json")),
        ("out.trace", ("apply", "maze/maze.model", "maze/maze.rules", "terrain", "--trace", "out.trace")),
        ("family.json", ("export", "m", "-o", "family.json")),
        ("page.html", ("report", "m", "-o", "page.html")),
        ("runs/m/training/100/runs.csv", ("train", "m", "--steps", "100", "--seeds", "1", "--force")),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_a_full_disk_leaves_the_old_file_unchanged(
    envgraph: Envgraph, monkeypatch: pytest.MonkeyPatch, target: str, command: tuple[str, ...]
) -> None:
    ok(envgraph("new", "maze"))
    if "m" in command:
        ok(envgraph("generate", "maze", "--set", "objective.effort=1", "--name", "m"))
    file = Path(target)
    file.parent.mkdir(parents=True, exist_ok=True)
    before = "\n\n" + file.read_text() if file.exists() else "old"
    file.write_text(before)
    entries = sorted(file.parent.iterdir())

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        result = envgraph(*command)
    wrote = "runs/m/training/unfinished.jsonl" if "train" in command else target  # what comes first
    assert result.code == 1 and f"{wrote}: no space left on device" in result.err
    assert file.read_text() == before
    assert sorted(file.parent.iterdir()) == entries
    ok(envgraph(*command))
    assert file.read_text() != before


def test_apply_fails_where_nothing_matches_or_a_unit_fails(envgraph: Envgraph) -> None:
    ok(envgraph("new", "maze"))
    Path("more.rules").write_text(
        'import "maze/maze.metamodel"\n'
        "rule never { lhs { r : Robot; r -at-> a : Rock; r -at-> b : Goal; } modify { delete r; } }\n"
        "rule clear { lhs { r : Rock; } modify { retype r : Floor; } }\n"
        "unit stops { clear; never; }\n"
    )
    files = ("maze/maze.model", "more.rules")
    for format in ("text", "json"):
        assert envgraph("apply", *files, "never", "--format", format).code == 1
        assert envgraph("apply", *files, "stops", "--format", format).code == 1
        ok(envgraph("apply", *files, "never", "--format", format, "--allow-none"))
    done = ok(envgraph("apply", *files, "clear", "--times", 100))
    assert "no match of clear after 18 applications" in done.out
    assert "failure" in envgraph("apply", *files, "stops", "--format", "json").out


def test_apply_writes_models_as_text_and_refuses_other_suffixes(envgraph: Envgraph) -> None:
    ok(envgraph("new", "maze"))
    apply = ("maze/maze.rules", "terrain", "-o")
    ok(envgraph("apply", "maze/maze.model", *apply, "deep/out.model"))
    assert Path("deep/out.model").read_text().startswith('import "../maze/maze.metamodel"\n')
    ok(envgraph("check", "deep/out.model"))
    ok(envgraph("apply", "deep/out.model", *apply, "out.json"))
    refused = envgraph("apply", "maze/maze.model", *apply, "out.txt")
    assert refused.code == 1 and "cannot be written; there are `.model`, `.xmi`, `.json`" in refused.err
    assert refused.out == "" and not Path("out.txt").exists()
    ok(envgraph("convert", "maze/maze.model", "copy.model"))
    shown = [ok(envgraph("show", name)).out for name in ("copy.model", "maze/maze.model")]
    assert shown[0] == shown[1]


def test_match_accepts_rules_and_literals_written_as_in_files(envgraph: Envgraph) -> None:
    ok(envgraph("new", "maze"))
    assert "1 match of moveRight" in ok(envgraph("match", "maze/maze.model", "maze/maze.rules", "moveRight")).out
    assert "no match" in ok(envgraph("match", "maze/maze.model", "maze/maze.rules", "moveUp", "-w", "here=2")).out
    Path("m.metamodel").write_text("metamodel m enum Way { east, west } class Box { Way way }")
    Path("m.model").write_text('import "m.metamodel" model a : m { b : Box { way = ::west } }')
    Path("m.query").write_text('import "m.metamodel" pattern goes(box : Box, way : Way) { Box.way(box, way); }')
    for literal in ("west", "::west", "Way::west"):
        assert "1 match" in ok(envgraph("match", "m.model", "m.query", "goes", "-w", f"way={literal}")).out
    assert "has no literal `wets`" in envgraph("match", "m.model", "m.query", "goes", "-w", "way=wets").err


def test_show_prints_the_lineage_of_members_and_the_rejections_of_a_run(envgraph: Envgraph) -> None:
    ok(envgraph("generate", "burning_forest/paper.toml", "--name", "run", "--generations", 3, "--population", 4))
    family = package.search.open_family("run")
    steps = ok(envgraph("show", "run", "--lineage", "E1", "--format", "json")).json
    assert isinstance(steps, dict) and steps["name"] == "E1" and steps["steps"]
    engine = family.domain.engine()
    for step in steps["steps"]:
        before, after = step["rule"].split(".")[-2:]
        (spelling,) = step["match"].values()
        assert spelling.startswith(before)
        matches = [one for one in engine.matches(step["rule"]) if str(one.object.x) in spelling]
        match = next(one for one in matches if f"y = {one.object.y}, x = {one.object.x}" in spelling)
        engine.apply(step["rule"], match)
        assert match.object.cls == after
    assert engine.model.state_hash() == family.model(family.member("E1")).state_hash()
    shown = ok(envgraph("show", "run", "--lineage", "E1")).out
    assert f"E1: {len(steps['steps'])} application" in shown
    assert "0 applications" in ok(envgraph("show", "run", "--lineage", "E4")).out
    rejected = ok(envgraph("show", "run", "--rejections", "--format", "json")).json
    assert isinstance(rejected, dict) and rejected["accepted"] > 4
    table = ok(envgraph("show", "run", "--rejections")).out
    assert all(reason in table and f"{count:,}" in table for reason, count in rejected["rejected"].items())
    ok(envgraph("export", "run", "-o", "family.json"))
    failed = envgraph("show", "family.json", "--rejections")
    assert failed.code == 1 and "does not record how it was generated" in failed.err
    assert envgraph("show", "run", "--lineage", "E9").code == 1


def test_verify_computes_certificates_twice_and_reports_differences(
    envgraph: Envgraph, monkeypatch: pytest.MonkeyPatch
) -> None:
    ok(envgraph(*DOORS, "--population", 2))
    shown = ok(envgraph("verify", "run")).out
    assert shown.splitlines()[0] == "KeyDoor: within 100 steps"
    found = ok(envgraph("verify", "run", "--format", "json")).json
    assert isinstance(found, dict)
    assert [one["differences"] for one in found["members"]] == [[], []]
    kept = [one["certificates"] for one in ok(envgraph("show", "run", "--format", "json")).json["members"]]  # type: ignore[index]
    assert kept[0].keys() == {"limit", "shortest_plan", "random_success", "optimal_return"}
    plan = found["members"][-1]["certificates"]["shortest_plan"]
    assert kept[-1]["shortest_plan"] == plan
    assert f"  {plan:.0f}  " in shown.splitlines()[-1]

    assert "shortest plan" in ok(envgraph("show", "run")).out
    ok(envgraph("report", "run"))
    assert "random walk in the family, 100 steps" in Path("runs/run/report.html").read_text()
    _, info = package.make("runs/run", variant="E1").reset(seed=0)
    assert (info["variant"], info["certificates"]) == ("E1", kept[0])
    ok(envgraph("export", "run", "-o", "family.json"))
    assert [one.certificates for one in open_family("family.json").members] == kept
    text = Path("family.json").read_text()
    ok(envgraph("verify", "family.json"))
    Path("family.json").write_text(text.replace(f'"shortest_plan": {plan}', f'"shortest_plan": {plan + 1}'))
    failed = envgraph("verify", "family.json")
    assert failed.code == 1 and "shortest_plan of the file" in failed.err

    whole = Family.explored

    def damaged(family: Family, member: Any, **options: Any) -> Any:
        found = whole(family, member, **options)
        return replace(found, tabular=replace(found.tabular, reward=found.tabular.reward + 0.5))

    monkeypatch.setattr(Family, "explored", damaged)
    failed = envgraph("verify", "run")
    assert failed.code == 1
    assert "the second computation gave other results: `E1 (optimal_return, policy_return)`" in failed.err


def test_an_interrupted_verification_goes_on(envgraph: Envgraph, monkeypatch: pytest.MonkeyPatch) -> None:
    ok(envgraph(*DOORS, "--population", 3))
    whole, asked = Family.explored, list[str]()

    def interrupted(family: Family, member: Any, **options: Any) -> Any:
        asked.append(member.name)
        if len(asked) == 2:
            raise KeyboardInterrupt
        return whole(family, member, **options)

    with monkeypatch.context() as patch:
        patch.setattr(Family, "explored", interrupted)
        failed = envgraph("verify", "run")
        assert failed.code == 130 and "1 environments are verified: `envgraph verify run" in failed.err
        shown = ok(envgraph("show", "run")).out.splitlines()
        assert [sum(word in line for line in shown) for word in ("random walk", "not verified")] == [1, 2]
        ok(envgraph("report", "run"))
        page = Path("runs/run/report.html").read_text()
        assert page.count("<dd>not verified</dd>") == 2 and "are not computed" not in page
        asked[:] = ["E1", "", ""]
        rows = ok(envgraph("verify", "run", "--resume")).out.splitlines()[2:]
        assert asked[3:] == ["E2", "E3"]
    assert [row.split()[0] for row in rows] == ["E1", "E2", "E3"]
    assert rows[0].endswith("same (verified earlier)") and rows[1].endswith("same")
    found = ok(envgraph("verify", "run", "--resume", "--format", "json")).json
    assert isinstance(found, dict) and len(found["members"]) == 3
    ok(envgraph("export", "run", "-o", "family.json"))
    refused = envgraph("verify", "family.json", "--resume")
    assert refused.code == 1 and "use `--resume` only with runs" in refused.err


def test_an_eof_error_is_not_reported_as_an_interruption(envgraph: Envgraph, monkeypatch: pytest.MonkeyPatch) -> None:
    def end(**options: object) -> None:
        raise EOFError

    monkeypatch.setattr("envgraph.cli._check_command.check_files", end)
    with pytest.raises(EOFError):
        envgraph("check", "burning_forest")
