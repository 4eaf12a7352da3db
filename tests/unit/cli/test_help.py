"""Every code of a diagnostic is explained, and its example has exactly this problem."""

from __future__ import annotations

import ast
import json
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

import envgraph
from envgraph.cli import main
from envgraph.cli._app import app
from envgraph.cli._help_command import KINDS, load_explanations
from envgraph.cli._output import diagnostics_of
from envgraph.errors import WARNING_CODES

PACKAGE = Path(envgraph.__file__).parent
EXPLAINED = load_explanations()
EXAMPLES = sorted(code for code, one in EXPLAINED.items() if one.wrong)
REPORTERS = {
    **{"Diagnostic": 0, "_make_warning": 0, "_raise_load_error": 1, "_report_error": 0, "_report_problem": 0},
    **{"error": 0, "from_problem": 0, "raise_limit_exceeded": 0, "report": 0, "report_at": 0, "report_error": 0},
    **{"report_unresolved": 0, "report_warning": 0, "warn": 0},
}
"""Functions that report a diagnostic, with the place of its code among the arguments."""
KEBAB = re.compile("[a-z]+(-[a-z]+)*")


def calls_in_the_source() -> Iterator[ast.Call]:
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text("utf-8")
        for node in ast.walk(ast.parse(text)) if re.search(r"Diagnostic|report|error\(|warn|Error\(", text) else ():
            if isinstance(node, ast.Call):
                yield node


def codes_in_the_source() -> set[str]:
    """Return the codes that are literal arguments of calls in the source, and the reasons of rule errors."""
    found = set[str]()
    for call in calls_in_the_source():
        name = getattr(call.func, "attr", getattr(call.func, "id", ""))
        places = (0, 1) if name == "_report" else (REPORTERS[name],) if name in REPORTERS else ()
        given: list[ast.expr] = [call.args[place] for place in places if place < len(call.args)]
        given += [one.value for one in call.keywords if one.arg == "reason" and name == "RuleError"]
        for one in given:
            branches = [one.body, one.orelse] if isinstance(one, ast.IfExp) else [one]
            texts = [branch.value for branch in branches if isinstance(branch, ast.Constant)]
            found |= {text for text in texts if isinstance(text, str) and KEBAB.fullmatch(text)}
    return found


def codes_of_exceptions() -> set[str]:
    """Return the codes that JSON output has for exceptions without a place in a text: they are named by their class."""
    bases: dict[str, list[str]] = {}
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text("utf-8")
        for node in ast.walk(ast.parse(text)) if "Error" in text else ():
            if isinstance(node, ast.ClassDef):
                bases[node.name] = [getattr(base, "id", "") for base in node.bases]

    def derives(name: str, root: str) -> bool:
        return name == root or any(derives(base, root) for base in bases.get(name, ()))

    wanted = {name for name in bases if derives(name, "EnvgraphError") and not derives(name, "DiagnosticError")}
    public = {name for name in wanted if name != "Contradiction" and not name.startswith("_")}  # that is internal
    return {re.sub("(?<=[a-z])(?=[A-Z])", "-", name).lower() for name in public}


def test_every_code_in_the_source_is_explained() -> None:
    found = codes_in_the_source()
    assert len(found) > 280 and found - EXPLAINED.keys() == set()
    assert EXPLAINED.keys() >= WARNING_CODES


def test_every_code_of_an_expected_text_is_explained() -> None:
    expected = (Path(__file__).parents[2] / "golden").rglob("*.expected")
    found = {code for path in expected for code in re.findall(r"warning: .*\[([a-z-]+)\]$", path.read_text(), re.M)}
    assert len(found) > 40 and found <= EXPLAINED.keys()


def test_every_exception_has_a_code_that_is_explained() -> None:
    found = codes_of_exceptions()
    assert len(found) > 8 and found <= EXPLAINED.keys()
    assert diagnostics_of(OSError(2, "No such file", "a"))[0].code in EXPLAINED


def test_no_explained_code_is_superfluous() -> None:
    texts = "".join(path.read_text("utf-8") for path in PACKAGE.rglob("*.py"))
    made = {f"{start}-{end}" for start in ("unknown", "ambiguous") for end in ("pattern", "rule")}
    made |= {"no-single-model", "no-single-environment", "values-left-out", "values-rounded", *codes_of_exceptions()}
    assert {code for code in EXPLAINED if f'"{code}"' not in texts} <= made


