"""The API reference documents every public name once, and links words in docstrings to the right name."""

from __future__ import annotations

from importlib import import_module

import pytest
from public_names import PAGES, constant_text, documented_packages, exports_of, find_name, public_name

PACKAGES = [name for name in documented_packages() if name != "envgraph.sb3"]


def test_every_package_for_users_has_a_page_in_the_contents() -> None:
    assert {"envgraph", "envgraph.graph", "envgraph.env", "envgraph.search", "envgraph.sb3"} <= set(
        documented_packages()
    )
    contents = (PAGES / "index.md").read_text("utf-8")
    for package in documented_packages():
        assert f"\n{package}\n" in contents
        assert f"```{{api}} {package}\n" in (PAGES / f"{package}.md").read_text("utf-8")


@pytest.mark.parametrize("package", PACKAGES)
def test_the_names_of_a_page_are_those_that_the_package_exports(package: str) -> None:
    assert sorted(exports_of(package)) == import_module(package).__all__


def test_a_name_is_documented_where_it_is_defined() -> None:
    assert public_name("envgraph", "Model").path == "envgraph.graph.Model"
    assert public_name("envgraph.graph", "Model").path == "envgraph.graph.Model"


@pytest.mark.parametrize(
    ("text", "package", "path"),
    [
        ("Node", "envgraph.rewrite", "envgraph.graph.Node"),
        ("Model.create", "envgraph.rewrite", "envgraph.graph.Model.create"),
        ("envgraph.graph.Model", "envgraph.search", "envgraph.graph.Model"),
        ("Pattern", "envgraph.pattern", "envgraph.pattern.Pattern"),
        ("Pattern", "envgraph.lang", "envgraph.lang.Pattern"),
        ("check_conformance()", "envgraph.lang", "envgraph.graph.check_conformance"),
        ("Model.missing", "envgraph.graph", None),
        ("no_such_name", "envgraph.graph", None),
        ("x + 1", "envgraph.graph", None),
    ],
)
def test_words_of_docstrings_mean_public_names(text: str, package: str, path: str | None) -> None:
    assert find_name(text, package) == path


def test_constants_have_their_value_and_docstring() -> None:
    value, docstring = constant_text("envgraph.errors._input_limits", "MAX_ERRORS")
    assert value == "100"
    assert docstring
