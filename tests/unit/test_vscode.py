"""The extension for VS Code: the parts that need no Node."""

from __future__ import annotations

import json
import re
import runpy
import sys
from pathlib import Path
from typing import Any

import pytest
from language_tokens import tokens_of

from envgraph.cli import main
from envgraph.cli._new_command import write_domain
from envgraph.lang import LANGUAGES, load_workspace

FOLDER = Path(__file__).parents[2] / "editors" / "vscode"
MANIFEST: dict[str, Any] = json.loads((FOLDER / "package.json").read_text("utf-8"))
grammar_of = runpy.run_path(str(FOLDER / "grammars.py"))["grammar_of"]
KEYWORD_SCOPES = re.compile(r"(storage\.type|keyword\.control|constant\.language)\.envgraph\.")


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_textmate_grammar_has_a_rule_for_each_keyword(language: str) -> None:
    rules = [rule for rule in grammar_of(language)["patterns"] if KEYWORD_SCOPES.match(rule.get("name", ""))]
    found = [word for rule in rules for word in re.findall(r"^\\b\(\?:([\w|]+)\)\\b\(\?<=", rule["match"])]
    assert sorted("|".join(found).split("|")) == sorted(tokens_of(language).keywords)


def test_the_problem_matcher_reads_what_the_command_check_prints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    metamodel, query = tmp_path / "a.metamodel", tmp_path / "a.query"
    metamodel.write_text("metamodel a\nclass Box { }\n", "utf-8")
    query.write_text(
        'import "a.metamodel"\nprivate pattern p(x : Box) { Box(x); }\npattern q(x : Bax) { Box(x); }', "utf-8"
    )
    monkeypatch.setattr(sys, "argv", ["envgraph", "check", str(metamodel), str(query)])
    assert main() == 1
    pattern = MANIFEST["contributes"]["problemMatchers"][0]["pattern"]
    groups = [pattern[name] for name in ("file", "line", "column", "severity", "message", "code")]
    matches = [re.match(pattern["regexp"], line) for line in capsys.readouterr().err.splitlines()]
    assert [[match[group] for group in groups] for match in matches if match] == [
        [str(query), "2", "17", "warning", "private pattern `p` is never called", "unused-private-pattern"],
        [str(query), "3", "15", None, "unknown type `Bax`", None],
    ]


SNIPPETS = [
    (path.stem, name, "\n".join(one["body"]))
    for path in sorted((FOLDER / "snippets").glob("*.json"))
    for name, one in json.loads(path.read_text("utf-8")).items()
]
PARTS = {
    "metamodel": "metamodel part class Cell {{ }} class Robot {{ }} {}",
    "class": "metamodel part class Cell {{ }} class Robot {{ {} }}",
    "model": 'import "m.metamodel" model m : m {{ {} }}',
    "model value": 'import "m.metamodel" model m : m {{ world : World {{ cells = {} }} }}',
    "query": 'import "m.metamodel" {}',
    "query part": """import "m.query"
        pattern part(robot : Robot, cell : Cell) {{ Robot.at(robot, cell); {} }}""",
    "rules": 'import "m.rules" {}',
    "rules part": """import "m.query"
        rule part(robot : Robot) {{ lhs {{ robot -at-> here : Cell; }} {} modify {{ set robot.at = none; }} }}""",
    "unit": """import "m.rules"
        unit part(robot : Robot) {{ {} }}""",
    "environment": """import "m.query" import "m.rules"
        environment Part(robot : Robot) {{ action left = moveLeft(robot) {} }}""",
    "toml": """model = "m.model"
        imports = ["m.rules"]
        measures.size.kind = "distance"
        diversity = {{ kind = "binned_entropy", of = "size", range = [0, 9] }}
        mutation.rules = ["m.terrain"]
        {}""",
}
"""Texts in which snippets are used, by language and part."""
PART_OF = {
    **dict.fromkeys(("metamodel", "model", "environment", "family"), ""),  # a whole file
    **dict.fromkeys(("attribute", "contains", "refers", "opposite"), "class"),
    **dict.fromkeys(("grid", "table"), "model value"),
    **dict.fromkeys(("find", "closure", "neg", "count", "check"), "query part"),
    **dict.fromkeys(("not", "require", "forall"), "rules part"),
    **dict.fromkeys(("alap", "try", "if", "repeat"), "unit"),
}


def filled(snippet: str) -> str:
    """Return the text of a snippet whose places keep their defaults; a choice keeps its first alternative."""
    text = re.sub(r"\$\{\d+\|([^,|]*)[^}]*\|\}", r"\1", snippet).replace("$0", "").replace("\t", "    ")
    while (shorter := re.sub(r"\$\{\d+:([^${}]*)\}", r"\1", text)) != text:
        text = shorter
    return text


@pytest.fixture(scope="module")
def domain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the directory of the files that `envgraph new m` writes."""
    folder = tmp_path_factory.mktemp("new")
    write_domain(folder, "m")
    return folder


@pytest.mark.parametrize(("language", "name", "snippet"), SNIPPETS, ids=[f"{one[0]}-{one[1]}" for one in SNIPPETS])
def test_a_snippet_with_its_defaults_has_no_errors(domain: Path, language: str, name: str, snippet: str) -> None:
    text = filled(snippet)
    assert "$" not in text
    part = PART_OF.get(name, language)
    file = domain / f"part.{language}"
    file.write_text(PARTS[part].format(text) if part else text, "utf-8")
    found = load_workspace([file])
    assert found.errors == ()
    assert found.definitions or found.models or found.behaviours or found.metamodel or found.families
