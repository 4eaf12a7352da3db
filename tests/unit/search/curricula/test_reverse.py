"""Families of states of an optimal episode: without any search, with free steps, and what is said of them."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from envgraph.cli import main
from envgraph.lang import data_path
from envgraph.search import Domain, Family, Outcome, RunStore, describe_search, generate, why_low
from envgraph.search.curricula import FamilyMoves, FirstFamilySampler, LearningObjective, LevelFactory
from envgraph.search.curricula._first_families import Easing, FamilyOrigin
from envgraph.search.curricula._reverse_curricula import GOOD_SUCCESS_RATE, reverse_curriculum
from envgraph.solve import evaluate
from envgraph.solve.learning import TrainingSettings, train_curriculum

pytestmark = pytest.mark.skipif(find_spec("numba") is None, reason="numba, the extra `fast`, is not installed")


def small(tmp_path: Path, *more: str, effort: int = 50_000_000) -> str:
    """Write the family file of the small forest."""
    folder = tmp_path / "domain"
    folder.mkdir()
    for file in data_path("rules", "burning_forest").iterdir():
        if file.is_file():
            (folder / file.name).write_bytes(file.read_bytes())
    text = f"""
    name = "Small"
    model = "running_4x4.model"
    environment = "burning_forest.environment"
    constraints.require = ["solvable", "truckOnStart"]
    measures.fires = {{ kind = "count", of = "burningTile" }}
    diversity = {{ kind = "binned_entropy", of = "fires", range = [0, 8] }}
    objective = {{ kind = "learning", effort = {effort} }}
    mutation.rules = ["retypings"]
    """
    file = folder / "small.toml"
    file.write_text("\n".join(line.strip() for line in text.split("\n")) + "\n".join(more))
    return str(file)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Family]:
    """The directory of the small forest, and its family."""
    folder = tmp_path_factory.mktemp("found")
    return folder, generate(small(folder), folder / "run.sqlite")


def test_missing_training_steps_and_population_are_chosen_by_the_search(
    tmp_path: Path, found: tuple[Path, Family]
) -> None:
    _, family = found
    training, outcome = family.domain.spec.training, Outcome.of(family)
    assert family.value is not None and family.value >= GOOD_SUCCESS_RATE
    assert training.steps_per_environment * len(family.members) == family.objective["steps"] < 5_000
    assert family.domain.spec.search.population == len(family.members)
    assert f"after as many steps on {family.members[-1].name} alone" in str(outcome)
    # Learners that the search has not seen do as well.
    tables = [family.explored(member).tabular for member in family.members]
    settings = TrainingSettings.from_spec(training, limit=family.limit)
    steps = [training.steps_per_environment] * len(tables)
    rngs = [np.random.default_rng(seed) for seed in range(30)]
    trained = [train_curriculum(tables, settings, rng, steps=steps).q for rng in rngs]
    solved = [evaluate(q, tables[-1], 1, settings.limit, rngs[0]).success_rate for q in trained]
    assert np.mean(solved) > 0.9
    again = generate(small(tmp_path), tmp_path / "again.sqlite")
    assert (again.members, again.objective) == (family.members, family.objective)


def test_constraints_violated_during_the_episode_apply_only_to_the_target(
    found: tuple[Path, Family],
) -> None:
    folder, family = found
    trucks = [family.text(member) for member in family.members]
    assert len(set(trucks)) == len(trucks)
    with RunStore.open(folder / "run.sqlite") as store:
        sentences = describe_search(family, store)
        assert why_low(family, store) is None
    target = family.members[-1].name
    assert f"only {target} has to satisfy these constraints: `require truckOnStart`" in sentences
    assert sentences[0].startswith(f"the environments before {target} are states of an optimal episode")
    domain = family.domain
    first = domain.problem(domain.engine(family.model(family.members[0])))
    assert list(map(str, first.violated_constraints())) == ["require truckOnStart"]


def test_reverse_curriculum_tries_fewer_members_first_with_evenly_spaced_states(tmp_path: Path) -> None:
    domain = Domain.load(small(tmp_path))
    assert domain.behaviour is not None
    levels = LevelFactory(domain.problem(domain.engine()), domain.behaviour)
    starts = FirstFamilySampler(levels, FamilyMoves(levels), None, np.random.default_rng(0), "auto")
    objective = LearningObjective(TrainingSettings(limit=50), levels.target, [], 1)
    tried = []

    def success(family: object, learning: LearningObjective, seeds: int) -> float:
        tried.append((len(family), learning.steps[0], seeds))  # type: ignore[arg-type]
        return float(len(family) == 4 and learning.steps[0] * 4 > 500)  # type: ignore[arg-type]

    found = reverse_curriculum(starts, objective, (3, 4, 99), success, lambda: False)
    assert found is not None and (len(found.family), found.success) == (4, 1.0)
    assert [seeds for size, *_, seeds in tried if size == 4][-3:] == [8, 100, 500]
    assert all(seeds == 8 for size, *_, seeds in tried if size == 3)
    assert 500 < 4 * found.objective.steps[0] < 650
    left = []
    for level in found.family:
        levels.check_out(level.version)
        left.append(len(level.trace))
    assert left == sorted(set(left), reverse=True) and left[-1] == 0


def test_family_that_teaches_little_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    few = ("training.steps_per_environment = 2", "search.population = 3")
    file = small(tmp_path, *few, effort=3_000_000)
    place = ("--name", "little", "--directory", str(tmp_path))
    monkeypatch.setattr("sys.argv", ["envgraph", "generate", file, *place, "--require", "0.9"])
    assert main() == 1
    out, error = capsys.readouterr()
    assert "0.0% of new learners solve E3 after 6 steps in all" in out
    assert "the family teaches little: 0.0% of new learners solve E3" in error
    assert "the family has a value of 0.000, but `--require` is 0.9" in error
    assert (tmp_path / "little" / "run.sqlite").exists()


def test_samples_can_be_generated_from_a_file_with_a_learning_objective(tmp_path: Path) -> None:
    family = generate(small(tmp_path), tmp_path / "run.sqlite", samples=5)
    assert len(family.members) == 5 and family.value is None


def test_generations_option_is_refused_for_a_file_with_an_objective(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("generate", small(tmp_path), "--directory", str(tmp_path), "--generations", "3")
    monkeypatch.setattr("sys.argv", ["envgraph", *words])
    assert main() == 1
    assert "small.toml` has an objective for whole families" in capsys.readouterr().err


def test_value_of_a_poor_family_is_measured_with_new_learners(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The success by which it was chosen is that of the luckiest of many families on few seeds."""
    monkeypatch.setattr(LearningObjective, "success_rate", lambda self, family, seeds: 0.5 if len(seeds) == 8 else 0.25)
    few = ("training.steps_per_environment = 2", "search.population = 3")
    family = generate(small(tmp_path, *few, effort=3_000_000), tmp_path / "run.sqlite")
    assert family.value == 0.25


def test_constraints_of_the_target_are_named_for_eased_members(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    eased = FamilyOrigin(None, Easing("retype RoadTile", "retype RoadTile"))
    monkeypatch.setattr(FirstFamilySampler, "reverse_curricula", lambda self, size: iter(()))
    monkeypatch.setattr(FirstFamilySampler, "sample_origin", lambda self, rng: eased)
    steps = ("training.steps_per_environment = 300", "search.population = 3")
    family = generate(small(tmp_path, *steps, effort=3_000_000), tmp_path / "run.sqlite")
    with RunStore.open(tmp_path / "run.sqlite") as store:
        sentences = describe_search(family, store)
    assert sentences[0].startswith("the environments before E3 are the target, eased by mutations")
    assert "only E3 has to satisfy these constraints: `require truckOnStart`" in sentences
