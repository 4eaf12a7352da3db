"""Parts of a family: bands, and members that are kept for tests."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envgraph.errors import InvalidArgument
from envgraph.search import Family, Member, generate, open_family, read_family, write_family


@pytest.fixture(scope="module")
def family(tmp_path_factory: pytest.TempPathFactory) -> Family:
    return generate("burning_forest/paper.toml", tmp_path_factory.mktemp("made") / "run.sqlite", samples=40)


@pytest.fixture(scope="module")
def tiles(family: Family) -> dict[str, list[str]]:
    """The classes of the tiles of each member: nothing else of them differs."""
    models = {member.name: family.model(member) for member in family.members}
    return {name: [model.graph.class_of(node) for node in range(1, 65)] for name, model in models.items()}


def map_distance(one: list[str], other: list[str]) -> int:
    return sum(a != b for a, b in zip(one, other, strict=True))


def names(family: Family) -> list[str]:
    return [member.name for member in family.members]


def test_distances_of_members_count_the_different_tiles_of_their_maps(
    family: Family, tiles: dict[str, list[str]]
) -> None:
    found = family.distances()
    assert found.shape == (40, 40) and (found == found.T).all() and not found.diagonal().any()
    maps = [*tiles.values()]
    assert found.tolist() == [[map_distance(one, other) for other in maps] for one in maps]
    assert (found[:, None, :] <= found[:, :, None] + found[None]).all()  # none is longer than by way of a third


def test_split_assigns_each_member_to_one_part_reproducibly(family: Family) -> None:
    trained, tested = family.split(0.25, seed=3)
    assert (len(trained.members), len(tested.members)) == (30, 10)
    assert sorted([*names(trained), *names(tested)]) == sorted(names(family))
    for part in (trained, tested):
        assert names(part) == [name for name in names(family) if name in names(part)]
    again, other = family.split(0.25, seed=3), family.split(10, seed=4)
    assert names(again[1]) == names(tested) != names(other[1]) and len(other[1].members) == 10


def test_sampled_test_members_are_never_the_target(family: Family) -> None:
    for seed in range(8):
        trained, tested = family.split(30, seed=seed)
        assert names(trained)[-1] == "E40" and len(tested.members) == 30
    trained, tested = family.split(39)
    assert names(trained) == ["E40"] and not any(one.initial for one in tested.members)
    trained, tested = family.split(lambda member: member.name == "E40")
    assert names(tested) == ["E40"] and len(trained.members) == 39
    levels = replace(family, members=tuple(replace(one, initial=False) for one in family.members))  # as if imported
    assert any("E40" in names(levels.split(0.5, seed=seed)[1]) for seed in range(8))


def test_split_with_a_minimum_distance_removes_members_close_to_the_other_part(
    family: Family, tiles: dict[str, list[str]]
) -> None:
    trained, tested = family.split(5, apart=9, seed=1)
    assert 0 < len(trained.members) < 35
    left_out = set(names(family)) - {*names(trained), *names(tested)}
    for member in family.members:
        if member.name not in names(tested):
            nearest = min(map_distance(tiles[member.name], tiles[other]) for other in names(tested))
            assert (nearest < 9) == (member.name in left_out)


def test_split_by_a_predicate_selects_the_test_members(family: Family) -> None:
    values = sorted(member.measures["complexity"] for member in family.members)
    trained, tested = family.split(lambda member: member.measures["complexity"] >= values[30])
    assert len(tested.members) == sum(value >= values[30] for value in values)
    assert max(one.measures["complexity"] for one in trained.members[:-1]) < values[30]
    low, high = values[3], values[8]
    band = [one.name for one in family.members if low <= one.measures["complexity"] <= high]
    assert names(family.between("complexity", low, high)) == band and len(band) >= 6


def test_spaced_members_are_evenly_distributed_by_complexity(family: Family) -> None:
    found = family.spaced(6)
    values = [one.measures["complexity"] for one in family.members[:-1]]
    assert found.members[-1].initial and names(found)[-1] == "E40" and len(set(names(found))) == 6
    wanted = np.linspace(min(values), max(values), 5)
    for member, value in zip(found.members, wanted, strict=False):
        nearest = sorted(abs(one - value) for one in values)
        assert abs(member.measures["complexity"] - value) in nearest[:5]
    assert found.members[0].measures["complexity"] == values[0]
    assert names(family.spaced(40)) == names(family) and len(family.spaced(2).members) == 2


def test_subset_keeps_the_names_and_key_index_of_the_family(family: Family, tmp_path: Path) -> None:
    part = family.subset(["E9", family.members[2], 5])
    assert names(part) == ["E3", "E5", "E9"] and part.keys == family.keys
    file = tmp_path / "part.json"
    file.write_text(write_family(part))
    assert [one.model for one in read_family(file).members] == [one.model for one in part.members]


def test_written_subset_keeps_the_key_index_of_the_whole_family(family: Family, tmp_path: Path) -> None:
    document = json.loads(write_family(family.subset(["E1"])))
    known = document["keys"]["Tile"]
    document["keys"]["Tile"] = [*known, [99, 99]]  # of a member that is in the other part
    file = tmp_path / "part.json"
    file.write_text(json.dumps(document))
    found = open_family(file)
    assert found.keys.size("Tile") == len(known) + 1
    table = found.explored(found.members[0]).tabular
    assert table.n_observations > family.explored(family.members[0]).tabular.n_observations


def test_family_is_returned_as_columns_of_member_values(family: Family) -> None:
    columns = family.columns()
    assert [*columns] == ["name", "initial", "complexity"] and columns["initial"].sum() == 1
    assert columns["complexity"].tolist() == [one.measures["complexity"] for one in family.members]
    certified = Member("E1", {"complexity": 0.5}, family.members[0].model, certificates={"plan": None, "limit": 9.0})
    found = Family(family.name, family.bundle, (certified, family.members[1]), family.domain).columns()
    assert np.isnan(found["plan"]).all() and found["limit"][0] == 9.0 and np.isnan(found["limit"][1])


@pytest.mark.parametrize(
    "asked",
    [
        lambda family: family.split(1.0),
        lambda family: family.split(0),
        lambda family: family.split(40),
        lambda family: family.split(lambda member: True),
        lambda family: family.split(lambda member: False),
        lambda family: family.split(apart=1000),
        lambda family: family.spaced(1),
        lambda family: family.spaced(41),
        lambda family: family.subset([]),
        lambda family: family.subset(["E99"]),
        lambda family: family.between("complexity", 2, 3),
        lambda family: family.between("complexiy", 0, 1),
    ],
)
def test_invalid_or_empty_subsets_are_refused(family: Family, asked: Any) -> None:
    with pytest.raises(InvalidArgument, match=r"member|environment|complexity"):
        asked(family)
