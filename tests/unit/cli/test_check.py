"""What `envgraph check` finds before it searches, what it says if a search fails, and which codes it ignores."""

from __future__ import annotations

import ast
import json
import re
import sys
from collections.abc import Callable
from math import inf
from pathlib import Path

import pytest

import envgraph
from envgraph.cli import main
from envgraph.env.compiled import ActionPlan
from envgraph.errors import WARNING_CODES, EvaluationError
from envgraph.search import Domain
from envgraph.search.problem._individual_measures import ShortestPlan

FILES = {
    "pit.metamodel": """
metamodel pit
class Pit { contains Mole[*] moles  @range(0, 3) int depth = 3  int load }
@key(name) class Mole { string name  bool up }
""",
    "pit.query": """
import "pit.metamodel"
pattern low(pit : Pit) { find down(pit, _); }
pattern down(pit : Pit, mole : Mole) { Pit.moles(pit, mole); Mole.up(mole, false); }
""",
    "pit.rules": """
import "pit.metamodel"
rule lift(mole : Mole) { lhs { } modify { set mole.up = true; } }
rule raise { lhs { mole : Mole; } modify { set mole.up = true; } }
""",
    "pit.model": """
import "pit.metamodel"
model pit : pit {
    pit : Pit { moles = [Mole { name = "a" },
        Mole { name = "b" }] }
}
""",
    "pit.environment": """
import "pit.query"
import "pit.rules"
environment Pit(pit : Pit) {
    action lift(mole : Mole) = lift(mole)
    on neg find down(pit, _) terminate success
    each step apply pit.load: raise()
    observe mole.up for mole : Mole
    limit 9 steps
}
""",
    "family.toml": """
model = "pit.model"
environment = "pit.environment"
[constraints]
reachable = ["success"]
[measures.plan]
kind = "shortest_plan"
[diversity]
kind = "binned_entropy"
of = "plan"
range = [0, 9]
[mutation]
rules = ["raise"]
""",
}
Changes = dict[str, tuple[str, str]]
Check = Callable[..., tuple[int, str, list[str]]]


def heads(err: str) -> list[str]:
    """Return the lines that begin a message, without excerpts, notes and hints."""
    return [line for line in err.split("\n") if re.match("pit/|error: ", line)]


