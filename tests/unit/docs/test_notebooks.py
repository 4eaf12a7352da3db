"""The notebooks of the site are executed as the site is built, and can be downloaded."""

from __future__ import annotations

import re
from pathlib import Path

import nbformat
import pytest
from notebook_pages import NotebookError, execute_notebook, page_text, parse_notebook

from tests.profile import AT_NIGHT

FOLDER = Path(__file__).parents[3] / "docs" / "notebooks"
NOTEBOOKS = {path.stem: path.read_text("utf-8") for path in sorted(FOLDER.glob("*.md")) if path.stem != "index"}
CELL = "# Title\n\nText with a [link](../other.md).\n\n```{code-cell}\n%s\n```\n"


def run(text: str) -> str:
    """Return the Markdown of the page of a notebook."""
    notebook = parse_notebook(text)
    execute_notebook(notebook)
    return page_text(text, notebook, "name")


def test_the_notebook_about_rules_shows_matches_and_reasons() -> None:
    page = run(NOTEBOOKS["rules"])
    assert "<td>&lt;Host#1 one&gt;</td><td>10</td>" in page and "then fails check(used &gt; host.memory)" in page
    assert page.count('<div class="cell-output">') == page.count("```ipython3") - 1, "`%load_ext` shows nothing"
    assert "{code-cell}" not in page and "<svg" in page


@AT_NIGHT
@pytest.mark.parametrize("name", sorted(NOTEBOOKS.keys() - {"rules"}))
def test_all_notebooks_run(name: str) -> None:
    page = run(NOTEBOOKS[name])
    assert '<a href="name.ipynb" download>' in page
    assert str(Path.home()) not in page and not re.search(r"/tmp/|object at 0x", page)


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_notebooks_to_download_are_valid_and_have_no_links_into_the_site(name: str) -> None:
    notebook = parse_notebook(NOTEBOOKS[name])
    nbformat.validate(notebook)
    assert len([cell for cell in notebook.cells if cell.cell_type == "code"]) >= 7
    assert ".md)" not in nbformat.writes(notebook)


def test_a_cell_that_fails_or_complains_stops_the_build() -> None:
    with pytest.raises(NotebookError, match="ZeroDivisionError"):
        run(CELL % "1 / 0")
    with pytest.raises(NotebookError, match="writes to standard error:\nbeware"):
        run(CELL % 'import sys; print("beware", file=sys.stderr)')


def test_outputs_are_escaped() -> None:
    page = run(CELL % 'print("<b> & more")\n"<i>"')
    assert "<pre>&lt;b&gt; &amp; more\n</pre>" in page and "<pre>&#x27;&lt;i&gt;&#x27;</pre>" in page
