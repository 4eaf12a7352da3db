"""What people see of families: pictures with captions, in files, on terminals and in notebooks."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree

import pytest

from envgraph.search import Family, family_svg, generate
from tests.unit.cli.test_street import write_street

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Family:
    """The family of README, which says nothing about drawing."""
    place = tmp_path_factory.mktemp("street")
    return generate(write_street(place), place / "run.sqlite", generations=3)


def test_family_without_a_drawing_is_shown_as_object_boxes(street: Family) -> None:
    assert street.scene(street.members[0]) is None
    for member in street.members:
        boxes = [part.text for part in ElementTree.fromstring(street.svg(member)).iter(f"{SVG}text")]
        assert boxes.count("main : Street") == 1
        lit = sum((text or "").startswith("Lit#") for text in boxes)
        assert lit == member.measures["light"] == street.text(member).count("│ Lit#")


def test_captions_are_shortened_and_show_counts_without_decimals(street: Family) -> None:
    long = replace(
        street.members[0], name="a street that is lit from its one end to the other", measures={"light": 2.0}
    )
    family = replace(street, members=(long, *street.members[1:]))
    root = ElementTree.fromstring(family_svg(family))
    captions = [part for part in root if part.tag == f"{SVG}text"]
    assert "light 2" in [part.text for part in captions]
    assert not [part.text for part in captions if "." in (part.text or "")]
    assert max(len(part.text or "") for part in captions) <= 27
    assert captions[0][0].text == long.name  # in full, under the mouse
    places = [(part.get("x"), part.get("y")) for part in captions]
    assert len(set(places)) == len(places) == 2 * len(family.members)


def test_notebooks_show_the_pictures_of_a_family_and_its_members(street: Family) -> None:
    html = street._repr_html_()
    assert html.count("<figure") == html.count("<svg") == len(street.members)
    shown = street.members[0]._repr_html_()
    assert shown is not None and shown in html
    assert replace(street.members[0], _family=None)._repr_html_() is None
