"""The published format, and the published data."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from envgraph.errors import LoadError, Source
from envgraph.search import (
    Family,
    export_ga4cl,
    import_ga4cl,
)
from tests.profile import NIGHTLY


def source(path: Path) -> Source:
    return Source(path.name, path.read_text())


def imported(path: Path, tmp_path: Path) -> Family:
    family, warnings = import_ga4cl(source(path), "burning_forest/paper.toml", tmp_path / f"{path.stem}.sqlite")
    assert not warnings  # neither a complexity nor a reward differs
    return family


def test_path_complexity_reproduces_every_published_complexity(published_files: list[Path], tmp_path: Path) -> None:
    checked = 0
    for path in published_files if NIGHTLY else published_files[::4]:
        published = sorted(one["complexity"] for one in json.loads(path.read_text())["environments"])
        found = sorted(member.measures["complexity"] for member in imported(path, tmp_path).members)
        assert found == pytest.approx(published, abs=1e-12)
        checked += len(found)
    assert (len(published_files), checked) == (31, 186 if NIGHTLY else 48)


def test_export_of_the_imported_published_family_equals_the_original(published: Path, tmp_path: Path) -> None:
    family = imported(published, tmp_path)
    exported, original = json.loads(export_ga4cl(family)), json.loads(published.read_text())
    assert exported == original


def test_export_keeps_complexities_exactly(published: Path, tmp_path: Path) -> None:
    family = imported(published, tmp_path)
    (tmp_path / "again.json").write_text(export_ga4cl(family))
    again = imported(tmp_path / "again.json", tmp_path)
    assert [m.measures for m in again.members] == [m.measures for m in family.members]


def test_family_with_moved_water_tiles_is_imported_without_a_target(
    published_files: list[Path], tmp_path: Path
) -> None:
    family = imported(published_files[1], tmp_path)
    assert len(family.members) == 6
    assert not any(member.initial for member in family.members)


def problems(text: str, tmp_path: Path) -> list[str]:
    with pytest.raises(LoadError) as caught:
        import_ga4cl(Source("maps.json", text), "burning_forest/paper.toml", tmp_path / "run.sqlite")
    assert all(problem.span for problem in caught.value.diagnostics)
    return [str(problem) for problem in caught.value.diagnostics]


def test_unknown_letter_is_reported_with_its_row_and_column(published: Path, tmp_path: Path) -> None:
    (problem,) = problems(published.read_text().replace('"RVVVRRVV"', '"RVXVRRVV"', 1), tmp_path)
    assert problem.split("\n")[0] == "maps.json:7:12: `X` has no meaning in the model"
    assert problem.split("\n")[2].index("^") == problem.split("\n")[1].index("X")


def test_all_mistakes_of_a_file_are_reported_together(tmp_path: Path) -> None:
    text = '{"environments": [{"env_id": 3, "desc": ["SG", "R"], "complexty": 1}, {"env_id": "x"}, 5]}'
    found = problems(text, tmp_path)
    assert len(found) == 5
    assert any("did you mean `complexity`?" in problem for problem in found)


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"environments": []}', '{"environments": 3}', '{"environments": [{"desc": []}]}']
)
def test_files_that_are_not_ga4cl_are_refused(text: str, tmp_path: Path) -> None:
    assert problems(text, tmp_path)
    assert not (tmp_path / "run.sqlite").exists()


def test_a_map_of_another_size_is_read_in_its_size(tmp_path: Path) -> None:
    text = Source("maps.json", '{"environments": [{"env_id": "a", "desc": ["SR", "RG"]}]}')
    family, _ = import_ga4cl(text, "burning_forest/paper.toml", tmp_path / "run.sqlite")
    assert [member.measures["complexity"] for member in family.members] == [0.0]
    assert json.loads(export_ga4cl(family))["environments"][0]["desc"] == ["SR", "RG"]


def test_another_complexity_or_reward_is_a_warning(published: Path, tmp_path: Path) -> None:
    data = json.loads(published.read_text())
    data["environments"][1]["complexity"] = 0.5
    data["environments"][2]["reward_schedule"][4] = 99.0
    text = Source("maps.json", json.dumps(data))
    _, warnings = import_ga4cl(text, "burning_forest/paper.toml", tmp_path / "run.sqlite")
    assert [warning.code for warning in warnings] == ["different-measure", "different-rewards"]
