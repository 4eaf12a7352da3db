"""What the picture and the words of docs/architecture.md say of the packages is so."""

from __future__ import annotations

import ast
import re
import runpy
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path

import networkx as nx

from envgraph.graph import Model
from envgraph.metamodel import Metamodel
from envgraph.rewrite import Engine

ROOT = Path(__file__).parents[2]


def test_the_package_picture_agrees_with_the_import_contract() -> None:
    drawn = runpy.run_path(str(ROOT / "docs" / "rooms.py"))["picture"]()
    assert drawn == (ROOT / "docs" / "rooms.svg").read_text("utf-8"), "run python docs/rooms.py"


@cache
def syntax_tree(path: Path) -> ast.Module:
    """Return the syntax tree of a module."""
    return ast.parse(path.read_text("utf-8"))


def imports(tree: ast.AST) -> Iterator[ast.ImportFrom]:
    """Those anywhere in a module, but for what annotations alone need."""
    for child in ast.iter_child_nodes(tree):
        if isinstance(child, ast.ImportFrom):
            yield child
        elif not (isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"):
            yield from imports(child)


def test_modules_have_no_cyclic_imports() -> None:
    """A name of a package counts as an import of the module that has it, which is loaded when the name is used."""
    trees = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): syntax_tree(path)
        for path in sorted((ROOT / "envgraph").rglob("*.py"))
    }
    homes = {
        f"{package}.{alias.name}": f"{each.module}.{alias.name}"
        for package, tree in trees.items()
        for each in ast.walk(tree)
        if isinstance(each, ast.ImportFrom)
        for alias in each.names
        if alias.asname == alias.name
    }
    assert homes["envgraph.make"] == "envgraph.search.make"
    graph = nx.DiGraph()
    for module, tree in trees.items():
        for each in imports(tree):
            for name in (f"{each.module}.{alias.name}" for alias in each.names if each.module in trees):
                while name in homes:
                    graph.add_edge(module, name.rpartition(".")[0])
                    name = homes[name]
                graph.add_edge(module, name if name in trees else name.rpartition(".")[0])
    assert graph.number_of_edges() > 1000
    circles = [circle for circle in nx.strongly_connected_components(graph) if len(circle) > 1]
    assert circles == []


def test_exported_names_are_imported_or_documented() -> None:
    """Classes aside: their objects show the package that exports them as their place."""
    used: set[str] = set()
    for path in (path for room in ("envgraph", "tests", "benchmarks") for path in sorted((ROOT / room).rglob("*.py"))):
        for each in ast.walk(syntax_tree(path)):
            if isinstance(each, ast.ImportFrom):
                used.update(f"{each.module}.{alias.name}" for alias in each.names)
            elif isinstance(each, ast.Attribute) and isinstance(each.value, ast.Name):
                used.add(f"envgraph.{each.value.id}.{each.attr}")
    pages = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]
    words = set(re.findall(r"\w+", "".join(page.read_text("utf-8") for page in pages)))
    unused = []
    for path in sorted((ROOT / "envgraph").rglob("__init__.py")):
        package = import_module(".".join(path.parent.relative_to(ROOT).parts))
        names = [name for name in getattr(package, "__all__", ()) if not isinstance(getattr(package, name), type)]
        unused += [f"{package.__name__}.{n}" for n in names if f"{package.__name__}.{n}" not in used and n not in words]
    assert unused == []


def test_public_members_of_models_and_engines_are_documented() -> None:
    """All else belongs to one of their parts."""
    pages = [one for one in sorted((ROOT / "docs").rglob("*.md")) if "architecture" not in str(one.relative_to(ROOT))]
    text = "".join(one.read_text("utf-8") for one in (*pages, ROOT / "README.md"))
    told = set(re.findall(r"[.`](\w+)", text))
    engine = Engine(Model(Metamodel("m", ())))
    offered = {f"{type(one).__name__}.{name}": name for one in (engine, engine.model) for name in dir(one)}
    assert len(offered) > 80
    assert {key for key, name in offered.items() if name[0] != "_" and name not in told} == set()


MOST_METHODS = 30
"""More are a sign of a second idea, which gets an object or functions of its own."""


def test_classes_have_few_methods() -> None:
    """Properties and private ones included; what a class takes from a module or a part counts where it is written."""
    found = {}
    for path in sorted((ROOT / "envgraph").rglob("*.py")):
        for each in ast.walk(syntax_tree(path)):
            if isinstance(each, ast.ClassDef):
                methods = {inner.name for inner in each.body if isinstance(inner, ast.FunctionDef)}
                if len(methods) > MOST_METHODS:
                    found[each.name] = len(methods)
    assert found == {}
