"""Every exporter and every template over hostile names: what is made can be read and imported, and text stays text."""

from __future__ import annotations

from pathlib import Path

import pytest

from envgraph.cli._new import write_domain
from envgraph.errors import InvalidArgument
from envgraph.lang import Bundle
from envgraph.search import Domain, Family
from envgraph.search.export import write_package, write_tables
from tests.campaigns.exporters import CODE, NAMES, doors, exported, lake, named

UNNAMED = [name for name in NAMES if name in ("", "..", "\0") or name.startswith(("../", "/"))]
"""Names that arrays cannot have."""


@pytest.mark.parametrize("name", UNNAMED)
def test_names_that_arrays_cannot_have_are_refused(name: str) -> None:
    family = lake()
    with pytest.raises(InvalidArgument, match="cannot name arrays; rename the member in the family file"):
        write_tables({name: family.explored(family.members[0]).tabular})


@pytest.mark.parametrize("name", ["class", "é", "_yard", "yard_", "my-yard", "a b", CODE])
def test_folders_that_are_no_names_of_packages_are_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidArgument, match="cannot be imported as a package"):
        write_package(lake(), tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_an_environment_that_cannot_be_a_class_is_refused(tmp_path: Path) -> None:
    family = lake()
    given = family.bundle.texts.items()
    texts = {name: text.replace("environment Adopted(", "environment Half½(") for name, text in given}
    domain = Domain.from_bundle(Bundle(("family.toml",), texts))
    odd = Family("lake", domain.workspace.bundle(), family.members, domain)
    with pytest.raises(InvalidArgument, match="cannot be a class of Python"):
        write_package(odd, tmp_path / "lake")


@pytest.mark.parametrize("name", [f"L{{{CODE}}}", "My levels (v2)", "", "a\n"])
def test_names_that_cannot_be_in_an_id_are_refused(name: str, tmp_path: Path) -> None:
    for family in (named(doors(), [name]), named(doors(), ["Doors", name])):
        assert not exported(family, tmp_path / "doors", ("minigrid",))
    assert not (tmp_path / "doors/minigrid").exists()


@pytest.mark.parametrize("name", NAMES)
def test_new_domains_have_plain_names(name: str, tmp_path: Path) -> None:
    if name not in ("class", "a" * 245):
        with pytest.raises(InvalidArgument, match="cannot name a domain"):
            write_domain(tmp_path, name)
