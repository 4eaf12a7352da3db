"""Cells in envgraph's languages: they are checked together, and mistakes are shown without a traceback."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from IPython.core.displaypub import CapturingDisplayPublisher
from IPython.core.interactiveshell import InteractiveShell
from traitlets.config import Config

import envgraph
from envgraph.lang import Workspace

METAMODEL = "%%metamodel\nmetamodel shop\nclass Shop { contains Thing[*] things }\nclass Thing { int size }\n"
QUERY = "%%query\npattern large(thing : Thing) { Thing.size(thing, n); check(n > 3); }\n"
RULES = "%%rules\nrule shrink(thing : Thing) { lhs { find large(thing); } modify { set thing.size = 1; } }\n"
MODEL = "%%model\nmodel shop : shop { shop : Shop { things = [Thing { size = 5 }, Thing { size = 2 }] } }\n"


class Notebook:
    """A shell without a screen that runs cells one after the other."""

    def __init__(self, folder: Path) -> None:
        self.shell = InteractiveShell(
            config=Config(HistoryManager={"enabled": False}), ipython_dir=str(folder / "ipython")
        )
        self.shell.display_pub = self.shown = CapturingDisplayPublisher(parent=self.shell)
        self.shell.run_cell("%load_ext envgraph.notebook").raise_error()

    def run(self, cell: str) -> str:
        """Run a cell that has no errors, and return what it shows."""
        self.shell.run_cell(cell).raise_error()
        outputs: list[dict[str, Any]] = self.shown.outputs
        texts = [one["data"]["text/plain"] for one in outputs]
        assert all(one["data"]["text/html"].startswith("<pre>") for one in outputs)
        outputs.clear()
        return "\n".join(texts)

    def value(self, expression: str) -> Any:
        """Return the value of a cell."""
        return self.shell.run_cell(expression).result


@pytest.fixture
def notebook(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Notebook:
    monkeypatch.chdir(tmp_path)
    return Notebook(tmp_path)


def test_cells_are_checked_together_and_make_an_engine(notebook: Notebook) -> None:
    assert notebook.run(METAMODEL) == "notebook.metamodel has no problems"
    for cell in (QUERY, RULES, MODEL):
        assert notebook.run(cell).endswith("has no problems")
    workspace = notebook.value("%envgraph")
    assert isinstance(workspace, Workspace)
    engine = workspace.engine()
    assert engine.count("large") == 1 and engine.apply("shrink") and engine.count("large") == 0


def test_a_mistake_stops_the_notebook_and_is_shown_with_its_place(
    notebook: Notebook, capsys: pytest.CaptureFixture[str]
) -> None:
    notebook.run(METAMODEL)
    assert isinstance(notebook.shell.run_cell(QUERY.replace("size", "sise")).error_in_exec, envgraph.LoadError)
    shown = capsys.readouterr().out
    assert shown.startswith("notebook.query:1:38: `Thing` has no feature `sise`\n 1 | pattern large")
    assert "did you mean `size`" in shown and "Traceback" not in shown and ".py" not in shown
    assert notebook.run(QUERY).endswith("no problems"), "the corrected cell takes the place of the wrong one"


def test_a_change_that_makes_other_cells_wrong_names_them(notebook: Notebook) -> None:
    notebook.run(METAMODEL)
    notebook.run(QUERY)
    shown = notebook.run(METAMODEL.replace("size", "weight"))
    assert "these cells have errors now" in shown and "notebook.query:1:38" in shown
    assert notebook.run(QUERY.replace("Thing.size", "Thing.weight")).endswith("has no problems")


def test_warnings_are_shown(notebook: Notebook) -> None:
    notebook.run(METAMODEL)
    shown = notebook.run("%%query\npattern all(a : Thing, b : Thing) { Thing(a); Thing(b); }\n")
    assert shown.startswith("notebook.query has no errors\n\nnotebook.query:1:9: warning:")


def test_cells_with_names_are_files_that_can_be_saved(notebook: Notebook, tmp_path: Path) -> None:
    (tmp_path / "shop.metamodel").write_text(METAMODEL.partition("\n")[2], "utf-8")
    notebook.run(QUERY.replace("%%query\n", '%%query sizes\nimport "shop.metamodel"\n'))
    notebook.run(RULES.replace("%%rules\n", '%%rules\nimport "sizes.query"\n'))
    assert notebook.run("%envgraph save out") == "wrote out/sizes.query\nwrote out/notebook.rules"
    (tmp_path / "out" / "shop.metamodel").write_text(METAMODEL.partition("\n")[2], "utf-8")
    assert envgraph.open("out/notebook.rules").rules == ("shrink",)
    notebook.run("%envgraph forget notebook.rules")
    assert notebook.value("%envgraph").rules == ()


def test_environments_in_wrappers_are_shown(notebook: Notebook) -> None:
    environment = envgraph.make(domain="burning_forest", render_mode="ansi")
    environment.reset(seed=0)
    assert notebook.shell.display_formatter is not None
    data, _ = notebook.shell.display_formatter.format(environment)
    assert "<th>actions</th><td>left, down, right, up" in data["text/html"] and "<svg" in data["text/html"]


def test_a_family_cell_is_checked_with_the_cells_that_it_names(
    notebook: Notebook, capsys: pytest.CaptureFixture[str]
) -> None:
    notebook.run(METAMODEL)
    notebook.run(MODEL)
    notebook.shell.run_cell('%%family\nname = "Shops"\nmodel = "notebok.model"\n')
    assert "family.toml:2:9: `notebok.model`: there is no such file" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("cell", "message"),
    [
        ("%envgraph save", "`%envgraph save` does not exist: write `%envgraph`, `%envgraph save FOLDER`"),
        ("%envgraph forget x.query", "no cell has defined `x.query`"),
        ("%envgraph save 'a", "No closing quotation"),
        ("%%query ../up\npattern", "`../up` cannot name a text"),
    ],
)
def test_wrong_use_of_magics_is_explained(
    notebook: Notebook, capsys: pytest.CaptureFixture[str], cell: str, message: str
) -> None:
    notebook.shell.run_cell(cell)
    told = capsys.readouterr()
    assert f"UsageError: {message}" in told.err and "Traceback" not in told.err + told.out
