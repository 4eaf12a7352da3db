"""The code in the documentation works, and what it says about files, modules and messages is true.

Fenced blocks are told apart by the words after the fence, which readers do not see:

- `query garden.query` starts that file of the example of the reference; `query` alone goes on with the last file of
  that language. All files are read without an error or a warning.
- `environment clause` stands inside an environment; `toml part` replaces tables of the family file.
- `query wrong` has a mistake; the `text` block after it shows lines of what is reported.
- `query cloud.query file` is that file in the directory of the page, as a reader saves it; `cloud.query append` adds
  to it.
- `python` and `sh` blocks of a page run one after the other in one empty directory; a `text` block after one of them
  is what it prints. `sh wrong` fails, and its `text` block shows the errors, too. `skip` is for what takes too long. A
  search for a family that teaches is cut short in a `shorter` block, which shows nothing of the result.
"""

from __future__ import annotations

import ast
import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
import pytest

import envgraph
from envgraph.cli import main
from envgraph.cli._app import app
from envgraph.env import EnvgraphEnv, EnvgraphLiveEnv, Simulator, explore
from envgraph.env.compiled import CompiledEnv, enumerate_states, program_of
from envgraph.errors import Diagnostic
from envgraph.graph import check_conformance
from envgraph.lang import LANGUAGES, TextFiles, load_workspace
from envgraph.learn import optimal_return
from envgraph.search import generate

ROOT = Path(__file__).parents[2]
REFERENCE = [
    ROOT / "docs" / "languages" / f"{name}.md"
    for name in (
        "metamodel",
        "model",
        "query",
        "expressions",
        "derived-features",
        "rules",
        "derived",
        "units",
        "environment",
        "effects",
        "observations",
        "agents",
        "../howto/environment-recipes",
        "family",
        "objective",
    )
]
ERRAND = ROOT / "docs" / "examples" / "errand"
COMMANDS = ROOT / "docs" / "reference" / "commands.md"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def page_name(page: Path) -> str:
    """Return the path of a page below `docs`, as the name of a test."""
    return page.relative_to(ROOT).as_posix().removeprefix("docs/")