@pytest.fixture
def check(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Check:
    """Write the domain `pit` with changes, and check it: return exit code, output, and the lines of the problems."""
    monkeypatch.chdir(tmp_path)

    def run(changes: Changes, *arguments: str) -> tuple[int, str, list[str]]:
        Path("pit").mkdir(exist_ok=True)
        for name, text in FILES.items():
            old, new = changes.get(name, ("", ""))
            assert old in text
            Path("pit", name).write_text(text.replace(old, new, 1), "utf-8")
        monkeypatch.setattr(sys, "argv", ["envgraph", "check", *(arguments or ["pit"])])
        code = main()
        out, err = capsys.readouterr()
        return code, out, heads(err)

    return run


TWICE = {"pit.model": ('"b"', '"a"')}
SAME_KEY = "pit/pit.model:5:9: `Mole#1` and `Mole#2` have the same key, name = a, but each"
BEFORE: dict[str, tuple[Changes, list[str]]] = {
    "rule": ({"pit.environment": ("= lift", "= lft")}, ["pit/pit.environment:5:32: unknown rule `lft`"]),
    "key": (TWICE, [SAME_KEY]),
    "key of agents": (
        {**TWICE, "pit.environment": ("action lift(mole : Mole) = lift(mole)", "agents together\n"
         "    agent mole : Mole { action lift = lift(mole) }")},
        [SAME_KEY],
    ),
    "keys of two classes": (
        {"pit.metamodel": ("@key(name) class Mole {", "@key(name) class Ant { string name }\n@key(name) class Mole {"),
         "pit.model": ('"b" }] }', '"a" }] }\n    Ant { name = "a" }\n    Ant { name = "a" }'),
         "pit.environment": ("action lift", "action tread(ant : Ant) = nothing()\n    action lift")},
        [SAME_KEY, "pit/pit.model:7:5: `Ant#3` and `Ant#4` have the same key, name = a, but each"],
    ),
    "several": (
        {**TWICE, "family.toml": ("reachable", 'forbid = ["down"]\nreachable'),
         "pit.environment": ("pit : Pit", "pit : Pit, top : Mole")},
        ["pit/pit.environment:4:28: cannot bind parameter `top`: the model has 2 objects", SAME_KEY,
         "pit/family.toml:5:11: the initial model violates `forbid down`: it matches"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BEFORE)
def test_errors_are_found_without_a_search(check: Check, monkeypatch: pytest.MonkeyPatch, case: str) -> None:
    monkeypatch.delattr(ShortestPlan, "find_plan")
    changes, messages = BEFORE[case]
    code, out, found = check(changes, "pit", "--ignore", "unlikely-probability")
    count = f"{len(messages)} error{'s' * (len(messages) > 1)}"
    assert (code, out) == (1, f"{count}; the states of `pit` were not searched\n")
    assert len(found) == len(messages) and all(map(str.startswith, found, messages)), found


def test_a_failed_search_leaves_the_warnings(
    check: Check, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    changes = {"pit.model": ("pit : Pit {", "pit : Pit { load = 7, depth = 9,")}
    code, out, found = check(changes)
    assert (code, out) == (1, "1 error, 2 warnings\n")
    unlikely, outside, error = found
    assert unlikely.endswith("this is an `int` [unlikely-probability]") and "7 is not a probability" in error
    assert outside.endswith("`pit` has 9 as `depth`, outside of its range from 0 to 3 [outside-range]")
    told = json.loads(check(changes, "pit", "--format", "json")[1])["diagnostics"]
    assert [one["code"] for one in told] == ["unlikely-probability", "outside-range", "no-value"]
    printed: list[str] = []

    def find_plan(*given: object) -> None:
        printed.append(capsys.readouterr().err)
        raise EvaluationError("the search failed")

    monkeypatch.setattr(ShortestPlan, "find_plan", find_plan)
    assert check(changes)[1:] == ("1 error, 2 warnings\n", []) and heads(printed[0]) == [unlikely, outside]


def test_searches_are_left_out_on_demand(check: Check, monkeypatch: pytest.MonkeyPatch) -> None:
    assert check({})[:2] == (0, "1 warning\n")
    monkeypatch.delattr(ShortestPlan, "find_plan")
    assert check({}, "pit", "--no-search")[:2] == (0, "1 warning\n")
    files = "pit/pit.environment", "pit/pit.model"
    assert check({}, *files)[:2] == (0, "1 warning\n")
    code, _, found = check(TWICE, *files)
    assert code == 1 and found[-1].startswith(SAME_KEY)


@pytest.mark.parametrize(("end", "guided"), [("down(pit, _)", True), ("down(pit, any)", True), ("low(pit)", False)])
def test_a_failed_search_says_if_nothing_guides_it(
    check: Check, monkeypatch: pytest.MonkeyPatch, end: str, guided: bool
) -> None:
    monkeypatch.setattr(ShortestPlan, "find_plan", lambda *given: ActionPlan(inf, (), 5, 3, 1))
    _, out, _ = check({"pit.environment": ("down(pit, _)", end)}, "pit", "--format", "json")
    hint = json.loads(out)["diagnostics"][-1]["hint"]
    assert ("nothing guides the search" in hint) != guided and 'write `guide = "name"` in a measure' in hint


def test_generate_warns_of_numbers_outside_their_range(check: Check, monkeypatch: pytest.MonkeyPatch) -> None:
    check({"pit.model": ("pit : Pit {", "pit : Pit { depth = 9,")})
    domain = Domain.load("pit")
    assert [one.code for one in domain.check_initial(search=False)] == ["outside-range"]


@pytest.mark.parametrize(
    ("code", "hint"),
    [("used-onc", "; did you mean `used-once`?"), ("unknown-class", ""), ("", "; there are `always-different`, ")],
)
def test_unknown_codes_to_ignore_are_refused(check: Check, code: str, hint: str) -> None:
    found = check({}, "pit", "--ignore", code)
    assert found[0] == 1 and found[2][0].startswith(f"error: there is no warning `{code}`{hint}")


def test_every_code_of_a_warning_can_be_ignored() -> None:
    """Codes of a call that gives a warning, as in the source, and those of all expected texts."""
    found = set[str]()
    for path in Path(envgraph.__file__).parent.rglob("*.py"):
        text = path.read_text("utf-8")
        for call in ast.walk(ast.parse(text)) if re.search("WARNING|warn|unresolved", text) else ():
            if isinstance(call, ast.Call) and call.args and is_warning(call):
                parts = [one.value for one in ast.walk(call.args[0]) if isinstance(one, ast.Constant)]
                found |= {str(one) for one in parts if re.fullmatch("[a-z]+(-[a-z]+)*", str(one))}
    for path in Path(__file__).parents[2].joinpath("golden").rglob("*.expected"):
        found |= set(re.findall(r": warning: .* \[([a-z-]+)\]$", path.read_text("utf-8"), re.MULTILINE))
    assert len(found) > 60 and found - WARNING_CODES == ELSEWHERE


ELSEWHERE = {
    *("different-measure", "different-rewards", "low-diversity", "not-formatted", "teaches-little", "unsatisfied")
}
"""Codes of warnings that other commands give."""


def is_warning(call: ast.Call) -> bool:
    """Return True for calls with the severity of a warning, and of the functions that only give warnings."""
    name = getattr(call.func, "attr", getattr(call.func, "id", ""))
    values = [*call.args, *(one.value for one in call.keywords)]
    severities = [getattr(one, "attr", "") for one in values]
    return name in ("warn", "_make_warning", "report_warning", "report_unresolved") or "WARNING" in severities
