"""The committed pictures are those that the scripts in `docs/pictures` make."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import given, strategies as st

from docs.pictures import gallery, models
from docs.pictures.drawing import sheet
from envgraph.draw import SvgFrame, film
from envgraph.draw._svg_film import merge_elements, svg_elements
from tests.profile import AT_NIGHT

PICTURES = sorted(gallery.PAGES.glob("pictures/*.svg"))
SMALL = '<svg viewBox="0 0 1 1" width="32" height="32">\n<title>a</title>\n{}\n</svg>'


def committed(name: str) -> str:
    return (gallery.PAGES / "pictures" / name).read_text("utf-8")


@pytest.mark.parametrize("domain", ["burning_forest", "keydoor"])
def test_committed_episodes_are_what_the_script_makes(domain: str) -> None:
    made = gallery.episode_pictures(domain)
    assert set(made) == {f"{domain}.svg", f"{domain}-episode.svg"}
    assert [name for name, text in made.items() if text != committed(name)] == [], "run `make pictures`"


def test_committed_pictures_of_queries_are_what_the_script_makes() -> None:
    made = {**models.railway_pictures(), **models.social_media_pictures()}
    assert [name for name, text in made.items() if text != committed(name)] == [], "run `make pictures`"


@AT_NIGHT
@pytest.mark.parametrize("domain", ["burning_forest", "keydoor", "network"])
def test_committed_families_are_what_the_script_makes(
    domain: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gallery, "CACHE", tmp_path)
    family = gallery.family_of(domain)
    assert gallery.family_picture(domain, family) == {f"{domain}-family.svg": committed(f"{domain}-family.svg")}
    page = (gallery.PAGES / f"{domain}.md").read_text("utf-8")
    assert gallery.with_table(page, gallery.family_table(family)) == page


@pytest.mark.parametrize(("members", "places"), [(3, [0, 1, 2]), (4, [0, 1, 2, 3]), (13, [0, 4, 8, 12])])
def test_a_table_of_a_family_has_at_most_four_members_with_the_first_and_the_last(
    members: int, places: list[int]
) -> None:
    assert gallery.shown_places(members) == places


@pytest.mark.parametrize("path", PICTURES, ids=lambda path: path.stem)
def test_pictures_are_small_have_a_title_and_are_on_a_page(path: Path) -> None:
    text = path.read_text("utf-8")
    assert len(text) < 60_000
    root = ElementTree.fromstring(text)
    assert root.get("aria-label") == root.findtext("{http://www.w3.org/2000/svg}title")
    pages = "".join(page.read_text("utf-8") for page in gallery.PAGES.glob("*.md"))
    assert re.search(rf"!\[[^]]{{15,}}\]\(pictures/{path.name}\)", pages), "a page shows it, with words in its place"


@given(st.lists(st.lists(st.sampled_from("abcdef"), unique=True), min_size=1))
def test_groups_of_merged_pictures_are_the_elements_of_each_picture(pictures: list[list[str]]) -> None:
    groups = merge_elements(pictures)
    for number, elements in enumerate(pictures):
        assert [one for group in groups if number in group.pictures for one in group.elements] == elements


def test_an_animation_begins_with_the_first_frame_and_shows_each_frame_in_its_time() -> None:
    frames = [SvgFrame(SMALL.format(f'<g>{place}</g>\n<circle r="1"/>'), f"frame {place}") for place in "abc"]
    text = film(frames, "three frames")
    rules = dict(re.findall(r"@keyframes (\w+)\{(.*?)\}\.", text))
    shown = {}
    for name, attributes, inside in re.findall(r'<g class="(\w+)"( visibility="hidden")?>\n<g>(\w)</g>', text):
        turns = re.findall(r"([\d.]+)%\{visibility:(\w+)\}", rules[name])
        shown[inside] = (bool(attributes), turns)
    assert shown == {  # two frames of one step, and the last one of four
        "a": (False, [("16.67", "hidden")]),
        "b": (True, [("16.67", "visible"), ("33.33", "hidden")]),
        "c": (True, [("33.33", "visible")]),
    }
    assert "prefers-reduced-motion:no-preference" in text
    assert text.count('<circle r="1"/>') == 1, "what frames share is written once"


def test_pictures_side_by_side_share_elements_of_several_lines() -> None:
    same = '<g stroke="red">\n<title>b</title></g>'
    assert svg_elements(SMALL.format(same)) == [same]
    text = sheet([(SMALL.format(same), "one"), (SMALL.format(same + "\n<b/>"), "two")], "two pictures")
    assert text.count(same) == 1 and text.count('<use href="#g0"/>') == 2 and text.count("<b/>") == 1
