"""Families that nothing has selected."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from envgraph.errors import InvalidArgument, Source
from envgraph.search import (
    Family,
    RunStore,
    generate,
    import_ga4cl,
    lineage_lengths,
    open_family,
    random_families,
)
from tests.unit.learn.forest_tables import DATA


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("made") / "run.sqlite"
    generate("burning_forest/paper.toml", path, generations=4, population=4)
    return path


@pytest.fixture(scope="module")
def family(run: Path) -> Family:
    return open_family(str(run), run.parent)


def models(family: Family) -> list[str]:
    return [member.model for member in family.members]


def test_random_families_have_valid_ordered_members_and_the_same_target(family: Family) -> None:
    for number, found in enumerate(random_families(family, 3, (2, 9, 30)), start=1):
        assert found.name == f"{family.name}, random {number}"
        assert [member.name for member in found.members] == ["E1", "E2", "E3", "E4"]
        assert found.members[-1].model == family.members[-1].model and found.members[-1].initial
        values = [member.measures["complexity"] for member in found.members[:-1]]
        assert values == sorted(values) and len(set(models(found))) == 4
        for member in found.members:
            problem = found.domain.problem(found.domain.engine(found.model(member)))
            assert problem.is_valid() and problem.compute_measures() == member.measures
        table = found.explored(found.members[0]).tabular
        assert table.n_observations == found.explored(found.members[-1]).tabular.n_observations


def test_random_family_depends_only_on_its_seed_and_number(family: Family) -> None:
    first = [models(one) for one in random_families(family, 3, (5, 5, 5))]
    assert first[:2] == [models(one) for one in random_families(family, 2, (5, 5, 5))]
    assert len({model for one in first for model in one}) == 3 * 3 + 1
    assert first[0] != next(models(one) for one in random_families(family, 1, (5, 5, 5), seed=1))


def test_members_lie_the_given_number_of_applications_from_the_target(family: Family) -> None:
    """Each mutation of the forest retypes one tile."""
    (still,) = random_families(family, 1, (0, 0, 0))
    assert set(models(still)) == {family.members[-1].model}
    target = family.domain.engine().model
    tiles = {node.id: node.cls for node in target.nodes("Tile")}
    for steps in (1, 2):
        (one,) = random_families(family, 1, (steps,) * 3)
        for member in one.members[:-1]:
            found = {node.id: node.cls for node in one.model(member).nodes("Tile")}
            changed = sum(found[id_] != name for id_, name in tiles.items())
            assert changed == 1 if steps == 1 else changed <= 2


def test_lineage_lengths_equal_those_of_the_store(run: Path, family: Family) -> None:
    with RunStore.open(run) as store:
        lengths = lineage_lengths(family, store)
        stored = {one.id: one for one in store.individuals()}
    assert len(lengths) == 3
    for member, length in zip(family.members, lengths, strict=False):
        at, steps = member.individual, 0
        while at is not None:
            at, steps = stored[at].parent, steps + len(stored[at].trace)
        assert steps == length > 0


@pytest.mark.parametrize(
    "act",
    [
        lambda family: list(random_families(family, -1, (1,))),
        lambda family: list(random_families(family, 1, (1, -1))),
    ],
)
def test_negative_numbers_are_refused(family: Family, act: Callable[[Family], object]) -> None:
    with pytest.raises(InvalidArgument, match="negative"):
        act(family)


def test_imported_members_have_no_lineage(tmp_path: Path) -> None:
    path = DATA / "environment-config.json"
    imported, _ = import_ga4cl(
        Source(str(path), path.read_text()), "burning_forest/paper.toml", tmp_path / "run.sqlite"
    )
    with (
        RunStore.open(tmp_path / "run.sqlite") as store,
        pytest.raises(InvalidArgument, match="was imported"),
    ):
        lineage_lengths(imported, store)
