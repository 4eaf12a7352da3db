"""Print texts drawn at random for a reader who has not seen the project: docstrings, messages, names.

`python -m tests.sample_prose --seed 7` prints 100 docstrings with their signatures, 50 messages and 50 names. The
reader writes down what each of them says and then compares that with the code. `--where` adds file and line.
"""

from __future__ import annotations

import argparse
import ast
import random
import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
Definition = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef

_REPORTING = re.compile(r"error|warn|note|hint|report|message|refuse|fail|complain|print|progress|Diagnostic|Argument")
"""Calls whose strings are read by users."""


@dataclass(frozen=True)
class Sample:
    """A text, the definition that it belongs to, and its file and line."""

    text: str
    owner: str
    place: str

    def shown(self, number: int, with_place: bool) -> str:
        place = f"   [{self.place}]" if with_place else ""
        return f"{number}. {self.owner}{place}\n{textwrap.indent(self.text, '    ')}\n"


def modules() -> Iterator[tuple[Path, ast.Module]]:
    """Yield all modules of the package with their syntax trees, in the order of their paths."""
    for path in sorted((ROOT / "envgraph").rglob("*.py")):
        yield path, ast.parse(path.read_text("utf-8"))


def definitions(tree: ast.AST, prefix: str = "") -> Iterator[tuple[str, Definition]]:
    """Yield functions and classes with their qualified names, in the order of the file."""
    for child in ast.iter_child_nodes(tree):
        if isinstance(child, Definition):
            yield prefix + child.name, child
            yield from definitions(child, f"{prefix}{child.name}.")
        else:
            yield from definitions(child, prefix)


def signature(node: Definition) -> str:
    """Return the line that defines a function or class."""
    if isinstance(node, ast.ClassDef):
        bases = ", ".join(ast.unparse(base) for base in node.bases)
        return f"class {node.name}({bases})" if bases else f"class {node.name}"
    returns = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    return f"def {node.name}({ast.unparse(node.args)}){returns}"


def _module(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def _scope(path: Path, name: str) -> str:
    """Return the module, and the class or function in which a definition is."""
    return f"{_module(path)}: {name.rpartition('.')[0]}".removesuffix(": ")


def _defined(node: Definition) -> str:
    """Return the decorators and the signature of a definition."""
    return "".join(f"@{ast.unparse(each)}\n" for each in node.decorator_list) + signature(node)


def _place(path: Path, node: ast.AST) -> str:
    return f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 1)}"


def docstrings() -> list[Sample]:
    """Return the docstrings of all modules, classes and functions."""
    found = []
    for path, tree in modules():
        if text := ast.get_docstring(tree):
            found.append(Sample(text, f"module {_module(path)}", _place(path, tree)))
        for name, node in definitions(tree):
            if text := ast.get_docstring(node):
                owner = f"{_scope(path, name)}\n{_defined(node)}"
                found.append(Sample(text, owner, _place(path, node)))
    return found


def names() -> list[Sample]:
    """Return the names of all functions and classes whose names are not fixed by Python, with their signatures."""
    return [
        Sample(_defined(node), _scope(path, name), _place(path, node))
        for path, tree in modules()
        for name, node in definitions(tree)
        if not node.name.startswith("__")
    ]


def _text(node: ast.expr) -> str:
    """Return the text of a string, with the expressions of an f-string in braces; an empty one for others."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(
            part.value if isinstance(part, ast.Constant) else ast.unparse(ast.JoinedStr([part]))[2:-1]
            for part in node.values
        )
    return ""


def _spoken(node: ast.AST) -> list[ast.expr]:
    """Return the expressions of a call or assignment that users read."""
    if isinstance(node, ast.Call) and _REPORTING.search(ast.unparse(node.func)):
        return [*node.args, *(each.value for each in node.keywords)]
    if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) in ("message", "hint", "problem"):
        return [node.value]
    if isinstance(node, ast.keyword) and node.arg in ("help", "message", "hint"):
        return [node.value]
    return []


def messages() -> list[Sample]:
    """Return what is raised, reported or assigned to a message or hint; the strings of one call are one message."""
    found: dict[str, Sample] = {}
    for path, tree in modules():
        for name, node in definitions(tree):
            for child in ast.walk(node):
                texts = [text for part in _spoken(child) if (text := _text(part)) and " " in text]
                if any(len(re.findall(r"[A-Za-z]{2,}", re.sub(r"\{[^}]*\}", "", text))) >= 4 for text in texts):
                    place = _place(path, child)
                    found[place] = Sample("\n".join(texts), f"{_module(path)}: {name}", place)
    return [found[place] for place in sorted(found)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--where", action="store_true", help="add the file and line of each text")
    chosen = parser.parse_args()
    generator = random.Random(chosen.seed)
    number = 0
    for title, samples, count in (
        ("Docstrings", docstrings(), 100),
        ("Messages", messages(), 50),
        ("Names", names(), 50),
    ):
        print(f"# {title}: {count} of {len(samples)}\n")
        for sample in generator.sample(samples, count):
            number += 1
            print(sample.shown(number, chosen.where))


if __name__ == "__main__":
    main()
