"""Every exporter and every template over hostile names: what is made can be read and imported, and text stays text."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import envgraph
from envgraph.cli import main
from envgraph.cli._adopt_command import _candidate_templates
from envgraph.cli._new_command import write_domain
from envgraph.env import adopt
from envgraph.errors import InvalidArgument
from envgraph.lang import Bundle
from envgraph.search import Domain, Family
from envgraph.search.export import write_package, write_tables
from tests.campaigns import exporters
from tests.campaigns.exporters import CODE, FORMATS, NAMES, doors, exported, lake, named, of_texts, yard

UNNAMED = [name for name in NAMES if name in ("", "..", "\0") or name.startswith(("../", "/"))]
"""Names that arrays cannot have."""


def test_each_export_format_escapes_names(tmp_path: Path) -> None:
    possible = [name for name in NAMES if name not in UNNAMED]
    made = exported(yard(["".join(possible), *possible[:6], "\\", "class", "a" * 245]), tmp_path / "yard", FORMATS)
    assert made == {*FORMATS} - {"minigrid", "frozenlake"}
    assert exported(named(lake(), NAMES), tmp_path / "lake", ("frozenlake",))
    assert "minigrid" in exported(doors("".join(NAMES)), tmp_path / "doors", FORMATS)
    exporters.check(tmp_path)
    folders = [str(tmp_path / folder) for folder in ("yard", "doors")]
    subprocess.run([sys.executable, "-m", "tests.campaigns.exporters", *folders], check=True)
    assert not list(tmp_path.rglob("CANARY*"))


def test_user_templates_without_filters_escape_names(tmp_path: Path) -> None:
    exporters.own_templates(yard(["".join(NAMES), *NAMES]), tmp_path)
    exporters.check(tmp_path)


@pytest.mark.parametrize("name", ["".join(NAMES), "\\"])
def test_models_and_pictures_escape_names(name: str) -> None:
    exporters.read_models(yard([name, *NAMES]))


def test_adopted_domains_escape_names() -> None:
    kinds = {
        kind: words
        for id in ("FrozenLake-v1", "CliffWalking-v1")
        for kind, words in _candidate_templates(adopt(id, 0)[0])
    }
    for kind, words in kinds.items():
        assert of_texts(kind, {**words, "id": "".join(NAMES), "said": "".join(NAMES)}).members


def test_list_of_template_folders_is_complete() -> None:
    root = Path(envgraph.__file__).parent
    assert {path.parent.relative_to(root).as_posix() for path in root.rglob("*.j2")} == {
        *("cli/templates/new", "cli/templates/adopt/grid", "cli/templates/adopt/minigrid"),
        *("cli/templates/adopt/states", "report/templates", "search/export/minigrid"),
        *(f"search/export/templates{part}" for part in ("", "/src/{{package}}", "/tests")),
    }


def test_titles_of_imported_levels_stay_comments(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    titles = [name.replace("\n", " ") for name in NAMES]
    (tmp_path / "levels.xsb").write_bytes("".join(f"; {one}\n#####\n#@$.#\n#####\n" for one in titles).encode())
    words = ["envgraph", "import", str(tmp_path / "levels.xsb"), "-o", str(tmp_path / "out")]
    monkeypatch.setattr(sys, "argv", words)
    assert main() == 0  # it reads what it has written
    models = "".join(path.read_text("utf-8") for path in (tmp_path / "out").glob("levels*.model"))
    assert "CANARY" in models
    exporters.check_text(models)


@pytest.mark.parametrize("name", UNNAMED)
def test_names_that_are_invalid_for_arrays_are_refused(name: str) -> None:
    family = lake()
    with pytest.raises(InvalidArgument, match="is not a valid array name; rename the member"):
        write_tables({name: family.explored(family.members[0]).tabular})


@pytest.mark.parametrize("name", ["class", "é", "_yard", "yard_", "my-yard", "a b", CODE])
def test_folders_that_are_invalid_package_names_are_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidArgument, match="cannot be imported as a package"):
        write_package(lake(), tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_environment_name_that_is_no_python_class_name_is_refused(tmp_path: Path) -> None:
    family = lake()
    given = family.bundle.texts.items()
    texts = {name: text.replace("environment Adopted(", "environment Half½(") for name, text in given}
    domain = Domain.from_bundle(Bundle(("family.toml",), texts))
    odd = Family("lake", domain.workspace.bundle(), family.members, domain)
    with pytest.raises(InvalidArgument, match="is not a valid name of a Python class"):
        write_package(odd, tmp_path / "lake")


@pytest.mark.parametrize("name", [f"L{{{CODE}}}", "My levels (v2)", "", "a\n"])
def test_names_that_are_invalid_in_an_environment_id_are_refused(name: str, tmp_path: Path) -> None:
    for family in (named(doors(), [name]), named(doors(), ["Doors", name])):
        assert not exported(family, tmp_path / "doors", ("minigrid",))
    assert not (tmp_path / "doors/minigrid").exists()


@pytest.mark.parametrize("name", NAMES)
def test_invalid_names_of_new_domains_are_refused(name: str, tmp_path: Path) -> None:
    if name not in ("class", "a" * 245):
        with pytest.raises(InvalidArgument, match="cannot be the name of a domain"):
            write_domain(tmp_path, name)
