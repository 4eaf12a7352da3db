"""The committed pictures of tutorials are drawn from the files that the tutorials show."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from docs.pictures import clinic, modelling
from docs.pictures.tutorial_files import TUTORIALS


@pytest.mark.parametrize(
    ("page", "draw"), [("modelling", modelling.pictures), ("clinic", clinic.pictures)], ids=["modelling", "clinic"]
)
def test_the_pictures_of_a_tutorial_are_current_small_and_shown(page: str, draw: Callable[[], dict[str, str]]) -> None:
    text = (TUTORIALS / f"{page}.md").read_text("utf-8")
    made = draw()
    assert {*made} == {path.name for path in TUTORIALS.glob(f"{page}-*.svg")}
    for name, picture in made.items():
        assert f"]({name})" in text
        assert len(picture) < 60_000
        assert picture == (TUTORIALS / name).read_text("utf-8"), f"run python -m docs.pictures.{page}"
