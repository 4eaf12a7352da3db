"""Find the public names of the packages, where each is documented, and which name a word in a docstring means."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

PAGES = Path(__file__).parents[1] / "reference" / "api"


@dataclass(frozen=True, slots=True)
class PublicName:
    """A public name.

    Attributes:
        package, name: the package that documents the name, and the name.
        module: the module that defines it.
    """

    package: str
    name: str
    module: str

    @property
    def path(self) -> str:
        """Return the name with its package."""
        return f"{self.package}.{self.name}"

    @property
    def value(self) -> Any:
        """Return what the name stands for."""
        return getattr(import_module(self.module), self.name)


@cache
def documented_packages() -> tuple[str, ...]:
    """Return the packages that have a page, parents first."""
    return tuple(sorted(path.stem for path in PAGES.glob("envgraph*.md")))


@cache
def exports_of(package: str) -> dict[str, str]:
    """Return the public names of a package: for each, the module that the package imports it from."""
    specification = find_spec(package)
    path = Path(str(specification.origin if specification else None))
    tree = ast.parse(path.read_text(encoding="utf-8"))
    if path.name != "__init__.py":
        kinds = (ast.FunctionDef, ast.ClassDef)
        return {one.name: package for one in tree.body if isinstance(one, kinds) and not one.name.startswith("_")}
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    return {one.name: str(node.module) for node in imports for one in node.names if one.asname == one.name}


def public_name(package: str, name: str) -> PublicName:
    """Return a public name of a package. If the package has it from another documented package, that one counts."""
    module = exports_of(package)[name]
    if module != package and module in documented_packages():
        return public_name(module, name)
    return PublicName(package, name, module)


def find_name(text: str, package: str) -> str | None:
    """Return the documented path that a text such as `Model` or `graph.Model.create` means inside a package.

    Return None if the text means no documented name, or could mean several.
    """
    words = text.removesuffix("()").split(".")
    for index, word in enumerate(words):
        prefix = ".".join(words[:index])
        named = [one for one in documented_packages() if f".{one}".endswith(f".{prefix}")] if prefix else []
        for packages in [named] if prefix else [[package], documented_packages()]:
            homes = {public_name(one, word) for one in packages if word in exports_of(one)}
            if len(homes) == 1:
                return _member_path(homes.pop(), words[index + 1 :])
    return None


def _member_path(home: PublicName, members: list[str]) -> str | None:
    """Return the path of a name or of its documented member; None if it has no such member."""
    if not members:
        return home.path
    member = getattr(home.value, members[0], None) if len(members) == 1 and isinstance(home.value, type) else None
    return f"{home.path}.{members[0]}" if getattr(member, "__doc__", None) and not members[0].startswith("_") else None


def constant_text(module: str, name: str) -> tuple[str, str]:
    """Return the text of a constant's value and its docstring, from the source of the module that defines it."""
    body = ast.parse(Path(str(import_module(module).__file__)).read_text(encoding="utf-8")).body
    for statement, after in zip(body, [*body[1:], None], strict=True):
        targets = statement.targets if isinstance(statement, ast.Assign) else [getattr(statement, "target", None)]
        if name not in [getattr(target, "id", None) for target in targets]:
            continue
        value = getattr(statement, "value", None)
        docstring = after.value if isinstance(after, ast.Expr) else None
        return (
            ast.unparse(value) if value else "",
            str(docstring.value) if isinstance(docstring, ast.Constant) else "",
        )
    return "", ""
