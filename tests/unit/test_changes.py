"""Each change that is not released yet is one sentence and a sample, in a file of its own."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_change_files_have_a_known_kind_a_sentence_and_a_sample() -> None:
    with (ROOT / "pyproject.toml").open("rb") as file:
        settings = tomllib.load(file)["tool"]["towncrier"]
    kinds = "|".join(kind["directory"] for kind in settings["type"])
    for path in sorted((ROOT / settings["directory"]).glob("*")):
        if path.name not in settings["ignore"]:
            assert re.fullmatch(rf"[a-z0-9-]+\.({kinds})\.md", path.name), path.name
            sentence, _, sample = path.read_text("utf-8").partition("\n\n")
            assert sentence[0] not in "-#" and sentence.rstrip()[-1] in ".:", path.name
            assert re.search(r"^    \S", sample, re.MULTILINE), path.name


def test_the_newest_release_has_the_version_of_the_package() -> None:
    text = (ROOT / "CHANGELOG.md").read_text("utf-8")
    with (ROOT / "pyproject.toml").open("rb") as file:
        version = tomllib.load(file)["project"]["version"]
    newest = re.search(r"^## \[([\d.]+)\] - \d{4}-\d\d-\d\d$", text, re.MULTILINE)
    assert newest is not None and newest.group(1) == version
