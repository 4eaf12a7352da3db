"""Mutations of many applications: what moves a model on which one change is not seen."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from random import Random

import pytest

from envgraph.lang import bundled_domain
from envgraph.search import (
    Family,
    Generation,
    Outcome,
    RunStore,
    generate,
    open_family,
    random_families,
    resume,
    why_low,
)

SIZE = 16
TILES = Random(4).choices("BRV", [0.3, 0.45, 0.25], k=SIZE * SIZE)
TILES[0], TILES[117], TILES[-1] = "SWG"
FIRES = TILES.count("B")
STRENGTH = ("mutation.strength=heavy_tailed",)


@pytest.fixture
def forest(tmp_path: Path) -> str:
    """All paths to the right and down are blocked, and by many fires each; there is a detour."""
    for file in bundled_domain("burning_forest").glob("*.*"):
        (tmp_path / file.name).write_text(file.read_text())
    rows = "\n                ".join("".join(TILES[row : row + SIZE]) for row in range(0, SIZE * SIZE, SIZE))
    (tmp_path / "target_8x8.model").write_text(
        f"""import "burning_forest.metamodel"
model target : burning_forest {{
    forest : Forest {{
        states = grid tile {{
            column x next right
            row y next down
            rows \"\"\"
                {rows}
                \"\"\"
        }}
        agent = truck : FireTruck {{ currentState = tile[0, 0] }}
    }}
}}
"""
    )
    path = tmp_path / "paper.toml"
    places = '"startTileFixedLocation", "goalTileFixedLocation", "waterTileFixedLocation", '
    path.write_text(path.read_text().replace(places, ""))
    return str(path)


def evolved(forest: str, store: Path, generations: int, *overrides: str) -> Family:
    return generate(forest, store, seed=1, population=20, generations=generations, overrides=(*STRENGTH, *overrides))


def test_heavy_tailed_strength_reaches_all_bins_of_a_large_model(forest: str, tmp_path: Path) -> None:
    single = evolved(forest, tmp_path / "single.sqlite", 25, "mutation.strength=single")
    assert Outcome.of(single).diversity == 0
    with RunStore.open(tmp_path / "single.sqlite") as store:
        low = why_low(single, store)
    assert low is not None and 'such as `strength = "heavy_tailed"` in `[mutation]`' in (low.hint or "")
    found = Outcome.of(evolved(forest, tmp_path / "tailed.sqlite", 25))
    assert found.diversity == found.maximum and len(set(found.bins)) == 20


def test_mutations_have_few_or_many_applications_of_one_or_several_rules(forest: str, tmp_path: Path) -> None:
    evolved(forest, tmp_path / "run.sqlite", 10, "search.target=false")
    with RunStore.open(tmp_path / "run.sqlite") as store:
        traces = [one.trace for one in store.individuals() if one.generation > 0]
    sizes = Counter(len(trace).bit_length() for trace in traces)
    assert len(traces) > 100 and all(sizes[bits] for bits in range(1, 8)) and max(sizes) <= 10
    alike = [len({rule for rule, _ in trace}) == 1 for trace in traces if len(trace) > 8]
    assert 0 < sum(alike) < len(alike)
    quenched = [trace for trace in traces if len(trace) >= FIRES and "BurningTile" in trace[0][0]]
    assert quenched, "now and then all fires go out at once"


@pytest.mark.parametrize("last", [0, 3])
def test_an_interrupted_run_resumes_to_the_same_store(forest: str, tmp_path: Path, last: int) -> None:
    class Interrupted(Exception):
        pass

    def interrupt(generation: Generation) -> None:
        if generation.number > last:
            raise Interrupted

    evolved(forest, tmp_path / "whole.sqlite", 5)
    with pytest.raises(Interrupted):
        generate(
            forest,
            tmp_path / "cut.sqlite",
            seed=1,
            population=20,
            generations=5,
            overrides=STRENGTH,
            progress=interrupt,
        )
    resume(tmp_path / "cut.sqlite")
    with RunStore.open(tmp_path / "cut.sqlite") as cut, RunStore.open(tmp_path / "whole.sqlite") as whole:
        assert list(cut.individuals()) == list(whole.individuals())
        assert cut.generation_statistics() == whole.generation_statistics() and len(whole.generation_statistics()) == 6


def test_random_families_use_the_mutation_strength_of_the_file(forest: str, tmp_path: Path) -> None:
    evolved(forest, tmp_path / "run.sqlite", 2)
    family = open_family(str(tmp_path / "run.sqlite"), tmp_path)
    found = next(random_families(family, 1, (1,) * 20))
    fires = [family.model(member).graph.extent("BurningTile") for member in found.members]
    assert max(abs(len(one) - FIRES) for one in fires) > 10
