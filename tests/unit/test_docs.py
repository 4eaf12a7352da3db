"""The code in the documentation works, and what it says about files, modules and messages is true.

Fenced blocks are told apart by the words after the fence, which readers do not see:

- ```` ```query garden.query ```` starts that file of the example of the reference; ```` ```query ```` goes on with the
  last file of that language. All files together are read without an error or a warning.
- ```` ```environment clause ```` stands inside an environment; ```` ```toml part ```` replaces tables of the family file.
- ```` ```query wrong ```` has a mistake; the ```` ```text ```` block after it shows lines of what is reported.
- ```` ```python ```` blocks of a page run one after the other in one empty directory, as do the ```` ```sh ```` blocks
  of the page, in the order of the page; ```` ```text ```` after one of them is what it prints. ```` skip ```` is for what
  takes long, and is only read.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from envgraph.errors import Diagnostic
from envgraph.lang import LANGUAGES, TextFiles, load_workspace

ROOT = Path(__file__).parents[2]
REFERENCE = [
    ROOT / "docs" / "languages" / f"{name}.md"
    for name in ("metamodel", "model", "query", "rules", "environment", "family")
]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]

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
    files: dict[str, str] = {}
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
        case "query" | "rules":
            imports = "".join(f'import "garden.{kind}"\n' for kind in ("query", "rules")[: 1 + (block.language == "rules")])
            return f"other.{block.language}", f"package garden\n{imports}{block.text}"
        case "environment":
            return "other.environment", inside_environment(block.text)
        case "toml":
            return "family.toml", with_tables(block.text)
    return f"other.{block.language}", block.text


@pytest.mark.parametrize("name", GARDEN)
def test_every_file_of_the_reference_is_read_without_a_word(name: str) -> None:
    assert [str(problem) for problem in problems({}, name)] == []


@pytest.mark.parametrize("block", [b for word in ("clause", "part") for b, _ in reference_blocks(word)], ids=str)
def test_fragments_of_the_reference_are_read_without_an_error(block: Block) -> None:
    name, text = beside_garden(block)
    assert [str(one) for one in problems({name: text}, name) if one.code != "no-observation"] == []


@pytest.mark.parametrize(("block", "after"), reference_blocks("wrong"), ids=str)
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