@pytest.mark.parametrize("code", EXAMPLES)
def test_example_of_a_code_has_exactly_this_problem(code: str) -> None:
    one = EXPLAINED[code]
    assert {found.code for found in one.wrong_diagnostics()} == {code}
    assert [str(found) for found in one.right_diagnostics()] == []


@pytest.mark.parametrize("code", sorted(code for code, one in EXPLAINED.items() if one.shell))
def test_commands_of_a_code_report_it(
    code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    printed = ""
    for line in ["envgraph new maze", *EXPLAINED[code].shell.strip().split("\n")]:
        if line.startswith("envgraph "):
            monkeypatch.setattr(sys, "argv", shlex.split(line))
            main()
            printed = "".join(capsys.readouterr())
        else:
            subprocess.run(["sh", "-c", line], check=True)
    shown = rf"^more: envgraph help .*\b{code}\b|\[{code}\]$|\"code\": \"{code}\""
    assert re.search(shown, printed, re.MULTILINE)


def test_explanations_are_short_sentences() -> None:
    for one in EXPLAINED.values():
        for text in (one.means, one.cure):
            assert text.endswith(".") and (text[0].isupper() or text[0] == "`") and text.count("`") % 2 == 0, one.code
            assert all(len(sentence.split()) <= 25 for sentence in re.split(r"[.:] ", text)), one.code
        assert not one.wrong or one.right or code_has_no_right_text(one.code)


def code_has_no_right_text(code: str) -> bool:
    return code == "no-agents"  # the clause is left out


def test_codes_and_commands_have_different_names() -> None:
    assert app.commands.keys() & EXPLAINED.keys() == set()


def run(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    monkeypatch.setattr(sys, "argv", ["envgraph", "help", *words])
    return main()


def test_help_of_a_code_prints_its_example(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(monkeypatch, "unknown-class", "used-once") == 0
    printed = capsys.readouterr().out
    one = EXPLAINED["unknown-class"]
    assert printed.startswith(f"error `unknown-class` (any file)\n\n{one.means}\nCure: {one.cure}\n")
    assert f"\n\n    {one.wrong}\n\nmaze.model:23:9: unknown class `Flor`\n" in printed
    assert "\nhint: did you mean `Floor`?\n" in printed and f"\n\n    {one.right}\n" in printed
    assert "\n\nwarning `used-once` (queries)\n" in printed


def test_help_of_a_command_is_that_of_the_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "check") == 0
    printed = capsys.readouterr().out
    monkeypatch.setattr(sys, "argv", ["envgraph", "check", "--help"])
    assert main() == 0
    assert printed == capsys.readouterr().out and printed.startswith("Usage: envgraph check ")


def test_help_without_a_name_lists_all_codes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch) == 0
    printed = capsys.readouterr().out
    assert set(re.findall(r"^([a-z-]+)  +[A-Z`]", printed, re.MULTILINE)) == EXPLAINED.keys()
    assert [title for title in KINDS.values() if f"\n{title}\n" not in f"\n{printed}"] == []


def test_help_as_json(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(monkeypatch, "unknown-class", "--format", "json") == 0
    found = json.loads(capsys.readouterr().out)[0]
    assert found["code"] == "unknown-class" and "did you mean `Floor`" in found["message"]


def test_unknown_name_is_refused_with_a_hint(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "unknown-clas") == 1
    assert capsys.readouterr().err == (
        "error: there is no code and no command `unknown-clas`; did you mean `unknown-class`?\n"
    )


def test_last_line_names_the_codes_of_errors(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.metamodel").write_text(
        "metamodel a\nclass A\nclass A extends B { int[*] n = 3 refers A[2..1] r opposite q }\n"
    )
    Path("a.query").write_text('import "a.metamodel"\npattern p(a) { A(a); A(b); Aa(c); }\n')
    monkeypatch.setattr(sys, "argv", ["envgraph", "check", "a.query"])
    assert main() == 1
    last = capsys.readouterr().err.splitlines()[-1]
    words = last.removeprefix("more: envgraph help ").split()
    assert len(words) == 3 and not WARNING_CODES & set(words) and set(words) <= EXPLAINED.keys()


def test_every_command_has_a_first_line_for_lists() -> None:
    assert all(isinstance(one, click.Command) and one.short_help for one in app.commands.values())
