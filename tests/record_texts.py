"""Record the texts that tests generate, to compare them before and after a change that must not alter them.

`pytest -p tests.record_texts --texts DIR -n0 ..` writes one file with all live texts, programs and refusals of each
test. `python -m tests.record_texts BEFORE AFTER` compares two such directories up to the names of functions and local
variables, prints the first difference of each test, and exits with 1 if there is any. `--limit N` prints more.
"""

from __future__ import annotations

import argparse
import ast
import difflib
import json
import sys
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest

from envgraph import code
from envgraph.code import _compile_text
from envgraph.env.compiled.layout._not_compiled import NotCompiled
from envgraph.env.compiled.programs import _compiled_program


class TextRecorder:
    """A plug-in of pytest that writes the texts of each test to a file named after the test."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._texts: dict[str, None] = {}
        folder.mkdir(parents=True, exist_ok=True)
        compiling: Any = _compile_text
        emitting: Any = _compiled_program
        self._compile, self._emit = compiling.compile_cached, emitting.emit_program
        compiling.compile_cached, emitting.emit_program = self._record_live_text, self._record_program

    def _record_live_text(self, text: str, file: str) -> Any:
        if not file.startswith(("<data class", "<program", "programs")):  # programs: see `_record_program`
            self._texts[text] = None
        return self._compile(text, file)

    def _record_program(self, *arguments: Any) -> Any:
        try:
            made = self._emit(*arguments)
        except NotCompiled as refusal:
            self._texts[f"# refused: {refusal.construct} at {refusal.span}"] = None
            raise
        columns = [repr(column) for column, _ in made.layout.stored_columns()]
        facts = "\n".join(f"# {line}" for line in (made.levels, made.width, made.action_names, *columns))
        self._texts[f"{facts}\n{code.print_source(made.functions).text}"] = None
        return made

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self._texts.clear()
        yield
        if self._texts:
            name = sha256(item.nodeid.encode()).hexdigest()[:24]
            record = {"test": item.nodeid, "texts": [*self._texts]}
            (self._folder / f"{name}.json").write_text(json.dumps(record, indent=0))


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--texts", type=Path, help="write the generated texts of each test to this directory")


def pytest_configure(config: pytest.Config) -> None:
    folder = config.getoption("--texts")
    if folder is not None:
        config.pluginmanager.register(TextRecorder(folder))


class _Renamer(ast.NodeTransformer):
    """A renamer of functions and local variables by the order in which they first appear."""

    def __init__(self, tree: ast.Module) -> None:
        self._functions = {one.name: f"function{place}" for place, one in enumerate(_functions_of(tree))}
        self._locals: dict[str, str] = {}

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        node.name = self._functions[node.name]
        outer = self._locals
        assigned = [one.id for one in ast.walk(node) if isinstance(one, ast.Name) and isinstance(one.ctx, ast.Store)]
        names = dict.fromkeys([*(one.arg for one in node.args.args), *assigned])
        self._locals = {**outer, **{name: f"local{place}" for place, name in enumerate(names, len(outer))}}
        self.generic_visit(node)
        self._locals = outer
        return node

    def visit_Name(self, node: ast.Name) -> ast.AST:
        node.id = self._locals.get(node.id) or self._functions.get(node.id, node.id)
        return node

    def visit_arg(self, node: ast.arg) -> ast.AST:
        node.arg = self._locals[node.arg]
        return node


def _functions_of(tree: ast.Module) -> Iterator[ast.FunctionDef]:
    return (one for one in ast.walk(tree) if isinstance(one, ast.FunctionDef))


def renamed(text: str) -> str:
    """Return a text whose functions and local variables have names by their order; its comments stay."""
    comments = [line for line in text.splitlines() if line.startswith("# ")]
    tree = ast.parse(text)
    return "\n".join([*comments, ast.unparse(_Renamer(tree).visit(tree))])


def compare(before: Path, after: Path, limit: int) -> int:
    """Print how the recorded texts differ, and return the number of tests that differ."""
    records = [
        {(record := json.loads(path.read_text()))["test"]: record["texts"] for path in folder.glob("*.json")}
        for folder in (before, after)
    ]
    different = 0
    for test in sorted({*records[0], *records[1]}):
        old, new = (record.get(test, []) for record in records)
        if old == new:
            continue
        old, new = (sorted(map(renamed, texts)) for texts in (old, new))
        if old == new:
            continue
        different += 1
        if different <= limit:
            print(f"=== {test}: {len(old)} texts before, {len(new)} after")
            gone = "\n".join(text for text in old if text not in new).splitlines()
            added = "\n".join(text for text in new if text not in old).splitlines()
            print("\n".join(difflib.unified_diff(gone, added, "before", "after", lineterm="")))
    print(f"{len(records[0])} tests before, {len(records[1])} after, {different} differ")
    return different


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("--limit", type=int, default=3)
    given = parser.parse_args()
    sys.exit(compare(given.before, given.after, given.limit) > 0)