FENCE = re.compile(r"^( *)```(\w+)([^\n`]*)\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Block:
    """A fenced block; `line` is that of its fence, `words` are those after the language."""

    page: Path
    line: int
    language: str
    words: tuple[str, ...]
    text: str

    def __str__(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    def precedes(self, other: Block | None) -> bool:
        """Whether the other block stands right behind this one, so that it shows what this one prints."""
        return other is not None and other.line == self.line + self.text.count("\n") + 2


def blocks(page: Path) -> list[Block]:
    """The fenced blocks of a page."""
    text = page.read_text(encoding="utf-8")
    return [
        Block(
            page,
            text.count("\n", 0, found.start()) + 1,
            found.group(2),
            tuple(found.group(3).split()),
            "".join(line.removeprefix(found.group(1)) for line in found.group(4).splitlines(keepends=True)),
        )
        for found in FENCE.finditer(text)
    ]


def reference_blocks(word: str) -> Iterator[tuple[Block, Block | None]]:
    """The blocks of the reference with a word after the language, and the block after each."""
    for page in REFERENCE:
        found = blocks(page)
        for block, after in zip(found, [*found[1:], None], strict=True):
            if word in block.words:
                yield block, after


def garden() -> dict[str, str]:
    """The files of the example of the reference."""
    files = {path.name: path.read_text(encoding="utf-8") for path in sorted(ERRAND.iterdir())}
    current: dict[str, str] = {}
    for block in (block for page in REFERENCE for block in blocks(page)):
        if block.language not in (*LANGUAGES, "toml") or set(block.words) & {"wrong", "clause", "part"}:
            continue
        if block.words:
            current[block.language] = block.words[0]
            files[block.words[0]] = ""
        # Blank lines keep the numbers of lines from misleading: those of a fragment are found by its text.
        files[current[block.language]] += block.text + "\n"
    return files


GARDEN = garden()


def problems(extra: dict[str, str], *roots: str) -> tuple[Diagnostic, ...]:
    """What is wrong with files that stand beside those of the garden."""
    return load_workspace(roots, files=TextFiles({**GARDEN, **extra})).diagnostics


def inside_environment(clauses: str) -> str:
    """Clauses as a whole environment file."""
    imports = 'import "garden.behaviour.query"\nimport "garden.behaviour.rules"\n'
    return f"{imports}\nenvironment Garden(hedgehog : Hedgehog) {{\n{clauses}}}\n"


def with_tables(part: str) -> str:
    """The family file with the tables of a fragment in place of its own."""
    tables = re.split(r"^(?=\[)", GARDEN["family.toml"], flags=re.MULTILINE)
    given = {table.split("]")[0] for table in re.split(r"^(?=\[)", part, flags=re.MULTILINE)}
    return "".join(table for table in tables if table.split("]")[0] not in given) + "\n" + part


def beside_garden(block: Block) -> tuple[str, str]:
    """Name and text of a file that says what a fragment says."""
    match block.language:
        case "query":
            return "other.query", f'package garden\nimport "garden.query"\n{block.text}'
        case "rules":
            return "other.rules", f'package garden\nimport "garden.rules"\n{block.text}'
        case "environment":
            return "other.environment", inside_environment(block.text)
        case "toml":
            return "family.toml", with_tables(block.text)
    return f"other.{block.language}", block.text


@pytest.mark.parametrize("name", GARDEN)
def test_every_file_of_the_reference_is_read_without_diagnostics(name: str) -> None:
    assert [str(problem) for problem in problems({}, name)] == []


@pytest.mark.parametrize("block", [b for word in ("clause", "part") for b, _ in reference_blocks(word)], ids=str)
def test_fragments_of_the_reference_are_read_without_an_error(block: Block) -> None:
    name, text = beside_garden(block)
    said = problems({name: text}, name)
    assert [str(one) for one in said if one.code != "no-observation"] == []  # a fragment leaves that out


@pytest.mark.parametrize(("block", "after"), [*reference_blocks("wrong")], ids=str)
def test_mistakes_of_the_reference_are_reported_as_shown(block: Block, after: Block | None) -> None:
    assert after is not None and after.language == "text", "the report stands behind the mistake"
    name, text = beside_garden(block)
    shown = "\n".join(str(one) for one in problems({name: text}, name))
    for line in after.text.splitlines():
        assert line in shown


def test_every_language_has_a_page_and_a_file_in_the_example() -> None:
    kinds = {name.rpartition(".")[2] for name in GARDEN}
    assert kinds == {*LANGUAGES, "toml"}
    assert all(page.is_file() for page in REFERENCE)


@pytest.fixture
def garden_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The example of the reference on the disk, as the working directory."""
    for name, text in GARDEN.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.usefixtures("garden_directory")
def test_models_of_the_reference_conform_to_their_metamodel() -> None:
    for name in GARDEN:
        if name.endswith(".model"):
            assert check_conformance(envgraph.open(name).model) == []


@pytest.mark.usefixtures("garden_directory")
def test_rules_and_units_of_the_reference_apply_to_all_their_matches() -> None:
    engine = envgraph.open("garden.model", "garden.rules", "garden.behaviour.rules")
    start = engine.commit()
    for rule in engine.rules:
        for match in engine.matches(rule, **dict.fromkeys(engine.prepare(rule).inputs, 1.5)):
            assert engine.apply(rule, match) is not None
            engine.model.check_integrity()
            engine.checkout(start, discard=True)
    for unit in engine.units:
        taken = engine.signature(unit).parameters
        assert engine.run(unit, **{one.name: engine.model["hedgehog"] for one in taken})
        engine.checkout(start, discard=True)


def test_the_recipes_show_the_environment_of_the_example() -> None:
    shown = GARDEN["errand.environment"]
    assert shown.strip() == (ERRAND / "errand.environment").read_text(encoding="utf-8").strip()


@pytest.mark.usefixtures("garden_directory")
def test_recipes_of_the_reference_give_the_same_tables_on_every_engine() -> None:
    workspace = load_workspace(["errand.model", "errand.environment"])
    engine, behaviour = workspace.engine(), workspace.behaviour()
    table, program = explore(engine, behaviour).tabular, program_of(engine, behaviour, native=False)
    assert set(table.terminated.ravel().tolist()) == {-1, 0, 1, 2}
    assert len(table.start_states) == 12, "three goals, and two stops that may be closed"
    assert {"robot at", "robot target"} < {*EnvgraphEnv(table, observation="dict").observation_space}
    listed = enumerate_states(program)
    for name in (
        "next_state",
        "probability",
        "reward",
        "terminated",
        "observation",
        "start_probability",
        "allowed",
    ):
        assert np.array_equal(getattr(listed, name), getattr(table, name)), name
    envs = EnvgraphEnv(table), EnvgraphLiveEnv(Simulator(engine, behaviour)), CompiledEnv(program)
    for seed in range(6):
        seen = {str(env.reset(seed=seed)[0]) for env in envs}
        for action in (1, 4, 0, 2, 3, 1, 0):
            steps = [env.step(action)[:4] for env in envs]
            seen = {str((int(index), *rest)) for index, *rest in steps}
            assert len(seen) == 1
            if any(steps[0][2:]):
                break


@pytest.mark.usefixtures("garden_directory")
def test_each_bed_of_the_reference_has_its_own_chance_of_rain() -> None:
    workspace = load_workspace(["garden.model", "garden.weather.environment"])
    simulator = Simulator(workspace.engine(), workspace.behaviour())
    found: Counter[int] = Counter()
    for probability, _, _ in simulator.outcomes(simulator.action_names.index("go(north)")):
        dry = simulator.engine.count("dry")
        assert probability == pytest.approx(0.9**dry * 0.1 ** (3 - dry))
        found[dry] += 1
    assert found == {3: 1, 2: 3, 1: 3, 0: 1}


def test_family_of_the_reference_is_diverse_and_solvable(garden_directory: Path) -> None:
    family = generate("family.toml", garden_directory / "run.sqlite")
    assert len({member.measures["beds"] for member in family.members}) == 4
    for member in family.members:
        assert optimal_return(family.explored(member).tabular) > 5  # 10 for the nest; two apples are 2


# --- pages whose code runs


def runs(page: Path) -> bool:
    """Whether a page has code to run."""
    return any(block.language in ("python", "sh") and "skip" not in block.words for block in blocks(page))


def save_file(block: Block) -> None:
    """Write the file that a `file` block shows, or add an `append` block to it, in the present directory."""
    if {"file", "append"} & set(block.words):
        with Path(block.words[0]).open("w" if "file" in block.words else "a", encoding="utf-8") as file:
            file.write(block.text)


def run_python(block: Block, names: dict[str, object]) -> str:
    """What a block prints."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(block.text, str(block), "exec"), names)
    return printed.getvalue()


def run_shell(block: Block) -> str:
    """What the commands of a block print; lines of `envgraph` alone run in this process, since it starts slowly."""
    parts = re.split(r"^(envgraph [^<>|&;$`\\\n]*)\n", block.text, flags=re.MULTILINE)
    return "".join(
        run_command(block, shortened(block, shlex.split(part))) if number % 2 else run_lines(block, part)
        for number, part in enumerate(parts)
        if part
    )


def run_lines(block: Block, lines: str) -> str:
    """What a shell prints."""
    bin_ = Path(sys.executable).parent
    done = subprocess.run(
        ["sh", "-e", "-c", lines],
        env={**os.environ, "PATH": f"{bin_}{os.pathsep}{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{block}: {done.stdout}{done.stderr}"
    return done.stdout


def shortened(block: Block, words: list[str]) -> list[str]:
    """Return a command with less effort for a search, if its block is a `shorter` one."""
    quick = "shorter" in block.words and words[:2] == ["envgraph", "generate"]
    return [*words, "--set", "objective.effort=3_000_000"] if quick else words


def run_command(block: Block, words: list[str]) -> str:
    """What one command prints."""
    printed, told = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", words)
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(told):
            try:
                code = main()
            except SystemExit as stop:
                code = stop.code
    wrong = "wrong" in block.words
    assert bool(code) == wrong, f"{block}: {printed.getvalue()}{told.getvalue()}"
    return (told.getvalue() if wrong else "") + printed.getvalue()


@pytest.mark.parametrize("page", [page for page in PAGES if runs(page)], ids=page_name)
def test_code_of_a_page_runs_and_prints_what_it_shows(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    names: dict[str, object] = {"__name__": "page"}
    found = blocks(page)
    for block, after in zip(found, [*found[1:], None], strict=True):
        save_file(block)
        if "skip" in block.words or block.language not in ("python", "sh"):
            continue
        printed = run_python(block, names) if block.language == "python" else run_shell(block)
        if after is not None and block.precedes(after) and after.language == "text":
            assert printed == after.text, f"{after}: it prints\n{printed}"


def test_mistake_in_a_new_domain_is_reported_as_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = next(block.text for block in blocks(COMMANDS) if "maze.rules" in block.words)
    monkeypatch.setattr(sys, "argv", ["envgraph", "new", "maze", "--directory", str(tmp_path)])
    assert main() == 0
    texts = {path.name: path.read_text(encoding="utf-8") for path in tmp_path.iterdir()}
    texts["maze.rules"] = texts["maze.rules"].replace("-at->", "-att->", 1)
    found = load_workspace(["maze.rules"], files=TextFiles(texts)).diagnostics
    more = f"more: envgraph help {found[0].code}"
    assert [str(one) for one in found] == [shown.rstrip("\n").removesuffix(f"\n\n{more}")] and more in shown


def test_every_command_has_examples_that_it_accepts() -> None:
    lines = COMMANDS.read_text(encoding="utf-8").split("```{commands}\n", 1)[1].split("```")[0].splitlines()
    examples = [shlex.split(line)[1:] for line in lines]
    assert {words[0] for words in examples} == app.commands.keys() and len(app.commands) > 20
    for name, *words in examples:
        with click.Context(app, obj=[]) as root:  # an unknown option or a wrong value raises an exception
            app.commands[name].make_context(name, list(words), root)


# --- what the pages say exists


@pytest.mark.parametrize("page", PAGES, ids=page_name)
def test_files_that_a_page_names_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    named = set(re.findall(r"`((?:envgraph|tests|grammars|rules|docs)/[\w./]*)`", text))
    linked = {link.split("#")[0] for link in re.findall(r"\]\(([^)\s]+)\)", text) if "://" not in link}
    missing = [name for name in named if not (ROOT / name).exists()]
    missing += [link for link in linked if link and not (page.parent / link).exists()]
    assert missing == []


def test_the_page_of_engines_lists_exactly_what_is_not_compiled() -> None:
    page = (ROOT / "docs" / "python" / "engines.md").read_text("utf-8")
    rows = page.split("| compiled environments do not support |", 1)[1].split("\n\n", 1)[0].splitlines()[2:]
    listed = [phrase for row in rows for phrase in re.findall("`([^`]+)`", row.split(" | ")[0])]
    raised = [
        ast.unparse(call.args[0])
        for path in sorted((ROOT / "envgraph/env").rglob("*.py"))
        for call in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(call, ast.Call) and getattr(call.func, "id", "") == "NotCompiled"
    ]
    assert [text for text in raised if not any(phrase in text for phrase in listed)] == []
    assert [phrase for phrase in listed if not any(phrase in text for text in raised)] == []


ROOMS = sorted((ROOT / "docs" / "architecture").glob("*.md"))


def test_each_package_has_an_architecture_page_that_the_index_links() -> None:
    index = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    packages = {path.parent.name for path in (ROOT / "envgraph").glob("*/__init__.py")}
    layers = re.search(r"^    (code < .*)$", index, re.MULTILINE)
    assert layers is not None
    modules = {path.stem for path in (ROOT / "envgraph").glob("[a-z]*.py")}
    assert set(layers.group(1).split(" < ")) == packages | modules
    assert packages == {page.stem for page in ROOMS} - {"compiled"}
    assert [name for name in modules if f"| `{name}` |" not in index] == []
    assert [name for name in packages if f"(architecture/{name}.md)" not in index] == []


@pytest.mark.parametrize("page", ROOMS, ids=lambda page: page.stem)
def test_an_architecture_page_names_three_types_of_its_package(page: Path) -> None:
    table = re.search(
        r"^\| (?:type|name) \|.*\n\|---.*\n((?:\| .*\n)+)", page.read_text(encoding="utf-8"), re.MULTILINE
    )
    assert table is not None
    names = re.findall(r"^\| `(\w+)`", table.group(1), re.MULTILINE)
    folder = ROOT / "envgraph" / ("env/compiled" if page.stem == "compiled" else page.stem)
    modules = "\n".join(path.read_text("utf-8") for path in sorted(folder.rglob("*.py")))
    assert len(names) == 3
    assert [name for name in names if not re.search(rf"^(?:class|def) {name}\b", modules, re.MULTILINE)] == []


@pytest.mark.parametrize("page", PAGES, ids=page_name)
def test_rows_of_a_table_have_as_many_cells_as_its_head(page: Path) -> None:
    width = 0
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), start=1):
        cells = len(re.findall(r"(?<!\\)\|", line)) if line.startswith("|") else 0
        assert not (width and cells) or cells == width, f"{page.name}:{number}"
        width = cells
