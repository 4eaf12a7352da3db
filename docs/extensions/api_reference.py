"""The directive `api`, which documents the public names of a package from their docstrings: `{api} envgraph.graph`."""

from __future__ import annotations

import inspect
import re
from importlib import import_module
from inspect import cleandoc
from typing import TYPE_CHECKING, Any

from docutils import nodes
from public_names import PublicName, constant_text, documented_packages, exports_of, find_name, public_name
from sphinx.domains.python import PyObject
from sphinx.ext.autodoc.mock import mock
from sphinx.util.docutils import SphinxDirective

if TYPE_CHECKING:
    from sphinx.application import Sphinx

_CODE = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")
_LONGEST_VALUE = 60


class Api(SphinxDirective):
    """Documents the public names of a package in sections: classes, functions, exceptions, constants and types."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the sections."""
        package = self.arguments[0]
        names = sorted((public_name(package, name) for name in exports_of(package)), key=lambda one: one.name.lower())
        parts: dict[str, list[str]] = {}
        for one in names:
            heading, lines = _other_package(package, one) if one.package != package else _documentation(one)
            parts.setdefault(heading, []).extend(lines)
        first = self._parse([f".. py:module:: {package}", "   :no-typesetting:"])
        return [*first, *(self._section(heading, parts[heading]) for heading in _HEADINGS if heading in parts)]

    def _section(self, heading: str, lines: list[str]) -> nodes.section:
        section = nodes.section(ids=[nodes.make_id(heading)], names=[])
        section += nodes.title("", heading)
        section += self._parse(lines)
        return section

    def _parse(self, lines: list[str]) -> list[nodes.Node]:
        text = "\n".join(["~~~~~~{eval-rst}", *lines, "~~~~~~"])
        return self.parse_text_to_nodes(text, allow_section_headings=False)


_HEADINGS = ("Classes", "Functions", "Exceptions", "Constants and types", "Names from other packages")


def _documentation(one: PublicName) -> tuple[str, list[str]]:
    """Return the heading under which a name belongs, and the lines that document it."""
    value = one.value
    if isinstance(value, type):
        heading = "Exceptions" if issubclass(value, BaseException) else "Classes"
        kind = "autoexception" if heading == "Exceptions" else "autoclass"
        return heading, [f".. {kind}:: {one.path}", "   :members:", "   :inherited-members:", ""]
    if inspect.isroutine(value):
        return "Functions", [f".. autofunction:: {one.path}", ""]
    text, docstring = constant_text(one.module, one.name)
    lines = [f".. py:data:: {one.name}"]
    if text and len(text) <= _LONGEST_VALUE:
        lines.append(f"   :value: {text}")
    documented = [f"   {line}" for line in _as_rst(cleandoc(docstring).splitlines(), one.package)]
    return "Constants and types", [*lines, "", *documented, ""]


def _other_package(package: str, one: PublicName) -> tuple[str, list[str]]:
    """Return a line that leads from a name of a package to its documentation in another package."""
    summary = (inspect.getdoc(one.value) or "").partition("\n\n")[0].split("\n")
    return "Names from other packages", [
        f"- :py:obj:`{package}.{one.name} <{one.path}>`: {' '.join(_as_rst(summary, one.package))}"
    ]


def _as_rst(lines: list[str], package: str) -> list[str]:
    """Return the lines of a docstring with code in backquotes as links to public names or as literals."""

    def role(found: re.Match[str]) -> str:
        path = find_name(found[1], package)
        role = f":py:obj:`{found[1]} <{path}>`" if path else f"``{found[1]}``"
        return role + ("\\ " if found.string[found.end() : found.end() + 1].isalnum() else "")

    converted = []
    in_example = False
    for line in lines:
        in_example = bool(line.strip()) and (in_example or line.lstrip().startswith(">>>"))
        converted.append(line if in_example else _CODE.sub(role, line))
    return converted


def _package_of(path: str) -> str:
    """Return the documented package that a path such as `envgraph.graph.Model.create` begins with."""
    return max((one for one in documented_packages() if f"{path}.".startswith(f"{one}.")), key=len, default="envgraph")


def _process_docstring(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    lines[:] = _as_rst(lines, _package_of(name))


def _skip_member(app: Sphinx, what: str, name: str, obj: Any, skip: bool, options: Any) -> bool | None:
    """Skip members that are inherited from other packages, such as those of Gymnasium and of tuples."""
    function = getattr(obj, "fget", None) or getattr(obj, "func", None) or getattr(obj, "__func__", obj)
    module = getattr(function, "__module__", None) or getattr(getattr(function, "__objclass__", None), "__module__", "")
    return None if str(module).startswith("envgraph") else True


def _resolve(app: Sphinx, env: Any, node: Any, contnode: nodes.Node) -> nodes.Node | None:
    """Link a type in a signature to the page of its public name; types without a page stay without a link."""
    if node.get("refdomain") != "py":
        return None
    package = node.get("py:module") or "envgraph"
    path = find_name(node["reftarget"].rpartition(".")[2], package)
    domain = env.domains.python_domain
    link = domain.resolve_xref(env, node["refdoc"], app.builder, "obj", path, node, contnode) if path else None
    if link is not None and link.get("reftitle"):
        link["reftitle"] = path
    return link or contnode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive and the handlers of docstrings with Sphinx."""
    # Imported once with stand-ins for a package that the site does without; later imports find the module.
    with mock(["stable_baselines3"]):
        import_module("envgraph.sb3")
    app.setup_extension("sphinx.ext.autodoc")
    app.connect("autodoc-process-docstring", _process_docstring, priority=400)
    app.setup_extension("sphinx.ext.napoleon")
    app.connect("autodoc-skip-member", _skip_member, priority=400)
    app.connect("missing-reference", _resolve)
    for field in PyObject.doc_field_types:
        if field.name == "variable":
            field.label = "Attributes"
    app.add_directive("api", Api)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
